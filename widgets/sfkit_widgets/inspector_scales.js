// One slider a block for its module scale, the ends of the range and the neutral 1 marked.

import { clamp, element } from "./_shared.js";
import { newGesture } from "./inspector_grid.js";

/** @typedef {import("./_shared.js").Model} Model */
/** @typedef {import("./_shared.js").View} View */

const NEAR_NEUTRAL = 0.025; // a slider that comes this near to 1, two pixels, takes it

/**
 * The scale a slider stands for: 1 catches it.
 * @param {number} value
 */
export function caught(value) {
  return Math.abs(value - 1) < NEAR_NEUTRAL ? 1 : value;
}

/**
 * @param {View} view
 * @param {Model} model
 * @returns {HTMLElement}
 */
export function scaleColumn(view, model) {
  const [low, high] = model.get("gamma");
  const at = (/** @type {number} */ value) => `${(100 * (value - low)) / (high - low)}%`;
  const marks = [low, 1, high].map((value) =>
    element("span", { style: `left: ${at(value)}` }, value === 1 ? "1" : value.toFixed(2)),
  );
  const head = element(
    "div",
    { class: "scale-head" },
    element("span", {}, "module scale"),
    element("div", { class: "scale-marks", "aria-hidden": "true" }, ...marks),
  );
  /** @type {string[]} */
  const blocks = model.get("blocks");
  const rows = blocks.map((block) => scaleRow(view, block, [low, high], at(1)));
  /** @param {"show" | "settle"} how */
  const all = (how) =>
    model.get("scales").forEach((/** @type {number} */ scale, /** @type {number} */ b) => rows[b][how](scale));
  view.watch(["scales"], () => all("show"));
  view.watch(["error"], () => {
    if (model.get("error")) all("show"); // a number that was refused gives way to the scale that holds
  });
  view.watch(["acknowledged"], () => all("settle"));
  return element(
    "div",
    { class: "scales", role: "group", "aria-label": "Module scales" },
    head,
    ...rows.map(({ row }) => row),
  );
}

/**
 * @param {View} view
 * @param {string} block
 * @param {[number, number]} range
 * @param {string} neutral where 1 lies on the track
 */
function scaleRow(view, block, [low, high], neutral) {
  const limits = { min: low, max: high, "aria-label": `Module scale of ${block}, ${low} to ${high}` };
  const slider = element("input", { type: "range", step: "any", ...limits });
  const number = element("input", { type: "number", step: 0.05, ...limits });
  const ticks = ["0%", neutral, "100%"].map((left) => element("i", { style: `left: ${left}` }));
  const track = element(
    "div",
    { class: "scale-track" },
    element("div", { class: "scale-ticks" }, ...ticks),
    slider,
  );
  let gesture = newGesture();
  slider.addEventListener(
    "input",
    () => {
      const value = caught(Number(slider.value));
      view.sendLatest(`scale ${block}`, "scale", { block, value, gesture });
    },
    { signal: view.signal },
  );
  slider.addEventListener("change", () => (gesture = newGesture()), { signal: view.signal });
  slider.addEventListener(
    "keydown",
    (/** @type {KeyboardEvent} */ event) => {
      // A native slider of "any" step moves by a hundredth of its range; a twentieth of 1 is a scale's step.
      const steps = { ArrowRight: 0.05, ArrowUp: 0.05, ArrowLeft: -0.05, ArrowDown: -0.05 }[event.key];
      if (steps === undefined) return;
      event.preventDefault();
      const value = clamp(Number((Number(slider.value) + steps).toFixed(4)), low, high);
      slider.value = String(value);
      view.sendLatest(`scale ${block}`, "scale", { block, value });
    },
    { signal: view.signal },
  );
  // What is being typed stays, whatever Python says of an earlier move meanwhile.
  let typed = false;
  number.addEventListener("input", () => (typed = true), { signal: view.signal });
  number.addEventListener("blur", () => (typed = false), { signal: view.signal });
  number.addEventListener(
    "change",
    () => {
      typed = false;
      if (number.value !== "") view.send("scale", { block, value: Number(number.value) });
    },
    { signal: view.signal },
  );
  /**
   * What a hand is moving stays where the hand has it until Python has caught up.
   * @param {number} scale
   */
  const settle = (scale) => {
    if (slider !== document.activeElement || !view.pending()) slider.value = String(scale);
  };
  return {
    row: element("div", { class: "scale-row" }, track, number),
    /** @param {number} scale */
    show(scale) {
      settle(scale);
      slider.setAttribute("aria-valuetext", scale.toFixed(2));
      const stays = typed || Number(number.value) === scale;
      if (number !== document.activeElement || !stays) number.value = scale.toFixed(2);
    },
    settle,
  };
}
