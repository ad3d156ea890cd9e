import assert from "node:assert/strict";
import { test } from "node:test";

import { decode, kernelDensity, nearestCurve, nearestPower, normal, unpackLayers } from "../../crfbench/widgets/static/decode.js";

const sigmoid = (x) => 1 / (1 + Math.exp(-x));
const close = (a, b, tolerance = 1e-12) => assert.ok(Math.abs(a - b) <= tolerance, `${a} is not ${b}`);

// One latent, two hidden units of which z = 1 leaves one at 0, three samples.
const LAYERS = unpackLayers([1, 2, 3], Float32Array.from([2, -1, 0.5, 0.25, 1, 4, 0.5, 4, -1, 4, 0, -2.5, 1]));

test("layers are weights row by row, then biases", () => {
  assert.deepEqual([...LAYERS[0].weight, ...LAYERS[0].bias], [2, -1, 0.5, 0.25]);
  assert.deepEqual([...LAYERS[1].weight], [1, 4, 0.5, 4, -1, 4]);
  assert.deepEqual([...LAYERS[1].bias], [0, -2.5, 1]);
  assert.deepEqual(LAYERS.map(({ columns }) => columns), [1, 2]);
});

test("a plain decoder ends in a sigmoid", () => {
  const curve = decode({ layers: LAYERS, monotone: false }, [1]); // hidden: 2.5 and 0
  [2.5, -1.25, -1.5].forEach((raw, i) => close(curve[i], sigmoid(raw)));
});

test("a monotone decoder sums positive steps and ends at exactly 1", () => {
  const curve = decode({ layers: LAYERS, monotone: true }, [1]);
  const steps = [2.5, -1.25, -1.5].map((raw) => Math.log(1 + Math.exp(raw)) + 1e-6);
  const sum = steps[0] + steps[1] + steps[2];
  assert.equal(curve.length, 4);
  assert.equal(curve[0], 0);
  close(curve[1], steps[0] / sum);
  close(curve[2], (steps[0] + steps[1]) / sum);
  assert.equal(curve[3], 1);
});

test("far latents give finite curves", () => {
  for (const z of [-1e6, 1e6]) {
    for (const monotone of [false, true]) assert.ok(decode({ layers: LAYERS, monotone }, [z]).every(Number.isFinite));
  }
});

test("the nearest power of a power is that power", () => {
  for (const gamma of [0.1, 0.45, 1, 2.2, 30]) {
    const power = nearestPower(Float64Array.from({ length: 94 }, (_, i) => (i / 93) ** gamma));
    close(power.gamma / gamma, 1, 1e-4);
    close(power.rmse, 0, 1e-5);
  }
});

test("the nearest curve is the one with the least RMSE", () => {
  const curves = { names: ["a", "b"], samples: Float64Array.from([0, 0.2, 1, 0, 0.6, 1]) };
  const { name, rmse, samples } = nearestCurve(curves, Float64Array.from([0, 0.5, 1]));
  assert.equal(name, "b");
  close(rmse, 0.1 / Math.sqrt(3));
  assert.deepEqual([...samples], [0, 0.6, 1]);
});

test("a kernel density has the area 1", () => {
  const places = Array.from({ length: 2001 }, (_, i) => i / 100 - 10);
  const density = kernelDensity(Float32Array.from([-1, 0, 0.5, 2]), places);
  close(density.reduce((a, b) => a + b, 0) / 100, 1, 1e-6);
  close(normal(0), 0.3989422804014327);
});
