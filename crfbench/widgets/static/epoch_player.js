// The page's side of EpochPlayer: it gets all epochs at once, so that playing and dragging need no Python.

const SPEED = 12; // epochs kept, a second
const CALM_STEP = 12; // the same way in one step a second, for who asks for less motion
const calm = window.matchMedia("(prefers-reduced-motion: reduce)");

class EpochPlayerView {
  constructor(model, root) {
    this.model = model;
    this.frame = 0;
    this.columns = [];
    this.play = button("Play", () => this.toggle(), { class: "crf-main crf-toggle" });
    this.slider = labelledSlider("Epoch", { min: 0, max: 0, step: 1 }, (position) => this.moveByHand(position));
    this.status = element("div", { class: "crf-status", role: "status" });
    this.grid = element("div", { class: "crf-columns" });
    this.root = element("div", { class: "crf crf-player" });
    const note = element("p", { class: "crf-note" }, NOTE);
    this.root.append(element("div", { class: "crf-play" }, this.play, this.slider.box), note, this.status, this.grid);
    root.append(this.root);
    this.leaveTheme = followTheme(this.root, () => this.columns.forEach((column) => column.repaint()));
    this.update = this.update.bind(this);
    model.on("change:_columns", this.update);
    this.update();
  }

  destroy() {
    this.model.off("change:_columns", this.update);
    this.pause();
    this.leaveTheme();
    for (const column of this.columns) column.destroy();
  }

  // New columns leave the epoch where it is; at first it is the last, what training led to.
  update() {
    const known = this.runs?.map(({ name }) => name);
    this.runs = this.model.get("_columns").map((packed) => new Run(packed));
    this.timeline = [...new Set(this.runs.flatMap(({ epochs }) => epochs))].sort((a, b) => a - b);
    const epoch = this.epoch ?? this.timeline.at(-1);
    this.rebuild();
    this.slider.input.max = this.timeline.length - 1;
    this.move(this.timeline.findLastIndex((kept) => kept <= epoch));
    this.tell(this.runs.filter(({ name }) => known && !known.includes(name)));
  }

  tell(joined) {
    this.status.textContent = joined.map(({ name }) => `${name} is here now.`).join(" ");
  }

  rebuild() {
    for (const column of this.columns) column.destroy();
    this.columns = this.runs.map(() => new LatentColumn());
    this.grid.replaceChildren(...this.columns.map(({ box }) => box));
  }

  move(position) {
    this.position = position;
    this.epoch = this.timeline[position];
    this.slider.show(position, `${this.epoch} of ${this.timeline.at(-1)}`);
    this.columns.forEach((column, i) => column.show(this.runs[i], this.epoch));
  }

  moveByHand(position) {
    this.pause();
    this.move(position);
  }

  toggle() {
    if (this.frame) return this.pause();
    const last = this.timeline.length - 1;
    this.start(this.position < last ? this.position : 0);
  }

  start(from) {
    this.play.textContent = "Pause";
    const began = performance.now();
    const next = (now) => {
      this.frame = requestAnimationFrame(next);
      this.advance(from + this.way(Math.max(0, now - began) / 1000));
    };
    this.frame = requestAnimationFrame(next);
  }

  way(seconds) {
    return calm.matches ? CALM_STEP * Math.floor(seconds) : Math.floor(SPEED * seconds);
  }

  advance(position) {
    const last = this.timeline.length - 1;
    if (position !== this.position) this.move(Math.min(position, last));
    if (position >= last) this.pause();
  }

  pause() {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.play.textContent = "Play";
  }
}

function render({ model, el }) {
  const view = new EpochPlayerView(model, el);
  return () => view.destroy();
}

export default { render };
