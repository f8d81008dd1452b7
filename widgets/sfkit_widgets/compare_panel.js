// One panel: a canvas that shows the camera's part of a picture, or of two with a divider, and its caption.

import { pointAt, visiblePart } from "./compare_camera.js";
import { element } from "./_shared.js";

/** @typedef {import("./compare_camera.js").Camera} Camera */
/** @typedef {import("./compare_camera.js").Size} Size */
/** @typedef {HTMLCanvasElement | HTMLImageElement | null} Picture */
/** @typedef {{title: string, note: string, pictures: Picture[]}} Content one picture, or two to swipe */
/** @typedef {{camera: Camera, image: Size, cursor: number[], divider: number,
 *   box: {x: number, y: number, width: number, height: number} | null}} Frame */

const BOX = "#ff5cf4"; // of no colour map
const SHARPEST = 2; // canvas pixels for one of the page, at most

export class Panel {
  /**
   * @param {string} key
   * @param {() => Content} content
   */
  constructor(key, content) {
    this.key = key;
    this.content = content;
    /** @type {HTMLCanvasElement} */
    this.canvas = element("canvas", { role: "img", "data-panel": key });
    this.title = element("strong");
    this.note = element("span", { class: "sfkit-compare-note" });
    this.caption = element("figcaption", {}, this.title, this.note);
    this.figure = element("figure", { "data-panel": key }, this.caption, this.canvas);
    this.context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
  }

  /**
   * The image point under a pointer.
   * @param {{clientX: number, clientY: number}} event
   * @param {Camera} camera
   * @param {Size} image
   */
  under(event, camera, image) {
    return pointAt(this.share(event), camera, image);
  }

  /**
   * A pointer's place as shares of the panel.
   * @param {{clientX: number, clientY: number}} event
   */
  share({ clientX, clientY }) {
    const box = this.canvas.getBoundingClientRect();
    return { x: (clientX - box.x) / box.width, y: (clientY - box.y) / box.height };
  }

  /**
   * @param {Frame} frame
   * @returns {boolean} false while the panel has no size; then it keeps what it shows
   */
  draw(frame) {
    const { title, note, pictures } = this.content();
    if (this.title.textContent !== title) {
      this.title.textContent = title;
      this.canvas.setAttribute("aria-label", title);
    }
    if (this.note.textContent !== note) this.note.textContent = this.caption.title = note;
    if (!this.fit(frame.image)) return false;
    this.paint(pictures[0], frame, 0, 1);
    if (pictures.length > 1) {
      this.paint(pictures[1], frame, frame.divider, 1);
      this.line(frame.divider);
    }
    this.marks(frame);
    return true;
  }

  /**
   * As many canvas pixels as the screen shows; false while the panel has no size.
   * @param {Size} image
   */
  fit(image) {
    const sharpness = Math.min(window.devicePixelRatio || 1, SHARPEST);
    const width = Math.round(this.canvas.clientWidth * sharpness);
    if (width === 0) return false;
    const height = Math.round((width * image.height) / image.width);
    if (this.canvas.width !== width || this.canvas.height !== height) {
      Object.assign(this.canvas, { width, height });
    }
    return true;
  }

  /**
   * Draw the part of a picture between two shares of the panel's width.
   * @param {Picture} picture
   * @param {Frame} frame
   * @param {number} from
   * @param {number} to
   */
  paint(picture, { camera, image }, from, to) {
    const { context, canvas } = this;
    if (!picture) return context.clearRect(0, 0, canvas.width, canvas.height);
    const part = visiblePart(camera, image);
    context.imageSmoothingEnabled = canvas.width < part.width;
    const width = to - from;
    if (width <= 0) return;
    context.drawImage(
      picture,
      part.x + from * part.width,
      part.y,
      width * part.width,
      part.height,
      from * canvas.width,
      0,
      width * canvas.width,
      canvas.height,
    );
  }

  /** @param {number} divider */
  line(divider) {
    const x = Math.round(divider * this.canvas.width);
    const [middle, reach] = [this.canvas.height / 2, 9];
    this.stroke(() => {
      this.context.moveTo(x, 0);
      this.context.lineTo(x, this.canvas.height);
      for (const side of [-1, 1]) {
        this.context.moveTo(x + side * 5, middle - reach);
        this.context.lineTo(x + side * (5 + reach), middle);
        this.context.lineTo(x + side * 5, middle + reach);
      }
    });
  }

  /** @param {Frame} frame the cursor's pixel as a cross, the region as a box */
  marks({ camera, image, cursor, box }) {
    const part = visiblePart(camera, image);
    const scale = this.canvas.width / part.width;
    const place = (/** @type {number} */ x, /** @type {number} */ y) => [(x - part.x) * scale, (y - part.y) * scale];
    if (box) {
      const [x, y] = place(box.x, box.y);
      this.corners(x - 2, y - 2, box.width * scale + 4, box.height * scale + 4);
    }
    if (cursor.length === 2) {
      const [x, y] = place(cursor[0] + 0.5, cursor[1] + 0.5);
      const gap = Math.max(4, scale / 2);
      this.stroke(() => {
        for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
          this.context.moveTo(x + dx * gap, y + dy * gap);
          this.context.lineTo(x + dx * (gap + 8), y + dy * (gap + 8));
        }
      });
    }
  }

  /**
   * The corners of a box, in a colour of their own: no edge of it is like a divider.
   * @param {number} x
   * @param {number} y
   * @param {number} width
   * @param {number} height
   */
  corners(x, y, width, height) {
    const arm = Math.max(6, Math.min(width, height, 72) / 3);
    this.stroke(() => {
      for (const [cx, cy, right, down] of [
        [x, y, 1, 1],
        [x + width, y, -1, 1],
        [x, y + height, 1, -1],
        [x + width, y + height, -1, -1],
      ]) {
        this.context.moveTo(cx + right * arm, cy);
        this.context.lineTo(cx, cy);
        this.context.lineTo(cx, cy + down * arm);
      }
    }, BOX);
  }

  /**
   * Light on black reads on every colour.
   * @param {() => void} path
   * @param {string} colour
   */
  stroke(path, colour = "#ffffff") {
    for (const [style, width] of /** @type {[string, number][]} */ ([["#000000", 4.5], [colour, 2]])) {
      this.context.beginPath();
      path();
      Object.assign(this.context, { strokeStyle: style, lineWidth: width });
      this.context.stroke();
    }
  }
}
