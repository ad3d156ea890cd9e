// What ChartLabeller paints: the photograph under the chart's outlines, and a magnifier at one corner.

import { PATCHES, perspective, UNIT_SQUARE } from "./chart_grid.js";
import { Sketch } from "./plot.js";

/**
 * @typedef {import("./chart_grid.js").Point} Point
 * @typedef {{ bitmap: ImageBitmap, corners: Point[], valid: boolean, description: string }} Photo
 * @typedef {{ bitmap: ImageBitmap, corners: Point[], at: number, description?: string }} Corner
 */

const LOUPE = 112; // its width on the page
const LOUPE_GAP = 20; // from its edge to the corner it shows
const LOUPE_PIXELS = 28; // of the picture sent, that it shows across

export function centre(/** @type {Point[]} */ corners) {
  return [0, 1].map((axis) => corners.reduce((sum, corner) => sum + corner[axis], 0) / corners.length);
}

/**
 * Lines that show on any photograph: the theme's blue over a light or dark edge.
 * @template {Photo | Corner} F
 * @extends {Sketch<F>}
 */
class ChartSketch extends Sketch {
  /**
   * @param {Point[][]} polygons
   * @param {(point: Point) => Point} toCanvas
   * @param {number} width
   */
  outline(polygons, toCanvas, width) {
    const { context } = this;
    context.beginPath();
    for (const points of polygons) {
      for (const [i, point] of points.entries()) {
        const [x, y] = toCanvas(point);
        if (i === 0) context.moveTo(x, y);
        else context.lineTo(x, y);
      }
      context.closePath();
    }
    const core = width + Number(this.dark); // light on black looks thinner than dark on white
    this.setLine({ width: core + 2 });
    context.strokeStyle = this.dark ? "#000" : "#fff";
    context.stroke();
    this.setLine({ colour: "blue", width: core });
    context.stroke();
  }
}

/**
 * The outline of the chart, and its patches where the corners are valid.
 * @extends {ChartSketch<Photo>}
 */
export class PhotoSketch extends ChartSketch {
  constructor() {
    super("crf-photo");
  }

  paint() {
    const { bitmap, corners, valid } = /** @type {Photo} */ (this.figure);
    /** @type {(point: Point) => Point} */
    const toCanvas = ([x, y]) => [x * this.width, y * this.height];
    this.context.drawImage(bitmap, 0, 0, this.width, this.height);
    this.outline([corners], toCanvas, 2);
    if (!valid) return;
    const toPhoto = perspective(corners);
    const boxes = PATCHES.map(([x, y, w, h]) => UNIT_SQUARE.map(([u, v]) => toPhoto([x + u * w, y + v * h])));
    this.outline(boxes, toCanvas, 1);
  }
}

/**
 * What lies about one corner, magnified.
 * @extends {ChartSketch<Corner>}
 */
export class Loupe extends ChartSketch {
  constructor() {
    super("crf-loupe");
    this.canvas.setAttribute("aria-hidden", "true");
  }

  hide() {
    this.canvas.classList.remove("crf-shown");
  }

  /**
   * @param {Corner} figure
   * @param {{ width: number, height: number }} stage the size of the photograph on the page
   */
  show(figure, stage) {
    this.figure = figure;
    this.place(figure, [stage.width, stage.height]);
    this.canvas.classList.add("crf-shown");
    this.schedule();
  }

  // Beside the corner and inside the photograph, away from the chart if it can be, and never over the corner.
  place(/** @type {Corner} */ { corners, at }, /** @type {number[]} */ size) {
    const corner = corners[at].map((share, axis) => share * size[axis]);
    const away = centre(corners).map((share, axis) => (corner[axis] < share * size[axis] ? -1 : 1));
    const places = [[1, 1], [1, -1], [-1, 1], [-1, -1]].map((sides) =>
      sides.map((side, axis) => {
        const middle = corner[axis] + side * away[axis] * (LOUPE / 2 + LOUPE_GAP);
        return Math.max(LOUPE / 2, Math.min(size[axis] - LOUPE / 2, middle));
      }),
    );
    const clear = places.find(([x, y]) => Math.hypot(x - corner[0], y - corner[1]) > LOUPE / 2 + LOUPE_GAP / 2);
    const [x, y] = clear ?? places[places.length - 1];
    this.canvas.style.left = `${x - LOUPE / 2}px`;
    this.canvas.style.top = `${y - LOUPE / 2}px`;
  }

  paint() {
    const { context } = this;
    const { bitmap, corners, at } = /** @type {Corner} */ (this.figure);
    const zoom = this.width / LOUPE_PIXELS;
    const [x, y] = [corners[at][0] * bitmap.width, corners[at][1] * bitmap.height];
    /** @type {(point: Point) => Point} */
    const toCanvas = ([u, v]) => [
      (u * bitmap.width - x) * zoom + this.width / 2,
      (v * bitmap.height - y) * zoom + this.height / 2,
    ];
    context.fillStyle = this.dark ? "#222" : "#ddd"; // beyond the photograph
    context.fillRect(0, 0, this.width, this.height);
    context.imageSmoothingEnabled = false;
    const [left, top] = toCanvas([0, 0]);
    context.drawImage(bitmap, left, top, bitmap.width * zoom, bitmap.height * zoom);
    this.outline([corners], toCanvas, 1);
  }
}
