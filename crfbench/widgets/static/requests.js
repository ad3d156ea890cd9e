// How a page asks Python, shared by the widgets whose curves Python computes.

import { newId } from "./controls.js";

const SLOW = 400; // ms without an answer after which the page says so

/**
 * Asks Python one thing at a time. While an answer is awaited only the newest request of each kind is kept, so a drag
 * never queues up: the next message carries the value that the hand has reached by then.
 */
export class RequestQueue {
  /**
   * @param {import("./controls.js").Model} model
   * @param {(busy: boolean) => void} onBusy told true when an answer is awaited, false when none is any more
   */
  constructor(model, onBusy) {
    this.model = model;
    this.onBusy = onBusy;
    this.name = newId(); // two views of one widget must not take each other's answers for their own
    this.count = 0;
    this.awaited = "";
    /** @type {Map<string, unknown>} */
    this.waiting = new Map();
  }

  get idle() {
    return this.awaited === "";
  }

  /**
   * @param {string} kind
   * @param {unknown} [value]
   */
  send(kind, value = null) {
    this.waiting.delete(kind); // so that the newest comes last
    this.waiting.set(kind, value);
    if (this.idle) this.sendNext();
  }

  sendNext() {
    const [next] = this.waiting;
    this.onBusy(next !== undefined);
    if (next === undefined) return;
    const [kind, value] = next;
    this.waiting.delete(kind);
    this.awaited = `${this.name}:${++this.count}`;
    this.model.send({ request: this.awaited, kind, value });
  }

  /** @param {string} request that Python's last scene answers */
  answered(request) {
    if (this.idle || request !== this.awaited) return;
    this.awaited = "";
    this.sendNext();
  }
}

// Returns what shows whether an answer is awaited: to machines at once, to eyes after a while.
export function busySign(/** @type {HTMLElement} */ root, /** @type {HTMLElement} */ status) {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  return (/** @type {boolean} */ busy) => {
    root.setAttribute("aria-busy", String(busy));
    clearTimeout(timer);
    if (busy) timer = setTimeout(() => (status.textContent = "waiting for Python …"), SLOW);
  };
}
