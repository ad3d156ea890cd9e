// How the cells of a table are ordered.

import assert from "node:assert/strict";
import { test } from "node:test";

import { compare } from "../../crfbench/widgets/static/sortable_table.js";

const sorted = (values, sign) => [...values].sort((a, b) => compare(a, b, sign));

test("numbers sort by value, not as text", () => {
  assert.deepEqual(sorted([10, 9, -1], 1), [-1, 9, 10]);
  assert.deepEqual(sorted([10, 9, -1], -1), [10, 9, -1]);
});

test("missing values come last either way", () => {
  assert.deepEqual(sorted([null, 2, null, 1], 1), [1, 2, null, null]);
  assert.deepEqual(sorted([null, 1, null, 2], -1), [2, 1, null, null]);
});

test("text sorts by letters", () => {
  assert.deepEqual(sorted(["EMoR", "Gamma", "EMoR"], -1), ["Gamma", "EMoR", "EMoR"]);
});
