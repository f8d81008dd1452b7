// Beside the individuals: where one comes from and what came of it, and the best subsets of all.

import { element } from "./_shared.js";
import { foretold } from "./model_panel.js";
import { marks } from "./population_grid.js";

/** @typedef {import("./population_shares.js").Evolution} Evolution */
/** @typedef {import("./population_shares.js").Person} Person */

/**
 * @param {Evolution} now
 * @param {number | null} number who is looked at
 * @param {(number: number) => void} jump go to the generation where an individual first is
 * @param {Partial<import("./model_panel.js").Model>} model empty where individuals are bred
 */
export function descentPanel(now, number, jump, model = {}) {
  const person = now.people[number ?? -1];
  const proposed = model.number !== undefined;
  const kind = proposed ? "sfkit-population-descent sfkit-population-proposed" : "sfkit-population-descent";
  const panel = element("section", { class: kind, "aria-label": "Descent" });
  panel.append(element("h4", {}, proposed ? "Where does it come from?" : "Who descends from whom?"));
  if (!person || number === null) {
    panel.append(element("p", { class: "sfkit-population-hint" }, "Point at an individual, or move to it."));
    return panel;
  }
  panel.append(line(now, number, "candidate", null), element("p", {}, made(person)));
  if (proposed) {
    panel.append(element("p", {}, foretold(model, number)));
    return panel;
  }
  for (const parent of person.parents) panel.append(line(now, parent, "parent", jump));
  const children = offspring(now.people, number);
  panel.append(element("p", {}, offspringText(now, children)));
  return panel;
}

/**
 * @param {Evolution} now
 * @param {(number: number) => void} jump
 */
export function archivePanel(now, jump) {
  const panel = element("section", { "aria-label": "Archive" });
  panel.append(element("h4", {}, `The best ${now.archive.length} subsets of all generations`));
  if (!now.archive.length) panel.append(element("p", {}, "No subset has a score yet."));
  const best = now.archive.map((number, n) => line(now, number, String(n + 1), jump));
  panel.append(element("div", { class: "sfkit-population-best" }, ...best));
  return panel;
}

/** @type {Record<string, string>} How candidates of a search by a model come about. */
const PROPOSED = {
  all: "All sources together, before there was a model",
  known: "Scored before this search",
  model: "Proposed by the model",
  single: "A source alone, for the model to learn from",
};

/**
 * How an individual came about.
 * @param {Pick<Person, "operators" | "parents">} person
 */
export function made({ operators, parents }) {
  const [first, ...then] = operators;
  const after = then.length ? `, then ${then.join(", then ")}` : "";
  if (PROPOSED[first]) return `${PROPOSED[first]}.`;
  if (first === "start") return `Given to start from${after}.`;
  if (!parents.length) return `Drawn at ${first ?? "random"}${after}.`;
  const from = parents.length > 1 ? parents.join(" and ") : `${parents[0]}`;
  return `${first === "copy" ? "Copy" : "Crossover"} of ${from}${after}.`;
}

/**
 * Numbers of those bred from an individual, ascending.
 * @param {Record<string, Pick<Person, "parents">>} people
 * @param {number} number
 */
export function offspring(people, number) {
  const born = Object.entries(people).filter(([, { parents }]) => parents.includes(number));
  return born.map(([child]) => Number(child));
}

/**
 * @param {Evolution} now
 * @param {number[]} children
 */
function offspringText(now, children) {
  if (!children.length) return "None of its offspring survived in the generations shown.";
  const named = children.slice(0, 6).map((child) => `${child} (${now.people[child].operators.join(", ")})`);
  const more = children.length > 6 ? ` and ${children.length - 6} more` : "";
  return `${children.length} surviving offspring: ${named.join("; ")}${more}.`;
}

/**
 * A row of number, marks and score.
 * @param {Evolution} now
 * @param {number} number
 * @param {string} name
 * @param {((number: number) => void) | null} jump
 */
function line(now, number, name, jump) {
  const person = now.people[number];
  if (!person) return element("p", {}, `${name} ${number}: not among the generations shown`);
  const strip = element("span", { class: "sfkit-population-strip", role: "img" }, ...marks(now, person, ""));
  strip.setAttribute("aria-label", person.sources.map((s) => now.sources[s]).join(", "));
  const row = element("div", { class: "sfkit-population-line" }, element("span", {}, name));
  const title = "Show the generation where it first is";
  const label = jump ? element("button", { type: "button", title }, String(number)) : element("b", {}, String(number));
  if (jump) label.addEventListener("click", () => jump(number));
  row.append(label, strip, element("span", {}, person.score));
  return row;
}
