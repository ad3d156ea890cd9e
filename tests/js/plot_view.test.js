// Zoom as parts of axes, and what a hand on a plot finds.

import assert from "node:assert/strict";
import { test } from "node:test";

import { further, inner, nearestOn, scaled, shown, valueAt, within } from "../../crfbench/widgets/static/plot_view.js";

const near = (found, expected) => found.forEach((value, i) => assert.ok(Math.abs(value - expected[i]) < 1e-12, `${found}`));

test("a part stays within the axis, as long as it was where it can be", () => {
  near(within(0.2, 0.5), [0.2, 0.5]);
  near(within(-0.2, 0.3), [0, 0.5]);
  near(within(0.9, 1.3), [0.6, 1]);
  near(within(-3, 5), [0, 1]);
  const [from, to] = within(0.5, 0.5);
  assert.ok(to > from, "never nothing");
});

test("a box within a part is the part of the whole that it covers", () => {
  near(inner([0.5, 1], 0.2, 0.6), [0.6, 0.8]);
  near(inner([0.2, 0.4], 0.5, 1.5), [0.3, 0.5]);
});

test("zoom keeps its place, and out is the way back from in", () => {
  for (const at of [0, 0.3, 1]) {
    const part = scaled([0.2, 0.6], 0.5, at);
    near([part[0] + at * (part[1] - part[0])], [0.2 + at * 0.4]);
    near(scaled(part, 2, at), [0.2, 0.6]);
  }
  near(scaled([0.2, 0.6], 100, 0.5), [0, 1]);
});

test("parts of an axis are shares of what is drawn, logarithms too", () => {
  assert.deepEqual(shown({ label: "x", min: -1, max: 3 }, [0.25, 0.5]), { label: "x", min: 0, max: 1 });
  const log = shown({ min: 1, max: 10000, log: true }, [0.25, 0.75]);
  near([log.min / 10, log.max / 1000], [1, 1]);
  const whole = { min: -0.1, max: 1.1 };
  assert.equal(shown(whole, [0, 1]), whole);
  near([valueAt(log, 0.5) / 100], [1]);
});

const trace = (points, joined = false) => ({ n: points.length, at: (i) => points[i], joined });

test("the nearest of points that stand alone is found, and the nearest place of a line", () => {
  const points = [[0, 0], [10, 0], [10, 10]];
  assert.deepEqual(nearestOn(trace(points), 4, 3), { i: 0, x: 0, y: 0, distance: 5 });
  assert.deepEqual(nearestOn(trace(points, true), 4, 3), { i: 0, x: 4, y: 0, distance: 3 });
  assert.deepEqual(nearestOn(trace(points, true), 12, 8), { i: 2, x: 10, y: 8, distance: 2 });
  assert.equal(nearestOn(trace([]), 1, 1).i, -1);
});

test("the keyboard goes from left to right through what is shown", () => {
  const points = trace([[50, 0], [10, 5], [30, 9], [90, 1]]);
  assert.equal(further(points, -1, 1, [0, 100]), 1);
  assert.deepEqual([1, 2, 0, 3].map((i) => further(points, i, 1, [0, 100])), [2, 0, 3, 3]);
  assert.deepEqual([3, 0, 2, 1].map((i) => further(points, i, -1, [0, 100])), [0, 2, 1, 1]);
  assert.equal(further(points, 0, 1, [20, 60]), 0, "no further than the end of what is shown");
  assert.equal(further(points, 1, 1, [20, 60]), 2, "what is no longer shown starts from the end");
  assert.equal(further(points, 1, 1, [60, 80]), null);
});
