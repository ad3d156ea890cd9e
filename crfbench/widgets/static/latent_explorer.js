// The page's side of LatentExplorer: the decoder runs here, so the curve follows the hand, with Python or without.

const REACH = 4; // how far the sliders go to either side of 0
const SLIDER_STEP = 0.02;
const LEAST_STEP = 1e-6; // as in the Python model
const SWEEP_SPEED = 2; // latent a second
const CALM_STEP = 0.5; // a second, for who asks for less motion
const calm = window.matchMedia("(prefers-reduced-motion: reduce)");

const sigmoid = (x) => 1 / (1 + Math.exp(-x));
const softplus = (x) => Math.max(x, 0) + Math.log1p(Math.exp(-Math.abs(x)));
const clamp = (value, reach) => Math.min(reach, Math.max(-reach, value));
const formatLatent = (z) => z.toFixed(2).replace("-", "−");

// The layers of a decoder from its float32 numbers: for each, the weights row by row, then the biases.
function unpackLayers(sizes, numbers) {
  let start = 0;
  const next = (count) => numbers.subarray(start, (start += count));
  return sizes.slice(1).map((rows, i) => ({ columns: sizes[i], weight: next(rows * sizes[i]), bias: next(rows) }));
}

function affine({ columns, weight, bias }, input) {
  const output = new Float64Array(bias.length);
  for (let row = 0, k = 0; row < bias.length; row++) {
    let sum = bias[row];
    for (let column = 0; column < columns; column++) sum += weight[k++] * input[column];
    output[row] = sum;
  }
  return output;
}

// Positive steps, summed and divided by their sum: from exactly 0 to exactly 1.
function risingCurve(raw) {
  const curve = new Float64Array(raw.length + 1);
  for (let i = 0; i < raw.length; i++) curve[i + 1] = curve[i] + softplus(raw[i]) + LEAST_STEP;
  return curve.map((total) => total / curve.at(-1));
}

function decode({ layers, monotone }, latent) {
  const hidden = layers.slice(0, -1);
  const last = hidden.reduce((h, layer) => affine(layer, h).map((x) => Math.max(0, x)), latent);
  const raw = affine(layers.at(-1), last);
  return monotone ? risingCurve(raw) : raw.map(sigmoid);
}

function rms(count, difference) {
  let sum = 0;
  for (let i = 0; i < count; i++) sum += difference(i) ** 2;
  return Math.sqrt(sum / count);
}

// The place of the least f between low and high, where f falls and then rises.
function goldenSection(f, low, high) {
  const share = (Math.sqrt(5) - 1) / 2;
  while (high - low > 1e-5) {
    const [left, right] = [high - share * (high - low), low + share * (high - low)];
    if (f(left) < f(right)) high = right;
    else low = left;
  }
  return (low + high) / 2;
}

// The power x^gamma nearest in least squares: the best of a table of exponents, then golden section around it.
function nearestPower(samples) {
  const n = samples.length;
  const distance = (log) => rms(n, (i) => (i / (n - 1)) ** (2 ** log) - samples[i]);
  const table = Array.from({ length: 49 }, (_, i) => i / 4 - 6); // gamma from 1/64 to 64
  const distances = table.map(distance);
  const best = table[distances.indexOf(Math.min(...distances))];
  const log = goldenSection(distance, best - 0.25, best + 0.25);
  return { gamma: 2 ** log, rmse: distance(log) };
}

// Measured curves come for each direction as thinned 16-bit samples, curve after curve.
function unpackCurves(curves) {
  const unpacked = Object.entries(curves).map(([direction, { names, samples }]) => [
    direction,
    { names, samples: Float64Array.from(uint16(samples), (value) => value / 65535) },
  ]);
  return Object.fromEntries(unpacked);
}

function nearestCurve({ names, samples }, thinned) {
  const n = thinned.length;
  const distances = names.map((_, row) => rms(n, (i) => samples[row * n + i] - thinned[i]));
  const rmse = Math.min(...distances);
  const row = distances.indexOf(rmse);
  return { name: names[row], rmse, samples: samples.subarray(row * n, (row + 1) * n) };
}

// Mean of normal curves at the latents, sampled evenly from -REACH to REACH; their width follows Scott's rule.
function kernelDensity(latents, count) {
  const mean = latents.reduce((a, b) => a + b, 0) / latents.length;
  const sd = rms(latents.length, (i) => latents[i] - mean);
  const width = Math.max(sd * latents.length ** -0.2, 0.02);
  return Array.from({ length: count }, (_, i) => {
    const z = REACH * ((2 * i) / (count - 1) - 1);
    return latents.reduce((sum, latent) => sum + normal((z - latent) / width), 0) / (latents.length * width);
  });
}

const normal = (z) => Math.exp((-z * z) / 2) / Math.sqrt(2 * Math.PI);

