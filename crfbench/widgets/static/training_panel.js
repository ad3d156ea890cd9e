// The page's side of TrainingPanel: it asks Python to train, and shows how far the training has got.

import { button, element, followTheme, KEEP_KEYS, labelledSelect, listen, newId, readouts } from "./controls.js";
import { LatentColumn, NOTE, Run } from "./latent_column.js";

/** @typedef {import("./controls.js").Model} Model */

/**
 * @param {string} label
 * @param {{ min: number, max: number }} range
 */
function labelledNumber(label, { min, max }) {
  const input = element("input", { id: newId(), type: "number", min, max, step: 1, ...KEEP_KEYS });
  return { box: element("div", { class: "crf-field" }, element("label", { for: input.id }, label), input), input };
}

class TrainingPanelView {
  constructor(/** @type {Model} */ model, /** @type {HTMLElement} */ root) {
    this.model = model;
    const { constraints, directions, mostEpochs, mostSeed } = model.get("_choices");
    this.constraint = labelledSelect("Constraint", constraints, () => {});
    this.direction = labelledSelect("Direction", directions, () => {});
    this.seed = labelledNumber("Seed", { min: 0, max: mostSeed });
    this.epochs = labelledNumber("Epochs", { min: 1, max: mostEpochs });
    this.start = button("Start", () => this.ask(), { class: "crf-main" });
    this.stop = button("Stop", () => model.send({ kind: "stop" }), { title: "keep what was trained so far" });
    this.fields = [this.constraint, this.direction, this.seed, this.epochs];
    this.column = new LatentColumn();
    this.progress = element("progress", { max: 1, value: 0, "aria-label": "training progress" });
    this.readouts = readouts(["epoch", "loss", "reconstruction MSE", "time"]);
    this.status = element("div", { class: "crf-status", role: "status" });
    this.root = element("div", { class: "crf crf-training" }, this.buildChoices(), this.buildBody());
    root.append(this.root);
    this.leaveTheme = followTheme(this.root, () => this.column.repaint());
    const update = () => this.update();
    this.leaveModel = listen(model, { running: update, status: update, _progress: update, _asked: () => this.fill() });
    this.fill();
    this.update();
  }

  destroy() {
    this.leaveModel();
    this.leaveTheme();
    this.column.destroy();
  }

  buildChoices() {
    const buttons = element("div", { class: "crf-buttons" }, this.start, this.stop);
    return element("div", { class: "crf-choices" }, ...this.fields.map(({ box }) => box), buttons);
  }

  buildBody() {
    const panel = element("div", { class: "crf-panel" }, this.status, this.progress, this.readouts.box);
    panel.append(element("p", { class: "crf-note" }, NOTE));
    return element("div", { class: "crf-body" }, panel, this.column.box);
  }

  ask() {
    const [constraint, direction] = [this.constraint, this.direction].map(({ input }) => input.selectedOptions[0].text);
    const [seed, epochs] = [this.seed, this.epochs].map(({ input }) => input.valueAsNumber);
    this.model.send({ kind: "start", constraint, direction, seed, epochs });
  }

  fill() {
    const { constraint, direction, seed, epochs } = this.model.get("_asked");
    const { constraints, directions } = this.model.get("_choices");
    this.constraint.input.selectedIndex = constraints.indexOf(constraint);
    this.direction.input.selectedIndex = directions.indexOf(direction);
    [this.seed.input.valueAsNumber, this.epochs.input.valueAsNumber] = [seed, epochs];
  }

  update() {
    const { epoch, epochs, loss, mse, left, live } = this.model.get("_progress");
    this.allow(this.model.get("running"));
    const status = this.model.get("status");
    if (this.status.textContent !== status) this.status.textContent = status; // said aloud at each change
    this.progress.value = epochs ? epoch / epochs : 0;
    this.readouts.show(epochs ? [`${epoch} of ${epochs}`, loss, mse, left] : ["–", "–", "–", "–"]);
    this.column.box.style.display = live ? "" : "none";
    if (live) this.column.show(new Run(live), epoch);
  }

  // The focus does not get lost on a button that can no longer be pressed.
  allow(/** @type {boolean} */ running) {
    const { activeElement } = document;
    const held = activeElement?.tagName === "BUTTON" && this.root.contains(activeElement);
    this.root.setAttribute("aria-busy", String(running));
    for (const { input } of this.fields) input.disabled = running;
    this.start.disabled = running;
    this.stop.disabled = !running;
    if (held) (running ? this.stop : this.start).focus();
  }
}

function render(/** @type {{ model: Model, el: HTMLElement }} */ { model, el }) {
  const view = new TrainingPanelView(model, el);
  return () => view.destroy();
}

export default { render };
