// From 16-bit codes to colours and back to pixels. Codes are explained in _compare_scene.py.

/**
 * @typedef {object} Palettes
 * @property {DataView} disparity (256, 3) RGB
 * @property {DataView} error (256, 3) RGB
 * @property {DataView} hatch (8, 8, 3) RGB
 * @property {number} errorSpan octaves of the error map on each side of the threshold
 * @property {number} advantageSpan thresholds on each side of the signed map
 */

const NO_VALUE = 0;
const NOT_FINITE = 65535;
const CODES = 65536;
const HATCH_SIDE = 8;
const SPARSE = 0.5;
export const REACH = 3;
const NEIGHBOURS = neighbours();
const NO_RESIDUAL = 255;
const RESIDUAL_NOT_FINITE = 254;
const RESIDUAL_STEPS = 2.5; // of a percent
const FAR = CODES * 4; // the error of a prediction that is not finite, in steps

/**
 * Codes of a map; bytes that Jupyter did not align are copied.
 * @param {DataView} bytes
 */
export function codesOf(bytes) {
  const { buffer, byteOffset, byteLength } = bytes;
  if (byteOffset % 2 === 0) return new Uint16Array(buffer, byteOffset, byteLength / 2);
  return new Uint16Array(buffer.slice(byteOffset, byteOffset + byteLength));
}

/**
 * RGB bytes as the numbers an ImageData holds.
 * @param {DataView} bytes
 */
export function colourTable(bytes) {
  const table = new Uint32Array(bytes.byteLength / 3);
  for (let i = 0; i < table.length; i += 1) {
    const [red, green, blue] = [0, 1, 2].map((channel) => bytes.getUint8(3 * i + channel));
    table[i] = ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0;
  }
  return table;
}

/**
 * Index into a table of 256 colours of a position in [0, 1] and beyond.
 * @param {number} position
 */
export function tableIndex(position) {
  return Math.round(255 * Math.min(Math.max(position, 0), 1));
}

/**
 * Disparity in pixels of a code; NaN where there is none.
 * @param {number} code
 * @param {{offset: number, step: number}} coding
 */
export function disparityOf(code, coding) {
  return code === NO_VALUE || code === NOT_FINITE ? NaN : coding.offset + (code - 1) * coding.step;
}

/**
 * A sign before the values of a code that also stands for what lies beyond it.
 * @param {number} code
 * @param {{cut: boolean[]}} coding
 */
export function cutOff(code, { cut: [below, above] }) {
  if (below && code === 1) return "≤ ";
  return above && code === CODES - 2 ? "≥ " : "";
}

/**
 * Absolute error in pixels of two codes: NaN without ground truth, Infinity without a finite prediction.
 * @param {number} code
 * @param {number} truth
 * @param {number} step
 */
export function errorOf(code, truth, step) {
  if (truth === NO_VALUE) return NaN;
  return code === NOT_FINITE ? Infinity : Math.abs(code - truth) * step;
}

/**
 * The colour of every code; hatched ones are 0.
 * @param {{offset: number, step: number}} coding
 * @param {number[]} limits
 * @param {Uint32Array} table
 */
export function disparityColours(coding, [low, high], table) {
  const colours = new Uint32Array(CODES);
  for (let code = 1; code < CODES - 1; code += 1) {
    colours[code] = table[tableIndex((disparityOf(code, coding) - low) / (high - low))];
  }
  return colours;
}

/**
 * Where an error stands on the log2 scale around the threshold, in [0, 1].
 * @param {number} error
 * @param {number} threshold
 * @param {number} span
 */
export function errorPosition(error, threshold, span) {
  return (Math.log2(Math.max(error / threshold, 2 ** -span)) + span) / (2 * span);
}

/**
 * The colour of every difference between a code and the truth's.
 * @param {number} step
 * @param {number} threshold
 * @param {number} span
 * @param {Uint32Array} table
 */
export function errorColours(step, threshold, span, table) {
  const colours = new Uint32Array(CODES);
  for (let i = 0; i < CODES; i += 1) colours[i] = table[tableIndex(errorPosition(i * step, threshold, span))];
  return colours;
}

/**
 * @param {Uint32Array} out
 * @param {Uint16Array | Uint8Array} codes of disparities, or of residuals
 * @param {Uint32Array} colours by code
 */
export function paintDisparity(out, codes, colours) {
  for (let i = 0; i < out.length; i += 1) out[i] = colours[codes[i]];
}

/**
 * @param {Uint32Array} out
 * @param {Uint16Array} codes
 * @param {Uint16Array} truth
 * @param {Uint32Array} colours by difference of codes
 */
export function paintError(out, codes, truth, colours) {
  const broken = colours[CODES - 1];
  for (let i = 0; i < out.length; i += 1) {
    if (truth[i] === NO_VALUE) out[i] = 0;
    else if (codes[i] === NOT_FINITE) out[i] = broken;
    else out[i] = colours[Math.abs(codes[i] - truth[i])];
  }
}

