// Small line charts as SVG, for series that grow while one looks. Numbers come from Python; null is a gap.

import { clamp, element } from "./_shared.js";
import {
  linePath,
  linear,
  logTicks,
  nearestIndex,
  numberText,
  scale,
  spread,
  ticks,
} from "./chart_scales.js";

/**
 * @typedef {object} Series
 * @property {string} name
 * @property {(number | null)[]} y one value for each x
 * @property {string} colour any CSS colour
 * @property {string} [dash] "dash" or "dot"; solid otherwise
 * @property {boolean} [dots] dots in place of a line
 * @property {boolean} [step] hold each value until the next
 * @property {number} [width] of the line in pixels
 * @property {[(number | null)[], (number | null)[]]} [band] ends of a range around y
 * @property {boolean} [quiet] not in the legend
 * @property {string} [help] what it is, said where the pointer rests on its name
 */

/**
 * @typedef {object} Chart
 * @property {string} title
 * @property {string} [help] what its values are, said where the pointer rests on the title
 * @property {string} [xHelp] the same of x
 * @property {string} xName what x counts, such as "generation"
 * @property {number[]} x ascending
 * @property {boolean} [xWhole] false where x has fractions
 * @property {Series[]} series
 * @property {number} [height] in pixels
 * @property {number} [width] in pixels; showCharts gives it
 * @property {[number, number]} [range] of y; the series' own unless given
 * @property {number[]} [yTicks] chosen unless given
 * @property {boolean} [log] logarithmic y
 * @property {number | null} [at] x to mark
 * @property {(x: number) => void} [pick] called with the x that was clicked
 */

const WIDTH = 480; // where there is no telling yet, as on a hidden page
const LEFT = 46;
const RIGHT = 10;
const TOP = 8;
const BOTTOM = 22;
/** @type {Record<string, string>} */
const DASH_PATTERNS = { dash: "6 4", dot: "2 3" };

/**
 * Put charts into a place, as wide as its columns are.
 * @param {HTMLElement} place of class sfkit-charts
 * @param {Chart[]} charts
 */
export function showCharts(place, charts) {
  // As many as there will be: columns are as wide as their number lets them.
  if (place.childElementCount !== charts.length) place.replaceChildren(...charts.map(() => element("div")));
  const width = place.firstElementChild?.clientWidth || WIDTH;
  place.replaceChildren(...charts.map((chart) => lineChart({ ...chart, width })));
}

/**
 * Call back whenever an element's width changes, until the signal aborts.
 * @param {HTMLElement} watched
 * @param {() => void} callback
 * @param {AbortSignal} signal
 */
export function onWidth(watched, callback, signal) {
  let width = watched.clientWidth;
  const observer = new ResizeObserver(() => {
    if (watched.clientWidth === width) return;
    width = watched.clientWidth;
    callback();
  });
  observer.observe(watched);
  signal.addEventListener("abort", () => observer.disconnect());
}

/**
 * A figure with title, lines, legend and the values under the pointer.
 * @param {Chart} chart
 * @returns {HTMLElement}
 */
export function lineChart(chart) {
  const { width = WIDTH, height = 130 } = chart;
  const values = chart.series.flatMap(({ y, band = [] }) => [y, ...band].flat()).filter((value) => value !== null);
  const range = chart.range ?? spread(values, chart.log ?? false);
  const toX = linear([chart.x[0] ?? 0, chart.x.at(-1) ?? 1], [LEFT, width - RIGHT]);
  const toY = scale(range, [height - BOTTOM, TOP], chart.log ?? false);
  const drawing = svg("svg", { viewBox: `0 0 ${width} ${height}`, class: "sfkit-chart-drawing", role: "img" });
  drawing.setAttribute("aria-label", `${chart.title}: ${described(chart)}`);
  drawing.append(...axes(chart, range, toX, toY, { width, height }));
  for (const series of chart.series) drawing.append(...drawn(series, chart.x, toX, toY));
  if (chart.at != null) drawing.append(upright(toX(chart.at), height, "sfkit-chart-at"));
  const readout = element("span", { class: "sfkit-chart-readout" });
  const caption = element(
    "figcaption",
    {},
    element(
      "span",
      { class: "sfkit-chart-title" },
      explained(chart.title, chart.help),
      " ",
      element("span", { class: "sfkit-chart-by" }, "by ", explained(chart.xName, chart.xHelp)),
    ),
    ...chart.series.filter(({ quiet }) => !quiet).map(legend),
    readout,
  );
  const figure = element("figure", { class: "sfkit-chart" }, caption, drawing);
  follow(drawing, chart, toX, { width, height }, readout);
  return figure;
}

/**
 * An SVG element.
 * @param {string} tag
 * @param {Record<string, string | number | null>} attributes
 * @param {...(Node | string)} children
 * @returns {SVGElement}
 */
export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== null) made.setAttribute(name, String(value));
  }
  made.append(...children);
  return made;
}

/**
 * @typedef {(value: number) => number} Scale
 * @typedef {{width: number, height: number}} Size in pixels
 */

/**
 * @param {Chart} chart
 * @param {[number, number]} range
 * @param {Scale} toX
 * @param {Scale} toY
 * @param {Size} size
 */
