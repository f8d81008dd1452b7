// A search by a model: what it expected of its proposals, what came, and what it chose them by.

import { element } from "./_shared.js";
import { explained, showCharts } from "./charts.js";

/** @typedef {import("./charts.js").Chart} Chart */

/**
 * The trait `model`; lists are parallel to `number`. Empty where no model proposes.
 * @typedef {object} Model
 * @property {string} metric with its unit
 * @property {number[]} number of candidates, ascending
 * @property {(number | null)[]} mean
 * @property {(number | null)[]} sd
 * @property {(number | null)[]} low
 * @property {(number | null)[]} high
 * @property {(number | null)[]} bound
 * @property {(number | null)[]} best
 * @property {(number | null)[]} score
 * @property {string} says
 */

const MODEL_HELP = {
  model: "A Gaussian process over the merges' weights, which learns from every score and proposes what to score next",
  predicted: "Mean score that the model expected before it was measured; the band is its 95 % interval",
  bound: "Predicted mean less some standard deviations (beta): the candidate with the lowest is scored next",
  best: "The best score found before the proposal: where the bound meets it, the model expects nothing better",
  against: "Each dot is a proposal; on the dashed line it came as predicted",
};

/**
 * The part of a view that shows the model; empty and hidden where there is none.
 * @returns {{part: HTMLElement, draw: (now: Partial<Model>, pick: (number: number) => void) => void}}
 */
export function modelPanel() {
  const says = element("p", { class: "sfkit-model-says" });
  const charts = element("div", { class: "sfkit-charts" });
  const head = element("div", { class: "sfkit-model-head", role: "heading", "aria-level": 4 });
  head.append(explained("What the model expects", MODEL_HELP.model));
  const part = element("div", { class: "sfkit-model", hidden: true }, head, says, charts);
  return {
    part,
    draw(now, pick) {
      part.hidden = now.number === undefined;
      if (part.hidden) return;
      const model = /** @type {Model} */ (now);
      says.textContent = model.says;
      showCharts(charts, model.number.length ? modelCharts(model, pick) : []);
    },
  };
}

/**
 * @param {Model} now
 * @param {(number: number) => void} pick
 * @returns {Chart[]}
 */
function modelCharts(now, pick) {
  const common = { xName: "candidate", x: now.number, pick, height: 150 };
  const [blue, warm, muted] = ["var(--sf-mark)", "var(--sf-mark-warm)", "var(--sf-muted)"];
  const { x, y } = byPrediction(now);
  return [
    {
      ...common,
      title: now.metric,
      series: [
        { name: "predicted", help: MODEL_HELP.predicted, y: now.mean, colour: blue, band: [now.low, now.high] },
        { name: "measured", y: now.score, colour: warm, dots: true },
      ],
    },
    {
      ...common,
      title: "Acquisition",
      series: [
        { name: "bound", help: MODEL_HELP.bound, y: now.bound, colour: blue },
        { name: "best before", help: MODEL_HELP.best, y: now.best, colour: warm, dash: "dash", step: true },
      ],
    },
    {
      title: "Measured",
      help: MODEL_HELP.against,
      xName: "predicted",
      xWhole: false,
      x,
      height: 150,
      series: [
        { name: "as predicted", y: x, colour: muted, dash: "dash" },
        { name: "measured", y, colour: blue, dots: true },
      ],
    },
  ];
}

/**
 * Measured over predicted scores, the latter ascending.
 * @param {Pick<Model, "mean" | "score">} now
 */
export function byPrediction({ mean, score }) {
  /** @type {[number, number | null][]} */
  const pairs = [];
  mean.forEach((value, n) => value !== null && pairs.push([value, score[n]]));
  pairs.sort(([one], [other]) => one - other);
  return { x: pairs.map(([value]) => value), y: pairs.map(([, value]) => value) };
}

/**
 * What the model said of a candidate, in words; empty where it did not propose it.
 * @param {Partial<Model>} now
 * @param {number} number
 */
export function foretold({ number: numbers = [], mean = [], sd = [], bound = [] }, number) {
  const n = numbers.indexOf(number);
  if (n < 0) return "";
  const digits = (/** @type {number | null} */ value, /** @type {number} */ most) => Number(value?.toPrecision(most));
  const expected = `${digits(mean[n], 4)} ± ${digits(sd[n], 2)}`;
  return `The model expected ${expected}, and chose it by its bound of ${digits(bound[n], 4)}.`;
}
