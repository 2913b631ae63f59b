// The therapist's page: numbers with their standard deviation, trends, requests.
import { Alarm, Live, Words, byId, load, post, setText } from "./common.js";

const TRACE_S = 20;
const TICKS_S = [-15, -10, -5, 0];
const POINTS_MAX = 60 * TRACE_S;
const PLOT_MS = 50;
const STRIDES_MAX = 200;
const EVENTS_MAX = 50;
const PROGRESS_MS = 15000;
const DAY_S = 86400;
const COMMANDS = ["enable", "disable", "hold", "hand_guiding", "self_test", "reset"];

const session = await load("/session.json");
const words = await Words.load(session.language);
const alarm = new Alarm(byId("sound"));
const request = (path, body) => post(path, body, 12000, { "X-CSRF-Token": session.csrf });

let strides = [];
let events = [];
let itemsAreNew = true;
const traces = new Map();
const painted = (window.painted = { frames: 0, items: 0 });

const live = new Live(
  alarm,
  (items) => {
    painted.items += items.length;
    for (const item of items) {
      if (item.kind === "stride") strides.push(item);
      else events.push(item);
    }
    strides = strides.slice(-STRIDES_MAX);
    events = events.slice(-EVENTS_MAX);
    itemsAreNew ||= items.length > 0;
  },
  () => { strides = []; events = []; itemsAreNew = true; },
);

function axes(label) {
  const font = "16px system-ui, sans-serif";
  return [{ font, stroke: "#111" }, { font, stroke: "#111", label, labelFont: font, size: 70 }];
}

// A ring of the last seconds for one axis; patient with its sigma, friction, net.
class Trace {
  constructor(parent, label) {
    this.rows = [[], [], [], [], [], []]; // time, patient, upper, lower, friction, net
    this.element = document.createElement("div");
    this.element.className = "plot";
    parent.append(this.element);
    const sigma = { stroke: "transparent", points: { show: false } };
    const line = (stroke, width, dash) => ({ stroke, width, dash, points: { show: false }, spanGaps: false });
    this.plot = new uPlot({
      width: 300, height: 190, legend: { show: false }, cursor: { show: false },
      axes: [{ ...axes(label)[0], splits: (plot) => TICKS_S.map((tick) => plot.scales.x.max + tick), values: () => TICKS_S.map((tick) => `${tick} s`) }, axes(label)[1]],
      scales: { x: { time: false, range: (_, low, high) => [(high ?? TRACE_S) - TRACE_S, high ?? TRACE_S] } },
      bands: [{ series: [2, 3], fill: "rgba(0,114,178,.25)" }],
      series: [{}, line("#0072b2", 3), sigma, sigma, line("#d55e00", 2, [10, 6]), line("#111", 2, [2, 4])],
    }, this.rows, this.element);
  }

  add(timeS, axis) {
    const { value, std } = axis.patient;
    const row = [timeS, value, value === null ? null : value + std, value === null ? null : value - std, axis.friction.value, axis.net.value];
    this.rows.forEach((column, index) => column.push(row[index]));
    if (this.rows[0].length > POINTS_MAX) for (const column of this.rows) column.shift();
  }

  draw() {
    if (this.plot.width !== this.element.clientWidth) this.plot.setSize({ width: this.element.clientWidth, height: 190 });
    this.plot.setData(this.rows);
  }
}

const share = (ratio) => (ratio === null ? null : 100 * ratio);
const trend = new uPlot({
  width: 300, height: 190, legend: { show: false }, cursor: { show: false },
  axes: [axes("")[0], { ...axes("%")[1] }, { ...axes("J")[1], side: 1, scale: "j", grid: { show: false } }],
  scales: { x: { time: false }, y: { range: [0, 100] } },
  series: [{}, { stroke: "#0072b2", width: 0, points: { show: true, size: 9, fill: "#0072b2" } },
    { scale: "j", stroke: "#d55e00", width: 0, points: { show: true, size: 7, fill: "#fff" } }],
}, [[], [], []], byId("trend"));

const number = (it, digits) => (it.value === null ? "–" : `${it.value.toFixed(digits)} ± ${it.std === null ? "–" : it.std.toFixed(digits)}`);
const plain = (value, digits, unit = "") => (value === null || value === undefined ? "–" : `${value.toFixed(digits)}${unit}`);

function legOf(leg) {
  if (traces.has(leg)) return traces.get(leg);
  const box = document.createElement("div");
  box.innerHTML = `<h2 data-text="${leg}"></h2><table><thead><tr><td></td>` +
    ["patient", "friction", "net", "drive", "validity"].map((key) => `<th scope="col" data-text="${key}"></th>`).join("") +
    `</tr></thead><tbody><tr><th scope="row" data-text="torque"></th>${"<td></td>".repeat(5)}</tr>` +
    `<tr><th scope="row" data-text="force"></th>${"<td></td>".repeat(5)}</tr></tbody></table>` +
    '<p class="legend"><span class="patient" data-text="patient"></span><span class="friction" data-text="friction"></span><span class="net" data-text="net"></span></p><div class="plots"></div>';
  byId("legs").append(box);
  const rows = [...box.querySelectorAll("tbody tr")].map((row) => [...row.querySelectorAll("td")]);
  traces.set(leg, { rows, hip: new Trace(box.querySelector(".plots"), "N·m"), slide: new Trace(box.querySelector(".plots"), "N"), newest: null });
  words.use(words.language);
  return traces.get(leg);
}

