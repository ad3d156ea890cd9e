// One plot of marks on a canvas, shared by the widgets: lines, dots, bands and bars on linear or logarithmic axes.

import { element, isDarkGround, written } from "./controls.js";
import { Hand, PLOT_HELP } from "./plot_hand.js";
import { shown } from "./plot_view.js";

/**
 * @typedef {object} Axis
 * @property {string} [label]
 * @property {number} min
 * @property {number} max
 * @property {boolean} [log]
 * @property {number} [gap] how near to each other the numbers of the x axis may stand, in pixels
 * @property {(value: number) => string} [format] how a number on the axis is written
 * @property {string} [name] in a read-out; by default the label up to its first bracket
 * @property {(value: number) => string} [write] how a number is written in a read-out
 *
 * @typedef {keyof typeof COLOURS} Colour
 * @typedef {object} Look
 * @property {string} [label] of the legend
 * @property {string} [of] the label of the mark that it goes with, where it has none itself
 * @property {string} [name] in a read-out; by default the label
 * @property {string[]} [names] in a read-out, one a point
 * @property {(i: number) => void} [onPick] called when the hand comes to point i
 * @property {Colour} [colour] the theme's ink where there is none
 * @property {string[]} [paints] colours of CSS, one a dot
 * @property {number} [alpha]
 *
 * @typedef {ArrayLike<number>} Numbers
 * @typedef {{ type: "line", x?: Numbers, y?: Numbers, dash?: keyof typeof DASHES, width?: number }} Line
 * @typedef {{ type: "dots", x: Numbers, y: Numbers, radius: number, shape?: Shape, rim?: boolean }} Dots
 * @typedef {{ type: "band", x?: Numbers, low: Numbers, high: Numbers }} Band
 * @typedef {{ type: "bar", x?: Numbers, low?: Numbers, high?: Numbers, width?: number }} Bar `width` is in pixels
 * @typedef {{ x: number, y: number, text: string }} Note beside a point
 * @typedef {Look & (Line | Dots | Band | Bar)} Mark A line or band without x, and a line without y, runs evenly
 *   over the axis. Bars without x stand side by side over the whole axis; without `low` or `high` they reach the frame.
 *
 * @typedef {object} Figure
 * @property {Axis} x
 * @property {Axis} y
 * @property {Mark[]} marks painted in this order, which is also that of the legend
 * @property {string} description what a screen reader says
 * @property {Note} [note] read out where the hand is not
 * @property {boolean} [bare] a strip with the numbers of the x axis and nothing else around it
 */

// Okabe and Ito's colours, told apart with any colour vision: [on a light ground, lighter on a dark ground].
export const COLOURS = {
  blue: ["#0072B2", "#56B4E9"],
  vermilion: ["#D55E00", "#F28A3A"],
  green: ["#009E73", "#2EC495"],
  purple: ["#CC79A7", "#E39AC4"],
  orange: ["#B87F00", "#F0C25A"],
};
const DASHES = { solid: [], dashed: [8, 4], dotted: [2, 3] };
const FONT_SIZE = 12;
const LINE_WIDTH = 2;
const LEGEND_LINE = 26; // length of the line sample
const LEGEND_GAP = 16; // between two entries
const ROW = 18; // height of a row of legend
const FADED = 0.15; // how much is left of a mark while another stands out
const THUMB = 8; // half a slider's thumb, whose centre stays that far inside the ends: bare plots lie below sliders

/** @typedef {"disc" | "ring" | "square" | "diamond"} Shape */
/**
 * Outlines of dots.
 * @type {Record<Shape, (context: CanvasRenderingContext2D, x: number, y: number, radius: number) => void>}
 */
export const SHAPES = {
  disc: (context, x, y, radius) => context.arc(x, y, radius, 0, 2 * Math.PI),
  ring: (context, x, y, radius) => context.arc(x, y, radius, 0, 2 * Math.PI),
  square: (context, x, y, radius) => context.rect(x - radius, y - radius, 2 * radius, 2 * radius),
  diamond: (context, x, y, radius) => {
    context.moveTo(x + radius, y);
    for (const [right, down] of [[0, 1], [-1, 0], [0, -1]]) context.lineTo(x + right * radius, y + down * radius);
    context.closePath();
  },
};

/**
 * The bytes of a binary trait, which is a view at any offset, copied to where numbers may lie.
 * @param {DataView} view
 */
