// What the parts of the therapist's page share: elements, icons, numbers.
import { el, set } from "./figure.js";

export function made(tag, className, ...parts) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  element.append(...parts);
  return element;
}

const disc = (fill, glyph, stroke = "#fff") => [
  ["circle", { cx: 50, cy: 50, r: 46, fill, stroke: "var(--ink)", "stroke-width": 5 }],
  ["path", { d: glyph, fill: "none", stroke, "stroke-width": 12, "stroke-linecap": "round", "stroke-linejoin": "round" }],
];
const ICONS = {
  moving: disc("var(--green)", "M38 30L70 50L38 70Z"),
  holding: disc("var(--blue)", "M39 32V68M61 32V68"),
  resting: disc("var(--card)", "M50 22V48M34 32A26 26 0 1 0 66 32", "var(--ink)"),
  stopped: [
    ["path", { d: "M32 5H68L95 32V68L68 95H32L5 68V32Z", fill: "var(--vermillion)", stroke: "var(--ink)", "stroke-width": 4 }],
    ["path", { d: "M30 50H70", stroke: "#fff", "stroke-width": 14, "stroke-linecap": "round" }],
  ],
  lost: disc("var(--card)", "M36 38A14 14 0 1 1 52 54V60M52 76V77", "var(--ink)"),
  ok: disc("var(--green)", "M27 52L44 69L74 34"),
  rest: disc("var(--card)", "M30 50H70", "var(--ink)"),
  bad: disc("var(--card)", "M34 34L66 66M66 34L34 66", "var(--ink)"),
  info: disc("var(--card)", "M50 46V74M50 28V29", "var(--ink)"),
  low: disc("var(--sky)", "M50 46V74M50 28V29", "#14212b"),
  medium: [
    ["path", { d: "M50 6L95 88H5Z", fill: "var(--orange)", stroke: "var(--ink)", "stroke-width": 5, "stroke-linejoin": "round" }],
    ["path", { d: "M50 36V60M50 73V74", stroke: "#14212b", "stroke-width": 11, "stroke-linecap": "round" }],
  ],
};
ICONS.stop = ICONS.stopped;

// Into an SVG of 100 x 100; painted again only where it is another one.
export function paintIcon(svg, name) {
  if (svg.dataset.icon === name) return;
  svg.dataset.icon = name;
  svg.replaceChildren(...ICONS[name].map(([tag, attributes]) => el(tag, attributes)));
}

export function icon(name, label = null) {
  const svg = el("svg", { viewBox: "0 0 100 100" });
  set(svg, label === null ? { "aria-hidden": "true" } : { role: "img", "aria-label": label });
  paintIcon(svg, name);
  return svg;
}

const formats = new Map();

// A number as the language writes it; "–": not known. most: digits after the point at most, all of them without least.
export function digits(value, language, most, least = most) {
  if (value === null || value === undefined) return "–";
  const key = `${language} ${most} ${least}`;
  if (!formats.has(key)) {
    const given = { minimumFractionDigits: least, maximumFractionDigits: most, useGrouping: false, signDisplay: "negative" };
    formats.set(key, new Intl.NumberFormat(language === "de" ? "de-DE" : "en-GB", given));
  }
  return formats.get(key).format(value).replace("-", "−");
}

export const percent = (ratio, language) => (ratio === null || ratio === undefined ? "–" : `${digits(100 * ratio, language, 0)} %`);

const locale = (language) => (language === "de" ? "de-DE" : "en-GB");
export const day = (time_ms, language) => new Date(time_ms).toLocaleDateString(locale(language), { day: "numeric", month: "short" });
export const clock = (time_ms, language) => new Date(time_ms).toLocaleTimeString(locale(language), { hour: "2-digit", minute: "2-digit" });
export const clockWithSeconds = (time_ms, language) => new Date(time_ms).toLocaleTimeString(locale(language), { hour: "2-digit", minute: "2-digit", second: "2-digit" });

// Calls paint where what it is made of has changed, or the language.
export class Once {
  constructor(paint) {
    this.paint = paint;
    this.seen = null;
  }

  show(what, language) {
    const key = `${language} ${JSON.stringify(what)}`;
    if (key === this.seen) return;
    this.seen = key;
    this.paint(what);
  }

  again() {
    this.seen = null;
  }
}
