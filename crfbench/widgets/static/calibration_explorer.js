// The page's side of CalibrationExplorer: a chart of patches to press, Python's curve and bands, and the truth.

const COLUMNS = 6; // patches in a row of the chart
const FAINT = 0.3; // opacity of a curve that the present choice no longer gives

// The first half of the numbers are x, the second y.
function points(view) {
  const numbers = float32(view);
  const n = numbers.length / 2;
  return Array.from({ length: n }, (_, i) => [numbers[i], numbers[n + i]]);
}

function halves(view) {
  const numbers = float32(view);
  return [numbers.subarray(0, numbers.length / 2), numbers.subarray(numbers.length / 2)];
}

// Figures as CurvePlot's, whose series may also be dots { points, radius } and bands { low, high, alpha }, any of them
// faint; a line with a `range` is dashed beyond it.
class CalibrationPlot extends CurvePlot {
  paintCurve(context, curve) {
    this.dress(context, curve);
    if (curve.points) for (const [x, y] of curve.points) this.dot(context, this.toX(x), this.toY(y), curve);
    else if (curve.low) this.paintBand(context, curve);
    else this.paintLine(context, curve);
    context.globalAlpha = 1;
  }

  // Ink where no colour is given.
  dress(context, { colour, faint, alpha = 1 }) {
    context.fillStyle = colour ? COLOURS[colour][Number(this.dark)] : this.ink;
    context.globalAlpha = alpha * (faint ? FAINT : 1);
  }

  // Dots of a colour have a rim of ink, which tells them from the others without it.
  dot(context, x, y, { radius, colour }) {
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fill();
    if (!colour) return;
    context.strokeStyle = this.ink;
    context.lineWidth = 1;
    context.setLineDash([]);
    context.stroke();
  }

  // Browsers drop paths that run off to enormous coordinates.
  spot(samples, i) {
    const y = this.toY(samples[i]);
    return [this.toX(i / (samples.length - 1)), Math.min(2 * this.bottom, Math.max(-this.bottom, y))];
  }

  paintBand(context, { low, high }) {
    context.beginPath();
    low.forEach((_, i) => context.lineTo(...this.spot(low, i)));
    for (let i = high.length - 1; i >= 0; i--) context.lineTo(...this.spot(high, i));
    context.fill();
  }

  paintLine(context, { samples, range, colour }) {
    const last = samples.length - 1;
    const ends = [0, Math.floor(range[0] * last), Math.ceil(range[1] * last), last];
    ["dashed", "solid", "dashed"].forEach((dash, part) => {
      this.setLine(context, { colour, dash });
      context.beginPath();
      for (let i = ends[part]; i <= ends[part + 1]; i++) context.lineTo(...this.spot(samples, i));
      context.stroke();
    });
    context.setLineDash([]);
  }

  paintLegend(context, { curve, label, x, row }) {
    const [start, y] = [this.left + x, row * ROW + ROW / 2];
    this.dress(context, curve);
    if (curve.points) this.dot(context, start + LEGEND_LINE / 2, y, curve);
    else if (curve.low) context.fillRect(start, y - 6, LEGEND_LINE, 12);
    else {
      this.setLine(context, { colour: curve.colour, dash: "solid" });
      context.beginPath();
      context.moveTo(start, y);
      context.lineTo(start + LEGEND_LINE, y);
      context.stroke();
    }
    context.globalAlpha = 1;
    context.fillStyle = this.ink;
    context.textAlign = "left";
    context.fillText(label, start + LEGEND_LINE + 6, y);
  }
}

// Densities over one parameter, and a line at the best value.
class BeliefPlot extends CurvePlot {
  constructor() {
    super();
    this.canvas.className = "crf-belief";
  }

  paintCurves(context) {
    super.paintCurves(context);
    const { best } = this.figure;
    const x = Math.min(this.right, Math.max(this.left, this.toX(best)));
    this.setLine(context, { colour: "green", dash: "solid" });
    context.beginPath();
    context.moveTo(x, this.top);
    context.lineTo(x, this.bottom);
    context.stroke();
    context.globalAlpha = 1;
  }
}

