// Messages of a trainer in a page or in Node: `gaitd.d.mts` has their types, docs/other_languages.md the
// use. It only reads. A handler gets each message of its key, or null where nothing is known.

const RETRY_MS = 500;
const SILENCE_MS = 1000; // the server sends a frame four times a second
const NOT_ALLOWED = 1008;
const TRY_LATER = 1013;
const SCHEMAS = {
  estimate: "gaitd.estimate.v1",
  activity: "gaitd.activity.v1",
  friction: "gaitd.friction.v1",
  stride: "gaitd.stride.v1",
  controller: "gaitd.controller.v1",
  drives: "gaitd.drives.v1",
  safety: "gaitd.safety.v1",
  events: "gaitd.events.v1",
  health: "gaitd.health.v1",
};

const schemaOf = (key) => SCHEMAS[key.startsWith("drives/") ? "drives" : key.split("/").at(-1)];

/** Follow keys until `close()`; the connection comes back by itself. */
export function follow(handlers, options = {}) {
  const Socket = options.WebSocket ?? globalThis.WebSocket;
  if (Socket === undefined) {
    throw new Error("no WebSocket here: Node 22, `node --experimental-websocket`, or options.WebSocket");
  }
  const address = new URL("/messages", options.address ?? globalThis.location?.href ?? "ws://127.0.0.1:8090");
  address.protocol = ["https:", "wss:"].includes(address.protocol) ? "wss:" : "ws:";
  for (const key of Object.keys(handlers)) address.searchParams.append("key", key);
  const following = { droppedCount: 0, close };
  let socket, watchdog, retry;
  let isClosed = false;
  let isLost = false;

  function open() {
    socket = new Socket(address.href);
    const mine = socket;
    let refusal = "";
    watch();
    mine.onmessage = ({ data }) => {
      if (mine !== socket) return;
      const frame = JSON.parse(data);
      if (frame.error !== undefined) return void (refusal = frame.error);
      watch();
      isLost = false;
      following.droppedCount = frame.dropped_count;
      mine.send(String(frame.seq));
      for (const message of frame.messages) give(message);
    };
    mine.onclose = ({ code, reason }) => {
      if (mine !== socket || isClosed) return;
      if (code === NOT_ALLOWED) {
        isClosed = true;
        clearTimeout(watchdog);
        return lose("refused", refusal || reason);
      }
      lost(code === TRY_LATER ? reason : "the server is away");
    };
    mine.onerror = () => {}; // `onclose` comes after it
  }

  function watch() {
    clearTimeout(watchdog);
    watchdog = setTimeout(() => lost(`no frame for ${SILENCE_MS} ms`), SILENCE_MS);
  }

  function lost(text) {
    clearTimeout(watchdog);
    const old = socket;
    socket = undefined;
    old.close();
    if (!isLost) lose("no_connection", text);
    if (!isClosed) retry = setTimeout(open, RETRY_MS);
  }

  function lose(kind, text) {
    isLost = true;
    for (const key of Object.keys(handlers)) handlers[key](null, { kind, text });
  }

  function give({ key, schema, value, trouble, text }) {
    const expected = schemaOf(key);
    if (schema !== expected) {
      handlers[key](null, { kind: "version", text: `${key} is ${schema}, this module reads ${expected}` });
    } else {
      handlers[key](value, value === null ? { kind: trouble, text } : null);
    }
  }

  function close() {
    isClosed = true;
    clearTimeout(watchdog);
    clearTimeout(retry);
    socket?.close();
  }

  queueMicrotask(() => lose("no_connection", "connecting"));
  open();
  return following;
}