// What lies below a slider: N(0, 1), the density of the training curves' latents, a tick for each, and where z is.
class DensityPlot extends Sketch {
  constructor(label, latents) {
    super("crf-density");
    const prior = Array.from({ length: 161 }, (_, i) => normal(REACH * (i / 80 - 1)));
    this.figure = { latents, prior, density: kernelDensity(latents, 161) };
    this.top = Math.max(...prior, ...this.figure.density);
    this.describe(`Density of ${label} over its ${latents.length} training curves beside N(0, 1)`);
  }

  mark(z) {
    this.z = z;
    this.schedule();
  }

  // The thumb's centre stays half a thumb, 8 pixels, inside the ends of the slider.
  toX(z) {
    return this.width / 2 + (clamp(z, REACH) / REACH) * (this.width / 2 - 8);
  }

  paint(context) {
    const floor = this.height - 24;
    const blue = COLOURS.blue[Number(this.dark)];
    context.fillStyle = blue;
    this.trace(context, this.figure.density, floor);
    for (const end of [REACH, -REACH]) context.lineTo(this.toX(end), floor);
    context.globalAlpha = 0.3;
    context.fill();
    context.globalAlpha = 1;
    this.setLine(context, { colour: "vermilion", dash: "dashed", width: 1.5 });
    this.trace(context, this.figure.prior, floor);
    context.stroke();
    const inside = this.figure.latents.filter((latent) => Math.abs(latent) <= REACH);
    for (const latent of inside) context.fillRect(this.toX(latent) - 0.5, floor, 1, 6);
    this.paintScale(context, floor);
  }

  trace(context, values, floor) {
    context.beginPath();
    values.forEach((value, i) => {
      const z = REACH * ((2 * i) / (values.length - 1) - 1);
      context.lineTo(this.toX(z), floor - (value / this.top) * (floor - 4));
    });
  }

  paintScale(context, floor) {
    context.fillStyle = this.ink;
    context.textAlign = "center";
    for (const z of [-4, -2, 0, 2, 4]) context.fillText(String(z).replace("-", "−"), this.toX(z), this.height - 4);
    context.fillRect(Math.round(this.toX(this.z)) - 1, 0, 2, floor + 6);
  }
}

// Selects that offer what exists: each one the values found together with those chosen before it.
class Chooser {
  constructor(facets, onChoose) {
    this.facets = facets;
    this.selects = facets.map(({ title }) => labelledSelect(title, [], () => onChoose(this.chosen())));
    this.box = element("div", { class: "crf-choices" }, ...this.selects.map(({ box }) => box));
  }

  // The model with the chosen values; those chosen earlier count for more than all later ones.
  chosen() {
    const wanted = this.selects.map(({ input }) => input.selectedOptions[0].text);
    const agreement = (model) =>
      this.facets.reduce((score, { values }, i) => 2 * score + Number(values[model] === wanted[i]), 0);
    const scores = this.facets[0].values.map((_, model) => agreement(model));
    return scores.indexOf(Math.max(...scores));
  }

