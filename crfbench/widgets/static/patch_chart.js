// The chart of CalibrationExplorer: a button a patch, by mouse or keyboard.

import { button, element, newId } from "./controls.js";

const COLUMNS = 6; // patches in a row of the chart
/** @type {Record<string, number>} */
const STEPS = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -COLUMNS, ArrowDown: COLUMNS };
const BRIGHT = 110; // of 255; from there on black numbers are easier to read than white ones

/** Buttons in rows; one is in the tab order and the arrow keys go to the others. */
export class PatchChart {
  /**
   * @param {number[]} reference irradiance of the patches, row by row
   * @param {(patch: number) => void} onToggle told the number of the patch, from 1
   */
  constructor(reference, onToggle) {
    this.painted = "";
    this.buttons = reference.map((value, i) => {
      const name = `patch ${i + 1}, irradiance ${value}`;
      const node = button("", () => (this.enter(i), onToggle(i + 1)), { "aria-label": name, title: name });
      node.append(element("span", { "aria-hidden": "true" }, String(i + 1)));
      return node;
    });
    const hint = element("p", { class: "crf-note", id: newId() }, "Click patches, or go with the arrow keys and press Space.");
    const group = { class: "crf-chart", role: "group", "aria-label": "colour chart", "aria-describedby": hint.id };
    const grid = element("div", group, ...this.buttons);
    grid.addEventListener("keydown", (event) => this.move(event));
    this.box = element("div", {}, element("div", { class: "crf-caption" }, "Patches to calibrate with"), grid, hint);
    this.enter(0);
  }

  /** @param {number} i the button to be in the tab order */
  enter(i) {
    this.buttons.forEach((node, k) => (node.tabIndex = k === i ? 0 : -1));
  }

  move(/** @type {KeyboardEvent} */ event) {
    if (!(event.key in STEPS)) return;
    event.preventDefault();
    const to = this.buttons.findIndex((node) => node === event.target) + STEPS[event.key];
    if (!this.buttons[to]) return;
    this.enter(to);
    this.buttons[to].focus();
  }

  press(/** @type {number[]} */ patches) {
    this.buttons.forEach((node, i) => node.setAttribute("aria-pressed", String(patches.includes(i + 1))));
  }

  /** @param {Uint8Array} bytes red, green and blue of each patch */
  paint(bytes) {
    if (String(bytes) === this.painted) return;
    this.painted = String(bytes);
    this.buttons.forEach((node, i) => {
      const [r, g, b] = bytes.subarray(3 * i, 3 * i + 3);
      node.style.setProperty("--crf-patch", `rgb(${r}, ${g}, ${b})`);
      node.style.color = 0.2126 * r + 0.7152 * g + 0.0722 * b > BRIGHT ? "#000" : "#fff";
    });
  }
}
