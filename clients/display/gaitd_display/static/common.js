// What both pages share: words, the connection, STOP, the alarm.

export const SILENCE_MS = 250; // without a frame: the server, or the way to it, is dead
const RETRY_MS = 300;
const STOP_TIMEOUT_MS = 1500;

export const byId = (id) => document.getElementById(id);

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export class Words {
  static async load(language) {
    const words = new Words();
    words.all = await (await fetch("/texts.json")).json();
    words.use(language);
    return words;
  }

  use(language) {
    this.language = language;
    document.documentElement.lang = language;
    for (const element of document.querySelectorAll("[data-text]")) element.textContent = this.of(element.dataset.text);
  }

  toggle() {
    this.use(this.language === "de" ? "en" : "de");
  }

  of(key) {
    return this.all[this.language][key] ?? key;
  }

  said(text) {
    return text[this.language];
  }
}

// The newest frame, and whether the server is alive. A hidden tab keeps the newest frame only; nothing waits to be painted.
export class Live {
  constructor(onItems, onRestart) {
    this.frame = null;
    this.heardMs = -Infinity;
    this.onItems = onItems;
    this.onRestart = onRestart;
    this.open();
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
      this.onItems(frame.items);
    };
    // A server that is suspended keeps the connection and says nothing, so the age counts, too.
    socket.onclose = () => setTimeout(() => this.open(), RETRY_MS);
  }

  isConnected() {
    return performance.now() - this.heardMs < SILENCE_MS;
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
    return { outcome: "no_answer", reason: "" };
  }
}

// STOP reacts to the first touch. A keyboard's click has detail 0.
export function bindStop(button, onAnswer) {
  const stop = async () => {
    onAnswer("sent");
    const answer = await post("/stop", {}, STOP_TIMEOUT_MS);
    onAnswer(answer.outcome === "done" ? "done" : "failed");
  };
  button.addEventListener("pointerdown", stop);
  button.addEventListener("click", (event) => event.detail === 0 && stop());
}

// Repeated until acknowledged; each new alarm sounds again. Five pulses, then a pause.
export class Alarm {
  constructor(soundButton) {
    this.button = soundButton;
    this.about = this.acknowledged = null;
    this.burstCount = 0;
    this.audio = new AudioContext();
    this.audio.onstatechange = () => this.show();
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

  burst() {
    if (!this.isSounding()) return;
    this.burstCount += 1;
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
