// The patient's page: paints what the server has computed; decides nothing but whether the server is there.
import { Alarm, Live, Words, byId, load, post, setText } from "./common.js";

const DOTS_MAX = 16; // of both legs: more would cover each other
const LOWEST = -0.25; // lower end of the bar
const TROUBLE_MS = 6000;
const AGES_MAX = 4096;

// One shape for each word, so that nothing depends on colour: [path, colour].
const UP = ["M50 5L95 60H70V95H30V60H5Z", "#d55e00"];
const DOWN = ["M50 95L95 40H70V5H30V40H5Z", "#e69f00"];
const TICK = ["M5 55L20 38L40 58L80 12L96 28L40 90Z", "#009e73"];
const BARS = ["M15 10H40V90H15ZM60 10H85V90H60Z", "#0072b2"];
const CLOCK = ["M20 5H80V15L58 50L80 85V95H20V85L42 50L20 15Z", "#0072b2"];
const CIRCLE = ["M50 8A42 42 0 1 1 49.9 8ZM50 24A26 26 0 1 0 50.1 24Z", "#0072b2"];
const SIGN = ["M30 3H70L97 30V70L70 97H30L3 70V30ZM22 40V60H78V40Z", "#d55e00"];
const WARNING = ["M50 4L98 92H2ZM45 32V64H55V32ZM45 70V82H55V70Z", "#111"];
const RIGHT = ["M5 35H55V10L97 50L55 90V65H5Z", "#0072b2"];
const HAND = ["M20 50L50 10L80 50H62V90H38V50Z M5 92H95V98H5Z", "#0072b2"];
const NO_WAVE = ["M5 45H30L40 20L60 80L70 55H95V65H76L60 98L40 42L36 55H5ZM8 5L14 0L95 92L89 98Z", "#111"];
const UNPLUGGED = ["M5 5L20 0L100 85L88 97ZM10 60H35V70H10ZM45 55A20 20 0 0 1 45 95ZM95 30H70V20H95ZM62 40A18 18 0 0 1 62 5Z", "#fff"];
const SHAPES = {
  no_connection: UNPLUGGED, too_many_pages: WARNING, no_signal: NO_WAVE, stopped: SIGN, stopping: SIGN, wait: CLOCK, ready: CIRCLE, rest: BARS,
  soon: WARNING, to_start: RIGHT, go_on: RIGHT, stronger: UP, good: TICK, gently: DOWN, ending: BARS, guide: HAND,
  self_test: CLOCK, service: CLOCK,
};

const page = await load("/page.json");
const words = await Words.load(page.language);
const alarm = new Alarm(byId("sound"));
const bars = new Map();
let dots = [];
let trouble = "";
let isAsking = false;
let dotsAreNew = true;
const painted = (window.painted = { frames: 0, ages: [], items: 0 }); // read by `gaitd bench` and the tests

const live = new Live(
  alarm,
  (items) => {
    painted.items += items.length;
    dots = [...dots, ...items].slice(-DOTS_MAX);
    dotsAreNew ||= items.length > 0;
  },
  () => { dots = []; dotsAreNew = true; },
);

function barOf(leg) {
  if (bars.has(leg)) return bars.get(leg);
  const figure = document.createElement("figure");
  figure.className = "bar";
  figure.innerHTML = '<figcaption></figcaption><div class="track"><div class="fill"></div><div class="zero"></div>' +
    '<div class="dash"></div><div class="band"><span></span></div><div class="peak"></div></div>';
  byId("bars").append(figure);
  const part = (name) => figure.querySelector(name);
  bars.set(leg, { figure, name: part("figcaption"), fill: part(".fill"), zero: part(".zero"), band: part(".band"),
    target: part(".band span"), peak: part(".peak"), dash: part(".dash"), track: part(".track") });
  return bars.get(leg);
}

const percent = (ratio) => `${((ratio - LOWEST) / (1 - LOWEST)) * 100}%`;

function paintBar(view, isKnown) {
  const bar = barOf(view.leg);
  const value = isKnown ? view.value_ratio : null;
  setText(bar.name, words.of(view.leg));
  setText(bar.target, words.of("target"));
  bar.track.setAttribute("role", "img");
  bar.track.setAttribute("aria-label", `${words.of(view.leg)}: ${value === null ? words.of("not_known") : `${Math.round(value * 100)} %`}`);
  bar.zero.style.bottom = percent(0);
  bar.band.style.bottom = percent(view.target_low_ratio);
  bar.band.style.height = `${((view.target_high_ratio - view.target_low_ratio) / (1 - LOWEST)) * 100}%`;
  bar.figure.classList.toggle("invalid", value === null);
  bar.figure.classList.toggle("against", value !== null && value < 0);
  bar.dash.hidden = value !== null;
  bar.fill.hidden = value === null;
  bar.peak.hidden = value === null || view.peak_ratio === null;
  if (value === null) return;
  bar.fill.style.bottom = percent(Math.min(0, value));
  bar.fill.style.height = `${(Math.abs(value) / (1 - LOWEST)) * 100}%`;
  if (view.peak_ratio !== null) bar.peak.style.top = `${100 - parseFloat(percent(view.peak_ratio))}%`;
}

