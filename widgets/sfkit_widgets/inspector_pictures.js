// The pair under the edited network: left image, ground truth, disparity, error; pins and blinking.

import { element, imageUrl } from "./_shared.js";

/** @typedef {import("./_shared.js").Model} Model */
/** @typedef {import("./_shared.js").View} View */

const BLINK = 700; // ms a pin is shown before the other
const EDITED = "edited";

/**
 * What is shown after one more blink: the pins in turn, or pin and edit where only one is pinned.
 * @param {string} shown
 * @param {string[]} pins
 */
export function blinked(shown, pins) {
  const turns = pins.length > 1 ? pins : [...pins, EDITED];
  return turns[(turns.indexOf(shown) + 1) % turns.length];
}

/** A picture that is swapped only once it is decoded, so that nothing flashes. */
export class Picture {
  /**
   * @param {string} caption
   * @param {[number, number]} size height and width of the pair
   */
  constructor(caption, [height, width]) {
    this.image = element("img", { alt: "", class: "picture-image", draggable: "false" });
    this.words = element("span", { class: "picture-words" }, caption);
    this.caption = element("figcaption", {}, this.words);
    this.button = element(
      "button",
      { type: "button", class: "picture-button", "aria-pressed": "false", title: "Enlarge, or make small again" },
      this.image,
    );
    this.figure = element("figure", { class: "picture" }, this.caption, this.button);
    this.url = "";
    /** @type {DataView | null} */
    this.bytes = null;
    this.swapped = Promise.resolve();
    this.resize([height, width]);
  }

  /** @param {[number, number]} size */
  resize([height, width]) {
    this.image.style.aspectRatio = `${width} / ${height}`;
  }

  /**
   * @param {DataView} bytes
   * @param {string} words the caption, and what a reader hears of the picture
   */
  async show(bytes, words) {
    this.words.textContent = words;
    this.image.alt = words;
    if (bytes !== this.bytes) {
      this.bytes = bytes;
      this.swapped = this.swap(bytes);
    }
    await this.swapped;
  }

  /** @param {DataView} bytes */
  async swap(bytes) {
    const url = imageUrl(bytes, "image/jpeg");
    const next = new Image();
    next.src = url;
    await next.decode();
    if (bytes !== this.bytes) return URL.revokeObjectURL(url);
    this.image.src = url;
    URL.revokeObjectURL(this.url);
    this.url = url;
  }

  free() {
    URL.revokeObjectURL(this.url);
  }
}

/** A colour key; its last tick says the unit. */
export function legend() {
  const bar = element("div", { class: "legend-bar" });
  const ticks = element("div", { class: "legend-ticks" });
  return {
    key: element("div", { class: "legend", role: "img" }, bar, ticks),
    /**
     * @param {{stops: string[], ticks: string[]}} legend
     * @param {string} name
     */
    show({ stops, ticks: words }, name) {
      bar.style.background = `linear-gradient(to right, ${stops.join(", ")})`;
      ticks.replaceChildren(...words.map((word) => element("span", {}, word)));
      bar.parentElement?.setAttribute("aria-label", `${name}: ${words.join(", ")}`);
    },
  };
}

/**
 * @param {View} view
 * @param {Model} model
 * @returns {HTMLElement}
 */
export function pictures(view, model) {
  const size = model.get("size");
  const [left, truth, disparity, error] = ["left image", "ground truth", "disparity", "error"].map(
    (caption) => new Picture(caption, size),
  );
  const keys = { disparity: legend(), error: legend() };
  disparity.figure.append(keys.disparity.key);
  error.figure.append(keys.error.key);
  const choose = element("select", { "aria-label": "Image pair" });
  choose.append(...model.get("pairs").map((/** @type {string} */ id) => element("option", { value: id }, id)));
  choose.addEventListener("change", () => view.send("show_pair", { pair: choose.value }), {
    signal: view.signal,
  });
  const shows = new Shown(view, model, disparity, error);
  view.watch(["pair", "left_picture", "truth_picture", "captions", "legends", "size"], () => {
    choose.value = model.get("pair");
    for (const picture of [left, truth, disparity, error]) picture.resize(model.get("size"));
    left.show(model.get("left_picture"), "left image");
    truth.show(model.get("truth_picture"), model.get("captions").truth);
    keys.disparity.show(model.get("legends").disparity, "disparity");
    keys.error.show(model.get("legends").error, model.get("captions").error);
  });
  for (const { button } of [left, truth, disparity, error]) {
    button.addEventListener("click", () => enlarge(button, [left, truth, disparity, error]), { signal: view.signal });
  }
  view.signal.addEventListener("abort", () => {
    for (const picture of [left, truth, disparity, error]) picture.free();
  });
  return element(
    "div",
    { class: "pictures" },
    element("div", { class: "pictures-bar" }, element("label", {}, "pair ", choose), shows.bar),
    element("div", { class: "pictures-grid" }, ...[left, truth, disparity, error].map(({ figure }) => figure)),
  );
}

