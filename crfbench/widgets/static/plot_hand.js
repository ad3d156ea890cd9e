// The hand on a plot, by pointer or keyboard: a box to zoom, a read-out of the nearest mark, the line of an entry.

import { button, element, KEEP_KEYS, written } from "./controls.js";
import { further, inner, nearestOn, scaled, shown, valueAt } from "./plot_view.js";

/**
 * @typedef {import("./plot.js").Axis} Axis
 * @typedef {import("./plot.js").Plot} Plot
 * @typedef {import("./plot_view.js").Part} Part
 * @typedef {{ mark: number, i: number, x: number, y: number, distance: number }} Found `mark` in the figure's order
 */

const HAND_REACH = 24; // pixels from a mark within which the pointer means it
const BEHIND = { dots: 0, line: 4, bar: 8, band: 8 }; // pixels by which a mark counts as farther off: dots come first
const SMALLEST_BOX = 6; // pixels; what is drawn smaller was a click
const READOUT_GAP = 12; // from a point to its read-out
const ZOOM = 1.5;
const PAN = 0.2; // of the part shown
const WALK_STEPS = 60; // by which the keyboard goes along a line
/** @type {Record<string, [number, number]>} */
const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const PLOT_KEYS = "← → along, ↑ ↓ other marks, + − zoom, Shift+arrows move, Esc all";
export const PLOT_HELP =
  "Drag a box, or press plus and minus, to zoom. Left and right arrow go along a mark, up and down to another, with " +
  "Shift they move the part shown. Escape or a double click shows all.";

/** @type {Part} */
const WHOLE = [0, 1];
const nameOf = (/** @type {Axis} */ { name, label = "" }) => name ?? label.split(" (")[0];

/**
 * Numbers as the axis writes them, otherwise with as many digits as a pixel is worth.
 * @param {Axis} axis as it is shown
 * @param {number | number[]} value or a range
 * @param {number} pixels
 */
function readValue(axis, value, pixels) {
  const decimals = Math.max(0, Math.min(9, Math.ceil(-Math.log10((axis.max - axis.min) / pixels))));
  const plain = (/** @type {number} */ one) => written(axis.log ? one.toPrecision(4) : one.toFixed(decimals));
  return `${nameOf(axis)} ${[value].flat().map(axis.write ?? plain).join(" to ")}`;
}

export class Hand {
  /**
   * @param {Plot} plot
   * @param {boolean} zooms otherwise it only reads
   */
  constructor(plot, zooms) {
    this.plot = plot;
    /** @type {{ x: number, y: number } | null} where the pointer is */
    this.at = null;
    /** @type {{ mark: number, i: number } | null} where the keyboard is */
    this.cursor = null;
    /** @type {{ x: number, y: number } | null} where the box began */
    this.corner = null;
    /** @type {string | null} the entry of the legend that was pressed */
    this.pressed = null;
    this.message = "";
    this.readout = element("div", { class: "crf-readout", role: "status" });
    this.spot = element("div", { class: "crf-spot" });
    this.area = element("div", { class: "crf-area" });
    this.reset = button("Show all", () => this.zoom(WHOLE, WHOLE), { class: "crf-reset", tabindex: -1 });
    this.box = element("div", { class: "crf-frame" }, plot.canvas, this.area, this.spot, this.readout, this.reset);
    for (const part of [this.area, this.spot, this.readout, this.reset]) part.hidden = true;
    const { canvas } = plot;
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerleave", () => this.corner || this.leave());
    if (zooms) this.listen(canvas);
  }

  listen(/** @type {HTMLCanvasElement} */ canvas) {
    const words = { role: "application", "aria-roledescription": "plot", tabindex: 0, ...KEEP_KEYS };
    for (const [name, value] of Object.entries(words)) canvas.setAttribute(name, String(value));
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointerup", (event) => this.release(event));
    canvas.addEventListener("pointercancel", () => this.drop());
    canvas.addEventListener("dblclick", ({ offsetX, offsetY }) => this.double(offsetX, offsetY));
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("blur", () => this.leave());
    canvas.addEventListener("focus", () => canvas.matches(":focus-visible") && this.say(PLOT_KEYS));
  }

  // --- by pointer

  move(/** @type {PointerEvent} */ { offsetX: x, offsetY: y }) {
    if (this.corner) return this.drawBox(this.corner, { x, y });
    const entry = this.plot.entryAt(x, y);
    this.plot.canvas.style.cursor = entry ? "pointer" : "";
    this.plot.light(entry ?? this.pressed);
    [this.at, this.cursor, this.message] = [{ x, y }, null, ""];
    this.tell(true);
  }

  leave() {
    [this.at, this.cursor, this.message] = [null, null, ""];
    this.plot.light(this.pressed);
    this.tell();
  }

