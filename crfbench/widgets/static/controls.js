// Labelled native controls, shared by the widgets. Joined in front of a widget's own module, so nothing is exported.

// Jupyter takes arrow keys, Enter and letters for its own shortcuts unless the control that has the focus says no.
const KEEP_KEYS = { "data-lm-suppress-shortcuts": "true" };

let lastId = 0;
const newId = () => `crf-${++lastId}-${Math.random().toString(36).slice(2, 8)}`;

function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

// Light text means a dark ground; this holds for every theme, whatever it calls itself.
function isDarkGround(node) {
  const [r, g, b] = getComputedStyle(node).color.match(/[\d.]+/g).map(Number);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b > 128;
}

// Gives the native controls in `root` the theme of the page whenever it appears or the theme changes; returns how to
// stop. The style sheet lets `color` pass over in a moment, so any change of theme ends in an event, whoever makes it.
function followTheme(root, onChange) {
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

function labelledSelect(label, options, onChange) {
  const input = element("select", { id: newId(), ...KEEP_KEYS });
  input.addEventListener("change", () => onChange(input.selectedIndex));
  offer(input, options);
  const box = element("div", { class: "crf-field" }, element("label", { for: input.id }, label), input);
  return { box, input };
}

function offer(select, options) {
  select.replaceChildren(...options.map((option, i) => element("option", { value: i }, option)));
}

function button(text, onClick, attributes = {}) {
  const node = element("button", { type: "button", ...KEEP_KEYS, ...attributes }, text);
  node.addEventListener("click", onClick);
  return node;
}

function labelledCheckbox(label, onChange) {
  const input = element("input", { type: "checkbox", ...KEEP_KEYS });
  input.addEventListener("change", () => onChange(input.checked));
  return { box: element("label", { class: "crf-check" }, input, label), input };
}

// `show(position, text)` moves the thumb and writes the value; a null position leaves the thumb where the hand has it.
function labelledSlider(label, { min, max, step }, onInput) {
  const input = element("input", { id: newId(), type: "range", min, max, step, ...KEEP_KEYS });
  const output = element("output", { for: input.id });
  const box = element("div", { class: "crf-slider" }, element("label", { for: input.id }, label), output, input);
  input.addEventListener("input", () => onInput(input.valueAsNumber));
  const show = (position, text) => {
    if (position !== null) input.value = position;
    output.textContent = text;
    input.setAttribute("aria-valuetext", text);
  };
  return { box, input, show };
}

// A list of names and values; `show(values)` writes the values in order.
function readouts(names) {
  const values = names.map(() => element("dd"));
  const rows = names.map((name, i) => element("div", {}, element("dt", {}, name), values[i]));
  const box = element("dl", { class: "crf-readouts" }, ...rows);
  return { box, show: (texts) => texts.forEach((text, i) => (values[i].textContent = text)) };
}

// Four digits, but no more than five decimals, so that what rounding leaves of a zero is shown as one.
function formatParam(value) {
  const rounded = Math.abs(value) < 1e-3 ? value.toFixed(5) : value.toPrecision(4);
  return Number(rounded) === 0 ? "0" : rounded.replace("-", "−");
}

function formatError(value) {
  if (value === 0) return "0";
  return value < 1e-3 || value >= 1e3 ? value.toExponential(3) : value.toPrecision(4);
}
