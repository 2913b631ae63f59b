// The engineer's page. It reads, and requests nothing but the last minute when it is opened.
import { byId, Live, load, setText } from "./common.js";
import { EngineerFigure, sign } from "./engineer_figure.js";
import { roomFor, Strip } from "./plot.js";
import { lookOf, paintTimeline } from "./timeline.js";

const CURVE_S = 12;
const MINUTE_S = 60;
const KEPT_S = 2; // longer than what is shown
const TRAIL_S = 4;
const TRAIL_EVERY = 4; // rows
const GAP_S = 0.5; // in the records' time: what lies between is not known, and is asked for
const PAST_RETRY_MS = 2000;
const CURVES_MS = 60; // between two paintings of the curves
const SLOW_MS = 250; // and of what changes once a second
const STRIDES_MAX = 200;
const EVENTS_MAX = 40;
const AGES_MAX = 10000;
const AXES = [
  { name: "hip", title: "Hip torque", unit: "N·m", suffix: "nm", places: 1, full: 14, ticks: [-10, 0, 10] },
  { name: "slide", title: "Slide force", unit: "N", suffix: "n", places: 0, full: 190, ticks: [-150, 0, 150] },
];
const SIGNS = {
  moving: "M5 3L17 10L5 17Z",
  holding: "M4 3H8V17H4ZM12 3H16V17H12Z",
  resting: "M4 4H16V16H4Z",
  stopped: "M10 2L18.5 17H1.5Z",
  lost: "M8 2H12L11.4 12H8.6ZM8.4 14.5H11.6V17.8H8.4Z",
};
const SAID = {
  wait: "waiting for the service",
  no_signal: "no signal from the trainer",
  no_connection: "no connection to this page's server",
  too_many_pages: "too many pages are open",
};

const painted = (window.painted = { frames: 0, ages: [], items: 0 }); // read by the tests

let legs = []; // names; the first one is in front
let figure = null;
let strips = []; // { leg, axis, strip, now }
let rows = new Map(); // by leg
let spans = [];
let seconds = [];
let strides = [];
let events = [];
let columns = [];
let areEventsNew = true;
let askedMs = -Infinity;

// --- what comes in -----------------------------------------------------------------------------

const seconded = ({ time_ms, ...rest }) => ({ t: time_ms / 1000, ...rest });

function rowOf(values) {
  const row = Object.fromEntries(columns.map((name, index) => [name, values[index]]));
  row.t = row.time_ms / 1000;
  return row;
}

const unknownAt = (t) => Object.assign(Object.fromEntries(columns.map((name) => [name, null])), { t });

// The last minute, from the server: at the beginning, and where something was missed.
async function readPast() {
  if (performance.now() - askedMs < PAST_RETRY_MS) return;
  askedMs = performance.now();
  const past = await load("/past.json");
  columns = past.columns;
  rows = new Map(Object.entries(past.rows).map(([leg, kept]) => [leg, kept.map(rowOf)]));
  spans = past.spans.map(seconded);
  seconds = past.seconds.map(seconded);
}

function forget(list, before) {
  let count = 0;
  while (count < list.length && list[count].t < before) count += 1;
  if (count > 0) list.splice(0, count);
}

function takeRow(leg, values) {
  const kept = rows.get(leg);
  if (kept === undefined) return;
  const last = kept.at(-1);
  if (values === null) {
    if (last !== undefined && last.hip_validity !== null) kept.push(unknownAt(last.t));
    return;
  }
  const row = rowOf(values);
  if (last !== undefined && row.t < last.t) {
    readPast(); // another run, with an earlier clock
    return;
  }
  if (last !== undefined && row.t === last.t && last.hip_validity !== null) return;
  if (last !== undefined && row.t - last.t > GAP_S) {
    kept.push(unknownAt(last.t));
    readPast();
  }
  kept.push(row);
  forget(kept, row.t - CURVE_S - KEPT_S);
}

function takeSpan(view, now) {
  const { category = null, cause = null } = view.verdict ?? {};
  const last = spans.at(-1);
  if (last === undefined || last.mode !== view.mode || last.category !== category || last.cause !== cause) {
    spans.push({ t: now, mode: view.mode, category, cause });
  }
  while (spans.length > 1 && spans[1].t < now - MINUTE_S - KEPT_S) spans.shift();
}

function take(view) {
  if (columns.length === 0) return;
  for (const { leg, row } of view.legs) takeRow(leg, row);
  if (view.time_ms === null) {
    takeSpan(view, spans.at(-1)?.t ?? 0);
    return;
  }
  const now = view.time_ms / 1000;
  takeSpan(view, now);
  const { second } = view;
  if (second !== null && second.time_ms / 1000 > (seconds.at(-1)?.t ?? -Infinity)) seconds.push(seconded(second));
  forget(seconds, now - MINUTE_S - KEPT_S);
}

