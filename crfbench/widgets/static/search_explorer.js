// The page's side of SearchExplorer: it draws the candidates and makes the choice for any M itself.

const REACH = 24; // CSS pixels from a candidate within which the pointer means it
const ROOM = 1.12; // factor of empty space beyond the outermost candidates, axes being logarithmic

const architectureName = ({ hidden }) => `(${hidden.join(", ")}${hidden.length === 1 ? "," : ""})`;

// Of the m most accurate candidates (they come in that order) the least complex; of equals, the more accurate.
function choose(candidates, m) {
  let best = 0;
  for (let i = 1; i < m; i++) if (candidates[i].complexity < candidates[best].complexity) best = i;
  return best;
}

// 1, 2 and 5 times each power of ten between min and max.
function logTicks({ min, max }) {
  const values = [];
  for (let power = Math.floor(Math.log10(min)); 10 ** power <= max; power++) {
    for (const factor of [1, 2, 5]) values.push(Number(`${factor}e${power}`));
  }
  return values.filter((value) => value >= min && value <= max);
}

function span(values) {
  return { min: Math.min(...values) / ROOM, max: Math.max(...values) * ROOM };
}

const inThousands = (value) => (value >= 1000 ? `${value / 1000}k` : `${value}`);
const perMille = (value) => `${Number((1000 * value).toPrecision(3))}`;

// Figures of the form { candidates, m, chosen, row, description }: see SearchExplorer.
class SearchPlot extends CurvePlot {
  paint() {
    const context = this.clear();
    const style = getComputedStyle(this.canvas);
    this.ink = style.color;
    this.dark = isDarkGround(this.canvas);
    context.font = `${FONT_SIZE}px ${style.fontFamily}`;
    this.place(this.legendRows(context));
    this.paintAxes(context);
    this.paintFront(context);
    this.figure.candidates.forEach((candidate, i) => i >= this.figure.m && this.paintPoint(context, i));
    for (let i = this.figure.m - 1; i >= 0; i--) this.paintPoint(context, i);
    this.paintChoice(context);
    this.paintFocus(context);
    this.paintKey(context);
  }

  entries() {
    const { m } = this.figure;
    return [
      { label: "candidate", colour: null },
      { label: m === 1 ? "the most accurate" : `the ${m} most accurate, with their bars`, colour: "blue" },
      { label: "choice", colour: "vermilion" },
      { label: "Pareto front", colour: "green" },
    ];
  }

  legendRows(context) {
    this.key = legendEntries(context, this.entries(), this.width - 56);
    return this.key.at(-1).row + 1;
  }

  place(legendRows) {
    const { candidates } = this.figure;
    const x = span(candidates.map(({ complexity }) => complexity));
    const y = span(candidates.map(({ mse }) => mse));
    this.left = 48;
    this.right = this.width - 8;
    this.top = legendRows * ROW + 8;
    this.bottom = this.height - 42;
    const share = (value, { min, max }) => Math.log(value / min) / Math.log(max / min);
    this.toX = (value) => this.left + share(value, x) * (this.right - this.left);
    this.toY = (value) => this.bottom - share(value, y) * (this.bottom - this.top);
    this.ticks = [logTicks(x), logTicks(y)];
    if (this.ticks[1].length < 3) this.ticks[1] = ticks(y, 6);
  }

  paintAxes(context) {
    const { left, right, top, bottom } = this;
    context.fillStyle = context.strokeStyle = this.ink;
    context.lineWidth = 1;
    context.setLineDash([]);
    context.textBaseline = "middle";
    context.textAlign = "right";
    for (const value of this.ticks[1]) {
      this.paintGridLine(context, left, this.toY(value), right, this.toY(value));
      context.fillText(perMille(value), left - 7, this.toY(value));
    }
    context.textAlign = "center";
    for (const value of this.ticks[0]) {
      this.paintGridLine(context, this.toX(value), top, this.toX(value), bottom);
      context.fillText(inThousands(value), this.toX(value), bottom + 12);
    }
    context.strokeRect(Math.round(left) + 0.5, Math.round(top) + 0.5, right - left - 1, bottom - top - 1);
    this.figure.x = { label: "complexity (encoder parameters)" };
    this.figure.y = { label: "held-out MSE (1e-3)" };
    this.paintAxisNames(context);
  }

  colour(name) {
    return COLOURS[name][Number(this.dark)];
  }

  at(i) {
    const { complexity, mse } = this.figure.candidates[i];
    return [this.toX(complexity), this.toY(mse)];
  }

  paintFront(context) {
    const front = this.figure.candidates.filter((candidate) => candidate.front);
    front.sort((a, b) => a.complexity - b.complexity);
    context.strokeStyle = this.colour("green");
    context.lineWidth = LINE_WIDTH;
    context.setLineDash(DASHES.dashed);
    context.beginPath();
    front.forEach((candidate, i) => {
      const [x, y] = [this.toX(candidate.complexity), this.toY(candidate.mse)];
      if (i > 0) context.lineTo(x, this.toY(front[i - 1].mse));
      context.lineTo(x, y);
    });
    context.lineTo(this.right, this.toY(front.at(-1).mse));
    context.stroke();
    context.setLineDash([]);
  }

  paintPoint(context, i) {
    const best = i < this.figure.m;
    if (best) this.paintBar(context, i, this.colour("blue"));
    context.globalAlpha = best ? 1 : 0.45;
    context.fillStyle = best ? this.colour("blue") : this.ink;
    this[best ? "diamond" : "disc"](context, ...this.at(i), best ? 5 : 3);
    context.fill();
    context.globalAlpha = 1;
  }

