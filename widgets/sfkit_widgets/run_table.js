// RunTable: all searches of a folder as a sortable table, and pictures of the one that is chosen.

import { element, mount } from "./_shared.js";
import { onWidth, showCharts } from "./charts.js";
import { parallelPicture } from "./run_parallel.js";

/** @typedef {import("./charts.js").Chart} Chart */
/** @typedef {import("./run_parallel.js").Axes} Axes */

/**
 * One stage of one search, an entry of the trait `rows`.
 * @typedef {object} RunRow
 * @property {[string, string | number | null][]} cells text and sort key
 * @property {string} metric with its unit
 * @property {string} stage
 * @property {number[]} numbers of candidates
 * @property {(number | null)[]} best parallel to `numbers`
 * @property {[string, number | null][]} importance
 * @property {Axes | null} axes
 */

const NUMBERS = ["best", "scored", "stored", "wall s", "CPU s"];
const NO_SEARCH = "No search has left a journal here. Run one, then press Read again.";

/** @param {{model: import("./_shared.js").Model, el: HTMLElement}} host */
function render(host) {
  const { root, body, watch, send, signal, announce, close } = mount(host, { label: "Searches", kind: "runs" });
  const read = element("button", { type: "button", title: "Look at what is in the folder now" }, "Read again");
  const count = element("span", { class: "sfkit-runs-count" });
  const wide = element("div", { class: "sfkit-runs-wide", role: "region", "aria-label": "Table of searches" });
  const title = element("div", { class: "sfkit-runs-title", role: "heading", "aria-level": 4 });
  const charts = element("div", { class: "sfkit-charts" });
  const more = element("div", { class: "sfkit-runs-more" });
  body.append(element("div", { class: "sfkit-runs-bar" }, read, count), wide, title, charts, more);
  read.addEventListener("click", () => send("read"), { signal });

  let chosen = ""; // the key of a row; the first until another is chosen
  let sorted = { column: -1, up: true };
  const rows = () => /** @type {RunRow[]} */ (host.model.get("rows"));

  const choose = (/** @type {string} */ key) => {
    chosen = key;
    draw();
  };
  const sort = (/** @type {number} */ column) => {
    sorted = { column, up: sorted.column === column ? !sorted.up : true };
    draw();
    /** @type {HTMLElement} */ (wide.querySelectorAll("th button")[column]).focus();
    announce(`Sorted by ${host.model.get("columns")[column]}, ${sorted.up ? "ascending" : "descending"}`);
  };

  function draw() {
    const all = rows();
    const now = all.find((row) => keyOf(row) === chosen) ?? all[0];
    count.textContent = all.length ? `${all.length} stages; lower is better` : NO_SEARCH;
    wide.hidden = title.hidden = !now;
    if (!now) {
      charts.replaceChildren();
      more.replaceChildren();
      return;
    }
    const held = wide.contains(document.activeElement) ? keyOf(now) : "";
    const ordered = sorted.column < 0 ? all : inOrder(all, sorted.column, sorted.up);
    wide.replaceChildren(runTable(host.model.get("columns"), ordered, now, sorted, { choose, sort }));
    wide.tabIndex = wide.scrollWidth > wide.clientWidth ? 0 : -1; // to scroll it by keyboard
    if (held) /** @type {HTMLElement | null} */ (wide.querySelector("[aria-pressed='true']"))?.focus();
    title.textContent = `${now.cells[0][0]}, ${now.stage}`;
    showCharts(charts, [bestChart(all, now)]);
    const parts = [];
    if (now.importance.length) parts.push(importancePicture(now));
    if (now.axes) parts.push(parallelPicture(now.axes, charts.clientWidth));
    more.replaceChildren(...parts);
  }

  watch(["rows", "columns"], draw);
  onWidth(root, draw, signal);
  return close;
}

/** @param {RunRow} row */
function keyOf(row) {
  return `${row.cells[0][0]}\n${row.stage}`;
}

/**
 * Rows by one column's keys; what is not known comes last, whichever way.
 * @param {RunRow[]} rows
 * @param {number} column
 * @param {boolean} up
 * @returns {RunRow[]}
 */
