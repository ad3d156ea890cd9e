// The geometry of a colour chart of 6 by 4 patches seen in perspective.

/** @typedef {[number, number]} Point */

const COLUMNS = 6;
const ROWS = 4;
const MARGIN = 0.25; // of a patch, left out on each side
const SAMPLES = 12; // a side of a patch, for its mean
const STRAIGHT = 1e-9; // a turn by less is none; the same as in Python

/** @type {Point[]} */
export const UNIT_SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]];

/** The part of each patch that is measured, row by row: [left, top, width, height] in the unit square. */
export const PATCHES = Array.from({ length: ROWS * COLUMNS }, (_, i) => [
  ((i % COLUMNS) + MARGIN) / COLUMNS,
  (Math.floor(i / COLUMNS) + MARGIN) / ROWS,
  (1 - 2 * MARGIN) / COLUMNS,
  (1 - 2 * MARGIN) / ROWS,
]);

/**
 * The projective map that takes the unit square to four points, clockwise from the origin.
 * @param {Point[]} corners
 * @returns {(point: Point) => Point}
 */
export function perspective([[x0, y0], [x1, y1], [x2, y2], [x3, y3]]) {
  const [ax, ay, bx, by] = [x1 - x2, y1 - y2, x3 - x2, y3 - y2];
  const [sx, sy] = [x0 - x1 + x2 - x3, y0 - y1 + y2 - y3];
  const area = ax * by - bx * ay;
  const [g, h] = [(sx * by - bx * sy) / area, (ax * sy - sx * ay) / area];
  return ([u, v]) => {
    const w = g * u + h * v + 1;
    return [
      (x0 + (x1 - x0 + g * x1) * u + (x3 - x0 + h * x3) * v) / w,
      (y0 + (y1 - y0 + g * y1) * u + (y3 - y0 + h * y3) * v) / w,
    ];
  };
}

// Whether four points turn clockwise all the way, so that a chart can lie between them.
export function turnsClockwise(/** @type {Point[]} */ corners) {
  return corners.every(([x, y], i) => {
    const [[x1, y1], [x2, y2]] = [corners[(i + 1) % 4], corners[(i + 2) % 4]];
    return (x1 - x) * (y2 - y1) - (y1 - y) * (x2 - x1) > STRAIGHT;
  });
}

/**
 * The mean colour of every patch, 24 times [red, green, blue].
 * @param {Pick<ImageData, "data" | "width" | "height">} pixels
 * @param {Point[]} corners shares of its width and height
 */
export function patchMeans(pixels, corners) {
  const toPhoto = perspective(corners);
  return PATCHES.map(([left, top, width, height]) => {
    const sum = [0, 0, 0];
    for (let i = 0; i < SAMPLES ** 2; i++) {
      const [across, down] = [(i % SAMPLES) + 0.5, Math.floor(i / SAMPLES) + 0.5];
      const point = toPhoto([left + (across / SAMPLES) * width, top + (down / SAMPLES) * height]);
      colourAt(pixels, point).forEach((value, k) => (sum[k] += value));
    }
    return sum.map((total) => total / SAMPLES ** 2);
  });
}

/**
 * @param {Pick<ImageData, "data" | "width" | "height">} pixels
 * @param {Point} point
 */
function colourAt({ data, width, height }, [x, y]) {
  /** @type {(share: number, size: number) => number} */
  const within = (share, size) => Math.min(size - 1, Math.max(0, Math.floor(share * size)));
  const at = 4 * (within(y, height) * width + within(x, width));
  return [data[at], data[at + 1], data[at + 2]];
}
