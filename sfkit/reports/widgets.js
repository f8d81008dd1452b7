(() => {
  "use strict";

  const { sources, models } = JSON.parse(document.getElementById("saved-widgets").textContent);

  /** What anywidget hands to a widget, on saved state: it keeps what it is given, and nobody answers it. */
  class SavedModel {
    constructor({ state, buffers }) {
      this.state = state;
      this.listeners = new Map();
      for (const { path, data } of buffers) {
        const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
        const owner = path.slice(0, -1).reduce((part, step) => part[step], this.state);
        owner[path.at(-1)] = new DataView(bytes.buffer);
      }
    }

    get(name) {
      return this.state[name];
    }

    set(name, value) {
      const changes = typeof name === "object" ? name : { [name]: value };
      Object.assign(this.state, changes);
      for (const changed of Object.keys(changes)) {
        for (const callback of [...(this.listeners.get(`change:${changed}`) ?? [])]) callback();
      }
    }

    on(event, callback) {
      this.listeners.set(event, (this.listeners.get(event) ?? new Set()).add(callback));
    }

    off(event, callback) {
      this.listeners.get(event)?.delete(callback);
    }

    save_changes() {}

    send() {}
  }

  /** A widget's definition and model; both are made once, however often it is shown. */
  async function opened({ script, style, ...saved }) {
    if (style !== undefined) {
      const sheet = document.createElement("style");
      sheet.textContent = sources[style];
      document.head.append(sheet);
    }
    const { default: given } = await import(`data:text/javascript,${encodeURIComponent(sources[script])}`);
    const widget = typeof given === "function" ? await given() : given;
    const model = new SavedModel(saved);
    await widget.initialize?.({ model });
    return { widget, model };
  }

  const held = new Map();
  for (const place of document.querySelectorAll(".widget")) {
    const name = place.dataset.model;
    if (!held.has(name)) held.set(name, opened(models[name]));
    held
      .get(name)
      .then(({ widget, model }) => widget.render?.({ model, el: place }))
      .catch((error) => {
        place.setAttribute("role", "alert");
        place.textContent = `This widget could not be drawn: ${error}`;
      });
  }
})();
