// Release of a plan. No field is filled in before the therapist fills it; help may be left as configured only where that is ticked.
import { byId, setText } from "./common.js";
import { digits, made, Once, paintIcon, percent } from "./therapist_parts.js";

const S_PER_MIN = 60;
const NAMED_MAX = 2; // empty fields that are named beside Release
// scale: of the page's unit, in units of the message; axis: whose assist it caps; ticked: the field may be left as configured.
const FIELDS = [
  { name: "cadence_max_hz", scale: 1, places: 2 },
  { name: "amplitude_max_ratio", scale: 0.01, places: 0 },
  { name: "duration_max_s", scale: S_PER_MIN, places: 2 },
  { name: "hip_assist_max", axis: "hip", scale: 1, places: 1, unit: "N·m", ticked: "as_configured_hip" },
  { name: "slide_assist_max", axis: "slide", scale: 1, places: 0, unit: "N", ticked: "as_configured_slide" },
];
const limitIn = (plan, { name, axis }) => (axis ? plan[axis].assist_max : plan[name]);
const PLAN_ICONS = { released: "ok", none: "rest", unknown: "lost" };

export class PlanForm {
  // request: sends a plan, or null, and tells its outcome.
  constructor(words, request) {
    Object.assign(this, { words, request, ranges: {}, profile: null });
    this.fields = FIELDS.map((field) => this.field(field));
    for (const { parts } of this.fields) byId("plan").lastElementChild.before(...parts);
    this.released = new Once((plan) => this.paintReleased(plan));
    this.allowed = new Once((ranges) => this.paintRanges(ranges));
    this.offered = new Once((profile) => this.paintProfile(profile));
    byId("plan").addEventListener("input", () => this.judge());
    byId("plan").addEventListener("submit", (event) => {
      event.preventDefault();
      this.release();
    });
    byId("releaseprofile").addEventListener("click", () => this.request(this.profile.limits));
    byId("withdraw").addEventListener("click", () => this.request(null));
    words.use(words.language);
  }

  field(field) {
    const input = Object.assign(made("input"), { type: "text", inputMode: "decimal", autocomplete: "off", id: `f-${field.name}` });
    const label = Object.assign(made("label"), { htmlFor: input.id });
    label.dataset.text = `limit.${field.name}`;
    const now = made("b");
    const parts = [label, now, input];
    let tick = null;
    if (field.ticked) {
      tick = Object.assign(made("input"), { type: "checkbox", id: `t-${field.name}` });
      const said = made("span");
      said.dataset.text = field.ticked;
      parts.push(made("label", "tick", tick, said));
      tick.addEventListener("change", () => {
        input.disabled = tick.checked;
        if (tick.checked) input.value = "";
        this.judge();
      });
    }
    return { ...field, input, now, tick, parts };
  }

  range({ name, scale, places }) {
    const { value_low: low, value_high: high, has_low: hasLow } = this.ranges[name];
    // The least that the field can say where its lower end itself is not allowed.
    return [hasLow ? low / scale : Math.max(low / scale, 10 ** -places), high / scale];
  }

  // The value in the unit of the message; NaN: none that is allowed.
  value(field) {
    if (field.tick?.checked) return null;
    const typed = field.input.value.trim().replace(",", ".");
    const [low, high] = this.range(field);
    const value = /^\d+(\.\d*)?$|^\.\d+$/.test(typed) ? Number(typed) : NaN;
    return value >= low && value <= high ? Number((value * field.scale).toPrecision(12)) : NaN;
  }

  judge() {
    const label = (field) => this.words.of(`limit.${field.name}`).split(",")[0];
    const empty = this.fields.filter((field) => !field.tick?.checked && field.input.value.trim() === "");
    const wrong = this.fields.find((field) => !empty.includes(field) && Number.isNaN(this.value(field)));
    for (const field of this.fields) field.input.setAttribute("aria-invalid", field === wrong);
    byId("release").disabled = empty.length > 0 || wrong !== undefined;
    let why = "";
    if (wrong !== undefined) {
      const [low, high] = this.range(wrong).map((value) => this.number(value, wrong.places));
      why = this.words.of("not_allowed", { field: label(wrong), low, high });
    } else if (empty.length > NAMED_MAX) why = this.words.of("fill_others");
    else if (empty.length > 0) why = this.words.of("fill_first", { fields: empty.map(label).join(", ") });
    setText(byId("why"), why);
  }

  async release() {
    const values = this.fields.map((field) => this.value(field));
    if (values.some(Number.isNaN)) return;
    const plan = Object.fromEntries(this.fields.map(({ name, axis }, at) => (axis ? [axis, { assist_max: values[at] }] : [name, values[at]])));
    if (!(await this.request(plan))) return;
    for (const { input, tick } of this.fields) {
      input.value = "";
      input.disabled = false;
      if (tick) tick.checked = false;
    }
    this.judge();
  }

  number(value, places) {
    return digits(value, this.words.language, places, 0);
  }

  paint(view, plan, profile) {
    this.allowed.show(view.ranges, this.words.language);
    this.released.show(plan, this.words.language);
    this.offered.show(profile, this.words.language);
  }

  paintRanges(ranges) {
    this.ranges = ranges;
    for (const field of this.fields) {
      const [low, high] = this.range(field).map((value) => this.number(value, field.places));
      field.input.placeholder = `${low}–${high}`;
    }
    this.judge();
  }

  paintReleased({ state, limits }) {
    paintIcon(byId("released").firstElementChild, PLAN_ICONS[state]);
    byId("released").dataset.state = state;
    setText(byId("planstate"), this.words.of(`plan.${state}`));
    setText(byId("planfor"), this.words.of(`plan.${state}_for`));
    byId("withdraw").hidden = limits === null;
    for (const field of this.fields) {
      const { scale, places, now } = field;
      const value = limits === null ? null : limitIn(limits, field);
      const isAsConfigured = limits !== null && value === null;
      setText(now, isAsConfigured ? this.words.of("as_configured") : value === null ? "–" : this.number(value / scale, places));
    }
  }

  paintProfile(profile) {
    this.profile = profile;
    byId("releaseprofile").hidden = byId("parts").hidden = profile === null;
    if (profile === null) return;
    const { language } = this.words;
    const [cadence, amplitude, duration, hip, slide] = this.fields.map((field) => {
      const { scale, places, unit = "" } = field;
      const value = limitIn(profile.limits, field);
      return value === null ? this.words.of("as_configured") : `${this.number(value / scale, places)}\u00a0${unit}`.trim();
    });
    setText(byId("profilesaid"), this.words.of("plan_said", { cadence, amplitude, duration, hip, slide }));
    const bounds = { low: digits(100 * profile.share_min_ratio, language, 0), high: digits(100 * profile.share_max_ratio, language, 0) };
    setText(byId("bounds"), this.words.of("share_bounds", bounds));
    byId("partrows").replaceChildren(...profile.blocks.map((block) => made("tr", "", ...[
      this.words.of(`block.${block.kind}`), this.number(block.duration_s / S_PER_MIN, 1), digits(block.cadence_hz, language, 2),
      percent(block.amplitude_ratio, language).replace(" %", ""), this.number(block.rest_s / S_PER_MIN, 1),
    ].map((text) => made("td", "", text)))));
  }
}
