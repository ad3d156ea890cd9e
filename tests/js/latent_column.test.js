import assert from "node:assert/strict";
import { test } from "node:test";

import { half, histogram, Run } from "../../crfbench/widgets/static/latent_column.js";

test("half precision is read as IEEE 754 says", () => {
  const known = { 0x0000: 0, 0x3c00: 1, 0xc000: -2, 0x3555: 0.333251953125, 0x7bff: 65504, 0x0001: 2 ** -24 };
  for (const [bits, value] of Object.entries(known)) assert.equal(half(Number(bits)), value);
});

test("latents beyond the bars count in the outermost", () => {
  const counts = histogram(Float32Array.from([-9, -5, -0.1, 0, 0.24, 0.25, 5, 9]));
  assert.equal(counts.length, 40);
  assert.equal(counts[0], 2);
  assert.equal(counts[39], 2);
  assert.deepEqual(counts.slice(19, 22), [1, 2, 1]);
  assert.equal(counts.reduce((a, b) => a + b), 8);
});

test("a run shows the latest epoch kept", () => {
  const view = (array) => new DataView(array.buffer);
  const run = new Run({
    name: "LDL", epochs: [1, 5, 9], xLabel: "x", yLabel: "y",
    latents: view(Uint16Array.from([0x3c00, 0, 0xc000, 0, 0, 0x3c00])),
    probes: view(Uint8Array.from([0, 255, 1, 254, 2, 253])),
    figures: view(Float32Array.from({ length: 12 }, (_, i) => i)),
  });
  assert.deepEqual([0, 1, 4, 5, 8, 9, 99].map((epoch) => run.rowAt(epoch)), [0, 0, 0, 1, 1, 2, 2]);
  assert.deepEqual(run.parts(run.latents, 1).map((row) => [...row]), [[-2, 0]]);
  assert.deepEqual(run.parts(run.probes, 2, 2).map((part) => [...part]), [[2], [253]]);
  assert.equal(run.size, 2);
});
