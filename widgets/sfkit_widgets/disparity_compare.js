// DisparityCompare: panels of one pair under one camera and one cursor.

import { cameraOn, heldCamera } from "./compare_camera.js";
import { leftContent, networkContent, stageContent, truthContent } from "./compare_contents.js";
import { listenToKeys, listenToMouse, zoomAt } from "./compare_gestures.js";
import { layOut } from "./compare_layout.js";
import { Look } from "./compare_look.js";
import { Panel } from "./compare_panel.js";
import { Pictures } from "./compare_pictures.js";
import { colourBars, fillRegions, fillValues, regionText, valuesText } from "./compare_readout.js";
import { clamp, listen, mount } from "./_shared.js";

const BLINK = 700; // ms for each of the two
const SAY_AFTER = 400; // ms without a move before the values are read out
const TALLEST = 560; // px of a panel that stands alone

class Compare {
  /** @param {{model: import("./_shared.js").Model, el: HTMLElement}} host */
  constructor(host) {
    this.model = host.model;
    this.view = mount(host, { label: "Compare disparities", kind: "compare" });
    const { signal, root } = this.view;
    this.look = new Look(this.model, root, signal, () => this.ask());
    this.pictures = this.load();
    /** @type {Panel[]} */
    this.panels = [];
    this.drawn = { panels: "", bars: "", regions: "", values: "" };
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.blink = { second: false, paused: still, timer: 0 };
    this.region = { of: "", number: -1 };
    this.frame = 0;
    this.again = true;
    this.saying = 0;
    this.parts = layOut(this.view.body, this.acts(), signal);
    this.handled = this.gestures();
    listenToMouse(this.handled, signal);
    listenToKeys(this.handled, signal);
    listen(
      this.model,
      "change:scene",
      () => {
        this.pictures = this.load();
        this.enter();
      },
      signal,
    );
    this.enter();
    this.view.watch(["pairs", "error"], () => this.ask());
    const observer = new ResizeObserver(() => {
      this.again = true;
      this.ask();
    });
    observer.observe(this.parts.area);
    signal.addEventListener("abort", () => {
      observer.disconnect();
      clearInterval(this.blink.timer);
      clearTimeout(this.saying);
      cancelAnimationFrame(this.frame);
    });
  }

  /** @returns {import("./compare_layout.js").Acts} */
  acts() {
    return {
      set: (values) => this.look.set(values),
      choose: (pair) => this.choose(pair),
      turn: (by) => this.turn(by),
      zoom: (factor) => zoomAt(this.handled, factor, this.camera()),
      bound: (end, value) => this.bound(end, value),
      jump: (number) => this.jump(number),
      exchange: () => this.look.set({ first: this.look.now.second, second: this.look.now.first }),
      pause: () => {
        this.blink.paused = !this.blink.paused;
        this.ask();
      },
    };
  }

  /** @returns {import("./compare_gestures.js").Handled} */
  gestures() {
    return {
      area: this.parts.area,
      panelOf: (target) => this.panels.find((panel) => panel.canvas === target),
      image: () => this.pictures.scene,
      camera: () => this.camera(),
      cursor: () => this.look.now.cursor,
      divider: () => (this.look.now.arrangement === "swipe" ? this.look.now.divider : null),
      set: (values) => this.look.set(values),
      follow: (values) => this.look.follow(values),
      key: (key) => this.key(key),
      say: () => this.say(),
    };
  }

  /** @param {string} key */
  key(key) {
    const { now } = this.look;
    const shown = { 1: "disparity", 2: "error", 3: "better" }[key];
    if (shown) this.look.set({ shown });
    else if (key === "n" || key === "p") this.jump(this.region.number + (key === "n" ? 1 : -1));
    else if (key === "PageUp" || key === "PageDown") this.turn(key === "PageUp" ? -1 : 1);
    else if (key === "[" || key === "]") {
      this.look.set({ divider: clamp(now.divider + (key === "]" ? 0.02 : -0.02), 0, 1) });
    } else if (key === " " && now.arrangement === "blink") {
      Object.assign(this.blink, { paused: true, second: !this.blink.second });
      this.ask();
    } else return false;
    return true;
  }

