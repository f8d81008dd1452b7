// The recipe as text, to copy, to load and to save a network of.

import { element } from "./_shared.js";

/** @typedef {import("./_shared.js").Model} Model */
/** @typedef {import("./_shared.js").View} View */

/**
 * @param {View} view
 * @param {Model} model
 * @returns {HTMLElement}
 */
export function recipePanel(view, model) {
  const { signal } = view;
  const text = element("textarea", { rows: 12, spellcheck: "false", "aria-label": "Recipe as JSON" });
  const copy = element("button", { type: "button" }, "Copy");
  const load = element("button", { type: "button" }, "Load this text");
  const file = element("input", {
    type: "text",
    value: "merged.safetensors",
    "aria-label": "File for the merged network",
  });
  const save = element("button", { type: "button" }, "Save network");
  const saved = element("output", {});
  copy.addEventListener(
    "click",
    async () => {
      text.value = model.get("recipe_json"); // not what someone has typed over it
      const done = await copied(text);
      view.announce(done ? "Recipe copied" : "Select the text and copy it: this page may not");
      copy.textContent = done ? "Copied" : "Copy";
    },
    { signal },
  );
  load.addEventListener("click", () => view.send("load", { text: text.value }), { signal });
  save.addEventListener("click", () => view.send("save", { path: file.value }), { signal });
  view.watch(["recipe_json"], () => {
    text.value = model.get("recipe_json");
    copy.textContent = "Copy";
  });
  view.watch(["saved"], () => {
    saved.textContent = model.get("saved") ? `saved as ${model.get("saved")}` : "";
  });
  return element(
    "details",
    { class: "recipe" },
    element("summary", {}, "Recipe and network"),
    text,
    element("div", { class: "buttons" }, copy, load),
    element("div", { class: "buttons" }, file, save, saved),
  );
}

/**
 * Copy a text area's text, by the old way where a page may not use the new one.
 * @param {HTMLTextAreaElement} area
 */
async function copied(area) {
  try {
    await navigator.clipboard.writeText(area.value);
    return true;
  } catch {
    area.select();
    return document.execCommand("copy");
  }
}
