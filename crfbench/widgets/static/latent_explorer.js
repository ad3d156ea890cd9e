// The page's side of LatentExplorer: the decoder runs here, so the curve follows the hand, with Python or without.

import { button, element, followTheme, labelledSelect, labelledSlider, listen, offer, readouts } from "./controls.js";
import {
  decode,
  hiddenLayers,
  kernelDensity,
  nearestCurve,
  nearestPower,
  normal,
  unpackCurves,
  unpackModel,
} from "./decode.js";
import { Afterwards, Animation, move } from "./moves.js";
import { NetworkSketch } from "./network.js";
import { SplitPhoto, tableOf, unchanged } from "./photo.js";
import { Plot } from "./plot.js";
import { renderScene } from "./scene.js";

/** @typedef {import("./controls.js").Model} Model */

/** @typedef {{ title: string, values: string[] }} Facet what tells models apart: a value for each */

const REACH = 4; // how far the sliders go to either side of 0
const SLIDER_STEP = 0.02;
const PACE = { speed: 2, calmStep: 0.5 }; // of the animation, in latent
const PLACES = Array.from({ length: 161 }, (_, i) => REACH * (i / 80 - 1)); // where densities are drawn
const PRIOR = PLACES.map(normal);
const RUG = 1 / 8; // height of the ticks below a density, as a share of it
const HEADROOM = 1 / 11; // above it

const NETWORK_NOTE =
  "The network and its numbers of neurons. In training, the encoder squeezed each curve (in: the nearest one) through " +
  "the waist. The decoder runs here: a cell is a neuron, the fuller the more active.";
const PHOTO_NOTE =
  "Made by arithmetic. Left: the light itself, shown as numbers. Right: the same light through the response shown. " +
  "Drag the border.";

const clamp = (/** @type {number} */ z) => Math.min(REACH, Math.max(-REACH, z));
const formatLatent = (/** @type {number} */ z) => z.toFixed(2).replace("-", "−");

/** What lies below a slider: N(0, 1), the density of the training curves' latents, a tick for each, and where z is. */
class DensityPlot extends Plot {
  constructor(/** @type {string} */ label, /** @type {Float32Array} */ latents) {
    super("crf-density", false);
    const density = kernelDensity(latents, PLACES);
    const top = Math.max(...PRIOR, ...density);
    const inside = latents.filter((z) => Math.abs(z) <= REACH);
    this.position = [0];
    this.draw({
      x: { name: "z", min: -REACH, max: REACH, gap: 50 },
      y: { name: "density", min: -RUG * top, max: (1 + HEADROOM) * top },
      marks: [
        { type: "band", name: "training curves", low: PLACES.map(() => 0), high: density, colour: "blue", alpha: 0.3 },
        { type: "line", name: "N(0, 1)", y: PRIOR, colour: "vermilion", dash: "dashed", width: 1.5 },
        { type: "bar", x: inside, high: inside.map(() => 0), colour: "blue" },
        { type: "bar", x: this.position, width: 2 },
      ],
      description: `Density of ${label} over its ${latents.length} training curves beside N(0, 1)`,
      bare: true,
    });
  }

  mark(/** @type {number} */ z) {
    this.position[0] = clamp(z);
    this.schedule();
  }
}

/** Selects that offer what exists: each one the values found together with those chosen before it. */
class Chooser {
  constructor(/** @type {Facet[]} */ facets, /** @type {(model: number) => void} */ onChoose) {
    this.facets = facets;
    this.selects = facets.map(({ title }) => labelledSelect(title, [], () => onChoose(this.chosen())));
    this.box = element("div", { class: "crf-choices" }, ...this.selects.map(({ box }) => box));
  }

  // The model with the chosen values; those chosen earlier count for more than all later ones.
  chosen() {
    const wanted = this.selects.map(({ input }) => input.selectedOptions[0].text);
    const scores = this.facets[0].values.map((_, model) =>
      this.facets.reduce((score, { values }, i) => 2 * score + Number(values[model] === wanted[i]), 0),
    );
    return scores.indexOf(Math.max(...scores));
  }

  show(/** @type {number} */ model) {
    let together = this.facets[0].values.map((_, i) => i);
    this.facets.forEach(({ values }, i) => {
      const { input } = this.selects[i];
      const options = [...new Set(together.map((other) => values[other]))];
      offer(input, options);
      input.selectedIndex = options.indexOf(values[model]);
      input.disabled = options.length === 1;
      together = together.filter((other) => values[other] === values[model]);
    });
  }
}

// Where a way to and fro between -REACH and REACH leads from z.
export function sweep(/** @type {number} */ z, /** @type {number} */ way) {
  const round = (clamp(z) + REACH + way) % (4 * REACH);
  return round < 2 * REACH ? round - REACH : 3 * REACH - round;
}

function saveAs(/** @type {string} */ name, /** @type {string} */ text) {
  const address = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}

