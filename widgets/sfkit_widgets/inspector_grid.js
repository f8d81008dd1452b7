// The routing weights as a grid of blocks (rows) and sources (columns): drag, type, lock, take out.

import { clamp, element, gridStep, standsUpright } from "./_shared.js";

/** @typedef {import("./_shared.js").Model} Model */
/** @typedef {import("./_shared.js").View} View */

const PIXELS_A_UNIT = 160; // a drag this long moves a weight from 0 to 1
const DEAD_ZONE = 3; // pixels a press may move and still be a click
const STEP = 0.05;
const FINE_STEP = 0.01;
const LETTERS_ABREAST = 40; // as many as its columns have room for

/**
 * What was typed as a weight: 0.25, .25, 0,25 or 25 %; null where it is no number from 0 to 1.
 * @param {string} text
 * @returns {number | null}
 */
export function parseWeight(text) {
  const match = /^\s*(\d*[.,]?\d+|\d+[.,])\s*(%?)\s*$/.exec(text);
  if (!match) return null;
  const value = Number(match[1].replace(",", ".")) / (match[2] ? 100 : 1);
  return value <= 1 ? value : null;
}

/**
 * The weight after a drag: right and up are more.
 * @param {number} from
 * @param {number} right pixels
 * @param {number} down pixels
 */
export function draggedWeight(from, right, down) {
  return clamp(from + (right - down) / PIXELS_A_UNIT, 0, 1);
}

/** A name for the edits of one drag, so that they are undone as one. */
export function newGesture() {
  return Math.random().toString(36).slice(2, 12);
}

export class WeightGrid {
  /**
   * @param {View} view
   * @param {Model} model
   */
  constructor(view, model) {
    this.view = view;
    this.model = model;
    /** @type {string[]} */
    this.blocks = model.get("blocks");
    /** @type {string[]} */
    this.sources = model.get("sources");
    /** @type {{block: string, source: string, weight: number} | null} */
    this.nudged = null;
    this.place = { row: 1, column: 0 }; // row 0 holds the sources' names
    /** @type {HTMLElement[][]} */
    this.cells = [this.sources.map((source) => this.head(source))];
    for (const block of this.blocks) this.cells.push(this.sources.map((source) => this.cell(block, source)));
    this.table = this.build();
    view.watch(["weights", "locked", "gone", "tied"], () => this.draw());
  }

  build() {
    const wide = standsUpright(this.sources, LETTERS_ABREAST);
    const rows = this.cells.map((cells, row) => {
      const name = row === 0 ? "block" : this.blocks[row - 1];
      const label = element("div", { role: row === 0 ? "columnheader" : "rowheader", title: name }, name);
      return element("div", { role: "row", class: row === 0 ? "grid-head" : "grid-row" }, label, ...cells);
    });
    const table = element(
      "div",
      {
        role: "grid",
        class: wide ? "grid grid-wide" : "grid",
        "aria-label": "Routing weights",
        style: `--columns: ${this.sources.length}`,
        "aria-rowcount": rows.length,
        "aria-colcount": this.sources.length + 1,
      },
      ...rows,
    );
    table.addEventListener("keydown", (event) => this.key(event), { signal: this.view.signal });
    table.addEventListener(
      "focusin",
      (event) => this.settle(/** @type {Element} */ (event.target).closest("[data-row]")),
      { signal: this.view.signal },
    );
    return table;
  }

  /** @param {string} source */
  head(source) {
    // Browsers break lines after hyphens by themselves, after underscores where they are allowed to.
    const parts = source.split(/(?<=_)/).flatMap((part, n) => (n ? [element("wbr"), part] : [part]));
    const name = element("span", { class: "grid-name" }, ...parts);
    const cell = element("div", { role: "columnheader", class: "grid-source", tabindex: -1 }, name);
    cell.addEventListener("click", () => this.take(source), { signal: this.view.signal });
    return cell;
  }

