// The row of controls over the panels.

import { element } from "./_shared.js";

/**
 * Buttons of which one is pressed.
 * @param {string} label
 * @param {[string, string][]} choices value and text
 * @param {(value: string) => void} choose
 * @param {AbortSignal} signal
 */
export function choiceButtons(label, choices, choose, signal) {
  const buttons = choices.map(([value, text]) => {
    const button = element("button", { type: "button", "data-value": value }, text);
    button.addEventListener("click", () => choose(value), { signal });
    return button;
  });
  const group = element("div", { role: "group", "aria-label": label, class: "sfkit-compare-choice" }, ...buttons);
  const update = (/** @type {string} */ value) => {
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.value === value));
  };
  const rename = (/** @type {string} */ value, /** @type {string} */ text) => {
    for (const button of buttons) if (button.dataset.value === value) button.textContent = text;
  };
  const offer = (/** @type {string} */ value, /** @type {boolean} */ possible) => {
    for (const button of buttons) if (button.dataset.value === value) button.hidden = !possible;
  };
  return { group, update, rename, offer };
}

/**
 * A labelled select.
 * @param {string} label
 * @param {(value: string) => void} choose
 * @param {AbortSignal} signal
 */
export function choiceList(label, choose, signal) {
  const select = element("select");
  const whole = element("label", {}, label, " ", select);
  select.addEventListener("change", () => choose(select.value), { signal });
  let listed = "";
  const update = (/** @type {string[]} */ values, /** @type {string} */ value) => {
    if (listed !== JSON.stringify(values)) {
      listed = JSON.stringify(values);
      select.replaceChildren(...values.map((name) => element("option", { value: name }, name)));
    }
    select.value = value;
  };
  return { whole, select, update };
}

/**
 * A labelled number in pixels; what is no number is put back.
 * @param {string} label
 * @param {(value: number) => void} choose
 * @param {AbortSignal} signal
 */
export function numberInput(label, choose, signal) {
  const input = element("input", { type: "number", step: "any", "aria-label": label });
  input.addEventListener(
    "change",
    () => choose(input.value === "" ? NaN : Number(input.value)),
    { signal },
  );
  const update = (/** @type {number} */ value) => (input.value = String(Number(value.toFixed(2))));
  return { input, update };
}

/**
 * A button.
 * @param {string} text
 * @param {string} label
 * @param {() => void} act
 * @param {AbortSignal} signal
 */
export function actionButton(text, label, act, signal) {
  const button = element("button", { type: "button", "aria-label": label, title: label }, text);
  button.addEventListener("click", act, { signal });
  return button;
}
