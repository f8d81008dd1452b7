import assert from "node:assert/strict";
import { test } from "node:test";
import { draggedWeight, parseWeight } from "../../../widgets/sfkit_widgets/inspector_grid.js";
import { blinked } from "../../../widgets/sfkit_widgets/inspector_pictures.js";
import { caught } from "../../../widgets/sfkit_widgets/inspector_scales.js";
import { differenceText, scoreText } from "../../../widgets/sfkit_widgets/inspector_scores.js";
import { chartPoints, drawnTrials, keyText, trialText } from "../../../widgets/sfkit_widgets/inspector_trials.js";

const known = (value) => ({ state: "known", value });
const unknown = { state: "unknown", value: null };

test("weights are read as people write them", () => {
  const read = { "0.25": 0.25, ".25": 0.25, "0,25": 0.25, " 25 % ": 0.25, 1: 1, "0": 0, "1.": 1, "100%": 1 };
  for (const [text, value] of Object.entries(read)) assert.equal(parseWeight(text), value, text);
  for (const text of ["", "1.1", "101%", "-0.1", "a", "0.1.2", "1e-3", "0,1,2", "Infinity", "."]) {
    assert.equal(parseWeight(text), null, text);
  }
});

test("a drag to the right or upwards adds, and stops at the ends", () => {
  assert.equal(draggedWeight(0.5, 80, 0), 1);
  assert.equal(draggedWeight(0.5, 0, -16), 0.6);
  assert.equal(draggedWeight(0.5, 0, 500), 0);
});

test("the neutral scale catches the slider", () => {
  assert.equal(caught(1.024), 1);
  assert.equal(caught(0.976), 1);
  assert.equal(caught(1.03), 1.03);
});

test("pins blink in turn, one pin with the edit", () => {
  assert.equal(blinked("A", ["A", "B"]), "B");
  assert.equal(blinked("B", ["A", "B"]), "A");
  assert.equal(blinked("edited", ["A", "B"]), "A");
  assert.equal(blinked("A", ["A"]), "edited");
  assert.equal(blinked("edited", ["A"]), "A");
});

test("scores have units, and say why there is none", () => {
  assert.equal(scoreText(known(20.294), "%"), "20.29 %");
  assert.equal(scoreText({ state: "failed", value: null }, "px"), "failed: not finite");
  assert.equal(scoreText({ state: "running", value: null }, "%"), "scoring …");
  assert.equal(scoreText(unknown, "%"), "–");
});

test("differences are in points of percent, or pixels; lower is better", () => {
  assert.equal(differenceText(known(20), known(21.5), "%"), "edited is 1.50 points better");
  assert.equal(differenceText(known(1.2), known(1.1), "px"), "edited is 0.10 px worse");
  assert.equal(differenceText(known(1.2), known(1.2001), "px"), "the same");
  assert.equal(differenceText(known(1.2), unknown, "px"), "");
});

test("the chart's key tells its ends, the worst tenth aside", () => {
  const scores = [30, null, 20, 21, 22, 23, 24, 25, 26, 27, 90];
  assert.ok(keyText(scores, "%").includes("from 20.00 to 30.00 % and more"));
  assert.equal(keyText([], "%"), "dots: the score of each trial; line: the best so far");
});

test("of many trials an even choice and every new best is drawn", () => {
  const best = Array.from({ length: 1000 }, (_, n) => (n < 501 ? 0 : 501));
  const drawn = drawnTrials(best, 100);
  assert.ok(drawn.length <= 103);
  assert.ok([0, 501, 999].every((n) => drawn.includes(n)));
  assert.deepEqual(drawnTrials([0, 0, 2], 400), [0, 1, 2]);
  assert.deepEqual(drawnTrials([], 400), []);
});

test("better scores lie lower, failed ones on the upper edge", () => {
  const [first, second, failed] = chartPoints([30, 20, null], [0, 1, 2]);
  assert.ok(second.y > first.y && first.y >= failed.y);
  assert.deepEqual([first.failed, failed.failed], [false, true]);
  assert.ok(first.x < second.x && second.x < failed.x);
  assert.ok(chartPoints([null], [0]).every(({ x, y }) => Number.isFinite(x) && Number.isFinite(y)));
});

test("a trial is named with its iteration, score and unit", () => {
  const all = { iteration: [0, 1, 1], score: [30, 20, null], bests: [0, 1, 1], name: "bad-3.0", unit: "%" };
  assert.equal(trialText(1, all), "trial 1 of 0 to 2, iteration 1: bad-3.0 20.00 %, the best");
  assert.equal(trialText(2, all), "trial 2 of 0 to 2, iteration 1: failed");
  assert.equal(trialText(null, all), "edited by hand; 3 trials of the search to scrub");
});
