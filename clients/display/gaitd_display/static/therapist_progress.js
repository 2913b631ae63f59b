// Progress over the sessions: mean share with its target, and a table.
import { byId, setText } from "./common.js";
import { el, n, set } from "./figure.js";
import { clock, day, digits, made, Once, percent } from "./therapist_parts.js";

const NEWEST = 6;
const DAY_MS = 86_400_000;

export class ProgressPanel {
  constructor(words) {
    Object.assign(this, { words, progress: null, isWhole: false });
    this.shown = new Once(() => this.paintAll());
    byId("all").addEventListener("click", () => {
      this.isWhole = !this.isWhole;
      this.shown.again();
      this.paint(this.progress);
    });
  }

  paint(progress) {
    if (progress === null) return;
    this.progress = progress;
    const { clientWidth: width, clientHeight: height } = byId("chart");
    this.shown.show([progress, width, height], this.words.language);
  }

  paintAll() {
    const { is_configured: isConfigured, sessions, troubles } = this.progress;
    byId("troubles").replaceChildren(...troubles.map((text) => made("li", "", this.words.said(text))));
    const why = isConfigured ? (troubles.length ? "" : "no_session") : "no_profile";
    byId("noprogress").hidden = sessions.length > 0 || why === "";
    setText(byId("noprogress"), why === "" ? "" : this.words.of(why));
    byId("history").hidden = sessions.length === 0;
    if (sessions.length === 0) return;
    this.paintTable(sessions);
    this.paintChart(sessions);
  }

  paintTable(sessions) {
    const { language } = this.words;
    const newest = [...sessions].reverse().slice(0, this.isWhole ? sessions.length : NEWEST);
    byId("sessions").replaceChildren(...newest.flatMap((one) => {
      const cells = [
        day(one.begun_ms, language), digits(one.walked_s / 60, language, 0), `${one.reached_count} / ${one.valid_count}`,
        percent(one.mean_share_ratio, language), String(one.interruption_count), this.words.of(`end.${one.end}`),
      ];
      const row = made("tr", "", ...cells.map((text) => made("td", text === "–" ? "unknown" : "", made("span", "", text))));
      return one.stops.length + one.marks.length === 0 ? [row] : [row, made("tr", "why", Object.assign(made("td", "", this.stops(one)), { colSpan: 6 }))];
    }));
    byId("all").hidden = sessions.length <= NEWEST;
    byId("all").setAttribute("aria-expanded", this.isWhole);
    setText(byId("all"), this.isWhole ? this.words.of("fewer_sessions") : this.words.of("all_sessions", { count: sessions.length }));
  }

  // Stops and marks, the newest first.
  stops({ stops, marks }) {
    const texts = [
      ...stops.map((stop) => ({ ...stop, text: this.words.said(stop.said) })),
      ...marks.map((mark) => ({ ...mark, text: this.words.of("mark_said", { text: mark.text }), remedy: null })),
    ].sort((one, other) => other.time_ms - one.time_ms);
    return made("ul", "", ...texts.map(({ time_ms: time, text, remedy }) => {
      const item = made("li", "", `${clock(time, this.words.language)} `, text);
      if (remedy !== null) item.append(this.remedy(remedy));
      return item;
    }));
  }

  // The text is there while it is open only: what is hidden must not take a place.
  remedy(remedy) {
    const text = made("p", "", this.words.said(remedy));
    const opened = made("details", "", made("summary", "", this.words.of("what_to_do")));
    opened.addEventListener("toggle", () => (opened.open ? opened.append(text) : text.remove()));
    return opened;
  }

  paintChart(sessions) {
    const svg = byId("chart");
    const { language } = this.words;
    const { clientWidth: width, clientHeight: height } = svg;
    svg.replaceChildren();
    set(svg, { viewBox: `0 0 ${width} ${height}` });
    const [left, top, bottom] = [34, 26, height - 22];
    const first = sessions[0].begun_ms;
    const span = Math.max(DAY_MS, sessions.at(-1).begun_ms - first);
    const x = (time_ms) => left + 12 + ((time_ms - first) / span) * (width - left - 26);
    const most = Math.max(...sessions.flatMap((one) => [one.mean_share_ratio ?? 0, one.target?.high_ratio ?? 0]));
    const full = most > 0.5 ? 1 : 0.5;
    const y = (share) => bottom - (Math.max(0, share) / full) * (bottom - top);
    // Where a session has no target, or no share, there is a gap.
    for (const run of runs(sessions, ({ target }) => target !== null)) {
      const edge = (name) => run.map((one) => [x(one.begun_ms), y(one.target[name])]);
      const [high, low] = [edge("high_ratio"), edge("low_ratio")];
      if (run.length === 1) for (const one of [high, low]) one.unshift([one[0][0] - 6, one[0][1]], [one[0][0] + 6, one[0][1]]);
      el("path", { d: `M${points(high)}L${points(low.reverse())}Z`, class: "band" }, svg);
    }
    for (const tick of [0, full / 2, full]) {
      el("line", { x1: left, x2: width, y1: n(y(tick)), y2: n(y(tick)), class: "grid" }, svg);
      el("text", { x: left - 6, y: n(y(tick) + 4.5), "text-anchor": "end" }, svg, String(100 * tick));
    }
    for (const run of runs(sessions, (one) => one.mean_share_ratio !== null)) {
      el("path", { d: `M${points(run.map((one) => [x(one.begun_ms), y(one.mean_share_ratio)]))}`, class: "shares" }, svg);
      for (const one of run) el("circle", { cx: n(x(one.begun_ms)), cy: n(y(one.mean_share_ratio)), r: 4.5, class: "dot" }, svg);
    }
    const title = this.words.of("mean_share");
    el("text", { x: left, y: 14 }, svg, title);
    el("text", { x: left, y: height - 4 }, svg, day(first, language));
    if (sessions.length > 1) el("text", { x: width - 2, y: height - 4, "text-anchor": "end" }, svg, day(sessions.at(-1).begun_ms, language));
    set(svg, { "aria-label": `${title}: ${sessions.map((one) => percent(one.mean_share_ratio, language)).join(", ")}` });
  }
}

const points = (list) => list.map(([x, y]) => `${n(x)} ${n(y)}`).join("L");

function runs(list, isKnown) {
  const made = [[]];
  for (const one of list) {
    if (isKnown(one)) made.at(-1).push(one);
    else if (made.at(-1).length) made.push([]);
  }
  return made.filter((run) => run.length);
}
