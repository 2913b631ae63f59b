// The legs now: mechanism, share of the last steps against the target, values, validity, the last 20 s.
import { setText } from "./common.js";
import { el, Mechanism, n, set } from "./figure.js";
import { roomFor, Strip } from "./plot.js";
import { digits, icon, made, percent } from "./therapist_parts.js";

const STEPS = 12;
const TRACE_S = 20;
const KEPT_S = 2; // longer than what is shown
const VALUES_MS = 120; // between two paintings of the numbers
const CURVES_MS = 60;
const FULL_GLOW_W = 60;
const VIEW = [-0.64, 0.44]; // left and top of what is shown of the mechanism, from the hip, in m
const BELOW_M = 0.09;
const BESIDE_M = 0.16;
const AXES = [
  { name: "hip", title: "hip_torque", trace: "hip_trace", places: 1, full: 15, ticks: [-10, 0, 10] },
  { name: "slide", title: "slide_force", trace: "slide_trace", places: 0, full: 150, ticks: [-100, 0, 100] },
];
const VALUES = ["patient", "friction", "net"];

export class LegCard {
  constructor(parent, leg, words) {
    Object.assign(this, { leg, words, rows: [], shownMs: -Infinity, drawnMs: -Infinity, geometry: null, steps: null });
    this.share = made("b");
    this.figure = el("svg", { "aria-hidden": "true", class: "figure" });
    this.path = el("svg", { role: "img", class: "path" });
    this.nopose = made("p", "nopose");
    this.cells = AXES.map(() => VALUES.map(() => ({ cell: made("td"), value: made("span"), std: made("small") })));
    for (const { cell, value, std } of this.cells.flat()) cell.append(value, std);
    const heads = VALUES.map((name) => this.said("th", name, { scope: "col" }));
    const bodies = AXES.map(({ title }, index) => made("tr", "", this.said("th", title, { scope: "row" }), ...this.cells[index].map(({ cell }) => cell)));
    const table = made("table", "values", made("thead", "", made("tr", "", made("td"), ...heads)), made("tbody", "", ...bodies));
    this.validity = made("p", "validity");
    this.strips = AXES.map((axis) => this.strip(axis));
    const title = made("header", "", this.said("h3", `leg.${leg}`), made("p", "share", this.said("span", "last_share"), " ", this.share));
    const views = made("div", "views", made("div", "pose", this.figure, this.nopose), this.path);
    const traces = made("div", "traces", ...this.strips.map(({ box }) => box));
    parent.append(made("article", "panel leg", title, views, made("div", "numbers", table, this.validity), traces));
    this.relabel();
  }

  // An element with a text of the catalogue, so that a change of the language finds it.
  said(tag, key, attributes = {}) {
    const element = made(tag);
    element.dataset.text = key;
    set(element, attributes);
    return element;
  }

  strip(axis) {
    const canvas = made("canvas");
    canvas.setAttribute("role", "img");
    const key = made("p", "key", this.said("span", axis.trace), ...VALUES.slice(0, 2).map((name) => made("span", "line", made("i", name), this.said("span", name))));
    const of = (name) => (row) => row[axis.name][name];
    const strip = new Strip(canvas, {
      seconds: TRACE_S,
      gutter: 40,
      series: [
        { get: of("friction"), color: "--orange-ink", width: 1.6, dash: [7, 5] },
        { get: of("patient"), color: "--blue-ink", width: 2.4, std: of("std") },
      ],
    });
    return { axis, canvas, strip, box: made("div", "trace", key, canvas) };
  }

  relabel() {
    this.words.use(this.words.language);
    for (const { axis, canvas } of this.strips) canvas.setAttribute("aria-label", this.words.of(axis.trace));
    this.saidValidity = null;
    this.steps = null;
    this.shownMs = -Infinity;
  }

  restyle() {
    for (const { strip } of this.strips) strip.restyle();
    this.geometry = null;
    this.steps = null;
  }