export function inOrder(rows, column, up) {
  return [...rows].sort((one, other) => {
    const [a, b] = [one.cells[column][1], other.cells[column][1]];
    if (a === null || b === null) return Number(a === null) - Number(b === null);
    const order = typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b));
    return up ? order : -order;
  });
}

/**
 * @param {string[]} columns
 * @param {RunRow[]} rows
 * @param {RunRow} chosen
 * @param {{column: number, up: boolean}} sorted
 * @param {{choose: (key: string) => void, sort: (column: number) => void}} hooks
 */
function runTable(columns, rows, chosen, sorted, { choose, sort }) {
  const heads = columns.map((name, n) => {
    const button = element("button", { type: "button" }, name);
    button.addEventListener("click", () => sort(n));
    const order = sorted.column !== n ? null : sorted.up ? "ascending" : "descending";
    return element("th", { scope: "col", "aria-sort": order, class: kindOf(name) }, button);
  });
  const lines = rows.map((row) => {
    const pick = element("button", { type: "button", "aria-pressed": String(row === chosen) }, row.cells[0][0]);
    const first = element("th", { scope: "row" }, pick);
    const others = row.cells.slice(1).map(([text], n) => element("td", { class: kindOf(columns[n + 1]) }, text));
    const line = element("tr", {}, first, ...others);
    line.addEventListener("click", () => choose(keyOf(row)));
    return line;
  });
  return element(
    "table",
    {},
    element("thead", {}, element("tr", {}, ...heads)),
    element("tbody", {}, ...lines),
  );
}

/** @param {string} column */
function kindOf(column) {
  return NUMBERS.includes(column) ? "sfkit-runs-number" : null;
}

/**
 * Best so far of the chosen search, and thin beside it of all others that can be compared.
 * @param {RunRow[]} rows
 * @param {RunRow} chosen
 * @returns {Chart}
 */
function bestChart(rows, chosen) {
  const others = rows.filter((row) => row !== chosen && row.stage === chosen.stage && row.metric === chosen.metric);
  const { x, ys } = onCommonAxis([...others, chosen]);
  const last = ys.length - 1;
  return {
    title: `Best so far${chosen.metric ? `, ${chosen.metric}` : ""}`,
    xName: "candidate",
    x,
    height: 190,
    series: ys.map((y, n) =>
      n === last
        ? { name: "this search", y, colour: "var(--sf-mark)", step: true, width: 2.5 }
        : { name: others.length === 1 ? "the other" : "others", y, colour: "var(--sf-muted)", step: true, width: 1, quiet: n > 0 },
    ),
  };
}

/**
 * Several searches over one axis: each holds its best until its last candidate, and ends there.
 * @param {Pick<RunRow, "numbers" | "best">[]} rows
 */
export function onCommonAxis(rows) {
  const x = [...new Set(rows.flatMap(({ numbers }) => numbers))].sort((a, b) => a - b);
  const ys = rows.map(({ numbers, best }) => {
    const last = numbers.at(-1) ?? -1;
    let at = -1;
    return x.map((number) => {
      while (at + 1 < numbers.length && numbers[at + 1] <= number) at += 1;
      return at < 0 || number > last ? null : best[at];
    });
  });
  return { x, ys };
}

/**
 * A bar a source: how much the best score rises without it.
 * @param {RunRow} now
 */
function importancePicture(now) {
  const top = Math.max(...now.importance.map(([, rise]) => rise ?? 0)) || 1;
  const unit = now.metric ? `, ${now.metric}` : "";
  const rows = now.importance.map(([source, rise]) => {
    const bar = element("span", { class: "sfkit-runs-bar-fill" });
    bar.style.width = `${rise === null ? 100 : (100 * rise) / top}%`;
    const text = rise === null ? "in every subset that was scored" : String(Number(rise.toPrecision(3)));
    return element(
      "li",
      {},
      element("span", { class: "sfkit-runs-source", title: source }, source),
      element("span", { class: "sfkit-runs-track" }, bar),
      element("span", {}, text),
    );
  });
  const caption = element("figcaption", {}, `How much the best score rises without a source${unit}`);
  return element("figure", { class: "sfkit-runs-figure" }, caption, element("ul", {}, ...rows));
}

export default { render };