export const bytesOf = (view) => view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength);
export const float32 = (/** @type {DataView} */ view) => new Float32Array(bytesOf(view));
export const uint16 = (/** @type {DataView} */ view) => new Uint16Array(bytesOf(view));

// About `count` round numbers (1, 2 or 5 times a power of ten) between min and max.
export function ticks(/** @type {Axis} */ { min, max }, /** @type {number} */ count) {
  const least = (max - min) / count;
  const power = 10 ** Math.floor(Math.log10(least));
  const step = power * ([1, 2, 5].find((factor) => factor * power >= least * 0.999) ?? 10);
  const first = Math.ceil(min / step - 1e-9);
  const n = Math.floor(max / step + 1e-9) - first + 1;
  return Array.from({ length: n }, (_, i) => Number(((first + i) * step).toPrecision(10)));
}

// 1, 2 and 5 times each power of ten between min and max; round numbers where these are fewer than three.
export function logTicks(/** @type {Axis} */ { min, max }) {
  const values = [];
  for (let power = Math.floor(Math.log10(min)); 10 ** power <= max; power++) {
    for (const factor of [1, 2, 5]) values.push(Number(`${factor}e${power}`));
  }
  const inside = values.filter((value) => value >= min && value <= max);
  return inside.length < 3 ? ticks({ min, max }, 6) : inside;
}

/**
 * The function from values on an axis to places between `start` and `end`.
 * @param {Axis} axis
 * @param {number} start
 * @param {number} end
 * @returns {(value: number) => number}
 */
