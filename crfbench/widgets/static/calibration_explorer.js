// The page's side of CalibrationExplorer: a chart of patches to press, Python's curve and bands, and the truth.

import {
  button,
  element,
  followTheme,
  formatError,
  formatParam,
  labelledSelect,
  listen,
  offer,
  readouts,
} from "./controls.js";
import { PatchChart } from "./patch_chart.js";
import { bytesOf, float32, Plot } from "./plot.js";
import { busySign } from "./requests.js";

/** @typedef {import("./controls.js").Model} Model */

/**
 * @typedef {import("./plot.js").Mark} Mark
 * @typedef {{ camera: string, illumination: number, model: string, method: string, patches: number[] }} Choice
 * @typedef {{ name: string, ends: number[], best: number, densities: DataView[] }} Density
 *
 * @typedef {object} Shown what Python says of the last calibration; numbers are float32
 * @property {string} label
 * @property {number} rmse
 * @property {DataView} curve
 * @property {Record<string, DataView>} bands by level, low and high one after the other
 * @property {number[]} patches which were used
 * @property {DataView} dots brightness and irradiance one after the other
 * @property {number[]} dotPatches which of the patches used each dot is, from 0
 * @property {[number, number]} range
 * @property {Density | null} density
 * @property {Record<string, number>} params
 * @property {string[]} warnings
 * @property {number} milliseconds
 *
 * @typedef {{ choice: Choice, error: string, colours: DataView, truth: DataView, shown: Shown }} Scene
 */

const FAINT = 0.3; // opacity of a curve that the present choice no longer gives

/** @param {DataView} view numbers of which the second half belongs to the first */
function halves(view) {
  const numbers = float32(view);
  return [numbers.subarray(0, numbers.length / 2), numbers.subarray(numbers.length / 2)];
}

/**
 * A curve over 0 to 1, solid within the range and dashed beyond it.
 * @param {Float32Array} samples
 * @param {[number, number]} range
 * @param {{ label: string, colour: "blue", alpha: number }} look
 * @returns {Mark[]}
 */
function curveMarks(samples, range, { label, ...look }) {
  const last = samples.length - 1;
  const x = samples.map((_, i) => i / last);
  const [from, to] = [Math.floor(range[0] * last), Math.ceil(range[1] * last)];
  /** @type {(start: number, end: number) => Mark & { type: "line" }} */
  const part = (start, end) => ({
    type: "line",
    x: x.subarray(start, end + 1),
    y: samples.subarray(start, end + 1),
    ...look,
  });
  return [{ ...part(0, from), dash: "dashed" }, { ...part(from, to), label }, { ...part(to, last), dash: "dashed" }];
}

class CalibrationExplorerView {
  constructor(/** @type {Model} */ model, /** @type {HTMLElement} */ root) {
    this.model = model;
    this.options = model.get("_options");
    this.plot = new Plot();
    this.density = new Plot("crf-density-curve");
    this.chart = new PatchChart(this.options.reference, (patch) => this.toggle(patch));
    this.figures = element("div");
    this.warnings = element("ul", { class: "crf-warnings", "aria-label": "warnings" });
    this.status = element("div", { class: "crf-status", role: "status" });
    const { cameras, illuminations, models } = this.options;
    const seen = illuminations.map((/** @type {number} */ i) => `illumination ${i}`);
    const names = models.map((/** @type {{ name: string }} */ { name }) => name);
    this.camera = labelledSelect("Camera", cameras, (i) => this.set({ camera: cameras[i] }));
    this.light = labelledSelect("Calibrate on", seen, (i) => this.set({ illumination: illuminations[i] }));
    this.family = labelledSelect("Model", names, (i) => this.chooseModel(i));
    this.method = labelledSelect("Method", [], (i) => this.set({ method: this.methods[i] }));
    /** @type {string[]} those of the model */
    this.methods = [];
    const boxes = [this.camera, this.light, this.family, this.method].map(({ box }) => box);
    const parts = [element("div", { class: "crf-choices" }, ...boxes), this.buildBody()];
    this.root = element("div", { class: "crf crf-calibration", "aria-busy": false }, ...parts);
    root.append(this.root);
    this.showBusy = busySign(this.root, this.status);
    this.leaveTheme = followTheme(this.root, () => [this.plot, this.density].forEach((plot) => plot.schedule()));
    const follow = () => this.followChoice();
    const choice = { camera: follow, illumination: follow, model: follow, method: follow, patches: follow };
    this.stopListening = listen(model, { ...choice, _scene: () => this.update() });
    this.update();
  }