  // A bar that reaches to zero or below stops at the frame.
  paintBar(context, i, colour) {
    const { mse, bar } = this.figure.candidates[i];
    const [x] = this.at(i);
    const low = mse > bar ? Math.min(this.toY(mse - bar), this.bottom) : this.bottom;
    context.strokeStyle = colour;
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(x, low);
    context.lineTo(x, Math.max(this.toY(mse + bar), this.top));
    context.stroke();
  }

  paintChoice(context) {
    const [x, y] = this.at(this.figure.chosen);
    context.fillStyle = this.colour("vermilion");
    context.fillRect(x - 6, y - 6, 12, 12);
  }

  paintFocus(context) {
    const { row, candidates } = this.figure;
    const [x, y] = this.at(row);
    this.paintBar(context, row, this.ink);
    context.lineWidth = LINE_WIDTH;
    this.disc(context, x, y, 9);
    context.stroke();
    const name = architectureName(candidates[row]);
    const length = context.measureText(name).width;
    const left = x + 14 + length > this.right ? x - 14 - length : x + 14;
    const middle = y - 18 < this.top + 8 ? y + 18 : y - 18;
    context.fillStyle = this.dark ? "#111" : "#fff"; // hides the dots behind the name
    context.fillRect(left - 4, middle - 8, length + 8, 16);
    context.fillStyle = this.ink;
    context.textAlign = "left";
    context.fillText(name, left, middle);
  }

  paintKey(context) {
    for (const { curve, label, x, row } of this.key) {
      const [start, y] = [this.left + x, row * ROW + ROW / 2];
      context.fillStyle = context.strokeStyle = curve.colour ? this.colour(curve.colour) : this.ink;
      context.globalAlpha = curve.colour ? 1 : 0.45;
      context.beginPath();
      if (curve.colour === "green") {
        context.lineWidth = LINE_WIDTH;
        context.setLineDash(DASHES.dashed);
        context.moveTo(start, y);
        context.lineTo(start + LEGEND_LINE, y);
        context.stroke();
        context.setLineDash([]);
      } else if (curve.colour === "vermilion") context.fillRect(start + LEGEND_LINE / 2 - 5, y - 5, 10, 10);
      else {
        this[curve.colour ? "diamond" : "disc"](context, start + LEGEND_LINE / 2, y, curve.colour ? 5 : 4);
        context.fill();
      }
      context.globalAlpha = 1;
      context.fillStyle = this.ink;
      context.textAlign = "left";
      context.fillText(label, start + LEGEND_LINE + 6, y);
    }
  }

  disc(context, x, y, radius) {
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
  }

  diamond(context, x, y, reach) {
    context.beginPath();
    for (const [right, down] of [[reach, 0], [0, reach], [-reach, 0], [0, -reach]]) context.lineTo(x + right, y + down);
    context.closePath();
  }

  // The candidate nearest to a place on the canvas, if any is near.
  nearest(x, y) {
    let [best, least] = [null, REACH];
    this.figure.candidates.forEach((_, i) => {
      const [px, py] = this.at(i);
      const distance = Math.hypot(px - x, py - y);
      if (distance < least) [best, least] = [i, distance];
    });
    return best;
  }
}

class SearchExplorerView {
  constructor(model, root) {
    this.model = model;
    this.candidates = model.get("_candidates");
    this.plot = new SearchPlot();
    this.readouts = readouts(["architecture", "held-out MSE", "mean RMSE", "complexity", "rank"]);
    this.status = element("div", { class: "crf-status", role: "status" });
    this.root = element("div", { class: "crf" }, this.buildBody());
    root.append(this.root);
    this.plot.canvas.addEventListener("pointermove", (event) => this.point(event));
    this.leaveTheme = followTheme(this.root, () => this.plot.schedule());
    this.update = this.update.bind(this);
    model.on("change:_m", this.update);
    model.on("change:_row", this.update);
    this.update();
  }

  destroy() {
    this.model.off("change:_m", this.update);
    this.model.off("change:_row", this.update);
    this.leaveTheme();
    this.plot.destroy();
  }

  buildBody() {
    const names = this.candidates.map((candidate, i) => `${i + 1}. ${architectureName(candidate)}`);
    const range = { min: 1, max: this.candidates.length, step: 1 };
    this.slider = labelledSlider("M, how many most accurate to choose from", range, (m) => this.set("_m", m));
    this.list = labelledSelect("Candidate, by rank", names, (row) => this.set("_row", row));
    const panel = element("div", { class: "crf-panel" }, this.slider.box, this.status, this.list.box);
    panel.append(this.readouts.box);
    return element("div", { class: "crf-body" }, element("div", { class: "crf-plot" }, this.plot.canvas), panel);
  }

  set(name, value) {
    this.model.set(name, value);
    this.model.save_changes();
  }

  point({ offsetX, offsetY }) {
    const row = this.plot.nearest(offsetX, offsetY);
    if (row !== null && row !== this.model.get("_row")) this.set("_row", row);
  }

  update() {
    const [m, row] = [this.model.get("_m"), this.model.get("_row")];
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
    const description = `${text} of the ${m} most accurate. Named: ${name}, MSE ${error}, complexity ${weights}`;
    this.plot.draw({ candidates: this.candidates, m, chosen, row, description });
  }
}

function render({ model, el }) {
  const view = new SearchExplorerView(model, el);
  return () => view.destroy();
}

export default { render };
