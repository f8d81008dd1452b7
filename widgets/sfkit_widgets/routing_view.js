// RoutingView: one recipe of Stage 2 as a heatmap with its scales, and how all of it moved.

import { element, mount, standsUpright } from "./_shared.js";
import { explained, legend, onWidth, showCharts } from "./charts.js";
import { modelPanel } from "./model_panel.js";

/** @typedef {import("./charts.js").Chart} Chart */
/** @typedef {Omit<Chart, "title" | "series">} Common what charts over evaluations share */

/**
 * The trait `trace` of a search that has begun; lists are parallel to `drawn`.
 * @typedef {object} Trace
 * @property {string[]} sources
 * @property {string[]} blocks
 * @property {[number, number]} gamma
 * @property {string} metric with its unit
 * @property {boolean} tied
 * @property {boolean} by_model whether a model proposes, and not CMA-ES
 * @property {number[]} drawn numbers of evaluations
 * @property {number} evaluations
 * @property {(number | null)[]} score
 * @property {string[]} text
 * @property {number[][][]} weights rows are blocks, a single one where they are tied
 * @property {number[][]} scales
 * @property {(number | null)[]} incumbent positions in `drawn`
 * @property {number[]} iterations numbers of evaluations
 * @property {(number | null)[]} sigma parallel to `iterations`
 * @property {(number | null)[][]} axes each parallel to `iterations`
 * @property {number | null} best position in `drawn`
 * @property {{color: string, dash: string}[]} colours of the sources
 * @property {[string, string][]} shades background and text
 */

const NOTHING_YET = "No evaluation yet. Press Run or One step of a SearchControl, or call step() on the search.";
const MARK = "var(--sf-mark)";
const BESIDE_COLUMNS = 170; // px of the heatmap that blocks and scales take
const NARROWEST = 36; // px of a source's column
const LETTER = 8; // px of one in the head, its share of the margins included

const HELP = {
  evaluation: "One recipe scored on all validation pairs, numbered from 0",
  candidate: "A recipe the search tried",
  best: "The candidate with the lowest score up to here",
  weights: "Share of each source in a block's merged task vector; the weights of a block sum to 1",
  scale: "Factor on a block's merged task vector; 1 takes it as it is",
  distribution: "CMA-ES draws candidates from a normal distribution in x, the weights and scales as it encodes them",
  sigma: "Overall spread of the distribution candidates are drawn from; it shrinks as the search settles",
  region: "Candidates are looked for around the best so far; the region grows while better ones are found there",
  radius: "Standard deviation of draws around the best, in x, the weights and scales as they are encoded",
  axes:
    "Spread along each main axis of the distribution, shortest to longest: far apart where some directions matter " +
    "more than others",
};

