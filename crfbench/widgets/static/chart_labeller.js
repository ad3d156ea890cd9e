// The page's side of ChartLabeller: drags the corners and previews the patches; Python keeps the labels.

const CORNER_NAMES = ["dark skin", "bluish green", "black", "white"];
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const MOST_HEIGHT = 560; // of the photograph on the page
const LOUPE = 112; // its width on the page
const LOUPE_GAP = 20; // from its edge to the corner it shows
const LOUPE_PIXELS = 28; // of the picture sent, that it shows across
const NUMBER_DISTANCE = 26; // from a corner to its number
const HELP =
  "Drag the corners, or press Tab to reach one and the arrow keys to move it by one pixel of the photograph, " +
  "with Shift by ten. Ctrl+Z undoes.";

// A centred chart in the photograph's own proportions, for where nobody has placed one.
function firstCorners({ width, height }) {
  const across = Math.min(0.6 * width, 0.8 * height * 1.5);
  const [dx, dy] = [across / width / 2, across / 1.5 / height / 2];
  return [[0.5 - dx, 0.5 - dy], [0.5 + dx, 0.5 - dy], [0.5 + dx, 0.5 + dy], [0.5 - dx, 0.5 + dy]];
}

function centre(corners) {
  return [0, 1].map((axis) => corners.reduce((sum, corner) => sum + corner[axis], 0) / corners.length);
}

const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

// Lines that show on any photograph: the theme's blue over a light or dark edge.
class ChartSketch extends Sketch {
  tracePolygons(context, polygons, toCanvas) {
    context.beginPath();
    for (const points of polygons) {
      points.map(toCanvas).forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.closePath();
    }
  }

  strokeTwice(context, width) {
    context.lineJoin = "round";
    context.setLineDash([]);
    const core = width + Number(this.dark); // light on black looks thinner than dark on white
    context.lineWidth = core + 2;
    context.strokeStyle = this.dark ? "#000" : "#fff";
    context.stroke();
    this.setLine(context, { colour: "blue", dash: "solid", width: core });
    context.stroke();
  }
}

class PhotoSketch extends ChartSketch {
  constructor() {
    super("crf-photo");
  }

  // `figure`: { bitmap, corners, valid, description }
  draw(figure) {
    this.figure = figure;
    this.describe(figure.description);
    this.schedule();
  }

  paint(context) {
    const { bitmap, corners, valid } = this.figure;
    const toCanvas = ([x, y]) => [x * this.width, y * this.height];
    context.drawImage(bitmap, 0, 0, this.width, this.height);
    this.tracePolygons(context, [corners], toCanvas);
    this.strokeTwice(context, 2);
    if (!valid) return;
    const toPhoto = perspective(corners);
    const boxes = PATCHES.map(([x, y, w, h]) => UNIT_SQUARE.map(([u, v]) => toPhoto([x + u * w, y + v * h])));
    this.tracePolygons(context, boxes, toCanvas);
    this.strokeTwice(context, 1);
  }
}

// What lies about one corner, magnified.
class Loupe extends ChartSketch {
  constructor() {
    super("crf-loupe");
    this.canvas.setAttribute("aria-hidden", "true");
  }

  hide() {
    this.canvas.classList.remove("crf-shown");
  }

  // `figure`: { bitmap, corners, at }; `stage` is the size of the photograph on the page.
  show(figure, stage) {
    this.figure = figure;
    this.place(stage);
    this.canvas.classList.add("crf-shown");
    this.schedule();
  }