  destroy() {
    this.stopListening();
    this.leaveTheme();
    for (const plot of [this.plot, this.density]) plot.destroy();
  }

  buildBody() {
    /** @type {{ label: string, patches: number[] }[]} */
    const shortcuts = this.options.shortcuts;
    const buttons = shortcuts.map(({ label, patches }) => button(label, () => this.set({ patches })));
    const row = element("div", { class: "crf-buttons", role: "group", "aria-label": "sets of patches" }, ...buttons);
    const hint = "Dashed: beyond the brightness measured, where model and prior speak alone.";
    const left = element("div", { class: "crf-plot" }, this.plot.box, element("p", { class: "crf-note" }, hint));
    left.append(this.status, this.warnings);
    const panel = element("div", { class: "crf-panel" }, this.chart.box, row, this.density.box, this.figures);
    return element("div", { class: "crf-body" }, left, panel);
  }

  // --- what is chosen: the traits, which the controls show at once; Python's answer follows

  set(/** @type {Partial<Choice>} */ choice) {
    for (const [name, value] of Object.entries(choice)) this.model.set(name, value);
    this.model.save_changes();
  }

  chooseModel(/** @type {number} */ i) {
    const { name, methods } = this.options.models[i];
    // All models list their methods in one order, so "grid" and "lm", the least loss, give way to each other.
    this.set({ model: name, method: methods[this.methods.indexOf(this.model.get("method"))] });
  }

  toggle(/** @type {number} */ patch) {
    /** @type {number[]} */
    const patches = this.model.get("patches");
    const others = patches.filter((other) => other !== patch);
    // In Python's order: what it would have to put right it sends back, perhaps later than the next click.
    this.set({ patches: others.length < patches.length ? others : [...others, patch].sort((a, b) => a - b) });
  }

  followChoice() {
    const { cameras, illuminations, models, methods } = this.options;
    const { choice } = /** @type {Scene} */ (this.model.get("_scene"));
    const at = models.findIndex((/** @type {{ name: string }} */ { name }) => name === this.model.get("model"));
    this.camera.input.selectedIndex = cameras.indexOf(this.model.get("camera"));
    this.light.input.selectedIndex = illuminations.indexOf(this.model.get("illumination"));
    this.family.input.selectedIndex = at;
    if (String(this.methods) !== String(models[at].methods)) {
      this.methods = models[at].methods;
      offer(this.method.input, this.methods.map((name) => methods[name]));
    }
    this.method.input.selectedIndex = this.methods.indexOf(this.model.get("method"));
    this.chart.press(this.model.get("patches"));
    this.showBusy(Object.entries(choice).some(([name, value]) => String(this.model.get(name)) !== String(value)));
  }

  // --- what Python answers

  update() {
    /** @type {Scene} */
    const scene = this.model.get("_scene");
    this.chart.paint(new Uint8Array(bytesOf(scene.colours)));
    this.showFigures(scene);
    this.drawCurve(scene);
    this.drawDensity(scene.shown.density);
    this.followChoice();
  }

