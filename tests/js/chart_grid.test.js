// The geometry of the chart: perspective, order of the corners, means of the patches.

import assert from "node:assert/strict";
import { test } from "node:test";

import { PATCHES, patchMeans, perspective, turnsClockwise, UNIT_SQUARE } from "../../crfbench/widgets/static/chart_grid.js";

const CORNERS = [[0.21, 0.24], [0.8, 0.17], [0.86, 0.78], [0.15, 0.7]];

const near = (found, expected, tolerance = 1e-12) =>
  found.forEach((value, i) => assert.ok(Math.abs(value - expected[i]) < tolerance, `${found} is not ${expected}`));

test("perspective takes the corners of the square to the corners given", () => {
  UNIT_SQUARE.forEach((corner, i) => near(perspective(CORNERS)(corner), CORNERS[i]));
});

test("perspective of a parallelogram is affine", () => {
  const map = perspective([[0.1, 0.2], [0.7, 0.3], [0.9, 0.8], [0.3, 0.7]]);
  near(map([0.5, 0.5]), [0.5, 0.5]);
  near(map([0.25, 0]), [0.25, 0.225]);
});

test("perspective keeps straight lines straight and the diagonals' crossing", () => {
  const map = perspective(CORNERS);
  const across = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
  for (const u of [0.1, 0.4, 0.9]) near([across(map([0, u]), map([0.3, u]), map([1, u]))], [0]);
  // The middle of the square lies on both diagonals, so its image lies on both of theirs.
  near([across(CORNERS[0], map([0.5, 0.5]), CORNERS[2]), across(CORNERS[1], map([0.5, 0.5]), CORNERS[3])], [0, 0]);
});

test("perspective is the inverse of a homography that is known", () => {
  const known = ([u, v]) => {
    const w = 0.3 * u - 0.2 * v + 1;
    return [(0.5 * u + 0.1 * v + 0.2) / w, (-0.05 * u + 0.6 * v + 0.1) / w];
  };
  const map = perspective(UNIT_SQUARE.map(known));
  for (const point of [[0.2, 0.7], [0.9, 0.1], [0.5, 0.5]]) near(map(point), known(point));
});

test("only corners that turn clockwise can be a chart's", () => {
  assert.ok(turnsClockwise(CORNERS));
  assert.ok(!turnsClockwise([...CORNERS].reverse()));
  assert.ok(!turnsClockwise([CORNERS[1], CORNERS[0], CORNERS[2], CORNERS[3]]), "crossed");
  assert.ok(!turnsClockwise([[0, 0], [0.5, 0], [1, 0], [0, 1]]), "three in a line");
  assert.ok(!turnsClockwise([[0, 0], [1, 0], [0.2, 0.2], [0, 1]]), "a corner that points inwards");
});

test("24 patches of equal size lie row by row inside the square", () => {
  assert.equal(PATCHES.length, 24);
  near(PATCHES[0], [1 / 24, 1 / 16, 1 / 12, 1 / 8]);
  near(PATCHES[7], [1 / 6 + 1 / 24, 1 / 4 + 1 / 16, 1 / 12, 1 / 8]);
  near([PATCHES[23][0] + PATCHES[23][2], PATCHES[23][1] + PATCHES[23][3]], [1 - 1 / 24, 1 - 1 / 16]);
});

test("means are those of the pixels in each patch", () => {
  const [width, height] = [120, 80];
  const data = new Uint8ClampedArray(4 * width * height);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      // A chart that fills the picture: red tells the column, green the row.
      const [column, row] = [Math.floor((6 * x) / width), Math.floor((4 * y) / height)];
      data.set([10 * column, 20 * row, 200, 255], 4 * (y * width + x));
    }
  }
  const means = patchMeans({ data, width, height }, UNIT_SQUARE);
  means.forEach((mean, i) => near(mean, [10 * (i % 6), 20 * Math.floor(i / 6), 200]));
});
