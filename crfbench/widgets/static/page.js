// Gives the modules of widgets, in a page without Jupyter, what it would: the state, its changes, a place.

import { element, isDarkGround } from "./controls.js";

// Binary values of the state were written as {"base64": "..."}.
function revive(/** @type {string} */ _key, /** @type {any} */ value) {
  if (typeof value?.base64 !== "string") return value;
  return new DataView(Uint8Array.from(atob(value.base64), (letter) => letter.charCodeAt(0)).buffer);
}

/** The traits of a widget where there is no Python. */
class PageModel {
  constructor(/** @type {Record<string, unknown>} */ state) {
    this.state = state;
    this.events = new EventTarget();
  }

  get(/** @type {string} */ name) {
    return this.state[name];
  }

  set(/** @type {string} */ name, /** @type {unknown} */ value) {
    this.state[name] = value;
    this.events.dispatchEvent(new Event(`change:${name}`));
  }

  on(/** @type {string} */ name, /** @type {() => void} */ listener) {
    this.events.addEventListener(name, listener);
  }

  off(/** @type {string} */ name, /** @type {() => void} */ listener) {
    this.events.removeEventListener(name, listener);
  }

  save_changes() {}

  send() {}
}

// Within a notebook's output: as high as the content, and as light or dark as the page around it.
function fitFrame(/** @type {HTMLElement} */ frame) {
  const root = document.documentElement;
  document.querySelector("h1")?.remove(); // the notebook has its own words
  root.style.colorScheme = isDarkGround(frame) ? "dark" : "light";
  new ResizeObserver(() => (frame.style.height = `${root.offsetHeight}px`)).observe(root);
}

// An island is a place and, right behind it, what the widget there needs.
async function bringToLife(/** @type {Element} */ script) {
  const { module, css, state } = JSON.parse(script.textContent ?? "", revive);
  document.head.append(element("style", {}, css));
  const address = URL.createObjectURL(new Blob([module], { type: "text/javascript" }));
  const { default: widget } = await import(address);
  widget.render({ model: new PageModel(state), el: script.previousElementSibling });
}

const frame = /** @type {HTMLElement | null} */ (window.frameElement);
if (frame) fitFrame(frame);
for (const script of document.querySelectorAll("script[type='application/json']")) await bringToLife(script);
