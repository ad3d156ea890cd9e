// The page's side of SearchExplorer: it draws the candidates, walks through Algorithm 1 and chooses for any M.

import { button, element, followTheme, labelledSelect, labelledSlider, listen, readouts } from "./controls.js";
import { Animation } from "./moves.js";
import { Plot } from "./plot.js";

/** @typedef {import("./controls.js").Model} Model */

/**
 * @typedef {{ hidden: number[], mse: number, bar: number, rmse: number, complexity: number, front: boolean }} Candidate
 */

const ROOM = 1.12; // factor of empty space beyond the outermost candidates, axes being logarithmic

/** @param {Candidate} candidate */
const architectureName = ({ hidden }) => `(${hidden.join(", ")})`;

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

// The lines of Algorithm 1, numbered as in the paper.
const LISTING = [
  "S ← an empty list of N results",
  "for each k from 1 to N:",
  "A ← candidate k of the search space",
  "a ← held-out MSE of A (accuracy)",
  "c ← weights and biases of A (complexity)",
  "S[k] ← (a, c, A)",
  "end for",
  "sort S by a, most accurate first",
  "S′ ← the first M of S",
  "sort S′ by c, least complex first",
  "return A of the first in S′",
];
const LOOP = [3, 4, 5, 6]; // its lines for each candidate
const AFTER = [8, 9, 10, 11];
const WALK_SECONDS = 16; // for all lines, but with time to read where they are few
const LEAST_SPEED = 4; // lines in a second

/** The order of the grid: by the first layer, then the second, then the third. */
export function gridOrder(/** @type {Pick<Candidate, "hidden">[]} */ candidates) {
  const layers = (/** @type {number} */ i) => [0, 1, 2].map((l) => candidates[i].hidden[l] ?? 0);
  const compare = (/** @type {number[]} */ a, /** @type {number[]} */ b) => a[0] - b[0] || a[1] - b[1] || a[2] - b[2];
  return candidates.map((_, i) => i).sort((i, j) => compare(layers(i), layers(j)));
}