function onItems(items) {
  for (const item of items) {
    painted.items += 1;
    if (item.kind === "stride") {
      strides.push({ t: item.time_ms / 1000, leg: item.leg, share: item.share_ratio, std: item.share_ratio_std });
      if (strides.length > STRIDES_MAX) strides.shift();
    } else if (!events.some(({ id }) => id === item.id)) {
      events.push(item);
      events.sort((one, other) => one.time_ms - other.time_ms);
      if (events.length > EVENTS_MAX) events.shift();
      areEventsNew = true;
    }
  }
  take(live.frame);
}

function onRestart() {
  [strides, events, areEventsNew, askedMs] = [[], [], true, -Infinity];
  readPast();
}

const live = new Live({ set() {} }, onItems, onRestart); // this page has no alarm

// --- layout ------------------------------------------------------------------------------------

function made(tag, className, ...parts) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  element.append(...parts);
  return element;
}

function layOutLegs(names) {
  legs = names;
  for (const one of document.querySelectorAll(".plot")) one.remove();
  const isPair = legs.length > 1;
  byId("curves").classList.toggle("two", isPair);
  byId("readouts").classList.toggle("two", isPair);
  const last = legs.length * AXES.length - 1;
  strips = legs.flatMap((leg) => AXES.map((axis) => ({ leg, axis }))).map(({ leg, axis }, index) => {
    const canvas = made("canvas");
    const now = made("span", "now");
    const title = isPair ? `${axis.title}, ${leg}` : axis.title;
    const panel = made("section", "panel plot", made("header", "", made("h2", "", title), now), canvas);
    panel.setAttribute("aria-label", title);
    byId("curves").append(panel);
    const of = (name) => `${axis.name}_${name}_${axis.suffix}`;
    const strip = new Strip(canvas, {
      seconds: CURVE_S,
      gutter: 46,
      hasTime: !isPair || index === last,
      ribbon: (row) => row[`${axis.name}_validity`],
      series: [
        { get: (row) => row[of("friction")], color: "--friction", width: 1.6 },
        { get: (row) => row[of("patient")], color: "--estimate-line", width: 3, std: (row) => row[`${of("patient")}_std`] },
        { get: (row) => row[of("true")], color: "--true", width: 2, dash: [7, 5] },
      ],
    });
    return { leg, axis, strip, now };
  });
  const readouts = [["patient, power", "power"], ["share, last stride", "share"]];
  byId("readouts").replaceChildren(...readouts.map(([title, name]) => made("div", "", made("dt", "", title), ...legs.map((leg) => {
    const value = made("dd");
    value.id = `${name}_${leg}`;
    return value;
  }))));
}

const late = new Strip(byId("late"), {
  seconds: MINUTE_S,
  range: [0, 2],
  ticks: [0, 1, 2],
  gutter: 34,
  hasTime: false,
  series: [
    { get: ({ late_max_us: us }) => us && us / 1000, color: "--friction", width: 1.6 },
    { get: ({ late_p50_us: us }) => us && us / 1000, color: "--estimate-line", width: 2.4 },
  ],
});
const work = new Strip(byId("work"), {
  seconds: MINUTE_S,
  range: [0, 10],
  ticks: [0, 5, 10],
  gutter: 34,
  series: [
    { get: ({ collect_max_us: us }) => us && us / 1000, color: "--friction", width: 1.6 },
    { get: ({ work_max_us: us }) => us && us / 1000, color: "--estimate-line", width: 2.4 },
  ],
});

addEventListener("resize", () => figure?.layout());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const strip of [late, work, ...strips.map((one) => one.strip)]) strip.restyle();
});
document.fonts.ready.then(() => {
  for (const strip of [late, work, ...strips.map((one) => one.strip)]) strip.restyle();
  figure?.layout();
});

// The scale follows the values of the last seconds of both legs.
function rescale(axis) {
  const keys = ["patient", "true", "friction"].map((name) => `${axis.name}_${name}_${axis.suffix}`);
  let most = 0;
  for (const kept of rows.values()) for (const row of kept) for (const key of keys) most = Math.max(most, Math.abs(row[key] ?? 0));
  const factor = roomFor(axis.full, most);
  for (const { strip } of strips.filter((one) => one.axis === axis)) {
    strip.range = [-axis.full * factor, axis.full * factor];
    strip.ticks = axis.ticks.map((tick) => tick * factor);
  }
}

// --- painting ----------------------------------------------------------------------------------

const clock = (time_ms, places = 0) => {
  const at = new Date(time_ms);
  const two = (value) => String(value).padStart(2, "0");
  const whole = `${two(at.getHours())}:${two(at.getMinutes())}:${two(at.getSeconds())}`;
  return places ? `${whole}.${Math.floor(at.getMilliseconds() / 100)}` : whole;
};
const span = (className, words) => made("span", className, words);

