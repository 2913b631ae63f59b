// The therapist's page: the session now, what can be done, the plan, progress, the machine.
import { Alarm, Live, Words, byId, load, post, setText } from "./common.js";
import { LegCard } from "./therapist_legs.js";
import { clock, clockWithSeconds, digits, icon, made, Once, paintIcon } from "./therapist_parts.js";
import { PlanForm } from "./therapist_plan.js";
import { ProfileForm } from "./therapist_profile.js";
import { ProgressPanel } from "./therapist_progress.js";
import { lookOf } from "./timeline.js";

const STRIDES_MAX = 200;
const EVENTS_MAX = 50;
const EVENTS_SHOWN = 12;
const PROGRESS_MS = 15000;
const SLOW_MS = 250; // between two paintings of what changes once a second
const NEW_MS = 600; // a button that has just come is not pressed by a second tap
const LOOKS = { enable: "main", hold: "main", disable: "warn" };
const NOTHING = { value: null, std: null };
const NO_AXIS = { validity: null, patient: NOTHING, friction: NOTHING, net: NOTHING, tremor_frequency_hz: null, tremor_amplitude: null };
const BAD_POWER = ["fault", "fault_reaction_active"];
const POWERED = ["operation_enabled", "quick_stop_active"];

const session = await load("/session.json");
const words = await Words.load(session.language);
const alarm = new Alarm(byId("sound"));
const painted = (window.painted = { frames: 0, items: 0 }); // read by the tests

let strides = [];
let events = [];
let progress = null;
let controlsMs = -Infinity;
const cards = new Map();

function onItems(items) {
  painted.items += items.length;
  for (const item of items) {
    if (item.kind === "stride") strides.push(item);
    else if (!events.some(({ id }) => id === item.id)) events.push(item);
  }
  events.sort((one, other) => one.time_ms - other.time_ms);
  strides = strides.slice(-STRIDES_MAX);
  events = events.slice(-EVENTS_MAX);
  for (const leg of live.frame.legs) cardOf(leg.leg).take(leg);
}

const live = new Live(alarm, onItems, () => {
  [strides, events] = [[], []];
});

function cardOf(leg) {
  if (!cards.has(leg)) {
    cards.set(leg, new LegCard(byId("legs"), leg, words));
    byId("legs").classList.toggle("two", cards.size > 1);
  }
  return cards.get(leg);
}

// --- requests ----------------------------------------------------------------------------------

let isAsking = false;

// Sends a request and tells its outcome; true: done.
async function request(path, body) {
  if (isAsking) return false;
  isAsking = true;
  tell(words.of("asking"));
  const { outcome, said } = await post(path, body, 12000, { "X-CSRF-Token": session.csrf });
  isAsking = false;
  if (outcome === "done") tell(words.of("request_done"));
  else if (outcome === "refused") tell(words.refusal(said));
  else tell(words.of("no_answer"));
  return outcome === "done";
}

function tell(text) {
  byId("answer").replaceChildren(text);
}

const possible = new Once(([controls, holder]) => {
  const had = byId("possible").contains(document.activeElement);
  controlsMs = performance.now();
  const what = ({ does }) => words.of(`does.${does}`, { name: holder ?? "" });
  byId("possible").replaceChildren(...controls.filter(({ does }) => does !== null).map((control) => {
    const { command, does } = control;
    const look = does === "lets_go_until_enabled" ? "warn" : LOOKS[command] ?? "";
    const button = Object.assign(made("button", look, made("span", "", words.of(`do.${command}`)), made("small", "", what(control))), { type: "button" });
    button.addEventListener("click", () => {
      if (performance.now() - controlsMs > NEW_MS) request("/act", { command });
    });
    return button;
  }));
  byId("impossible").replaceChildren(...controls.filter(({ does }) => does === null).map(({ command, why_not: why }) =>
    made("li", "", made("b", "", words.of(`do.${command}`)), made("span", "", words.of(`why_not.${why}`)))));
  if (had) byId("h-controls").focus(); // the next press of a key must not meet another button
});

byId("mark").addEventListener("submit", async (event) => {
  event.preventDefault();
  const field = byId("marktext");
  if (await request("/mark", { text: field.value.trim() })) field.value = "";
});

const plan = new PlanForm(words, (limits) => request("/plan", { plan: limits }));
const history = new ProgressPanel(words);
const profile = new ProfileForm(words, session.csrf, () => readOnce());

