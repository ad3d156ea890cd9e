// The network of an SLR as the paper draws it: a curve in, layer by layer to a waist, and the decoded curve out.

import { Sketch } from "./plot.js";

/**
 * @typedef {object} Network
 * @property {number[]} sizes neurons of the decoder's layers, the latents first and the curve's samples last
 * @property {ArrayLike<number>[]} active for each of the decoder's layers, how active its neurons are, from 0 to 1
 * @property {number[]} latent
 * @property {ArrayLike<number> | null} input
 * @property {ArrayLike<number>} output
 * @property {string} description
 */

const CELLS = 64; // of a layer at most; the layers of samples have more neurons than fit
const REACH_OF_COLOUR = 3; // the latent at which a waist is filled in full
const [ABOVE, BELOW] = [26, 22]; // for the names and the numbers of neurons

/** @extends {Sketch<Network>} */
export class NetworkSketch extends Sketch {
  constructor() {
    super("crf-network");
  }

  paint(/** @type {Network} */ { sizes, active, latent, input, output }) {
    const side = Math.min(this.height - ABOVE - BELOW, 0.17 * this.width);
    const middle = (this.height + ABOVE - BELOW) / 2;
    const all = [...sizes.slice(1).reverse(), ...sizes];
    const waist = sizes.length - 1;
    const [first, last] = [side + 26, this.width - side - 26];
    const columns = all.map((size, i) => {
      const half = (0.08 + (0.92 * Math.log(size)) / Math.log(1024)) * ((this.height - ABOVE - BELOW) / 2);
      return { size, half, x: first + (i * (last - first)) / (all.length - 1) };
    });
    this.paintFunnels(columns, middle);
    columns.forEach((column, i) => {
      const values = i > waist ? active[i - waist - 1] : i === 0 ? (input ?? []) : [];
      if (i === waist) this.paintWaist(latent, column.x, middle);
      else this.paintLayer(column, middle, values, i > waist ? "blue" : "vermilion");
      const outwards = i === 0 ? -10 : i === all.length - 1 ? 10 : 0; // for the long numbers of the layers of samples
      this.write(String(column.size), column.x + outwards, this.height - BELOW / 2);
    });
    this.write("encoder", (first + columns[waist].x) / 2, ABOVE / 2);
    this.write("z", columns[waist].x, ABOVE / 2);
    this.write("decoder", (last + columns[waist].x) / 2, ABOVE / 2);
    this.paintCurve(0.5, middle - side / 2, side, input ?? [], "vermilion");
    this.paintCurve(this.width - side - 0.5, middle - side / 2, side, output, "blue");
    this.write("in", side / 2, ABOVE / 2);
    this.write("out", this.width - side / 2, ABOVE / 2);
  }

  /** @type {(columns: { x: number, half: number }[], middle: number) => void} */
  paintFunnels(columns, middle) {
    const { context } = this;
    context.fillStyle = this.ink;
    context.globalAlpha = 0.1;
    columns.slice(1).forEach(({ x, half }, i) => {
      const before = columns[i];
      context.beginPath();
      context.moveTo(before.x, middle - before.half);
      context.lineTo(x, middle - half);
      context.lineTo(x, middle + half);
      context.lineTo(before.x, middle + before.half);
      context.fill();
    });
    context.globalAlpha = 1;
  }

  /**
   * A neuron is a cell, the fuller the more active; those of a layer without values stay empty.
   * @param {{ x: number, half: number, size: number }} column
   * @param {number} middle
   * @param {ArrayLike<number>} values
   * @param {import("./plot.js").Colour} colour
   */
  paintLayer({ x, half, size }, middle, values, colour) {
    const { context } = this;
    const [cells, width] = [Math.min(size, CELLS), 9];
    const height = (2 * half) / cells;
    context.fillStyle = this.dark ? "#111" : "#fff";
    context.fillRect(x - width / 2, middle - half, width, 2 * half);
    context.fillStyle = this.colour(colour);
    for (let i = 0; i < cells && values.length; i++) {
      context.globalAlpha = Math.min(1, Math.max(0, values[Math.floor((i * values.length) / cells)]));
      context.fillRect(x - width / 2, middle + half - (i + 1) * height, width, height + 0.3); // the first sample lowest
    }
    context.globalAlpha = 1;
    this.setLine({ width: 1 });
    context.strokeRect(x - width / 2, middle - half, width, 2 * half);
  }

  /** @type {(latent: number[], x: number, middle: number) => void} */
  paintWaist(latent, x, middle) {
    const { context } = this;
    latent.forEach((z, i) => {
      context.beginPath();
      context.arc(x, middle + (i - (latent.length - 1) / 2) * 22, 9, 0, 2 * Math.PI);
      context.fillStyle = this.dark ? "#111" : "#fff";
      context.fill();
      context.globalAlpha = Math.min(1, Math.abs(z) / REACH_OF_COLOUR);
      context.fillStyle = this.colour(z < 0 ? "vermilion" : "blue");
      context.fill();
      context.globalAlpha = 1;
      this.setLine({ width: 1.5 });
      context.stroke();
    });
  }

  /**
   * @param {number} left
   * @param {number} top
   * @param {number} side
   * @param {ArrayLike<number>} curve
   * @param {import("./plot.js").Colour} colour
   */
  paintCurve(left, top, side, curve, colour) {
    const { context } = this;
    this.setLine({ width: 1 });
    context.strokeRect(left, top, side, side);
    this.setLine({ colour, dash: colour === "vermilion" ? "dashed" : "solid" });
    context.beginPath();
    for (let i = 0; i < curve.length; i++) {
      context.lineTo(left + (side * i) / (curve.length - 1), top + side * (1 - Math.min(1, Math.max(0, curve[i]))));
    }
    context.stroke();
  }

  /** @type {(text: string, x: number, y: number) => void} */
  write(text, x, y) {
    this.context.fillStyle = this.ink;
    this.context.textAlign = "center";
    this.context.fillText(text, x, y);
  }
}
