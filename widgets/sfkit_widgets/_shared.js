// Shared by all widgets: frame, theme, commands, and a few pure functions. See widgets/README.md.

/**
 * What anywidget hands to render, and all a widget may use of it.
 * @typedef {object} Model
 * @property {(name: string) => any} get
 * @property {(name: string, callback: (...values: any[]) => void) => void} on
 * @property {(name: string, callback: (...values: any[]) => void) => void} off
 * @property {(content: object) => void} send
 */

/**
 * @typedef {object} View
 * @property {HTMLElement} root the widget's outermost element
 * @property {HTMLElement} body where the widget puts its own
 * @property {AbortSignal} signal aborts when the view goes; give it to addEventListener
 * @property {(names: string | string[], callback: () => void) => void} watch call now and on every change
 * @property {(command: string, values?: object) => number} send a command; its sequence number
 * @property {(slot: string, command: string, values?: object) => void} sendLatest for drags: one on its way
 *   and the latest waiting, by slot
 * @property {() => boolean} pending whether a command is on its way
 * @property {(text: string) => void} announce say it in the live region
 * @property {() => void} close what render returns
 */

const WAITING_AFTER = 3000; // ms without an acknowledgement before the widget says that it waits

/**
 * Build a widget's frame: alert, body, live region; theme and commands are looked after.
 * @param {{model: Model, el: HTMLElement}} host
 * @param {{label: string, kind: string}} about label for assistive technology, kind for the style sheet
 * @returns {View}
 */
export function mount({ model, el }, { label, kind }) {
  const ended = new AbortController();
  const alert = element("div", { class: "sfkit-alert", role: "alert", hidden: true });
  const waiting = element("div", { class: "sfkit-waiting", role: "status", hidden: true });
  const live = element("div", { class: "sfkit-unseen", "aria-live": "polite" });
  const body = element("div", { class: "sfkit-body" });
  const root = element(
    "section",
    // JupyterLab would take keys typed here for its own shortcuts.
    { class: `sfkit sfkit-${kind}`, "aria-label": label, "data-lm-suppress-shortcuts": "true" },
    alert,
    waiting,
    body,
    live,
  );
  root.addEventListener("keydown", (event) => event.stopPropagation(), { signal: ended.signal });
  const commands = new Commands(model, root, waiting, ended.signal);
  /** @type {View["watch"]} */
  const watch = (names, callback) => {
    for (const name of [names].flat()) listen(model, `change:${name}`, callback, ended.signal);
    callback();
  };
  watch("error", () => {
    alert.textContent = model.get("error");
    alert.hidden = !model.get("error");
    // Whoever works further down sees it, too.
    if (!alert.hidden && root.contains(document.activeElement)) alert.scrollIntoView({ block: "nearest" });
  });
  followTheme(root, model, ended.signal);
  hideStill(model.get("still"), ended.signal);
  el.replaceChildren(root);
  return {
    root,
    body,
    watch,
    signal: ended.signal,
    send: (command, values = {}) => commands.sendAfterAll(command, values),
    sendLatest: (slot, command, values = {}) => commands.sendLatest(slot, command, values),
    pending: () => commands.sent !== commands.acknowledged,
    announce: (text) => (live.textContent = text),
    close: () => ended.abort(),
  };
}

/**
 * While a widget lives its still is not needed, nor the output that holds it in JupyterLab and Notebook.
 * @param {string | undefined} name the still's class
 * @param {AbortSignal} signal
 */
function hideStill(name, signal) {
  if (!name) return;
  const rule = `.jp-OutputArea-child:has(.${name}), .${name} { display: none !important; }`;
  const sheet = element("style", {}, rule);
  document.head.append(sheet);
  signal.addEventListener("abort", () => sheet.remove());
}

/**
 * Commands of one view, numbered; Python acknowledges each in the trait `acknowledged`. The root's
 * data-sent and data-acknowledged tell both numbers, for tests.
 */
export class Commands {
  /**
   * @param {Model} model
   * @param {HTMLElement} root
   * @param {HTMLElement} waiting
   * @param {AbortSignal} signal
   */
  constructor(model, root, waiting, signal) {
    this.model = model;
    this.root = root;
    this.waiting = waiting;
    this.view = Math.random().toString(36).slice(2, 10);
    this.sent = 0;
    this.acknowledged = 0;
    /** @type {Map<string, {sequence: number, next: [string, object] | null}>} */
    this.slots = new Map();
    this.timer = 0;
    listen(model, "change:acknowledged", () => this.hear(), signal);
    signal.addEventListener("abort", () => clearTimeout(this.timer));
  }

  /**
   * @param {string} command
   * @param {object} values
   */
  send(command, values) {
    this.sent += 1;
    this.root.dataset.sent = String(this.sent);
    let patience = WAITING_AFTER;
    try {
      this.model.send({ command, arguments: values, view: this.view, sequence: this.sent });
    } catch {
      patience = 0; // the kernel that knew the widget was restarted: nobody will answer
    }
    this.watchClock(patience);
    return this.sent;
  }

  /**
   * Send a command behind those that wait in slots, which it may build on.
   * @param {string} command
   * @param {object} values
   */
  sendAfterAll(command, values) {
    for (const held of this.slots.values()) {
      if (held.next) Object.assign(held, { sequence: this.send(...held.next), next: null });
    }
    return this.send(command, values);
  }

  /**
   * @param {string} slot
   * @param {string} command
   * @param {object} values
   */
  sendLatest(slot, command, values) {
    const held = this.slots.get(slot);
    if (held) held.next = [command, values];
    else this.slots.set(slot, { sequence: this.send(command, values), next: null });
  }