  show(model) {
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

// Moves a value to and fro between -REACH and REACH, from wherever it is.
class Sweep {
  constructor(onMove) {
    this.onMove = onMove;
    this.frame = 0;
  }

  get running() {
    return this.frame !== 0;
  }

  start(z) {
    const began = performance.now();
    const move = (now) => {
      this.frame = requestAnimationFrame(move);
      this.onMove(this.positionAfter(Math.max(0, now - began) / 1000, z));
    };
    this.frame = requestAnimationFrame(move);
  }

  stop() {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
  }

  positionAfter(seconds, z) {
    const way = calm.matches ? CALM_STEP * Math.floor(seconds) : SWEEP_SPEED * seconds;
    const round = (clamp(z, REACH) + REACH + way) % (4 * REACH);
    return round < 2 * REACH ? round - REACH : 3 * REACH - round;
  }
}

function saveAs(name, text) {
  const address = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}

class LatentExplorerView {
  constructor(model, root) {
    this.model = model;
    this.choices = model.get("_choices");
    this.curves = unpackCurves(this.choices.curves ?? {});
    this.plot = new CurvePlot();
    this.sliders = [];
    this.densities = [];
    this.sweep = new Sweep((z) => this.slide(this.touched, z));
    this.chooser = new Chooser(this.choices.facets, (index) => this.choose(this.choices.models[index]));
    this.root = element("div", { class: "crf" }, this.chooser.box, this.buildBody());
    root.append(this.root);
    this.leaveTheme = followTheme(this.root, () => this.repaint());
    this.update = this.update.bind(this);
    model.on("change:_shown", this.update);
    this.update();
  }

  destroy() {
    this.model.off("change:_shown", this.update);
    this.sweep.stop();
    this.leaveTheme();
    for (const sketch of [this.plot, ...this.densities]) sketch.destroy();
  }

  repaint() {
    for (const sketch of [this.plot, ...this.densities]) sketch.schedule();
  }

  buildBody() {
    this.sliderBox = element("div", { class: "crf-sliders", role: "group", "aria-label": "latent" });
    this.note = element("p", { class: "crf-note" });
    this.readouts = readouts(["gamma-equivalent", "RMSE to that gamma", ...this.nearestNames()]);
    this.status = element("div", { class: "crf-status", role: "status" });
    const panel = element("div", { class: "crf-panel" }, this.sliderBox, this.note, this.buildButtons());
    panel.append(this.readouts.box, this.status);
    return element("div", { class: "crf-body" }, element("div", { class: "crf-plot" }, this.plot.canvas), panel);
  }

  nearestNames() {
    return this.choices.curves ? ["RMSE to nearest curve", "nearest curve"] : []; // last, since names may wrap
  }

  buildButtons() {
    this.animate = button("Animate", () => this.toggleSweep(), { class: "crf-main crf-toggle" });
    const reset = button("Reset", () => this.put(this.current.name, this.shown.latent.map(() => 0)), { title: "z = 0" });
    const save = button("Save CSV", () => this.save(), { title: "the curve as irradiance and brightness" });
    return element("div", { class: "crf-buttons" }, this.animate, reset, save);
  }

  get shown() {
    return this.model.get("_shown");
  }

  // Drawing comes first: `set` calls `update`. Only then is the value sent, if there is a Python to send it to.
  put(name, latent) {
    this.model.set("_shown", { ...this.shown, model: name, latent });
    this.model.save_changes();
  }

  choose({ name, labels }) {
    const { latent } = this.shown;
    this.put(name, labels.length === latent.length ? latent : labels.map(() => 0));
  }

  slide(index, z) {
    this.touched = index;
    this.expected = this.shown.latent.with(index, z);
    this.put(this.current.name, this.expected);
  }

  toggleSweep() {
    if (this.sweep.running) this.stopSweep();
    else {
      this.sweep.start(this.shown.latent[this.touched]);
      this.animate.textContent = "Pause";
    }
  }

  stopSweep() {
    this.sweep.stop();
    this.animate.textContent = "Animate";
  }

  update() {
    const { model: name, latent } = this.shown;
    if (latent !== this.expected) this.stopSweep();
    if (name !== this.current?.name) this.change(name);
    this.curve = decode(this.current, latent);
    latent.forEach((z, i) => {
      this.sliders[i].show(z, formatLatent(z));
      this.densities[i].mark(z);
    });
    this.tell(latent);
  }

  change(name) {
    const index = this.choices.models.findIndex((entry) => entry.name === name);
    const entry = this.choices.models[index];
    this.current = { ...entry, layers: unpackLayers(entry.sizes, float32(entry.weights)) };
    this.touched = 0;
    this.status.textContent = "";
    this.chooser.show(index);
    this.rebuildSliders(entry.labels, float32(entry.latents));
  }

  rebuildSliders(labels, latents) {
    const k = labels.length;
    for (const density of this.densities) density.destroy();
    this.densities = labels.map((label, i) => new DensityPlot(label, latents.filter((_, at) => at % k === i)));
    const travel = { min: -REACH, max: REACH, step: SLIDER_STEP };
    this.sliders = labels.map((label, i) => labelledSlider(label, travel, (z) => this.slideByHand(i, z)));
    this.sliderBox.replaceChildren(
      ...labels.map((_, i) => element("div", {}, this.sliders[i].box, this.densities[i].canvas)),
    );
    const outside = latents.filter((z) => Math.abs(z) > REACH).length;
    this.note.textContent =
      "Filled, with a tick for each: the training curves. Dashed: N(0,\u00a01)." +
      (outside ? ` ${outside} of ${latents.length} ticks lie beyond the slider.` : "");
  }

  slideByHand(index, z) {
    this.stopSweep();
    this.slide(index, z);
  }

  // The figure and the read-outs of the curve that was just decoded.
  tell(latent) {
    const thinned = this.curve.filter((_, i) => i % this.choices.stride === 0);
    const power = nearestPower(thinned);
    const texts = [`γ = ${power.gamma.toPrecision(3)}`, power.rmse.toPrecision(3)];
    const curves = this.curves[this.current.direction];
    const nearest = curves && nearestCurve(curves, thinned);
    if (nearest) texts.push(nearest.rmse.toPrecision(3), nearest.name);
    this.readouts.show(texts);
    this.plot.draw(this.figure(nearest, this.describe(latent, texts)));
  }

  figure(nearest, description) {
    const forward = this.current.direction === "forward";
    const { xLabel, yLabel } = this.current;
    const samples = this.curve;
    const series = [
      { label: forward ? "response f" : "inverse response g", samples, colour: "blue", dash: "solid" },
      { label: "its inverse, axes swapped", samples, colour: "green", dash: "dotted", width: 1.5, mirrored: true },
    ];
    if (nearest) {
      series.push({ label: "nearest curve", samples: nearest.samples, colour: "vermilion", dash: "dashed", width: 1.5 });
    }
    const [x, y] = [xLabel, yLabel].map((label) => ({ label, min: 0, max: 1 }));
    return { x, y, series, description };
  }

  describe(latent, [gamma, , , nearest]) {
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

function render({ model, el }) {
  const view = new LatentExplorerView(model, el);
  return () => view.destroy();
}

export default { render };
