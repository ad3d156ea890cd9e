// The page's side of ChartLabeller: drags the corners and previews the patches; Python keeps the labels.

import { PATCHES, patchMeans, turnsClockwise } from "./chart_grid.js";
import { centre, Loupe, PhotoSketch } from "./chart_sketch.js";
import { button, element, followTheme, labelledSelect, listen } from "./controls.js";

/** @typedef {import("./controls.js").Model} Model */

/**
 * @typedef {import("./chart_grid.js").Point} Point
 * @typedef {{ index: number, name: string, width: number, height: number, jpeg: DataView<ArrayBuffer> }} Picture
 */

const CORNER_NAMES = ["dark skin", "bluish green", "black", "white"];
/** @type {Record<string, Point>} */
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const MOST_HEIGHT = 560; // of the photograph on the page
const NUMBER_DISTANCE = 26; // from a corner to its number
const NUMBER_RADIUS = 9; // of the number itself
const HELP =
  "Drag the corners, or press Tab to reach one and the arrow keys to move it by one pixel of the photograph, " +
  "with Shift by ten. Ctrl+Z undoes.";

/**
 * A centred chart in the photograph's own proportions, for where nobody has placed one.
 * @param {Picture} picture
 * @returns {Point[]}
 */
function firstCorners({ width, height }) {
  const across = Math.min(0.6 * width, 0.8 * height * 1.5);
  const [dx, dy] = [across / width / 2, across / 1.5 / height / 2];
  return [[0.5 - dx, 0.5 - dy], [0.5 + dx, 0.5 - dy], [0.5 + dx, 0.5 + dy], [0.5 - dx, 0.5 + dy]];
}

/** @type {(a: unknown, b: unknown) => boolean} */
const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

class ChartLabellerView {
  constructor(/** @type {Model} */ model, /** @type {HTMLElement} */ root) {
    this.model = model;
    /** @type {string[]} */
    this.names = model.get("_names");
    /** @type {Picture} the one on the page, which the choice may have left already */
    this.picture = model.get("_picture");
    /** @type {{ bitmap: ImageBitmap, pixels: ImageData } | null} of the picture, once it is decoded */
    this.image = null;
    /** @type {Point[]} */
    this.corners = firstCorners(this.picture);
    /** @type {{ name: string, before: Point[] | undefined }[]} */
    this.undoable = [];
    this.committing = false;
    this.message = "";
    this.photo = new PhotoSketch();
    this.loupe = new Loupe();
    this.choice = labelledSelect("Photograph", this.names, (index) => this.go(index));
    this.handles = CORNER_NAMES.map((_, at) => this.buildHandle(at));
    this.stage = element("div", { class: "crf-stage" }, this.photo.canvas, this.loupe.canvas, ...this.handles);
    this.swatches = PATCHES.map(() => element("span"));
    this.preview = element("div", { class: "crf-swatches", role: "img" }, ...this.swatches);
    this.status = element("div", { class: "crf-status", role: "status" });
    this.root = element("div", { class: "crf", "aria-busy": true }, this.buildChoices(), this.buildBody());
    this.root.addEventListener("keydown", (event) => this.onUndoKeys(event));
    root.append(this.root);
    this.leaveTheme = followTheme(this.root, () => this.show());
    this.stopListening = listen(model, {
      index: () => this.showBusy(),
      _picture: () => this.receive(),
      labels: () => this.heed(),
    });
    this.receive();
  }

  destroy() {
    this.stopListening();
    this.leaveTheme();
    this.photo.destroy();
    this.loupe.destroy();
    this.image?.bitmap.close();
  }

  buildChoices() {
    this.choice.box.classList.add("crf-grow");
    const turns = [
      button("◀", () => this.turn(-1), { "aria-label": "previous photograph", title: "previous photograph" }),
      button("▶", () => this.turn(1), { "aria-label": "next photograph", title: "next photograph" }),
    ];
    const copy = button("Copy corners to next", () => this.copyToNext());
    const undo = button("Undo", () => this.undo());
    const turn = element("div", { class: "crf-turn" }, ...turns);
    return element("div", { class: "crf-choices" }, this.choice.box, turn, copy, undo);
  }

  buildBody() {
    const order = element("ol", { class: "crf-order" }, ...CORNER_NAMES.map((name) => element("li", {}, name)));
    const panel = element("div", { class: "crf-panel" }, this.status, element("div", {}, "Corners, clockwise:", order));
    panel.append(element("div", {}, "Means of the patches:", this.preview), element("p", { class: "crf-note" }, HELP));
    return element("div", { class: "crf-body" }, element("div", { class: "crf-plot" }, this.stage), panel);
  }

