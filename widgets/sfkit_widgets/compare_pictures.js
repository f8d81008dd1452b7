// The pictures of a scene, painted when they are first needed and kept until they would look different.

import {
  codesOf,
  colourTable,
  cutOff,
  differenceOf,
  disparityColours,
  disparityOf,
  errorColours,
  errorOf,
  isSparse,
  paintBetter,
  paintBetterMatch,
  paintDisparity,
  paintError,
  paintHatch,
  paintWider,
  residualColours,
  residualOf,
} from "./compare_paint.js";
import { element, imageUrl } from "./_shared.js";

/** @typedef {import("./compare_paint.js").Palettes} Palettes */
/** @typedef {{x: number, y: number, width: number, height: number, pixels: number, above: number,
 *   mean: number | null, worst: number | null, peak: [number, number]}} Region */
/** @typedef {{name: string, score: string, map: DataView, residual: DataView | null,
 *   against: {fixed: number | null, broken: number | null}[], regions: Region[]}} SceneNetwork */
/** @typedef {{benchmark: string, protocol: string, pair: string, width: number, height: number,
 *   offset: number, step: number, cut: boolean[], limits: number[], threshold: number, kind: "error" | "residual",
 *   unit: string, missing: string, left: DataView, right: DataView | null,
 *   truth: DataView | null, networks: SceneNetwork[]}} Scene */

export class Pictures {
  /**
   * @param {Scene} scene
   * @param {Palettes} palettes
   * @param {() => void} loaded called when the left image is there
   */
  constructor(scene, palettes, loaded) {
    this.scene = scene;
    this.palettes = palettes;
    this.labelled = scene.kind === "error";
    this.truth = scene.truth ? codesOf(scene.truth) : new Uint16Array(0);
    /** Whether so few pixels have ground truth that each is painted wider. */
    this.sparse = isSparse(this.truth);
    this.maps = scene.networks.map((network) => codesOf(network.map));
    this.residuals = scene.networks.map(({ residual }) =>
      residual ? new Uint8Array(residual.buffer, residual.byteOffset, residual.byteLength) : new Uint8Array(0),
    );
    this.tables = {
      disparity: colourTable(palettes.disparity),
      error: colourTable(palettes.error),
      hatch: colourTable(palettes.hatch),
    };
    const { threshold } = scene;
    this.errors = this.labelled
      ? errorColours(scene.step, threshold, palettes.errorSpan, this.tables.error)
      : residualColours(threshold, palettes.errorSpan, this.tables.error);
    /** @type {Map<string, {look: string, canvas: HTMLCanvasElement}>} */
    this.painted = new Map();
    this.disparities = { look: "", colours: new Uint32Array(0) };
    /** The images; null until they are decoded, the right one where there is ground truth, too.
     * @type {{left: HTMLCanvasElement | null, right: HTMLCanvasElement | null}} */
    this.photographs = { left: null, right: null };
    this.decode("left", scene.left, loaded);
    if (scene.right) this.decode("right", scene.right, loaded);
  }

  /**
   * @param {"left" | "right"} side
   * @param {DataView} bytes
   * @param {() => void} loaded
   */
  decode(side, bytes, loaded) {
    const { width, height } = this.scene;
    const image = new Image();
    const url = imageUrl(bytes, "image/jpeg");
    image.onload = () => {
      // A canvas, so that no frame decodes it again.
      const canvas = element("canvas", { width, height });
      canvas.getContext("2d")?.drawImage(image, 0, 0);
      this.photographs[side] = canvas;
      URL.revokeObjectURL(url);
      loaded();
    };
    image.src = url;
  }

  /** @param {number[]} limits */
  groundTruth(limits) {
    return this.picture("truth", String(limits), (out) =>
      paintDisparity(out, this.truth, this.disparityColours(limits)),
    );
  }

  /**
   * What is shown of a network; of the reference itself, its error stands where others are better.
   * @param {number} number
   * @param {{shown: string, limits: number[], reference: number}} look
   */
  network(number, { shown, limits, reference }) {
    const kind = shown === "better" && number === reference ? "error" : shown;
    const codes = this.maps[number];
    if (kind === "disparity") {
      return this.picture(`network ${number}`, `disparity ${limits}`, (out) =>
        paintDisparity(out, codes, this.disparityColours(limits)),
      );
    }
    if (kind === "error") {
      return this.picture(`network ${number}`, "error", (out) =>
        this.labelled
          ? paintError(out, codes, this.truth, this.errors)
          : paintDisparity(out, this.residuals[number], this.errors),
      );
    }
    const { step, threshold } = this.scene;
    if (!this.labelled) {
      const [own, other] = [this.residuals[number], this.residuals[reference]];
      return this.picture(`network ${number}`, `better ${reference}`, (out) =>
        paintBetterMatch(out, own, other, this.palettes.advantageSpan * threshold, this.tables.error),
      );
    }
    const span = (this.palettes.advantageSpan * threshold) / step;
    const maps = { codes, reference: this.maps[reference], truth: this.truth };
    return this.picture(`network ${number}`, `better ${reference}`, (out) =>
      paintBetter(out, maps, span, this.tables.error),
    );
  }

  /**
   * What a reader learns of one pixel: disparities in image pixels, errors or residuals in the scene's unit.
   * @param {number} x
   * @param {number} y
   * @param {number} reference
   */
  values(x, y, reference) {
    const at = y * this.scene.width + x;
    const { step } = this.scene;
    const truth = this.labelled ? this.truth[at] : 0;
    const errorAt = (/** @type {number} */ number) =>
      this.labelled ? errorOf(this.maps[number][at], truth, step) : residualOf(this.residuals[number][at]);
    return {
      truth: disparityOf(truth, this.scene),
      networks: this.maps.map((map, number) => {
        const error = errorAt(number);
        const against = number === reference ? 0 : differenceOf(error, errorAt(reference));
        const cut = cutOff(map[at], this.scene);
        return { disparity: disparityOf(map[at], this.scene), cut, error, against };
      }),
    };
  }

  /** @param {number[]} limits */
  disparityColours(limits) {
    if (this.disparities.look !== String(limits)) {
      const colours = disparityColours(this.scene, limits, this.tables.disparity);
      this.disparities = { look: String(limits), colours };
    }
    return this.disparities.colours;
  }

  /**
   * @param {string} slot one canvas each
   * @param {string} look what the canvas must show
   * @param {(out: Uint32Array) => void} paint
   */
  picture(slot, look, paint) {
    const held = this.painted.get(slot) ?? { look: "", canvas: document.createElement("canvas") };
    this.painted.set(slot, held);
    if (held.look === look) return held.canvas;
    const { width, height } = this.scene;
    const context = /** @type {CanvasRenderingContext2D} */ (held.canvas.getContext("2d"));
    if (!held.look) Object.assign(held.canvas, { width, height });
    const data = context.createImageData(width, height);
    const out = new Uint32Array(data.data.buffer);
    paint(out);
    paintWider(out, width);
    paintHatch(out, width, this.tables.hatch);
    context.putImageData(data, 0, 0);
    held.look = look;
    return held.canvas;
  }
}