class LatentExplorerView {
  constructor(/** @type {Model} */ model, /** @type {HTMLElement} */ root) {
    this.model = model;
    /** @type {{ facets: Facet[], models: import("./decode.js").Packed[], curves: any, stride: number }} */
    this.choices = model.get("_choices");
    this.curves = unpackCurves(this.choices.curves);
    this.plot = new Plot();
    this.network = new NetworkSketch();
    this.photo = new SplitPhoto(renderScene(), PHOTO_NOTE);
    this.most = [1]; // how active each hidden layer gets
    /** @type {ReturnType<typeof labelledSlider>[]} */
    this.sliders = [];
    /** @type {DensityPlot[]} */
    this.densities = [];
    this.touched = 0; // which latent the animation moves
    this.from = 0; // and from where
    /** @type {unknown} the latent that the page itself has set last */
    this.expected = null;
    this.afterwards = new Afterwards();
    this.animation = new Animation(PACE, (way) => this.slide(this.touched, sweep(this.from, way)));
    this.chooser = new Chooser(this.choices.facets, (index) => this.choose(this.choices.models[index]));
    this.sliderBox = element("div", { class: "crf-sliders", role: "group", "aria-label": "latent" });
    this.note = element("p", { class: "crf-note" });
    this.animate = button("Animate", () => this.toggle(), { class: "crf-main crf-toggle" });
    this.readouts = readouts(["gamma-equivalent", "RMSE to that gamma", ...this.nearestNames()]);
    this.status = element("div", { class: "crf-status", role: "status" });
    this.root = element("div", { class: "crf" }, this.chooser.box, this.buildBody());
    root.append(this.root);
    this.leaveTheme = followTheme(this.root, () => this.sketches().forEach((sketch) => sketch.schedule()));
    this.leaveModel = listen(model, { model: () => this.update(), latent: () => this.update() });
    this.current = this.change(model.get("model"));
    /** @type {Float64Array} */
    this.curve = new Float64Array();
    this.update();
  }

  destroy() {
    this.leaveModel();
    this.leaveTheme();
    this.animation.stop();
    this.afterwards.stop();
    this.photo.destroy();
    for (const sketch of this.sketches()) sketch.destroy();
  }

  sketches() {
    return [this.plot, this.network, ...this.densities];
  }

  buildBody() {
    const reset = button("Reset", () => this.put(this.latent.map(() => 0)), { title: "z = 0" });
    const save = button("Save CSV", () => this.save(), { title: "the curve as irradiance and brightness" });
    const buttons = element("div", { class: "crf-buttons" }, this.animate, reset, save);
    const network = element("figure", {}, this.network.canvas, element("figcaption", { class: "crf-note" }, NETWORK_NOTE));
    const panel = element("div", { class: "crf-panel" }, this.sliderBox, this.note, buttons);
    panel.append(this.readouts.box, network, this.status);
    const left = element("div", { class: "crf-plot" }, this.plot.box, this.photo.box);
    return element("div", { class: "crf-body" }, left, panel);
  }

  nearestNames() {
    return this.choices.curves ? ["RMSE to nearest curve", "nearest curve"] : []; // last, since names may wrap
  }

  /** @returns {number[]} one latent is a plain number, which sliders of other widgets can be linked to */
  get latent() {
    return [this.model.get("latent")].flat();
  }

  /**
   * @param {number[]} latent
   * @param {string} [model]
   */
  put(latent, model = this.current.name) {
    this.expected = latent.length === 1 ? latent[0] : latent;
    move(this.model, { model, latent: this.expected });
  }

  choose(/** @type {import("./decode.js").Packed} */ { name, labels }) {
    this.stop();
    this.put(labels.length === this.latent.length ? this.latent : labels.map(() => 0), name);
  }

  slide(/** @type {number} */ index, /** @type {number} */ z) {
    this.touched = index;
    this.put(this.latent.with(index, z));
  }

  toggle() {
    if (this.animation.running) return this.stop();
    this.from = this.latent[this.touched];
    this.animation.start();
    this.animate.textContent = "Pause";
  }

  stop() {
    this.animation.stop();
    this.animate.textContent = "Animate";
  }

  update() {
    const name = this.model.get("model");
    if (name !== this.current.name) this.current = this.change(name);
    const { latent } = this;
    if (latent.length !== this.current.labels.length) return; // of the model before; the new one's is on its way
    if (this.model.get("latent") !== this.expected) this.stop();
    this.curve = decode(this.current, latent);
    latent.forEach((z, i) => {
      this.sliders[i].show(z, formatLatent(z));
      this.densities[i].mark(z);
    });
    this.tell(latent);
  }

  change(/** @type {string} */ name) {
    const index = this.choices.models.findIndex((entry) => entry.name === name);
    const current = unpackModel(this.choices.models[index]);
    this.touched = 0;
    this.status.textContent = "";
    this.chooser.show(index);
    this.rebuildSliders(current.labels, current.latents);
    const ends = [-REACH, 0, REACH].map((z) => hiddenLayers(current.layers, current.labels.map(() => z)));
    this.most = ends[0].map((_, layer) => Math.max(1e-9, ...ends.flatMap((hidden) => [...hidden[layer]])));
    return current;
  }

