// The picture of the mechanism, to scale: couch, person, thigh, shank, foot on its slide. Colours are in figure.css.

const NS = "http://www.w3.org/2000/svg";
const BESIDE_RAIL_M = 0.03; // of the rail, beyond the limits of the slide

export function el(tag, attributes = {}, parent = null, text = null) {
  const made = document.createElementNS(NS, tag);
  set(made, attributes);
  if (text !== null) made.textContent = text;
  if (parent) parent.append(made);
  return made;
}

export function set(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
}

export const n = (value) => value.toFixed(1);

// Two circles and their outer tangents: a limb.
function limbPath([x0, y0], r0, [x1, y1], r1) {
  const angle = Math.atan2(y1 - y0, x1 - x0);
  const spread = Math.acos(Math.max(-1, Math.min(1, (r0 - r1) / Math.hypot(x1 - x0, y1 - y0))));
  const at = (x, y, r, a) => `${n(x + r * Math.cos(a))} ${n(y + r * Math.sin(a))}`;
  return `M${at(x0, y0, r0, angle + spread)}A${n(r0)} ${n(r0)} 0 1 1 ${at(x0, y0, r0, angle - spread)}` +
    `L${at(x1, y1, r1, angle - spread)}A${n(r1)} ${n(r1)} 0 0 1 ${at(x1, y1, r1, angle + spread)}Z`;
}

// x to the right and y up, from the hip, in m; angles in rad. The hip angle is 0 where the thigh continues the trunk.
export class Mechanism {
  // geometry: as the server sends it; legs: the first one is in front; room: null: all is shown, else the legs alone with so many metres below.
  constructor(svg, geometry, legs, room = null) {
    this.svg = svg;
    this.geometry = geometry;
    this.legs = legs;
    this.isClose = room !== null;
    this.parts = new Map();
    const top = this.rail(geometry.slide_max_m);
    const bottom = this.rail(geometry.slide_min_m);
    this.floor = Math.min(bottom[1], 0) - 0.13;
    const right = Math.max(top[0], bottom[0]);
    this.view = this.isClose
      ? [-0.5, right + 0.11, bottom[1] - room, Math.max(0.33, top[1] + 0.2)]
      : [-0.94, right + 0.33, this.floor - 0.18, Math.max(0.64, top[1] + 0.1)];
  }

  layout(width, height) {
    const [left, right, bottom, top] = this.view;
    this.scale = Math.min(width / (right - left), height / (top - bottom));
    this.x0 = (width - this.scale * (right - left)) / 2 - left * this.scale;
    this.y0 = (height - this.scale * (top - bottom)) / 2 + top * this.scale;
    set(this.svg, { viewBox: `0 0 ${width} ${height}` });
    this.svg.replaceChildren();
    this.fixed();
    for (const side of [...this.legs].reverse()) this.parts.set(side, this.leg(side === this.legs[0] ? "near" : "far"));
    this.svg.append(this.arm);
  }

  at([x, y]) {
    return [this.x0 + x * this.scale, this.y0 - y * this.scale];
  }

  line(from, to, className, width, parent) {
    const [[x1, y1], [x2, y2]] = [this.at(from), this.at(to)];
    const ends = { x1: n(x1), y1: n(y1), x2: n(x2), y2: n(y2) };
    return el("line", { ...ends, class: className, "stroke-width": n(width * this.scale), "stroke-linecap": "round" }, parent);
  }

  limb(from, r0, to, r1) {
    return limbPath(this.at(from), r0 * this.scale, this.at(to), r1 * this.scale);
  }

  rail(s) {
    const { rail_x_m: x, rail_y_m: y, rail_angle_rad: angle } = this.geometry;
    return [x + s * Math.cos(angle), y + s * Math.sin(angle)];
  }

  // Couch, floor, rail, and the person down to the hip.
  fixed() {
    const { recline_rad: recline, slide_min_m: low, slide_max_m: high } = this.geometry;
    const g = el("g", { class: "fixed" }, this.svg);
    const lean = Math.PI / 2 + recline;
    const along = (r, across = 0) => [r * Math.cos(lean) - across * Math.sin(lean), r * Math.sin(lean) + across * Math.cos(lean)];
    const ends = [this.rail(low - BESIDE_RAIL_M), this.rail(high + BESIDE_RAIL_M)];
    const post = this.rail(low + 0.65 * (high - low));
    if (!this.isClose) {
      this.line([this.view[0], this.floor], [this.view[1], this.floor], "fig-floor", 0.012, g);
      this.line([post[0] + 0.19, this.floor], [post[0] + 0.02, post[1] - 0.02], "fig-post", 0.032, g);
      this.line([ends[0][0] - 0.05, this.floor], [post[0] + 0.26, this.floor], "fig-post", 0.035, g);
    }
    const couch = el("g", { class: "fig-couch" }, g);
    this.line(along(-0.10, 0.185), along(0.86, 0.185), "fig-cushion", 0.12, couch);
    if (!this.isClose) {
      this.line([-0.36, this.floor], [-0.36, -0.06], "fig-post", 0.05, couch);
      this.line([-0.62, this.floor], [-0.10, this.floor], "fig-post", 0.035, couch);
    }
    this.line(...ends, "fig-rail", 0.05, g);
    this.line(...ends, "fig-rail-inner", 0.014, g);

    const body = el("g", { class: "fig-person" }, g);
    el("path", { d: this.limb(along(0.0, 0.02), 0.115, along(0.45, 0.0), 0.14), class: "fig-body" }, body);
    el("path", { d: this.limb(along(0.5, 0.0), 0.07, along(0.66, -0.02), 0.055), class: "fig-body" }, body);
    const [hx, hy] = this.at(along(0.735, -0.03));
    el("circle", { cx: n(hx), cy: n(hy), r: n(0.108 * this.scale), class: "fig-body" }, body);
    this.arm = el("g", { class: "fig-arm" });
    const [shoulder, elbow, hand] = [along(0.45, -0.02), [-0.30, 0.085], [0.0, 0.205]];
    el("path", { d: this.limb(shoulder, 0.05, elbow, 0.042), class: "fig-limb" }, this.arm);
    el("path", { d: this.limb(elbow, 0.042, hand, 0.032), class: "fig-limb" }, this.arm);
    this.line([hand[0] + 0.005, hand[1] - 0.065], [hand[0] + 0.045, hand[1] + 0.07], "fig-switch", 0.036, this.arm);
    const [gx, gy] = this.at([hand[0] + 0.022, hand[1]]);
    el("circle", { cx: n(gx), cy: n(gy), r: n(0.042 * this.scale), class: "fig-limb" }, this.arm);
  }

