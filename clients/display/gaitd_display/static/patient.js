// The patient's page: paints what the server has computed; decides nothing but whether the server is there.
import { Alarm, Live, Words, byId, load, post, setText } from "./common.js";
import { el, Mechanism } from "./figure.js";
import { drawSymbol, pictureOf } from "./pictures.js";
import { paintSteps } from "./steps.js";

const TROUBLE_MS = 6000;
const AGES_MAX = 4096;
const LONGEST = 0.56; // 16:9
const SQUAREST = 0.76; // 4:3
const TALLY_ROOM_M = 0.47; // below the rail
const CARD_ROOM_M = 0.1;
const ROW_MIN = 3; // shorter rows are not told
const COUNT_MAX = 999; // longer ones have no room beside each other
const SEGMENTS_MAX = 12; // of the ring; more would be dots
const WALKING = ["go_on", "more", "good", "gently", "relax"];
const COUNTING = ["soon", "rest"];
const TONES = { good: "good", finished: "good", more: "more", gently: "gently", relax: "against", soon: "soon", stopped: "alert", stopping: "alert" };
const WITH_END = ["paused", "next", "failed"];

const { page, diagonal_mm: diagonalMm, far_mm: farMm, far_ratio: farRatio, text_max_ratio: textMax, announce_s: announceS, losses } = await load("/page.json");
const words = await Words.load(page.language);
words.otherwise = () => words.all.cautious[words.language]; // nothing is known: the emergency stop
const alarm = new Alarm(byId("sound"));
const painted = (window.painted = { frames: 0, ages: [] }); // read by `gaitd bench` and the tests
let trouble = "";
let isAsking = false;
let scene = { key: "", figures: [], paint: () => {} }; // what is shown now
const farUnits = 100 * farRatio; // of the smallest text, as --t-far in tokens.css
let sizes = { unit: 1, far: farUnits };

document.body.dataset.hand = page.switch_hand;
for (const part of ["help", "unstrap"]) {
  for (const language of ["en", "de"]) words.all[language][`page.${part}`] = page[part][language];
}

const live = new Live(alarm, () => {}, () => {});

// --- small helpers -------------------------------------------------------------------------------

function html(tag, className, ...children) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  made.append(...children);
  return made;
}

const phrase = ({ key, values, said }) => (said === null ? words.of(key, { help: words.of("page.help"), ...values }) : words.said(said));
const percent = (ratio) => (ratio === null ? "–" : `${Math.round(100 * ratio)}\u00a0%`);

// Type as large as the screen needs it, and the layout bears it: see settings.py.
function measure() {
  const { innerWidth: width, innerHeight: height } = window;
  const unit = width > height ? Math.min(height / 100, width * 0.0064) : Math.min(height * 0.00625, width / 100);
  const mmPerPx = diagonalMm / Math.hypot(width, height);
  const form = Math.min(width, height) / Math.max(width, height);
  const most = form < LONGEST || form > SQUAREST ? 1 : textMax; // the layout bears it on these screens alone
  const text = Math.max(1, Math.min(most, farMm / mmPerPx / (farUnits * unit)));
  document.documentElement.style.setProperty("--text", text.toFixed(3));
  sizes = { unit, far: farUnits * text * unit, of: `${width} ${height}` };
}

// --- the parts of a scene ------------------------------------------------------------------------

// Where the service has said what the mechanism is; it moves with the leg.
function figureIn(box, view, room = null, svg = el("svg", { "aria-hidden": "true" })) {
  if (!box.contains(svg)) box.append(svg);
  if (!view?.geometry) return;
  const legs = view.legs.map(({ leg }) => leg);
  const machine = new Mechanism(svg, view.geometry, legs, room);
  const { clientWidth: width, clientHeight: height } = svg;
  machine.layout(width || 240, height || 166);
  scene.figures.push({ box, machine });
}

function paintFigures(view, isKnown) {
  for (const { box, machine } of scene.figures) {
    const areKnown = view.legs.map((leg) => isKnown && leg.hip_angle_rad !== null && leg.slide_position_m !== null);
    box.classList.toggle("unknown", !areKnown[0]);
    view.legs.forEach(({ leg, hip_angle_rad: hip, slide_position_m: slide, glow_ratio: glow }, index) => {
      machine.parts.get(leg).g.classList.toggle("absent", !areKnown[index]);
      if (areKnown[index]) machine.draw(leg, hip, slide, 0.8 * (machine.isClose ? glow : 0));
    });
  }
}

