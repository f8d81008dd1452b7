import assert from "node:assert/strict";
import { test } from "node:test";
import {
  linePath,
  linear,
  logTicks,
  nearestIndex,
  numberText,
  scale,
  spread,
  ticks,
} from "../../../widgets/sfkit_widgets/chart_scales.js";
import { byPrediction, foretold } from "../../../widgets/sfkit_widgets/model_panel.js";
import { made, offspring } from "../../../widgets/sfkit_widgets/population_descent.js";
import { ofIncumbent } from "../../../widgets/sfkit_widgets/routing_view.js";
import { inOrder, onCommonAxis } from "../../../widgets/sfkit_widgets/run_table.js";
import { percent } from "../../../widgets/sfkit_widgets/search_control.js";

test("ticks are round numbers between the ends", () => {
  assert.deepEqual(ticks(0, 1), [0, 0.2, 0.4, 0.6, 0.8, 1]);
  assert.deepEqual(ticks(23.7, 26.9, 4), [24, 25, 26]);
  assert.deepEqual(ticks(0, 3, 8, true), [0, 1, 2, 3]);
  assert.deepEqual(ticks(2, 2), [2]);
});

test("ticks of a logarithmic axis are 1, 2 and 5, or evenly apart where those are too few", () => {
  assert.deepEqual(logTicks(0.01, 10, 5), [0.01, 0.05, 0.2, 1, 5]);
  assert.deepEqual(logTicks(0.32, 0.62, 4), [0.4, 0.5, 0.6]);
});

test("an axis has room around its values, and ends where there is none", () => {
  assert.deepEqual(spread([], false), [0, 1]);
  assert.deepEqual(spread([2], false), [1.8, 2.2]);
  assert.deepEqual(spread([1, 2], true), [0.8, 2.5]);
});

test("scales map ends to ends", () => {
  assert.equal(linear([0, 10], [100, 200])(5), 150);
  assert.equal(linear([3, 3], [100, 200])(3), 100);
  assert.ok(Math.abs(scale([1, 100], [0, 2], true)(10) - 1) < 1e-12);
});

test("lines break at gaps, and hold values where they step", () => {
  assert.equal(linePath([[0, 1], [2, 3], null, [4, 5]], false), "M0 1L2 3M4 5");
  assert.equal(linePath([[0, 1], [2, 3]], true), "M0 1H2V3");
});

test("numbers have four digits", () => {
  assert.deepEqual([0.123456, 25, 1234.56].map(numberText), ["0.1235", "25", "1235"]);
});

test("the nearest is found", () => {
  assert.deepEqual([nearestIndex([0, 10, 20], 14), nearestIndex([], 1)], [1, -1]);
});

test("an individual's origin is told in words", () => {
  const told = (operators, parents) => made({ operators, parents });
  assert.equal(told(["random"], []), "Drawn at random.");
  assert.equal(told(["start"], []), "Given to start from.");
  assert.equal(told(["copy", "delete"], [3]), "Copy of 3, then delete.");
  assert.equal(told(["crossover"], [3, 4]), "Crossover of 3 and 4.");
  assert.equal(told(["model"], []), "Proposed by the model.");
});

test("offspring name their parent", () => {
  assert.deepEqual(offspring({ 5: { parents: [1, 2] }, 6: { parents: [3] } }, 1), [5]);
});

test("the line of the best so far begins with the first score", () => {
  assert.deepEqual(ofIncumbent([7, 5, 6], [null, 1, 1]), [null, 5, 5]);
});

test("a bar is never more than full, and full where there is nothing to do", () => {
  assert.deepEqual([percent(1, 3), percent(5, 4), percent(0, 0)], [33.3, 100, 100]);
});

test("what was expected is told of proposals alone, and set beside what came in its order", () => {
  const model = { number: [7, 9], mean: [24.356, 23], sd: [0.37991, 1], bound: [23.4062, 22], score: [25, null] };
  assert.equal(foretold(model, 7), "The model expected 24.36 ± 0.38, and chose it by its bound of 23.41.");
  assert.equal(foretold(model, 8), "");
  assert.equal(foretold({}, 8), "");
  assert.deepEqual(byPrediction(model), { x: [23, 24.356], y: [null, 25] });
});

test("searches share an axis: each holds its best until its last candidate", () => {
  const rows = [
    { numbers: [0, 2], best: [null, 3] },
    { numbers: [1, 4], best: [5, 4] },
  ];
  assert.deepEqual(onCommonAxis(rows), { x: [0, 1, 2, 4], ys: [[null, null, 3, null], [null, 5, 5, 4]] });
});

test("the table sorts by numbers or texts, what is not known last", () => {
  const rows = [["b", 2], ["a", null], ["c", 10]].map(([name, best]) => ({ cells: [[name, name], ["", best]] }));
  const names = (column, up) => inOrder(rows, column, up).map(({ cells }) => cells[0][0]).join("");
  assert.deepEqual([names(0, true), names(0, false), names(1, true), names(1, false)], ["abc", "cba", "bca", "cba"]);
});