/** @param {{model: import("./_shared.js").Model, el: HTMLElement}} host */
function render(host) {
  const { root, body, watch, signal, close } = mount(host, { label: "Routing", kind: "routing" });
  const empty = element("p", { class: "sfkit-routing-empty" }, NOTHING_YET);
  const slider = element("input", { type: "range", min: 0, step: 1, class: "sfkit-routing-slider" });
  const which = element("output", { class: "sfkit-routing-which" });
  const best = element("button", { type: "button", title: "Follow the best so far" }, "Best");
  const bar = element("div", { class: "sfkit-routing-bar" });
  bar.append(element("label", {}, "Evaluation ", slider), which, best);
  const heat = element("div", { class: "sfkit-routing-heat", role: "group", "aria-label": "Recipe on show" });
  const charts = () => element("div", { class: "sfkit-charts" });
  const [score, weights, scales, distribution] = [charts(), charts(), charts(), charts()];
  const recipe = element("div", {}, bar, heat);
  const top = element("div", { class: "sfkit-routing-top" }, recipe, score);
  const [weightsHead, scalesHead, distributionHead] = [1, 2, 3].map(() =>
    element("div", { class: "sfkit-routing-section", role: "heading", "aria-level": 4 }),
  );
  const model = modelPanel();
  const content = element(
    "div",
    { class: "sfkit-routing-content" },
    top,
    weightsHead,
    weights,
    scalesHead,
    scales,
    distributionHead,
    distribution,
    model.part,
  );
  body.append(empty, content);

  let shown = -1; // position in `drawn`; the best so far until another is chosen
  const choose = (/** @type {number} */ n) => {
    shown = n;
    draw();
  };
  slider.addEventListener("input", () => choose(Number(slider.value)), { signal });
  best.addEventListener("click", () => choose(-1), { signal });

  function draw() {
    const now = /** @type {Trace} */ (host.model.get("trace"));
    const ready = now.drawn !== undefined;
    empty.hidden = ready;
    content.hidden = !ready;
    if (!ready) return;
    const last = now.drawn.length - 1;
    const at = shown < 0 || shown > last ? now.best ?? last : shown;
    const number = now.drawn[at];
    slider.max = String(last);
    slider.value = String(at);
    slider.setAttribute("aria-valuetext", `evaluation ${number}, ${now.text[at]}`);
    const following = shown < 0 && now.best !== null ? ", best so far" : "";
    which.textContent = `${number} of ${now.evaluations - 1}: ${now.text[at]}${following}`;
    best.setAttribute("aria-pressed", String(shown < 0));
    root.style.setProperty("--sf-heat", `${BESIDE_COLUMNS + NARROWEST * now.sources.length}px`);
    heat.replaceChildren(heatmap(now, at, (heat.clientWidth - BESIDE_COLUMNS) / LETTER));
    heat.tabIndex = heat.scrollWidth > heat.clientWidth ? 0 : -1; // to scroll it by keyboard
    const pick = (/** @type {number} */ evaluation) => choose(now.drawn.indexOf(evaluation));
    const common = { xName: "evaluation", xHelp: HELP.evaluation, x: now.drawn, at: number, pick };
    showCharts(score, [scoreChart(now, common)]);
    const ofWeights = weightCharts(now, common);
    weightsHead.replaceChildren(
      explained("Weights of the best so far (fraction)", HELP.weights),
      ...ofWeights[0].series.map(legend),
    );
    showCharts(weights, ofWeights.map(quiet));
    const ofScales = scaleCharts(now, common);
    scalesHead.replaceChildren(explained("Module scales (factor)", HELP.scale), ...ofScales[0].series.map(legend));
    showCharts(scales, ofScales.map(quiet));
    distributionHead.replaceChildren(explained("Where the search looks", now.by_model ? HELP.region : HELP.distribution));
    showCharts(distribution, distributionCharts(now, common));
    model.draw(host.model.get("model"), pick);
  }

  watch(["trace", "model"], draw);
  onWidth(root, draw, signal);
  return close;
}

/**
 * Routing weights of one evaluation: rows are blocks with their scales, columns sources.
 * @param {Trace} now
 * @param {number} at
 * @param {number} letters of sources' names that have room side by side
 */
function heatmap(now, at, letters) {
  const table = element("table", { class: standsUpright(now.sources, letters) ? "sfkit-routing-upright" : null });
  table.append(element("caption", {}, "Routing weights (fraction) and module scales (factor)"));
  const names = now.sources.map((name) => element("th", { scope: "col" }, element("span", { title: name }, name)));
  table.append(element("tr", {}, element("th", { scope: "col", class: "sfkit-routing-block" }, "block"), ...names, element("th", { class: "sfkit-routing-scale" }, "scale")));
  now.blocks.forEach((block, b) => {
    const row = now.weights[at][now.tied ? 0 : b];
    const cells = row.map((weight) => weightCell(weight, now.shades));
    const scale = element("td", { class: "sfkit-routing-scale" }, `× ${now.scales[at][b].toFixed(2)}`);
    table.append(element("tr", {}, element("th", { scope: "row" }, block), ...cells, scale));
  });
  return table;
}

/**
 * @param {number} weight
 * @param {[string, string][]} shades
 */
