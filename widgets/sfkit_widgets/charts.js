// Small line charts as SVG, for series that grow while one looks. Numbers come from Python; null is a gap.

import { clamp, element } from "./_shared.js";

/**
 * @typedef {object} Series
 * @property {string} name
 * @property {(number | null)[]} y one value for each x
 * @property {string} colour any CSS colour
 * @property {string} [dash] "solid", "dash" or "dot"
 * @property {boolean} [dots] dots in place of a line
 * @property {boolean} [step] hold each value until the next
 * @property {number} [width] of the line in pixels
 * @property {boolean} [quiet] not in the legend
 */

/**
 * @typedef {object} Chart
 * @property {string} title
 * @property {string} xName what x counts, such as "generation"
 * @property {number[]} x ascending
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
const DASH_PATTERNS = { solid: null, dash: "6 4", dot: "2 3" };

/**
 * Put charts into a place, as wide as its columns are.
 * @param {HTMLElement} place of class sfkit-charts
 * @param {Chart[]} charts
 */
export function showCharts(place, charts) {
  if (!place.firstElementChild) place.append(element("div"));
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
  const values = chart.series.flatMap(({ y }) => y.filter((value) => value !== null));
  const range = chart.range ?? spread(values, chart.log ?? false);
  const toX = linear([chart.x[0] ?? 0, chart.x.at(-1) ?? 1], [LEFT, width - RIGHT]);
  const toY = scale(range, [height - BOTTOM, TOP], chart.log ?? false);
  const drawing = svg("svg", { viewBox: `0 0 ${width} ${height}`, class: "sfkit-chart-drawing", role: "img" });
  drawing.setAttribute("aria-label", `${chart.title}: ${described(chart)}`);
  drawing.append(...axes(chart, range, toX, toY, width, height));
  for (const series of chart.series) drawing.append(...drawn(series, chart.x, toX, toY));
  if (chart.at != null) drawing.append(upright(toX(chart.at), height, "sfkit-chart-at"));
  const readout = element("span", { class: "sfkit-chart-readout" });
  const caption = element(
    "figcaption",
    {},
    element("span", { class: "sfkit-chart-title" }, chart.title),
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
 * @param {[number, number]} domain
 * @param {[number, number]} range
 * @returns {(value: number) => number}
 */
export function linear([low, high], [from, to]) {
  const span = high - low || 1;
  return (value) => from + ((value - low) / span) * (to - from);
}

/**
 * @param {[number, number]} domain
 * @param {[number, number]} range
 * @param {boolean} log
 */
export function scale(domain, range, log) {
  if (!log) return linear(domain, range);
  const inner = linear([Math.log(domain[0]), Math.log(domain[1])], range);
  return (/** @type {number} */ value) => inner(Math.log(value));
}

/**
 * The ends of an axis: the values' own with a margin; something sensible where there are none.
 * @param {number[]} values
 * @param {boolean} log
 * @returns {[number, number]}
 */
export function spread(values, log) {
  if (!values.length) return log ? [0.1, 1] : [0, 1];
  const low = values.reduce((a, b) => Math.min(a, b));
  const high = values.reduce((a, b) => Math.max(a, b));
  if (log) return [low * 0.8, high * 1.25];
  const margin = 0.06 * (high - low) || Math.abs(high) * 0.1 || 1;
  return [low - margin, high + margin];
}

/**
 * Round numbers between two ends, at most `most` of them: 1, 2 or 5 times a power of ten apart.
 * @param {number} low
 * @param {number} high
 * @param {number} most at least 2
 * @param {boolean} whole whole numbers only
 * @returns {number[]}
 */
export function ticks(low, high, most = 5, whole = false) {
  const rough = (high - low) / most;
  if (!(rough > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(rough));
  const found = [1, 2, 5, 10].map((digit) => digit * power).find((step) => (high - low) / step <= most) ?? rough;
  const step = whole ? Math.max(1, Math.round(found)) : found;
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: Math.max(count, 0) }, (_, n) => Number(((first + n) * step).toPrecision(12)));
}

/**
 * 1, 2 and 5 times powers of ten between two positive ends, thinned to at most `most`; evenly
 * apart where that gives fewer than two.
 * @param {number} low
 * @param {number} high
 * @param {number} most
 * @returns {number[]}
 */
export function logTicks(low, high, most = 5) {
  const all = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power += 1) {
    for (const digit of [1, 2, 5]) {
      const tick = Number((digit * 10 ** power).toPrecision(3));
      if (tick >= low && tick <= high) all.push(tick);
    }
  }
  if (all.length < 2) return ticks(low, high, most);
  const every = Math.ceil(all.length / most);
  return all.filter((_, n) => n % every === 0);
}

