import { element, mount } from "./_shared.js";

function render(host) {
  const { body, watch, send, sendLatest, signal, close } = mount(host, { label: "Probe", kind: "probe" });
  const button = element("button", { type: "button" }, "add");
  const drag = element("button", { type: "button" }, "drag");
  const shown = element("output");
  body.append(button, drag, shown);
  button.addEventListener("click", () => send("add", { number: 2 }), { signal });
  drag.addEventListener(
    "click",
    () => [1, 2, 3, 4].forEach((number) => sendLatest("drag", "add", { number })),
    { signal },
  );
  watch("total", () => (shown.textContent = String(host.model.get("total"))));
  return close;
}

export default { render };