function paintAxis(cells, axis, digits) {
  const texts = [number(axis.patient, digits), number(axis.friction, digits), number(axis.net, digits), plain(axis.effort, digits), axis.validity ?? "–"];
  texts.forEach((text, index) => {
    setText(cells[index], text);
    cells[index].classList.toggle("invalid", text === "–");
  });
}

function paintItems() {
  if (!itemsAreNew) return;
  itemsAreNew = false;
  const cell = (text) => Object.assign(document.createElement("td"), { textContent: text });
  byId("strides").replaceChildren(...strides.slice(-30).reverse().map((stride) => {
    const row = document.createElement("tr");
    row.append(cell(`${words.of(stride.leg)} ${stride.number}`), cell(plain(share(stride.share_ratio), 0, " %")),
      cell(number({ value: stride.work_j, std: stride.work_j_std }, 1)), cell(plain(stride.cadence_hz, 2)));
    return row;
  }));
  byId("events").replaceChildren(...events.slice().reverse().map((event) =>
    Object.assign(document.createElement("li"), { textContent: `${new Date(event.time_ms).toLocaleTimeString(words.language)} · ${event.priority} · ${event.text}${event.remedy ? ` — ${event.remedy}` : ""}` })));
  trend.setData([strides.map((_, index) => index + 1), strides.map((stride) => share(stride.share_ratio)), strides.map((stride) => stride.work_j)]);
}

function paintHealth(health) {
  const rows = health === null ? [["–", "–"]] : [
    ["CAN", `${health.bus ?? "–"}, ${plain(share(health.bus_load_ratio), 0, " %")}`],
    ["SYNC, max", plain(health.lateness_max_us === null ? null : health.lateness_max_us / 1000, 2, " ms")],
    ["overrun", plain(health.overrun_count, 0)],
    ["missed", plain(health.missed_count, 0)],
  ];
  const text = JSON.stringify(rows);
  if (byId("health").dataset.shown === text) return;
  byId("health").dataset.shown = text;
  byId("health").replaceChildren(...rows.map(([name, value]) => {
    const row = document.createElement("tr");
    row.append(Object.assign(document.createElement("th"), { scope: "row", textContent: name }), Object.assign(document.createElement("td"), { textContent: value }));
    return row;
  }));
}

const assistText = (value, unit) => (value === null ? "–" : `${value} ${unit}`);
const limitsText = (limits) => `${limits.cadence_max_hz} /s, ${limits.amplitude_max_ratio}, ${limits.duration_max_s} s, ${assistText(limits.hip_assist_max_nm, "N·m")}, ${assistText(limits.slide_assist_max_n, "N")}`;

const dayText = (timeS) => new Date(timeS * 1000).toLocaleDateString(words.language, { day: "numeric", month: "numeric" });

// Profile, plan and history: read again now and then, because a session writes them.
const shares = new uPlot({
  width: 300, height: 190, legend: { show: false }, cursor: { show: false },
  axes: [{ ...axes("")[0], incrs: [1, 2, 7, 14, 28, 91, 364].map((days) => days * DAY_S), values: (_, ticks) => ticks.map(dayText) }, axes("%")[1]],
  scales: { x: { range: (_, low, high) => [(low ?? 0) - DAY_S / 2, (high ?? DAY_S) + DAY_S / 2] }, y: { range: [0, 100] } },
  series: [{}, { stroke: "#0072b2", width: 2, points: { show: true, size: 9, fill: "#0072b2" }, spanGaps: false }],
}, [[], []], byId("shares"));
let progress = null;

