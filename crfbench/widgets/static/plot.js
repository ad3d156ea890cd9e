// Small plots on a canvas, shared by the widgets. Joined in front of a widget's own module.

// Okabe and Ito's colours, told apart with any colour vision: [on a light ground, lighter on a dark ground].
const COLOURS = {
  blue: ["#0072B2", "#56B4E9"],
  vermilion: ["#D55E00", "#F28A3A"],
  green: ["#009E73", "#2EC495"],
};
const DASHES = { solid: [], dashed: [8, 4], dotted: [2, 3] };
const FONT_SIZE = 12;
const LINE_WIDTH = 2;
const LEGEND_LINE = 26; // length of the line sample
const LEGEND_GAP = 16; // between two entries
const ROW = 18; // height of a row of legend

// The samples of a binary trait: a DataView at any offset, so the bytes are copied to where numbers may lie.
const bytesOf = (view) => view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength);
const float32 = (view) => new Float32Array(bytesOf(view));
const uint16 = (view) => new Uint16Array(bytesOf(view));

// About `count` round numbers (1, 2 or 5 times a power of ten) between min and max.
function ticks({ min, max }, count) {
  const least = (max - min) / count;
  const power = 10 ** Math.floor(Math.log10(least));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= least * 0.999);
  const first = Math.ceil(min / step - 1e-9);
  const n = Math.floor(max / step + 1e-9) - first + 1;
  return Array.from({ length: n }, (_, i) => Number(((first + i) * step).toPrecision(10)));
}

const written = (value) => String(value).replace("-", "−");

function shorten(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  let end = text.length;
  while (end > 1 && context.measureText(text.slice(0, end) + "…").width > width) end--;
  return text.slice(0, end) + "…";
}

// Where each legend entry goes: as many in a row as fit.
function legendEntries(context, series, width) {
  let x = 0;
  let row = 0;
  return series.map((curve) => {
    const label = shorten(context, curve.label, width - LEGEND_LINE - 6);
    const length = LEGEND_LINE + 6 + context.measureText(label).width;
    if (x > 0 && x + length > width) [x, row] = [0, row + 1];
    const entry = { curve, label, x, row };
    x += length + LEGEND_GAP;
    return entry;
  });
}

// A canvas as large as the style sheet makes it, painted at most once a frame; `paint(context)` is the subclass's.
class Sketch {
  constructor(name) {
    this.canvas = element("canvas", { class: name, role: "img" });
    this.frame = 0;
    this.width = this.height = 0;
    this.observer = new ResizeObserver(() => this.schedule());
    this.observer.observe(this.canvas);
  }

  describe(text) {
    this.canvas.setAttribute("aria-label", text);
  }

  destroy() {
    this.observer.disconnect();
    cancelAnimationFrame(this.frame);
  }

  schedule() {
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      if (this.figure && this.measure()) this.paint(this.begin());
    });
  }

  // JupyterLab hides the page for a moment while it changes the theme; the last size is kept for that moment.
  measure() {
    const { clientWidth, clientHeight, isConnected } = this.canvas;
    if (clientWidth) [this.width, this.height] = [clientWidth, clientHeight];
    return isConnected && this.width > 0;
  }

  // An empty canvas with the theme's ink and letters.
  begin() {
    const context = this.clear();
    const style = getComputedStyle(this.canvas);
    this.ink = style.color;
    this.dark = isDarkGround(this.canvas);
    context.font = `${FONT_SIZE}px ${style.fontFamily}`;
    return context;
  }

  // One canvas pixel is one device pixel, so lines and letters are crisp; drawing is in CSS pixels.
  clear() {
    const ratio = window.devicePixelRatio || 1;
    const { canvas } = this;
    const [width, height] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    return context;
  }

  setLine(context, { colour, dash, width = LINE_WIDTH }) {
    context.strokeStyle = COLOURS[colour][Number(this.dark)];
    context.lineWidth = width;
    context.lineJoin = "round";
    context.setLineDash(DASHES[dash]);
  }
}

