// How the reader looks at a pair: changed here at once, remembered in Python a moment later.

import { listen } from "./_shared.js";

/** @typedef {import("./_shared.js").Model} Model */

const REST = 200; // ms without a change before Python is told

export const LOOKS = [
  "arrangement",
  "shown",
  "first",
  "second",
  "limits",
  "camera",
  "cursor",
  "divider",
];

/**
 * Nothing here needs a kernel, so these messages are not among those the widget waits for. The root's
 * data-kept tells whether Python has the last look, for tests.
 */
export class Look {
  /**
   * @param {Model} model
   * @param {HTMLElement} root
   * @param {AbortSignal} signal
   * @param {() => void} changed
   */
  constructor(model, root, signal, changed) {
    this.model = model;
    this.root = root;
    this.changed = changed;
    this.view = `look-${Math.random().toString(36).slice(2, 10)}`;
    this.sent = 0;
    this.timer = 0;
    /** @type {Record<string, any>} */
    this.now = Object.fromEntries(LOOKS.map((name) => [name, model.get(name)]));
    /** @type {Record<string, any>} */
    this.waiting = {};
    for (const name of LOOKS) listen(model, `change:${name}`, () => this.hear(name), signal);
    listen(model, "change:acknowledged", () => this.mark(), signal);
    signal.addEventListener("abort", () => clearTimeout(this.timer));
    this.mark();
  }

  /** @param {Record<string, any>} values */
  set(values) {
    Object.assign(this.now, values);
    Object.assign(this.waiting, values);
    this.mark();
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.tell(), REST);
    this.changed();
  }

  /**
   * For what follows the mouse: Python hears of it with the next change.
   * @param {Record<string, any>} values
   */
  follow(values) {
    Object.assign(this.now, values);
    this.changed();
  }

  tell() {
    this.sent += 1;
    const values = this.waiting;
    this.waiting = {};
    this.model.send({ command: "look", arguments: values, view: this.view, sequence: this.sent });
  }

  /**
   * What Python says holds, unless it was changed here since, or Python has not heard the last of it.
   * @param {string} name
   */
  hear(name) {
    if (name in this.waiting || this.heard() < this.sent) return;
    this.now[name] = this.model.get(name);
    this.changed();
  }

  heard() {
    return this.model.get("acknowledged")[this.view] ?? 0;
  }

  mark() {
    const kept = this.heard() === this.sent && Object.keys(this.waiting).length === 0;
    this.root.dataset.kept = String(kept);
  }
}
