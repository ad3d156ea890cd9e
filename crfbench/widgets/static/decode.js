// The decoder of an SLR in JavaScript, and what LatentExplorer says of a decoded curve.

import { float32, uint16 } from "./plot.js";

const LEAST_STEP = 1e-6; // as in the Python model

/**
 * @typedef {{ columns: number, weight: Float32Array, bias: Float32Array }} Layer
 * @typedef {{ names: string[], samples: Float64Array }} Curves thinned samples, curve after curve
 */

const sigmoid = (/** @type {number} */ x) => 1 / (1 + Math.exp(-x));
const softplus = (/** @type {number} */ x) => Math.max(x, 0) + Math.log1p(Math.exp(-Math.abs(x)));
export const normal = (/** @type {number} */ z) => Math.exp((-z * z) / 2) / Math.sqrt(2 * Math.PI);

/**
 * The layers of a decoder from its numbers: for each, the weights row by row, then the biases.
 * @param {number[]} sizes
 * @param {Float32Array} numbers
 * @returns {Layer[]}
 */
export function unpackLayers(sizes, numbers) {
  let start = 0;
  const next = (/** @type {number} */ count) => numbers.subarray(start, (start += count));
  return sizes.slice(1).map((rows, i) => ({ columns: sizes[i], weight: next(rows * sizes[i]), bias: next(rows) }));
}

function affine(/** @type {Layer} */ { columns, weight, bias }, /** @type {ArrayLike<number>} */ input) {
  const output = new Float64Array(bias.length);
  for (let row = 0, k = 0; row < bias.length; row++) {
    let sum = bias[row];
    for (let column = 0; column < columns; column++) sum += weight[k++] * input[column];
    output[row] = sum;
  }
  return output;
}

// Positive steps, summed and divided by their sum: from exactly 0 to exactly 1.
function risingCurve(/** @type {Float64Array} */ raw) {
  const curve = new Float64Array(raw.length + 1);
  for (let i = 0; i < raw.length; i++) curve[i + 1] = curve[i] + softplus(raw[i]) + LEAST_STEP;
  const total = curve[raw.length];
  return curve.map((sum) => sum / total);
}

// What each hidden layer makes of a latent, in order.
export function hiddenLayers(/** @type {Layer[]} */ layers, /** @type {number[]} */ latent) {
  let h = Float64Array.from(latent);
  return layers.slice(0, -1).map((layer) => (h = affine(layer, h).map((x) => Math.max(0, x))));
}

/**
 * The curve of a latent, in double precision.
 * @param {{ layers: Layer[], monotone: boolean }} model
 * @param {number[]} latent
 */
export function decode({ layers, monotone }, latent) {
  const [last] = hiddenLayers(layers, latent).slice(-1);
  const raw = affine(layers[layers.length - 1], last);
  return monotone ? risingCurve(raw) : raw.map(sigmoid);
}

function rms(/** @type {number} */ count, /** @type {(i: number) => number} */ difference) {
  let sum = 0;
  for (let i = 0; i < count; i++) sum += difference(i) ** 2;
  return Math.sqrt(sum / count);
}

// The place of the least f between low and high, where f falls and then rises.
function goldenSection(/** @type {(x: number) => number} */ f, /** @type {number} */ low, /** @type {number} */ high) {
  const share = (Math.sqrt(5) - 1) / 2;
  while (high - low > 1e-5) {
    const [left, right] = [high - share * (high - low), low + share * (high - low)];
    if (f(left) < f(right)) high = right;
    else low = left;
  }
  return (low + high) / 2;
}

// The power x^gamma nearest in least squares: the best of a table of exponents, then golden section around it.
export function nearestPower(/** @type {Float64Array} */ samples) {
  const n = samples.length;
  const distance = (/** @type {number} */ log) => rms(n, (i) => (i / (n - 1)) ** (2 ** log) - samples[i]);
  const table = Array.from({ length: 49 }, (_, i) => i / 4 - 6); // gamma from 1/64 to 64
  const distances = table.map(distance);
  const best = table[distances.indexOf(Math.min(...distances))];
  const log = goldenSection(distance, best - 0.25, best + 0.25);
  return { gamma: 2 ** log, rmse: distance(log) };
}

/**
 * Measured curves come for each direction as 16-bit samples.
 * @param {Record<string, { names: string[], samples: DataView }> | null} packed
 * @returns {Record<string, Curves>}
 */
export function unpackCurves(packed) {
  const unpacked = Object.entries(packed ?? {}).map(([direction, { names, samples }]) => [
    direction,
    { names, samples: Float64Array.from(uint16(samples), (value) => value / 65535) },
  ]);
  return Object.fromEntries(unpacked);
}

export function nearestCurve(/** @type {Curves} */ { names, samples }, /** @type {Float64Array} */ thinned) {
  const n = thinned.length;
  const distances = names.map((_, row) => rms(n, (i) => samples[row * n + i] - thinned[i]));
  const rmse = Math.min(...distances);
  const row = distances.indexOf(rmse);
  return { name: names[row], rmse, samples: samples.subarray(row * n, (row + 1) * n) };
}

// Mean of normal curves at the latents, at evenly spaced places; their width follows Scott's rule.
export function kernelDensity(/** @type {Float32Array} */ latents, /** @type {number[]} */ places) {
  const mean = latents.reduce((a, b) => a + b, 0) / latents.length;
  const sd = rms(latents.length, (i) => latents[i] - mean);
  const width = Math.max(sd * latents.length ** -0.2, 0.02);
  return places.map((z) => {
    return latents.reduce((sum, latent) => sum + normal((z - latent) / width), 0) / (latents.length * width);
  });
}

/**
 * What Python packed of a model, with its numbers unpacked.
 * @typedef {object} Packed
 * @property {string} name
 * @property {string[]} labels of the latents
 * @property {string} direction
 * @property {boolean} monotone
 * @property {number[]} sizes
 * @property {DataView} weights
 * @property {DataView} latents of the training curves
 * @property {string} xLabel
 * @property {string} yLabel
 * @param {Packed} packed
 */
export const unpackModel = (packed) => ({
  ...packed,
  layers: unpackLayers(packed.sizes, float32(packed.weights)),
  latents: float32(packed.latents),
});