function wordOf(view, loss) {
  if (view === null) return loss === "too_many_pages" ? loss : "wait";
  if (loss !== "") return loss;
  if (view.mode === null) return "no_signal";
  return lookOf(view.mode);
}

function paintTop(view, word) {
  const isKnown = SAID[word] === undefined;
  if (document.body.dataset.word !== word || byId("sign").getAttribute("d") === null) {
    document.body.dataset.word = word;
    byId("sign").setAttribute("d", SIGNS[word] ?? SIGNS.lost);
  }
  setText(byId("mode"), isKnown ? view.mode.replaceAll("_", " ") : SAID[word]);
  setText(byId("progress"), isKnown ? view.progress : "");
  setText(byId("lease"), isKnown && view.lease_holder ? `lease: ${view.lease_holder}` : "");
  setText(byId("time"), isKnown && view.time_ms !== null ? clock(view.time_ms, 1) : "–");
  byId("sim").hidden = byId("keytrue").hidden = !(isKnown && view.has_truth);
  const { verdict } = view ?? {};
  for (const [id, words] of [["verdict", verdict ? `${verdict.category}: ${verdict.text}` : ""], ["trouble", view?.truth_trouble ?? ""]]) {
    byId(id).hidden = !isKnown || words === "";
    setText(byId(id), words);
  }
}

function paintFigure(view, isKnown) {
  if (view.geometry === null || view.legs.length === 0) return;
  const names = view.legs.map(({ leg }) => leg);
  const geometry = JSON.stringify([view.geometry, names]);
  if (names.join() !== legs.join()) layOutLegs(names);
  if (figure === null || figure.key !== geometry) {
    figure = new EngineerFigure(byId("figure"), view.geometry, names);
    figure.key = geometry;
  }
  if (columns.length === 0) return;
  const newest = view.legs.map(({ row }) => (isKnown && row !== null ? rowOf(row) : null));
  const powers = view.legs.map(({ power_w: power }) => power);
  const kept = rows.get(legs[0]) ?? [];
  const begun = (kept.at(-1)?.t ?? 0) - TRAIL_S;
  const way = kept.filter((row, index) => index % TRAIL_EVERY === 0 && row.t > begun && row.hip_angle_rad !== null && row.slide_position_m !== null);
  byId("nopose").hidden = figure.draw(newest, powers, way);
}

function paintReadouts(view, isKnown) {
  const isPair = legs.length > 1;
  for (const leg of legs) {
    const now = isKnown ? view.legs.find((one) => one.leg === leg) : null;
    const power = now?.power_w ?? null;
    const side = () => (isPair ? [made("small", "", `${leg} `)] : []);
    byId(`power_${leg}`).replaceChildren(...side(), power === null ? "–" : sign(power, 0), made("small", "", " W"));
    const stride = isKnown ? strides.findLast((one) => one.leg === leg) : undefined;
    const share = stride?.share ?? null;
    const std = share === null || stride.std === null ? " %" : ` % ± ${(100 * stride.std).toFixed(1)}`;
    byId(`share_${leg}`).replaceChildren(...side(), share === null ? "–" : (100 * share).toFixed(0), made("small", "", std));
  }
}

function paintCurves(view, isKnown) {
  for (const axis of AXES) rescale(axis);
  for (const { leg, axis, strip, now } of strips) {
    const kept = rows.get(leg) ?? [];
    const at = kept.at(-1)?.t ?? 0;
    strip.draw(kept, at);
    const values = isKnown ? view.legs.find((one) => one.leg === leg)?.row ?? null : null;
    const row = values === null ? unknownAt(at) : rowOf(values);
    const of = (name) => row[`${axis.name}_${name}_${axis.suffix}`];
    const told = (value) => (value === null ? "–" : sign(value, axis.places));
    const std = row[`${axis.name}_patient_${axis.suffix}_std`];
    const isNet = of("patient") === null && of("net") !== null;
    const parts = isNet
      ? ["net ", span("e", told(of("net"))), ` ${axis.unit}`]
      : [span("e", told(of("patient"))), std === null ? "" : ` ± ${std.toFixed(axis.places)}`, ` ${axis.unit}`];
    if (view.has_truth) parts.push(" · true ", span("t", told(of("true"))));
    parts.push(" · friction ", span("f", told(of("friction"))));
    now.replaceChildren(...parts);
  }
}

function paintTiming(view, isKnown, now) {
  late.draw(seconds, now);
  work.draw(seconds, now);
  const second = isKnown ? view.second : null;
  const ms = (us) => (us === null || us === undefined ? "–" : (us / 1000).toFixed(2));
  byId("latenow").replaceChildren("median ", span("e", ms(second?.late_p50_us)), " · max ", span("f", ms(second?.late_max_us)));
  byId("worknow").replaceChildren("work ", span("e", ms(second?.work_max_us)), " · frames ", span("f", ms(second?.collect_max_us)));
  setText(byId("overruns"), String(second?.overrun_count ?? "–"));
}