// --- painting ----------------------------------------------------------------------------------

// How far the session is, as far as the history tells, and who takes part in it.
const course = new Once(([now, profile, holder]) => {
  const planned_s = profile === null ? 0 : profile.blocks.reduce((sum, block) => sum + block.duration_s, 0);
  const isGoing = now !== null && now.block > 0 && planned_s > 0;
  byId("part").hidden = !isGoing;
  if (isGoing) {
    const minutes = (time_s) => digits(time_s / 60, words.language, 0);
    const text = words.of("part", { part: now.block, all: profile.blocks.length, walked: minutes(now.walked_s), planned: minutes(planned_s) });
    setText(byId("parttext"), text);
    byId("partbar").value = Math.min(1, now.walked_s / planned_s);
    byId("partbar").setAttribute("aria-label", text);
  }
  const since = () => words.of("since", { profile: profile.id, time: clock(now.begun_ms, words.language) });
  const whose = profile === null ? "" : now === null ? words.of("profile_only", { profile: profile.id }) : since();
  const assist = holder === null ? "" : words.of("held_by", { name: holder });
  setText(byId("who"), [whose, assist].filter(Boolean).join(" · "));
});

function paintTop(view, word) {
  const isKnown = word !== "lost";
  document.body.dataset.word = live.loss() || word;
  paintIcon(byId("mode").firstElementChild, word);
  const name = `mode.${view?.mode}`;
  const loss = live.loss() || "no_signal";
  setText(byId("modeword"), isKnown ? words.has(name) ? words.of(name) : words.of("mode.other", { mode: view.mode }) : words.of(`lost.${view === null && loss === "no_connection" ? "wait" : loss}`));
  const stage = isKnown && view.stage !== null && view.stage !== "playing" ? `stage.${view.stage}` : "";
  setText(byId("stage"), stage && words.of(stage));
  const now = progress?.sessions.findLast(({ end }) => end === "") ?? null;
  course.show([now, progress?.profile ?? null, isKnown ? view.lease_holder : null], words.language);
  byId("quiet").hidden = !alarm.isSounding();
}

const lost = new Once((loss) => {
  byId("loss").hidden = loss === "";
  byId("loss").dataset.kind = loss;
  if (loss === "") return;
  setText(byId("losstitle"), words.of(`lost.${loss}`));
  setText(byId("lossline"), words.of(`loss.${loss}`));
});

const stopped = new Once((stop) => {
  byId("verdict").hidden = stop === null;
  if (stop === null) return;
  paintIcon(byId("verdict").firstElementChild, "stopped");
  setText(byId("cause"), words.said(stop.stopped));
  byId("subject").hidden = stop.subject === null;
  setText(byId("subject"), stop.subject === null ? "" : words.said(stop.subject));
  setText(byId("first"), words.of(`first.${stop.situation}`));
  for (const part of ["then", "again"]) setText(byId(part), words.said(stop[part]));
});

const row = (...cells) => made("tr", "", ...cells.map((text) => made("td", text === "–" ? "unknown" : "", typeof text === "string" ? made("span", "", text) : text)));

const drives = new Once((list) => byId("drives").replaceChildren(...list.map((drive) => {
  const { name, power_state: power, effort, temperature_degc: warm } = drive;
  const [leg, axis] = name.split("/");
  const isHip = axis === "hip";
  const look = power === null ? "lost" : BAD_POWER.includes(power) ? "medium" : POWERED.includes(power) ? "ok" : "rest";
  const state = made("span", "state", icon(look), words.of(`power_state.${power ?? "unknown"}`));
  const measured = effort === null ? "–" : `${digits(effort, words.language, isHip ? 1 : 0)} ${isHip ? "N·m" : "N"}`;
  return row(`${words.of(`side.${leg}`)}, ${words.of(`axis.${axis}`)}`, state, measured, digits(warm, words.language, 0));
})));

