import assert from "node:assert/strict";
import { test } from "node:test";

import { float32, logTicks, scale, ticks, uint16 } from "../../crfbench/widgets/static/plot.js";

test("ticks are about as many round numbers as asked for, ends included", () => {
  assert.deepEqual(ticks({ min: 0, max: 1 }, 5), [0, 0.2, 0.4, 0.6, 0.8, 1]);
  assert.deepEqual(ticks({ min: -0.1, max: 1.1 }, 6), [0, 0.2, 0.4, 0.6, 0.8, 1]);
  assert.deepEqual(ticks({ min: -4, max: 4 }, 5), [-4, -2, 0, 2, 4]);
  assert.deepEqual(ticks({ min: 0, max: 0.8 }, 3), [0, 0.5]);
});

test("ticks are round for any range", () => {
  for (const max of [3e-7, 0.012, 0.8, 7, 96, 12345]) {
    for (const count of [2, 5, 9]) {
      const found = ticks({ min: 0, max }, count);
      assert.ok(found.length >= 1 && found.length <= count + 1, `${found}`);
      assert.ok(found.every((value) => value >= 0 && value <= max * (1 + 1e-9)));
      assert.ok(found.every((value) => String(value).replace(/[-+.e]/g, "").length <= 12), `${found}`);
    }
  }
});

test("logarithmic ticks are 1, 2 and 5 times powers of ten, or plain ones where these are few", () => {
  assert.deepEqual(logTicks({ min: 0.9, max: 60 }), [1, 2, 5, 10, 20, 50]);
  assert.deepEqual(logTicks({ min: 3, max: 4.5 }), ticks({ min: 3, max: 4.5 }, 6));
});

test("a scale takes the ends of an axis to the ends of the frame", () => {
  const linear = scale({ min: -1, max: 3 }, 10, 90);
  assert.deepEqual([-1, 0, 3].map(linear), [10, 30, 90]);
  const log = scale({ min: 1, max: 100, log: true }, 90, 10);
  assert.deepEqual([1, 10, 100].map(log), [90, 50, 10]);
  assert.ok(log(0) > 1e4, "what has no logarithm is far below the frame");
  assert.ok(log(-3) === log(0));
});

test("binary traits are read from views at any offset", () => {
  const bytes = new Uint8Array(13);
  new DataView(bytes.buffer).setFloat32(1, 0.5, true);
  new DataView(bytes.buffer).setUint16(7, 513, true);
  assert.deepEqual([...float32(new DataView(bytes.buffer, 1, 4))], [0.5]);
  assert.deepEqual([...uint16(new DataView(bytes.buffer, 7, 2))], [513]);
});
