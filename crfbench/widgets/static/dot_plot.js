// The page's side of DotPlot: a group of dots for each entry of the legend.

import { element, followTheme } from "./controls.js";
import { COLOURS, Plot, SHAPES } from "./plot.js";

/** @typedef {{ label: string, x: number[], y: number[], names: string[] }} Group */

const ROOM = 0.04; // beside the outermost dots, as a share of the axis
const HINT =
  "Point at a name in the legend to see its dots alone, press it to keep them so. Point at a dot to read it, drag a box " +
  "to zoom in. By keyboard: the arrow keys.";

/** @type {(values: number[], log?: boolean) => { min: number, max: number, log?: boolean }} */
export function axisOver(values, log) {
  const ends = [values.reduce((a, b) => Math.min(a, b)), values.reduce((a, b) => Math.max(a, b))];
  if (log) return { min: ends[0] / 1.3, max: 1.3 * ends[1], log };
  const room = ROOM * (ends[1] - ends[0] || 1);
  return { min: ends[0] - room, max: ends[1] + room };
}

function render(/** @type {{ model: import("./controls.js").Model, el: HTMLElement }} */ { model, el }) {
  const { groups, xLabel, yLabel, log } = model.get("_dots");
  const [colours, shapes] = [Object.keys(COLOURS), Object.keys(SHAPES)];
  const plot = new Plot("crf-canvas crf-many");
  const root = element("div", { class: "crf" }, plot.box, element("p", { class: "crf-note" }, HINT));
  el.append(root);
  const leaveTheme = followTheme(root, () => plot.schedule());
  const all = (/** @type {"x" | "y"} */ of) => groups.flatMap((/** @type {Group} */ group) => group[of]);
  plot.draw({
    x: { label: xLabel, ...axisOver(all("x")) },
    y: { label: yLabel, ...axisOver(all("y"), log) },
    // Neighbours in the legend differ in both colour and shape.
    marks: groups.map((/** @type {Group} */ { label, x, y, names }, /** @type {number} */ i) => ({
      type: "dots",
      label,
      x,
      y,
      names: names.map((name) => (name === label ? name : `${label}, ${name}`)),
      radius: 3,
      alpha: 0.8,
      colour: /** @type {import("./plot.js").Colour} */ (colours[i % colours.length]),
      shape: /** @type {import("./plot.js").Shape} */ (shapes[i % shapes.length]),
    })),
    description: `${yLabel} against ${xLabel} of ${groups.length} groups`,
  });
  return () => {
    leaveTheme();
    plot.destroy();
  };
}

export default { render };
