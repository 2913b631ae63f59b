// A strip chart of the last seconds on a canvas: a fixed scale, gaps where a value is not known, a band of
// the standard deviation, and below it a ribbon of the validity.

const RIBBON_PX = 12;

// 1, 2, 4, ...: so many times the full scale has room for the largest value; never less than 1, so that noise stays small.
export const roomFor = (full, most) => 2 ** Math.ceil(Math.log2(Math.max(1, most / full)));

export class Strip {
  // series: [{ get, color, width, dash, std }]; colours are names of CSS variables. What goes beyond the range is at its edge.
  constructor(canvas, { seconds, range = [-1, 1], ticks = [], series, ribbon = null, gutter = 44, font = 13, hasTime = true }) {
    Object.assign(this, { canvas, seconds, range, ticks, series, ribbon, gutter, font, hasTime });
    this.restyle();
  }

  // The colours are read again: the scheme of the page has changed.
  restyle() {
    this.colours = new Map();
    this.family = getComputedStyle(this.canvas).fontFamily;
  }

  colour(name) {
    if (!this.colours.has(name)) {
      this.canvas.style.color = `var(${name})`;
      this.colours.set(name, getComputedStyle(this.canvas).color);
      this.canvas.style.color = "";
    }
    return this.colours.get(name);
  }

  // rows: with their time t in s, rising; now: at the right edge.
  draw(rows, now) {
    const { canvas, seconds, range: [low, high], gutter, font } = this;
    const [w, h] = [canvas.clientWidth, canvas.clientHeight];
    const ratio = devicePixelRatio || 1;
    const [width, height] = [Math.round(w * ratio), Math.round(h * ratio)];
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const g = canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, w, h);
    const axis = this.hasTime ? font + 5 : 3;
    const ribbon = this.ribbon ? RIBBON_PX + 6 : 0;
    const [top, bottom] = [font * 0.7, h - axis - ribbon];
    const right = w - 6;
    this.x = (t) => right - ((now - t) / seconds) * (right - gutter);
    this.y = (value) => bottom - ((Math.max(low, Math.min(high, value)) - low) / (high - low)) * (bottom - top);
    this.axes(g, now, right, h);
    g.save();
    g.beginPath();
    g.rect(gutter, 0, right - gutter, bottom + 2);
    g.clip();
    for (const one of this.series) {
      if (one.std) this.band(g, rows, one);
      this.curve(g, rows, one);
    }
    g.restore();
    if (this.ribbon) this.drawRibbon(g, rows, bottom + 6, right);
  }

  axes(g, now, right, h) {
    const { gutter, font, seconds } = this;
    g.font = `${font}px ${this.family}`;
    g.textBaseline = "middle";
    g.textAlign = "right";
    for (const tick of this.ticks) {
      const y = Math.round(this.y(tick)) + 0.5;
      g.strokeStyle = this.colour(tick === 0 ? "--edge" : "--line");
      g.lineWidth = 1;
      g.beginPath();
      g.moveTo(gutter, y);
      g.lineTo(right, y);
      g.stroke();
      g.fillStyle = this.colour("--soft");
      g.fillText(`${tick < 0 ? "−" : ""}${Math.abs(tick)}`, gutter - 6, this.y(tick));
    }
    if (!this.hasTime) return;
    for (let s = 0; s <= seconds; s += seconds / 4) {
      g.textAlign = s === 0 ? "right" : s === seconds ? "left" : "center";
      g.fillText(s === 0 ? "0 s" : `−${s}`, this.x(now - s), h - font / 2 - 1);
    }
  }

  band(g, rows, one) {
    g.fillStyle = this.colour(one.color);
    g.globalAlpha = 0.24;
    let run = [];
    const flush = () => {
      if (run.length > 1) {
        g.beginPath();
        for (const [t, value, std] of run) g.lineTo(this.x(t), this.y(value + std));
        for (const [t, value, std] of run.reverse()) g.lineTo(this.x(t), this.y(value - std));
        g.fill();
      }
      run = [];
    };
    for (const row of rows) {
      const value = one.get(row);
      if (value === null) flush();
      else run.push([row.t, value, one.std(row) ?? 0]);
    }
    flush();
    g.globalAlpha = 1;
  }

  curve(g, rows, one) {
    g.strokeStyle = this.colour(one.color);
    g.lineWidth = one.width;
    g.lineJoin = "round";
    g.setLineDash(one.dash ?? []);
    g.beginPath();
    let isDown = false;
    for (const row of rows) {
      const value = one.get(row);
      if (value !== null && isDown) g.lineTo(this.x(row.t), this.y(value));
      else if (value !== null) g.moveTo(this.x(row.t), this.y(value));
      isDown = value !== null;
    }
    g.stroke();
    g.setLineDash([]);
  }

  // Green: valid; hatched: the net value alone; vermillion: bad; nothing: no message.
  drawRibbon(g, rows, top, right) {
    const { gutter } = this;
    g.save();
    g.beginPath();
    g.roundRect(gutter, top, right - gutter, RIBBON_PX, RIBBON_PX / 2);
    g.clip();
    g.fillStyle = this.colour("--shade");
    g.fillRect(gutter, top, right - gutter, RIBBON_PX);
    let from = null;
    let kind = null;
    const fill = (to) => {
      if (kind === null || this.x(to) < gutter) return;
      const [a, b] = [Math.max(gutter, this.x(from)), this.x(to)];
      if (kind === "ok" || kind === "bad") {
        g.fillStyle = this.colour(kind === "ok" ? "--green" : "--vermillion");
        g.fillRect(a, top, b - a + 0.6, RIBBON_PX);
      } else this.hatch(g, a, b, top);
    };
    for (const row of rows) {
      const now = this.ribbon(row);
      if (now === kind) continue;
      fill(row.t);
      [from, kind] = [row.t, now];
    }
    if (rows.length) fill(rows.at(-1).t);
    g.restore();
  }

  hatch(g, a, b, top) {
    g.save();
    g.beginPath();
    g.rect(a, top, b - a, RIBBON_PX);
    g.clip();
    g.strokeStyle = this.colour("--edge");
    g.lineWidth = 2.5;
    g.beginPath();
    for (let s = a - RIBBON_PX - ((a + RIBBON_PX) % 7); s < b; s += 7) {
      g.moveTo(s, top + RIBBON_PX);
      g.lineTo(s + RIBBON_PX, top);
    }
    g.stroke();
    g.restore();
  }
}
