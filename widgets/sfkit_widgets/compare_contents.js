// What each panel shows: its title, a note under it, and one picture, or two to swipe.

import { REACH } from "./compare_paint.js";

/** @typedef {import("./compare_panel.js").Content} Content */

/**
 * How the pair is looked at; numbers of networks for A and B.
 * @typedef {{pictures: import("./compare_pictures.js").Pictures, shown: string, limits: number[],
 *   first: number, second: number}} Shown
 */

const LETTERS = ["A", "B"];

/**
 * @param {Shown} now
 * @returns {Content}
 */
export function leftContent({ pictures }) {
  return { title: "left image", note: "", pictures: [pictures.photographs.left] };
}

/**
 * The ground truth, or the right image where there is none.
 * @param {Shown} now
 * @returns {Content}
 */
export function truthContent({ pictures, limits }) {
  if (!pictures.labelled) {
    return { title: "right image", note: "no ground truth", pictures: [pictures.photographs.right] };
  }
  const wider = pictures.sparse ? `; sparse values reach ${REACH} px` : "";
  const note = `${pictures.scene.protocol}; hatched: no value${wider}`;
  return { title: "ground truth", note, pictures: [pictures.groundTruth(limits)] };
}

/**
 * A network; where others are better than A, A itself shows its error.
 * @param {Shown} now
 * @param {number} number
 * @returns {Content}
 */
export function networkContent({ pictures, shown, limits, first }, number) {
  const { networks } = pictures.scene;
  const { name, score, against } = networks[number];
  const { fixed, broken } = against[first];
  const better = shown === "better" && number !== first;
  const changes =
    fixed === null || broken === null
      ? "no pixel to compare in both"
      : `${fixed.toFixed(1)} % fixed, ${broken.toFixed(1)} % broken`;
  const note = better ? `against ${networks[first].name}: ${changes}` : score;
  const kind = better ? "better where" : shown === "disparity" ? shown : pictures.scene.kind;
  const picture = pictures.network(number, { shown, limits, reference: first });
  return { title: `${name}: ${kind}`, note, pictures: [picture] };
}

/**
 * The large panel: A and B with a divider, or one of them.
 * @param {Shown} now
 * @param {string} arrangement
 * @param {boolean} second whether a blink is at B
 * @returns {Content}
 */
export function stageContent(now, arrangement, second) {
  const both = [now.first, now.second].map((number) => networkContent(now, number));
  const titles = both.map(({ title }, i) => `${LETTERS[i]} ${title}`);
  if (arrangement === "blink") {
    const at = second ? 1 : 0;
    return { ...both[at], title: titles[at] };
  }
  return {
    title: titles.join(" | "),
    note: both.map(({ note }) => note).join(" | "),
    pictures: both.flatMap(({ pictures }) => pictures),
  };
}
