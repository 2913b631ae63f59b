// The mechanism with all that is measured and estimated of it: angle, position, efforts, and the way of the joints.
import { el, Mechanism, n, set } from "./figure.js";

const DEGREES = 180 / Math.PI;
const TORQUE_RAD_PER_NM = 0.16; // length of an arrow
const FORCE_M_PER_N = 0.0055;
const FRICTION_M_PER_N = 0.0022;
const TORQUE_MAX_RAD = 2.2;
const FORCE_MAX_M = 0.42;
const FULL_GLOW_W = 60;
const HEAD = 11;
const TICK_M = 0.1;

export const sign = (value, places) => `${Number(value.toFixed(places)) < 0 ? "−" : ""}${Math.abs(value).toFixed(places)}`;

export class EngineerFigure {
  constructor(svg, geometry, legs) {
    this.svg = svg;
    this.geometry = geometry;
    this.legs = legs;
    this.machine = new Mechanism(svg, geometry, legs);
    this.layout();
  }

  at(point) {
    return this.machine.at(point);
  }

  text(point, words, className, anchor = "start") {
    return el("text", { x: n(point[0]), y: n(point[1]), class: className, "text-anchor": anchor }, this.front, words);
  }

  layout() {
    const { svg, geometry } = this;
    this.machine.layout(svg.clientWidth, svg.clientHeight);
    for (const { g } of this.machine.parts.values()) g.classList.add("moves");
    this.front = el("g", {}, svg);
    this.down = geometry.recline_rad - Math.PI / 2;
    const ray = (r) => this.at([r * Math.cos(this.down), r * Math.sin(this.down)]);
    const [to, from] = [ray(0.44), ray(-0.52)];
    el("line", { x1: n(from[0]), y1: n(from[1]), x2: n(to[0]), y2: n(to[1]), class: "ref" }, this.front);
    this.ruler();
    this.scaleBar();
    const group = el("g", { class: "moves" }, this.front);
    this.trails = ["knee", "ankle"].map(() => el("path", { class: "trail" }, group));
    this.arc = el("path", { class: "arc" }, group);
    this.arrows = {};
    for (const [name, kind] of [["friction", "rub"], ["patient", ""], ["true", "true"]]) {
      for (const axis of ["hip", "slide"]) {
        const head = kind === "true" ? null : el("path", { class: `head ${kind}` }, group);
        this.arrows[`${axis}_${name}`] = { shaft: el("path", { class: `effort ${kind}` }, group), head };
      }
    }
    const phi = this.at([0.4 * Math.cos(this.down - 0.42), 0.4 * Math.sin(this.down - 0.42)]);
    const foot = this.at([this.machine.rail(geometry.slide_min_m)[0], this.machine.floor]);
    this.values = this.legs.map((_, index) => [
      this.text([phi[0] - 78, phi[1] + 8 + 20 * index], "", "over value"),
      this.text([foot[0], foot[1] + 26 + 20 * index], "", "over value", "middle"),
    ]);
    this.names = ["thigh", "shank"].map((name) => el("text", { class: "over", "text-anchor": "middle" }, group, name));
  }

  normal() {
    const { rail_angle_rad: angle } = this.geometry;
    return [Math.sin(angle), -Math.cos(angle)];
  }

  beside(s, across) {
    const [p, normal] = [this.machine.rail(s), this.normal()];
    return this.at([p[0] + across * normal[0], p[1] + across * normal[1]]);
  }

  ruler() {
    const { slide_min_m: low, slide_max_m: high } = this.geometry;
    for (let tick = Math.ceil(low / TICK_M - 1e-6); tick * TICK_M <= high + 1e-6; tick += 1) {
      const s = tick * TICK_M;
      const isLong = tick % 5 === 0;
      const [a, b] = [this.beside(s, 0.045), this.beside(s, isLong ? 0.095 : 0.07)];
      el("line", { x1: n(a[0]), y1: n(a[1]), x2: n(b[0]), y2: n(b[1]), class: "tick" }, this.front);
      const [x, y] = this.beside(s, 0.115);
      if (isLong) this.text([x, y + 5], tick === 0 ? "0" : s.toFixed(1), "over small");
    }
  }

  scaleBar() {
    const y = this.machine.floor + 0.11;
    const [[x0, y0], [x1]] = [this.at([-0.89, y]), this.at([-0.39, y])];
    el("path", { d: `M${n(x0)} ${n(y0 - 5)}v10M${n(x0)} ${n(y0)}H${n(x1)}M${n(x1)} ${n(y0 - 5)}v10`, class: "scalebar" }, this.front);
    this.text([(x0 + x1) / 2, y0 - 10], "0.5 m", "over small", "middle");
  }