  // Beside the corner and inside the photograph, away from the chart if it can be, and never over the corner.
  place({ width, height }) {
    const size = [width, height];
    const corner = this.figure.corners[this.figure.at].map((share, axis) => share * size[axis]);
    const away = centre(this.figure.corners).map((share, axis) => (corner[axis] < share * size[axis] ? -1 : 1));
    const places = [[1, 1], [1, -1], [-1, 1], [-1, -1]].map((sides) =>
      sides.map((side, axis) => {
        const middle = corner[axis] + side * away[axis] * (LOUPE / 2 + LOUPE_GAP);
        return Math.max(LOUPE / 2, Math.min(size[axis] - LOUPE / 2, middle));
      }),
    );
    const clear = ([x, y]) => Math.hypot(x - corner[0], y - corner[1]) > LOUPE / 2 + LOUPE_GAP / 2;
    const [x, y] = places.find(clear) ?? places.at(-1);
    this.canvas.style.left = `${x - LOUPE / 2}px`;
    this.canvas.style.top = `${y - LOUPE / 2}px`;
  }

  paint(context) {
    const { bitmap, corners, at } = this.figure;
    const scale = this.width / LOUPE_PIXELS;
    const [x, y] = [corners[at][0] * bitmap.width, corners[at][1] * bitmap.height];
    const toCanvas = ([u, v]) => [
      (u * bitmap.width - x) * scale + this.width / 2,
      (v * bitmap.height - y) * scale + this.height / 2,
    ];
    context.fillStyle = this.dark ? "#222" : "#ddd"; // beyond the photograph
    context.fillRect(0, 0, this.width, this.height);
    context.imageSmoothingEnabled = false;
    const [left, top] = toCanvas([0, 0]);
    context.drawImage(bitmap, left, top, bitmap.width * scale, bitmap.height * scale);
    this.tracePolygons(context, [corners], toCanvas);
    this.strokeTwice(context, 1);
  }
}

class ChartLabellerView {
  constructor(model, root) {
    this.model = model;
    this.names = model.get("_names");
    this.undoable = [];
    this.photo = new PhotoSketch();
    this.loupe = new Loupe();
    this.root = element("div", { class: "crf" }, this.buildChoices(), this.buildBody());
    this.root.addEventListener("keydown", (event) => this.onUndoKeys(event));
    root.append(this.root);
    this.leaveTheme = followTheme(this.root, () => this.show());
    this.listeners = { "change:_picture": () => this.receive(), "change:_labels": () => this.heed() };
    for (const [event, listener] of Object.entries(this.listeners)) model.on(event, listener);
    this.receive();
  }

  destroy() {
    for (const [event, listener] of Object.entries(this.listeners)) this.model.off(event, listener);
    this.leaveTheme();
    this.photo.destroy();
    this.loupe.destroy();
    this.bitmap?.close();
  }

  buildChoices() {
    this.choice = labelledSelect("Photograph", this.names, (index) => this.go(index));
    this.choice.box.classList.add("crf-grow");
    const turn = element("div", { class: "crf-turn" });
    for (const [sign, step, title] of [["◀", -1, "previous photograph"], ["▶", 1, "next photograph"]]) {
      turn.append(button(sign, () => this.turn(step), { "aria-label": title, title }));
    }
    const copy = button("Copy corners to next", () => this.copyToNext());
    const undo = button("Undo", () => this.undo());
    return element("div", { class: "crf-choices" }, this.choice.box, turn, copy, undo);
  }

  buildBody() {
    this.handles = CORNER_NAMES.map((_, at) => this.buildHandle(at));
    this.stage = element("div", { class: "crf-stage" }, this.photo.canvas, this.loupe.canvas, ...this.handles);
    this.swatches = PATCHES.map(() => element("span"));
    this.preview = element("div", { class: "crf-swatches", role: "img" }, ...this.swatches);
    this.status = element("div", { class: "crf-status", role: "status" });
    const order = element("ol", { class: "crf-order" }, ...CORNER_NAMES.map((name) => element("li", {}, name)));
    const panel = element("div", { class: "crf-panel" }, this.status, element("div", {}, "Corners, clockwise:", order));
    panel.append(element("div", {}, "Means of the patches:", this.preview), element("p", { class: "crf-note" }, HELP));
    return element("div", { class: "crf-body" }, element("div", { class: "crf-plot" }, this.stage), panel);
  }