function markOf(leg, className, x, y, radius) {
  return leg === "right"
    ? `<circle class="${className}" cx="${x}" cy="${y}" r="${radius}"/>`
    : `<rect class="${className}" x="${x - radius}" y="${y - radius}" width="${2 * radius}" height="${2 * radius}"/>`;
}

// Bands: the target of a session for the share of each leg. The page of two legs marks whose it is.
function paintDots(bands) {
  const { clientWidth: width, clientHeight: height } = byId("dots");
  const shown = `${width} ${height} ${bands.map((band) => Object.values(band))}`;
  if (!dotsAreNew && byId("dots").dataset.shown === shown) return;
  dotsAreNew = false;
  byId("dots").dataset.shown = shown;
  byId("dots").setAttribute("viewBox", `0 0 ${width} ${height}`);
  byId("bandlegend").hidden = bands.length === 0;
  const most = Math.max(1, ...dots.map((dot) => dot.work_j ?? 0));
  const rowOf = (share) => height - 24 - (height - 48) * share;
  const last = width - 24 - (bands.length > 1 ? 40 : 0);
  const frames = bands.map((band) => {
    const [top, bottom] = [rowOf(band.high_ratio), rowOf(band.low_ratio)];
    const mark = bands.length > 1 ? markOf(band.leg, `${band.leg} whose`, width - 20, (top + bottom) / 2, 10) : "";
    return `<rect class="share ${band.leg}" x="6" y="${top}" width="${width - 12}" height="${bottom - top}"/>${mark}`;
  });
  const shapes = [...frames, `<line class="half" x1="0" x2="${width}" y1="${rowOf(0.5)}" y2="${rowOf(0.5)}"/>`];
  for (const [index, dot] of dots.entries()) {
    const x = 24 + (index * (last - 24)) / (DOTS_MAX - 1);
    if (dot.share_ratio === null) { // a dash in the middle, as wherever a value is not valid
      shapes.push(`<rect class="unknown" x="${x - 11}" y="${rowOf(0.5) - 7}" width="22" height="14"/>`);
      continue;
    }
    const y = rowOf(Math.min(1, Math.max(0, dot.share_ratio)));
    const isKnown = dot.work_j !== null; // without it the mark is hollow
    const radius = isKnown ? 6 + (10 * Math.max(0, dot.work_j)) / most : 8;
    shapes.push(markOf(dot.leg, isKnown ? dot.leg : `${dot.leg} hollow`, x, y, radius));
  }
  byId("dots").innerHTML = shapes.join("");
}

