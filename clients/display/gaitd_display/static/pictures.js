// Symbols of the states, and pictures of what a hand has to find. No text: the words stand beside them.
import { el } from "./figure.js";

const disc = (fill, glyph, stroke = "#fff") => [
  ["circle", { cx: 50, cy: 50, r: 46, fill, stroke: "var(--ink)", "stroke-width": 4 }],
  ["path", { d: glyph, fill: "none", stroke, "stroke-width": 11, "stroke-linecap": "round", "stroke-linejoin": "round" }],
];
const DARK = "#14110c"; // on orange and purple
const TICK = "M27 52L44 69L74 34";
const BARS = "M39 32V68M61 32V68";
const CLOCK = "M50 24V50L66 60";
const ALONG = "M30 50H70";
const AHEAD = "M26 50H70M52 32L70 50L52 68";
const STOPPED = [
  ["path", { d: "M32 5H68L95 32V68L68 95H32L5 68V32Z", fill: "var(--vermillion)", stroke: "var(--ink)", "stroke-width": 4 }],
  ["path", { d: "M30 50H70", stroke: "#fff", "stroke-width": 14, "stroke-linecap": "round" }],
];
const WARNING = [
  ["path", { d: "M50 8L94 86H6Z", fill: "var(--orange)", stroke: "var(--ink)", "stroke-width": 5, "stroke-linejoin": "round" }],
  ["path", { d: "M50 36V58M50 71V72", stroke: DARK, "stroke-width": 10, "stroke-linecap": "round" }],
];
const SILENT = [
  ["circle", { cx: 50, cy: 50, r: 46, fill: "var(--card)", stroke: "var(--ink)", "stroke-width": 5 }],
  ["path", { d: "M18 52H34L42 34L54 68L62 52H82M20 20L80 80", fill: "none", stroke: "var(--ink)", "stroke-width": 8, "stroke-linecap": "round", "stroke-linejoin": "round" }],
];
const SYMBOLS = {
  good: disc("var(--green)", TICK), finished: disc("var(--green)", TICK),
  more: disc("var(--blue)", "M50 76V26M29 47L50 26L71 47"), gently: disc("var(--orange)", "M50 24V74M29 53L50 74L71 53", DARK),
  relax: disc("var(--purple)", "M18 50H43M32 38L44 50L32 62M82 50H57M68 38L56 50L68 62", DARK), go_on: disc("var(--card)", ALONG, "var(--ink)"),
  start: disc("var(--blue)", "M38 30L70 50L38 70Z"), next: disc("var(--blue)", "M38 30L70 50L38 70Z"), ready: disc("var(--blue)", "M38 30L70 50L38 70Z"),
  rest: disc("var(--blue)", BARS), paused: disc("var(--blue)", BARS), held: disc("var(--blue)", BARS), ending: disc("var(--blue)", BARS),
  wait: disc("var(--blue)", CLOCK), self_test: disc("var(--blue)", CLOCK), service: disc("var(--blue)", CLOCK), used: disc("var(--blue)", CLOCK),
  way_out: disc("var(--blue)", AHEAD), to_start: disc("var(--blue)", AHEAD), guide: disc("var(--blue)", "M33 60V40M44 60V32M56 60V32M67 60V42M33 60Q50 80 67 60"),
  daily_test: disc("var(--blue)", CLOCK), let_go: disc("var(--blue)", CLOCK), release: WARNING, failed: WARNING, soon: WARNING, too_many_pages: WARNING,
  stopped: STOPPED, stopping: STOPPED, no_signal: SILENT, no_connection: SILENT,
};

export function drawSymbol(svg, word) {
  svg.replaceChildren();
  for (const [tag, attributes] of SYMBOLS[word]) el(tag, attributes, svg);
}

const SKIN = { fill: "var(--fig-body)", stroke: "var(--ink)", "stroke-width": 4, "stroke-linejoin": "round" };
const LINE = { fill: "none", stroke: "var(--ink)", "stroke-width": 11, "stroke-linecap": "round", "stroke-linejoin": "round" };

function handle(svg, isHeld) {
  const tilt = el("g", { transform: "rotate(14 120 80)" }, svg);
  el("path", { d: "M120 138C120 168 150 158 168 150S206 150 214 168", fill: "none", stroke: "var(--fig-machine)", "stroke-width": 6, "stroke-linecap": "round" }, tilt);
  el("rect", { x: 104, y: 22, width: 34, height: 122, rx: 15, fill: "var(--fig-machine)" }, tilt);
  el("rect", { x: 107, y: isHeld ? 15 : 6, width: 28, height: 24, rx: 8, fill: "var(--blue)", stroke: "var(--ink)", "stroke-width": 4 }, tilt);
  return tilt;
}

