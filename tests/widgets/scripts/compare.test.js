import assert from "node:assert/strict";
import { test } from "node:test";
import {
  cameraOn,
  cameraSeeing,
  heldCamera,
  pointAt,
  visiblePart,
  zoomedCamera,
} from "../../../widgets/sfkit_widgets/compare_camera.js";
import {
  codesOf,
  colourTable,
  cutOff,
  disparityOf,
  errorOf,
  errorPosition,
  paintBetter,
  paintBetterMatch,
  paintWider,
  pixelText,
  residualColours,
  residualOf,
  tableIndex,
} from "../../../widgets/sfkit_widgets/compare_paint.js";
import { regionText, shortNumber } from "../../../widgets/sfkit_widgets/compare_readout.js";

const IMAGE = { width: 400, height: 200 };
const CODING = { offset: 2, step: 0.5, cut: [false, true] };

test("codes are read at odd places of a buffer, too", () => {
  const bytes = Uint8Array.from([9, 1, 0, 255, 255, 0]);
  assert.deepEqual([...codesOf(new DataView(bytes.buffer, 1, 4))], [1, 65535]);
  assert.deepEqual([...codesOf(new DataView(bytes.buffer, 4, 2))], [255]);
});

test("colours are opaque, red first in memory", () => {
  const [number] = colourTable(new DataView(Uint8Array.from([1, 2, 3]).buffer));
  assert.deepEqual([...new Uint8Array(Uint32Array.of(number).buffer)], [1, 2, 3, 255]);
});

test("no truth, no finite prediction and the lowest value are three things", () => {
  assert.ok(Number.isNaN(disparityOf(0, CODING)));
  assert.ok(Number.isNaN(disparityOf(65535, CODING)));
  assert.equal(disparityOf(1, CODING), 2);
  assert.ok(Number.isNaN(errorOf(7, 0, 0.5)));
  assert.equal(errorOf(65535, 7, 0.5), Infinity);
  assert.equal(errorOf(3, 7, 0.5), 2);
});

test("sparse values reach three pixels, and what lies between two is the nearest's", () => {
  const row = new Uint32Array(20);
  row[2] = 7;
  row[7] = 9;
  paintWider(row, 20);
  assert.deepEqual([...row], [7, 7, 7, 7, 7, 9, 9, 9, 9, 9, 9, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
  const dense = Uint32Array.from([1, 0, 2]);
  paintWider(dense, 3);
  assert.deepEqual([...dense], [1, 0, 2]);
  const [first, ...others] = Array.from({ length: 10 }, (_, n) => n);
  const square = new Uint32Array(100);
  square[55] = 1;
  paintWider(square, 10);
  const painted = (/** @type {number} */ y, /** @type {number} */ x) => (y - 5) ** 2 + (x - 5) ** 2 <= 9;
  for (const y of [first, ...others]) for (const x of others) assert.equal(square[y * 10 + x] === 1, painted(y, x));
});

test("values beyond the ends are marked where there are any", () => {
  assert.equal(cutOff(65534, CODING), "≥ ");
  assert.equal(cutOff(1, CODING), "");
  assert.equal(cutOff(1, { cut: [true, false] }), "≤ ");
});

test("the threshold is the middle of the error colours, eight times it their end", () => {
  assert.equal(errorPosition(3, 3, 3), 0.5);
  assert.equal(errorPosition(24, 3, 3), 1);
  assert.equal(errorPosition(0, 3, 3), 0);
  assert.deepEqual([-1, 0, 0.5, 1, 2].map(tableIndex), [0, 0, 128, 255, 255]);
});

test("better is the first colour, worse the last, broken both ways the middle", () => {
  const table = Uint32Array.from({ length: 256 }, (_, i) => i + 1);
  const out = new Uint32Array(5);
  const maps = {
    truth: Uint16Array.of(100, 100, 0, 100, 100),
    codes: Uint16Array.of(100, 180, 5, 65535, 65535),
    reference: Uint16Array.of(180, 100, 6, 65535, 100),
  };
  paintBetter(out, maps, 40, table);
  assert.deepEqual([...out], [1, 256, 0, 129, 256]);
});

test("residuals have colours of their own, none where there is no match", () => {
  assert.deepEqual([0, 25, 250].map(residualOf), [0, 10, 100]);
  assert.ok(Number.isNaN(residualOf(255)));
  assert.equal(residualOf(254), Infinity);
  const table = Uint32Array.from({ length: 256 }, (_, i) => i + 1);
  const colours = residualColours(10, 3, table);
  assert.deepEqual([0, 25, 200, 254, 255].map((code) => colours[code]), [1, 129, 256, 256, 0]);
  const out = new Uint32Array(4);
  paintBetterMatch(out, Uint8Array.of(0, 254, 50, 255), Uint8Array.of(50, 254, 0, 0), 20, table);
  assert.deepEqual([...out], [1, 129, 256, 0]);
});

test("numbers say what they are", () => {
  assert.equal(pixelText(-0.456, true), "−0.46");
  assert.equal(pixelText(0.456, true), "+0.46");
  assert.equal(pixelText(-0.001, true), "0.00");
  assert.equal(pixelText(NaN), "none");
  assert.equal(pixelText(Infinity), "not finite");
  assert.equal(shortNumber(-0.375), "−0.375");
  assert.equal(shortNumber(1234.5), "1230");
});

test("a region that is not finite says so", () => {
  const region = { x: 0, y: 0, width: 1, height: 1, pixels: 9, above: 3, mean: null, worst: null, peak: [0, 0] };
  assert.equal(regionText(region, "px"), "9 px beyond 3 px, not finite");
});

test("the view stays inside the image", () => {
  assert.deepEqual(heldCamera({}, IMAGE), { x: 200, y: 100, zoom: 1 });
  assert.deepEqual(heldCamera({ x: 0, y: 500, zoom: 4 }, IMAGE), { x: 50, y: 175, zoom: 4 });
  assert.equal(heldCamera({ zoom: 1000 }, IMAGE).zoom, 64);
  assert.equal(heldCamera({ zoom: 0.1 }, IMAGE).zoom, 1);
});

test("zooming leaves the point under the mouse where it is", () => {
  const camera = { x: 200, y: 100, zoom: 2 };
  const share = { x: 0.25, y: 0.75 };
  const point = pointAt(share, camera, IMAGE);
  assert.deepEqual(point, { x: 150, y: 125 });
  const closer = zoomedCamera(camera, 3, point, IMAGE);
  assert.equal(closer.zoom, 6);
  const { x, y } = pointAt(share, closer, IMAGE);
  assert.ok(Math.abs(x - 150) < 1e-9 && Math.abs(y - 125) < 1e-9);
});

test("a jump shows the box with room around it, and no closer than 12 times", () => {
  assert.deepEqual(cameraOn({ x: 180, y: 90, width: 40, height: 20 }, IMAGE), { x: 200, y: 100, zoom: 4 });
  assert.equal(cameraOn({ x: 200, y: 100, width: 1, height: 1 }, IMAGE).zoom, 12);
});

test("the view follows a point just so far that it shows", () => {
  const camera = { x: 200, y: 100, zoom: 4 };
  assert.deepEqual(cameraSeeing(camera, { x: 210, y: 100 }, IMAGE), camera);
  const moved = cameraSeeing(camera, { x: 300, y: 100 }, IMAGE);
  const part = visiblePart(moved, IMAGE);
  assert.equal(part.x + part.width, 301);
});
