// Labelled native controls, the theme of the page, and what a widget's model is: shared by the widgets.

/**
 * What anywidget hands to `render`: the traits that Python and the page share.
 * @typedef {object} Model
 * @property {(name: string) => any} get
 * @property {(name: string, value: unknown) => void} set
 * @property {(event: string, listener: () => void) => void} on
 * @property {(event: string, listener: () => void) => void} off
 * @property {() => void} save_changes
 * @property {(message: object) => void} send
 */

// Jupyter takes arrow keys, Enter and letters for its own shortcuts unless the control that has the focus says no.
export const KEEP_KEYS = { "data-lm-suppress-shortcuts": "true" };

let lastId = 0;
export const newId = () => `crf-${++lastId}-${Math.random().toString(36).slice(2, 8)}`;

/**
 * @template {keyof HTMLElementTagNameMap} T
 * @param {T} tag
 * @param {Record<string, string | number | boolean>} [attributes]
 * @param {...(Node | string)} children
 */
export function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, String(value));
  node.append(...children);
  return node;
}

// Light text means a dark ground; this holds for every theme, whatever it calls itself.
export function isDarkGround(/** @type {Element} */ node) {
  const [r, g, b] = (getComputedStyle(node).color.match(/[\d.]+/g) ?? [0, 0, 0]).map(Number);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b > 128;
}

// Gives the native controls in `root` the theme of the page whenever it appears or the theme changes; returns how to
// stop. The style sheet lets `color` pass over in a moment, so any change of theme ends in an event, whoever makes it.
export function followTheme(/** @type {HTMLElement} */ root, /** @type {() => void} */ onChange) {
  const follow = () => {
    if (!root.isConnected) return; // no colours yet
    root.style.colorScheme = isDarkGround(root) ? "dark" : "light";
    onChange();
  };
  for (const end of ["transitionend", "transitioncancel"]) root.addEventListener(end, follow);
  const observer = new ResizeObserver(follow);
  observer.observe(root);
  return () => observer.disconnect();
}

/**
 * Calls the listeners when their traits change; returns how to stop.
 * @param {Model} model
 * @param {Record<string, () => void>} listeners by the names of traits
 */
export function listen(model, listeners) {
  const entries = Object.entries(listeners);
  for (const [name, listener] of entries) model.on(`change:${name}`, listener);
  return () => entries.forEach(([name, listener]) => model.off(`change:${name}`, listener));
}

/**
 * @param {string} label
 * @param {string[]} options
 * @param {(index: number) => void} onChange
 */
export function labelledSelect(label, options, onChange) {
  const input = element("select", { id: newId(), ...KEEP_KEYS });
  input.addEventListener("change", () => onChange(input.selectedIndex));
  offer(input, options);
  const box = element("div", { class: "crf-field" }, element("label", { for: input.id }, label), input);
  return { box, input };
}

export function offer(/** @type {HTMLSelectElement} */ select, /** @type {string[]} */ options) {
  select.replaceChildren(...options.map((option, i) => element("option", { value: i }, option)));
}

/**
 * @param {string} text
 * @param {() => void} onClick
 * @param {Record<string, string | number>} [attributes]
 */
export function button(text, onClick, attributes = {}) {
  const node = element("button", { type: "button", ...KEEP_KEYS, ...attributes }, text);
  node.addEventListener("click", onClick);
  return node;
}

export function labelledCheckbox(/** @type {string} */ label, /** @type {(on: boolean) => void} */ onChange) {
  const input = element("input", { type: "checkbox", ...KEEP_KEYS });
  input.addEventListener("change", () => onChange(input.checked));
  return { box: element("label", { class: "crf-check" }, input, label), input };
}

/**
 * `show(position, text)` moves the thumb and writes the value; a null position leaves the thumb where the hand has it.
 * @param {string} label
 * @param {{ min: number, max: number, step: number }} range
 * @param {(value: number) => void} onInput
 */
export function labelledSlider(label, { min, max, step }, onInput) {
  const input = element("input", { id: newId(), type: "range", min, max, step, ...KEEP_KEYS });
  const output = element("output", { for: input.id });
  const box = element("div", { class: "crf-slider" }, element("label", { for: input.id }, label), output, input);
  input.addEventListener("input", () => onInput(input.valueAsNumber));
  /** @type {(position: number | null, text: string) => void} */
  const show = (position, text) => {
    if (position !== null) input.value = String(position);
    output.textContent = text;
    input.setAttribute("aria-valuetext", text);
  };
  return { box, input, show };
}

// A formula or note in which ^{...} is raised and _{...} lowered.
export function formula(/** @type {string} */ text) {
  return text.split(/([_^]\{[^}]*\})/).map((part) => {
    if (!part.endsWith("}")) return part;
    return element(part[0] === "^" ? "sup" : "sub", {}, part.slice(2, -1));
  });
}

// A list of names and values; `show(values)` writes the values in order.
export function readouts(/** @type {string[]} */ names) {
  const values = names.map(() => element("dd"));
  const rows = names.map((name, i) => element("div", {}, element("dt", {}, name), values[i]));
  const box = element("dl", { class: "crf-readouts" }, ...rows);
  /** @type {(texts: string[]) => void} */
  const show = (texts) => texts.forEach((text, i) => (values[i].textContent = text));
  return { box, show };
}

// With a true minus sign, which is as wide as a plus.
export const written = (/** @type {number | string} */ value) => String(value).replace("-", "−");

// Four digits, but no more than five decimals, so that what rounding leaves of a zero is shown as one.
export function formatParam(/** @type {number} */ value) {
  const rounded = Math.abs(value) < 1e-3 ? value.toFixed(5) : value.toPrecision(4);
  return Number(rounded) === 0 ? "0" : written(rounded);
}

/** @param {number} value an RMSE or MSE */
export function formatError(value) {
  if (value === 0) return "0";
  return value < 1e-3 || value >= 1e3 ? value.toExponential(3) : value.toPrecision(4);
}