// Where step t of the algorithm is: its line, how many candidates lie in S, and which one is the present; with n
// candidates there are 4 n + 5 steps from 0, and after them no line.
export function stepAt(/** @type {number} */ t, /** @type {number} */ n) {
  if (t === 0) return { line: 1, stored: 0, k: -1 };
  const [k, at] = [Math.floor((t - 1) / LOOP.length), (t - 1) % LOOP.length];
  if (k < n) return { line: LOOP[at], stored: k + Number(at === LOOP.length - 1), k };
  return { line: AFTER[t - 1 - LOOP.length * n] ?? 0, stored: n, k: -1 };
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
    this.names = this.candidates.map(architectureName);
    this.points = { x: this.candidates.map(({ complexity }) => complexity), y: this.candidates.map(({ mse }) => mse) };
    this.order = gridOrder(this.candidates);
    this.last = LOOP.length * this.order.length + 1 + AFTER.length;
    this.t = this.last; // the step of the algorithm; the last: all is done
    this.from = 0; // where the animation began
    const speed = Math.ceil(Math.max(LEAST_SPEED, this.last / WALK_SECONDS));
    this.animation = new Animation({ speed, calmStep: speed }, (way) => this.go(this.from + Math.floor(way)));
    this.plot = new Plot();
    const names = this.names.map((name, i) => `${i + 1}. ${name}`);
    const range = { min: 1, max: names.length, step: 1 };
    this.slider = labelledSlider("M, how many most accurate to choose from", range, (m) => this.chooseFrom(m));
    this.list = labelledSelect("Candidate, by rank", names, (row) => this.set("focus", this.candidates[row].hidden));
    this.readouts = readouts(["architecture", "held-out MSE", "mean RMSE", "complexity", "rank"]);
    this.status = element("div", { class: "crf-status", role: "status" });
    this.play = button("Play", () => this.toggle(), { class: "crf-main crf-toggle" });
    this.lines = LISTING.map((line, i) => element("li", { class: LOOP.includes(i + 1) ? "crf-inner" : "" }, line));
    const panel = [this.slider.box, this.status, this.list.box, this.readouts.box, this.buildListing()];
    const left = element("div", { class: "crf-plot" }, this.plot.box);
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
    this.animation.stop();
    this.plot.destroy();
  }

  buildListing() {
    const step = button("Step", () => (this.pause(), this.go((this.t + 1) % (this.last + 1))), { title: "one line" });
    const end = button("To the end", () => (this.pause(), this.go(this.last)));
    const buttons = element("div", { class: "crf-buttons" }, this.play, step, end);
    const list = element("ol", { class: "crf-listing" }, ...this.lines);
    const title = element("div", {}, `The paper's Algorithm 1, N = ${this.order.length}`);
    return element("div", { role: "group", "aria-label": "Algorithm 1" }, title, list, buttons);
  }

  // --- the walk through the algorithm

  toggle() {
    if (this.animation.running) return this.pause();
    this.from = this.t < this.last ? this.t : 0;
    this.animation.start();
    this.play.textContent = "Pause";
    this.status.setAttribute("aria-live", "off"); // too quick to be read aloud
  }

  pause() {
    this.animation.stop();
    this.play.textContent = "Play";
    this.status.removeAttribute("aria-live");
  }

  go(/** @type {number} */ t) {
    if (t >= this.last) this.pause();
    this.t = Math.min(t, this.last);
    this.update();
  }

  /**
   * What happens at a line, in words, and the candidate that it is about.
   * @param {number} m
   * @param {number} chosen
   * @returns {{ text: string, row: number }}
   */
  tell(m, chosen) {
    const { line, k } = stepAt(this.t, this.order.length);
    const n = this.order.length;
    const row = k >= 0 ? this.order[k] : [10, 11, 0].includes(line) ? chosen : 0;
    const name = this.names[row];
    const { mse, complexity } = this.candidates[row];
    /** @type {Record<number, string>} */
    const texts = {
      1: `nothing is known yet of the ${n} candidates.`,
      3: `candidate ${k + 1} of ${n} is ${name}.`,
      4: `its held-out MSE is ${mse.toExponential(2)}.`,
      5: `its complexity is ${complexity.toLocaleString("en")}.`,
      6: `${name} is stored, ${k + 1} of ${n}.`,
      8: `the most accurate is ${name}.`,
      9: m === 1 ? "the most accurate is kept." : `the ${m} most accurate are kept.`,
      10: `the least complex of them is ${name}.`,
      11: `the choice is ${name}.`,
    };
    return line ? { text: `Line ${line}: ${texts[line]}`, row } : { text: `Choice: ${name}`, row: this.row() };
  }

  // --- the candidates

  set(/** @type {string} */ name, /** @type {unknown} */ value) {
    this.model.set(name, value);
    this.model.save_changes();
  }

  // The choice is named then, whatever was before.
  chooseFrom(/** @type {number} */ m) {
    this.model.set("m", m);
    this.set("focus", this.candidates[choose(this.candidates, m)].hidden);
  }

  row() {
    const focus = String(this.model.get("focus"));
    return Math.max(0, this.candidates.findIndex(({ hidden }) => String(hidden) === focus));
  }

  update() {
    // A slider linked to M may run beyond the candidates.
    const m = Math.min(this.candidates.length, Math.max(1, this.model.get("m")));
    const chosen = choose(this.candidates, m);
    const { text, row } = this.tell(m, chosen);
    const { line } = stepAt(this.t, this.order.length);
    this.lines.forEach((node, i) => node.setAttribute("aria-current", i + 1 === line ? "step" : "false"));
    this.slider.show(m, String(m));
    this.list.input.selectedIndex = row;
    this.status.textContent = text;
    const { mse, bar, rmse, complexity } = this.candidates[row];
    const error = `${mse.toExponential(2)} ± ${bar.toExponential(0)}`;
    const weights = complexity.toLocaleString("en");
    const rank = `${row + 1} of ${this.candidates.length}`;
    this.readouts.show([this.names[row], error, rmse.toPrecision(3), weights, rank]);
    const named = `Named: ${this.names[row]}, MSE ${error}, complexity ${weights}`;
    this.draw(m, chosen, row, line ? `${text} ${named}` : `${text} of the ${m} most accurate. ${named}`);
  }

  /**
   * @param {number} m
   * @param {number} chosen
   * @param {number} row
   * @param {string} description
   */
  draw(m, chosen, row, description) {
    const x = { label: "complexity (encoder parameters)", ...span(this.points.x), format: inThousands };
    const y = { label: "held-out MSE (1e-3)", ...span(this.points.y), format: perMille };
    const { line, k } = stepAt(this.t, this.order.length);
    const point = { x: this.points.x[row], y: this.points.y[row] };
    const note = k >= 0 && line < 6 ? undefined : { ...point, text: this.names[row] };
    this.plot.draw({
      x: { ...x, write: (weights) => Math.round(weights).toLocaleString("en") },
      y: { ...y, write: (mse) => mse.toExponential(2) },
      marks: k >= 0 || line === 1 ? this.marksSoFar(row) : this.marks(m, chosen, row),
      note: line === 1 ? undefined : note,
      description,
    });
  }

  /**
   * Some of the candidates as dots that name themselves.
   * @param {number[]} rows
   * @returns {{ type: "dots", x: number[], y: number[], names: string[], onPick: (i: number) => void }}
   */
  dots(rows) {
    const names = rows.map((row) => `${this.names[row]}, rank ${row + 1}`);
    const [x, y] = [rows.map((row) => this.points.x[row]), rows.map((row) => this.points.y[row])];
    return { type: "dots", x, y, names, onPick: (i) => this.pick(rows[i]) };
  }

  pick(/** @type {number} */ row) {
    if (this.t === this.last && row !== this.row()) this.set("focus", this.candidates[row].hidden);
  }

  /**
   * While the algorithm loops: what is stored, and of the present candidate what is known.
   * @param {number} row
   * @returns {import("./plot.js").Mark[]}
   */
  marksSoFar(row) {
    const { line, stored } = stepAt(this.t, this.order.length);
    const [x, y] = [this.points.x[row], this.points.y[row]];
    const [across, up] = [span(this.points.x), span(this.points.y)];
    /** @type {import("./plot.js").Mark[]} */
    const marks = [{ ...this.dots(this.order.slice(0, stored)), label: "stored in S", radius: 3, alpha: 0.45 }];
    if (line >= 4) marks.push({ type: "line", name: "a", x: [across.min, across.max], y: [y, y], dash: "dotted" });
    if (line >= 5) marks.push({ type: "line", name: "c", x: [x, x], y: [up.min, up.max], dash: "dotted" });
    if (line === 6) marks.push({ ...this.dots([row]), label: "A", shape: "square", radius: 6, colour: "vermilion" });
    return marks;
  }

  /**
   * @param {number} m
   * @param {number} chosen
   * @param {number} row
   * @returns {import("./plot.js").Mark[]}
   */
  marks(m, chosen, row) {
    const { line } = stepAt(this.t, this.order.length);
    const { x } = this.points;
    const rows = x.map((_, i) => i);
    const kept = line === 8 ? 0 : m;
    const best = m === 1 ? "the most accurate" : `the ${m} most accurate, with their bars`;
    /** @type {(some: number[]) => import("./plot.js").Bar} */
    const errorBars = (some) => {
      const bars = some.map((i) => this.candidates[i]);
      const [low, high] = [bars.map(({ mse, bar }) => mse - bar), bars.map(({ mse, bar }) => mse + bar)];
      return { type: "bar", x: some.map((i) => x[i]), low, high };
    };
    /** @type {import("./plot.js").Mark[]} */
    const marks = [{ ...this.dots(rows.slice(kept)), label: "candidate", radius: 3, alpha: 0.45 }];
    if (!line) {
      const front = staircase(this.candidates, span(x).max);
      marks.unshift({ type: "line", label: "Pareto front", ...front, colour: "green", dash: "dashed" });
    }
    if (kept) {
      marks.push({ ...errorBars(rows.slice(0, m)), of: best, colour: "blue" });
      marks.push({ ...this.dots(rows.slice(0, m)), label: best, shape: "diamond", radius: 5, colour: "blue" });
    }
    if (!line || line === 11) {
      marks.push({ ...this.dots([chosen]), label: "choice", shape: "square", radius: 6, colour: "vermilion" });
    }
    return [...marks, { ...errorBars([row]), name: `bar of ${this.names[row]}` }, { ...this.dots([row]), shape: "ring", radius: 9 }];
  }
}

function render(/** @type {{ model: Model, el: HTMLElement }} */ { model, el }) {
  const view = new SearchExplorerView(model, el);
  return () => view.destroy();
}

export default { render };