  showFigures(/** @type {Scene} */ { choice, shown, error }) {
    const [darkest, brightest] = shown.range.map((value) => value.toFixed(2));
    const rows = {
      "held-out RMSE": formatError(shown.rmse),
      ...Object.fromEntries(Object.entries(shown.params).map(([name, value]) => [name, formatParam(value)])),
      "brightness measured": `${darkest} to ${brightest}`,
      calculation: `${Number(shown.milliseconds.toPrecision(2))} ms`,
    };
    const list = readouts(Object.keys(rows));
    list.show(Object.values(rows));
    this.figures.replaceChildren(list.box);
    this.root.classList.toggle("crf-stale", error !== "");
    this.status.textContent = error || `${choice.patches.length} patches: held-out RMSE ${formatError(shown.rmse)}`;
    this.warnings.replaceChildren(...(error ? [] : shown.warnings).map((text) => element("li", {}, text)));
  }

  drawCurve(/** @type {Scene} */ { choice, shown, error, truth, colours }) {
    const other = this.options.illuminations.find((/** @type {number} */ i) => i !== choice.illumination);
    const [seen, raw] = halves(truth);
    const [brightness, irradiance] = halves(shown.dots);
    const patches = shown.dotPatches.map((i) => shown.patches[i]);
    const rgb = new Uint8Array(bytesOf(colours));
    const paints = patches.map((patch) => `rgb(${rgb.subarray(3 * patch - 3, 3 * patch).join()})`);
    const strength = error ? FAINT : 1;
    /** @type {Mark[]} */
    const bands = Object.entries(shown.bands)
      .sort(([a], [b]) => Number(b) - Number(a))
      .map(([level, view], i) => {
        const [low, high] = halves(view);
        const alpha = strength * (0.16 + 0.14 * i);
        return { type: "band", label: `${100 * Number(level)} % band`, low, high, colour: "blue", alpha };
      });
    const stale = error ? " The last curve is kept, faded." : "";
    this.plot.draw({
      x: { label: "brightness of the JPEG (0 to 1)", min: 0, max: 1 },
      y: { label: "irradiance (RAW, 0 to 1)", min: -0.05, max: 1.1 },
      marks: [
        ...bands,
        { type: "dots", label: `truth: RAW, illumination ${other}`, x: seen, y: raw, radius: 2.5, alpha: 0.5 },
        ...curveMarks(float32(shown.curve), shown.range, { label: shown.label, colour: "blue", alpha: strength }),
        {
          type: "dots",
          label: "patches used, in their colours, aligned",
          names: patches.map((patch) => `patch ${patch}`),
          paints,
          x: brightness,
          y: irradiance,
          radius: 4.5,
          rim: true,
          colour: "vermilion",
          alpha: strength,
        },
      ],
      description:
        `Inverse response of ${choice.camera} by ${shown.label}: ` +
        `held-out RMSE ${formatError(shown.rmse)}.${stale}`,
    });
  }

  /** @param {Density | null} density over the one parameter of a model that has no more */
  drawDensity(density) {
    this.density.box.hidden = density === null;
    if (density === null) return;
    const { name, best } = density;
    const [prior, posterior, likelihood] = density.densities.map(float32);
    const [min, max] = density.ends;
    const top = 1.08 * Math.max(...prior, ...(posterior ?? []), ...(likelihood ?? []));
    const at = Math.min(max, Math.max(min, best));
    /** @type {Mark[]} */
    const marks = [{ type: "line", label: "prior", y: prior, colour: "vermilion", dash: "dashed" }];
    if (posterior) marks.push({ type: "line", label: "posterior", y: posterior, colour: "blue" });
    if (likelihood) marks.push({ type: "line", label: "likelihood", y: likelihood, colour: "green", dash: "dotted" });
    marks.push({ type: "line", label: "best", x: [at, at], y: [0, top], width: 1 });
    this.density.draw({
      x: { label: name, min, max, gap: 40 },
      y: { label: "density", min: 0, max: top },
      marks,
      description: `Density of ${name}: prior${posterior ? " and posterior" : ""}, best ${formatParam(best)}`,
    });
  }
}

function render(/** @type {{ model: Model, el: HTMLElement }} */ { model, el }) {
  const view = new CalibrationExplorerView(model, el);
  return () => view.destroy();
}

export default { render };