function weightCell(weight, shades) {
  const [background, colour] = shades[Math.round(weight * (shades.length - 1))];
  const style = `background: ${background}; color: ${colour}`;
  return element("td", { class: "sfkit-routing-weight", style }, weight.toFixed(2));
}

/**
 * The values the best so far had at each evaluation that is drawn; null before there is one.
 * @param {(number | null)[]} values
 * @param {(number | null)[]} incumbent positions
 */
export function ofIncumbent(values, incumbent) {
  return incumbent.map((n) => (n === null ? null : values[n]));
}

/**
 * The chart without a legend, which stands once over all of its kind.
 * @param {Chart} chart
 * @returns {Chart}
 */
function quiet(chart) {
  return { ...chart, series: chart.series.map((series) => ({ ...series, quiet: true })) };
}

/**
 * @param {Trace} now
 * @param {Common} common
 * @returns {Chart}
 */
function scoreChart(now, common) {
  const best = ofIncumbent(now.score, now.incumbent);
  const series = [
    { name: "candidate", help: HELP.candidate, y: now.score, colour: "var(--sf-mark-warm)", dots: true },
    { name: "best so far", help: HELP.best, y: best, colour: MARK, step: true },
  ];
  return { ...common, title: now.metric, height: 190, series };
}

/**
 * @param {Trace} now
 * @param {Common} common
 * @returns {Chart[]}
 */
function distributionCharts(now, common) {
  const iterations = { ...common, x: now.iterations, at: null, pick: undefined, log: true, height: 100 };
  const longest = now.axes.length - 1;
  const names = now.axes.map((_, n) => (n === 0 ? "shortest" : n === longest ? "longest" : `axis ${n + 1}`));
  const inner = (/** @type {number} */ n) => n > 0 && n < longest;
  const axis = (/** @type {(number | null)[]} */ y, /** @type {number} */ n) => {
    const colour = inner(n) ? "var(--sf-muted)" : MARK;
    const dash = n === 0 && longest > 0 ? "dash" : "";
    return { name: names[n], y, colour, dash, width: inner(n) ? 0.8 : 2, step: true, quiet: inner(n) };
  };
  const sigma = [{ name: now.by_model ? "radius" : "σ", y: now.sigma, colour: MARK, step: true, quiet: true }];
  if (now.by_model) {
    return [{ ...iterations, title: "Radius of the trust region (in x)", help: HELP.radius, series: sigma }];
  }
  return [
    { ...iterations, title: "Step size σ (in x)", help: HELP.sigma, series: sigma },
    { ...iterations, title: "Axis lengths (in x)", help: HELP.axes, series: now.axes.map(axis) },
  ];
}

/**
 * @param {Trace} now
 * @param {Common} common
 * @returns {Chart[]}
 */
function weightCharts(now, common) {
  const rows = now.weights[0].map((_, b) => (now.tied ? "all blocks" : now.blocks[b]));
  return rows.map((name, b) => ({
    ...common,
    title: name,
    height: 130,
    range: [-0.02, 1.02],
    yTicks: [0, 0.5, 1],
    series: now.sources.map((source, e) => {
      const y = ofIncumbent(now.weights.map((weights) => weights[b][e]), now.incumbent);
      const { color, dash } = now.colours[e];
      return { name: source, y, colour: color, dash, step: true };
    }),
  }));
}

/**
 * @param {Trace} now
 * @param {Common} common
 * @returns {Chart[]}
 */
function scaleCharts(now, common) {
  const [low, high] = now.gamma;
  const margin = 0.06 * (high - low);
  return now.blocks.map((block, b) => {
    const y = now.scales.map((scales) => scales[b]);
    return {
      ...common,
      title: block,
      height: 110,
      range: [low - margin, high + margin],
      yTicks: [low, 1, high],
      series: [
        { name: "candidate", help: HELP.candidate, y, colour: "var(--sf-mark-warm)", dots: true },
        { name: "best so far", help: HELP.best, y: ofIncumbent(y, now.incumbent), colour: MARK, step: true },
      ],
    };
  });
}

export default { render };