  load() {
    return new Pictures(this.model.get("scene"), this.model.get("palettes"), () => this.ask());
  }

  /** A scene has come. */
  enter() {
    const { scene } = this.pictures;
    this.drawn = { panels: "", bars: "", regions: "", values: "" };
    this.region = { of: "", number: -1 };
    const scores = scene.networks.map(({ name, score }) => `${name} ${score}`).join("; ");
    this.view.announce(`Pair ${scene.pair}: ${scores}`);
    this.view.root.dataset.pair = scene.pair;
    this.ask();
  }

  names() {
    return this.pictures.scene.networks.map(({ name }) => name);
  }

  /** Numbers of A and B; names that a scene does not have stand for its first and second. */
  chosen() {
    const names = this.names();
    const [first, second] = ["first", "second"].map((which) => names.indexOf(this.look.now[which]));
    return [first < 0 ? 0 : first, second < 0 ? Math.min(1, names.length - 1) : second];
  }

  camera() {
    return heldCamera(this.look.now.camera, this.pictures.scene);
  }

  limits() {
    return this.look.now.limits.length ? this.look.now.limits : this.pictures.scene.limits;
  }

  /** @param {string} pair */
  choose(pair) {
    this.view.announce(`Running the networks on pair ${pair}`);
    this.view.send("choose", { pair });
  }

  /** @param {number} by */
  turn(by) {
    const pairs = this.model.get("pairs");
    const to = pairs.indexOf(this.pictures.scene.pair) + by;
    if (to >= 0 && to < pairs.length) this.choose(pairs[to]);
  }

  /**
   * @param {number} end
   * @param {number} value
   */
  bound(end, value) {
    const limits = [...this.limits()];
    limits[end] = value;
    if (Number.isFinite(value) && limits[0] < limits[1]) this.look.set({ limits });
    else this.view.announce("The colours need a lower and a higher disparity in pixels.");
    this.ask();
  }

  /** @param {number} number of the region of B */
  jump(number) {
    const { name, regions } = this.pictures.scene.networks[this.chosen()[1]];
    const region = regions[number];
    if (!region) return;
    this.region = { of: name, number };
    const camera = cameraOn(region, this.pictures.scene);
    this.look.set({ camera, cursor: region.peak });
    this.view.announce(`Region ${number + 1} of ${regions.length}: ${regionText(region, this.pictures.scene.unit)}`);
  }

  say() {
    clearTimeout(this.saying);
    this.saying = window.setTimeout(() => {
      const { cursor } = this.look.now;
      if (cursor.length) this.view.announce(valuesText(this.pictures, cursor, this.chosen()[0]));
    }, SAY_AFTER);
  }

  /** What is drawn: where a network is better is a picture of its own, with nothing to swipe or blink to. */
  shown() {
    const { shown, arrangement } = this.look.now;
    return shown === "better" && arrangement !== "side by side" ? "error" : shown;
  }

