// One training at one epoch, for EpochPlayer and TrainingPanel: the histogram of its latents and curves it decodes.

import { element, readouts, written } from "./controls.js";
import { bytesOf, float32, Plot, uint16 } from "./plot.js";

/**
 * What Python packed of a training; rows of its numbers are the epochs kept.
 * @typedef {object} Packed
 * @property {string} name
 * @property {number[]} epochs
 * @property {string} xLabel
 * @property {string} yLabel
 * @property {DataView} latents
 * @property {DataView} probes
 * @property {DataView} figures
 */

const REACH = 5; // latents shown to either side of 0; those beyond count in the outermost bars
const BAR = 0.25; // width of a bar
const MOST = 0.8; // density at the top of the histogram: twice the peak of N(0, 1)
const PROBE_COUNT = 9; // curves decoded at each epoch, from z = -2 to z = 2

export const NOTE =
  "Bars: latents of the n training curves, density in bars of 0.25 (beyond ±5: in the outermost; above 0.8: cut). " +
  "Dashed outline: N(0,\u00a01). Below, decoded curves (relative, 0 to 1): z from −2 to −0.5 dashed, blue; 0 thick, " +
  "green; 0.5 to 2 thin, orange.";

const PRIOR = Array.from({ length: 81 }, (_, i) => Math.exp(-((i / 8 - REACH) ** 2) / 2) / Math.sqrt(2 * Math.PI));

// The number that 16 bits stand for: sign, 5 bits of exponent, 10 of fraction (IEEE 754, without infinities).
export function half(/** @type {number} */ bits) {
  const exponent = (bits >> 10) & 31;
  const fraction = (bits & 1023) / 1024;
  const size = exponent === 0 ? fraction * 2 ** -14 : (1 + fraction) * 2 ** (exponent - 15);
  return bits & 0x8000 ? -size : size;
}

// How many latents each bar of the histogram holds.
export function histogram(/** @type {Float32Array} */ latents) {
  const counts = new Array((2 * REACH) / BAR).fill(0);
  for (const z of latents) counts[Math.max(0, Math.min(counts.length - 1, Math.floor((z + REACH) / BAR)))] += 1;
  return counts;
}

/** A training with its numbers unpacked. */
export class Run {
  constructor(/** @type {Packed} */ { name, epochs, xLabel, yLabel, latents, probes, figures }) {
    this.name = name;
    this.epochs = epochs;
    this.labels = [xLabel, yLabel];
    this.latents = Float32Array.from(uint16(latents), half);
    this.probes = new Uint8Array(bytesOf(probes));
    this.figures = float32(figures);
    this.size = this.latents.length / epochs.length;
    this.last = epochs[epochs.length - 1];
  }

  // The row of the latest epoch that is not after `epoch`.
  rowAt(/** @type {number} */ epoch) {
    return Math.max(0, this.epochs.findLastIndex((kept) => kept <= epoch));
  }

  /**
   * @template {Float32Array | Uint8Array} T
   * @param {T} numbers
   * @param {number} row
   * @param {number} [parts] into which the row falls
   * @returns {T[]}
   */
  parts(numbers, row, parts = 1) {
    const length = numbers.length / this.epochs.length / parts;
    return Array.from({ length: parts }, (_, i) => {
      const start = (row * parts + i) * length;
      return /** @type {T} */ (numbers.subarray(start, start + length));
    });
  }
}

/**
 * @param {number} side which of the curves, counted from the one of z = 0
 * @returns {Omit<import("./plot.js").Line, "type"> & import("./plot.js").Look}
 */
function probeLook(side) {
  if (side === 0) return { colour: "green", width: 3 };
  return side < 0 ? { colour: "blue", dash: "dashed", width: 1.2 } : { colour: "vermilion", width: 1.2 };
}

/** A training's name, its two pictures and its figures. */
export class LatentColumn {
  constructor() {
    this.title = element("div", { class: "crf-title" });
    this.caption = element("p", { class: "crf-note" });
    this.histogram = new Plot("crf-small");
    this.curves = new Plot("crf-small");
    this.readouts = readouts(["mean", "sd", "KL", "KS"]);
    this.box = element("div", { class: "crf-column", role: "group" });
    this.box.append(this.title, this.caption, this.histogram.box, this.curves.box, this.readouts.box);
  }

  // A training that ended earlier stays at its last epoch.
  show(/** @type {Run} */ run, /** @type {number} */ epoch) {
    const row = run.rowAt(epoch);
    this.title.textContent = this.title.title = run.name;
    this.box.setAttribute("aria-label", run.name);
    const kept = `${epoch > run.last ? "ended at" : "epoch"} ${run.epochs[row]}`;
    this.caption.textContent = `${kept}, n = ${run.size}`;
    this.drawHistogram(run, row);
    this.drawCurves(run, row);
    const [figures] = run.parts(run.figures, row);
    this.readouts.show(Array.from(figures, (value) => written(value.toFixed(3))));
  }

  drawHistogram(/** @type {Run} */ run, /** @type {number} */ row) {
    const counts = histogram(run.parts(run.latents, row)[0]);
    this.histogram.canvas.dataset.counts = String(counts); // the numbers behind the picture, for who inspects it
    const density = counts.map((count) => count / run.size / BAR);
    this.histogram.draw({
      x: { label: "latent z", min: -REACH, max: REACH, gap: 32 },
      y: { label: "density", min: 0, max: MOST },
      marks: [
        { type: "bar", name: "training curves", high: density, colour: "blue", alpha: 0.6 },
        { type: "line", name: "N(0, 1)", y: PRIOR, colour: "vermilion", dash: "dashed", width: 1.5 },
      ],
      description: `Histogram of the latents of ${run.name} at epoch ${run.epochs[row]} beside N(0, 1)`,
    });
  }

  drawCurves(/** @type {Run} */ run, /** @type {number} */ row) {
    const [x, y] = run.labels.map((label) => ({ label, min: 0, max: 1 }));
    this.curves.draw({
      x,
      y,
      marks: run.parts(run.probes, row, PROBE_COUNT).map((samples, i) => {
        const side = i - (PROBE_COUNT - 1) / 2;
        const look = { name: `z = ${written(side / 2)}`, ...probeLook(side) };
        return { type: "line", y: Array.from(samples, (share) => share / 255), ...look };
      }),
      description: `Curves that ${run.name} decodes from latents of −2 to 2 at epoch ${run.epochs[row]}`,
    });
  }

  repaint() {
    this.histogram.schedule();
    this.curves.schedule();
  }

  destroy() {
    this.histogram.destroy();
    this.curves.destroy();
  }
}
