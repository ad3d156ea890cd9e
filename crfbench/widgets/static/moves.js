// How a page moves what Python shows too, by hand or by itself, shared by the widgets that work without Python.

let moves = 0;

/**
 * Sets traits, which draws at once, and then sends them, if there is a Python to send them to. With them goes which of
 * Python's own moves the page knew of, so that Python's next one is not undone by what was still under way.
 * @param {import("./controls.js").Model} model
 * @param {Record<string, unknown>} traits
 */
export function move(model, traits) {
  for (const [name, value] of Object.entries(traits)) model.set(name, value);
  model.set("_page_moves", [model.get("_python_moves"), ++moves]);
  model.save_changes();
}

/** Does the last work that it was given after the next frame, which so never waits for it. */
export class Afterwards {
  constructor() {
    this.frame = 0;
    /** @type {(() => void) | null} */
    this.work = null;
  }

  run(/** @type {() => void} */ work) {
    this.work = work;
    this.frame ||= requestAnimationFrame(() => setTimeout(() => this.finish()));
  }

  finish() {
    this.frame = 0;
    this.work?.();
  }

  stop() {
    cancelAnimationFrame(this.frame);
    this.work = null;
  }
}

/** Says in every frame how far it has got; in one step a second for who asks for less motion. */
export class Animation {
  /**
   * @param {{ speed: number, calmStep: number }} pace the way in a second, and the calm step
   * @param {(way: number) => void} onFrame
   */
  constructor({ speed, calmStep }, onFrame) {
    this.speed = speed;
    this.calmStep = calmStep;
    this.onFrame = onFrame;
    this.frame = 0;
  }

  get running() {
    return this.frame !== 0;
  }

  start() {
    const began = performance.now();
    const calm = window.matchMedia("(prefers-reduced-motion: reduce)");
    const next = (/** @type {number} */ now) => {
      this.frame = requestAnimationFrame(next);
      const seconds = Math.max(0, now - began) / 1000;
      this.onFrame(calm.matches ? this.calmStep * Math.floor(seconds) : this.speed * seconds);
    };
    this.frame = requestAnimationFrame(next);
  }

  stop() {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
  }
}
