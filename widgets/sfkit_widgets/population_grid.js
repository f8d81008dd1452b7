// The individuals of one generation: rows of membership marks, best first; parents and offspring marked.

import { element, gridStep } from "./_shared.js";

/** @typedef {import("./population_shares.js").Evolution} Evolution */

/**
 * @param {HTMLElement} place
 * @param {{look: (number: number) => void, signal: AbortSignal}} hooks look: an individual is pointed at
 */
export function populationGrid(place, { look, signal }) {
  const grid = element("div", { class: "sfkit-population-table", role: "grid", "aria-readonly": "true" });
  const more = element("p", { class: "sfkit-population-more" });
  place.append(grid, more);
  let rows = /** @type {{row: HTMLElement, number: number}[]} */ ([]);
  let now = /** @type {Evolution | null} */ (null);
  let focus = 0;

  const at = (/** @type {Event} */ event) => {
    const row = event.target instanceof Element ? event.target.closest("[data-number]") : null;
    return rows.findIndex((entry) => entry.row === row);
  };
  const point = (/** @type {number} */ n) => {
    if (n < 0) return;
    rove(n);
    look(rows[n].number);
  };
  grid.addEventListener("pointerover", (event) => point(at(event)), { signal });
  grid.addEventListener("focusin", (event) => point(at(event)), { signal });
  grid.addEventListener(
    "keydown",
    (event) => {
      const to = gridStep(event.key, { row: focus, column: 0 }, { rows: rows.length, columns: 1 });
      if (!to) return;
      event.preventDefault();
      const target = event.key === "Home" ? 0 : event.key === "End" ? rows.length - 1 : to.row;
      rove(target);
      rows[target].row.focus();
    },
    { signal },
  );

  /**
   * Tab stops at one row of the grid, the one looked at last.
   * @param {number} n
   */
  function rove(n) {
    focus = n;
    rows.forEach(({ row }, k) => (row.tabIndex = k === n ? 0 : -1));
  }

  /** @param {number | null} number */
  function mark(number) {
    const people = now?.people ?? {};
    const parents = new Set(number === null ? [] : people[number]?.parents);
    for (const { row, number: own } of rows) {
      row.classList.toggle("sfkit-population-chosen", own === number);
      row.classList.toggle("sfkit-population-parent", parents.has(own));
      const child = number !== null && (people[own]?.parents ?? []).includes(number);
      row.classList.toggle("sfkit-population-child", child);
    }
  }

  /**
   * @param {Evolution} next
   * @param {number} generation position of the one to show
   * @param {number | null} chosen
   */
  function draw(next, generation, chosen) {
    const held = grid.contains(document.activeElement);
    now = next;
    const numbers = next.populations[generation];
    rows = numbers.map((number, n) => ({ row: personRow(next, number, n), number }));
    grid.setAttribute("aria-label", `Individuals of generation ${next.generations[generation]}, best first`);
    grid.replaceChildren(...rows.map(({ row }) => row));
    const hidden = next.totals[generation] - numbers.length;
    more.textContent = hidden > 0 ? `The best ${numbers.length} of ${next.totals[generation]} individuals.` : "";
    rove(Math.max(0, numbers.indexOf(chosen ?? -1)));
    if (held) rows[focus]?.row.focus();
    mark(chosen);
  }

  return { draw, mark };
}

/**
 * @param {Evolution} now
 * @param {number} number
 * @param {number} n its rank, from 0
 */
function personRow(now, number, n) {
  const person = now.people[number];
  const row = element("div", { class: "sfkit-population-row", role: "row", "data-number": number });
  const names = person.sources.map((s) => now.sources[s]).join(", ");
  row.setAttribute("aria-label", `Rank ${n + 1}, candidate ${number}: ${names}; ${person.score}`);
  row.append(
    element("span", { class: "sfkit-population-name", role: "gridcell" }, String(n + 1)),
    ...marks(now, person),
    element("span", { class: "sfkit-population-score", role: "gridcell" }, person.score),
  );
  if (person.failed) row.classList.add("sfkit-population-failed");
  return row;
}

/**
 * One mark a source: filled where the individual has it.
 * @param {Evolution} now
 * @param {{sources: number[]}} person
 * @param {string} role empty for marks that are one picture together
 */
export function marks(now, person, role = "gridcell") {
  const has = new Set(person.sources);
  return now.sources.map((name, s) => {
    const kind = has.has(s) ? "sfkit-population-mark sfkit-population-has" : "sfkit-population-mark";
    const mark = element("span", { class: kind, title: name });
    if (role) mark.setAttribute("role", role);
    if (role) mark.setAttribute("aria-label", has.has(s) ? name : `not ${name}`);
    return mark;
  });
}
