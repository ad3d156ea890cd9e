import assert from "node:assert/strict";
import { test } from "node:test";

import { RequestQueue } from "../../crfbench/widgets/static/requests.js";

function queue() {
  const [sent, busy] = [[], []];
  const requests = new RequestQueue({ send: (message) => sent.push(message) }, (on) => busy.push(on));
  return { requests, sent, busy };
}

test("while an answer is awaited, only the newest request of each kind is kept", () => {
  const { requests, sent, busy } = queue();
  for (const value of [1, 2, 3]) requests.send("index", value);
  requests.send("fit");
  requests.send("index", 4);
  assert.deepEqual(sent.map(({ kind, value }) => [kind, value]), [["index", 1]]);
  requests.answered(sent[0].request);
  requests.answered(sent[1].request);
  assert.deepEqual(sent.map(({ kind, value }) => [kind, value]), [["index", 1], ["fit", null], ["index", 4]]);
  assert.ok(!requests.idle);
  requests.answered(sent[2].request);
  assert.ok(requests.idle);
  assert.deepEqual(busy, [true, true, true, false]);
});

test("answers to others are not taken for its own", () => {
  const [one, other] = [queue(), queue()];
  one.requests.send("fit");
  other.requests.send("fit");
  one.requests.answered(other.sent[0].request);
  one.requests.answered("");
  assert.ok(!one.requests.idle);
});