  hear() {
    const heard = this.model.get("acknowledged")[this.view] ?? 0;
    if (heard <= this.acknowledged) return;
    this.acknowledged = heard;
    this.root.dataset.acknowledged = String(heard);
    this.watchClock();
    for (const [slot, { sequence, next }] of [...this.slots]) {
      if (sequence > heard) continue;
      this.slots.delete(slot);
      if (next) this.sendLatest(slot, ...next);
    }
  }

  /**
   * Say so when Python does not answer; a saved notebook has no one who could.
   * @param {number} patience ms
   */
  watchClock(patience = WAITING_AFTER) {
    clearTimeout(this.timer);
    this.waiting.hidden = true;
    if (this.sent === this.acknowledged) return;
    this.timer = window.setTimeout(() => {
      this.waiting.hidden = false;
      this.waiting.textContent =
        "Waiting for Python. On a saved page, or after a restart of the kernel, nobody answers: run the cell that " +
        "makes this widget in an open notebook.";
    }, patience);
  }
}

/**
 * Subscribe until the signal aborts.
 * @param {Model} model
 * @param {string} name
 * @param {(...values: any[]) => void} callback
 * @param {AbortSignal} signal
 */
export function listen(model, name, callback, signal) {
  model.on(name, callback);
  signal.addEventListener("abort", () => model.off(name, callback));
}

/**
 * Keep the root's data-theme ("light" or "dark") and data-host in step with the trait and the host.
 * @param {HTMLElement} root
 * @param {Model} model
 * @param {AbortSignal} signal
 */
export function followTheme(root, model, signal) {
  const preference = window.matchMedia("(prefers-color-scheme: dark)");
  const update = () => {
    const host = hostTheme(document, preference.matches);
    const wanted = model.get("theme");
    root.dataset.theme = wanted === "auto" ? host.theme : wanted;
    root.dataset.host = root.dataset.theme === host.theme ? host.name : "other";
  };
  const observer = new MutationObserver(update);
  const attributes = { attributeFilter: ["class", "theme", "data-jp-theme-light", "data-jp-theme-name"] };
  observer.observe(document.body, attributes);
  observer.observe(document.documentElement, attributes);
  preference.addEventListener("change", update, { signal });
  signal.addEventListener("abort", () => observer.disconnect());
  listen(model, "change:theme", update, signal);
  update();
}

/**
 * The theme of the page: JupyterLab and Notebook, VS Code, Colab, else what the browser prefers.
 * @param {{body: HTMLElement, documentElement: HTMLElement}} page
 * @param {boolean} prefersDark
 * @returns {{name: string, theme: "light" | "dark"}}
 */
export function hostTheme(page, prefersDark) {
  const jupyter = page.body.dataset.jpThemeLight;
  if (jupyter !== undefined) return { name: "jupyter", theme: jupyter === "false" ? "dark" : "light" };
  const { classList } = page.body;
  const light = ["vscode-light", "vscode-high-contrast-light"].some((name) => classList.contains(name));
  if (light) return { name: "vscode", theme: "light" };
  const dark = ["vscode-dark", "vscode-high-contrast"].some((name) => classList.contains(name));
  if (dark) return { name: "vscode", theme: "dark" };
  const colab = page.documentElement.getAttribute("theme");
  if (colab === "light" || colab === "dark") return { name: "colab", theme: colab };
  return { name: "browser", theme: prefersDark ? "dark" : "light" };
}

/**
 * An element with attributes and children; true writes the bare attribute, false and null none. Texts
 * become text nodes, so that nothing a file is called can become markup.
 * @template {keyof HTMLElementTagNameMap} Tag
 * @param {Tag} tag
 * @param {Record<string, string | number | boolean | null>} attributes
 * @param {...(Node | string)} children
 * @returns {HTMLElementTagNameMap[Tag]}
 */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null) made.setAttribute(name, String(value));
  }
  made.append(...children);
  return made;
}

/**
 * Where an arrow key, Home, End, Page Up or Page Down leads from a cell of a grid; null for other keys.
 * @param {string} key
 * @param {{row: number, column: number}} from
 * @param {{rows: number, columns: number}} size
 * @returns {{row: number, column: number} | null}
 */
export function gridStep(key, from, size) {
  const { row, column } = from;
  const to = {
    ArrowUp: { row: row - 1, column },
    ArrowDown: { row: row + 1, column },
    ArrowLeft: { row, column: column - 1 },
    ArrowRight: { row, column: column + 1 },
    Home: { row, column: 0 },
    End: { row, column: size.columns - 1 },
    PageUp: { row: 0, column },
    PageDown: { row: size.rows - 1, column },
  }[key];
  if (!to) return null;
  return { row: clamp(to.row, 0, size.rows - 1), column: clamp(to.column, 0, size.columns - 1) };
}

/**
 * Whether names over columns stand upright: the longest word of any needs room in every column.
 * @param {string[]} names
 * @param {number} letters that have room side by side
 */
export function standsUpright(names, letters) {
  const words = names.flatMap((name) => name.split(/(?<=[-_])|\s/));
  return names.length * Math.max(0, ...words.map((word) => word.length)) > letters;
}

/**
 * @param {number} value
 * @param {number} low
 * @param {number} high
 */
export function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

/**
 * A trait of bytes as something an image element can show; the caller revokes it.
 * @param {DataView} bytes
 * @param {string} type such as image/png
 */
export function imageUrl(bytes, type) {
  const held = new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  return URL.createObjectURL(new Blob([/** @type {Uint8Array<ArrayBuffer>} */ (held)], { type }));
}