  leg(depth) {
    const k = this.scale;
    const g = el("g", { class: `fig-leg-group ${depth}` }, this.svg);
    const parts = { g };
    for (const name of ["glowShank", "glowThigh"]) parts[name] = el("path", { class: "fig-glow" }, g);
    for (const name of ["foot", "shank", "thigh"]) parts[name] = el("path", { class: `fig-leg ${name}` }, g);
    for (const name of ["exoThigh", "exoShank", "exoShoe"]) {
      parts[name] = el("line", { class: "fig-exo", "stroke-linecap": "round", "stroke-width": n(0.022 * k) }, g);
    }
    const box = { width: n(0.15 * k), height: n(0.075 * k), x: n(-0.075 * k), y: n(-0.0375 * k), rx: n(0.02 * k) };
    parts.carriage = el("rect", { class: "fig-carriage", ...box }, g);
    for (const [name, radius] of [["hip", 0.062], ["knee", 0.034], ["ankle", 0.028], ["slide", 0.024]]) {
      parts[name] = el("circle", { class: `fig-joint ${name}`, r: n(radius * k), "stroke-width": n(0.014 * k) }, g);
    }
    return parts;
  }

  // Places of the joints; the ankle is on the branch where the knee bends.
  pose(hip, s) {
    const { thigh_m: thigh, shank_m: shank, shoe_m: shoe, recline_rad: recline, thigh_offset_rad: offset } = this.geometry;
    const angle = hip + offset - (Math.PI / 2 - recline);
    const knee = [thigh * Math.cos(angle), thigh * Math.sin(angle)];
    const slide = this.rail(s);
    const [dx, dy] = [slide[0] - knee[0], slide[1] - knee[1]];
    const d2 = dx * dx + dy * dy;
    const half = 0.5 * (shank * shank - shoe * shoe + d2);
    const delta = Math.sqrt(Math.max(0, shank * shank * d2 - half * half));
    const ankle = [knee[0] + (half * dx + delta * dy) / d2, knee[1] + (half * dy - delta * dx) / d2];
    return { hip: [0, 0], knee, ankle, slide };
  }

  // glow: 0 to 1, the soft pulse of the power
  draw(side, hip, s, glow = 0) {
    const p = this.pose(hip, s);
    const parts = this.parts.get(side);
    const { knee, ankle, slide } = p;
    parts.thigh.setAttribute("d", this.limb([0, 0], 0.098, knee, 0.066));
    parts.shank.setAttribute("d", this.limb(knee, 0.066, ankle, 0.043));
    parts.glowThigh.setAttribute("d", this.limb([0, 0], 0.145, knee, 0.112));
    parts.glowShank.setAttribute("d", this.limb(knee, 0.112, ankle, 0.085));
    for (const name of ["glowThigh", "glowShank"]) parts[name].setAttribute("opacity", glow.toFixed(2));
    parts.foot.setAttribute("d", this.foot(ankle, slide));
    for (const [name, from, to] of [["exoThigh", [0, 0], knee], ["exoShank", knee, ankle], ["exoShoe", ankle, slide]]) {
      const [[x1, y1], [x2, y2]] = [this.at(from), this.at(to)];
      set(parts[name], { x1: n(x1), y1: n(y1), x2: n(x2), y2: n(y2) });
    }
    for (const [name, point] of Object.entries(p)) {
      const [cx, cy] = this.at(point);
      set(parts[name], { cx: n(cx), cy: n(cy) });
    }
    const [sx, sy] = this.at(slide);
    const turn = n(-this.geometry.rail_angle_rad * 180 / Math.PI);
    parts.carriage.setAttribute("transform", `translate(${n(sx)} ${n(sy)}) rotate(${turn})`);
    return p;
  }

  foot(ankle, slide) {
    const length = Math.hypot(slide[0] - ankle[0], slide[1] - ankle[1]);
    const u = [(slide[0] - ankle[0]) / length, (slide[1] - ankle[1]) / length];
    const m = [u[1], -u[0]];
    const f = (from, a, b) => this.at([from[0] + a * u[0] + b * m[0], from[1] + a * u[1] + b * m[1]]).map(n).join(" ");
    return `M${f(ankle, -0.035, -0.045)}Q${f(ankle, -0.10, 0.0)} ${f(ankle, -0.075, 0.062)}L${f(slide, 0.055, 0.05)}` +
      `Q${f(slide, 0.11, 0.03)} ${f(slide, 0.06, -0.012)}Q${f(ankle, 0.12, -0.045)} ${f(ankle, 0.045, -0.048)}Z`;
  }
}
