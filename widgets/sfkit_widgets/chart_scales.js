// Scales, ticks and paths of charts: pure functions of numbers.

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
