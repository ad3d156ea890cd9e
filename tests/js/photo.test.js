import assert from "node:assert/strict";
import { test } from "node:test";

import { placeOf, tableOf, unchanged, heightAt } from "../../crfbench/widgets/static/photo.js";
import { lightAt, renderScene } from "../../crfbench/widgets/static/scene.js";

const near = (a, b, within = 1e-9) => assert.ok(Math.abs(a - b) <= within, `${a} is not ${b}`);
const GRID = Array.from({ length: 1024 }, (_, i) => i / 1023);

test("a place on a rising curve and the value there undo each other", () => {
  const curve = GRID.map((x) => x ** 2.2);
  for (const place of [0, 0.0004, 0.1, 0.77, 1]) near(placeOf(curve, heightAt(curve, place)), place, 1e-6);
});

test("what no value of the curve reaches lies at an end, and a flat or falling stretch at its beginning", () => {
  assert.equal(placeOf([0.2, 0.8], 0.1), 0);
  assert.equal(placeOf([0.2, 0.8], 0.9), 1);
  assert.equal(placeOf([0, 0.5, 0.5, 0.4, 1], 0.5), 0.25);
});

test("an inverse response makes the same picture as the response", () => {
  const levels = Float64Array.from({ length: 64 }, (_, i) => (i / 63) ** 2);
  const forward = tableOf(levels, GRID.map((x) => x ** 0.5));
  const inverse = tableOf(levels, GRID.map((x) => x ** 2), true);
  for (let i = 8; i < 64; i++) near(forward[i], inverse[i], 1); // below, a line between samples is no square root
  assert.deepEqual([...unchanged(levels)], Array.from(levels, (level) => Math.round(255 * level)));
});

test("the scene is light between 0 and 1, the same each time, with steps of one stop", () => {
  const { width, height, codes, levels } = renderScene();
  assert.equal(codes.length, 3 * width * height);
  assert.deepEqual(codes, renderScene().codes);
  assert.ok(codes.every((code) => code < levels.length));
  const steps = Array.from({ length: 9 }, (_, i) => lightAt((i + 0.5) / 9, 0.9)[1]);
  steps.slice(1).forEach((step, i) => near(step / steps[i], 0.5));
});