  // A frame has come: its sample goes into the curves.
  take(view) {
    const { time_ms } = view;
    const last = this.rows.at(-1);
    const row = (t, axis) => ({ patient: axis?.patient.value ?? null, std: axis?.patient.std ?? null, friction: axis?.friction.value ?? null, t });
    if (time_ms === null) {
      if (last !== undefined && last.isKnown) this.rows.push({ t: last.t, hip: row(last.t), slide: row(last.t), isKnown: false });
      return;
    }
    const t = time_ms / 1000;
    if (last !== undefined && t < last.t) this.rows = []; // another run, with an earlier clock
    if (last !== undefined && t === last.t && last.isKnown) return;
    this.rows.push({ t, hip: row(t, view.hip), slide: row(t, view.slide), isKnown: true });
    while (this.rows[0].t < t - TRACE_S - KEPT_S) this.rows.shift();
  }

  paint(view, geometry, strides, target, nowMs) {
    this.paintFigure(view, geometry);
    if (nowMs - this.drawnMs > CURVES_MS) {
      this.drawnMs = nowMs;
      this.paintCurves();
    }
    if (nowMs - this.shownMs < VALUES_MS) return;
    this.shownMs = nowMs;
    this.paintSteps(strides, target, view.time_ms !== null);
    this.paintValues(view);
    this.paintValidity(view);
  }

  paintFigure(view, geometry) {
    if (geometry !== null && geometry !== undefined && this.geometry !== JSON.stringify(geometry)) {
      this.geometry = JSON.stringify(geometry);
      this.machine = new Mechanism(this.figure, geometry, [this.leg]);
      this.machine.layout(1000, 1000);
      this.crop();
    }
    const isKnown = this.machine !== undefined && view.hip_angle_rad !== null && view.slide_position_m !== null;
    this.nopose.hidden = isKnown;
    if (!isKnown) setText(this.nopose, this.words.of("no_pose"));
    this.figure.classList.toggle("lost", !isKnown);
    if (!isKnown) return;
    const glow = 0.8 * Math.max(0, Math.min(1, (view.power_w ?? 0) / FULL_GLOW_W));
    this.machine.draw(this.leg, view.hip_angle_rad, view.slide_position_m, glow);
  }

  // The leg and its rail fill the picture; couch and floor go beyond its edges.
  crop() {
    const { machine } = this;
    const ends = [machine.rail(machine.geometry.slide_min_m), machine.rail(machine.geometry.slide_max_m)];
    const right = Math.max(...ends.map(([x]) => x)) + BESIDE_M;
    const bottom = Math.min(...ends.map(([, y]) => y)) - BELOW_M;
    const [x0, y0] = machine.at(VIEW);
    const [x1, y1] = machine.at([right, bottom]);
    set(this.figure, { viewBox: `${n(x0)} ${n(y0)} ${n(x1 - x0)} ${n(y1 - y0)}` });
  }

  paintSteps(strides, target, isKnown) {
    const shares = strides.filter(({ leg }) => leg === this.leg).slice(-STEPS).map(({ share_ratio: share }) => share);
    const { clientWidth: width, clientHeight: height } = this.path;
    const key = JSON.stringify([shares, target, width, height, isKnown]);
    if (key === this.steps) return;
    this.steps = key;
    const { language } = this.words;
    setText(this.share, isKnown && shares.length ? percent(shares.at(-1), language) : "–");
    const band = target ? this.words.of("target_band", { low: digits(100 * target.low_ratio, language, 0), high: digits(100 * target.high_ratio, language, 0) }) : this.words.of("no_target");
    const told = shares.length ? shares.map((share) => percent(share, language)).join(", ") : this.words.of("no_step");
    this.path.setAttribute("aria-label", this.words.of("steps_said", { steps: told, target: band }));
    paintPath(this.path, shares, target, { band, steps: this.words.of("last_steps"), width, height });
  }

  paintValues(view) {
    const { language } = this.words;
    AXES.forEach(({ name, places }, row) => VALUES.forEach((kind, column) => {
      const { cell, value, std } = this.cells[row][column];
      const number = view[name][kind];
      cell.classList.toggle("unknown", number.value === null);
      setText(value, digits(number.value, language, places));
      setText(std, number.value === null ? "" : ` ± ${digits(number.std, language, places)}`);
    }));
  }

