// How often each source is chosen: one row a generation, time running down, one column a source.

import { element } from "./_shared.js";

/**
 * One candidate, as Python shows it.
 * @typedef {object} Person
 * @property {number[]} sources positions of its sources
 * @property {string} score with its unit
 * @property {boolean} failed
 * @property {string[]} operators what made it, in order
 * @property {number[]} parents numbers
 * @property {number | null} generation where it is first drawn
 */

/**
 * The trait `evolution` of a search that has begun; lists are parallel to `generations`.
 * @typedef {object} Evolution
 * @property {string[]} sources
 * @property {string} metric with its unit
 * @property {number[]} generations
 * @property {(number | null)[]} best
 * @property {(number | null)[]} median
 * @property {number[][]} share
 * @property {[number, number, number][]} sizes
 * @property {number[]} diversity
 * @property {number[][]} populations numbers, best first
 * @property {number[]} totals
 * @property {Record<string, Person>} people
 * @property {number[]} archive numbers, best first
 */

/**
 * Columns of all tables of a population, so that a source is followed down one column: a place for the
 * row's name, the sources, and a place for the score.
 * @param {number} sources
 */
export function sourceColumns(sources) {
  return `38px repeat(${sources}, minmax(12px, 1fr)) 96px`;
}

/**
 * @param {Evolution} now
 * @param {number} at position of the generation that is shown
 * @param {(position: number) => void} choose
 * @returns {HTMLElement}
 */
export function shareTable(now, at, choose) {
  const table = element("div", { class: "sfkit-population-table", role: "table" });
  table.setAttribute("aria-label", "Share of the individuals that have a source, by generation");
  table.append(headRow(now.sources));
  // Long searches scroll here, which takes the keyboard as well.
  const body = element("div", { class: "sfkit-population-scroll", role: "rowgroup", tabindex: 0 });
  body.setAttribute("aria-label", "Generations");
  now.generations.forEach((generation, n) => {
    const row = element("div", { class: "sfkit-population-row", role: "row" });
    if (n === at) row.classList.add("sfkit-population-at");
    row.append(element("span", { class: "sfkit-population-name", role: "rowheader" }, String(generation)));
    row.append(...now.share[n].map((share, s) => shareCell(share, now.sources[s])));
    row.append(element("span", { role: "cell" }));
    row.addEventListener("click", () => choose(n));
    body.append(row);
  });
  table.append(body);
  return table;
}

/** @param {string[]} sources */
function headRow(sources) {
  const names = sources.map((name) =>
    element("span", { class: "sfkit-population-source", role: "columnheader", title: name }, name),
  );
  const corner = element("span", { class: "sfkit-population-name", role: "columnheader" }, "gen.");
  const key = element("span", { class: "sfkit-population-key", role: "columnheader" }, "have the source");
  key.append(element("span", { class: "sfkit-population-ramp", "aria-hidden": "true" }), "0–100 %");
  return element("div", { class: "sfkit-population-row sfkit-population-head", role: "row" }, corner, ...names, key);
}

/**
 * @param {number} share
 * @param {string} name
 */
function shareCell(share, name) {
  const text = `${Math.round(100 * share)} %`;
  const cell = element("span", { class: "sfkit-population-share", role: "cell", title: `${name}: ${text}` });
  cell.setAttribute("aria-label", text);
  cell.style.opacity = String(0.08 + 0.92 * share);
  return cell;
}