/**
 * The network's error minus the reference's, from -span (first colour) to span (last).
 * @param {Uint32Array} out
 * @param {{codes: Uint16Array, reference: Uint16Array, truth: Uint16Array}} maps
 * @param {number} span in steps
 * @param {Uint32Array} table
 */
export function paintBetter(out, { codes, reference, truth }, span, table) {
  for (let i = 0; i < out.length; i += 1) {
    if (truth[i] === NO_VALUE) {
      out[i] = 0;
      continue;
    }
    const own = codes[i] === NOT_FINITE ? FAR : Math.abs(codes[i] - truth[i]);
    const other = reference[i] === NOT_FINITE ? FAR : Math.abs(reference[i] - truth[i]);
    out[i] = table[tableIndex((own - other + span) / (2 * span))];
  }
}

/**
 * The residual in percent of a code; NaN where there is none, Infinity without a finite prediction.
 * @param {number} code
 */
export function residualOf(code) {
  if (code === NO_RESIDUAL) return NaN;
  return code === RESIDUAL_NOT_FINITE ? Infinity : code / RESIDUAL_STEPS;
}

/**
 * The colour of every code of a residual; that of none is 0.
 * @param {number} threshold
 * @param {number} span
 * @param {Uint32Array} table
 */
export function residualColours(threshold, span, table) {
  return Uint32Array.from({ length: NO_RESIDUAL + 1 }, (_, code) =>
    code === NO_RESIDUAL ? 0 : table[tableIndex(errorPosition(residualOf(code), threshold, span))],
  );
}

/**
 * The network's residual minus the reference's, from -span (first colour) to span (last).
 * @param {Uint32Array} out
 * @param {Uint8Array} residuals
 * @param {Uint8Array} reference
 * @param {number} span in percent
 * @param {Uint32Array} table
 */
export function paintBetterMatch(out, residuals, reference, span, table) {
  for (let i = 0; i < out.length; i += 1) {
    const change = differenceOf(residualOf(residuals[i]), residualOf(reference[i]));
    out[i] = Number.isNaN(change) ? 0 : table[tableIndex((change + span) / (2 * span))];
  }
}

/**
 * How much larger one error is than another; equal where neither is finite.
 * @param {number} own
 * @param {number} other
 */
export function differenceOf(own, other) {
  return own === Infinity && other === Infinity ? 0 : own - other;
}

/**
 * Give pixels near a value the colour of the nearest where fewer than half of the picture's have one, as where a
 * laser scanner measured: a dot a pixel wide between stripes cannot be seen. As sfkit.colours does.
 * @param {Uint32Array} out 0 where there is no value
 * @param {number} width
 */
export function paintWider(out, width) {
  if (!isSparse(out)) return;
  const height = out.length / width;
  const known = new Int32Array(out.length);
  let count = 0;
  for (let at = 0; at < out.length; at += 1) {
    if (out[at] !== 0) known[count++] = at;
  }
  // From the few that have a value, one neighbour after the other, the nearest first.
  for (const [dy, dx] of NEIGHBOURS) {
    for (let n = 0; n < count; n += 1) {
      const at = known[n];
      const column = (at % width) - dx;
      const row = (at - (at % width)) / width - dy;
      if (column < 0 || column >= width || row < 0 || row >= height) continue;
      const target = row * width + column;
      if (out[target] === 0) out[target] = out[at];
    }
  }
}

/**
 * Whether so few pixels have a value that each is painted wider.
 * @param {Uint32Array | Uint16Array} values 0 where there is none
 */
export function isSparse(values) {
  let known = 0;
  for (const value of values) known += Number(value !== 0);
  return known > 0 && known < SPARSE * values.length;
}

/** @returns {number[][]} rows and columns of the neighbours within reach, the nearest first */
function neighbours() {
  const side = Array.from({ length: 2 * REACH + 1 }, (_, n) => n - REACH);
  return side
    .flatMap((dy) => side.map((dx) => [dy * dy + dx * dx, dy, dx]))
    .filter(([square]) => square > 0 && square <= REACH * REACH)
    .sort((one, other) => one[0] - other[0] || one[1] - other[1] || one[2] - other[2])
    .map(([, dy, dx]) => [dy, dx]);
}

/**
 * Put diagonal stripes where there is no value; they belong to the picture and grow with it.
 * @param {Uint32Array} out
 * @param {number} width
 * @param {Uint32Array} tile 8 by 8
 */
export function paintHatch(out, width, tile) {
  for (let i = 0, x = 0, row = 0; i < out.length; i += 1) {
    if (out[i] === 0) out[i] = tile[(row % HATCH_SIDE) * HATCH_SIDE + (x % HATCH_SIDE)];
    x += 1;
    if (x === width) {
      x = 0;
      row += 1;
    }
  }
}

/**
 * A number of pixels as text.
 * @param {number} value
 * @param {boolean} signed
 */
export function pixelText(value, signed = false) {
  if (Number.isNaN(value)) return "none";
  if (!Number.isFinite(value)) return value > 0 ? "not finite" : "−∞";
  const text = Math.abs(value).toFixed(2);
  if (value < 0 && Number(text) > 0) return `−${text}`;
  return signed && Number(text) > 0 ? `+${text}` : text;
}
