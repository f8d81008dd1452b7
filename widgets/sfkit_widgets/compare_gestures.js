// Mouse and keyboard on the panels.

import { cameraSeeing, visiblePart, zoomedCamera } from "./compare_camera.js";
import { clamp } from "./_shared.js";

/** @typedef {import("./compare_camera.js").Camera} Camera */
/** @typedef {import("./compare_camera.js").Size} Size */
/** @typedef {import("./compare_panel.js").Panel} Panel */

/**
 * What gestures act on.
 * @typedef {object} Handled
 * @property {HTMLElement} area where the panels are; takes the keys
 * @property {(target: EventTarget | null) => Panel | undefined} panelOf
 * @property {() => Size} image
 * @property {() => Camera} camera
 * @property {() => number[]} cursor
 * @property {() => number | null} divider of a panel that is swiped
 * @property {(values: object) => void} set
 * @property {(values: object) => void} follow
 * @property {(key: string) => boolean} key other keys; whether it meant something
 * @property {() => void} say read the values out
 */

export const STEP = 1.2;
const STILL = 4; // px a pointer may move and still click
const NEAR_DIVIDER = 14; // px

/**
 * @param {Handled} on
 * @param {AbortSignal} signal
 */
export function listenToMouse(on, signal) {
  const { area } = on;
  /** @type {{panel: Panel, x: number, y: number, camera: Camera, divider: boolean, moved: boolean} | null} */
  let drag = null;
  area.addEventListener(
    "pointerdown",
    (event) => {
      const panel = on.panelOf(event.target);
      if (!panel || event.button !== 0) return;
      event.preventDefault();
      area.focus({ preventScroll: true });
      panel.canvas.setPointerCapture(event.pointerId);
      const divider = on.divider();
      const away = Math.abs(panel.share(event).x - (divider ?? 0)) * panel.canvas.clientWidth;
      const swiping = divider !== null && panel.key === "stage" && away < NEAR_DIVIDER;
      const { clientX: x, clientY: y } = event;
      drag = { panel, x, y, camera: on.camera(), divider: swiping, moved: false };
    },
    { signal },
  );
  area.addEventListener(
    "pointermove",
    (event) => {
      const panel = on.panelOf(event.target);
      if (!drag && panel) on.follow({ cursor: pixelUnder(on, panel, event) });
      if (!drag) return;
      const [dx, dy] = [event.clientX - drag.x, event.clientY - drag.y];
      drag.moved ||= Math.hypot(dx, dy) > STILL;
      if (drag.divider) on.set({ divider: clamp(drag.panel.share(event).x, 0, 1) });
      else if (drag.moved) {
        const perPixel = visiblePart(drag.camera, on.image()).width / drag.panel.canvas.clientWidth;
        const { x, y, zoom } = drag.camera;
        on.set({ camera: { x: x - dx * perPixel, y: y - dy * perPixel, zoom } });
      }
    },
    { signal },
  );
  const end = (/** @type {PointerEvent} */ event) => {
    if (drag && !drag.moved && event.type === "pointerup") {
      on.set({ cursor: pixelUnder(on, drag.panel, event) });
    }
    drag = null;
  };
  area.addEventListener("pointerup", end, { signal });
  area.addEventListener("pointercancel", end, { signal });
  area.addEventListener(
    "wheel",
    (event) => {
      const panel = on.panelOf(event.target);
      // Elsewhere the wheel scrolls the notebook.
      if (!panel || !(event.ctrlKey || area.matches(":focus"))) return;
      event.preventDefault();
      zoomAt(on, STEP ** -clamp(event.deltaY / 120, -1, 1), panel.under(event, on.camera(), on.image()));
    },
    { signal, passive: false },
  );
  area.addEventListener(
    "dblclick",
    (event) => {
      const panel = on.panelOf(event.target);
      if (panel) zoomAt(on, STEP ** 2, panel.under(event, on.camera(), on.image()));
    },
    { signal },
  );
}

/**
 * Arrow keys move the cursor, + and - zoom at it, 0 shows all; others go to `on.key`.
 * @param {Handled} on
 * @param {AbortSignal} signal
 */
export function listenToKeys(on, signal) {
  on.area.addEventListener(
    "keydown",
    (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (!cursorKey(on, event) && !zoomKey(on, event.key) && !on.key(event.key)) return;
      event.preventDefault();
    },
    { signal },
  );
}

/**
 * @param {Handled} on
 * @param {KeyboardEvent} event
 */
function cursorKey(on, { key, shiftKey }) {
  const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[key];
  if (!step) return false;
  const image = on.image();
  const length = shiftKey ? 10 : 1;
  const [x, y] = on.cursor().length ? on.cursor() : [on.camera().x, on.camera().y].map(Math.floor);
  const to = [
    clamp(x + step[0] * length, 0, image.width - 1),
    clamp(y + step[1] * length, 0, image.height - 1),
  ];
  on.set({ cursor: to, camera: cameraSeeing(on.camera(), { x: to[0], y: to[1] }, image) });
  on.say();
  return true;
}

/**
 * @param {Handled} on
 * @param {string} key
 */
function zoomKey(on, key) {
  if (key === "0") on.set({ camera: {} });
  else if (key === "+" || key === "=") zoomAt(on, STEP, centreOf(on));
  else if (key === "-") zoomAt(on, 1 / STEP, centreOf(on));
  else return false;
  return true;
}

/** @param {Handled} on the cursor, where it shows, else the middle */
function centreOf(on) {
  const [x, y] = on.cursor();
  const part = visiblePart(on.camera(), on.image());
  const inside = x >= part.x && y >= part.y && x < part.x + part.width && y < part.y + part.height;
  return inside ? { x: x + 0.5, y: y + 0.5 } : { x: on.camera().x, y: on.camera().y };
}

/**
 * @param {Handled} on
 * @param {number} factor
 * @param {{x: number, y: number}} point
 */
export function zoomAt(on, factor, point) {
  on.set({ camera: zoomedCamera(on.camera(), factor, point, on.image()) });
}

/**
 * @param {Handled} on
 * @param {Panel} panel
 * @param {PointerEvent} event
 */
function pixelUnder(on, panel, event) {
  const image = on.image();
  const point = panel.under(event, on.camera(), image);
  return [
    clamp(Math.floor(point.x), 0, image.width - 1),
    clamp(Math.floor(point.y), 0, image.height - 1),
  ];
}