  /**
   * @param {string} block
   * @param {string} source
   */
  cell(block, source) {
    const cell = element("div", { role: "gridcell", class: "grid-weight", tabindex: -1 });
    const { signal } = this.view;
    cell.addEventListener("pointerdown", (event) => this.press(cell, block, source, event), { signal });
    cell.addEventListener("dblclick", () => this.type(), { signal });
    return cell;
  }

  draw() {
    const [weights, locked, gone] = ["weights", "locked", "gone"].map((name) => this.model.get(name));
    const shades = this.model.get("shades");
    this.cells.forEach((cells, row) =>
      cells.forEach((cell, column) => {
        const source = this.sources[column];
        const out = gone.includes(source);
        cell.dataset.row = String(row);
        cell.dataset.column = String(column);
        cell.classList.toggle("gone", out);
        if (row === 0) {
          cell.title = out ? `Bring ${source} back` : `What if ${source} were gone?`;
          cell.setAttribute("aria-label", out ? `${source}, taken out` : source);
          return;
        }
        const weight = weights[row - 1][column];
        const kept = locked[row - 1][column];
        const words = [out ? "taken out" : weight.toFixed(3), ...(kept ? ["locked"] : [])];
        cell.setAttribute("aria-label", `${this.blocks[row - 1]}, ${source}: ${words.join(", ")}`);
        cell.setAttribute("aria-readonly", String(out || kept));
        cell.classList.toggle("locked", kept);
        [cell.style.background, cell.style.color] = out ? ["", ""] : shades[Math.round(100 * weight)];
        if (!cell.querySelector("input")) cell.textContent = out ? "–" : weight.toFixed(2);
      }),
    );
    this.cells.flat().forEach((cell) => (cell.tabIndex = -1));
    this.current.tabIndex = 0;
  }

  get current() {
    return this.cells[this.place.row][this.place.column];
  }

  /** The block and source that keys and buttons act on; block null on a source's name. */
  get selected() {
    const { row, column } = this.place;
    return { block: row === 0 ? null : this.blocks[row - 1], source: this.sources[column] };
  }

  /** @param {Element | null} cell the cell that has the focus now */
  settle(cell) {
    if (!(cell instanceof HTMLElement)) return;
    this.current.tabIndex = -1;
    this.place = { row: Number(cell.dataset.row), column: Number(cell.dataset.column) };
    this.current.tabIndex = 0;
    this.view.root.dispatchEvent(new CustomEvent("sf-select"));
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (event.ctrlKey || event.metaKey) this.nudged = null;
    if (event.target instanceof HTMLInputElement || event.ctrlKey || event.metaKey || event.altKey) return;
    const size = { rows: this.cells.length, columns: this.sources.length };
    const to = gridStep(event.key, this.place, size);
    const { block, source } = this.selected;
    if (to) this.cells[to.row][to.column].focus();
    else if (block === null && ["Enter", " ", "Delete"].includes(event.key)) this.take(source);
    else if (block === null) return;
    else if (/^[\d.,]$/.test(event.key)) this.type(event.key);
    else if (["Enter", "F2"].includes(event.key)) this.type();
    else if (["+", "=", "-", "_"].includes(event.key)) this.nudge("+=".includes(event.key) ? 1 : -1, event);
    else if (event.key === "Delete") this.weigh(block, source, 0);
    else if (event.key.toLowerCase() === "l") this.toggleLock();
    else return;
    event.preventDefault();
  }

  /**
   * @param {number} sign
   * @param {KeyboardEvent} event Shift makes a small step
   */
  nudge(sign, event) {
    const { block, source } = this.selected;
    if (block === null) return;
    const step = sign * (event.shiftKey && event.key !== "+" ? FINE_STEP : STEP);
    // Keys come faster than networks run: the next adds to what was asked for, not to what is shown.
    const asked = this.nudged?.block === block && this.nudged.source === source && this.view.pending();
    const from = this.nudged && asked ? this.nudged.weight : this.weight(block, source);
    const weight = clamp(from + step, 0, 1);
    this.nudged = { block, source, weight };
    this.view.sendLatest(`weigh ${block} ${source}`, "weigh", { block, source, weight });
  }