  // A finger scrolls the page instead.
  press(/** @type {PointerEvent} */ { offsetX: x, offsetY: y, button: which, pointerType, pointerId }) {
    if (which !== 0) return;
    const entry = this.plot.entryAt(x, y);
    if (entry) this.plot.light((this.pressed = entry === this.pressed ? null : entry));
    else if (pointerType !== "touch" && this.plot.holds(x, y)) {
      this.corner = { x, y };
      this.plot.canvas.setPointerCapture(pointerId);
    }
  }

  release(/** @type {PointerEvent} */ { offsetX, offsetY }) {
    if (!this.corner) return;
    const { left, right, top, bottom } = this.plot;
    const [x, y] = [[this.corner.x, offsetX], [this.corner.y, offsetY]].map((ends) => ends.sort((a, b) => a - b));
    this.drop();
    // A box that is flat one way leaves that axis as it is.
    const [wide, high] = [x, y].map(([from, to]) => to - from >= SMALLEST_BOX);
    const { parts } = this.plot;
    const across = x.map((place) => (place - left) / (right - left));
    const up = y.map((place) => (bottom - place) / (bottom - top));
    if (!wide && !high) return;
    this.zoom(wide ? inner(parts.x, across[0], across[1]) : parts.x, high ? inner(parts.y, up[1], up[0]) : parts.y);
  }

  drop() {
    this.corner = null;
    this.area.hidden = true;
  }

  /**
   * @param {{ x: number, y: number }} from
   * @param {{ x: number, y: number }} to
   */
  drawBox(from, to) {
    const { left, right, top, bottom } = this.plot;
    const x = [from.x, Math.min(right, Math.max(left, to.x))].sort((a, b) => a - b);
    const y = [from.y, Math.min(bottom, Math.max(top, to.y))].sort((a, b) => a - b);
    const place = { left: x[0], top: y[0], width: x[1] - x[0], height: y[1] - y[0] };
    for (const [name, value] of Object.entries(place)) this.area.style.setProperty(name, `${value}px`);
    this.area.hidden = false;
    this.readout.hidden = this.spot.hidden = true;
  }

  // The only way to zoom for a finger.
  double(/** @type {number} */ x, /** @type {number} */ y) {
    const { left, right, top, bottom, parts, zoomed } = this.plot;
    if (!this.plot.holds(x, y)) return;
    if (zoomed) return this.zoom(WHOLE, WHOLE);
    const [at, up] = [(x - left) / (right - left), (bottom - y) / (bottom - top)];
    this.zoom(scaled(parts.x, 0.5, at), scaled(parts.y, 0.5, up));
  }

  // --- by keyboard

  key(/** @type {KeyboardEvent} */ event) {
    const { key, shiftKey, ctrlKey, metaKey, altKey } = event;
    if (ctrlKey || metaKey || altKey || !this.act(key, shiftKey)) return;
    event.preventDefault();
  }

  /**
   * @param {string} key
   * @param {boolean} shift
   * @returns {boolean} whether it means something here
   */
  act(key, shift) {
    if (key in WAYS) shift ? this.pan(WAYS[key]) : this.walk(WAYS[key]);
    else if (key === "+" || key === "=") this.scale(1 / ZOOM);
    else if (key === "-" || key === "_") this.scale(ZOOM);
    else if (key === "0" || key === "Escape") this.showAll();
    else return false;
    return true;
  }

  showAll() {
    this.pressed = null;
    this.leave();
    this.zoom(WHOLE, WHOLE);
  }

  // Around where the keyboard is.
  scale(/** @type {number} */ factor) {
    const { left, right, top, bottom, parts } = this.plot;
    const found = this.cursor && this.find();
    const at = found ? (found.x - left) / (right - left) : 0.5;
    const up = found ? (bottom - found.y) / (bottom - top) : 0.5;
    this.zoom(scaled(parts.x, factor, at), scaled(parts.y, factor, up));
  }

  pan(/** @type {[number, number]} */ [right, up]) {
    const { x, y } = this.plot.parts;
    this.zoom(inner(x, PAN * right, 1 + PAN * right), inner(y, PAN * up, 1 + PAN * up));
  }

  walk(/** @type {[number, number]} */ [right, up]) {
    const found = this.find();
    [this.at, this.message] = [null, ""];
    if (right && found) this.walkAlong(found, right);
    else this.walkAcross(found?.mark ?? -1, -up || 1);
    const mark = this.plot.figure?.marks[this.cursor?.mark ?? -1];
    this.plot.light(mark?.label ?? mark?.of ?? null);
    this.tell(true);
  }

  walkAlong(/** @type {Found} */ { mark, i }, /** @type {number} */ right) {
    const { figure, left, right: end, zoomed } = this.plot;
    const trace = this.plot.trace(/** @type {import("./plot.js").Figure} */ (figure).marks[mark]);
    const step = trace.joined ? Math.ceil(trace.n / WALK_STEPS) : 1;
    const to = further(trace, i, right * step, [left, end]);
    if (to === i && zoomed) return this.pan([right, 0]);
    this.cursor = { mark, i: to ?? i };
  }