  buildHandle(at) {
    const handle = button(String(at + 1), () => {}, { class: "crf-corner", "data-number": at + 1 });
    handle.addEventListener("pointerdown", (event) => this.startDrag(event, at));
    handle.addEventListener("keydown", (event) => this.nudge(event, at));
    handle.addEventListener("focus", () => this.magnify(at));
    handle.addEventListener("blur", () => this.loupe.hide());
    return handle;
  }

  // --- which photograph

  go(index) {
    this.root.setAttribute("aria-busy", true);
    this.model.set("_index", index);
    this.model.save_changes();
  }

  turn(step) {
    const n = this.names.length;
    if (n > 1) this.go((this.model.get("_index") + step + n) % n);
  }

  async receive() {
    const picture = this.model.get("_picture");
    const bitmap = await createImageBitmap(new Blob([bytesOf(picture.jpeg)], { type: "image/jpeg" }));
    if (picture !== this.model.get("_picture")) return; // another one came meanwhile
    this.bitmap?.close();
    this.bitmap = bitmap;
    this.picture = picture;
    this.pixels = pixelsOf(bitmap);
    this.stage.style.aspectRatio = `${picture.width} / ${picture.height}`;
    this.stage.style.maxWidth = `${(MOST_HEIGHT * picture.width) / picture.height}px`;
    this.choice.input.selectedIndex = picture.index;
    this.follow();
    this.root.setAttribute("aria-busy", false);
  }

  // --- the labels

  get name() {
    return this.picture.name;
  }

  // Keeps what Python says; nothing done here before it can be undone any more.
  heed() {
    if (this.committing) return;
    this.undoable = [];
    if (this.picture) this.follow();
  }

  // Takes the corners of this photograph from the labels.
  follow(message) {
    this.corners = this.model.get("_labels")[this.name] ?? firstCorners(this.picture);
    this.message = message;
    this.show();
  }

  commit(name, corners, undoable = true) {
    const { [name]: before, ...labels } = this.model.get("_labels");
    if (undoable) this.undoable.push({ name, before });
    if (corners) labels[name] = corners;
    this.committing = true;
    this.model.set("_labels", labels);
    this.committing = false;
    this.model.save_changes();
  }

  undo() {
    const last = this.undoable.pop();
    if (!last) return this.follow("There is nothing to undo.");
    this.commit(last.name, last.before, false);
    if (last.name === this.name) this.follow();
    else this.go(this.names.indexOf(last.name));
  }

  onUndoKeys(event) {
    if (!(event.ctrlKey || event.metaKey) || event.shiftKey || event.key.toLowerCase() !== "z") return;
    event.preventDefault();
    this.undo();
  }

  copyToNext() {
    const next = this.picture.index + 1;
    if (!(this.name in this.model.get("_labels"))) return this.follow("Place the corners before you copy them.");
    if (next === this.names.length) return this.follow("This is the last photograph; there is none to copy to.");
    this.commit(this.names[next], this.corners);
    this.go(next);
  }

  // --- moving a corner

  startDrag(event, at) {
    if (event.button !== 0 || !this.picture) return;
    event.preventDefault();
    const handle = this.handles[at];
    handle.focus({ preventScroll: true });
    handle.setPointerCapture(event.pointerId);
    const [before, from] = [this.corners, [event.clientX, event.clientY]];
    const { width, height } = this.stage.getBoundingClientRect();
    const [x, y] = before[at];
    handle.onpointermove = ({ clientX, clientY }) =>
      this.move(at, [x + (clientX - from[0]) / width, y + (clientY - from[1]) / height]);
    handle.onpointerup = () => this.endDrag(handle, before, this.corners);
    handle.onpointercancel = () => this.endDrag(handle, before, before);
  }

  endDrag(handle, before, corners) {
    handle.onpointermove = handle.onpointerup = handle.onpointercancel = null;
    if (!same(before, corners)) this.commit(this.name, corners);
    this.follow();
  }

