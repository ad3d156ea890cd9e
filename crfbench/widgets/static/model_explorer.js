// The page's side of ModelExplorer: it asks, Python decodes, it draws. No model's formula is written here.

import {
  button,
  element,
  followTheme,
  formatError,
  formatParam,
  formula,
  labelledCheckbox,
  labelledSelect,
  labelledSlider,
  listen,
  newId,
  readouts,
} from "./controls.js";
import { Afterwards } from "./moves.js";
import { SplitPhoto, tableOf } from "./photo.js";
import { float32, Plot } from "./plot.js";
import { busySign, RequestQueue } from "./requests.js";
import { renderScene } from "./scene.js";

/** @typedef {import("./controls.js").Model} Model */

/**
 * All that is drawn at once, as Python packed it.
 * @typedef {object} Scene
 * @property {string} answered the page's request that led to it
 * @property {number} index
 * @property {string} model
 * @property {string} equation
 * @property {boolean} inverse
 * @property {{ name: string, note: string, min: number, max: number, position: number, param: number }[]} sliders
 * @property {string} message
 * @property {DataView} target
 * @property {DataView} decoded
 * @property {DataView | null} valid the nearest valid curve
 * @property {number} rmse
 * @property {number} mse
 * @property {number} falls samples at which the curve falls
 * @property {boolean} inRange
 */

const SLIDER_STEP = 0.02; // in standard deviations of the parameter
const HEADROOM = 0.1; // how much of what leaves [0, 1] is seen

const GAME = "Can you beat Fit? Drag until the RMSE is as small as you can make it, then press Fit.";
const SEAM = "The same light through both curves: where the model fits, no seam is seen. Drag the border.";

function verdict(/** @type {Scene} */ { falls, inRange }) {
  const rises = falls === 0 ? "yes" : `falls at ${falls} sample${falls === 1 ? "" : "s"}`;
  return { rises, stays: inRange ? "yes" : "no" };
}

class ModelExplorerView {
  constructor(/** @type {Model} */ model, /** @type {HTMLElement} */ root) {
    this.model = model;
    /** @type {{ names: string[], models: string[], xLabel: string, yLabel: string }} */
    this.choices = model.get("_choices");
    const { names, models } = this.choices;
    this.plot = new Plot();
    this.photo = new SplitPhoto(renderScene(), SEAM);
    this.equation = element("p", { class: "crf-formula" });
    this.drawn = ""; // the model that the sliders belong to
    /** @type {number[]} */
    this.positions = [];
    /** @type {ReturnType<typeof labelledSlider>[]} */
    this.sliders = [];
    this.sliderBox = element("div", { class: "crf-sliders", role: "group", "aria-label": "model parameters" });
    this.curve = labelledSelect("Curve", names, (index) => this.requests.send("index", index));
    this.family = labelledSelect("Model", models, (i) => this.requests.send("model", models[i]));
    this.valid = labelledCheckbox("show nearest valid curve", (on) => this.requests.send("show_valid", on));
    this.readouts = readouts(["RMSE", "your best RMSE", "MSE", "monotone", "in [0, 1]"]);
    this.status = element("div", { class: "crf-status", role: "status" });
    this.root = element("div", { class: "crf", "aria-busy": false }, this.buildChoices(), this.buildBody());
    root.append(this.root);
    this.afterwards = new Afterwards();
    this.requests = new RequestQueue(model, busySign(this.root, this.status));
    this.leaveTheme = followTheme(this.root, () => this.plot.schedule());
    this.leaveModel = listen(model, { _scene: () => this.update(), best: () => this.update() });
    this.update();
  }

  destroy() {
    this.leaveModel();
    this.leaveTheme();
    this.plot.destroy();
    this.afterwards.stop();
    this.photo.destroy();
  }

  buildChoices() {
    this.curve.box.classList.add("crf-grow");
    const turn = element("div", { class: "crf-turn" });
    turn.append(button("◀", () => this.turn(-1), { "aria-label": "previous curve", title: "previous curve" }));
    turn.append(button("▶", () => this.turn(1), { "aria-label": "next curve", title: "next curve" }));
    return element("div", { class: "crf-choices" }, this.curve.box, turn, this.family.box, this.equation);
  }

  buildBody() {
    const fit = button("Fit", () => this.requests.send("fit"), { class: "crf-main", title: "least MSE to this curve" });
    const reset = button("Reset", () => this.requests.send("reset"), { title: "mean parameters" });
    const buttons = element("div", { class: "crf-buttons" }, fit, reset);
    const game = element("p", { class: "crf-note" }, GAME);
    const panel = element("div", { class: "crf-panel" }, game, this.sliderBox, buttons, this.valid.box);
    panel.append(this.readouts.box, this.status);
    const left = element("div", { class: "crf-plot" }, this.plot.box, this.photo.box);
    return element("div", { class: "crf-body" }, left, panel);
  }

