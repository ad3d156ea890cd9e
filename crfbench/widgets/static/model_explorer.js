// The page's side of ModelExplorer: it asks, Python decodes, it draws. No model's formula is written here.

const SLIDER_STEP = 0.02; // in standard deviations of the parameter
const SLOW = 400; // ms without an answer after which the page says so
const HEADROOM = 0.1; // how much of what leaves [0, 1] is seen

// Speaks to Python one wish at a time. While an answer is awaited only the newest wish of each kind is kept, so a
// drag never queues up: the next message carries the value that the hand has reached by then.
class Wishes {
  constructor(model, onBusy) {
    this.model = model;
    this.onBusy = onBusy; // told true when an answer is awaited, false when nothing is under way any more
    this.name = newId(); // two views of one widget must not take each other's answers for their own
    this.count = 0;
    this.awaited = null;
    this.waiting = new Map();
  }

  get idle() {
    return this.awaited === null;
  }

  send(kind, value = null) {
    this.waiting.delete(kind); // so that the newest comes last
    this.waiting.set(kind, value);
    if (this.idle) this.sendNext();
  }

  sendNext() {
    const next = this.waiting.entries().next();
    this.onBusy(!next.done);
    if (next.done) return;
    const [kind, value] = next.value;
    this.waiting.delete(kind);
    this.awaited = `${this.name}:${++this.count}`;
    this.model.send({ request: this.awaited, kind, value });
  }

  answered(request) {
    if (request !== this.awaited) return;
    this.awaited = null;
    this.sendNext();
  }
}

// Four digits, but no more than five decimals, so that what rounding leaves of a zero is shown as one.
function formatParam(value) {
  const rounded = Math.abs(value) < 1e-3 ? value.toFixed(5) : value.toPrecision(4);
  return Number(rounded) === 0 ? "0" : rounded.replace("-", "−");
}

function formatError(value) {
  if (value === 0) return "0";
  return value < 1e-3 || value >= 1e3 ? value.toExponential(3) : value.toPrecision(4);
}

function verdict({ falls, inRange }) {
  const rises = falls === 0 ? "yes" : `falls at ${falls} sample${falls === 1 ? "" : "s"}`;
  return { rises, stays: inRange ? "yes" : "no" };
}

class ModelExplorerView {
  constructor(model, root) {
    this.model = model;
    this.choices = model.get("_choices");
    this.wishes = new Wishes(model, (busy) => this.showBusy(busy));
    this.plot = new CurvePlot();
    this.sliders = [];
    this.sliderBox = element("div", { class: "crf-sliders", role: "group", "aria-label": "model parameters" });
    this.readouts = readouts(["RMSE", "MSE", "monotone", "in [0, 1]"]);
    this.status = element("div", { class: "crf-status", role: "status" });
    this.root = element("div", { class: "crf", "aria-busy": false }, this.buildChoices(), this.buildBody());
    root.append(this.root);
    this.leaveTheme = followTheme(this.root, () => this.plot.schedule());
    this.update = this.update.bind(this);
    model.on("change:_scene", this.update);
    this.update();
  }

  destroy() {
    this.model.off("change:_scene", this.update);
    clearTimeout(this.timer);
    this.leaveTheme();
    this.plot.destroy();
  }

  buildChoices() {
    const { names, models } = this.choices;
    this.curve = labelledSelect("Curve", names, (index) => this.wishes.send("index", index));
    this.curve.box.classList.add("crf-grow");
    this.family = labelledSelect("Model", models, (i) => this.wishes.send("model_name", models[i]));
    const turn = element("div", { class: "crf-turn" });
    turn.append(button("◀", () => this.turn(-1), { "aria-label": "previous curve", title: "previous curve" }));
    turn.append(button("▶", () => this.turn(1), { "aria-label": "next curve", title: "next curve" }));
    return element("div", { class: "crf-choices" }, this.curve.box, turn, this.family.box);
  }

