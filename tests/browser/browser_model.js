// A stand-in for the model anywidget hands to a widget: it keeps state, records messages, tells listeners.

export class FakeModel {
  constructor(state, transport) {
    this.state = decode(state);
    this.messages = [];
    this.listeners = new Map();
    this.transport = transport;
  }

  get(name) {
    return this.state[name];
  }

  set(name, value) {
    this.push({ [name]: value });
  }

  save_changes() {}

  on(name, callback) {
    const held = this.listeners.get(name) ?? new Set();
    this.listeners.set(name, held.add(callback));
  }

  off(name, callback) {
    this.listeners.get(name)?.delete(callback);
  }

  // As a kernel would: messages leave at once, what they change comes back later.
  send(content) {
    this.messages.push(structuredClone(content));
    this.transport?.(content);
  }

  push(changes) {
    const changed = Object.entries(decode(changes));
    for (const [name, value] of changed) this.state[name] = value;
    for (const [name] of changed) {
      for (const callback of [...(this.listeners.get(`change:${name}`) ?? [])]) callback();
    }
  }

  get listening() {
    return [...this.listeners.values()].reduce((sum, held) => sum + held.size, 0);
  }
}

// Bytes travel as {"$bytes": base64} and arrive as the DataView that Jupyter gives.
function decode(state) {
  const bytes = (value) => {
    if (Array.isArray(value)) return value.map(bytes);
    if (value === null || typeof value !== "object") return value;
    if ("$bytes" in value) {
      const text = atob(value.$bytes);
      return new DataView(Uint8Array.from(text, (letter) => letter.charCodeAt(0)).buffer);
    }
    return Object.fromEntries(Object.entries(value).map(([key, entry]) => [key, bytes(entry)]));
  };
  return bytes(state);
}

export async function show(state, transport) {
  const style = document.createElement("style");
  style.textContent = state._css;
  document.head.append(style);
  const module = await import(`data:text/javascript;base64,${encoded(state._esm)}`);
  const model = new FakeModel(state, transport);
  const el = document.createElement("div");
  document.body.append(el);
  await module.default.initialize?.({ model });
  const close = await module.default.render({ model, el });
  Object.assign(window, { model, el, close });
}

function encoded(text) {
  return btoa(Array.from(new TextEncoder().encode(text), (byte) => String.fromCharCode(byte)).join(""));
}
