// The page's side of SearchExplorer: it draws the candidates and makes the choice for any M itself.

import { element, followTheme, labelledSelect, labelledSlider, listen, readouts } from "./controls.js";
import { Plot } from "./plot.js";

/** @typedef {import("./controls.js").Model} Model */

/**
 * @typedef {{ hidden: number[], mse: number, bar: number, rmse: number, complexity: number, front: boolean }} Candidate
 */

const REACH = 24; // CSS pixels from a candidate within which the pointer means it
const ROOM = 1.12; // factor of empty space beyond the outermost candidates, axes being logarithmic

/** @param {Candidate} candidate */
const architectureName = ({ hidden }) => `(${hidden.join(", ")}${hidden.length === 1 ? "," : ""})`;

// Of the m most accurate candidates (they come in that order) the least complex; of equals, the more accurate.
export function choose(/** @type {Pick<Candidate, "complexity">[]} */ candidates, /** @type {number} */ m) {
  let best = 0;
  for (let i = 1; i < m; i++) if (candidates[i].complexity < candidates[best].complexity) best = i;
  return best;
}

/**
 * The Pareto front as a staircase: the least MSE of all candidates up to a complexity, drawn on to `end`.
 * @param {Pick<Candidate, "complexity" | "mse" | "front">[]} candidates
 * @param {number} end
 */
export function staircase(candidates, end) {
  const front = candidates.filter((candidate) => candidate.front).sort((a, b) => a.complexity - b.complexity);
  const stops = [...front.slice(1).map(({ complexity }) => complexity), end];
  return {
    x: front.flatMap(({ complexity }, i) => [complexity, stops[i]]),
    y: front.flatMap(({ mse }) => [mse, mse]),
  };
}

/** @param {number[]} values */
const span = (values) => ({ min: Math.min(...values) / ROOM, max: Math.max(...values) * ROOM, log: true });

const inThousands = (/** @type {number} */ value) => (value >= 1000 ? `${value / 1000}k` : `${value}`);
const perMille = (/** @type {number} */ value) => `${Number((1000 * value).toPrecision(3))}`;

class SearchExplorerView {
  constructor(/** @type {Model} */ model, /** @type {HTMLElement} */ root) {
    this.model = model;
    /** @type {Candidate[]} */
    this.candidates = model.get("_candidates");
    this.points = { x: this.candidates.map(({ complexity }) => complexity), y: this.candidates.map(({ mse }) => mse) };
    this.plot = new Plot();
    this.plot.canvas.addEventListener("pointermove", (event) => this.point(event));
    const names = this.candidates.map((candidate, i) => `${i + 1}. ${architectureName(candidate)}`);
    const range = { min: 1, max: names.length, step: 1 };
    this.slider = labelledSlider("M, how many most accurate to choose from", range, (m) => this.set("m", m));
    this.list = labelledSelect("Candidate, by rank", names, (row) => this.set("focus", this.candidates[row].hidden));
    this.readouts = readouts(["architecture", "held-out MSE", "mean RMSE", "complexity", "rank"]);
    this.status = element("div", { class: "crf-status", role: "status" });
    const panel = [this.slider.box, this.status, this.list.box, this.readouts.box];
    const left = element("div", { class: "crf-plot" }, this.plot.canvas);
    const body = element("div", { class: "crf-body" }, left, element("div", { class: "crf-panel" }, ...panel));
    this.root = element("div", { class: "crf" }, body);
    root.append(this.root);
    this.leaveTheme = followTheme(this.root, () => this.plot.schedule());
    const update = () => this.update();
    this.stopListening = listen(model, { m: update, focus: update });
    update();
  }

  destroy() {
    this.stopListening();
    this.leaveTheme();
    this.plot.destroy();
  }

  set(/** @type {string} */ name, /** @type {unknown} */ value) {
    this.model.set(name, value);
    this.model.save_changes();
  }

  point(/** @type {PointerEvent} */ { offsetX, offsetY }) {
    const row = this.plot.nearest(this.points, offsetX, offsetY, REACH);
    if (row !== null && row !== this.row()) this.set("focus", this.candidates[row].hidden);
  }

  row() {
    const focus = String(this.model.get("focus"));
    return Math.max(0, this.candidates.findIndex(({ hidden }) => String(hidden) === focus));
  }

  update() {
    // A slider linked to M may run beyond the candidates.
    const m = Math.min(this.candidates.length, Math.max(1, this.model.get("m")));
    const row = this.row();
    const chosen = choose(this.candidates, m);
    const { mse, bar, rmse, complexity } = this.candidates[row];
    const name = architectureName(this.candidates[row]);
    const text = `Choice: ${architectureName(this.candidates[chosen])}`;
    this.slider.show(m, String(m));
    this.list.input.selectedIndex = row;
    this.status.textContent = text;
    const error = `${mse.toExponential(2)} ± ${bar.toExponential(0)}`;
    const weights = complexity.toLocaleString("en");
    this.readouts.show([name, error, rmse.toPrecision(3), weights, `${row + 1} of ${this.candidates.length}`]);
    this.plot.draw({
      x: { label: "complexity (encoder parameters)", ...span(this.points.x), format: inThousands },
      y: { label: "held-out MSE (1e-3)", ...span(this.points.y), format: perMille },
      marks: this.marks(m, chosen, row),
      description: `${text} of the ${m} most accurate. Named: ${name}, MSE ${error}, complexity ${weights}`,
    });
  }

  /**
   * @param {number} m
   * @param {number} chosen
   * @param {number} row
   * @returns {import("./plot.js").Mark[]}
   */
  marks(m, chosen, row) {
    const { x, y } = this.points;
    const bars = this.candidates.map(({ mse, bar }) => [mse - bar, mse + bar]);
    /** @type {(from: number, to: number) => { x: number[], y: number[] }} */
    const points = (from, to) => ({ x: x.slice(from, to), y: y.slice(from, to) });
    /** @type {(from: number, to: number) => import("./plot.js").Bar} */
    const errorBars = (from, to) => {
      const some = bars.slice(from, to);
      return { type: "bar", x: x.slice(from, to), low: some.map(([low]) => low), high: some.map(([, high]) => high) };
    };
    const best = m === 1 ? "the most accurate" : `the ${m} most accurate, with their bars`;
    const front = staircase(this.candidates, span(x).max);
    return [
      { type: "line", label: "Pareto front", ...front, colour: "green", dash: "dashed" },
      { type: "dots", label: "candidate", ...points(m, x.length), radius: 3, alpha: 0.45 },
      { ...errorBars(0, m), colour: "blue" },
      { type: "dots", label: best, ...points(0, m), shape: "diamond", radius: 5, colour: "blue" },
      { type: "dots", label: "choice", ...points(chosen, chosen + 1), shape: "square", radius: 6, colour: "vermilion" },
      errorBars(row, row + 1),
      { type: "dots", ...points(row, row + 1), shape: "ring", radius: 9 },
      { type: "text", x: x[row], y: y[row], text: architectureName(this.candidates[row]) },
    ];
  }
}

function render(/** @type {{ model: Model, el: HTMLElement }} */ { model, el }) {
  const view = new SearchExplorerView(model, el);
  return () => view.destroy();
}

export default { render };
