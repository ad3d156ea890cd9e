// How a page speaks to Python, shared by the widgets whose curves Python computes. Joined in front of their modules.

const SLOW = 400; // ms without an answer after which the page says so

// Speaks to Python one wish at a time. While an answer is awaited only the newest wish of each kind is kept, so a
// drag never queues up: the next message carries the value that the hand has reached by then.
class Wishes {
  constructor(model, onBusy) {
    this.model = model;
    this.onBusy = onBusy; // told true when an answer is awaited, false when nothing is under way any more
    this.name = newId(); // two views of one widget must not take each other's answers for their own
    this.count = 0;
    this.awaited = null;
    this.waiting = new Map();
  }

  get idle() {
    return this.awaited === null;
  }

  send(kind, value = null) {
    this.waiting.delete(kind); // so that the newest comes last
    this.waiting.set(kind, value);
    if (this.idle) this.sendNext();
  }

  sendNext() {
    const next = this.waiting.entries().next();
    this.onBusy(!next.done);
    if (next.done) return;
    const [kind, value] = next.value;
    this.waiting.delete(kind);
    this.awaited = `${this.name}:${++this.count}`;
    this.model.send({ request: this.awaited, kind, value });
  }

  answered(request) {
    if (request !== this.awaited) return;
    this.awaited = null;
    this.sendNext();
  }
}

// Returns what shows whether an answer is awaited: to machines at once, to eyes after a while.
function busySign(root, status) {
  let timer;
  return (busy) => {
    root.setAttribute("aria-busy", busy);
    clearTimeout(timer);
    if (busy) timer = setTimeout(() => (status.textContent = "waiting for Python …"), SLOW);
  };
}
