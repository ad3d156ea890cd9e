// What a hand does on a plot, without the page: it takes parts of an axis, and finds what is nearest.

/** @typedef {[number, number]} Part from which share of a whole axis to which it is shown */

const LEAST = 1 / 200; // of the axis, that can still be shown

/**
 * The part from one share to another, moved into the axis, and neither longer than it nor too short.
 * @param {number} from
 * @param {number} to
 * @returns {Part}
 */
export function within(from, to) {
  const length = Math.min(1, Math.max(LEAST, to - from));
  const start = Math.min(1 - length, Math.max(0, (from + to - length) / 2));
  return [start, start + length];
}

// A part of the part shown, whose shares of it are given; below 0 and above 1 they lead out of it.
export function inner(/** @type {Part} */ [from, to], /** @type {number} */ start, /** @type {number} */ end) {
  return within(from + start * (to - from), from + end * (to - from));
}

// `factor` times as long, with the place at a share of it where it was.
export function scaled(/** @type {Part} */ part, /** @type {number} */ factor, /** @type {number} */ at) {
  return inner(part, at - at * factor, at + (1 - at) * factor);
}

/**
 * @param {import("./plot.js").Axis} axis
 * @param {number} share
 */
export function valueAt({ min, max, log }, share) {
  return log ? min * (max / min) ** share : min + share * (max - min);
}

/**
 * @param {import("./plot.js").Axis} axis the whole
 * @param {Part} part
 */
export function shown(axis, [from, to]) {
  return to - from === 1 ? axis : { ...axis, min: valueAt(axis, from), max: valueAt(axis, to) };
}

/**
 * Points on the canvas, joined by a line or not.
 * @typedef {{ n: number, at: (i: number) => [number, number], joined?: boolean }} Trace
 */

/**
 * Where points, or the line that joins them, come nearest to a place; `i` is the nearest point's, -1 without points.
 * @param {Trace} trace
 * @param {number} x
 * @param {number} y
 */
export function nearestOn({ n, at, joined }, x, y) {
  const best = { i: -1, x: 0, y: 0, distance: Infinity };
  let [lastX, lastY] = n ? at(0) : [0, 0];
  for (let i = 0; i < n; i++) {
    const [nextX, nextY] = at(i);
    const [dx, dy] = joined ? [nextX - lastX, nextY - lastY] : [0, 0];
    // How far along the piece of line that ends here; 1 is its end, where points stand alone.
    const along = dx || dy ? Math.min(1, Math.max(0, ((x - lastX) * dx + (y - lastY) * dy) / (dx * dx + dy * dy))) : 1;
    const [atX, atY] = [nextX - (1 - along) * dx, nextY - (1 - along) * dy];
    const distance = Math.hypot(atX - x, atY - y);
    if (distance < best.distance) Object.assign(best, { i: along < 0.5 ? i - 1 : i, x: atX, y: atY, distance });
    [lastX, lastY] = [nextX, nextY];
  }
  return best;
}

/**
 * The point `step` places further right among those between two ends, or the last there is; null where none is.
 * @param {Trace} trace
 * @param {number} i from which to go
 * @param {number} step
 * @param {[number, number]} ends
 */
export function further({ n, at }, i, step, [left, right]) {
  const seen = Array.from({ length: n }, (_, k) => k).filter((k) => at(k)[0] >= left - 0.5 && at(k)[0] <= right + 0.5);
  if (!seen.length) return null;
  seen.sort((a, b) => at(a)[0] - at(b)[0] || a - b);
  const place = seen.indexOf(i);
  if (place < 0) return seen[step > 0 ? 0 : seen.length - 1];
  return seen[Math.min(seen.length - 1, Math.max(0, place + step))];
}
