// The page's side of BeforeAfter: a photograph as its camera wrote it, and the light that its curves make of it.

import { element } from "./controls.js";
import { SplitPhoto, tableOf, unchanged } from "./photo.js";
import { float32 } from "./plot.js";

const NOTE = "Left of the border: brightness, as the camera wrote it. Right: irradiance, the light itself. Drag the border.";

/** @type {(jpeg: any) => Promise<import("./photo.js").Picture>} */
async function pictureOf(jpeg) {
  const bitmap = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
  const { width, height } = bitmap;
  const context = /** @type {CanvasRenderingContext2D} */ (element("canvas", { width, height }).getContext("2d"));
  context.drawImage(bitmap, 0, 0);
  const codes = context.getImageData(0, 0, width, height).data.filter((_, i) => i % 4 < 3); // without alpha
  return { width, height, codes, levels: Float64Array.from({ length: 256 }, (_, i) => i / 255) };
}

/** @type {(context: { model: import("./controls.js").Model, el: HTMLElement }) => Promise<() => void>} */
async function render({ model, el }) {
  const { jpeg, curves, count } = model.get("_photo");
  const photo = new SplitPhoto(await pictureOf(jpeg), NOTE);
  photo.box.classList.add("crf-large");
  const samples = float32(curves);
  const length = samples.length / count;
  const tables = Array.from({ length: count }, (_, i) =>
    tableOf(photo.picture.levels, samples.subarray(i * length, (i + 1) * length)),
  );
  photo.show(
    { name: "brightness", tables: [unchanged(photo.picture.levels)] },
    { name: "linearised: irradiance", tables },
  );
  el.append(element("div", { class: "crf" }, photo.box));
  return () => photo.destroy();
}

export default { render };
