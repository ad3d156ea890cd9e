// The choice of Algorithm 1 and the Pareto front, as the page finds them.

import assert from "node:assert/strict";
import { test } from "node:test";

import { choose, gridOrder, staircase, stepAt } from "../../crfbench/widgets/static/search_explorer.js";

const candidates = (...complexities) => complexities.map((complexity) => ({ complexity }));

test("the choice is the least complex of the m most accurate", () => {
  const found = candidates(50, 70, 20, 30, 10);
  assert.deepEqual([1, 2, 3, 4, 5].map((m) => choose(found, m)), [0, 0, 2, 2, 4]);
});

test("of equally complex candidates the more accurate is chosen", () => {
  assert.equal(choose(candidates(50, 20, 20), 3), 1);
});

test("the Pareto front is drawn as stairs, from the least complex on", () => {
  const found = [
    { complexity: 90, mse: 1, front: true },
    { complexity: 95, mse: 2, front: false },
    { complexity: 40, mse: 3, front: true },
    { complexity: 10, mse: 5, front: true },
  ];
  assert.deepEqual(staircase(found, 100), { x: [10, 40, 40, 90, 90, 100], y: [5, 5, 3, 3, 1, 1] });
});

test("the search sees the candidates in the order of the grid", () => {
  const found = [[50, 20], [10], [500], [50], [50, 20, 10], [50, 100]].map((hidden) => ({ hidden }));
  const seen = gridOrder(found).map((i) => found[i].hidden.join());
  assert.deepEqual(seen, ["10", "50", "50,20", "50,20,10", "50,100", "500"]);
});

test("Algorithm 1 stores every candidate once, in four lines each, and chooses then", () => {
  const n = 3;
  const steps = Array.from({ length: 4 * n + 5 }, (_, t) => stepAt(t, n));
  const lines = steps.map(({ line }) => line);
  assert.deepEqual(lines, [1, 3, 4, 5, 6, 3, 4, 5, 6, 3, 4, 5, 6, 8, 9, 10, 11]);
  assert.deepEqual(steps.filter(({ line }) => line === 6).map(({ k, stored }) => [k, stored]), [[0, 1], [1, 2], [2, 3]]);
  assert.deepEqual(steps.filter(({ line }) => line === 3).map(({ stored }) => stored), [0, 1, 2]);
  assert.equal(stepAt(4 * n + 5, n).line, 0, "all is done");
});
