// The parts of DisparityCompare on the page, and what its controls do.

import { STEP } from "./compare_gestures.js";
import { actionButton, choiceButtons, choiceList, numberInput } from "./compare_controls.js";
import { element } from "./_shared.js";

/**
 * What controls ask for.
 * @typedef {object} Acts
 * @property {(values: Record<string, any>) => void} set a look
 * @property {(pair: string) => void} choose
 * @property {(by: number) => void} turn to another pair
 * @property {(factor: number) => void} zoom
 * @property {(end: number, value: number) => void} bound the colour range
 * @property {(number: number) => void} jump to a region
 * @property {() => void} exchange A and B
 * @property {() => void} pause
 */

const HELP =
  "Click a panel; then the wheel, + and − zoom, dragging pans and 0 shows all. Arrows move the cursor, with " +
  "shift by 10 px. 1, 2, 3: disparity, error (or residual), better. N and P: outlier regions. Page up and down: pairs. " +
  "Space: A or B when blinking. [ and ]: the divider.";
/** @type {[string, string][]} */
const ARRANGEMENTS = ["side by side", "swipe", "blink"].map((name) => [name, name]);
/** @type {[string, string][]} */
const SHOWN = [
  ["disparity", "disparity"],
  ["error", "error"],
  ["better", "better where"],
];

/**
 * @param {HTMLElement} body
 * @param {Acts} act
 * @param {AbortSignal} signal
 */
export function layOut(body, act, signal) {
  const set = (/** @type {string} */ name) => (/** @type {any} */ value) => act.set({ [name]: value });
  const button = (/** @type {string} */ text, /** @type {string} */ label, /** @type {() => void} */ press) =>
    actionButton(text, label, press, signal);
  const divider = element("input", { type: "range", min: 0, max: 1, step: 0.01 });
  const parts = {
    pair: choiceList("pair", act.choose, signal),
    arrangement: choiceButtons("arrangement", ARRANGEMENTS, set("arrangement"), signal),
    shown: choiceButtons("what is shown", SHOWN, set("shown"), signal),
    first: choiceList("A", set("first"), signal),
    second: choiceList("B", set("second"), signal),
    low: numberInput("lowest disparity of the colours, px", (value) => act.bound(0, value), signal),
    high: numberInput("highest disparity of the colours, px", (value) => act.bound(1, value), signal),
    zoom: element("output", { "aria-label": "zoom" }),
    pause: button("pause", "blink by itself", act.pause),
    divider,
    divided: element("label", {}, "divider ", divider),
    bars: element("div", { class: "sfkit-compare-bars" }),
    area: element("div", {
      class: "sfkit-compare-panels",
      role: "application",
      tabindex: 0,
      "aria-roledescription": "linked image panels",
    }),
    table: element("table"),
    listed: choiceList("Outlier regions of B", set("second"), signal),
    regions: element("ol"),
    none: element("p", { class: "sfkit-compare-help" }),
  };
  divider.addEventListener("input", () => act.set({ divider: Number(divider.value) }), { signal });
  parts.regions.addEventListener(
    "click",
    (/** @type {MouseEvent} */ event) => {
      const pressed = /** @type {HTMLElement} */ (event.target).closest("button");
      if (pressed) act.jump(Number(pressed.dataset.number));
    },
    { signal },
  );
  const group = (/** @type {(Node | string)[]} */ ...inside) => element("div", {}, ...inside);
  const tools = element(
    "div",
    { class: "sfkit-compare-tools" },
    group(
      button("‹", "previous pair", () => act.turn(-1)),
      parts.pair.whole,
      button("›", "next pair", () => act.turn(1)),
    ),
    parts.arrangement.group,
    parts.shown.group,
    group(parts.first.whole, button("⇄", "exchange A and B", act.exchange), parts.second.whole),
    group(
      button("−", "zoom out", () => act.zoom(1 / STEP)),
      parts.zoom,
      button("+", "zoom in", () => act.zoom(STEP)),
      button("all", "show the whole image", () => act.set({ camera: {} })),
    ),
    group(
      "colours",
      parts.low.input,
      "to",
      parts.high.input,
      "px",
      button("auto", "colour range of the pair", () => act.set({ limits: [] })),
    ),
    group(parts.pause, parts.divided),
  );
  const regions = element("div", {}, parts.listed.whole, parts.regions, parts.none);
  const side = element("div", { class: "sfkit-compare-side" }, parts.table, regions);
  const main = element("div", { class: "sfkit-compare-main" }, parts.area, side);
  body.append(tools, parts.bars, main, element("p", { class: "sfkit-compare-help" }, HELP));
  return parts;
}