// Buttons in rows; one is in the tab order and the arrow keys go to the others.
class Chart {
  constructor(reference, onToggle) {
    this.buttons = reference.map((value, i) => this.patch(i, value, onToggle));
    this.grid = element("div", { class: "crf-chart", role: "group", "aria-label": "colour chart" }, ...this.buttons);
    this.grid.addEventListener("keydown", (event) => this.move(event));
    const hint = element("p", { class: "crf-note", id: newId() }, "Click patches, or go with the arrow keys and press Space.");
    this.grid.setAttribute("aria-describedby", hint.id);
    this.box = element("div", {}, element("div", { class: "crf-caption" }, "Patches to calibrate with"), this.grid, hint);
    this.enter(0);
  }

  patch(i, value, onToggle) {
    const name = `patch ${i + 1}, irradiance ${value}`;
    const node = button("", () => (this.enter(i), onToggle(i + 1)), { "aria-label": name, title: name });
    node.append(element("span", { "aria-hidden": "true" }, i + 1));
    return node;
  }

  enter(i) {
    this.buttons.forEach((node, k) => (node.tabIndex = k === i ? 0 : -1));
  }

  move(event) {
    const steps = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -COLUMNS, ArrowDown: COLUMNS };
    const to = this.buttons.indexOf(event.target) + steps[event.key];
    if (Number.isNaN(to)) return;
    event.preventDefault();
    if (!this.buttons[to]) return;
    this.enter(to);
    this.buttons[to].focus();
  }

  press(patches) {
    this.buttons.forEach((node, i) => node.setAttribute("aria-pressed", patches.includes(i + 1)));
  }

  paint(bytes) {
    if (String(bytes) === this.painted) return;
    this.painted = String(bytes);
    this.buttons.forEach((node, i) => {
      const [r, g, b] = bytes.subarray(3 * i, 3 * i + 3);
      node.style.setProperty("--crf-patch", `rgb(${r}, ${g}, ${b})`);
      node.style.color = 0.2126 * r + 0.7152 * g + 0.0722 * b > 110 ? "#000" : "#fff";
    });
  }
}

class CalibrationExplorerView {
  constructor(model, root) {
    this.model = model;
    this.choices = model.get("_choices");
    this.plot = new CalibrationPlot();
    this.belief = new BeliefPlot();
    this.chart = new Chart(this.choices.reference, (patch) => this.toggle(patch));
    this.figures = element("div");
    this.warnings = element("ul", { class: "crf-warnings", "aria-label": "warnings" });
    this.status = element("div", { class: "crf-status", role: "status" });
    const parts = [this.buildChoices(), this.buildBody()];
    this.root = element("div", { class: "crf crf-calibration", "aria-busy": false }, ...parts);
    root.append(this.root);
    this.wishes = new Wishes(model, busySign(this.root, this.status));
    this.leaveTheme = followTheme(this.root, () => [this.plot, this.belief].forEach((plot) => plot.schedule()));
    this.update = this.update.bind(this);
    model.on("change:_scene", this.update);
    this.update();
  }

  destroy() {
    this.model.off("change:_scene", this.update);
    this.leaveTheme();
    for (const plot of [this.plot, this.belief]) plot.destroy();
  }

  buildChoices() {
    const { cameras, illuminations, models } = this.choices;
    const seen = illuminations.map((i) => `illumination ${i}`);
    const names = models.map(({ name }) => name);
    this.camera = labelledSelect("Camera", cameras, (i) => this.wishes.send("camera", cameras[i]));
    this.light = labelledSelect("Calibrate on", seen, (i) => this.wishes.send("illumination", illuminations[i]));
    this.family = labelledSelect("Model", names, (i) => this.wishes.send("model", names[i]));
    this.method = labelledSelect("Method", [], (i) => this.wishes.send("method", this.methods[i]));
    const boxes = [this.camera, this.light, this.family, this.method].map(({ box }) => box);
    return element("div", { class: "crf-choices" }, ...boxes);
  }

  buildBody() {
    const shortcuts = this.choices.shortcuts.map(({ label, patches }) => button(label, () => this.choose([...patches])));
    const row = element("div", { class: "crf-buttons", role: "group", "aria-label": "sets of patches" }, ...shortcuts);
    const hint = "Dashed: beyond the brightness measured, where model and prior speak alone.";
    const left = element("div", { class: "crf-plot" }, this.plot.canvas, element("p", { class: "crf-note" }, hint));
    left.append(this.status, this.warnings);
    const panel = element("div", { class: "crf-panel" }, this.chart.box, row, this.belief.canvas, this.figures);
    return element("div", { class: "crf-body" }, left, panel);
  }