function paintStop(view, word) {
  const isShown = view.stop !== null || view.step !== "none";
  byId("stopped").hidden = !isShown;
  byId("training").hidden = byId("bars").hidden = isShown;
  action.hidden = view.step === "none" || ["help", "start"].includes(view.step);
  if (!isShown) return;
  setText(byId("stopword"), words.of(`word.${word}`));
  setText(byId("happened"), view.stop ? words.said(view.stop.happened) : words.of(`line.${word}`));
  const list = byId("instructions");
  const texts = view.stop ? view.stop.instructions.map((text) => words.said(text)) : [];
  if (list.dataset.shown !== texts.join("\n")) {
    list.dataset.shown = texts.join("\n");
    list.replaceChildren(...texts.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
  }
  const isAlone = !["help", "none"].includes(view.step);
  byId("way").hidden = !isAlone;
  if (isAlone) setText(byId("waytext"), words.of(`way.${view.step}`));
  action.classList.toggle("absent", view.action === null);
  action.disabled = isAsking;
  if (view.action !== null) {
    setText(action, words.of(`act.${view.action}`));
    action.dataset.action = view.action;
  }
  byId("help").hidden = word === "stopping";
  byId("unstrap").hidden = view.unstrap === "not_now";
  byId("unstrapfirst").hidden = view.unstrap !== "behind_emergency_stop";
  setText(byId("helptext"), words.said(page.help));
  setText(byId("unstraptext"), words.said(page.unstrap));
}

// The button of a step: a row of the footer, which nothing covers; what is above may scroll.
const action = Object.assign(document.createElement("button"), { id: "action", type: "button", hidden: true });
action.addEventListener("click", () => request("/act", { action: action.dataset.action }));
byId("stop").parentElement.prepend(action);

// Each button has a place of its own, so that none comes to lie under a finger that presses another.
const presses = new Map();
for (const name of ["start", "pause", "end"]) {
  const button = Object.assign(document.createElement("button"), { id: name, type: "button", className: "press absent", hidden: true });
  button.addEventListener("click", () => request("/session", { button: name }));
  byId("stop").before(button);
  presses.set(name, button);
}

const ADVISED = ["ready", "rest", "wait"]; // words during which the session says what to do

// Below the advice: what the session has been, or why the last START has ended early or failed, the latter in the service's words.
function linesOf({ summary, reason, why, advice }, word) {
  if (!ADVISED.includes(word)) return [];
  if (summary === null && why !== null) return [words.of(`why.${why}`)];
  if (summary === null) return advice === "try_again_or_call_therapist" ? [reason] : [];
  const minutes = (summary.walked_s / 60).toLocaleString(words.language, { maximumFractionDigits: 1 });
  return [
    words.of("walked").replace("{minutes}", minutes),
    words.of("reached").replace("{reached}", summary.in_band_count).replace("{all}", summary.valid_count),
  ];
}

// Only if the server runs a session; without one nothing of it is shown.
function paintTraining(training, word) {
  for (const [name, button] of presses) {
    button.hidden = training === null;
    if (training === null) continue;
    button.classList.toggle("absent", !training.buttons.includes(name));
    button.disabled = isAsking && name === "start"; // what ends a motion waits for nothing
    setText(button, words.of(`press.${name}`));
  }
  byId("left").hidden = training === null || training.summary !== null;
  const lines = training === null ? [] : linesOf(training, word);
  byId("more").hidden = lines.length === 0;
  setText(byId("more"), lines.join("\n"));
  if (training === null) return;
  const kept = training.is_kept ? "" : ` · ${words.of("not_kept")}`;
  setText(byId("left"), `· ${words.of("time_left")}: ${Math.ceil(training.left_s / 60)}${kept}`);
}

let paintedWord = "";
function paint() {
  requestAnimationFrame(paint);
  const loss = live.loss();
  const isConnected = loss === "";
  const view = live.frame;
  const word = isConnected ? view.word : loss;
  const isKnown = isConnected && word !== "no_signal";
  if (word !== paintedWord) {
    paintedWord = document.body.dataset.word = word;
    for (const shape of [byId("shape"), byId("sign")]) {
      shape.setAttribute("d", SHAPES[word][0]);
      shape.setAttribute("fill", SHAPES[word][1]);
      shape.setAttribute("fill-rule", "evenodd");
    }
  }
  setText(byId("word"), words.of(`word.${word}`));
  const training = isConnected ? view.training : null;
  setText(byId("line"), training !== null && ADVISED.includes(word) ? words.of(`advice.${training.advice}`) : words.of(`line.${word}`));
  if (!view) return;
  paintTraining(training, word);
  for (const bar of view.bars) paintBar(bar, isKnown);
  paintDots(training === null ? [] : training.bands);
  paintStop(isConnected ? view : { stop: null, step: "none", action: null, unstrap: "not_now" }, word);
  setText(byId("trouble"), trouble);
  byId("trouble").hidden = trouble === "";
  byId("quiet").hidden = !alarm.isSounding();
  painted.frames += 1;
  const sampled = isKnown ? view.bars[0].sample_time_ms : null;
  if (sampled !== null && sampled !== painted.newest) {
    painted.newest = sampled;
    painted.ages.push(Date.now() - sampled);
    if (painted.ages.length > AGES_MAX) painted.ages.shift();
  }
}

let troubleTimer = 0;
function tell(text) {
  trouble = text;
  clearTimeout(troubleTimer);
  if (text) troubleTimer = setTimeout(() => { trouble = ""; }, TROUBLE_MS);
}

byId("language").addEventListener("click", () => words.toggle());
byId("quiet").addEventListener("click", () => alarm.acknowledge());
async function request(path, body) {
  isAsking = true;
  const answer = await post(path, body);
  isAsking = false;
  if (answer.outcome === "refused") tell(`${words.of("refused")}: ${answer.reason}`);
  else if (answer.outcome !== "done") tell(words.of("no_answer"));
}
paint();
