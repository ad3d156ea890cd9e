// Gives the modules of widgets, in a page without Jupyter, what it would: the state, its changes, a place.

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

// An island is a place and, right behind it, what the widget there needs.
async function bringToLife(script) {
  const { module, css, state } = JSON.parse(script.textContent, revive);
  document.head.append(element("style", {}, css));
  const address = URL.createObjectURL(new Blob([module], { type: "text/javascript" }));
  const { default: widget } = await import(address);
  widget.render({ model: new Model(state), el: script.previousElementSibling });
}

if (window.frameElement) fitFrame(window.frameElement);
for (const script of document.querySelectorAll("script[type='application/json']")) await bringToLife(script);
