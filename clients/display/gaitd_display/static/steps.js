// The path of the last steps, and the gauge of the newest one of each leg. The server has judged them and says how high they are.
import { el, n, set } from "./figure.js";

const LOW = 0.31; // the target's place on the gauge, as the server's heights have it
const HIGH = 0.69;

// Shapes tell the results apart, and a square the left leg where there are two.
function mark(parent, result, x, y, r, isLeft) {
  const g = el("g", { transform: `translate(${n(x)} ${n(y)})` }, parent);
  const round = isLeft ? ["rect", { x: -r * 0.9, y: -r * 0.9, width: r * 1.8, height: r * 1.8, rx: r * 0.2 }] : ["circle", { r }];
  if (result === "below") el("path", { d: `M0 ${-r * 1.05}L${r} ${r * 0.75}H${-r}Z`, class: "mark below" }, g);
  else if (result === "above") el("path", { d: `M0 ${r * 1.05}L${r} ${-r * 0.75}H${-r}Z`, class: "mark above" }, g);
  else if (result === "against") el("path", { d: `M0 ${-r}L${r} 0L0 ${r}L${-r} 0Z`, class: "mark against" }, g);
  else el(round[0], { ...round[1], class: `mark ${result}` }, g);
  if (result === "within") el("path", { d: `M${-r * 0.42} 0L${-r * 0.08} ${r * 0.36}L${r * 0.46} ${-r * 0.36}`, class: "glyph" }, g);
  if (result === "unknown") el("path", { d: `M${-r * 0.4} 0H${r * 0.4}`, class: "dash" }, g);
}

class Gauge {
  constructor(svg, { unit, far, hasTarget, words }) {
    Object.assign(this, { svg, unit, far, hasTarget, words });
    this.width = svg.clientWidth;
    this.height = svg.clientHeight;
    this.pad = 2.2 * unit;
    this.top = 0.85 * far + this.pad * 0.8;
    this.bottom = this.height - 0.72 * far - this.pad * 0.8;
  }

  y(ratio) {
    return this.bottom - ratio * (this.bottom - this.top);
  }

  // Returns where the path may begin.
  band() {
    if (!this.hasTarget) return this.pad * 2;
    const [top, bottom] = [this.y(HIGH), this.y(LOW)];
    el("rect", { x: this.pad, y: top, width: this.width - 2 * this.pad, height: bottom - top, rx: 10, class: "band" }, this.svg);
    const label = el("text", { x: this.pad * 1.8, y: (top + bottom) / 2 + 0.34 * this.far, class: "bandlabel" }, this.svg, this.words.of("target"));
    return this.pad * 1.8 + label.getComputedTextLength() + 2.8 * this.unit;
  }

  bandLines() {
    if (!this.hasTarget) return;
    for (const ratio of [LOW, HIGH]) el("line", { x1: this.pad, x2: this.width - this.pad, y1: this.y(ratio), y2: this.y(ratio), class: "bandline" }, this.svg);
  }

  column(x, width, step, index) {
    const { svg, top, bottom } = this;
    const box = { x, y: top, width, height: bottom - top, rx: 0.14 * width };
    el("rect", box, el("clipPath", { id: `gauge${index}` }, svg));
    el("rect", { ...box, class: "track" }, svg);
    const inner = el("g", { "clip-path": `url(#gauge${index})` }, svg);
    if (step === undefined || step.height_ratio === null) {
      for (let y = top - width; y < bottom + width; y += 2.7 * this.unit) el("line", { x1: x, x2: x + width, y1: y + width, y2: y, class: "hatchline" }, inner);
    } else {
      const y = this.y(step.height_ratio);
      el("rect", { x, y, width, height: bottom - y, class: `column ${step.result}` }, inner);
      el("line", { x1: x, x2: x + width, y1: y, y2: y, class: "columntop" }, inner);
    }
    el("rect", { ...box, class: "outline" }, svg);
  }