/**
 * Draws figures of the form
 *   { x: { label, min, max, gap }, y: { label, min, max }, series: [{ label, samples, colour, dash, ... }], description }
 * where `samples` are spread evenly over the x axis, `colour` is a key of COLOURS, `dash` one of DASHES and
 * `description` what a screen reader says. A series may have a `width` of its own and be `mirrored` at the diagonal,
 * which shows the inverse of a curve; both axes must then show the same range of 0 to 1. `gap` is how near to each
 * other the numbers of the x axis may stand, 56 pixels if not given.
 */
class CurvePlot extends Sketch {
  constructor() {
    super("crf-canvas");
  }

  draw(figure) {
    this.figure = figure;
    this.describe(figure.description);
    this.schedule();
  }

  paint(context) {
    const entries = legendEntries(context, this.figure.series, this.width - 56);
    this.place(entries.at(-1).row + 1);
    this.paintAxes(context);
    this.paintCurves(context);
    for (const entry of entries) this.paintLegend(context, entry);
  }

  place(legendRows) {
    const { x, y } = this.figure;
    this.left = 48;
    this.right = this.width - 8;
    this.top = legendRows * ROW + 8;
    this.bottom = this.height - 42;
    this.toX = (value) => this.left + ((value - x.min) / (x.max - x.min)) * (this.right - this.left);
    this.toY = (value) => this.bottom - ((value - y.min) / (y.max - y.min)) * (this.bottom - this.top);
  }

  paintAxes(context) {
    const { x, y } = this.figure;
    const { left, right, top, bottom } = this;
    context.fillStyle = context.strokeStyle = this.ink;
    context.lineWidth = 1;
    context.setLineDash([]);
    context.textBaseline = "middle";
    for (const value of ticks(y, (bottom - top) / 44)) {
      this.paintGridLine(context, left, this.toY(value), right, this.toY(value));
      context.textAlign = "right";
      context.fillText(written(value), left - 7, this.toY(value));
    }
    for (const value of ticks(x, (right - left) / (x.gap ?? 56))) {
      this.paintGridLine(context, this.toX(value), top, this.toX(value), bottom);
      context.textAlign = value === x.max ? "right" : "center";
      context.fillText(written(value), this.toX(value) + (value === x.max ? 4 : 0), bottom + 12);
    }
    context.strokeRect(Math.round(left) + 0.5, Math.round(top) + 0.5, right - left - 1, bottom - top - 1);
    this.paintAxisNames(context);
  }

  paintGridLine(context, ...ends) {
    const [x0, y0, x1, y1] = ends.map((end) => Math.round(end) + 0.5);
    context.globalAlpha = 0.16;
    context.beginPath();
    context.moveTo(x0, y0);
    context.lineTo(x1, y1);
    context.stroke();
    context.globalAlpha = 1;
  }

  paintAxisNames(context) {
    const { left, right, top, bottom } = this;
    context.textAlign = "center";
    context.fillText(this.figure.x.label, (left + right) / 2, bottom + 31);
    context.save();
    context.translate(9, (top + bottom) / 2);
    context.rotate(-Math.PI / 2);
    context.fillText(shorten(context, this.figure.y.label, bottom - top), 0, 0);
    context.restore();
  }

  paintCurves(context) {
    context.save();
    context.beginPath();
    context.rect(this.left, this.top, this.right - this.left, this.bottom - this.top);
    context.clip();
    for (const curve of this.figure.series) this.paintCurve(context, curve);
    context.restore();
  }

  paintCurve(context, curve) {
    const { samples } = curve;
    const last = samples.length - 1;
    // Browsers drop paths that run off to enormous coordinates.
    const onCanvas = (y) => Math.min(2 * this.bottom, Math.max(-this.bottom, y));
    const stride = (this.right - this.left) / last;
    this.setLine(context, curve);
    context.beginPath();
    if (curve.mirrored) samples.forEach((value, i) => context.lineTo(this.toX(value), this.toY(i / last)));
    else samples.forEach((value, i) => context.lineTo(this.left + i * stride, onCanvas(this.toY(value))));
    context.stroke();
  }

  paintLegend(context, { curve, label, x, row }) {
    const [start, y] = [this.left + x, row * ROW + ROW / 2];
    this.setLine(context, curve);
    context.beginPath();
    context.moveTo(start, y);
    context.lineTo(start + LEGEND_LINE, y);
    context.stroke();
    context.textAlign = "left";
    context.fillText(label, start + LEGEND_LINE + 6, y);
  }
}
