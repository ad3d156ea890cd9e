// The page's side of EpochPlayer: it gets all epochs at once, so that playing and dragging need no Python.

import { button, element, followTheme, labelledSlider, listen } from "./controls.js";
import { LatentColumn, NOTE, Run } from "./latent_column.js";
import { Animation, move } from "./moves.js";

/** @typedef {import("./controls.js").Model} Model */

const PACE = { speed: 12, calmStep: 12 }; // of the animation, in epochs kept

class EpochPlayerView {
  constructor(/** @type {Model} */ model, /** @type {HTMLElement} */ root) {
    this.model = model;
    /** @type {Run[]} */
    this.runs = [];
    /** @type {LatentColumn[]} */
    this.columns = [];
    /** @type {number[]} all epochs that any training kept */
    this.timeline = [];
    this.position = 0; // in the timeline
    this.from = 0; // where the animation began
    this.expected = model.get("epoch"); // what the page itself has set last
    this.animation = new Animation(PACE, (way) => this.advance(this.from + Math.floor(way)));
    this.play = button("Play", () => this.toggle(), { class: "crf-main crf-toggle" });
    const range = { min: 0, max: 0, step: 1 };
    this.slider = labelledSlider("Epoch", range, (position) => (this.pause(), this.put(position)));
    this.status = element("div", { class: "crf-status", role: "status" });
    this.grid = element("div", { class: "crf-columns" });
    this.root = element("div", { class: "crf crf-player" });
    const note = element("p", { class: "crf-note" }, NOTE);
    this.root.append(element("div", { class: "crf-play" }, this.play, this.slider.box), note, this.status, this.grid);
    root.append(this.root);
    this.leaveTheme = followTheme(this.root, () => this.columns.forEach((column) => column.repaint()));
    this.leaveModel = listen(model, { _columns: () => this.rebuild(), epoch: () => this.update() });
    this.rebuild();
  }

  destroy() {
    this.leaveModel();
    this.leaveTheme();
    this.animation.stop();
    for (const column of this.columns) column.destroy();
  }

  rebuild() {
    const known = this.runs.map(({ name }) => name);
    /** @type {import("./latent_column.js").Packed[]} */
    const packed = this.model.get("_columns");
    this.runs = packed.map((column) => new Run(column));
    this.timeline = [...new Set(this.runs.flatMap(({ epochs }) => epochs))].sort((a, b) => a - b);
    for (const column of this.columns) column.destroy();
    this.columns = this.runs.map(() => new LatentColumn());
    this.grid.replaceChildren(...this.columns.map(({ box }) => box));
    this.slider.input.max = String(this.timeline.length - 1);
    this.update();
    const joined = known.length ? this.runs.filter(({ name }) => !known.includes(name)) : [];
    this.status.textContent = joined.map(({ name }) => `${name} is here now.`).join(" ");
  }

  update() {
    const wanted = this.model.get("epoch");
    if (wanted !== this.expected) this.pause();
    this.position = Math.max(0, this.timeline.findLastIndex((kept) => kept <= wanted));
    const epoch = this.timeline[this.position];
    this.slider.show(this.position, `${epoch} of ${this.timeline[this.timeline.length - 1]}`);
    this.columns.forEach((column, i) => column.show(this.runs[i], epoch));
  }

  put(/** @type {number} */ position) {
    this.expected = this.timeline[position];
    move(this.model, { epoch: this.expected });
  }

  toggle() {
    if (this.animation.running) return this.pause();
    this.from = this.position < this.timeline.length - 1 ? this.position : 0;
    this.animation.start();
    this.play.textContent = "Pause";
  }

  advance(/** @type {number} */ position) {
    const last = this.timeline.length - 1;
    if (position !== this.position) this.put(Math.min(position, last));
    if (position >= last) this.pause();
  }

  pause() {
    this.animation.stop();
    this.play.textContent = "Play";
  }
}

function render(/** @type {{ model: Model, el: HTMLElement }} */ { model, el }) {
  const view = new EpochPlayerView(model, el);
  return () => view.destroy();
}

export default { render };