  toggleLock() {
    const { block, source } = this.selected;
    if (block !== null) this.view.send("lock", { block, source, locked: !this.isLocked(block, source) });
  }

  /** @param {string} source */
  take(source) {
    this.view.send(this.model.get("gone").includes(source) ? "bring_back" : "remove", { source });
  }

  /**
   * @param {string} block
   * @param {string} source
   * @param {number} weight
   */
  weigh(block, source, weight) {
    this.view.send("weigh", { block, source, weight });
  }

  /**
   * @param {string} block
   * @param {string} source
   * @returns {number}
   */
  weight(block, source) {
    return this.model.get("weights")[this.blocks.indexOf(block)][this.sources.indexOf(source)];
  }

  /**
   * @param {string} block
   * @param {string} source
   * @returns {boolean}
   */
  isLocked(block, source) {
    return this.model.get("locked")[this.blocks.indexOf(block)][this.sources.indexOf(source)];
  }

  /**
   * @param {HTMLElement} cell
   * @param {string} block
   * @param {string} source
   * @param {PointerEvent} start
   */
  press(cell, block, source, start) {
    const fixed = this.isLocked(block, source) || this.model.get("gone").includes(source);
    if (start.button !== 0 || start.target instanceof HTMLInputElement || fixed) return;
    const from = this.weight(block, source);
    const gesture = newGesture();
    const over = new AbortController();
    const signal = AbortSignal.any([over.signal, this.view.signal]);
    let moved = false;
    cell.setPointerCapture(start.pointerId);
    /** @param {PointerEvent} event */
    const move = (event) => {
      const [right, down] = [event.clientX - start.clientX, event.clientY - start.clientY];
      moved ||= Math.hypot(right, down) > DEAD_ZONE;
      if (!moved) return;
      cell.classList.add("dragged");
      const weight = draggedWeight(from, right, down);
      this.view.sendLatest("weigh", "weigh", { block, source, weight, gesture });
    };
    const end = () => {
      cell.classList.remove("dragged");
      over.abort();
    };
    cell.addEventListener("pointermove", move, { signal });
    for (const name of ["pointerup", "pointercancel"]) cell.addEventListener(name, end, { signal });
  }

  /**
   * Type into the selected cell; Enter or leaving it takes the weight on, Escape does not.
   * @param {string} first what was typed already
   */
  type(first = "") {
    const { block, source } = this.selected;
    const cell = this.current;
    if (block === null || cell.querySelector("input") || this.model.get("gone").includes(source)) return;
    if (this.isLocked(block, source)) {
      this.view.announce(`${block}, ${source} is locked: press L to unlock it`);
      return;
    }
    const text = first || this.weight(block, source).toFixed(3);
    const label = `Weight of ${source} in ${block}, from 0 to 1`;
    const input = element("input", { type: "text", inputmode: "decimal", value: text, "aria-label": label });
    cell.replaceChildren(input);
    input.focus();
    input.setSelectionRange(first.length, text.length); // behind what was typed, or all of the old
    let over = false; // taking the input away blurs it, too
    /** @param {boolean} taken */
    const finish = (taken) => {
      const weight = parseWeight(input.value);
      if (over) return;
      if (taken && weight === null) {
        input.setAttribute("aria-invalid", "true");
        this.view.announce(`${input.value} is no weight: type a number from 0 to 1`);
        return;
      }
      over = true;
      const focused = input === document.activeElement;
      input.remove();
      this.draw();
      if (focused) cell.focus();
      if (taken && weight !== null) this.weigh(block, source, weight);
    };
    input.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
      if (event.key === "Enter" || event.key === "Escape") finish(event.key === "Enter");
    });
    input.addEventListener("blur", () => finish(parseWeight(input.value) !== null));
  }
}
