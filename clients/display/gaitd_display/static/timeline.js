// The last minute: mode, stop, and the patient's share of each stride.
import { el, n, set } from "./figure.js";

const SECONDS = 60;
const LEFT_PX = 88;
const ROOMY_PX = 60; // height of a lane with a tick in its middle
const WIDTH_PER_CHARACTER_PX = 7.4;
const STRIDE_WIDTH_S = 1;

// resting: no power; holding: powered, the leg does not move
const LOOK = { off: "resting", bringing_up: "resting", ready: "resting", hold: "holding", stopping: "stopped", fault: "stopped" };

export const lookOf = (mode) => LOOK[mode] ?? "moving";

// spans: { t, mode, category, cause }, rising, each until the next; strides: { t, leg, share }; now: s, of the same clock
export function paintTimeline(svg, spans, strides, legs, now) {
  const { clientWidth: width, clientHeight: height } = svg;
  svg.replaceChildren();
  set(svg, { viewBox: `0 0 ${width} ${height}` });
  const right = width - 14;
  const x = (t) => right - Math.max(0, Math.min(1, (now - t) / SECONDS)) * (right - LEFT_PX);
  const lane = Math.min(26, (height - 70) / 5);
  const text = (at, y, words, className = "lanetext", anchor = "start") => el("text", { x: n(at), y: n(y), class: className, "text-anchor": anchor }, svg, words);
  const rows = { mode: 14, stop: 14 + lane * 1.35 };
  for (const [name, top] of Object.entries(rows)) {
    el("rect", { x: LEFT_PX, y: n(top), width: n(right - LEFT_PX), height: n(lane), class: "lane", rx: 5 }, svg);
    text(14, top + lane / 2 + 4.5, name);
  }
  const runs = (keyOf) => {
    const made = [];
    for (const [index, span] of spans.entries()) {
      const to = spans[index + 1]?.t ?? now;
      const key = keyOf(span);
      if (key === null || to < now - SECONDS) continue;
      if (made.at(-1)?.key === key && made.at(-1).to === span.t) made.at(-1).to = to;
      else made.push({ key, from: span.t, to, span });
    }
    return made;
  };
  const segment = (top, { from, to, key }, className) => {
    const [a, b] = [x(from), x(to)];
    el("rect", { x: n(a), y: n(top), width: n(Math.max(3, b - a - 1)), height: n(lane), class: `seg ${className}`, rx: 5 }, svg);
    if (b - a > key.length * WIDTH_PER_CHARACTER_PX + 18) text(a + 9, top + lane / 2 + 4.5, key, `segtext ${className}`);
    return b;
  };
  for (const run of runs(({ mode }) => mode)) segment(rows.mode, { ...run, key: run.key.replaceAll("_", " ") }, lookOf(run.key));
  const stops = runs(({ category, cause }) => (cause === null ? null : `${category} ${cause.replaceAll("_", " ")}`));
  for (const [index, run] of stops.entries()) {
    const end = segment(rows.stop, run, "stopped");
    // Beside a short one, where there is room.
    const length = run.key.length * WIDTH_PER_CHARACTER_PX;
    const isInside = end - x(run.from) > length + 18;
    const limit = index + 1 < stops.length ? x(stops[index + 1].from) : right;
    if (!isInside && end + 8 + length < limit) text(end + 6, rows.stop + lane / 2 + 4.5, run.key);
    else if (!isInside && index === 0 && x(run.from) - 8 - length > LEFT_PX) text(x(run.from) - 6, rows.stop + lane / 2 + 4.5, run.key, "lanetext", "end");
  }
  const [top, bottom] = [14 + lane * 2.9, height - 26];
  const share = (bottom - top) / legs.length;
  for (const [index, leg] of legs.entries()) {
    const base = top + share * (index + 1);
    text(14, base - 0.75 * (share - 14) + 4.5, legs.length > 1 ? leg : "share");
    const full = share - 14;
    for (const part of share > ROOMY_PX ? [0, 0.5, 1] : [0, 1]) {
      const y = Math.round(base - part * full) - 0.5;
      el("line", { x1: LEFT_PX, y1: y, x2: n(right), y2: y, class: "baseline" }, svg);
      text(LEFT_PX - 6, y + 4.5, `${100 * part} %`, "lanetext", "end");
    }
    const wide = (right - LEFT_PX) / SECONDS * STRIDE_WIDTH_S;
    for (const stride of strides) {
      if (stride.leg !== leg || now - stride.t > SECONDS - STRIDE_WIDTH_S) continue;
      const high = stride.share === null ? full / 2 : Math.max(2, Math.min(1, stride.share) * full);
      el("rect", { x: n(x(stride.t) - wide), y: n(base - high), width: n(wide), height: n(high), class: `stride ${stride.share === null ? "none" : ""}`, rx: 2 }, svg);
    }
  }
  for (let ago = SECONDS; ago >= 0; ago -= 15) text(x(now - ago), height - 8, ago ? `−${ago}` : "0 s", "lanetext", ago === SECONDS ? "start" : ago === 0 ? "end" : "middle");
}