  // rows: of each leg now, null where it is not known; powers in W; past: rows of the first leg of the last seconds.
  draw(rows, powers, past) {
    const known = rows.map((row) => row !== null && row.hip_angle_rad !== null && row.slide_position_m !== null);
    this.svg.classList.toggle("unknown-pose", !known[0]);
    const poses = rows.map((row, index) => {
      this.machine.parts.get(this.legs[index]).g.classList.toggle("absent", !known[index]);
      this.write(index, known[index] ? row : null);
      if (!known[index]) return null;
      const glow = 0.75 * Math.max(0, Math.min(1, (powers[index] ?? 0) / FULL_GLOW_W));
      return this.machine.draw(this.legs[index], row.hip_angle_rad, row.slide_position_m, glow);
    });
    if (poses[0] !== null) this.drawNear(rows[0], poses[0], past);
    return known.every(Boolean);
  }

  write(index, row) {
    const side = this.legs.length > 1 ? ` ${this.legs[index]}` : "";
    const [phi, s] = this.values[index];
    phi.textContent = `φ${side} ${row === null ? "–" : `${sign(row.hip_angle_rad * DEGREES, 1)}°`}`;
    s.textContent = `s${side} ${row === null ? "–" : `${sign(row.slide_position_m, 3)} m`}`;
  }

  drawNear(row, pose, past) {
    const { machine, down } = this;
    const [cx, cy] = this.at([0, 0]);
    const r = 0.31 * machine.scale;
    const rim = (a) => `${n(cx + r * Math.cos(a))} ${n(cy - r * Math.sin(a))}`;
    const turn = row.hip_angle_rad + this.geometry.thigh_offset_rad;
    this.arc.setAttribute("d", `M${rim(down)}A${n(r)} ${n(r)} 0 0 ${turn > 0 ? 0 : 1} ${rim(down + turn)}`);
    for (const [index, name] of ["knee", "ankle"].entries()) {
      const way = past.map((one) => this.at(machine.pose(one.hip_angle_rad, one.slide_position_m)[name]).map(n).join(" "));
      this.trails[index].setAttribute("d", way.length > 1 ? `M${way.join("L")}` : "");
    }
    this.torque("hip_patient", row.hip_patient_nm, 0.215);
    this.torque("hip_true", row.hip_true_nm, 0.215);
    this.torque("hip_friction", row.hip_friction_nm === null ? null : -row.hip_friction_nm, 0.265);
    const s = row.slide_position_m;
    this.force("slide_patient", row.slide_patient_n, s, 0.205, FORCE_M_PER_N);
    this.force("slide_true", row.slide_true_n, s, 0.205, FORCE_M_PER_N);
    this.force("slide_friction", row.slide_friction_n === null ? null : -row.slide_friction_n, s, 0.26, FRICTION_M_PER_N);
    this.link(0, pose.hip, pose.knee, 0.72, 0.135);
    this.link(1, pose.knee, pose.ankle, 0.5, 0.12);
  }

  link(index, a, b, k, side) {
    const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
    const length = Math.hypot(dx, dy);
    const [x, y] = this.at([a[0] + k * dx - side * dy / length, a[1] + k * dy + side * dx / length]);
    set(this.names[index], { x: n(x), y: n(y + 4) });
  }

  // A torque about the hip: an arc whose length is the size; null: not known, no arrow.
  torque(name, value, radius) {
    const [cx, cy] = this.at([0, 0]);
    const from = Math.PI * 0.56;
    const turn = Math.max(-TORQUE_MAX_RAD, Math.min(TORQUE_MAX_RAD, (value ?? 0) * TORQUE_RAD_PER_NM));
    const r = radius * this.machine.scale;
    const to = from + turn;
    const rim = (a) => `${n(cx + r * Math.cos(a))} ${n(cy - r * Math.sin(a))}`;
    const d = `M${rim(from)}A${n(r)} ${n(r)} 0 0 ${turn > 0 ? 0 : 1} ${rim(to)}`;
    const end = [cx + r * Math.cos(to), cy - r * Math.sin(to)];
    this.arrow(name, Math.abs(turn) > 0.06 ? d : "", end, -(to + Math.PI / 2 * Math.sign(turn)));
  }

  // A force along the rail, beside it.
  force(name, value, s, across, scale) {
    const { rail_angle_rad: angle } = this.geometry;
    const from = this.beside(s, across);
    const length = Math.max(-FORCE_MAX_M, Math.min(FORCE_MAX_M, (value ?? 0) * scale)) * this.machine.scale;
    const to = [from[0] + length * Math.cos(angle), from[1] - length * Math.sin(angle)];
    const d = `M${from.map(n).join(" ")}L${to.map(n).join(" ")}`;
    this.arrow(name, Math.abs(length) > 6 ? d : "", to, -angle + (length < 0 ? Math.PI : 0));
  }

  arrow(name, d, [x, y], angle) {
    const { shaft, head } = this.arrows[name];
    shaft.setAttribute("d", d);
    if (head === null) return;
    const turned = ([a, b]) => `${n(x + a * Math.cos(angle) - b * Math.sin(angle))} ${n(y + a * Math.sin(angle) + b * Math.cos(angle))}`;
    const corners = [[HEAD, 0], [-HEAD * 0.75, HEAD * 0.8], [-HEAD * 0.75, -HEAD * 0.8]];
    head.setAttribute("d", d === "" ? "" : `M${corners.map(turned).join("L")}Z`);
  }
}