// One arc for each part; those before are full, the present one is filled by its ratio.
function ring(svg, number, count, ratio, width) {
  svg.replaceChildren();
  const [parts, at] = count > SEGMENTS_MAX ? [1, 0] : [count, number - 1];
  const gap = parts === 1 ? 0 : Math.min(3.5, 40 / parts);
  const length = 100 / parts - gap;
  for (let part = 0; part < parts; part += 1) {
    const arc = (className, size) => el("circle", {
      cx: 50, cy: 50, r: 50 - width / 2, class: className, "stroke-width": width, pathLength: 100,
      "stroke-dasharray": `${size} ${100 - size}`, "stroke-dashoffset": -(part * 100) / parts, transform: "rotate(-90 50 50)",
    }, svg);
    arc("track", length);
    const done = part < at ? 1 : part === at ? ratio : 0;
    if (done > 0) arc("done", done * length);
  }
}

function cardOf({ picture, number, title, text, is_first: isFirst }, view) {
  const head = html("strong", "");
  if (number !== null) head.append(html("span", "number", String(number)));
  head.append(phrase(title));
  const said = html("p", "", head);
  if (text !== null) said.append(phrase(text));
  const box = html("div", "picturebox");
  const card = html("div", isFirst ? "card first" : "card", html("div", "inside", box, said));
  byId("scene").append(card);
  if (picture === "leg") figureIn(box, view, CARD_ROOM_M);
  else box.append(pictureOf(picture, page.switch_hand));
}

function stripOf({ picture, text, is_small: isSmall }) {
  const strip = html("p", isSmall ? "strip near" : "strip");
  if (picture !== null) strip.append(pictureOf(picture, page.switch_hand));
  strip.append(html("span", "", phrase(text)));
  byId("scene").append(strip);
}

const LAYOUTS = {
  plain() {},

  leg(view) {
    const box = html("div", "panel");
    byId("scene").append(box);
    figureIn(box, view);
  },

  cards(view, said) {
    const hasEnd = view?.training?.buttons.includes("end") && WITH_END.includes(view.word);
    byId("scene").dataset.cards = said.cards.length + (hasEnd ? 1 : 0);
    for (const card of said.cards) cardOf(card, view);
    if (hasEnd) byId("scene").append(endButton("card end"));
    for (const strip of said.strips) stripOf(strip);
  },

  walk(view) {
    const box = html("div", "panel fade");
    const path = el("svg", { role: "img" });
    byId("scene").append(box, html("div", "panel", path));
    figureIn(box, view, TALLY_ROOM_M);
    const tally = html("div", "tally");
    box.append(tally);
    let [painted, told] = ["", ""];
    scene.paint = (now) => {
      const steps = JSON.stringify(now.steps);
      if (steps !== painted) paintSteps(path, { legs: now.legs, steps: now.steps, words, ...sizes });
      painted = steps;
      const counts = now.training === null ? "" : `${now.word} ${now.training.row_count} ${now.training.session_in_band_count}`;
      if (counts !== told) paintTally(tally, now);
      told = counts;
    };
  },

  count(view) {
    const face = el("svg", { viewBox: "0 0 100 100", "aria-hidden": "true" });
    const digits = html("span", "digits");
    const box = html("div", "count", face, digits);
    box.setAttribute("role", "timer");
    byId("scene").append(box);
    if (view.word === "rest") byId("scene").append(praise(view.training));
    else LAYOUTS.leg(view);
    let told = "";
    scene.paint = ({ training }) => {
      const [left, whole] = countdown(training, view.word);
      const text = left === 0 ? "" : view.word === "rest" ? clock(left) : String(Math.ceil(left));
      if (text === told && text !== "") return;
      if (text === "" && face.dataset.shown === "sign") return;
      told = text;
      face.dataset.shown = text === "" ? "sign" : "digits";
      setText(digits, text);
      digits.dataset.length = text.length;
      ring(face, 1, 1, left === 0 ? 1 : Math.ceil(left) / whole, 7);
      if (text === "") drawSymbol(el("svg", { x: 26, y: 22, width: 48, height: 48, viewBox: "0 0 100 100" }, face), view.word);
    };
  },

  summary(view) {
    const { training: { summary } } = view;
    const { walked_s: walked, valid_count: valid, in_band_count: inBand, best_row_count: best } = summary;
    const minutes = walked < 600 ? (walked / 60).toLocaleString(words.language, { maximumFractionDigits: 1 }) : String(Math.round(walked / 60));
    const tile = (big, small, key) => html("div", "tile", html("b", "", big, html("small", "", small)), html("span", "", words.of(key)));
    byId("scene").append(
      tile(minutes, ` ${words.of("minutes")}`, "walked"),
      tile(valid === 0 ? "–" : String(inBand), valid === 0 || valid > COUNT_MAX ? "" : ` / ${valid}`, "in_target"),
      tile(valid === 0 ? "–" : String(best), "", "best_row"),
    );
    paintShares(summary);
  },
};