const POWERED = ["operation_enabled", "quick_stop_active"];
const BAD = ["fault", "fault_reaction_active"];

function tableRow(name, state, className, ...more) {
  const line = made("tr", "");
  line.append(made("td", "", name), made("td", "", made("span", `dot ${className}`), state), ...more);
  return line;
}

const SWITCH = [["hand switch", "hand_switch_closed", "held", "open"], ["STO", "sto_released", "released", "active"]];

function paintDrives(view, isKnown) {
  const drives = isKnown ? view.drives : view.drives.map(({ name }) => ({ name, power_state: null, statusword: null, effort: null, temperature_degc: null, hand_switch_closed: null, sto_released: null, emergency: null }));
  const right = (words, className = "") => made("td", className, words);
  const lines = drives.map((drive) => {
    const { power_state: state } = drive;
    const className = POWERED.includes(state) ? "on" : BAD.includes(state) ? "bad" : "";
    const isHip = drive.name.endsWith("hip");
    const effort = drive.effort === null ? "–" : `${sign(drive.effort, isHip ? 1 : 0)} ${isHip ? "N·m" : "N"}`;
    const said = drive.emergency ?? state?.replaceAll("_", " ") ?? "–";
    const warm = drive.temperature_degc === null ? "–" : drive.temperature_degc.toFixed(0);
    return tableRow(drive.name.replace("/", " "), said, className, right(drive.statusword ?? "–", "wide"), right(effort), right(warm));
  });
  const second = isKnown ? view.second : null;
  const load = second?.bus_load_ratio ?? null;
  const isGood = second?.bus === "active";
  lines.push(tableRow("bus", second?.bus ?? "–", isGood ? "on" : second ? "bad" : "", right("", "wide"), right(load === null ? "–" : `${(100 * load).toFixed(1)} %`), right("")));
  const said = SWITCH.map(([name, key, yes, no]) => {
    const read = drives.map((drive) => drive[key]);
    return `${name} ${read.includes(false) ? no : read.length && read.every((one) => one === true) ? yes : "–"}`;
  });
  const inputs = made("td", "", said.join(" · "));
  inputs.colSpan = 5;
  lines.push(made("tr", "", inputs));
  byId("driverows").replaceChildren(...lines);
}

// As many as there is room for, the newest first.
function paintEvents() {
  if (!areEventsNew) return;
  areEventsNew = false;
  const list = byId("eventlist");
  list.replaceChildren();
  for (const event of [...events].reverse()) {
    const line = made("p");
    if (event.priority === "high" || event.priority === "medium") line.append(span("mark", "▲ "));
    line.append(event.said.en);
    const remedy = made("em", "", event.remedy.en ? ` ${event.remedy.en}` : "");
    line.append(remedy);
    const item = made("li", "", made("time", "", clock(event.time_ms)), line);
    list.append(item);
    const isFull = () => list.scrollHeight > list.clientHeight;
    if (isFull()) remedy.remove();
    if (isFull() && list.childElementCount > 1) {
      item.remove();
      return;
    }
  }
}

let [curvesMs, slowMs] = [-Infinity, -Infinity];
function paintAllNext() {
  [curvesMs, slowMs] = [-Infinity, -Infinity];
}
addEventListener("resize", () => {
  areEventsNew = true;
  paintAllNext();
});

function paint() {
  requestAnimationFrame(paint);
  const view = live.frame;
  const word = wordOf(view, live.loss());
  if (word !== document.body.dataset.word) paintAllNext(); // nothing that is lost stays for a moment
  paintTop(view, word);
  if (view === null) return;
  const isKnown = SAID[word] === undefined;
  paintFigure(view, isKnown);
  painted.frames += 1;
  const sampled = isKnown ? view.legs[0]?.row?.[0] ?? null : null;
  if (sampled !== null && sampled !== painted.newest) {
    painted.newest = sampled;
    painted.ages.push(Date.now() - sampled);
    if (painted.ages.length > AGES_MAX) painted.ages.shift();
  }
  if (performance.now() - curvesMs < CURVES_MS || columns.length === 0) return;
  curvesMs = performance.now();
  paintReadouts(view, isKnown);
  paintCurves(view, isKnown);
  if (performance.now() - slowMs < SLOW_MS) return;
  slowMs = performance.now();
  const now = Math.max(spans.at(-1)?.t ?? 0, ...legs.map((leg) => rows.get(leg)?.at(-1)?.t ?? 0));
  paintTiming(view, isKnown, now);
  paintTimeline(byId("timeline").firstElementChild, spans, strides, legs, now);
  paintDrives(view, isKnown);
  paintEvents();
}
paint();
