// A scrubber over the trials of a Stage 2 search, under a chart of their scores.

import { element } from "./_shared.js";
import { newGesture } from "./inspector_grid.js";

/** @typedef {import("./_shared.js").Model} Model */
/** @typedef {import("./_shared.js").View} View */

const WIDTH = 1000; // of the chart's own coordinates
const HEIGHT = 90;
const MARGIN = 4;
const MOST_POINTS = 400;
const SVG = "http://www.w3.org/2000/svg";

/**
 * Trials to draw: at most `most`, evenly, and every new best.
 * @param {number[]} best number of the best trial up to each
 * @param {number} most
 */
export function drawnTrials(best, most) {
  const step = Math.max(1, Math.ceil(best.length / most));
  return best.map((_, n) => n).filter((n) => n % step === 0 || best[n] === n || n === best.length - 1);
}

/**
 * Places of trials in the chart; failed ones lie on its upper edge.
 * @param {(number | null)[]} scores
 * @param {number[]} drawn
 * @returns {{x: number, y: number, failed: boolean}[]}
 */
export function chartPoints(scores, drawn) {
  const [low = 0, high = 1] = ends(scores);
  const span = high - low || 1;
  return drawn.map((n) => {
    const score = scores[n];
    const x = scores.length > 1 ? MARGIN + (n / (scores.length - 1)) * (WIDTH - 2 * MARGIN) : WIDTH / 2;
    const share = score === null ? 1 : Math.min(1, (score - low) / span);
    return { x, y: HEIGHT - MARGIN - share * (HEIGHT - 2 * MARGIN), failed: score === null };
  });
}

/**
 * What the chart shows: the scores at its lower and upper edge.
 * @param {(number | null)[]} scores
 * @param {string} unit
 */
export function keyText(scores, unit) {
  const [low, high] = ends(scores);
  const span = low === undefined ? "" : `, from ${low.toFixed(2)} to ${high.toFixed(2)} ${unit} and more`;
  return `dots: the score of each trial${span}; line: the best so far`;
}

/**
 * The best score, and the worst of the best nine tenths: the worst candidates of a search can be far off.
 * @param {(number | null)[]} scores
 */
function ends(scores) {
  const sorted = scores.filter((score) => score !== null).sort((a, b) => a - b);
  return [sorted[0], sorted[Math.floor(0.9 * (sorted.length - 1))]];
}

/**
 * @param {string} tag
 * @param {Record<string, string | number>} attributes
 * @returns {any}
 */
function drawing(tag, attributes) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  return made;
}

/**
 * @param {View} view
 * @param {Model} model
 * @returns {HTMLElement}
 */
export function trialScrubber(view, model) {
  const { signal } = view;
  const chart = drawing("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none" });
  chart.setAttribute("aria-hidden", "true");
  const marker = drawing("line", { y1: 0, y2: HEIGHT, class: "trial-marker" });
  const slider = element("input", { type: "range", min: 0, step: 1, "aria-label": "Trial of the search" });
  const words = element("output", { class: "trial-words" });
  const key = element("p", { class: "help" });
  const best = element("button", { type: "button" }, "Best");
  const more = element("button", { type: "button", title: "Read the search's trials anew" }, "Refresh");
  let gesture = newGesture();
  slider.addEventListener(
    "input",
    () => view.sendLatest("scrub", "scrub", { trial: Number(slider.value), gesture }),
    { signal },
  );
  slider.addEventListener("change", () => (gesture = newGesture()), { signal });
  best.addEventListener("click", () => view.send("scrub", { trial: model.get("trials").best.at(-1) }), { signal });
  more.addEventListener("click", () => view.send("refresh"), { signal });
  view.watch(["trials"], () => {
    const { score, best: bests } = model.get("trials");
    slider.max = String(Math.max(0, score.length - 1));
    best.disabled = !(bests.at(-1) >= 0);
    const drawn = drawnTrials(bests, MOST_POINTS);
    const points = chartPoints(score, drawn);
    const led = drawn.map((n) => bests[n]).map((n) => (n < 0 ? null : points[drawn.indexOf(n)].y));
    const steps = points.flatMap(({ x }, i) => {
      const y = led[i];
      return y === null ? [] : [...(i && led[i - 1] !== null ? [`${x},${led[i - 1]}`] : []), `${x},${y}`];
    });
    chart.replaceChildren(
      marker,
      ...points.map(({ x, y, failed }) =>
        drawing("line", { x1: x, x2: x, y1: y, y2: y, class: failed ? "trial-failed" : "trial-point" }),
      ),
      drawing("polyline", { points: steps.join(" "), class: "trial-best" }),
    );
  });
  view.watch(["trials", "trial", "metric", "acknowledged"], () => {
    const { iteration, score, best: bests } = model.get("trials");
    const { name, unit } = model.get("metric");
    const trial = model.get("trial");
    const text = trialText(trial, { iteration, score, bests, name, unit });
    words.textContent = text;
    key.textContent = keyText(score, unit);
    // What a hand is moving stays where the hand has it until Python has caught up.
    const held = slider === document.activeElement && view.pending();
    if (trial !== null && !held) slider.value = String(trial);
    slider.setAttribute("aria-valuetext", text);
    marker.setAttribute("visibility", trial === null ? "hidden" : "visible");
    const [{ x }] = trial === null ? [{ x: 0 }] : chartPoints(score, [trial]);
    marker.setAttribute("x1", String(x));
    marker.setAttribute("x2", String(x));
  });
  const [high, low, unit, first, last] = ["", "", "", "", ""].map((text) => element("span", {}, text));
  view.watch(["trials", "metric"], () => {
    const { score } = model.get("trials");
    const [best, worst] = ends(score);
    const { unit: of } = model.get("metric");
    high.textContent = worst === undefined ? "" : `≥ ${worst.toFixed(1)}`;
    low.textContent = best === undefined ? "" : best.toFixed(1);
    unit.textContent = of;
    first.textContent = "trial 0";
    last.textContent = String(Math.max(0, score.length - 1));
  });
  const box = element(
    "div",
    { class: "trials" },
    element("div", { class: "trials-bar" }, words, best, more),
    element(
      "div",
      { class: "trials-plot" },
      element("div", { class: "trials-y", "aria-hidden": "true" }, high, unit, low),
      element("div", { class: "trials-chart" }, chart),
      slider,
      element("div", { class: "trials-x", "aria-hidden": "true" }, first, last),
    ),
    key,
  );
  view.watch(["trials"], () => (box.hidden = model.get("trials").score.length === 0));
  return box;
}

/**
 * What is said of the trial on show.
 * @param {number | null} trial
 * @param {{iteration: number[], score: (number | null)[], bests: number[], name: string, unit: string}} all
 */
export function trialText(trial, { iteration, score, bests, name, unit }) {
  if (trial === null) return `edited by hand; ${score.length} trials of the search to scrub`;
  const found = score[trial] === null ? "failed" : `${name} ${score[trial].toFixed(2)} ${unit}`;
  const leads = bests.at(-1) === trial ? ", the best" : "";
  return `trial ${trial} of 0 to ${score.length - 1}, iteration ${iteration[trial]}: ${found}${leads}`;
}
