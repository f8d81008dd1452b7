// PopulationView: generations above, the individuals of one below, descent and archive beside them.

import { element, mount } from "./_shared.js";
import { onWidth, showCharts } from "./charts.js";
import { modelPanel } from "./model_panel.js";
import { descentPanel, archivePanel } from "./population_descent.js";
import { populationGrid } from "./population_grid.js";
import { shareTable, sourceColumns } from "./population_shares.js";

/** @typedef {import("./population_shares.js").Evolution} Evolution */
/** @typedef {import("./charts.js").Chart} Chart */

const EMPTY = "No generation yet. Press Run or One step of a SearchControl, or call step() on the search.";

/** Rows at the left, of generations and individuals, that leave room for the archive below them. */
const SHORT = 20;

/** @param {{model: import("./_shared.js").Model, el: HTMLElement}} host */
function render(host) {
  const { root, body, watch, signal, close } = mount(host, { label: "Population", kind: "population" });
  const empty = element("p", { class: "sfkit-population-empty" }, EMPTY);
  const slider = element("input", { type: "range", min: 0, step: 1, class: "sfkit-population-slider" });
  const which = element("output", { class: "sfkit-population-which" });
  const latest = element("button", { type: "button", title: "Follow the latest generation" }, "Latest");
  const bar = element(
    "div",
    { class: "sfkit-population-bar" },
    element("label", {}, "Generation ", slider),
    which,
    latest,
  );
  const shares = element("div", {});
  const charts = element("div", { class: "sfkit-charts" });
  const people = element("div", {});
  const descent = element("div", { class: "sfkit-population-side" });
  const archive = element("div", { class: "sfkit-population-side sfkit-population-archive" });
  const left = element("div", { class: "sfkit-population-left" }, shares, bar, people);
  const right = element("div", { class: "sfkit-population-right" }, charts, descent);
  const model = modelPanel();
  const content = element("div", { class: "sfkit-population-content" }, left, right, archive, model.part);
  body.append(empty, content);

  // What one looks at is each view's own; the latest generation until another is chosen.
  let shown = -1;
  let chosen = /** @type {number | null} */ (null);
  /** @returns {Evolution} */
  const state = () => host.model.get("evolution");

  const choose = (/** @type {number | null} */ n) => {
    shown = n === null ? -1 : n;
    drawAll();
  };
  const look = (/** @type {number} */ number) => {
    chosen = number;
    drawSide();
    grid.mark(number);
  };
  const jump = (/** @type {number} */ number) => {
    const { generations, people: all } = state();
    const born = all[number]?.generation;
    if (born !== null && born !== undefined) shown = generations.indexOf(born);
    chosen = number;
    drawAll();
  };
  const grid = populationGrid(people, { look, signal });

  slider.addEventListener("input", () => choose(Number(slider.value)), { signal });
  latest.addEventListener("click", () => choose(null), { signal });

  function drawSide() {
    const now = state();
    descent.replaceChildren(descentPanel(now, chosen, jump, host.model.get("model")));
    archive.replaceChildren(archivePanel(now, jump));
  }

  function drawAll() {
    const now = state();
    const ready = now.generations !== undefined;
    empty.hidden = ready;
    content.hidden = !ready;
    if (!ready) return;
    const last = now.generations.length - 1;
    const at = shown < 0 || shown > last ? last : shown;
    root.style.setProperty("--sf-columns", sourceColumns(now.sources.length));
    slider.max = String(last);
    slider.value = String(at);
    slider.setAttribute("aria-valuetext", `generation ${now.generations[at]}`);
    which.textContent = `${now.generations[at]} of ${now.generations[last]}${shown < 0 ? ", following" : ""}`;
    latest.setAttribute("aria-pressed", String(shown < 0));
    if (chosen !== null && !(chosen in now.people)) chosen = null;
    const rows = now.generations.length + now.populations[at].length;
    content.classList.toggle("sfkit-population-short", rows <= SHORT);
    shares.replaceChildren(shareTable(now, at, choose));
    showCharts(charts, timeCharts(now, at, choose));
    grid.draw(now, at, chosen);
    model.draw(host.model.get("model"), jump);
    drawSide();
  }

  watch(["evolution", "model"], drawAll);
  onWidth(root, drawAll, signal);
  return close;
}

/**
 * @param {Evolution} now
 * @param {number} at position of the generation that is shown
 * @param {(position: number) => void} choose
 * @returns {Chart[]}
 */
function timeCharts(now, at, choose) {
  const common = { xName: "generation", x: now.generations, at: now.generations[at] };
  const pick = (/** @type {number} */ generation) => choose(now.generations.indexOf(generation));
  /**
   * @param {string} name
   * @param {(number | null)[]} y
   * @param {string} colour
   */
  const line = (name, y, colour, dash = "") => ({ name, y, colour, dash });
  const size = (/** @type {number} */ n) => now.sizes.map((triple) => triple[n]);
  return [
    {
      ...common,
      pick,
      title: now.metric,
      series: [
        line("best so far", now.best, "var(--sf-mark)"),
        line("median of the population", now.median, "var(--sf-mark-warm)", "dash"),
      ],
    },
    {
      ...common,
      pick,
      title: "Sources in a subset (number)",
      height: 100,
      series: [
        line("largest", size(2), "var(--sf-muted)", "dot"),
        line("mean", size(1), "var(--sf-mark)"),
        line("smallest", size(0), "var(--sf-muted)", "dash"),
      ],
    },
    {
      ...common,
      pick,
      title: "Diversity (mean Jaccard distance)",
      height: 100,
      range: [0, 1],
      yTicks: [0, 0.5, 1],
      series: [line("diversity", now.diversity, "var(--sf-mark)")],
    },
  ];
}

export default { render };