  // The chart answers the hand at once; Python's answer follows.
  choose(patches) {
    this.patches = patches;
    this.chart.press(patches);
    this.wishes.send("patches", patches);
  }

  toggle(patch) {
    const others = this.patches.filter((other) => other !== patch);
    this.choose(others.length < this.patches.length ? others : [...others, patch]);
  }

  update() {
    const scene = this.model.get("_scene");
    this.wishes.answered(scene.answered);
    if (this.wishes.idle) this.followControls(scene);
    this.chart.paint(new Uint8Array(bytesOf(scene.colours)));
    this.showFigures(scene);
    this.plot.draw(this.figure(scene));
    this.drawBelief(scene.shown.belief);
  }

  // Only when nothing is under way, so that an old answer never pulls a control from under the hand.
  followControls(scene) {
    const { cameras, illuminations, models, methods } = this.choices;
    const at = models.findIndex(({ name }) => name === scene.model);
    this.camera.input.selectedIndex = cameras.indexOf(scene.camera);
    this.light.input.selectedIndex = illuminations.indexOf(scene.illumination);
    this.family.input.selectedIndex = at;
    if (String(this.methods) !== String(models[at].methods)) {
      this.methods = models[at].methods;
      offer(this.method.input, this.methods.map((name) => methods[name]));
    }
    this.method.input.selectedIndex = this.methods.indexOf(scene.method);
    this.patches = [...scene.patches];
    this.chart.press(this.patches);
  }

  showFigures({ shown, error, patches }) {
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
    this.status.textContent = error || `${patches.length} patches: held-out RMSE ${formatError(shown.rmse)}`;
    this.warnings.replaceChildren(...(error ? [] : shown.warnings).map((text) => element("li", {}, text)));
  }

  figure(scene) {
    const { shown } = scene;
    const other = this.choices.illuminations.find((i) => i !== scene.illumination);
    const faint = scene.error !== "";
    const bands = Object.entries(shown.bands).map(([level, view]) => [Number(level), halves(view)]);
    bands.sort(([a], [b]) => b - a);
    const series = [
      ...bands.map(([level, [low, high]], i) => {
        return { label: `${100 * level} % band`, low, high, alpha: 0.16 + 0.14 * i, colour: "blue", faint };
      }),
      { label: `truth: RAW, illumination ${other}`, points: points(scene.truth), radius: 2.5, alpha: 0.5 },
      { label: shown.label, samples: float32(shown.curve), range: shown.range, colour: "blue", faint },
      { label: "patches used, aligned", points: points(shown.dots), radius: 3.5, colour: "vermilion", faint },
    ];
    return {
      x: { label: "brightness of the JPEG (0 to 1)", min: 0, max: 1 },
      y: { label: "irradiance (RAW, 0 to 1)", min: -0.05, max: 1.1 },
      series,
      description: this.describe(scene),
    };
  }

  describe({ camera, shown, error }) {
    const stale = error ? " The last curve is kept, faded." : "";
    return `Inverse response of ${camera} by ${shown.label}: held-out RMSE ${formatError(shown.rmse)}.${stale}`;
  }

  drawBelief(belief) {
    this.belief.canvas.hidden = belief === null;
    if (belief === null) return;
    const [prior, posterior] = belief.densities.map(float32);
    const series = [{ label: "prior", samples: prior, colour: "vermilion", dash: "dashed" }];
    if (posterior) series.push({ label: "posterior", samples: posterior, colour: "blue", dash: "solid" });
    series.push({ label: "best", samples: [], colour: "green", dash: "solid" });
    const [min, max] = belief.ends;
    const top = 1.08 * Math.max(...series.flatMap(({ samples }) => [...samples]));
    const value = `best ${formatParam(belief.best)}`;
    this.belief.draw({
      x: { label: belief.name, min, max, gap: 40 },
      y: { label: "density", min: 0, max: top },
      series,
      best: belief.best,
      description: `Density of ${belief.name}: prior${posterior ? " and posterior" : ""}, ${value}`,
    });
  }
}

function render({ model, el }) {
  const view = new CalibrationExplorerView(model, el);
  return () => view.destroy();
}

export default { render };