  buildHandle(/** @type {number} */ at) {
    const handle = button(String(at + 1), () => {}, { class: "crf-corner", "data-number": at + 1 });
    handle.addEventListener("pointerdown", (event) => this.startDrag(event, at));
    handle.addEventListener("keydown", (event) => this.nudge(event, at));
    handle.addEventListener("focus", () => this.magnify(at));
    handle.addEventListener("blur", () => this.loupe.hide());
    return handle;
  }

  // --- which photograph

  go(/** @type {number} */ index) {
    this.model.set("index", index);
    this.model.save_changes();
  }

  turn(/** @type {number} */ step) {
    const n = this.names.length;
    if (n > 1) this.go((this.model.get("index") + step + n) % n);
  }

  showBusy() {
    this.root.setAttribute("aria-busy", String(!this.image || this.picture.index !== this.model.get("index")));
  }

  async receive() {
    /** @type {Picture} */
    const picture = this.model.get("_picture");
    const bitmap = await createImageBitmap(new Blob([picture.jpeg], { type: "image/jpeg" }));
    if (picture !== this.model.get("_picture")) return; // another one came meanwhile
    this.image?.bitmap.close();
    this.image = { bitmap, pixels: pixelsOf(bitmap) };
    this.picture = picture;
    this.stage.style.aspectRatio = `${picture.width} / ${picture.height}`;
    this.stage.style.maxWidth = `${(MOST_HEIGHT * picture.width) / picture.height}px`;
    this.choice.input.selectedIndex = picture.index;
    this.follow();
    this.showBusy();
  }

  // --- the labels

  /** @returns {Record<string, Point[]>} */
  get labels() {
    return this.model.get("labels");
  }

  // Keeps what Python says; nothing done here before it can be undone any more.
  heed() {
    if (this.committing) return;
    this.undoable = [];
    this.follow();
  }

  // Takes the corners of this photograph from the labels.
  follow() {
    this.corners = this.labels[this.picture.name] ?? firstCorners(this.picture);
    this.say();
  }

  /** @param {string} [message] instead of what is always said */
  say(message = "") {
    this.message = message;
    this.show();
  }

  // Crossed corners stay on the page until they are right: only those that a chart can have become a label.
  keep(/** @type {Point[]} */ before) {
    if (!turnsClockwise(this.corners)) return this.say();
    if (!same(before, this.corners)) this.commit(this.picture.name, this.corners);
    this.follow();
  }

  /**
   * @param {string} name
   * @param {Point[] | undefined} corners none where the photograph is to have no label
   */
  commit(name, corners, undoable = true) {
    const { [name]: before, ...labels } = this.labels;
    if (undoable) this.undoable.push({ name, before });
    if (corners) labels[name] = corners;
    this.committing = true;
    this.model.set("labels", labels);
    this.committing = false;
    this.model.save_changes();
  }

  undo() {
    if (!turnsClockwise(this.corners)) return this.follow(); // back to the last that were right
    const last = this.undoable.pop();
    if (!last) return this.say("There is nothing to undo.");
    this.commit(last.name, last.before, false);
    if (last.name === this.picture.name) this.follow();
    else this.go(this.names.indexOf(last.name));
  }

  onUndoKeys(/** @type {KeyboardEvent} */ event) {
    if (!(event.ctrlKey || event.metaKey) || event.shiftKey || event.key.toLowerCase() !== "z") return;
    event.preventDefault();
    this.undo();
  }

  copyToNext() {
    const next = this.picture.index + 1;
    const placed = this.labels[this.picture.name];
    if (!same(placed, this.corners)) return this.say("Place the corners before you copy them.");
    if (next === this.names.length) return this.say("This is the last photograph; there is none to copy to.");
    this.commit(this.names[next], placed);
    this.go(next);
  }

  // --- moving a corner

  startDrag(/** @type {PointerEvent} */ event, /** @type {number} */ at) {
    if (event.button !== 0 || !this.image) return;
    event.preventDefault();
    const handle = this.handles[at];
    handle.focus({ preventScroll: true });
    handle.setPointerCapture(event.pointerId);
    const [before, from] = [this.corners, [event.clientX, event.clientY]];
    const { width, height } = this.stage.getBoundingClientRect();
    const [x, y] = before[at];
    handle.onpointermove = ({ clientX, clientY }) =>
      this.move(at, [x + (clientX - from[0]) / width, y + (clientY - from[1]) / height]);
    handle.onpointerup = handle.onpointercancel = ({ type }) => {
      handle.onpointermove = handle.onpointerup = handle.onpointercancel = null;
      if (type === "pointercancel") this.corners = before;
      this.keep(before);
    };
  }