const clock = (left_s) => `${Math.floor(Math.ceil(left_s) / 60)}:${String(Math.ceil(left_s) % 60).padStart(2, "0")}`;

// What is left, and of how much; before and after it is counted nothing is.
function countdown(training, word) {
  if (training === null) return [0, 1];
  return word === "rest" ? [training.block_left_s, training.block_s] : [training.announce_left_s, announceS];
}

function paintTally(tally, { word, training }) {
  tally.replaceChildren();
  if (training === null) return;
  const { row_count: row, session_valid_count: valid, session_in_band_count: count } = training;
  if (word === "good" && row >= ROW_MIN) tally.append(html("p", "", html("b", "", String(row)), ` ${words.of("in_row")}`));
  const tick = el("svg", { viewBox: "0 0 100 100", "aria-hidden": "true" });
  drawSymbol(tick, count > 0 ? "good" : "go_on");
  tally.append(html("p", "", tick, html("b", "", valid > 0 ? String(count) : "–"), ` ${words.of("in_target")}`));
}

function praise({ in_band_count: inBand, valid_count: valid, number, count, buttons }) {
  const tick = el("svg", { viewBox: "0 0 100 100", "aria-hidden": "true" });
  drawSymbol(tick, inBand > 0 ? "good" : "go_on");
  const said = valid > 0
    ? html("p", "praise", html("b", "", String(inBand)), words.of("of_steps", { count: valid }))
    : html("p", "praise", words.of("no_steps"));
  const next = html("div", "next", html("p", "", words.of("next_part", { number, count })));
  if (buttons.includes("end")) next.append(endButton("press end"));
  return html("div", "panel praisebox", tick, said, next);
}

function paintShares({ share_ratio: share, past_share_ratios: past, best_share_ratio: best }) {
  const said = html("p", "", words.of("your_share", { share: percent(share) }));
  if (past !== null) said.append(html("br"), past.length > 0 ? words.of("shares_before", { last: percent(past.at(-1)), best: percent(best) }) : words.of("first_time"));
  const svg = el("svg", { "aria-hidden": "true" });
  byId("scene").append(html("div", "panel shares", said, svg));
  const { clientWidth: width, clientHeight: height } = svg;
  if (height < 2 * sizes.far) return svg.remove(); // no room: the sentence says the same
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const all = [...(past ?? []), share];
  const highest = Math.max(0.01, ...all.map((one) => one ?? 0));
  const each = Math.min(width / all.length, 14 * sizes.unit);
  const floor = Math.max(3 * sizes.unit, height - 0.95 * sizes.far);
  all.forEach((one, index) => {
    const isToday = index === all.length - 1;
    const [x, high] = [width - (all.length - index) * each, ((one ?? 0) / highest) * (floor - 2 * sizes.unit)];
    el("rect", { x: x + each * 0.14, y: floor - high, width: each * 0.72, height: high, rx: 0.08 * each, class: isToday ? "sharebar today" : "sharebar" }, svg);
  });
  if (share !== null) el("text", { x: width, y: height - 0.2 * sizes.far, class: "sharetext" }, svg, words.of("today"));
}

function endButton(className) {
  const button = html("button", className, html("b", "", words.of("press.end")));
  if (className.includes("card")) button.append(html("span", "", words.of("end_here")));
  button.id = "end";
  button.type = "button";
  button.addEventListener("click", () => request("/session", { button: "end" }));
  return button;
}

// --- buttons -------------------------------------------------------------------------------------

// In the footer, before STOP: the one of the step, then those of the session.
const buttons = new Map();
for (const [name, className] of [["action", "press main"], ["start", "press main"], ["pause", "press"]]) {
  const button = html("button", className);
  Object.assign(button, { id: name, type: "button", hidden: true });
  byId("stop").before(button);
  buttons.set(name, button);
}
buttons.get("action").addEventListener("click", () => request("/act", { action: buttons.get("action").dataset.action }));
for (const name of ["start", "pause"]) buttons.get(name).addEventListener("click", () => request("/session", { button: name }));

function show(button, isShown, text = "") {
  button.hidden = !isShown;
  if (isShown) setText(button, text);
}

function paintButtons(view, isConnected) {
  const action = isConnected ? view.action : null;
  const session = isConnected && view.training !== null ? view.training.buttons : [];
  const button = buttons.get("action");
  show(button, action !== null, action === null ? "" : words.of(`act.${action}`));
  button.dataset.action = action ?? "";
  button.disabled = isAsking;
  for (const name of ["start", "pause"]) show(buttons.get(name), session.includes(name), words.of(`press.${name}`));
  buttons.get("start").disabled = isAsking; // what ends a motion waits for nothing
  const count = [...buttons.values()].filter((one) => !one.hidden).length;
  document.body.dataset.presses = count;
}