  /** Draw with the next frame. */
  ask() {
    if (this.frame) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = 0;
      this.draw();
    });
  }

  draw() {
    this.arrange();
    this.showControls();
    const { scene } = this.pictures;
    const { cursor, divider } = this.look.now;
    const [first, second] = this.chosen();
    if (this.region.of !== scene.networks[second].name) this.region = { of: "", number: -1 };
    const box = this.region.of ? scene.networks[second].regions[this.region.number] : null;
    const frame = { camera: this.camera(), image: scene, cursor, divider, box };
    const drawn = this.panels.map((panel) => panel.draw(frame)).every(Boolean);
    // Hidden for one frame, as while JupyterLab changes its theme: no observer sees that, so draw once more.
    if (!drawn && this.again) this.ask();
    this.again = drawn;
    this.once("values", [cursor, first], () => fillValues(this.parts.table, this.pictures, cursor, first));
    const shown = this.shown();
    this.once("bars", [shown, this.limits()], () =>
      this.parts.bars.replaceChildren(...colourBars(this.pictures, shown, this.limits())),
    );
    this.once("regions", [second, this.region.number], () => {
      const { regions } = scene.networks[second];
      fillRegions(this.parts.regions, regions, this.region.number, scene.unit);
      this.parts.none.textContent = regions.length ? "" : "No region of 8 or more bad pixels.";
    });
  }

  /**
   * Do it again only where what it depends on has changed.
   * @param {"panels" | "bars" | "regions" | "values"} what
   * @param {any[]} on
   * @param {() => void} act
   */
  once(what, on, act) {
    const key = JSON.stringify(on);
    if (this.drawn[what] === key) return;
    this.drawn[what] = key;
    act();
  }

  /** Make the panels that the arrangement needs. */
  arrange() {
    const { arrangement } = this.look.now;
    this.once("panels", [arrangement, this.names()], () => {
      const { width, height } = this.pictures.scene;
      const alone = arrangement !== "side by side";
      const networks = this.names().map(
        (_, number) => new Panel(`network ${number}`, () => networkContent(this.content(), number)),
      );
      const stage = [new Panel("stage", () => stageContent(this.content(), arrangement, this.blink.second))];
      const scene = [
        new Panel("left", () => leftContent(this.content())),
        new Panel("truth", () => truthContent(this.content())),
      ];
      this.panels = alone ? [...stage, ...scene] : [...scene, ...networks];
      const { area } = this.parts;
      area.setAttribute("aria-label", `panels of pair ${this.pictures.scene.pair}`);
      area.dataset.columns = !alone && this.panels.length > 4 ? "3" : "2";
      area.style.setProperty("--shape", `${width} / ${height}`);
      area.style.setProperty("--widest", `${Math.round((TALLEST * width) / height)}px`);
      area.replaceChildren(...this.panels.map((panel) => panel.figure));
      clearInterval(this.blink.timer);
      if (arrangement === "blink") this.blink.timer = window.setInterval(() => this.turnOver(), BLINK);
    });
  }

  /** @returns {import("./compare_contents.js").Shown} */
  content() {
    const [first, second] = this.chosen();
    return { pictures: this.pictures, shown: this.shown(), limits: this.limits(), first, second };
  }

  turnOver() {
    if (this.blink.paused || document.hidden) return;
    this.blink.second = !this.blink.second;
    this.ask();
  }

  showControls() {
    const { parts, look } = this;
    const { arrangement, divider } = look.now;
    const [first, second] = this.chosen().map((number) => this.names()[number]);
    const limits = this.limits();
    parts.pair.update(this.model.get("pairs"), this.pictures.scene.pair);
    parts.arrangement.update(arrangement);
    parts.shown.update(this.shown());
    parts.shown.offer("better", arrangement === "side by side");
    parts.shown.rename("error", this.pictures.scene.kind);
    parts.first.update(this.names(), first);
    parts.second.update(this.names(), second);
    parts.listed.update(this.names(), second);
    parts.low.update(limits[0]);
    parts.high.update(limits[1]);
    parts.zoom.textContent = `${Math.round(100 * this.camera().zoom)} %`;
    parts.divided.hidden = arrangement !== "swipe";
    parts.divider.value = String(divider);
    parts.pause.hidden = arrangement !== "blink";
    parts.pause.setAttribute("aria-pressed", String(!this.blink.paused));
    parts.pause.textContent = this.blink.paused ? "blink" : "blinking";
  }
}

/** @param {{model: import("./_shared.js").Model, el: HTMLElement}} host */
function render(host) {
  const { view } = new Compare(host);
  return view.close;
}

export default { render };