  // To the next mark of which something is shown, as far left as it is.
  walkAcross(/** @type {number} */ mark, /** @type {number} */ step) {
    const { figure, left, right } = this.plot;
    const marks = figure?.marks ?? [];
    for (let k = 1; k <= marks.length; k++) {
      const next = (Math.max(mark, step < 0 ? 0 : -1) + step * k + marks.length) % marks.length;
      const i = further(this.plot.trace(marks[next]), -1, 1, [left, right]);
      if (i !== null) return (this.cursor = { mark: next, i });
    }
  }

  // --- what is shown

  zoom(/** @type {Part} */ x, /** @type {Part} */ y) {
    const { figure } = this.plot;
    if (!figure) return;
    this.plot.parts = { x, y };
    this.reset.hidden = !this.plot.zoomed;
    this.plot.schedule();
    const [across, up] = [shown(figure.x, x), shown(figure.y, y)];
    const { left, right, top, bottom } = this.plot;
    const range = readValue(across, [across.min, across.max], right - left);
    const shownNow = `${range}; ${readValue(up, [up.min, up.max], bottom - top)}`;
    this.say(this.plot.zoomed ? shownNow : "All is shown.");
  }

  say(/** @type {string} */ message) {
    this.message = message;
    this.tell();
  }

  /** @returns {Found | null} */
  find() {
    const marks = this.plot.figure?.marks ?? [];
    if (this.at) return this.nearest(this.at.x, this.at.y);
    const { mark, i } = this.cursor ?? { mark: -1, i: -1 };
    if (!marks[mark]) return null;
    const trace = this.plot.trace(marks[mark]);
    if (i >= trace.n) return null;
    const [x, y] = trace.at(i);
    return { mark, i, x, y, distance: 0 };
  }

  /**
   * @param {number} x
   * @param {number} y
   * @returns {Found | null}
   */
  nearest(x, y) {
    const { figure, lit } = this.plot;
    /** @type {Found | null} */
    let best = null;
    if (!figure || !this.plot.holds(x, y)) return null;
    for (const [mark, look] of figure.marks.entries()) {
      if (lit !== null && lit !== (look.label ?? look.of)) continue;
      const found = nearestOn(this.plot.trace(look, y), x, y);
      const distance = found.distance + BEHIND[look.type];
      const near = distance <= Math.min(HAND_REACH, best?.distance ?? HAND_REACH);
      if (found.i >= 0 && near) best = { ...found, mark, distance };
    }
    return best;
  }

  // Called after every painting, since what lies under the hand may have moved.
  tell(moved = false) {
    const { figure } = this.plot;
    if (!figure || this.corner) return;
    const found = this.message ? null : this.find();
    const mark = found && figure.marks[found.mark];
    if (moved && found && mark?.onPick) mark.onPick(found.i);
    const { note } = this.plot.figure ?? figure;
    const place = found ?? (note && this.plot.place(note));
    const text = this.message || (found ? this.words(found) : place && note ? note.text : "");
    if (!text && this.readout.hidden) return;
    this.spot.hidden = !found;
    this.readout.hidden = !text;
    if (this.readout.textContent !== text) this.readout.textContent = text;
    if (found) this.spot.style.translate = `${found.x}px ${found.y}px`;
    if (text) this.put(this.message ? null : place);
  }

  words(/** @type {Found} */ { mark: k, i, x, y }) {
    const { figure, left, right, top, bottom, axes } = this.plot;
    const mark = /** @type {import("./plot.js").Figure} */ (figure).marks[k];
    const name = mark.names?.[i] ?? mark.name ?? mark.label ?? mark.of;
    const up = valueAt(axes.y, (bottom - y) / (bottom - top));
    const values = this.plot.values(mark, i, { x: valueAt(axes.x, (x - left) / (right - left)), y: up });
    const both = `${readValue(axes.x, values.x, right - left)}, ${readValue(axes.y, values.y, bottom - top)}`;
    return name ? `${name}: ${both}` : both;
  }

  // Beside the point where there is room; a message in the upper left corner.
  put(/** @type {{ x: number, y: number } | null | undefined} */ place) {
    const { width, left: edge, top: lid } = this.plot;
    const { offsetWidth, offsetHeight } = this.readout;
    let [left, top] = [Math.max(0, Math.min(edge + 4, width - offsetWidth)), lid + 4];
    if (place) {
      const [right, above] = [place.x + READOUT_GAP, place.y - READOUT_GAP - offsetHeight];
      left = right + offsetWidth > width ? Math.max(0, place.x - READOUT_GAP - offsetWidth) : right;
      top = above < 0 ? place.y + READOUT_GAP : above;
    }
    this.readout.style.translate = `${left}px ${top}px`;
  }
}