  nudge(event, at) {
    if (!(event.key in ARROWS) || event.ctrlKey || event.metaKey || event.altKey || !this.picture) return;
    event.preventDefault();
    const step = event.shiftKey ? 10 : 1;
    const [dx, dy] = ARROWS[event.key];
    const [x, y] = this.corners[at];
    const before = this.corners;
    this.move(at, [x + (step * dx) / this.picture.width, y + (step * dy) / this.picture.height]);
    if (!same(before, this.corners)) this.commit(this.name, this.corners);
    this.follow();
  }

  move(at, point) {
    const inside = point.map((share) => Math.min(1, Math.max(0, share)));
    this.corners = this.corners.map((corner, i) => (i === at ? inside : corner));
    this.show();
  }

  // --- what is seen

  magnify(at) {
    if (!this.picture) return;
    this.loupe.show({ bitmap: this.bitmap, corners: this.corners, at }, this.stage.getBoundingClientRect());
  }

  show() {
    if (!this.picture) return;
    const valid = turnsClockwise(this.corners);
    const description = `Photograph ${this.name} with the chart`;
    this.photo.draw({ bitmap: this.bitmap, corners: this.corners, valid, description });
    this.showHandles();
    this.showMeans(valid);
    const text = this.message ?? this.describe(valid);
    if (this.status.textContent !== text) this.status.textContent = text;
    const held = this.handles.indexOf(this.root.ownerDocument.activeElement);
    if (held >= 0) this.magnify(held);
  }

  showHandles() {
    const { width, height } = this.picture;
    const middle = centre(this.corners);
    const stage = this.stage.getBoundingClientRect();
    this.handles.forEach((handle, at) => {
      const [x, y] = this.corners[at];
      const away = Math.atan2((y - middle[1]) * height, (x - middle[0]) * width);
      handle.style.left = `${100 * x}%`;
      handle.style.top = `${100 * y}%`;
      // Towards the chart where the photograph ends.
      const inside = (shift, from, size) => (from + shift < 9 || from + shift > size - 9 ? -shift : shift);
      const [dx, dy] = [NUMBER_DISTANCE * Math.cos(away), NUMBER_DISTANCE * Math.sin(away)];
      handle.style.setProperty("--crf-dx", `${inside(dx, x * stage.width, stage.width)}px`);
      handle.style.setProperty("--crf-dy", `${inside(dy, y * stage.height, stage.height)}px`);
      const place = `x ${(x * width).toFixed(1)}, y ${(y * height).toFixed(1)}`;
      handle.setAttribute("aria-label", `corner ${at + 1} of 4, ${CORNER_NAMES[at]}: ${place}`);
    });
  }

  showMeans(valid) {
    const texts = valid ? patchMeans(this.pixels, this.corners).map((mean) => mean.map(Math.round).join(" ")) : [];
    this.swatches.forEach((swatch, i) => {
      swatch.style.backgroundColor = valid ? `rgb(${texts[i]})` : "transparent";
      swatch.title = valid ? `patch ${i + 1}: ${texts[i]}` : "";
    });
    const text = valid ? `red green blue of the 24 patches: ${texts.join(", ")}` : "no patches";
    this.preview.setAttribute("aria-label", text);
  }

  describe(valid) {
    const labels = this.model.get("_labels");
    const count = `${this.names.filter((name) => name in labels).length} of ${this.names.length} labelled.`;
    if (!valid) return `The corners cross or run anticlockwise: bring them into the order below. ${count}`;
    return `${this.name in labels ? "This photograph is labelled" : "Drag the four corners onto the chart"}; ${count}`;
  }
}

function pixelsOf(bitmap) {
  const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d");
  context.drawImage(bitmap, 0, 0);
  return context.getImageData(0, 0, bitmap.width, bitmap.height);
}

function render({ model, el }) {
  const view = new ChartLabellerView(model, el);
  return () => view.destroy();
}

export default { render };