  paintValidity(view) {
    const of = AXES.map(({ name }) => view[name].validity ?? "none");
    const isSame = of[0] === of[1];
    const valid = isSame ? this.words.of(`valid.${of[0]}`) : of.map((one, index) => (one === "ok" ? "" : `${this.words.of(AXES[index].title).split(",")[0]}: ${this.words.of(`valid.${one}`)}`)).filter(Boolean).join(". ");
    const said = [valid, ...this.tremors(view)].join(". ");
    const relative = view.time_ms === null ? "" : this.words.of(view.is_relative ? "relative" : "no_baseline");
    const key = `${said} ${relative}`;
    if (key === this.saidValidity) return;
    this.saidValidity = key;
    const isBad = of.includes("bad") || of.includes("none");
    this.validity.replaceChildren(icon(isBad ? "bad" : of.includes("split_unobservable") ? "rest" : "ok"), said, made("small", "", relative));
  }

  // A sentence for each axis on which tremor stands out.
  tremors(view) {
    const { language } = this.words;
    return AXES.filter(({ name }) => view[name].tremor_frequency_hz !== null).map(({ name, places }) => {
      const { tremor_frequency_hz: frequency, tremor_amplitude: amplitude } = view[name];
      return this.words.of(`tremor_${name}`, { frequency: digits(frequency, language, 1), amplitude: digits(amplitude, language, places) });
    });
  }

  paintCurves() {
    const at = this.rows.at(-1)?.t ?? 0;
    for (const { axis, strip } of this.strips) {
      let most = 0;
      for (const row of this.rows) most = Math.max(most, Math.abs(row[axis.name].patient ?? 0), Math.abs(row[axis.name].friction ?? 0));
      const factor = roomFor(axis.full, most);
      strip.range = [-axis.full * factor, axis.full * factor];
      strip.ticks = axis.ticks.map((tick) => tick * factor);
      strip.draw(this.rows, at);
    }
  }
}

// Circle: in the target; triangle up: below it, it needs more; triangle down: above it; dashed: not known. The last one is larger.
function paintPath(svg, shares, target, { band, steps, width, height }) {
  svg.replaceChildren();
  set(svg, { viewBox: `0 0 ${width} ${height}` });
  const [left, top, bottom] = [34, 26, height - 22];
  const most = Math.max(0.5, target?.high_ratio ?? 0, ...shares.map((share) => share ?? 0));
  const full = most > 0.8 ? 1 : most > 0.6 ? 0.8 : 0.6;
  const y = (share) => bottom - (Math.max(0, Math.min(full, share)) / full) * (bottom - top);
  if (target) {
    const [high, low] = [y(target.high_ratio), y(target.low_ratio)];
    el("rect", { x: left, y: n(high), width: n(width - left), height: n(low - high), class: "band" }, svg);
    for (const edge of [high, low]) el("line", { x1: left, x2: width, y1: n(edge), y2: n(edge), class: "bandline" }, svg);
  }
  for (let tick = 0; tick <= full + 0.01; tick += full / (full === 0.8 ? 4 : full === 1 ? 2 : 3)) {
    el("text", { x: left - 6, y: n(y(tick) + 4.5), "text-anchor": "end" }, svg, String(Math.round(tick * 100)));
  }
  el("line", { x1: left, x2: width, y1: n(bottom), y2: n(bottom), class: "base" }, svg);
  el("text", { x: left, y: height - 4 }, svg, steps);
  el("text", { x: width - 2, y: 14, "text-anchor": "end", class: target ? "aim" : "" }, svg, band);
  const first = STEPS - shares.length;
  shares.forEach((share, index) => {
    const x = left + 12 + ((first + index) * (width - left - 26)) / (STEPS - 1);
    const r = index === shares.length - 1 ? 8 : 5.5;
    const at = y(share ?? (target ? (target.low_ratio + target.high_ratio) / 2 : full / 2));
    const up = `M${n(x)} ${n(at - r)}L${n(x + r)} ${n(at + 0.8 * r)}H${n(x - r)}Z`;
    const down = `M${n(x)} ${n(at + r)}L${n(x + r)} ${n(at - 0.8 * r)}H${n(x - r)}Z`;
    if (share === null) el("circle", { cx: n(x), cy: n(at), r, class: "none" }, svg);
    else if (target && share < target.low_ratio) el("path", { d: up, class: "mark below" }, svg);
    else if (target && share > target.high_ratio) el("path", { d: down, class: "mark above" }, svg);
    else el("circle", { cx: n(x), cy: n(at), r, class: target ? "mark in" : "mark" }, svg);
  });
}