  /**
   * @param {string[]} labels
   * @param {Float32Array} latents of all training curves, those of a curve together
   */
  rebuildSliders(labels, latents) {
    const k = labels.length;
    for (const density of this.densities) density.destroy();
    this.densities = labels.map((label, i) => new DensityPlot(label, latents.filter((_, at) => at % k === i)));
    const range = { min: -REACH, max: REACH, step: SLIDER_STEP };
    this.sliders = labels.map((label, i) => labelledSlider(label, range, (z) => (this.stop(), this.slide(i, z))));
    const boxes = labels.map((_, i) => element("div", {}, this.sliders[i].box, this.densities[i].box));
    this.sliderBox.replaceChildren(...boxes);
    const outside = latents.filter((z) => Math.abs(z) > REACH).length;
    this.note.textContent =
      "Filled, with a tick for each: the training curves. Dashed: N(0,\u00a01)." +
      (outside ? ` ${outside} of ${latents.length} ticks lie beyond the slider.` : "");
  }

  // The figure and the read-outs of the curve that was just decoded.
  tell(/** @type {number[]} */ latent) {
    const thinned = this.curve.filter((_, i) => i % this.choices.stride === 0);
    const power = nearestPower(thinned);
    const texts = [`γ = ${power.gamma.toPrecision(3)}`, power.rmse.toPrecision(3)];
    const curves = this.curves[this.current.direction];
    const nearest = curves ? nearestCurve(curves, thinned) : null;
    if (nearest) texts.push(nearest.rmse.toPrecision(3), nearest.name);
    this.readouts.show(texts);
    const { direction, xLabel, yLabel } = this.current;
    const name = direction === "forward" ? "response f" : "inverse response g";
    /** @type {import("./plot.js").Mark[]} */
    const marks = [
      { type: "line", y: this.curve, label: name, colour: "blue" },
      { type: "line", x: this.curve, label: "its inverse, axes swapped", colour: "green", dash: "dotted", width: 1.5 },
    ];
    if (nearest) {
      const { samples } = nearest;
      marks.push({ type: "line", y: samples, label: "nearest curve", colour: "vermilion", dash: "dashed", width: 1.5 });
    }
    const [x, y] = [xLabel, yLabel].map((label) => ({ label, min: 0, max: 1 }));
    this.plot.draw({ x, y, marks, description: this.describe(latent, texts) });
    this.afterwards.run(() => {
      this.drawNetwork(latent, nearest);
      this.drawPhoto();
    });
  }

  drawPhoto() {
    const { levels } = this.photo.picture;
    const bent = tableOf(levels, this.curve, this.current.direction !== "forward");
    this.photo.show({ name: "the light", tables: [unchanged(levels)] }, { name: "through this response", tables: [bent] });
    this.photo.refresh();
  }

  /** @type {(latent: number[], nearest: ReturnType<typeof nearestCurve> | null) => void} */
  drawNetwork(latent, nearest) {
    const { layers, sizes } = this.current;
    const hidden = hiddenLayers(layers, latent).map((values, i) => {
      return values.map((value) => Math.sqrt(Math.max(0, value) / this.most[i])); // so that weak ones are seen, too
    });
    const wide = sizes.with(-1, this.curve.length); // a monotone decoder has steps, one fewer than samples
    this.network.draw({
      sizes: wide,
      active: [...hidden, this.curve],
      latent,
      input: nearest && nearest.samples,
      output: this.curve,
      description: `The network: ${[...wide.slice(1).reverse(), ...wide].join(", ")} neurons; the waist has the latent`,
    });
    this.network.refresh();
  }

  describe(/** @type {number[]} */ latent, /** @type {string[]} */ [gamma, , , nearest]) {
    const at = [0.25, 0.5, 0.75].map((x) => this.curve[Math.round(x * (this.curve.length - 1))].toFixed(3));
    const near = nearest ? `, nearest to ${nearest}` : "";
    return (
      `Curve of ${this.current.name} at ${latent.map(formatLatent).join(", ")}: ` +
      `${at[0]} at a quarter, ${at[1]} at a half, ${at[2]} at three quarters; ${gamma}${near}`
    );
  }

  save() {
    const { name, direction } = this.current;
    const rows = Array.from(this.curve, (value, i) => {
      const pair = [i / (this.curve.length - 1), value].map((number) => Number(number.toPrecision(9)));
      return (direction === "forward" ? pair : pair.reverse()).join();
    });
    saveAs(`${name}.csv`, ["irradiance,brightness", ...rows, ""].join("\n"));
    this.status.textContent = `Saved ${name}.csv`;
  }
}

function render(/** @type {{ model: Model, el: HTMLElement }} */ { model, el }) {
  const view = new LatentExplorerView(model, el);
  return () => view.destroy();
}

export default { render };
