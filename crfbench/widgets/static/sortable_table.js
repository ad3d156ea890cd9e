// The page's side of SortableTable: a plain table, with a button in each column's heading.

import { button, element, followTheme, KEEP_KEYS } from "./controls.js";

/** @typedef {import("./controls.js").Model} Model */

/**
 * @typedef {{ label: string, note: string, numeric: boolean }} Column
 * @typedef {{ text: string, value: number | string | null }} Cell
 */

// Missing values come last whichever way the others go.
export function compare(/** @type {Cell["value"]} */ a, /** @type {Cell["value"]} */ b, /** @type {1 | -1} */ sign) {
  if (a === null || b === null) return Number(a === null) - Number(b === null);
  return sign * (typeof a === "number" ? a - Number(b) : a.localeCompare(String(b)));
}

class SortableTableView {
  constructor(/** @type {Model} */ model, /** @type {HTMLElement} */ root) {
    /** @type {{ caption: string, columns: Column[], rows: Cell[][] }} */
    this.table = model.get("_table");
    this.column = -1;
    this.ascending = true;
    this.headings = this.table.columns.map((column, i) => this.buildHeading(column, i));
    this.body = element("tbody", {}, ...this.table.rows.map((row) => this.buildRow(row)));
    this.rows = [...this.body.rows];
    this.status = element("div", { class: "crf-status crf-note", role: "status" }, "Press a heading to sort by it.");
    this.root = element("div", { class: "crf crf-sortable" }, this.buildTable(), this.status, this.buildNotes());
    root.append(this.root);
    this.destroy = followTheme(this.root, () => {});
  }

  buildTable() {
    const { caption } = this.table;
    const head = element("thead", {}, element("tr", {}, ...this.headings));
    const table = element("table", {}, element("caption", {}, caption), head, this.body);
    // Wider than a phone, so it scrolls by itself, also by keyboard.
    const region = { class: "crf-scroll", role: "region", tabindex: 0, "aria-label": caption, ...KEEP_KEYS };
    return element("div", region, table);
  }

  buildHeading(/** @type {Column} */ { label, numeric }, /** @type {number} */ i) {
    const heading = element("th", { scope: "col", "aria-sort": "none" }, button(label, () => this.sort(i)));
    heading.classList.toggle("crf-number", numeric);
    return heading;
  }

  buildRow(/** @type {Cell[]} */ row) {
    const cells = row.map(({ text }, i) => {
      const cell = i === 0 ? element("th", { scope: "row" }, text) : element("td", {}, text);
      cell.classList.toggle("crf-number", this.table.columns[i].numeric);
      return cell;
    });
    return element("tr", {}, ...cells);
  }

  buildNotes() {
    const noted = this.table.columns.filter(({ note }) => note);
    const entries = noted.map(({ label, note }) => element("div", {}, element("dt", {}, label), element("dd", {}, note)));
    const list = element("dl", {}, ...entries);
    return noted.length ? element("details", {}, element("summary", {}, "What the columns mean"), list) : "";
  }

  // The first press sorts upwards, the next the other way round. Rows move, they are not built again.
  sort(/** @type {number} */ column) {
    this.ascending = this.column === column ? !this.ascending : true;
    this.column = column;
    const value = (/** @type {HTMLTableRowElement} */ row) => this.table.rows[this.rows.indexOf(row)][column].value;
    this.body.append(...[...this.rows].sort((a, b) => compare(value(a), value(b), this.ascending ? 1 : -1)));
    const direction = this.ascending ? "ascending" : "descending";
    this.headings.forEach((heading, i) => heading.setAttribute("aria-sort", i === column ? direction : "none"));
    this.status.textContent = `Sorted by ${this.table.columns[column].label}, ${direction}.`;
  }
}

function render(/** @type {{ model: Model, el: HTMLElement }} */ { model, el }) {
  const view = new SortableTableView(model, el);
  return () => view.destroy();
}

export default { render };