// --- painting ------------------------------------------------------------------------------------

function layoutOf(word, said) {
  if (WALKING.includes(word)) return "walk";
  if (said.cards.length > 0) return "cards";
  if (COUNTING.includes(word)) return "count";
  if (word === "finished") return "summary";
  return word === "too_many_pages" ? "plain" : "leg";
}

const STOP_NOTES = { no_connection: "no_stop_now" };

function paintHead(word, said) {
  if (document.body.dataset.word !== word) {
    // Only between words of the same page; a stop, or its end, is there at once.
    document.body.classList.toggle("calm", WALKING.includes(word) && WALKING.includes(document.body.dataset.word));
    byId("said").setAttribute("aria-live", word === "stopped" ? "assertive" : "polite");
    document.body.dataset.word = word;
    document.body.dataset.tone = TONES[word] ?? "plain";
    drawSymbol(byId("symbol"), word);
  }
  setText(byId("word"), phrase(said.heading));
  byId("line").hidden = said.line === null;
  setText(byId("line"), said.line === null ? "" : phrase(said.line));
  setText(byId("whole"), said.whole === null ? "" : phrase(said.whole));
  setText(document.querySelector("#stop small"), words.of(STOP_NOTES[word] ?? "stop_note"));
}

// A scene is made anew where something of it has changed; its moving parts are painted each frame.
function paintScene(view, word, said) {
  const layout = layoutOf(word, said);
  const legs = view?.legs.map(({ leg, share_low_ratio: low }) => [leg, low !== null]);
  const training = view?.training ?? null;
  const counts = layout === "walk" ? "" : [training?.buttons.includes("end"), training?.summary, training?.number];
  // The walking scene is one for all its words, so that nothing of it is made anew at each step.
  const shown = layout === "walk" ? layout : [word, said];
  const key = JSON.stringify([layout, shown, words.language, sizes, view?.geometry, legs, counts, fontsCount]);
  if (key === scene.key) return;
  scene = { key, figures: [], paint: () => {} };
  document.body.dataset.layout = layout;
  delete byId("scene").dataset.cards;
  byId("scene").replaceChildren();
  LAYOUTS[layout](view, said);
}

let paintedLeft = "";
function paintLeft({ training }, word) {
  const isShown = WALKING.includes(word) && training !== null && training.phase === "walking";
  byId("left").hidden = !isShown;
  if (!isShown) return;
  const { block_left_s: left, block_s: whole, number, count } = training;
  const isLong = left > 60;
  const told = String(Math.ceil(isLong ? left / 60 : left));
  const unit = words.of(isLong ? "minutes" : "seconds");
  const key = `${told} ${unit} ${number} ${count} ${Math.round(left)}`;
  if (key === paintedLeft) return;
  paintedLeft = key;
  byId("lefttext").replaceChildren(html("b", "", told), html("small", "", unit));
  byId("left").setAttribute("aria-label", words.of("block_left", { number, count, left: `${told} ${unit}` }));
  ring(byId("ring"), number, count, 1 - left / whole, 9);
}

const NOTHING = { heading: { key: "word.no_connection", values: {} }, line: null, whole: null, cards: [], strips: [] };

function paint() {
  requestAnimationFrame(paint);
  const loss = live.loss();
  const isConnected = loss === "";
  const view = live.frame;
  const word = isConnected ? view.word : loss;
  const said = isConnected ? view.scene : losses[word] ?? NOTHING;
  const isKnown = isConnected && word !== "no_signal";
  paintHead(word, said);
  paintScene(isConnected ? view : null, word, said);
  paintButtons(view, isConnected);
  setText(byId("trouble"), trouble);
  byId("trouble").hidden = trouble === "";
  byId("quiet").hidden = !alarm.isHeard();
  byId("left").hidden = true;
  if (!view) return;
  if (isConnected) {
    paintLeft(view, word);
    scene.paint(view);
    byId("notkept").hidden = view.training === null || view.training.is_kept;
  }
  paintFigures(view, isKnown);
  painted.frames += 1;
  const sampled = isKnown ? view.sample_time_ms : null;
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

async function request(path, body) {
  isAsking = true;
  const answer = await post(path, body);
  isAsking = false;
  if (answer.outcome === "refused") tell(words.refusal(answer.said));
  else if (answer.outcome !== "done") tell(words.of("no_answer"));
}

let fontsCount = 0; // widths of texts change when they come
document.fonts.addEventListener("loadingdone", () => { fontsCount += 1; });
byId("language").addEventListener("click", () => words.toggle());
byId("quiet").addEventListener("click", () => alarm.acknowledge());
addEventListener("resize", measure);
measure();
paint();
