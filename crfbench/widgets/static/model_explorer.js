// The page's side of ModelExplorer: it asks, Python decodes, it draws. No model's formula is written here.

const SLIDER_STEP = 0.02; // in standard deviations of the parameter
const HEADROOM = 0.1; // how much of what leaves [0, 1] is seen

function verdict({ falls, inRange }) {
  const rises = falls === 0 ? "yes" : `falls at ${falls} sample${falls === 1 ? "" : "s"}`;
  return { rises, stays: inRange ? "yes" : "no" };
}

class ModelExplorerView {
  constructor(model, root) {
    this.model = model;
    this.choices = model.get("_choices");
    this.plot = new CurvePlot();
    this.sliders = [];
    this.sliderBox = element("div", { class: "crf-sliders", role: "group", "aria-label": "model parameters" });
    this.readouts = readouts(["RMSE", "MSE", "monotone", "in [0, 1]"]);
    this.status = element("div", { class: "crf-status", role: "status" });
    this.root = element("div", { class: "crf", "aria-busy": false }, this.buildChoices(), this.buildBody());
    root.append(this.root);
    this.wishes = new Wishes(model, busySign(this.root, this.status));
    this.leaveTheme = followTheme(this.root, () => this.plot.schedule());
    this.update = this.update.bind(this);
    model.on("change:_scene", this.update);
    this.update();
  }

  destroy() {
    this.model.off("change:_scene", this.update);
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