const facts = new Once(([health, handSwitch, sto, tested]) => {
  const input = (key, value) => (value === null ? "–" : words.of(`${key}.${value}`));
  const load_percent = health?.bus_load_ratio ?? null;
  const bus = health?.bus ?? null;
  const busText = [bus === null ? "" : words.of(`bus.${bus}`), load_percent === null ? "" : words.of("bus_load", { load: digits(100 * load_percent, words.language, 0) })].filter(Boolean).join(", ");
  const late = health?.lateness_max_us ?? null;
  const test = tested === null || tested === undefined ? "–" : tested === 0 ? words.of("never") : new Date(tested).toLocaleString(words.language, { day: "numeric", month: "short", hour: "2-digit", minute: "2-digit" });
  byId("facts").replaceChildren(
    row(words.of("hand_switch"), input("hand_switch", handSwitch)),
    row(words.of("emergency_stop"), input("emergency_stop", sto)),
    row(words.of("self_test_passed"), test),
    row(words.of("bus"), busText || "–"),
    row(words.of("late"), late === null ? "–" : `${digits(late / 1000, words.language, 2)} ms`),
    row(words.of("overruns"), digits(health?.overrun_count, words.language, 0)),
    row(words.of("missed"), digits(health?.missed_count, words.language, 0)),
  );
});

const eventList = new Once((list) => byId("eventlist").replaceChildren(...(list.length ? list.map((event) => {
  const text = made("p", "", words.said(event.said));
  const remedy = words.said(event.remedy);
  if (remedy) text.append(made("em", "", remedy));
  return made("li", "", icon(event.icon, words.of(`kind.${event.icon}`)), made("time", "", clockWithSeconds(event.time_ms, words.language)), text);
}) : [made("li", "none", words.of("no_events"))])));

// Nothing is known where nothing comes.
const unknownLeg = ({ leg }) => ({ leg, time_ms: null, hip_angle_rad: null, slide_position_m: null, power_w: null, hip: NO_AXIS, slide: NO_AXIS });
const unknownDrive = ({ name }) => ({ name, power_state: null, effort: null, temperature_degc: null });

let slowMs = -Infinity;
let wasKnown = null;
function paint() {
  requestAnimationFrame(paint);
  const view = live.frame;
  const loss = view === null && live.closedBy === "no_connection" ? "" : live.loss();
  const isKnown = view !== null && live.loss() === "" && !view.is_silent;
  const word = isKnown ? lookOf(view.mode) : "lost";
  paintTop(view, word);
  lost.show(view === null ? loss : live.loss() || (view.is_silent ? "no_signal" : ""), words.language);
  if (view === null) return;
  const nowMs = performance.now();
  const isOther = isKnown !== wasKnown; // nothing that is lost stays for a moment
  wasKnown = isKnown;
  stopped.show(isKnown ? view.stop : null, words.language);
  possible.show(isKnown ? [view.controls, view.lease_holder] : [view.controls.map(({ command }) => ({ command, does: null, why_not: "unknown" })), null], words.language);
  plan.paint(view, isKnown ? view.plan : { state: "unknown", limits: null }, progress?.profile ?? null);
  for (const leg of view.legs) {
    const card = cardOf(leg.leg);
    if (isOther) card.shownMs = card.drawnMs = -Infinity;
    card.paint(isKnown ? leg : unknownLeg(leg), view.geometry, strides, progress?.targets[leg.leg] ?? null, nowMs);
  }
  painted.frames += 1;
  if (nowMs - slowMs < SLOW_MS && !isOther) return;
  slowMs = nowMs;
  drives.show(isKnown ? view.drives : view.drives.map(unknownDrive), words.language);
  facts.show(isKnown ? [view.health, view.hand_switch_closed, view.sto_released, progress?.self_test_ms] : [null, null, null, progress?.self_test_ms], words.language);
  eventList.show(events.slice(-EVENTS_SHOWN).reverse(), words.language);
  history.paint(progress);
}

async function readOnce() {
  const signal = AbortSignal.timeout(PROGRESS_MS);
  progress = await fetch("/progress.json", { signal }).then((answer) => (answer.ok ? answer.json() : null)).catch(() => null);
  byId("profilepanel").hidden = !progress?.is_configured;
}

async function readProgress() {
  await readOnce();
  setTimeout(readProgress, PROGRESS_MS);
}

byId("language").addEventListener("click", () => {
  words.toggle();
  for (const card of cards.values()) card.relabel();
  plan.judge();
  profile.relabel();
  tell("");
});
byId("quiet").addEventListener("click", () => alarm.acknowledge());
byId("logout").addEventListener("click", async () => {
  await request("/logout", {});
  location.reload();
});
const restyle = () => {
  for (const card of cards.values()) card.restyle();
};
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", restyle);
document.fonts.ready.then(restyle);
document.body.dataset.page = "therapist"; // its script has run
paint();
readProgress();
