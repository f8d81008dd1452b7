// SearchControl: buttons, progress and figures of a search. Python says which buttons make sense.

import { element, mount } from "./_shared.js";
import { svg } from "./charts.js";

const BUTTONS = [
  ["run", "Run", "Go on until the search is done", "M3 2l10 6-10 6z"],
  ["pause", "Pause", "Hold after the evaluation under way", "M3 2h4v12H3zM9 2h4v12H9z"],
  ["step", "One step", "Do one generation, then pause", "M2 2l8 6-8 6zM11 2h3v12h-3z"],
  ["stop", "Stop", "End after the evaluation under way", "M3 3h10v10H3z"],
];

/** @param {{model: import("./_shared.js").Model, el: HTMLElement}} host */
function render(host) {
  const label = "Search control";
  const { body, watch, send, announce, signal, close } = mount(host, { label, kind: "control" });
  const buttons = new Map(BUTTONS.map((entry) => [entry[0], controlButton(entry)]));
  const title = element("h3", { class: "sfkit-control-title" });
  const phase = element("span", { class: "sfkit-control-phase" });
  const toolbar = element("div", { class: "sfkit-control-buttons", role: "toolbar" }, ...buttons.values());
  toolbar.setAttribute("aria-label", "Commands of the search");
  const fill = element("div", { class: "sfkit-control-fill" });
  const bar = element("div", { class: "sfkit-control-bar", role: "progressbar", "aria-valuemin": 0 }, fill);
  bar.setAttribute("aria-label", "Candidates proposed");
  const count = element("div", { class: "sfkit-control-count" });
  const says = element("p", { class: "sfkit-control-says" });
  const figures = element("div", { class: "sfkit-control-figures", role: "list", "aria-label": "Figures" });
  const best = element("div", { class: "sfkit-control-best" });
  const head = element("div", { class: "sfkit-control-head" }, title, phase, toolbar);
  body.append(head, bar, element("div", { class: "sfkit-control-line" }, says, count), figures, best);

  for (const [name, button] of buttons) {
    // Disabled buttons would lose the keyboard's focus, so that they stay and do nothing.
    const press = () => button.getAttribute("aria-disabled") === "false" && send(name);
    button.addEventListener("click", press, { signal });
  }

  let heard = "";
  watch("progress", () => {
    const now = host.model.get("progress");
    title.textContent = now.title;
    phase.textContent = now.phase;
    phase.dataset.phase = now.phase;
    says.textContent = now.says;
    toolbar.hidden = now.watched;
    for (const [name, button] of buttons) {
      button.setAttribute("aria-disabled", String(!now.allowed.includes(name)));
    }
    bar.setAttribute("aria-valuemax", String(now.total));
    bar.setAttribute("aria-valuenow", String(Math.min(now.done, now.total)));
    fill.style.width = `${percent(now.done, now.total)}%`;
    count.textContent = `${now.done} of at most ${now.total} candidates`;
    figures.replaceChildren(...now.figures.map((/** @type {[string, string]} */ [name, value]) => figure(name, value)));
    best.replaceChildren(...bestLine(now.best));
    if (heard && heard !== now.phase) announce(`${now.title} ${now.says}`);
    heard = now.phase;
  });
  return close;
}

/** @param {string[]} entry command, text, tip and icon */
function controlButton([name, text, tip, path]) {
  const icon = svg("svg", { viewBox: "0 0 16 16", class: "sfkit-control-icon", "aria-hidden": "true" });
  icon.append(svg("path", { d: path, fill: "currentColor" }));
  const attributes = { type: "button", title: tip, "aria-disabled": "true", "data-command": name };
  return element("button", attributes, icon, text);
}

/** @type {Record<string, string>} */
const MEANS = {
  generation: "Candidates are proposed a generation at a time",
  evaluations: "Recipes that were scored on all validation pairs",
  "from the store": "Of these, scores an earlier search had left in the evaluation store",
  failed: "Of these, recipes without a finite score",
  repeated: "Candidates this search had asked for before; they cost nothing again",
};

/**
 * @param {string} name
 * @param {string} value
 */
function figure(name, value) {
  // No dl: JupyterLab lays those out its own way.
  const label = element("span", { class: "sfkit-control-label", title: MEANS[name] ?? null }, name);
  return element("div", { role: "listitem" }, label, element("span", { "data-figure": name }, value));
}

/** @param {{score: string, candidate: number, sources: string[]} | null} best */
function bestLine(best) {
  if (!best) return [element("span", { class: "sfkit-control-none" }, "No candidate has a score yet.")];
  return [
    element("span", { class: "sfkit-control-score" }, `Best so far: ${best.score}`),
    element("span", {}, ` candidate ${best.candidate}, from `),
    ...best.sources.map((name) => element("span", { class: "sfkit-control-source" }, name)),
  ];
}

/**
 * How much of a bar is full.
 * @param {number} done
 * @param {number} total
 */
export function percent(done, total) {
  return total > 0 ? Math.round((1000 * Math.min(done, total)) / total) / 10 : 100;
}

export default { render };