export function scale({ min, max, log }, start, end) {
  if (!log) return (value) => start + ((value - min) / (max - min)) * (end - start);
  const span = Math.log(max / min);
  // Zero and what lies below it have no logarithm; they are as far below the frame as can be.
  return (value) => start + (Math.log(Math.max(value, Number.MIN_VALUE) / min) / span) * (end - start);
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {string} text
 * @param {number} width
 */
function shorten(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  let end = text.length;
  while (end > 1 && context.measureText(text.slice(0, end) + "…").width > width) end--;
  return text.slice(0, end) + "…";
}

/**
 * Where each legend entry goes: as many in a row as fit.
 * @param {CanvasRenderingContext2D} context
 * @param {Mark[]} marks
 * @param {number} width
 */
function legendEntries(context, marks, width) {
  let x = 0;
  let row = 0;
  return marks.flatMap((mark) => {
    if (mark.label === undefined) return [];
    const label = shorten(context, mark.label, width - LEGEND_LINE - 6);
    const length = LEGEND_LINE + 6 + context.measureText(label).width;
    if (x > 0 && x + length > width) [x, row] = [0, row + 1];
    const entry = { mark, label, x, row, length };
    x += length + LEGEND_GAP;
    return [entry];
  });
}

/**
 * A canvas as large as the style sheet makes it, painted at most once a frame; how, is the subclass's `paint`.
 * @template {{ description?: string }} F what is painted; a screen reader says its description
 */
export class Sketch {
  /** @param {string} name its class in the style sheet */
  constructor(name) {
    this.canvas = element("canvas", { class: name, role: "img" });
    this.context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
    this.frame = this.width = this.height = 0;
    this.ink = "";
    this.dark = false;
    /** @type {F | null} */
    this.figure = null; // nothing is painted before there is one
    this.observer = new ResizeObserver(() => this.schedule());
    this.observer.observe(this.canvas);
  }

  draw(/** @type {F} */ figure) {
    this.figure = figure;
    if (figure.description) this.canvas.setAttribute("aria-label", this.describe(figure.description));
    this.schedule();
  }

  describe(/** @type {string} */ description) {
    return description;
  }

  destroy() {
    this.observer.disconnect();
    cancelAnimationFrame(this.frame);
  }

  schedule() {
    this.frame ||= requestAnimationFrame(() => this.refresh());
  }

  // Paints now rather than in the next frame.
  refresh() {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    if (!this.figure || !this.measure()) return;
    this.begin();
    this.paint(this.figure);
  }

  /** @param {F} _figure */
  paint(_figure) {}

  // JupyterLab hides the page for a moment while it changes the theme; the last size is kept for that moment.
  measure() {
    const { clientWidth, clientHeight, isConnected } = this.canvas;
    if (clientWidth) [this.width, this.height] = [clientWidth, clientHeight];
    return isConnected && this.width > 0;
  }

  // An empty canvas with the theme's ink and letters. One canvas pixel is one device pixel, so lines and letters are
  // crisp; drawing is in CSS pixels.
  begin() {
    const ratio = window.devicePixelRatio || 1;
    const { canvas, context } = this;
    const [width, height] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    const style = getComputedStyle(canvas);
    this.ink = style.color;
    this.dark = isDarkGround(canvas);
    context.font = `${FONT_SIZE}px ${style.fontFamily}`;
    context.textBaseline = "middle";
  }

  /** @param {Colour} [name] */
  colour(name) {
    return name ? COLOURS[name][Number(this.dark)] : this.ink;
  }

  /** @param {{ colour?: Colour, dash?: keyof typeof DASHES, width?: number }} look */
  setLine({ colour, dash = "solid", width = LINE_WIDTH }) {
    const { context } = this;
    context.strokeStyle = this.colour(colour);
    context.lineWidth = width;
    context.lineJoin = "round";
    context.setLineDash(DASHES[dash]);
  }
}

/**
 * Axes, marks and, where marks have labels, a legend.
 * @extends {Sketch<Figure>}
 */
export class Plot extends Sketch {
  constructor(name = "crf-canvas", zooms = true) {
    super(name);
    this.left = this.right = this.top = this.bottom = 0;
    /** @type {(value: number) => number} */
    this.toX = (value) => value;
    this.toY = this.toX;
    /** @type {{ x: import("./plot_view.js").Part, y: import("./plot_view.js").Part }} */
    this.parts = { x: [0, 1], y: [0, 1] };
    /** @type {{ x: Axis, y: Axis }} what is shown of them */
    this.axes = { x: { min: 0, max: 1 }, y: { min: 0, max: 1 } };
    this.start = this.end = this.floor = this.lid = 0; // where the ends of the whole axes lie
    /** @type {ReturnType<typeof legendEntries>} */
    this.entries = [];
    /** @type {string | null} the entry of the legend whose marks stand out */
    this.lit = null;
    this.zooms = zooms;
    this.hand = new Hand(this, zooms);
    this.box = this.hand.box;
  }

  describe(/** @type {string} */ description) {
    return this.zooms ? `${description.replace(/\.$/, "")}. ${PLOT_HELP}` : description;
  }

  get zoomed() {
    return [this.parts.x, this.parts.y].some(([from, to]) => to - from < 0.999);
  }

  paint(/** @type {Figure} */ figure) {
    const { context } = this;
    const { marks, bare } = figure;
    this.entries = legendEntries(context, marks, this.width - 56);
    const { entries } = this;
    const rows = entries.length ? entries[entries.length - 1].row + 1 : 0;
    this.axes = { x: shown(figure.x, this.parts.x), y: shown(figure.y, this.parts.y) };
    if (bare) this.frameBy(figure, THUMB, this.width - THUMB, 0, this.height - ROW);
    else this.frameBy(figure, 48, this.width - 8, rows * ROW + 8, this.height - 42);
    this.paintAxes(figure);
    context.save();
    context.beginPath();
    context.rect(this.left, this.top, this.right - this.left, this.bottom - this.top);
    context.clip();
    for (const mark of marks) this.paintMark(mark);
    context.restore();
    for (const entry of entries) this.paintLegend(entry);
    this.hand.tell();
  }

  /**
   * @param {Figure} whole
   * @param {number} left
   * @param {number} right
   * @param {number} top
   * @param {number} bottom
   */
  frameBy(whole, left, right, top, bottom) {
    Object.assign(this, { left, right, top, bottom });
    const { x, y } = this.axes;
    const toY = scale(y, bottom, top);
    this.toX = scale(x, left, right);
    [this.start, this.end] = [whole.x.min, whole.x.max].map(this.toX);
    [this.floor, this.lid] = [whole.y.min, whole.y.max].map(toY);
    // Browsers drop paths that run off to enormous coordinates.
    this.toY = (/** @type {number} */ value) => Math.min(20 * bottom, Math.max(-20 * bottom, toY(value)));
  }

  // --- what the hand asks

  holds(/** @type {number} */ x, /** @type {number} */ y) {
    return x >= this.left && x <= this.right && y >= this.top && y <= this.bottom;
  }

  /** Where a point lies, or null outside the frame. */
  place(/** @type {{ x: number, y: number }} */ point) {
    const [x, y] = [this.toX(point.x), this.toY(point.y)];
    return this.holds(x, y) ? { x, y } : null;
  }

  // The entry of the legend at a place.
  entryAt(/** @type {number} */ x, /** @type {number} */ y) {
    const row = Math.floor(y / ROW);
    const from = x - this.left;
    const found = this.entries.find((entry) => entry.row === row && from >= entry.x && from <= entry.x + entry.length);
    return found?.mark.label ?? null;
  }

  light(/** @type {string | null} */ entry) {
    if (entry === this.lit) return;
    this.lit = entry;
    this.schedule();
  }

  /**
   * Where the points of a mark lie; of a bar or band its top, or its place next to `y`.
   * @param {Mark} mark
   * @param {number} y
   * @returns {import("./plot_view.js").Trace}
   */
  trace(mark, y = -Infinity) {
    if (mark.type === "dots") return { n: mark.x.length, at: (i) => [this.toX(mark.x[i]), this.toY(mark.y[i])] };
    if (mark.type === "line") {
      const { n, toX, toY } = this.along(mark);
      return { n, at: (i) => [toX(i), toY(i)], joined: true };
    }
    const { low, high } = mark;
    const n = (mark.x ?? low ?? high ?? []).length;
    const share = (this.end - this.start) / n;
    const middle = (/** @type {number} */ i) => this.start + (i + 0.5) * share;
    const toX = mark.type === "band" || mark.x ? this.across(mark.x, n) : middle;
    const inFrame = (/** @type {number} */ place) => Math.min(this.bottom, Math.max(this.top, place));
    return {
      n,
      at: (i) => {
        const top = high ? inFrame(this.toY(high[i])) : this.top;
        const bottom = low ? inFrame(this.toY(low[i])) : this.bottom;
        return [toX(i), Math.min(bottom, Math.max(top, y))];
      },
    };
  }

  /**
   * The numbers of a point: those of the mark, and where it has none `drawn`, those at its place.
   * @param {Mark} mark
   * @param {number} i
   * @param {{ x: number, y: number }} drawn
   * @returns {{ x: number | number[], y: number | number[] }}
   */
  values(mark, i, drawn) {
    if (mark.type === "dots") return { x: mark.x[i], y: mark.y[i] };
    if (mark.type === "line") return drawn;
    const { low, high } = mark;
    const y = low && high ? [low[i], high[i]] : (high ?? low ?? [])[i];
    if (mark.type === "band" || mark.x) return { x: mark.x ? mark.x[i] : drawn.x, y };
    const { min, max } = /** @type {Figure} */ (this.figure).x;
    const step = (max - min) / (high ?? low ?? []).length;
    return { x: [min + i * step, min + (i + 1) * step], y };
  }

  paintAxes(/** @type {Figure} */ { bare }) {
    const { context } = this;
    const { x, y } = this.axes;
    const { left, right, top, bottom } = this;
    context.fillStyle = context.strokeStyle = this.ink;
    context.lineWidth = 1;
    context.setLineDash([]);
    for (const value of bare ? [] : y.log ? logTicks(y) : ticks(y, (bottom - top) / 44)) {
      this.paintGridLine(left, this.toY(value), right, this.toY(value));
      context.textAlign = "right";
      context.fillText((y.format ?? written)(value), left - 7, this.toY(value));
    }
    for (const value of x.log ? logTicks(x) : ticks(x, (right - left) / (x.gap ?? 56))) {
      if (!bare) this.paintGridLine(this.toX(value), top, this.toX(value), bottom);
      const last = !bare && !x.log && value === x.max; // must not leave the canvas
      context.textAlign = last ? "right" : "center";
      context.fillText((x.format ?? written)(value), this.toX(value) + (last ? 4 : 0), bottom + (bare ? 10 : 12));
    }
    if (bare) return;
    context.strokeRect(Math.round(left) + 0.5, Math.round(top) + 0.5, right - left - 1, bottom - top - 1);
    this.paintAxisNames(x.label ?? "", y.label ?? "");
  }

  /** @param {...number} ends */
  paintGridLine(...ends) {
    const { context } = this;
    const [x0, y0, x1, y1] = ends.map((end) => Math.round(end) + 0.5);
    context.globalAlpha = 0.16;
    context.beginPath();
    context.moveTo(x0, y0);
    context.lineTo(x1, y1);
    context.stroke();
    context.globalAlpha = 1;
  }

  paintAxisNames(/** @type {string} */ x, /** @type {string} */ y) {
    const { context } = this;
    const { left, right, top, bottom } = this;
    context.textAlign = "center";
    context.fillText(x, (left + right) / 2, bottom + 31);
    context.save();
    context.translate(9, (top + bottom) / 2);
    context.rotate(-Math.PI / 2);
    context.fillText(shorten(context, y, bottom - top), 0, 0);
    context.restore();
  }

  paintMark(/** @type {Mark} */ mark) {
    const { context } = this;
    context.fillStyle = this.colour(mark.colour);
    context.globalAlpha = this.strength(mark);
    if (mark.type === "line") this.paintLine(mark);
    else if (mark.type === "dots") this.paintDots(mark);
    else if (mark.type === "band") this.paintBand(mark);
    else this.paintBars(mark);
    context.globalAlpha = 1;
  }

  strength(/** @type {Mark} */ { alpha = 1, label, of }) {
    return this.lit === null || this.lit === (label ?? of) ? alpha : FADED * alpha;
  }

  /**
   * Where sample i lies across the whole axis.
   * @param {Numbers | undefined} x
   * @param {number} count
   * @returns {(i: number) => number}
   */
  across(x, count) {
    const step = (this.end - this.start) / (count - 1);
    return x ? (i) => this.toX(x[i]) : (i) => this.start + i * step;
  }

  along(/** @type {Line} */ { x, y }) {
    const n = (x ?? y ?? []).length;
    const rise = (this.floor - this.lid) / (n - 1);
    /** @type {(i: number) => number} */
    const toY = y ? (i) => this.toY(y[i]) : (i) => this.floor - i * rise;
    return { n, toX: this.across(x, n), toY };
  }

  paintLine(/** @type {Look & Line} */ mark) {
    const { context } = this;
    const { n, toX, toY } = this.along(mark);
    this.setLine(mark);
    context.beginPath();
    for (let i = 0; i < n; i++) context.lineTo(toX(i), toY(i));
    context.stroke();
  }

  paintDots(/** @type {Look & Dots} */ { x, y, ...look }) {
    for (let i = 0; i < x.length; i++) {
      if (look.paints) this.context.fillStyle = look.paints[i];
      this.paintDot(this.toX(x[i]), this.toY(y[i]), look);
    }
  }

  /**
   * A rim of ink tells dots of a colour from the others without it.
   * @param {number} x
   * @param {number} y
   * @param {Look & Omit<Dots, "x" | "y">} look
   */
  paintDot(x, y, { shape = "disc", radius, colour, rim }) {
    const { context } = this;
    context.beginPath();
    SHAPES[shape](context, x, y, radius);
    if (shape !== "ring") context.fill();
    if (shape !== "ring" && !rim) return;
    this.setLine(rim ? { width: 1 } : { colour });
    context.stroke();
  }

  paintBand(/** @type {Band} */ { x, low, high }) {
    const { context } = this;
    const toX = this.across(x, low.length);
    context.beginPath();
    for (let i = 0; i < low.length; i++) context.lineTo(toX(i), this.toY(low[i]));
    for (let i = high.length - 1; i >= 0; i--) context.lineTo(toX(i), this.toY(high[i]));
    context.fill();
  }

  paintBars(/** @type {Bar} */ { x, low, high, width = 1 }) {
    const { context } = this;
    const count = (x ?? low ?? high ?? []).length;
    const share = (this.end - this.start) / count;
    for (let i = 0; i < count; i++) {
      // Whole pixels, so that the edges are crisp.
      const start = Math.round(x ? this.toX(x[i]) - width / 2 : this.start + i * share);
      const end = x ? start + width : Math.round(this.start + (i + 1) * share);
      const bottom = Math.round(low ? Math.min(this.bottom, this.toY(low[i])) : this.bottom);
      const top = Math.round(high ? Math.max(this.top, this.toY(high[i])) : this.top);
      context.fillRect(start, top, end - start, bottom - top);
    }
  }

  paintLegend(/** @type {ReturnType<typeof legendEntries>[number]} */ { mark, label, x, row }) {
    const { context } = this;
    const [start, y] = [this.left + x, row * ROW + ROW / 2];
    context.fillStyle = this.colour(mark.colour);
    context.globalAlpha = this.strength(mark);
    if (mark.type === "dots") this.paintDot(start + LEGEND_LINE / 2, y, mark);
    else if (mark.type === "line") {
      this.setLine(mark);
      context.beginPath();
      context.moveTo(start, y);
      context.lineTo(start + LEGEND_LINE, y);
      context.stroke();
    } else context.fillRect(start, y - 6, LEGEND_LINE, 12);
    context.globalAlpha = 1;
    context.fillStyle = this.ink;
    context.textAlign = "left";
    context.fillText(label, start + LEGEND_LINE + 6, y);
  }
}
