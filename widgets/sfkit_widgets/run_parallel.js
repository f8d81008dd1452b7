// Parallel coordinates: a line a candidate of Stage 2, an axis a weight, a scale or the score.

import { element } from "./_shared.js";
import { svg } from "./charts.js";
import { linear, numberText } from "./chart_scales.js";

/**
 * @typedef {object} Axes
 * @property {string[]} names
 * @property {number[]} lows
 * @property {number[]} highs
 * @property {number[]} numbers of the evaluations
 * @property {number[][]} lines values on each axis, the best drawn last
 * @property {number} leading lines at the end that are of the best tenth
 */

const ROOM = { height: 220, top: 22, bottom: 44, side: 40 };
const LONGEST = 18; // letters of a name below its axis

/**
 * @param {Axes} axes
 * @param {number} width in pixels
 */
export function parallelPicture(axes, width) {
  const wide = Math.max(width || 480, 62 * axes.names.length);
  const { height, top, bottom, side } = ROOM;
  const toX = linear([0, axes.names.length - 1], [side, wide - side]);
  const toY = axes.names.map((_, n) => linear([axes.lows[n], axes.highs[n]], [height - bottom, top]));
  const drawing = svg("svg", { viewBox: `0 0 ${wide} ${height}`, width: wide, height, role: "img" });
  drawing.setAttribute("class", "sfkit-chart-drawing");
  drawing.setAttribute("aria-label", `${axes.lines.length} candidates over ${axes.names.join(", ")}`);
  axes.lines.forEach((values, n) => {
    const points = values.map((value, a) => `${toX(a).toFixed(1)},${toY[a](value).toFixed(1)}`).join(" ");
    const leads = n >= axes.lines.length - axes.leading;
    const line = svg("polyline", { points, class: leads ? "sfkit-runs-line" : "sfkit-runs-faint" });
    const told = values.map((value, a) => `${axes.names[a]} ${numberText(value)}`).join(", ");
    line.append(svg("title", {}, `evaluation ${axes.numbers[n]}: ${told}`));
    drawing.append(line);
  });
  axes.names.forEach((name, a) => {
    const x = toX(a);
    const short = name.length > LONGEST ? `${name.slice(0, LONGEST - 1)}…` : name;
    const foot = svg("text", { x, y: height - bottom + (a % 2 ? 36 : 22), class: "sfkit-chart-x" }, short);
    foot.append(svg("title", {}, name));
    drawing.append(
      svg("line", { x1: x, x2: x, y1: top, y2: height - bottom, class: "sfkit-chart-rule" }),
      svg("text", { x, y: top - 6, class: "sfkit-chart-x" }, numberText(axes.highs[a])),
      svg("text", { x, y: height - bottom + 10, class: "sfkit-chart-x" }, numberText(axes.lows[a])),
      foot,
    );
  });
  const scroll = element("div", { class: "sfkit-runs-scroll" }, drawing);
  if (wide > width) scroll.tabIndex = 0; // to scroll it by keyboard
  const says = "Every candidate: mean weights, scales and score; the best tenth in colour";
  return element("figure", { class: "sfkit-runs-figure" }, element("figcaption", {}, says), scroll);
}
