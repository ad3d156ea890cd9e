// Gives a widget's module, in a page of its own, what Jupyter would: the state, its changes, a place. Python is not there.

// Binary values of the state were written as {"base64": "..."}.
function revive(_key, value) {
  if (typeof value?.base64 !== "string") return value;
  return new DataView(Uint8Array.from(atob(value.base64), (letter) => letter.charCodeAt(0)).buffer);
}

class Model {
  constructor(state) {
    this.state = state;
    this.events = new EventTarget();
  }

  get(name) {
    return this.state[name];
  }

  set(name, value) {
    this.state[name] = value;
    this.events.dispatchEvent(new Event(`change:${name}`));
  }

  on(name, listener) {
    this.events.addEventListener(name, listener);
  }

  off(name, listener) {
    this.events.removeEventListener(name, listener);
  }

  save_changes() {}
}

// Within a notebook's output: as high as the content, and light or dark as the page around it, whatever the system says.
function fitFrame(frame) {
  const root = document.documentElement;
  document.querySelector("h1").remove(); // the notebook has its own words
  root.style.colorScheme = isDarkGround(frame) ? "dark" : "light";
  new ResizeObserver(() => (frame.style.height = `${root.offsetHeight}px`)).observe(root);
}

const { module, css, state } = JSON.parse(document.getElementById("content").textContent, revive);
document.head.append(element("style", {}, css));
if (window.frameElement) fitFrame(window.frameElement);
const address = URL.createObjectURL(new Blob([module], { type: "text/javascript" }));
const { default: widget } = await import(address);
widget.render({ model: new Model(state), el: document.getElementById("widget") });