/**
 * One picture at most is large, above the others.
 * @param {HTMLButtonElement} chosen
 * @param {Picture[]} all
 */
function enlarge(chosen, all) {
  const large = chosen.getAttribute("aria-pressed") !== "true";
  for (const { button } of all) button.setAttribute("aria-pressed", String(large && button === chosen));
}

/** Which recipe the pictures show: the edited one, a pin, or pins in turn. */
class Shown {
  /**
   * @param {View} view
   * @param {Model} model
   * @param {Picture} disparity
   * @param {Picture} error
   */
  constructor(view, model, disparity, error) {
    this.view = view;
    this.model = model;
    this.disparity = disparity;
    this.error = error;
    this.shown = EDITED;
    this.drawing = 0; // the latest of the drawings, which alone tells when it is done
    this.clock = 0;
    this.choices = element("div", { role: "group", "aria-label": "Recipe on show", class: "buttons" });
    this.blink = element("button", { type: "button", "aria-pressed": "false" }, "Blink");
    this.blink.addEventListener("click", () => this.toggle(), { signal: view.signal });
    this.bar = element("div", { class: "buttons", hidden: true }, this.choices, this.blink);
    view.watch(["pin_pictures", "disparity_picture", "error_picture", "look"], () => this.draw());
    // An edit is what one wants to see, whatever pin is on show.
    view.watch(["recipe_json"], () => this.turn(this.clock ? this.shown : EDITED));
    view.signal.addEventListener("abort", () => clearInterval(this.clock));
  }

  toggle() {
    if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.turn(blinked(this.shown, this.pinned)); // by hand: one press, one turn
      return;
    }
    clearInterval(this.clock);
    this.clock = this.clock ? 0 : window.setInterval(() => this.turn(blinked(this.shown, this.pinned)), BLINK);
    this.blink.setAttribute("aria-pressed", String(this.clock !== 0));
    if (!this.clock) this.turn(EDITED);
  }

  get pinned() {
    return Object.keys(this.model.get("pin_pictures")).sort();
  }

  /** @param {string} name */
  turn(name) {
    this.shown = name;
    this.draw();
  }

  draw() {
    const pins = this.model.get("pin_pictures");
    if (this.clock && this.pinned.length === 0) this.toggle();
    if (this.shown !== EDITED && !(this.shown in pins)) this.shown = EDITED;
    this.bar.hidden = this.pinned.length === 0;
    this.choices.replaceChildren(
      ...[EDITED, ...this.pinned].map((name) => {
        const pressed = String(name === this.shown);
        const button = element("button", { type: "button", "aria-pressed": pressed, "data-shown": name }, name);
        button.addEventListener("click", () => this.turn(name));
        return button;
      }),
    );
    const held = this.shown === EDITED ? null : pins[this.shown];
    const of = held ? ` of ${this.shown}` : "";
    const reduction = held ? 1 : this.model.get("look").reduction;
    const size = reduction > 1 ? ` (at 1/${reduction} size)` : "";
    const picture = (/** @type {string} */ name) => (held ? held[name] : this.model.get(`${name}_picture`));
    const sent = this.view.root.dataset.acknowledged ?? "0";
    const drawing = (this.drawing += 1);
    Promise.all([
      this.disparity.show(picture("disparity"), `disparity${of}${size}`),
      this.error.show(picture("error"), `${this.model.get("captions").error}${of}${size}`),
    ]).then(() => {
      if (drawing === this.drawing) this.view.root.dataset.painted = sent;
    });
  }
}
