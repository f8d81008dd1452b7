// RoutingInspector: weights, scales, trials and pictures in one place. Python does the work.

import { element, mount } from "./_shared.js";
import { WeightGrid } from "./inspector_grid.js";
import { pictures } from "./inspector_pictures.js";
import { recipePanel } from "./inspector_recipe.js";
import { scaleColumn } from "./inspector_scales.js";
import { scoreTable, scoreText } from "./inspector_scores.js";
import { trialScrubber } from "./inspector_trials.js";

/** @typedef {import("./_shared.js").Model} Model */
/** @typedef {import("./_shared.js").View} View */

/**
 * @param {View} view
 * @param {Model} model
 * @param {WeightGrid} grid
 */
function toolbar(view, model, grid) {
  /** @type {(words: string, title: string, act: () => void) => HTMLButtonElement} */
  const button = (words, title, act) => {
    const made = element("button", { type: "button", title }, words);
    made.addEventListener("click", act, { signal: view.signal });
    return made;
  };
  const undo = button("Undo", "Ctrl+Z", () => view.send("undo"));
  const redo = button("Redo", "Ctrl+Y", () => view.send("redo"));
  const reset = button("Equal weights", "Stage 1's merge: equal weights, scales of 1", () => view.send("reset"));
  const lock = button("Lock", "L: keep the selected weight while others move", () => grid.toggleLock());
  const tied = element("input", { type: "checkbox" });
  tied.addEventListener("change", () => view.send("tie", { tied: tied.checked }), { signal: view.signal });
  const pins = ["A", "B"].map((name) =>
    button(`Pin ${name}`, `Keep this recipe as ${name}, to compare with`, () =>
      view.send("pin", { name }),
    ),
  );
  const select = () => {
    const { block, source } = grid.selected;
    const locked = block !== null && grid.isLocked(block, source);
    lock.textContent = locked ? "Unlock" : "Lock";
    lock.disabled = block === null || model.get("gone").includes(source);
    lock.setAttribute("aria-label", `${lock.textContent} ${source}${block === null ? "" : ` in ${block}`}`);
  };
  view.root.addEventListener("sf-select", select, { signal: view.signal });
  view.watch(["can_undo", "can_redo", "tied", "locked", "gone"], () => {
    undo.disabled = !model.get("can_undo");
    redo.disabled = !model.get("can_redo");
    tied.checked = model.get("tied");
    select();
  });
  view.root.addEventListener(
    "keydown",
    (event) => {
      const typing = event.target instanceof HTMLInputElement && event.target.type !== "range";
      if (!(event.ctrlKey || event.metaKey) || typing || event.target instanceof HTMLTextAreaElement) return;
      const key = event.key.toLowerCase();
      if (key === "z") view.send(event.shiftKey ? "redo" : "undo");
      else if (key === "y") view.send("redo");
      else return;
      event.preventDefault();
    },
    { signal: view.signal },
  );
  return element(
    "div",
    { class: "toolbar", role: "group", "aria-label": "Edit" },
    undo,
    redo,
    reset,
    lock,
    ...pins,
    element("label", { class: "tied" }, tied, " tie blocks"),
  );
}

/** @param {{model: Model, el: HTMLElement}} host */
function render(host) {
  const { model } = host;
  const view = mount(host, { label: "Routing inspector", kind: "inspector" });
  const grid = new WeightGrid(view, model);
  const help =
    "Drag a weight, or select it and type. Arrow keys move, + and − change it, L locks it. Select a source's " +
    "name to take it out.";
  view.body.append(
    element(
      "div",
      { class: "editor" },
      toolbar(view, model, grid),
      element("div", { class: "routing" }, element("div", { class: "grid-scroll" }, grid.table), scaleColumn(view, model)),
      element("p", { class: "help" }, help),
      trialScrubber(view, model),
      recipePanel(view, model),
    ),
    element("div", { class: "seen" }, pictures(view, model), scoreTable(view, model)),
  );
  view.watch(["look"], () => {
    const { score, reduction } = model.get("look");
    if (reduction === 1) {
      const { name, unit } = model.get("metric");
      view.announce(`this pair: ${name} ${scoreText(score, unit)}`);
    }
  });
  let scoring = false;
  view.watch(["scores"], () => {
    const scores = model.get("scores");
    const { name, unit, benchmark } = model.get("metric");
    if (scoring && scores.state !== "running") view.announce(`${benchmark}: ${name} ${scoreText(scores, unit)}`);
    scoring = scores.state === "running";
  });
  return view.close;
}

export default { render };
