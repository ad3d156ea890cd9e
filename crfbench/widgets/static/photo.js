// A photograph seen through a response, with a border to drag: one side as it is, the other side as a curve makes it.

import { element, KEEP_KEYS } from "./controls.js";

/**
 * @typedef {ArrayLike<number>} Values
 * @typedef {object} Picture
 * @property {number} width
 * @property {number} height
 * @property {Uint8ClampedArray | Uint16Array} codes red, green, blue of each pixel, which count into `levels`
 * @property {Float64Array} levels what a code stands for, from 0 to 1
 * @typedef {{ name: string, tables: Uint8ClampedArray[] }} Side a table for all channels or one for each
 */

const KEY_STEP = 0.05; // of the width, by an arrow key

// Where a rising curve of even samples reaches a value, from 0 to 1; of one that falls, where it first does.
/** @type {(curve: Values, value: number) => number} */
export function placeOf(curve, value) {
  let i = 1;
  while (i < curve.length - 1 && curve[i] < value) i++;
  const [low, high] = [curve[i - 1], curve[i]];
  const share = high > low ? Math.min(1, Math.max(0, (value - low) / (high - low))) : 0;
  return (i - 1 + share) / (curve.length - 1);
}

/** @type {(curve: Values, place: number) => number} */
export function heightAt(curve, place) {
  const at = Math.min(1, Math.max(0, place)) * (curve.length - 1);
  const i = Math.min(curve.length - 2, Math.floor(at));
  return curve[i] + (at - i) * (curve[i + 1] - curve[i]);
}

// What each level becomes, from 0 to 255: by the curve or, where it leads the other way, by its inverse.
/** @type {(levels: Float64Array, curve: Values, inverse?: boolean) => Uint8ClampedArray} */
export function tableOf(levels, curve, inverse = false) {
  const through = inverse ? placeOf : heightAt;
  return Uint8ClampedArray.from(levels, (level) => 255 * through(curve, level));
}

/** @type {(levels: Float64Array) => Uint8ClampedArray} */
export const unchanged = (levels) => tableOf(levels, [0, 1]);

/** The picture on a canvas, painted at most once a frame, and a border that mouse, finger and arrow keys move. */
export class SplitPhoto {
  constructor(/** @type {Picture} */ picture, note = "") {
    this.picture = picture;
    const { width, height } = picture;
    this.canvas = element("canvas", { class: "crf-split-canvas", role: "img", width, height });
    this.context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
    this.image = this.context.createImageData(width, height);
    this.names = [element("span"), element("span")];
    const range = { "aria-valuemin": 0, "aria-valuemax": 100, "aria-orientation": "vertical" };
    const label = { "aria-label": "border between both halves of the photograph", title: "drag, or use the arrow keys" };
    this.border = element("div", { class: "crf-border", role: "separator", tabindex: 0, ...range, ...label, ...KEEP_KEYS });
    const stage = element("div", { class: "crf-split-stage" }, this.canvas, this.border);
    const names = element("div", { class: "crf-split-names" }, ...this.names);
    const caption = element("figcaption", { class: "crf-note" }, note);
    this.box = element("figure", { class: "crf-split" }, element("div", {}, names, stage), caption);
    /** @type {Side[]} */
    this.sides = [];
    this.frame = 0;
    this.share = 0.5; // of the width, where the border is
    this.listen(stage);
    this.place(this.share);
  }

  listen(/** @type {HTMLElement} */ stage) {
    const follow = (/** @type {PointerEvent} */ event) => {
      const { left, width } = stage.getBoundingClientRect();
      this.place((event.clientX - left) / width);
    };
    stage.addEventListener("pointerdown", (event) => {
      stage.setPointerCapture(event.pointerId);
      this.border.focus();
      event.preventDefault(); // no text is selected on the way
      follow(event);
    });
    stage.addEventListener("pointermove", (event) => stage.hasPointerCapture(event.pointerId) && follow(event));
    this.border.addEventListener("keydown", (event) => {
      const steps = { ArrowLeft: -KEY_STEP, ArrowRight: KEY_STEP, Home: -1, End: 1 }[event.key];
      if (steps === undefined) return;
      event.preventDefault();
      this.place(this.share + steps);
    });
  }

  place(/** @type {number} */ share) {
    this.share = Math.min(1, Math.max(0, share));
    this.border.style.left = `${100 * this.share}%`;
    this.border.setAttribute("aria-valuenow", String(Math.round(100 * this.share)));
    this.schedule();
  }

  /** @type {(left: Side, right: Side) => void} */
  show(left, right) {
    this.sides = [left, right];
    this.names.forEach((node, i) => (node.textContent = this.sides[i].name));
    this.canvas.setAttribute("aria-label", `A photograph; left: ${left.name}; right: ${right.name}`);
    this.schedule();
  }

  schedule() {
    this.frame ||= requestAnimationFrame(() => this.refresh());
  }

  // Paints now rather than in the next frame.
  refresh() {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    if (this.sides.length) this.paint();
  }

  paint() {
    const { width, height, codes } = this.picture;
    const { data } = this.image;
    const border = Math.round(this.share * width);
    const [left, right] = this.sides.map(({ tables }) => [0, 1, 2].map((channel) => tables[channel % tables.length]));
    for (let y = 0, from = 0, to = 0; y < height; y++) {
      for (let x = 0; x < width; x++, to += 4) {
        const tables = x < border ? left : right;
        for (let channel = 0; channel < 3; channel++) data[to + channel] = tables[channel][codes[from++]];
        data[to + 3] = 255;
      }
    }
    this.context.putImageData(this.image, 0, 0);
  }

  destroy() {
    cancelAnimationFrame(this.frame);
  }
}
