import assert from "node:assert/strict";
import { test } from "node:test";
import { clamp, gridStep, hostTheme, standsUpright } from "../../../widgets/sfkit_widgets/_shared.js";

const page = ({ classes = [], theme = null, ...dataset } = {}) => ({
  body: { dataset, classList: { contains: (name) => classes.includes(name) } },
  documentElement: { getAttribute: () => theme },
});

test("a value is kept between its limits", () => {
  assert.deepEqual([-1, 0.5, 7].map((value) => clamp(value, 0, 1)), [0, 0.5, 1]);
});

test("arrow keys stay inside the grid", () => {
  const size = { rows: 3, columns: 2 };
  const walk = (keys, from) => keys.reduce((at, key) => gridStep(key, at, size), from);
  assert.deepEqual(walk(["ArrowUp", "ArrowLeft"], { row: 0, column: 0 }), { row: 0, column: 0 });
  assert.deepEqual(walk(["ArrowDown", "ArrowDown", "ArrowDown"], { row: 0, column: 1 }), { row: 2, column: 1 });
  assert.deepEqual(walk(["End", "PageDown"], { row: 0, column: 0 }), { row: 2, column: 1 });
  assert.deepEqual(walk(["Home", "PageUp"], { row: 2, column: 1 }), { row: 0, column: 0 });
  assert.equal(gridStep("a", { row: 0, column: 0 }, size), null);
});

test("the host's theme comes before the browser's", () => {
  assert.deepEqual(hostTheme(page({ jpThemeLight: "false" }), false), { name: "jupyter", theme: "dark" });
  assert.deepEqual(hostTheme(page({ jpThemeLight: "true" }), true), { name: "jupyter", theme: "light" });
  assert.deepEqual(hostTheme(page({ classes: ["vscode-dark"] }), false), { name: "vscode", theme: "dark" });
  const highContrast = ["vscode-high-contrast", "vscode-high-contrast-light"];
  assert.deepEqual(hostTheme(page({ classes: highContrast }), true), { name: "vscode", theme: "light" });
  assert.deepEqual(hostTheme(page({ theme: "dark" }), false), { name: "colab", theme: "dark" });
  assert.deepEqual(hostTheme(page(), true), { name: "browser", theme: "dark" });
});

test("names stand upright where the longest word has no room", () => {
  assert.equal(standsUpright(["far-scene", "thin-things", "open-ground"], 40), false);
  assert.equal(standsUpright(["far-scene", "thin-things", "open-ground", "plain", "haze", "uneven-exposure"], 40), true);
  assert.equal(standsUpright(["kitti2012", "kitti2015", "hamza", "hamza_finetuned_again"], 40), false);
  assert.equal(standsUpright([], 40), false);
});