  turn(/** @type {number} */ step) {
    const { input } = this.curve;
    const n = input.options.length;
    input.selectedIndex = (input.selectedIndex + step + n) % n;
    this.requests.send("index", input.selectedIndex);
  }

  update() {
    /** @type {Scene} */
    const scene = this.model.get("_scene");
    this.requests.answered(scene.answered);
    const best = this.model.get("best")[`${this.choices.names[scene.index]}, ${scene.model}`];
    if (scene.model !== this.drawn) this.rebuildSliders(scene);
    if (this.requests.idle) this.followControls(scene);
    scene.sliders.forEach(({ param }, i) => this.sliders[i].show(null, formatParam(param)));
    const { rises, stays } = verdict(scene);
    this.readouts.show([formatError(scene.rmse), best === undefined ? "–" : formatError(best), formatError(scene.mse), rises, stays]);
    this.status.textContent = scene.message + (scene.message && best ? `; your best: ${formatError(best)}` : "");
    this.draw(scene);
  }

  rebuildSliders(/** @type {Scene} */ scene) {
    this.drawn = scene.model;
    this.positions = scene.sliders.map(({ position }) => position);
    const [left, ...right] = scene.equation.split(" = "); // y in the colour of the model's line
    const y = element("b", { class: "crf-model-colour" }, left);
    this.equation.replaceChildren(...(scene.equation ? [y, " = ", ...formula(right.join(" = "))] : []));
    this.sliders = scene.sliders.map(({ name, note, min, max }, i) => {
      const slider = labelledSlider(name, { min, max, step: SLIDER_STEP }, (position) => this.slide(i, position));
      const says = element("span", { class: "crf-note", id: newId() }, ...formula(note));
      slider.input.setAttribute("aria-describedby", says.id);
      slider.box.append(says);
      return slider;
    });
    this.sliderBox.replaceChildren(...this.sliders.map(({ box }) => box));
  }

  // Positions are kept apart from the thumbs, which stop at the ends of their range and at whole steps.
  slide(/** @type {number} */ i, /** @type {number} */ position) {
    this.positions[i] = position;
    this.requests.send("positions", [...this.positions]);
  }

  // Only when nothing is under way, so that an old answer never pulls a control from under the hand.
  followControls(/** @type {Scene} */ scene) {
    this.curve.input.selectedIndex = scene.index;
    this.family.input.selectedIndex = this.choices.models.indexOf(scene.model);
    this.valid.input.checked = scene.valid !== null;
    this.positions = scene.sliders.map(({ position }) => position);
    scene.sliders.forEach(({ position, param }, i) => this.sliders[i].show(position, formatParam(param)));
  }

  draw(/** @type {Scene} */ scene) {
    const { names, xLabel, yLabel } = this.choices;
    /** @type {import("./plot.js").Mark[]} */
    const marks = [
      { type: "line", y: float32(scene.target), label: names[scene.index], colour: "blue" },
      { type: "line", y: float32(scene.decoded), label: scene.model, colour: "vermilion", dash: "dashed" },
    ];
    if (scene.valid !== null) {
      marks.push({ type: "line", y: float32(scene.valid), label: "nearest valid", colour: "green", dash: "dotted" });
    }
    const x = { label: xLabel, min: 0, max: 1 };
    const y = { label: yLabel, min: -HEADROOM, max: 1 + HEADROOM };
    this.plot.draw({ x, y, marks, description: this.describe(scene) });
    this.afterwards.run(() => this.drawPhoto(scene));
  }

  drawPhoto(/** @type {Scene} */ { index, model, target, decoded, inverse }) {
    const { levels } = this.photo.picture;
    const [left, right] = [target, decoded].map((curve) => tableOf(levels, float32(curve), inverse));
    this.photo.show({ name: this.choices.names[index], tables: [left] }, { name: model, tables: [right] });
    this.photo.refresh();
  }

  describe(/** @type {Scene} */ scene) {
    const { rises, stays } = verdict(scene);
    const errors = `RMSE ${formatError(scene.rmse)}, monotone: ${rises}, in [0, 1]: ${stays}`;
    return `Curve ${this.choices.names[scene.index]} and model ${scene.model}: ${errors}`;
  }
}

function render(/** @type {{ model: Model, el: HTMLElement }} */ { model, el }) {
  const view = new ModelExplorerView(model, el);
  return () => view.destroy();
}

export default { render };
