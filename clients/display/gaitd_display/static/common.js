// What the pages share: words, the connection, the alarm. STOP is in stop.js.

export const SILENCE_MS = 250; // without a frame: the server, or the way to it, is dead
const RETRY_MS = 300;
const FULL_RETRY_MS = 2000;
const LOSS_POLL_MS = 100;
const LOSS_MS = 700; // of looks without a connection, before the alarm: a page that was suspended looks once
const TOO_MANY_PAGES = 1013; // the server's codes, see web.py
const LOGIN_OVER = 4401;

export const byId = (id) => document.getElementById(id);

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// Retried until it comes; after a second the page says by itself that it has no connection.
export async function load(path) {
  for (;;) {
    try {
      const answer = await fetch(path);
      if (answer.ok) return await answer.json();
    } catch { /* tried again */ }
    await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
  }
}

export class Words {
  static async load(language) {
    const words = new Words();
    words.all = await load("/texts.json");
    words.use(language);
    byId("unloaded").remove();
    return words;
  }

  use(language) {
    this.language = language;
    document.documentElement.lang = language;
    for (const element of document.querySelectorAll("[data-text]")) {
      const { text } = element.dataset;
      element.textContent = this.has(text) ? this.of(text) : element.textContent || this.otherwise(text); // STOP keeps its name
    }
  }

  toggle() {
    this.use(this.language === "de" ? "en" : "de");
  }

  has(key) {
    return key in this.all[this.language];
  }

  // A text with its values filled in.
  of(key, values = {}) {
    if (!this.has(key)) return this.otherwise(key, values);
    return this.all[this.language][key].replace(/\{(\w+)\}/g, (_, name) => values[name]);
  }

  // What stands for a text that is missing: its key and values; the patient's page has another one.
  otherwise(key, values = {}) {
    return [key, ...Object.entries(values).map(([name, value]) => `${name}=${value}`)].join(" ");
  }

  said(text) {
    return text[this.language];
  }

  // Why the machine, or this page's server, has refused a request.
  refusal(said) {
    return said === null ? this.of("refused") : `${this.of("refused")}: ${this.said(said)}`;
  }
}

// The newest frame, and whether the server is alive. A hidden tab keeps the newest frame only; nothing waits to be painted.
export class Live {
  constructor(alarm, onItems, onRestart) {
    this.frame = null;
    this.heardMs = -Infinity;
    this.closedBy = "no_connection";
    this.alarm = alarm;
    this.onItems = onItems;
    this.onRestart = onRestart;
    this.lostMs = null;
    this.lossCount = 0;
    this.open();
    setInterval(() => this.look(), LOSS_POLL_MS);
  }

  open() {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    let isFirst = true;
    socket.onmessage = (event) => {
      const frame = JSON.parse(event.data);
      socket.send(String(frame.seq));
      if (isFirst) this.onRestart();
      isFirst = false;
      this.heardMs = performance.now();
      this.frame = frame.now;
      this.lostMs = null;
      this.alarm.set(frame.now.alarm); // here, because a hidden tab paints nothing
      this.onItems(frame.items);
    };
    socket.onclose = ({ code }) => {
      if (code === LOGIN_OVER) {
        location.reload(); // to the login page
        return;
      }
      this.closedBy = code === TOO_MANY_PAGES ? "too_many_pages" : "no_connection";
      setTimeout(() => this.open(), code === TOO_MANY_PAGES ? FULL_RETRY_MS : RETRY_MS);
    };
  }

  // Why nothing comes; "": it does. A suspended server keeps the connection and says nothing, so the age counts, too.
  loss() {
    return performance.now() - this.heardMs < SILENCE_MS ? "" : this.closedBy;
  }

  // The server counts the alarms; that it is lost itself, while the drives are enabled, is an alarm of the page.
  look() {
    if (this.loss() === "") return;
    if (this.lostMs === null) {
      this.lostMs = performance.now();
      this.lossCount += 1;
    }
    if (this.frame?.active && performance.now() - this.lostMs > LOSS_MS) this.alarm.set(`loss-${this.lossCount}`);
  }
}

export async function post(path, body, timeoutMs = 12000, headers = {}) {
  try {
    const answer = await fetch(path, {
      method: "POST",
      headers: { "Content-Type": "application/json", ...headers },
      body: JSON.stringify(body ?? {}),
      signal: AbortSignal.timeout(timeoutMs),
    });
    return await answer.json();
  } catch {
    return { outcome: "no_answer", reason: "", said: null };
  }
}

// Repeated until acknowledged; each new alarm sounds again. Five pulses, then a pause.
export class Alarm {
  constructor(soundButton) {
    this.button = soundButton;
    this.about = this.acknowledged = null;
    this.audio = new AudioContext();
    this.audio.onstatechange = () => {
      this.show();
      this.burst();
    };
    soundButton.addEventListener("click", () => this.audio.resume());
    addEventListener("pointerdown", () => this.audio.resume());
    setInterval(() => this.burst(), 3000);
    this.show();
  }

  show() {
    this.button.hidden = this.audio.state === "running";
  }

  set(about) {
    if (about === this.about) return;
    this.about = about;
    if (this.isSounding()) this.burst();
  }

  acknowledge() {
    this.acknowledged = this.about;
  }

  isSounding() {
    return this.about !== null && this.about !== this.acknowledged;
  }

  // Where the browser does not yet allow sound there is none to switch off.
  isHeard() {
    return this.isSounding() && this.audio.state === "running";
  }

  burst() {
    // Tones of a browser that does not yet allow sound would all wait for the first touch.
    if (!this.isHeard()) return;
    const start = this.audio.currentTime + 0.02;
    for (const [pulse, frequency] of [660, 880, 660, 880, 1040].entries()) {
      const tone = this.audio.createOscillator();
      const volume = this.audio.createGain();
      const from = start + pulse * 0.25;
      tone.type = "square";
      tone.frequency.value = frequency;
      volume.gain.setValueAtTime(0, from);
      volume.gain.linearRampToValueAtTime(0.5, from + 0.02);
      volume.gain.setValueAtTime(0.5, from + 0.15);
      volume.gain.linearRampToValueAtTime(0, from + 0.18);
      tone.connect(volume).connect(this.audio.destination);
      tone.start(from);
      tone.stop(from + 0.2);
    }
  }
}