function paintProgress() {
  if (progress === null) return;
  const row = (texts) => {
    const made = document.createElement("tr");
    made.append(...texts.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
    return made;
  };
  const { profile, sessions, troubles } = progress;
  byId("progresstroubles").replaceChildren(...troubles.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
  byId("progressbox").hidden = !progress.is_configured;
  byId("blocks").hidden = byId("releaseprofile").hidden = profile === null;
  if (profile === null) {
    setText(byId("profile"), progress.is_configured ? "–" : words.of("no_profile"));
    setText(byId("profilelimits"), "");
  } else {
    setText(byId("profile"), `${profile.id} · ${profile.legs.map((leg) => words.of(leg)).join(", ")} · ${words.of("share_bounds")}: ${share(profile.share_min_ratio).toFixed(0)} – ${share(profile.share_max_ratio).toFixed(0)} %`);
    byId("blockrows").replaceChildren(...profile.blocks.map((block) => row([words.of(`block.${block.kind}`), plain(block.duration_s, 0), plain(block.cadence_hz, 2), plain(block.amplitude_ratio, 2), plain(block.rest_s, 0)])));
    setText(byId("profilelimits"), limitsText(profile.limits));
  }
  byId("sessions").replaceChildren(...sessions.slice().reverse().map((one) => row([
    new Date(one.begun_ms).toLocaleString(words.language, { dateStyle: "short", timeStyle: "short" }), plain(one.walked_s / 60, 1), plain(one.stride_count, 0),
    plain(one.valid_count, 0), plain(share(one.mean_share_ratio), 0, " %"), [plain(one.interruption_count, 0), one.last_interruption].filter(Boolean).join(": "), words.of(`end.${one.end}`)])));
  shares.setData([sessions.map((one) => one.begun_ms / 1000), sessions.map((one) => share(one.mean_share_ratio))]);
}

async function readProgress() {
  const answer = await fetch("/progress.json").catch(() => null); // the loss is shown already
  if (answer?.ok) progress = await answer.json();
  paintProgress();
  setTimeout(readProgress, PROGRESS_MS);
}

let plottedMs = 0;
let seen = null;
function paint() {
  requestAnimationFrame(paint);
  const view = live.frame;
  const lost = live.loss();
  const loss = lost || (view.is_silent ? "no_signal" : "");
  byId("loss").hidden = loss === "";
  byId("loss").classList.toggle("silent", loss === "no_signal");
  if (loss) setText(byId("loss"), `${words.of(loss)}. ${words.of(`line.${loss}`)}`);
  if (!view) return;
  byId("quiet").hidden = !alarm.isSounding();
  setText(byId("state"), loss ? words.of(loss) : [`${words.of("mode")}: ${view.mode}`, view.progress, view.lease_holder].filter(Boolean).join(" · "));
  const verdict = loss ? null : view.verdict;
  byId("verdict").hidden = verdict === null;
  if (verdict) {
    setText(byId("cause"), `${verdict.category} · ${verdict.cause} · ${verdict.text}`);
    setText(byId("remedy"), verdict.remedy);
  }
  for (const leg of view.legs) {
    const shown = legOf(leg.leg);
    const unknown = { patient: { value: null }, friction: { value: null }, net: { value: null }, effort: null, validity: null };
    paintAxis(shown.rows[0], loss ? unknown : leg.hip, 2);
    paintAxis(shown.rows[1], loss ? unknown : leg.slide, 1);
    if (view !== seen && leg.sample_time_ms !== null && leg.sample_time_ms !== shown.newest) {
      if (shown.newest !== null && leg.sample_time_ms < shown.newest) for (const trace of [shown.hip, shown.slide]) trace.rows.forEach((column) => { column.length = 0; });
      shown.newest = leg.sample_time_ms;
      const timeS = (leg.sample_time_ms % 86400000) / 1000;
      shown.hip.add(timeS, leg.hip);
      shown.slide.add(timeS, leg.slide);
    }
  }
  seen = view;
  const plan = loss ? { state: "unknown" } : view.plan;
  setText(byId("plannow"), { unknown: "–", none: words.of("no_plan"), released: plan.limits ? limitsText(plan.limits) : "" }[plan.state]);
  paintHealth(loss ? null : view.health);
  const now = performance.now();
  if (now - plottedMs >= PLOT_MS) {
    plottedMs = now;
    paintItems();
    for (const shown of traces.values()) { shown.hip.draw(); shown.slide.draw(); }
    for (const [plot, box] of [[trend, byId("trend")], [shares, byId("shares")]]) {
      if (plot.width !== box.clientWidth) plot.setSize({ width: box.clientWidth, height: 190 });
    }
  }
  painted.frames += 1;
}

const tell = (text) => setText(byId("answer"), text);
const told = (answer) => tell(answer.outcome === "done" ? words.of("done") : answer.outcome === "refused" ? `${words.of("refused")}: ${answer.reason}` : words.of("no_answer"));

for (const command of COMMANDS) {
  const button = Object.assign(document.createElement("button"), { type: "button" });
  button.dataset.text = command;
  button.addEventListener("click", async () => told(await request("/act", { command })));
  byId("requests").append(button);
}
words.use(words.language);
const cap = (id) => (byId(id).value === "" ? null : Number(byId(id).value));
byId("plan").addEventListener("submit", async (event) => {
  event.preventDefault();
  const plan = { cadence_max_hz: Number(byId("cadence").value), amplitude_max_ratio: Number(byId("amplitude").value), duration_max_s: Number(byId("duration").value), hip_assist_max_nm: cap("hipassist"), slide_assist_max_n: cap("slideassist") };
  told(await request("/plan", { plan }));
});
byId("releaseprofile").addEventListener("click", async () => told(await request("/plan", { plan: progress.profile.limits })));
byId("withdraw").addEventListener("click", async () => told(await request("/plan", { plan: null })));
byId("language").addEventListener("click", () => { words.toggle(); itemsAreNew = true; paintProgress(); });
byId("quiet").addEventListener("click", () => alarm.acknowledge());
byId("logout").addEventListener("click", async () => { await request("/logout", {}); location.reload(); });
for (const [box, key] of [["stridebox", "stride_table"], ["eventbox", "events"], ["sessionbox", "progress"]]) byId(box).setAttribute("aria-label", words.of(key));
paint();
readProgress();
