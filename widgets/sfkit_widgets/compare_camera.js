// One camera for all panels: which part of the image they show. Panels have the image's proportions.

import { clamp } from "./_shared.js";

/** @typedef {{x: number, y: number, zoom: number}} Camera centre in pixels of the image; zoom 1 is all of it */
/** @typedef {{width: number, height: number}} Size */
/** @typedef {{x: number, y: number}} Point */

const CLOSEST = 64;
const ROOM_AROUND_BOX = 2.5; // how much more than a region's box is shown when jumping to it
const CLOSEST_TO_BOX = 12;

/**
 * The camera, its view kept inside the image.
 * @param {Partial<Camera>} camera
 * @param {Size} image
 * @returns {Camera}
 */
export function heldCamera(camera, image) {
  const zoom = clamp(camera.zoom ?? 1, 1, CLOSEST);
  const [halfWidth, halfHeight] = [image.width / zoom / 2, image.height / zoom / 2];
  return {
    x: clamp(camera.x ?? image.width / 2, halfWidth, image.width - halfWidth),
    y: clamp(camera.y ?? image.height / 2, halfHeight, image.height - halfHeight),
    zoom,
  };
}

/**
 * The part of the image that shows.
 * @param {Camera} camera
 * @param {Size} image
 */
export function visiblePart(camera, image) {
  const [width, height] = [image.width / camera.zoom, image.height / camera.zoom];
  return { x: camera.x - width / 2, y: camera.y - height / 2, width, height };
}

/**
 * The image point at a place in a panel, both places as shares of its width and height.
 * @param {Point} share
 * @param {Camera} camera
 * @param {Size} image
 * @returns {Point}
 */
export function pointAt(share, camera, image) {
  const part = visiblePart(camera, image);
  return { x: part.x + share.x * part.width, y: part.y + share.y * part.height };
}

/**
 * Zoom by a factor; the given image point stays where it is on the screen.
 * @param {Camera} camera
 * @param {number} factor
 * @param {Point} point
 * @param {Size} image
 */
export function zoomedCamera(camera, factor, point, image) {
  const zoom = clamp(camera.zoom * factor, 1, CLOSEST);
  const kept = camera.zoom / zoom;
  return heldCamera(
    { x: point.x + (camera.x - point.x) * kept, y: point.y + (camera.y - point.y) * kept, zoom },
    image,
  );
}

/**
 * Show a box with some room around it.
 * @param {{x: number, y: number, width: number, height: number}} box
 * @param {Size} image
 */
export function cameraOn(box, image) {
  const fit = Math.min(image.width / box.width, image.height / box.height) / ROOM_AROUND_BOX;
  const centre = { x: box.x + box.width / 2, y: box.y + box.height / 2 };
  return heldCamera({ ...centre, zoom: Math.min(fit, CLOSEST_TO_BOX) }, image);
}

/**
 * Move the camera just so far that a point shows.
 * @param {Camera} camera
 * @param {Point} point
 * @param {Size} image
 */
export function cameraSeeing(camera, point, image) {
  const part = visiblePart(camera, image);
  const x = clamp(camera.x, point.x + 1 - part.width / 2, point.x + part.width / 2);
  const y = clamp(camera.y, point.y + 1 - part.height / 2, point.y + part.height / 2);
  return heldCamera({ x, y, zoom: camera.zoom }, image);
}
