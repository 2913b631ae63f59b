// The training profile as a form. The server has all rules; here numbers are read in the page's units, and what is wrong is told in the reader's words.
import { byId, post, setText } from "./common.js";
import { digits, made } from "./therapist_parts.js";

const PERCENT = 0.01;
const PLACES = 6;
// key: of the profile; scale: of the page's unit, in units of the profile.
const GROUPS = [
  ["profile_range", [["range.cadence_min_hz", 1], ["range.cadence_max_hz", 1], ["range.amplitude_min_ratio", PERCENT], ["range.amplitude_max_ratio", PERCENT]]],
  ["profile_assist", [["assist.hip.max_nm", 1], ["assist.slide.max_n", 1]]],
  ["profile_goal", ["share_min", "share_max", "share_start", "band_width", "challenge", "step_max", "in_band_goal"].map((name) => [`goal.${name}_ratio`, PERCENT])],
];
const COLUMNS = [["duration_s", 1], ["cadence_hz", 1], ["amplitude_ratio", PERCENT], ["rest_s", 1]];

export class ProfileForm {
  // csrf: of the login; onSaved: reads the profile of the page again.
  constructor(words, csrf, onSaved) {
    Object.assign(this, { words, csrf, onSaved, read: null, inputs: new Map(), told: () => "" });
    this.form = byId("profile");
    byId("editprofile").addEventListener("click", () => this.toggle());
    byId("profilediscard").addEventListener("click", () => this.load());
    byId("addpart").addEventListener("click", () => this.add());
    byId("haspassive").addEventListener("change", () => this.build(this.values()));
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.save();
    });
  }

  toggle() {
    this.form.hidden = !this.form.hidden; // what is hidden takes no place; what was typed stays
    byId("editprofile").setAttribute("aria-expanded", !this.form.hidden);
    if (!this.form.hidden && this.read === null) this.load();
  }

  async load() {
    const signal = AbortSignal.timeout(12000);
    const read = await fetch("/profile.json", { signal }).then((answer) => answer.json()).catch(() => ({ outcome: "no_answer" }));
    if ("outcome" in read) {
      this.tell(() => (read.said ? this.words.said(read.said) : this.words.of("no_answer")));
      return;
    }
    this.read = read;
    byId("haspassive").checked = read.values.plan.passive !== null;
    this.build(read.values);
    this.tell(() => "");
  }

  // The form of these values, as those of the profile; a null is an empty field.
  build(values) {
    this.inputs.clear();
    const at = (key) => key.split(".").reduce((part, name) => part[name], values);
    byId("profilefields").replaceChildren(...GROUPS.flatMap(([name, fields]) => [
      made("div", "fields", made("h3", "", this.named(made("span"), name)), ...fields.flatMap(([key, scale]) => {
        const input = this.input(key, scale, at(key));
        const label = Object.assign(made("label", "", this.named(made("span"), `profile.${key}`), " ", this.range(key, scale)), { htmlFor: input.id });
        return [label, input];
      })),
    ]));
    const { passive, warm_up: warmUp, block } = values.plan;
    const first = passive ?? { ...warmUp, duration_s: null, rest_s: 0 };
    const rows = [...(byId("haspassive").checked ? [["plan.passive", first]] : []), ["plan.warm_up", warmUp], ...block.map((walk, index) => [`plan.block[${index}]`, walk])];
    byId("profileranges").replaceChildren(made("td"), ...COLUMNS.map(([name, scale]) => made("td", "", this.range(`plan.block.${name}`, scale))), made("td"));
    byId("profileparts").replaceChildren(...rows.map(([key, walk]) => this.row(key, walk, block.length)));
    byId("addpart").disabled = block.length >= this.read.blocks_max;
    this.relabel();
  }

  row(key, walk, count) {
    const index = /\[(\d+)\]/.exec(key)?.[1];
    const cells = COLUMNS.map(([name, scale]) => made("td", "", this.input(`${key}.${name}`, scale, walk[name])));
    const last = made("td");
    if (index !== undefined && count > 1) {
      const remove = Object.assign(made("button", "", "\u00d7"), { type: "button" });
      remove.dataset.part = index;
      remove.addEventListener("click", () => this.remove(Number(index)));
      last.append(remove);
    }
    const head = Object.assign(made("th"), { scope: "row" });
    head.dataset.part = key;
    return made("tr", "", head, ...cells, last);
  }

  input(key, scale, value) {
    const input = Object.assign(made("input"), { type: "text", inputMode: "decimal", autocomplete: "off", id: `p-${key}` });
    input.value = value === null ? "" : digits(value / scale, this.words.language, PLACES, 0);
    this.inputs.set(key, { input, scale });
    return input;
  }

  named(element, text) {
    element.dataset.text = text;
    return element;
  }

  range(key, scale) {
    const { value_low: low, value_high: high } = this.read.bounds[key];
    const text = made("small");
    text.dataset.low = low / scale;
    text.dataset.high = high / scale;
    return text;
  }

  number(value) {
    return digits(value, this.words.language, PLACES, 0);
  }

  // A name for the reader: of a field, or of a part and its column.
  name(key) {
    const [, part, column] = /^(plan\.\w+(?:\[\d+\])?)\.(\w+)$/.exec(key) ?? [];
    return part === undefined ? this.words.of(`profile.${key}`) : `${this.part(part)}, ${this.words.of(`profile_column.${column}`)}`;
  }

  part(key) {
    const index = /\[(\d+)\]/.exec(key)?.[1];
    return index === undefined ? this.words.of(`block.${key.replace("plan.", "")}`) : `${this.words.of("block")} ${Number(index) + 1}`;
  }

  relabel() {
    for (const one of this.form.querySelectorAll("small[data-low]")) setText(one, `${this.number(Number(one.dataset.low))}\u2013${this.number(Number(one.dataset.high))}`);
    for (const one of this.form.querySelectorAll("th[data-part]")) setText(one, this.part(one.dataset.part));
    for (const one of this.form.querySelectorAll("button[data-part]")) one.setAttribute("aria-label", this.words.of("part_remove", { part: Number(one.dataset.part) + 1 }));
    for (const [key, { input }] of this.inputs) if (key.startsWith("plan.")) input.setAttribute("aria-label", this.name(key));
    for (const one of this.form.querySelectorAll("[data-text]")) setText(one, this.words.of(one.dataset.text));
    const mark = this.words.language === "de" ? "," : ".";
    for (const { input } of this.inputs.values()) input.value = input.value.replace(/[.,]/, mark);
    for (const one of this.form.querySelectorAll(".wrong")) setText(one, one.told());
    this.tell(this.told);
  }

  tell(told) {
    this.told = told;
    const texts = [told()].flat().filter(Boolean);
    byId("profilesays").replaceChildren(...texts.map((text) => made("li", "", text)));
  }

  // The values in units of the profile; null: what was typed is no number.
  values() {
    const found = structuredClone(this.read.values);
    const { plan } = found;
    plan.passive = byId("haspassive").checked ? {} : null;
    plan.block = [];
    for (const [key, { input, scale }] of this.inputs) {
      const typed = input.value.trim().replace(",", ".");
      const value = /^\d+(\.\d*)?$|^\.\d+$/.test(typed) ? Number((Number(typed) * scale).toPrecision(12)) : null;
      const [, index, column] = /^plan\.block\[(\d+)\]\.(\w+)$/.exec(key) ?? [];
      if (index !== undefined) (plan.block[index] ??= {})[column] = value;
      else if (!key.startsWith("plan.passive") || plan.passive !== null) {
        const names = key.split(".");
        names.slice(0, -1).reduce((part, name) => part[name], found)[names.at(-1)] = value;
      }
    }
    if (plan.passive !== null && !("duration_s" in plan.passive)) plan.passive = null; // just ticked
    return found;
  }

  add() {
    const values = this.values();
    values.plan.block.push({ ...values.plan.block.at(-1) });
    this.build(values);
    byId(`p-plan.block[${values.plan.block.length - 1}].duration_s`).focus();
  }

  remove(index) {
    const values = this.values();
    values.plan.block.splice(index, 1);
    this.build(values);
    byId("addpart").focus();
  }

  async save() {
    if (this.read === null) return;
    this.tell(() => this.words.of("asking"));
    for (const one of this.form.querySelectorAll(".wrong")) (one.closest("tr.why") ?? one).remove();
    for (const { input } of this.inputs.values()) {
      input.removeAttribute("aria-invalid");
      input.removeAttribute("aria-describedby");
    }
    const body = { sha256: this.read.sha256, values: this.values() };
    const answer = await post("/profile", body, 12000, { "X-CSRF-Token": this.csrf });
    if (answer.outcome === "done") {
      await this.load();
      this.tell(() => this.words.of("profile_saved"));
      this.onSaved();
    } else if (answer.wrong) {
      const [beside, other] = [answer.wrong.filter(({ key }) => this.inputs.has(key)), answer.wrong.filter(({ key }) => !this.inputs.has(key))];
      for (const one of beside) this.show(one);
      this.tell(() => [this.words.of("profile_not_saved", { count: answer.wrong.length }), ...other.map(({ key }) => this.words.of("profile_unusable", { field: key }))]);
      if (beside.length > 0) this.inputs.get(beside[0].key).input.focus();
    } else this.tell(() => (answer.said ? this.words.said(answer.said) : this.words.of("no_answer")));
  }

  // Says at its field, or below its part, what is wrong.
  show({ key, value, value_low: low, value_high: high }) {
    const { input, scale } = this.inputs.get(key);
    const typed = value === null ? input.value.trim() || "\u2013" : null;
    const told = () => {
      if (low === null) return this.words.of("profile_unusable", { field: this.name(key) });
      const [least, most] = [low, high].map((bound) => this.number(bound / scale));
      return this.words.of("profile_wrong", { field: this.name(key), value: typed ?? this.number(value / scale), low: least, high: most });
    };
    const text = Object.assign(made("p", "wrong", told()), { id: `w-${key}`, told });
    const row = input.closest("tr");
    if (row === null) input.after(text);
    else row.after(made("tr", "why", Object.assign(made("td", "", text), { colSpan: COLUMNS.length + 2 })));
    input.setAttribute("aria-invalid", true);
    input.setAttribute("aria-describedby", text.id);
  }
}