  buildBody() {
    this.valid = labelledCheckbox("show nearest valid curve", (on) => this.wishes.send("show_valid", on));
    const fit = button("Fit", () => this.wishes.send("fit"), { class: "crf-main", title: "least MSE to this curve" });
    const reset = button("Reset", () => this.wishes.send("reset"), { title: "mean parameters" });
    const buttons = element("div", { class: "crf-buttons" }, fit, reset);
    const panel = element("div", { class: "crf-panel" }, this.sliderBox, buttons, this.valid.box);
    panel.append(this.readouts.box, this.status);
    return element("div", { class: "crf-body" }, element("div", { class: "crf-plot" }, this.plot.canvas), panel);
  }

  showBusy(busy) {
    this.root.setAttribute("aria-busy", busy);
    clearTimeout(this.timer);
    if (busy) this.timer = setTimeout(() => (this.status.textContent = "waiting for Python …"), SLOW);
  }

  turn(step) {
    const { input } = this.curve;
    const n = input.options.length;
    input.selectedIndex = (input.selectedIndex + step + n) % n;
    this.wishes.send("index", input.selectedIndex);
  }

  update() {
    const scene = this.model.get("_scene");
    this.wishes.answered(scene.answered);
    if (scene.model !== this.drawnModel) this.rebuildSliders(scene);
    if (this.wishes.idle) this.followControls(scene);
    scene.sliders.forEach(({ param }, i) => this.sliders[i].show(null, formatParam(param)));
    const { rises, stays } = verdict(scene);
    this.readouts.show([formatError(scene.rmse), formatError(scene.mse), rises, stays]);
    this.status.textContent = scene.message;
    this.plot.draw(this.figure(scene));
  }

  rebuildSliders(scene) {
    this.drawnModel = scene.model;
    this.positions = scene.sliders.map(({ position }) => position);
    this.sliders = scene.sliders.map(({ name, min, max }, i) =>
      labelledSlider(name, { min, max, step: SLIDER_STEP }, (position) => this.slide(i, position)),
    );
    this.sliderBox.replaceChildren(...this.sliders.map(({ box }) => box));
  }

  // Positions are kept apart from the thumbs, which stop at the ends of their range and at whole steps.
  slide(i, position) {
    this.positions[i] = position;
    this.wishes.send("positions", [...this.positions]);
  }

  // Only when nothing is under way, so that an old answer never pulls a control from under the hand.
  followControls(scene) {
    this.curve.input.selectedIndex = scene.index;
    this.family.input.selectedIndex = this.choices.models.indexOf(scene.model);
    this.valid.input.checked = scene.valid !== null;
    this.positions = scene.sliders.map(({ position }) => position);
    scene.sliders.forEach(({ position, param }, i) => this.sliders[i].show(position, formatParam(param)));
  }

  figure(scene) {
    const { names, xLabel, yLabel } = this.choices;
    const series = [
      { label: names[scene.index], samples: float32(scene.target), colour: "blue", dash: "solid" },
      { label: scene.model, samples: float32(scene.decoded), colour: "vermilion", dash: "dashed" },
    ];
    if (scene.valid !== null) {
      series.push({ label: "nearest valid", samples: float32(scene.valid), colour: "green", dash: "dotted" });
    }
    return {
      x: { label: xLabel, min: 0, max: 1 },
      y: { label: yLabel, min: -HEADROOM, max: 1 + HEADROOM },
      series,
      description: this.describe(scene),
    };
  }

  describe(scene) {
    const { rises, stays } = verdict(scene);
    const errors = `RMSE ${formatError(scene.rmse)}, monotone: ${rises}, in [0, 1]: ${stays}`;
    return `Curve ${this.choices.names[scene.index]} and model ${scene.model}: ${errors}`;
  }
}

function render({ model, el }) {
  const view = new ModelExplorerView(model, el);
  return () => view.destroy();
}

export default { render };