function axes(chart, range, toX, toY, { width, height }) {
  const [low, high] = range;
  const rows = chart.yTicks ?? (chart.log ? logTicks(low, high, 4) : ticks(low, high, 4));
  const columns = chart.x.length ? ticks(chart.x[0], chart.x[chart.x.length - 1], 8, chart.xWhole ?? true) : [];
  const parts = rows.flatMap((value) => [
    svg("line", { x1: LEFT, x2: width - RIGHT, y1: toY(value), y2: toY(value), class: "sfkit-chart-rule" }),
    svg("text", { x: LEFT - 6, y: toY(value) + 4, class: "sfkit-chart-y" }, numberText(value)),
  ]);
  const feet = columns.map((value) =>
    svg("text", { x: toX(value), y: height - 6, class: "sfkit-chart-x" }, numberText(value)),
  );
  return [...parts, ...feet];
}

/**
 * @param {Series} series
 * @param {number[]} x
 * @param {Scale} toX
 * @param {Scale} toY
 * @returns {SVGElement[]}
 */
function drawn(series, x, toX, toY) {
  const points = x.map((value, n) => {
    const y = series.y[n];
    return y == null ? null : /** @type {[number, number]} */ ([toX(value), toY(y)]);
  });
  const known = points.filter((point) => point !== null);
  const dots = known.map(([cx, cy]) => svg("circle", { cx, cy, r: 2.2, style: `fill: ${series.colour}` }));
  if (series.dots) {
    for (const dot of dots) dot.setAttribute("class", "sfkit-chart-dot");
    return dots;
  }
  const band = series.band ? [bandOf(series.band, series.colour, x, toX, toY)] : [];
  const line = svg("path", {
    d: linePath(points, series.step ?? false),
    class: "sfkit-chart-line",
    style: `stroke: ${series.colour}; stroke-width: ${series.width ?? 2}`,
    "stroke-dasharray": DASH_PATTERNS[series.dash ?? ""] ?? null,
  });
  return known.length === 1 ? [...band, line, ...dots] : [...band, line];
}

/**
 * The area between two lines.
 * @param {[(number | null)[], (number | null)[]]} ends
 * @param {string} colour
 * @param {number[]} x
 * @param {Scale} toX
 * @param {Scale} toY
 */
function bandOf([low, high], colour, x, toX, toY) {
  const along = (/** @type {(number | null)[]} */ y) =>
    x.flatMap((value, n) => (y[n] == null ? [] : [`${toX(value)},${toY(y[n])}`]));
  return svg("polygon", {
    points: [...along(high), ...along(low).reverse()].join(" "),
    class: "sfkit-chart-band",
    style: `fill: ${colour}`,
  });
}

/**
 * @param {number} x
 * @param {number} height
 * @param {string} kind
 */
function upright(x, height, kind) {
  return svg("line", { x1: x, x2: x, y1: TOP, y2: height - BOTTOM, class: kind });
}

/**
 * Words with what they mean for whoever rests the pointer on them.
 * @param {string} words
 * @param {string} [help]
 */
export function explained(words, help) {
  return help ? element("abbr", { title: help, class: "sfkit-chart-help" }, words) : words;
}

/** @param {Series} series */
export function legend({ name, colour, dash, dots, help }) {
  const key = svg("svg", { viewBox: "0 0 20 8", class: "sfkit-chart-key", "aria-hidden": "true" });
  const style = dots ? `fill: ${colour}` : `stroke: ${colour}; stroke-width: 2.5`;
  const pattern = DASH_PATTERNS[dash ?? ""] ?? null;
  key.append(
    dots
      ? svg("circle", { cx: 10, cy: 4, r: 3, style })
      : svg("path", { d: "M0 4H20", style, "stroke-dasharray": pattern }),
  );
  return element("span", { class: "sfkit-chart-legend" }, key, explained(name, help));
}

/** @param {Chart} chart */
function described({ x, series, xName }) {
  if (!x.length) return "nothing yet";
  const last = series.filter(({ dots, quiet }) => !dots && !quiet).slice(0, 8);
  const parts = last.map(({ name, y }) => `${name} ${valueText(y.at(-1))}`);
  return `${xName} ${x[0]} to ${x.at(-1)}; at the end ${parts.join(", ")}`;
}

/** @param {number | null | undefined} value */
function valueText(value) {
  return value == null ? "none" : numberText(value);
}

/**
 * Values under the pointer, and the x that a click chooses.
 * @param {SVGElement} drawing
 * @param {Chart} chart
 * @param {Scale} toX
 * @param {Size} size
 * @param {HTMLElement} readout
 */
function follow(drawing, chart, toX, { width, height }, readout) {
  const cursor = upright(0, height, "sfkit-chart-cursor");
  const nearest = (/** @type {MouseEvent} */ event) => {
    const box = drawing.getBoundingClientRect();
    const place = ((event.clientX - box.left) / (box.width || 1)) * width;
    return nearestIndex(chart.x.map(toX), clamp(place, LEFT, width - RIGHT));
  };
  drawing.addEventListener("pointermove", (event) => {
    const n = nearest(event);
    if (n < 0) return;
    for (const name of ["x1", "x2"]) cursor.setAttribute(name, String(toX(chart.x[n])));
    drawing.append(cursor);
    const parts = chart.series
      .filter(({ y, name }) => y[n] != null && name)
      .map(({ name, y }) => `${name} ${valueText(y[n])}`);
    readout.textContent = `${chart.xName} ${chart.x[n]}: ${parts.slice(0, 6).join(", ")}`;
  });
  drawing.addEventListener("pointerleave", () => {
    cursor.remove();
    readout.textContent = "";
  });
  if (chart.pick) drawing.addEventListener("click", (event) => chart.pick?.(chart.x[nearest(event)]));
}