function emergencyStop(svg, arrow) {
  // The real thing is red on yellow: the one place with other colours than those of Okabe and Ito.
  el("rect", { x: 56, y: 62, width: 128, height: 92, rx: 16, fill: "#f0c800", stroke: "var(--ink)", "stroke-width": 4 }, svg);
  el("rect", { x: 96, y: 74, width: 48, height: 30, fill: "#5b0f12" }, svg);
  el("path", { d: "M62 74C62 34 88 18 120 18S178 34 178 74C178 84 150 88 120 88S62 84 62 74Z", fill: "#c4161c", stroke: "var(--ink)", "stroke-width": 4 }, svg);
  el("path", { d: "M82 56C86 40 100 32 116 31", fill: "none", stroke: "#fff", "stroke-opacity": 0.7, "stroke-width": 7, "stroke-linecap": "round" }, svg);
  el("path", { ...LINE, d: arrow }, svg);
}

const PICTURES = {
  switch(svg) {
    el("circle", { cx: 122, cy: 78, r: 66, fill: "var(--blue-tint)", class: "hold-ring" }, svg);
    const tilt = handle(svg, true);
    el("path", { d: "M84 150C66 136 62 104 70 82C74 70 84 66 92 68L150 68L150 134C138 150 100 156 84 150Z", ...SKIN }, tilt);
    for (let finger = 0; finger < 4; finger += 1) el("rect", { x: 96, y: 62 + finger * 21, width: 62, height: 22, rx: 11, ...SKIN }, tilt);
    el("path", { d: "M72 92C74 62 88 40 106 24C114 17 126 18 130 26C133 33 126 40 118 44C108 52 100 66 100 84", ...SKIN }, tilt);
    el("path", { ...LINE, d: "M174 4V34M160 22L174 36L188 22", stroke: "var(--blue)", "stroke-width": 9 }, tilt);
  },
  released(svg) {
    const hand = el("g", { transform: "rotate(-20 64 104)" }, handle(svg, false));
    for (const [x, y, length, turn] of [[30, 34, 60, -12], [46, 24, 66, -4], [63, 26, 64, 4], [80, 38, 54, 12]]) {
      el("rect", { x, y, width: 16, height: length, rx: 8, transform: `rotate(${turn} ${x + 8} ${y + length})`, ...SKIN }, hand);
    }
    el("rect", { x: 90, y: 78, width: 17, height: 48, rx: 8.5, transform: "rotate(38 98 120)", ...SKIN }, hand);
    el("path", { d: "M31 88Q62 74 96 88L98 118C98 144 84 156 64 156S31 144 31 118Z", ...SKIN }, hand);
    el("path", { d: "M36 90Q62 80 92 90", fill: "none", stroke: "var(--fig-body)", "stroke-width": 7 }, hand);
  },
  emergency_stop: (svg) => emergencyStop(svg, "M208 8V62M190 44L208 64L226 44"),
  released_stop: (svg) => emergencyStop(svg, "M208 64V10M190 28L208 8L226 28"),
  telephone(svg) {
    el("rect", { x: 82, y: 8, width: 78, height: 146, rx: 14, fill: "var(--card)", stroke: "var(--ink)", "stroke-width": 5 }, svg);
    el("rect", { x: 94, y: 22, width: 54, height: 26, rx: 4, fill: "var(--blue-tint)", stroke: "var(--ink)", "stroke-width": 3 }, svg);
    for (let key = 0; key < 9; key += 1) {
      el("rect", { x: 94 + (key % 3) * 19, y: 60 + Math.floor(key / 3) * 28, width: 15, height: 19, rx: 5, fill: "var(--shade)", stroke: "var(--ink)", "stroke-width": 2 }, svg);
    }
    el("path", { d: "M60 44A30 30 0 0 0 60 92M44 32A50 50 0 0 0 44 104M180 44A30 30 0 0 1 180 92M196 32A50 50 0 0 1 196 104", fill: "none", stroke: "var(--blue)", "stroke-width": 7, "stroke-linecap": "round" }, svg);
  },
  button(svg) {
    el("rect", { x: 30, y: 30, width: 180, height: 82, rx: 22, fill: "var(--blue)", stroke: "var(--ink)", "stroke-width": 4 }, svg);
    el("path", { d: "M78 50L112 71L78 92Z", fill: "#fff", stroke: "#fff", "stroke-width": 6, "stroke-linejoin": "round" }, svg);
    el("path", { d: "M150 162C134 144 128 130 136 124C142 120 150 126 156 132V104C156 92 174 92 174 104V122C190 120 202 130 200 146L196 162", ...SKIN }, svg);
  },
  strap(svg) {
    el("path", { d: "M34 60H206V106H34Z", fill: "var(--fig-machine-light)", stroke: "var(--ink)", "stroke-width": 4, "stroke-linejoin": "round" }, svg);
    el("rect", { x: 84, y: 40, width: 72, height: 86, rx: 12, fill: "var(--card)", stroke: "var(--ink)", "stroke-width": 7 }, svg);
    el("path", { ...LINE, d: "M100 83H186M168 65L186 83L168 101" }, svg);
  },
};

// hand: which one holds the switch; the picture of the other one is its mirror image.
export function pictureOf(name, hand) {
  const svg = el("svg", { viewBox: "0 0 240 166", class: "picture", "aria-hidden": "true" });
  const isMirrored = hand === "left" && ["switch", "released"].includes(name);
  PICTURES[name](isMirrored ? el("g", { transform: "translate(240 0) scale(-1 1)" }, svg) : svg);
  return svg;
}
