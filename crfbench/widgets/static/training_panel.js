// The page's side of TrainingPanel: it asks Python to train, and shows how far the training has got.

function labelledNumber(label, { value, min, max }) {
  const input = element("input", { id: newId(), type: "number", value, min, max, step: 1, ...KEEP_KEYS });
  return { box: element("div", { class: "crf-field" }, element("label", { for: input.id }, label), input), input };
}

class TrainingPanelView {
  constructor(model, root) {
    this.model = model;
    this.choices = model.get("_choices");
    this.root = element("div", { class: "crf crf-training" }, this.buildChoices(), this.buildBody());
    root.append(this.root);
    this.leaveTheme = followTheme(this.root, () => this.column.repaint());
    this.update = this.update.bind(this);
    model.on("change:_shown", this.update);
    this.update();
  }

  destroy() {
    this.model.off("change:_shown", this.update);
    this.leaveTheme();
    this.column.destroy();
  }

  buildChoices() {
    const { constraints, directions, epochs, mostEpochs, mostSeed } = this.choices;
    this.constraint = labelledSelect("Constraint", constraints, () => {});
    this.direction = labelledSelect("Direction", directions, () => {});
    this.seed = labelledNumber("Seed", { value: 0, min: 0, max: mostSeed });
    this.epochs = labelledNumber("Epochs", { value: epochs, min: 1, max: mostEpochs });
    this.start = button("Start", () => this.ask(), { class: "crf-main" });
    this.stop = button("Stop", () => this.model.send({ kind: "stop" }), { title: "keep what was trained so far" });
    this.fields = [this.constraint, this.direction, this.seed, this.epochs];
    const buttons = element("div", { class: "crf-buttons" }, this.start, this.stop);
    return element("div", { class: "crf-choices" }, ...this.fields.map(({ box }) => box), buttons);
  }

  buildBody() {
    this.column = new LatentColumn();
    this.progress = element("progress", { max: 1, value: 0, "aria-label": "training progress" });
    this.readouts = readouts(["epoch", "loss", "reconstruction MSE", "time left"]);
    this.status = element("div", { class: "crf-status", role: "status" });
    const panel = element("div", { class: "crf-panel" }, this.status, this.progress, this.readouts.box);
    panel.append(element("p", { class: "crf-note" }, NOTE));
    return element("div", { class: "crf-body" }, panel, this.column.box);
  }

  ask() {
    const [constraint, direction] = [this.constraint, this.direction].map(({ input }) => input.selectedOptions[0].text);
    const [seed, epochs] = [this.seed, this.epochs].map(({ input }) => input.valueAsNumber);
    this.model.send({ kind: "start", constraint, direction, seed, epochs });
  }

  update() {
    const { training, message, epoch, epochs, loss, mse, left, live } = this.model.get("_shown");
    this.allow(training);
    if (this.status.textContent !== message) this.status.textContent = message; // said aloud at each change
    this.progress.value = epochs ? epoch / epochs : 0;
    this.readouts.show(epochs ? [`${epoch} of ${epochs}`, loss, mse, left] : ["–", "–", "–", "–"]);
    this.column.box.style.display = live ? "" : "none";
    if (live) this.column.show(new Run(live), epoch);
  }

  // The focus does not get lost on a button that can no longer be pressed.
  allow(training) {
    const held = this.root.contains(document.activeElement) && document.activeElement.tagName === "BUTTON";
    this.root.setAttribute("aria-busy", training);
    for (const { input } of [...this.fields, { input: this.start }]) input.disabled = training;
    this.stop.disabled = !training;
    if (held && document.activeElement !== (training ? this.stop : this.start)) (training ? this.stop : this.start).focus();
  }
}

function render({ model, el }) {
  const view = new TrainingPanelView(model, el);
  return () => view.destroy();
}

export default { render };