  newest(x, width, step, isLeft) {
    const { svg, top, bottom, unit } = this;
    const middle = x + width / 2;
    if (step === undefined || step.height_ratio === null) {
      const y = (top + bottom) / 2;
      el("rect", { x: middle - width * 0.3, y: y - 3.4 * unit, width: width * 0.6, height: 6.8 * unit, rx: 10, class: "plate" }, svg);
      el("line", { x1: middle - width * 0.16, x2: middle + width * 0.16, y1: y, y2: y, class: "dash", "stroke-width": 1.3 * unit }, svg);
      return;
    }
    const r = Math.min(4.8 * unit, width * 0.44);
    mark(svg, step.result, middle, Math.max(top + r * 1.12, Math.min(bottom - r * 1.12, this.y(step.height_ratio))), r, isLeft);
  }
}

// legs: as the server sends them; steps: the newest ones of all, oldest first.
export function paintSteps(svg, { legs, steps, unit, far, words }) {
  svg.replaceChildren();
  const hasTarget = legs.some((leg) => leg.share_low_ratio !== null);
  const gauge = new Gauge(svg, { unit, far, hasTarget, words });
  const { width, top, bottom, pad } = gauge;
  set(svg, { viewBox: `0 0 ${width} ${gauge.height}` });
  const isTwo = legs.length > 1;
  const wide = (isTwo ? 19 : 12.5) * unit;
  const at = width - pad * 1.6 - wide;
  const each = (wide - (legs.length - 1) * unit) / legs.length;
  const newest = legs.map(({ leg }) => steps.findLast((step) => step.leg === leg));
  const from = gauge.band();
  legs.forEach((_, index) => gauge.column(at + index * (each + unit), each, newest[index], index));
  gauge.bandLines();
  legs.forEach(({ leg }, index) => el("text", { x: at + index * (each + unit) + each / 2, y: top - 0.14 * far, class: "gaugesign" }, svg, isTwo ? words.of(`letter.${leg}`) : "+"));
  el("text", { x: at + wide / 2, y: bottom + 0.68 * far, class: "gaugesign" }, svg, "–");

  const before = steps.filter((step) => !newest.includes(step));
  const gap = (at - 3 * unit - from) / 11;
  const r = Math.min(gap * 0.44, 2.5 * unit);
  const first = at - 3 * unit - (before.length - 1) * gap;
  const points = before.map((step, index) => [first + index * gap, gauge.y(step.height_ratio ?? (LOW + HIGH) / 2), step]);
  const known = points.filter(([, , step]) => step.result !== "unknown");
  if (!isTwo && newest[0]?.height_ratio != null) known.push([at + wide / 2, gauge.y(newest[0].height_ratio), newest[0]]);
  const links = known.slice(1).flatMap(([x, y, step], index) => {
    const [x0, y0, last] = known[index];
    return step.result === "within" && last.result === "within" ? [`M${n(x0)} ${n(y0)}L${n(x)} ${n(y)}`] : [];
  });
  el("path", { d: links.join(""), class: "chain" }, svg);
  for (const [x, y, step] of points) mark(svg, step.result, x, y, r, isTwo && step.leg === "left");
  legs.forEach(({ leg }, index) => gauge.newest(at + index * (each + unit), each, newest[index], isTwo && leg === "left"));
  set(svg, { "aria-label": labelOf(legs, newest, words) });
}

const percent = (ratio) => `${Math.round(100 * ratio)} %`;

function labelOf(legs, newest, words) {
  return legs.map(({ leg, share_low_ratio: low, share_high_ratio: high }, index) => {
    const share = newest[index]?.share_ratio ?? null;
    const said = `${words.of(leg)}: ${share === null ? words.of("not_known") : percent(share)}`;
    return low === null ? said : `${said}, ${words.of("target")} ${percent(low)} – ${percent(high)}`;
  }).join("; ");
}
