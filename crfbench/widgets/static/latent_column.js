// One training at one epoch: the histogram of its latents and curves that it decodes. Shared by EpochPlayer and
// TrainingPanel; joined in front of their modules, after plot.js.

const REACH = 5; // latents shown to either side of 0; those beyond count in the outermost bars
const BAR = 0.25; // width of a bar
const MOST = 0.8; // density at the top of the histogram: twice the peak of N(0, 1)
const PROBE_COUNT = 9; // curves decoded at each epoch, from z = -2 to z = 2

const NOTE =
  "Bars: latents of the n training curves, density in bars of 0.25 (beyond ±5: in the outermost; above 0.8: cut). " +
  "Dashed outline: N(0,\u00a01). Below, decoded curves (relative, 0 to 1): z from −2 to −0.5 dashed, blue; 0 thick, green; 0.5 to 2 thin, orange.";

const normalDensity = Array.from({ length: 81 }, (_, i) => Math.exp(-((i / 8 - 5) ** 2) / 2) / Math.sqrt(2 * Math.PI));

// The number that 16 bits stand for: sign, 5 bits of exponent, 10 of fraction (IEEE 754, without infinities).
function half(bits) {
  const exponent = (bits >> 10) & 31;
  const fraction = (bits & 1023) / 1024;
  const size = exponent === 0 ? fraction * 2 ** -14 : (1 + fraction) * 2 ** (exponent - 15);
  return bits & 0x8000 ? -size : size;
}

function formatFigure(value) {
  return value.toFixed(3).replace("-", "−");
}

// What Python packed of one training; rows are the epochs kept.
class Run {
  constructor({ name, epochs, xLabel, yLabel, latents, probes, figures }) {
    Object.assign(this, { name, epochs, xLabel, yLabel });
    this.latents = Float32Array.from(uint16(latents), half);
    this.probes = new Uint8Array(bytesOf(probes));
    this.figures = float32(figures);
    this.size = this.latents.length / epochs.length;
  }

  get last() {
    return this.epochs.at(-1);
  }

  // The row of the latest epoch that is not after `epoch`.
  rowAt(epoch) {
    return Math.max(0, this.epochs.findLastIndex((kept) => kept <= epoch));
  }

  part(numbers, row) {
    const length = numbers.length / this.epochs.length;
    return numbers.subarray(row * length, (row + 1) * length);
  }

  counts(row) {
    const counts = new Array((2 * REACH) / BAR).fill(0);
    for (const z of this.part(this.latents, row)) {
      counts[Math.max(0, Math.min(counts.length - 1, Math.floor((z + REACH) / BAR)))] += 1;
    }
    return counts;
  }

  curves(row) {
    const samples = this.part(this.probes, row);
    const length = samples.length / PROBE_COUNT;
    return Array.from({ length: PROBE_COUNT }, (_, i) =>
      Array.from(samples.subarray(i * length, (i + 1) * length), (share) => share / 255),
    );
  }
}

// Axes with their names and no legend.
class SmallPlot extends CurvePlot {
  constructor() {
    super();
    this.canvas.className = "crf-small";
  }

  paint(context) {
    this.place(0);
    this.paintAxes(context);
    this.paintCurves(context);
  }
}

class HistogramPlot extends SmallPlot {
  show(run, row) {
    const counts = run.counts(row);
    this.canvas.dataset.counts = counts; // the numbers behind the picture, for who inspects it
    this.draw({
      x: { label: "latent z", min: -REACH, max: REACH, gap: 32 },
      y: { label: "density", min: 0, max: MOST },
      series: [{ samples: normalDensity, colour: "vermilion", dash: "dashed", width: 1.5 }],
      shares: counts.map((count) => count / run.size),
      description: `Histogram of the latents of ${run.name} at epoch ${run.epochs[row]} beside N(0, 1)`,
    });
  }

  paintCurves(context) {
    context.fillStyle = COLOURS.blue[Number(this.dark)];
    context.globalAlpha = 0.6;
    this.figure.shares.forEach((share, i) => {
      const [left, right] = [i, i + 1].map((edge) => Math.round(this.toX(edge * BAR - REACH)));
      const top = Math.round(this.toY(Math.min(MOST, share / BAR)));
      context.fillRect(left, top, right - left, Math.round(this.bottom) - top);
    });
    context.globalAlpha = 1;
    super.paintCurves(context);
  }
}

class ProbePlot extends SmallPlot {
  show(run, row) {
    this.draw({
      x: { label: run.xLabel, min: 0, max: 1 },
      y: { label: run.yLabel, min: 0, max: 1 },
      series: run.curves(row).map((samples, i) => ({ samples, ...this.look(i - (PROBE_COUNT - 1) / 2) })),
      description: `Curves that ${run.name} decodes from latents of −2 to 2 at epoch ${run.epochs[row]}`,
    });
  }

  look(side) {
    if (side === 0) return { colour: "green", dash: "solid", width: 3 };
    return side < 0 ? { colour: "blue", dash: "dashed", width: 1.2 } : { colour: "vermilion", dash: "solid", width: 1.2 };
  }
}

class LatentColumn {
  constructor() {
    this.title = element("div", { class: "crf-title" });
    this.caption = element("p", { class: "crf-note" });
    this.plots = [new HistogramPlot(), new ProbePlot()];
    this.readouts = readouts(["mean", "sd", "KL", "KS"]);
    const canvases = this.plots.map(({ canvas }) => canvas);
    this.box = element("div", { class: "crf-column", role: "group" });
    this.box.append(this.title, this.caption, ...canvases, this.readouts.box);
  }

  // A training that ended earlier stays at its last epoch.
  show(run, epoch) {
    const row = run.rowAt(epoch);
    this.title.textContent = this.title.title = run.name;
    this.box.setAttribute("aria-label", run.name);
    const kept = `${epoch > run.last ? "ended at" : "epoch"} ${run.epochs[row]}`;
    this.caption.textContent = `${kept}, n = ${run.size}`;
    for (const plot of this.plots) plot.show(run, row);
    this.readouts.show(Array.from(run.part(run.figures, row), formatFigure));
  }

  repaint() {
    for (const plot of this.plots) plot.schedule();
  }

  destroy() {
    for (const plot of this.plots) plot.destroy();
  }
}
