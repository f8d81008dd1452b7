// Scores of the edited recipe beside those of the pins, on the pair and on the whole benchmark.

import { element } from "./_shared.js";

/** @typedef {import("./_shared.js").Model} Model */
/** @typedef {import("./_shared.js").View} View */
/** @typedef {{state: string, value: number | null}} Score */

/**
 * A score with its unit, or why there is none.
 * @param {Score} score
 * @param {string} unit
 */
export function scoreText({ state, value }, unit) {
  if (value !== null) return `${value.toFixed(2)} ${unit}`;
  return { running: "scoring …", failed: "failed: not finite" }[state] ?? "–";
}

/**
 * How an edited score differs from a pinned one; empty where one of them is not known. Lower is better.
 * @param {Score} edited
 * @param {Score} pinned
 * @param {string} unit
 */
export function differenceText(edited, pinned, unit) {
  if (edited.value === null || pinned.value === null) return "";
  const difference = edited.value - pinned.value;
  if (Math.abs(difference) < 0.005) return "the same";
  const points = unit === "%" ? "points" : unit;
  const size = `${Math.abs(difference).toFixed(2)} ${points}`;
  return difference < 0 ? `edited is ${size} better` : `edited is ${size} worse`;
}

/**
 * @param {View} view
 * @param {string} name
 */
function unpin(view, name) {
  const button = element("button", { type: "button", class: "unpin", "aria-label": `Unpin ${name}` }, "×");
  button.addEventListener("click", () => view.send("unpin", { name }), { signal: view.signal });
  return button;
}

/**
 * @param {View} view
 * @param {Model} model
 * @returns {HTMLElement}
 */
export function scoreTable(view, model) {
  const table = element("table", { class: "scores" });
  const flag = element("p", { class: "flag", role: "note" });
  const ask = element("button", { type: "button" }, "Score");
  ask.addEventListener("click", () => view.send("score"), { signal: view.signal });
  view.watch(["look", "scores", "pins", "metric", "flag"], () => {
    const { name, unit, benchmark, pairs } = model.get("metric");
    const all = `${pairs} ${pairs === 1 ? "pair" : "pairs"}`;
    const pins = Object.entries(model.get("pins")).sort();
    const look = model.get("look");
    const scores = model.get("scores");
    const known = scores.state === "known" || scores.state === "failed";
    ask.hidden = known || scores.state === "running";
    ask.setAttribute("aria-label", `Score on ${pairs === 1 ? "" : "all "}${all} of ${benchmark}`);
    const shown = look.reduction > 1 ? "…" : scoreText(look.score, unit);
    /** @param {string} title @param {Score} edited @param {Node | string} own @param {(pin: any) => Score} of */
    const row = (title, edited, own, of) =>
      element(
        "tr",
        {},
        element("th", { scope: "row" }, title),
        element("td", {}, own),
        ...pins.map(([, pin]) => {
          const difference = differenceText(edited, of(pin), unit);
          const mark = difference.endsWith("better") ? "better" : difference.endsWith("worse") ? "worse" : "";
          return element(
            "td",
            {},
            `${scoreText(of(pin), unit)} `,
            element("span", { class: `difference ${mark}` }, difference),
          );
        }),
      );
    const own = element("span", {}, scores.state === "unknown" ? "" : scoreText(scores, unit), ask);
    table.replaceChildren(
      element("caption", {}, `${name}, lower is better`),
      element(
        "thead",
        {},
        element(
          "tr",
          {},
          element("td", {}),
          element("th", { scope: "col" }, "edited"),
          ...pins.map(([pin]) => element("th", { scope: "col" }, `${pin} `, unpin(view, pin))),
        ),
      ),
      element(
        "tbody",
        {},
        row("this pair", look.score, shown, (pin) => pin.pair),
        row(`${benchmark}, ${all}`, scores, own, (pin) => pin.benchmark),
      ),
    );
    flag.textContent = model.get("flag");
    flag.hidden = !model.get("flag");
  });
  return element("div", { class: "scoring" }, table, flag);
}
