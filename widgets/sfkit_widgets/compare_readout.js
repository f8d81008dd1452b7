// What stands beside the panels: values under the cursor, colour bars, outlier regions.

import { pixelText } from "./compare_paint.js";
import { element } from "./_shared.js";

/** @typedef {import("./compare_pictures.js").Pictures} Pictures */
/** @typedef {import("./compare_pictures.js").Region} Region */

/**
 * The values under the cursor as a table, one row a network.
 * @param {HTMLTableElement} table
 * @param {Pictures} pictures
 * @param {number[]} cursor
 * @param {number} reference
 */
export function fillValues(table, pictures, cursor, reference) {
  const { networks, kind, unit } = pictures.scene;
  const found = cursor.length === 2 ? pictures.values(cursor[0], cursor[1], reference) : null;
  const where = found ? `x ${cursor[0]}, y ${cursor[1]}` : "point at a panel";
  const truth = found ? pixelText(found.truth) : "";
  const heads = ["disparity (px)", `${kind} (${unit})`, `against ${networks[reference].name}`];
  const rows = networks.map(({ name }, number) => {
    const values = found?.networks[number];
    const cells = values
      ? [disparityText(values), errorText(values), pixelText(values.against, true)]
      : ["", "", ""];
    return element(
      "tr",
      {},
      element("th", { scope: "row" }, name),
      ...cells.map((text) => element("td", {}, text)),
    );
  });
  table.replaceChildren(
    element("caption", {}, `Values at the cursor: ${where}`),
    element(
      "thead",
      {},
      element("tr", {}, element("td"), ...heads.map((text) => element("th", { scope: "col" }, text))),
    ),
    element("tbody", {}, ...(pictures.labelled ? [truthRow(truth)] : []), ...rows),
  );
}

/** @param {string} truth */
function truthRow(truth) {
  const name = element("th", { scope: "row" }, "ground truth");
  return element("tr", {}, name, element("td", {}, truth), element("td"), element("td"));
}

/** @param {{disparity: number, cut: string}} values */
function disparityText({ disparity, cut }) {
  return Number.isNaN(disparity) ? "not finite" : cut + pixelText(disparity);
}

/** @param {{error: number, cut: string}} values an error of a value that was cut off is larger */
function errorText({ error, cut }) {
  return (cut && Number.isFinite(error) ? "≥ " : "") + pixelText(error);
}

/**
 * The same in one sentence, for the live region.
 * @param {Pictures} pictures
 * @param {number[]} cursor
 * @param {number} reference
 */
export function valuesText(pictures, cursor, reference) {
  const { truth, networks } = pictures.values(cursor[0], cursor[1], reference);
  const { kind, unit } = pictures.scene;
  const said = networks.map((values, number) => {
    const { name } = pictures.scene.networks[number];
    if (!Number.isFinite(values.error)) return `${name} ${disparityText(values)}`;
    return `${name} ${disparityText(values)} px, ${kind} ${errorText(values)} ${unit}`;
  });
  const known = Number.isNaN(truth) ? "no ground truth" : `ground truth ${pixelText(truth)} px`;
  return `x ${cursor[0]}, y ${cursor[1]}: ${known}; ${said.join("; ")}`;
}

/**
 * A colour bar with its ticks.
 * @param {{label: string, table: Uint32Array, ticks: {at: number, text: string}[], mark: number | null}} bar
 */
export function colourBar({ label, table, ticks, mark }) {
  const stops = Array.from({ length: 17 }, (_, i) => {
    const colour = table[Math.round((i / 16) * 255)];
    return `rgb(${colour & 255} ${(colour >> 8) & 255} ${(colour >> 16) & 255})`;
  });
  const strip = element("div", {
    class: "sfkit-compare-strip",
    style: `background: linear-gradient(to right, ${stops.join(", ")})`,
  });
  if (mark !== null) strip.append(element("i", { style: `left: ${100 * mark}%` }));
  const scale = element(
    "div",
    { class: "sfkit-compare-ticks" },
    ...ticks.map(({ at, text }) => element("span", { style: `left: ${100 * at}%` }, text)),
  );
  const name = element("span", { class: "sfkit-compare-barname" }, label);
  return element(
    "div",
    { class: "sfkit-compare-bar", role: "img", "aria-label": `${label}: ${ticks.map(({ text }) => text).join(", ")}` },
    name,
    strip,
    scale,
  );
}

/**
 * The colour bars of what is shown.
 * @param {Pictures} pictures
 * @param {string} shown
 * @param {number[]} limits
 */
export function colourBars(pictures, shown, limits) {
  const { palettes, scene, tables } = pictures;
  const even = (/** @type {number} */ low, /** @type {number} */ high) =>
    [0, 0.25, 0.5, 0.75, 1].map((at) => ({ at, text: shortNumber(low + at * (high - low)) }));
  const bars = [
    colourBar({
      label: "disparity (px)",
      table: tables.disparity,
      ticks: ends(even(limits[0], limits[1])),
      mark: null,
    }),
  ];
  if (shown !== "disparity") {
    const span = palettes.errorSpan;
    const octaves = Array.from({ length: 2 * span + 1 }, (_, i) => i - span);
    const ticks = octaves.map((octave) => ({
      at: (octave + span) / (2 * span),
      text: shortNumber(scene.threshold * 2 ** octave),
    }));
    bars.push(
      colourBar({
        label: `${scene.kind} (${scene.unit}), threshold ${shortNumber(scene.threshold)}`,
        table: tables.error,
        ticks: ends(ticks),
        mark: 0.5,
      }),
    );
  }
  if (shown === "better") {
    const reach = palettes.advantageSpan * scene.threshold;
    bars.push(
      colourBar({
        label: `${scene.kind} less that of A (${scene.unit}), blue: better`,
        table: tables.error,
        ticks: ends(even(-reach, reach)),
        mark: 0.5,
      }),
    );
  }
  return bars;
}

/**
 * Ticks whose ends say that beyond them the colour stays.
 * @param {{at: number, text: string}[]} ticks
 */
function ends(ticks) {
  return ticks.map(({ at, text }) => ({ at, text: at === 0 ? `≤ ${text}` : at === 1 ? `≥ ${text}` : text }));
}

/** @param {number} value */
export function shortNumber(value) {
  return String(Number(value.toPrecision(3))).replace("-", "−");
}

/**
 * What a region's button says.
 * @param {Region} region
 * @param {string} unit of its errors
 */
export function regionText({ pixels, above, mean, worst }, unit) {
  const size = `${pixels} px beyond ${shortNumber(above)} ${unit}`;
  if (worst === null || mean === null) return `${size}, not finite`;
  return `${size}: mean ${pixelText(mean)}, worst ${pixelText(worst)}`;
}

/**
 * A button for each region; the one in focus stays in focus.
 * @param {HTMLElement} list
 * @param {Region[]} regions
 * @param {number} pressed
 * @param {string} unit of their errors
 */
export function fillRegions(list, regions, pressed, unit) {
  const buttons = regions.map((region, i) =>
    element(
      "button",
      { type: "button", "data-number": i, "aria-pressed": String(i === pressed) },
      regionText(region, unit),
    ),
  );
  const focused = list.contains(document.activeElement);
  list.replaceChildren(...buttons.map((button) => element("li", {}, button)));
  if (focused) buttons[pressed]?.focus();
}