  nudge(/** @type {KeyboardEvent} */ event, /** @type {number} */ at) {
    if (!(event.key in ARROWS) || event.ctrlKey || event.metaKey || event.altKey || !this.image) return;
    event.preventDefault();
    const step = event.shiftKey ? 10 : 1;
    const [dx, dy] = ARROWS[event.key];
    const before = this.corners;
    const [x, y] = before[at];
    this.move(at, [x + (step * dx) / this.picture.width, y + (step * dy) / this.picture.height]);
    this.keep(before);
  }

  move(/** @type {number} */ at, /** @type {Point} */ [x, y]) {
    /** @type {Point} */
    const inside = [Math.min(1, Math.max(0, x)), Math.min(1, Math.max(0, y))];
    this.corners = this.corners.map((corner, i) => (i === at ? inside : corner));
    this.show();
  }

  // --- what is seen

  magnify(/** @type {number} */ at) {
    if (!this.image) return;
    const figure = { bitmap: this.image.bitmap, corners: this.corners, at };
    this.loupe.show(figure, this.stage.getBoundingClientRect());
  }

  show() {
    if (!this.image) return;
    const valid = turnsClockwise(this.corners);
    const description = `Photograph ${this.picture.name} with the chart`;
    this.photo.draw({ bitmap: this.image.bitmap, corners: this.corners, valid, description });
    this.showHandles();
    this.showMeans(valid ? patchMeans(this.image.pixels, this.corners) : []);
    const text = this.message || this.describe(valid);
    if (this.status.textContent !== text) this.status.textContent = text;
    const held = this.handles.findIndex((handle) => handle === this.root.ownerDocument.activeElement);
    if (held >= 0) this.magnify(held);
  }

  showHandles() {
    const { width, height } = this.picture;
    const middle = centre(this.corners);
    const stage = this.stage.getBoundingClientRect();
    // Numbers stand away from the chart, but towards it where the photograph ends.
    /** @type {(shift: number, from: number, size: number) => number} */
    const inside = (shift, from, size) =>
      from + shift < NUMBER_RADIUS || from + shift > size - NUMBER_RADIUS ? -shift : shift;
    this.handles.forEach((handle, at) => {
      const [x, y] = this.corners[at];
      const away = Math.atan2((y - middle[1]) * height, (x - middle[0]) * width);
      const [dx, dy] = [NUMBER_DISTANCE * Math.cos(away), NUMBER_DISTANCE * Math.sin(away)];
      handle.style.left = `${100 * x}%`;
      handle.style.top = `${100 * y}%`;
      handle.style.setProperty("--crf-dx", `${inside(dx, x * stage.width, stage.width)}px`);
      handle.style.setProperty("--crf-dy", `${inside(dy, y * stage.height, stage.height)}px`);
      const place = `x ${(x * width).toFixed(1)}, y ${(y * height).toFixed(1)}`;
      handle.setAttribute("aria-label", `corner ${at + 1} of 4, ${CORNER_NAMES[at]}: ${place}`);
    });
  }

  /** @param {number[][]} means of the patches, or none */
  showMeans(means) {
    const texts = means.map((mean) => mean.map(Math.round).join(" "));
    this.swatches.forEach((swatch, i) => {
      swatch.style.backgroundColor = texts[i] ? `rgb(${texts[i]})` : "transparent";
      swatch.title = texts[i] ? `patch ${i + 1}: ${texts[i]}` : "";
    });
    const text = texts.length ? `red green blue of the 24 patches: ${texts.join(", ")}` : "no patches";
    this.preview.setAttribute("aria-label", text);
  }

  describe(/** @type {boolean} */ valid) {
    const { labels } = this;
    const count = `${this.names.filter((name) => name in labels).length} of ${this.names.length} labelled.`;
    if (!valid) return `The corners cross or run anticlockwise: bring them into the order below. ${count}`;
    const labelled = this.picture.name in labels;
    return `${labelled ? "This photograph is labelled" : "Drag the four corners onto the chart"}; ${count}`;
  }
}

function pixelsOf(/** @type {ImageBitmap} */ bitmap) {
  const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
  const context = /** @type {OffscreenCanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.drawImage(bitmap, 0, 0);
  return context.getImageData(0, 0, bitmap.width, bitmap.height);
}

function render(/** @type {{ model: Model, el: HTMLElement }} */ { model, el }) {
  const view = new ChartLabellerView(model, el);
  return () => view.destroy();
}

export default { render };