/**
 * Four significant digits, without the exponent where that is short.
 * @param {number} value
 */
export function numberText(value) {
  return String(Number(value.toPrecision(4)));
}

/**
 * Position of the number nearest to `value`; -1 where there is none.
 * @param {number[]} numbers ascending
 * @param {number} value
 */
export function nearestIndex(numbers, value) {
  return numbers.reduce(
    (best, number, n) => (best < 0 || Math.abs(number - value) < Math.abs(numbers[best] - value) ? n : best),
    -1,
  );
}

function axes(chart, range, toX, toY, width, height) {
  const rows = chart.yTicks ?? (chart.log ? logTicks(...range, 4) : ticks(...range, 4));
  const columns = chart.x.length ? ticks(chart.x[0], chart.x[chart.x.length - 1], 8, true) : [];
  const parts = rows.flatMap((value) => [
    svg("line", { x1: LEFT, x2: width - RIGHT, y1: toY(value), y2: toY(value), class: "sfkit-chart-rule" }),
    svg("text", { x: LEFT - 6, y: toY(value) + 4, class: "sfkit-chart-y" }, numberText(value)),
  ]);
  const feet = columns.map((value) =>
    svg("text", { x: toX(value), y: height - 6, class: "sfkit-chart-x" }, numberText(value)),
  );
  return [...parts, ...feet];
}

function drawn(series, x, toX, toY) {
  const known = x.flatMap((value, n) => (series.y[n] == null ? [] : [[toX(value), toY(series.y[n])]]));
  if (series.dots) {
    return known.map(([cx, cy]) =>
      svg("circle", { cx, cy, r: 2.2, style: `fill: ${series.colour}`, class: "sfkit-chart-dot" }),
    );
  }
  const path = linePath(
    x.map((value, n) => (series.y[n] == null ? null : [toX(value), toY(series.y[n])])),
    series.step ?? false,
  );
  const line = svg("path", {
    d: path,
    class: "sfkit-chart-line",
    style: `stroke: ${series.colour}; stroke-width: ${series.width ?? 2}`,
    "stroke-dasharray": DASH_PATTERNS[series.dash ?? "solid"],
  });
  const single = known.length === 1 ? [svg("circle", { cx: known[0][0], cy: known[0][1], r: 2.5 })] : [];
  for (const dot of single) dot.setAttribute("style", `fill: ${series.colour}`);
  return [line, ...single];
}

/**
 * @param {([number, number] | null)[]} points null where the line is broken
 * @param {boolean} step
 */
export function linePath(points, step) {
  let pen = "M";
  let path = "";
  for (const point of points) {
    if (point === null) {
      pen = "M";
      continue;
    }
    const [x, y] = point.map((value) => Math.round(value * 10) / 10);
    path += pen === "L" && step ? `H${x}V${y}` : `${pen}${x} ${y}`;
    pen = "L";
  }
  return path;
}

function upright(x, height, kind) {
  return svg("line", { x1: x, x2: x, y1: TOP, y2: height - BOTTOM, class: kind });
}

function legend({ name, colour, dash, dots }) {
  const key = svg("svg", { viewBox: "0 0 20 8", class: "sfkit-chart-key", "aria-hidden": "true" });
  const style = dots ? `fill: ${colour}` : `stroke: ${colour}; stroke-width: 2.5`;
  const pattern = DASH_PATTERNS[dash ?? "solid"];
  key.append(
    dots
      ? svg("circle", { cx: 10, cy: 4, r: 3, style })
      : svg("path", { d: "M0 4H20", style, "stroke-dasharray": pattern }),
  );
  return element("span", { class: "sfkit-chart-legend" }, key, name);
}

function described({ x, series, xName }) {
  if (!x.length) return "nothing yet";
  const last = series.filter(({ dots, quiet }) => !dots && !quiet).slice(0, 8);
  const parts = last.map(({ name, y }) => `${name} ${y.at(-1) == null ? "none" : numberText(y.at(-1))}`);
  return `${xName} ${x[0]} to ${x.at(-1)}; at the end ${parts.join(", ")}`;
}

/** Values under the pointer, and the x that a click chooses. */
function follow(drawing, chart, toX, { width, height }, readout) {
  const cursor = upright(0, height, "sfkit-chart-cursor");
  const nearest = (event) => {
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
      .map(({ name, y }) => `${name} ${numberText(y[n])}`);
    readout.textContent = `${chart.xName} ${chart.x[n]}: ${parts.slice(0, 6).join(", ")}`;
  });
  drawing.addEventListener("pointerleave", () => {
    cursor.remove();
    readout.textContent = "";
  });
  if (chart.pick) drawing.addEventListener("click", (event) => chart.pick?.(chart.x[nearest(event)]));
}
