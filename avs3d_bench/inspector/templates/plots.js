"use strict";
// Plots over time (azimuth above ILD, distance above level) and scatter plots; a click jumps to that time.
(() => {
  const { make } = window.AVS3D;
  const PAD = { left: 46, right: 14, top: 22, bottom: 30 };

  const nice = (low, high, count) => {
    const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 2.5, 5, 10].map((m) => m * power).find((s) => s >= raw);
    const out = [];
    for (let value = Math.ceil(low / step) * step; value <= high + 1e-9; value += step) out.push(Math.round(value * 1e6) / 1e6);
    return out;
  };
  const extent = (values, least) => {
    let low = Math.min(...values), high = Math.max(...values);
    const spare = Math.max(least - (high - low), 0) / 2 + 0.06 * Math.max(high - low, least);
    return [low - spare, high + spare];
  };
  const text = (value) => String(value).replace("-", "−");
  const mean = (values) => values.reduce((a, b) => a + b, 0) / values.length;

  // Two panels with a common time axis.
  class Series {
    constructor(host, data, seek, { title, note, upper, lower }) {
      Object.assign(this, { data, seek, upper, lower, index: 0, time: 0 });
      this.figure = frame(host, title, note);
      this.svg = make("svg", { role: "img", "aria-label": title, class: "series" });
      this.figure.append(this.svg);
      this.svg.addEventListener("pointerdown", (event) => { this.drag = true; this.go(event); });
      this.svg.addEventListener("pointermove", (event) => { if (this.drag && event.buttons) this.go(event); });
      window.addEventListener("pointerup", () => { this.drag = false; });
      new ResizeObserver(() => this.draw()).observe(this.figure);
    }

    renew() { this.width = 0; this.draw(); }

    go(event) {
      const box = this.svg.getBoundingClientRect(), count = this.data.frames.length;
      const share = (event.clientX - box.left - PAD.left) / (box.width - PAD.left - PAD.right);
      this.seek(Math.min(count - 1, Math.max(0, Math.floor(share * count))));
    }

    draw() {
      const width = this.figure.clientWidth;
      if (!width || width === this.width) return;
      this.width = width;
      const panel = 96, gap = 30, height = PAD.top + 2 * panel + gap + PAD.bottom, count = this.data.frames.length;
      const inner = width - PAD.left - PAD.right;
      this.x = (t) => PAD.left + (inner * t) / count;
      this.svg.replaceChildren();
      this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
      this.svg.setAttribute("width", width);
      this.svg.setAttribute("height", height);
      [this.upper, this.lower].forEach((spec, at) => {
        const top = PAD.top + at * (panel + gap);
        const lines = this.lines(spec), known = lines.flatMap((line) => line.values).filter((v) => v !== undefined);
        make("text", { x: 4, y: top - 8, class: "axis name" }, this.svg, spec.label);
        if (!known.length) {
          make("text", { x: PAD.left, y: top + panel / 2, class: "axis" }, this.svg, this.data.scene ? "nothing sounds" : "not in the data");
          return;
        }
        const [low, high] = spec.range ?? (spec.symmetric
          ? ((limit) => [-limit, limit])(1.1 * Math.max(1, ...known.map(Math.abs))) : extent(known, spec.least));
        const y = (v) => top + panel - (panel * (v - low)) / (high - low);
        for (const tick of spec.ticks ?? nice(low, high, 4)) {
          make("line", { x1: PAD.left, x2: width - PAD.right, y1: y(tick), y2: y(tick), class: tick === 0 ? "grid zero" : "grid" }, this.svg);
          make("text", { x: PAD.left - 6, y: y(tick) + 3.5, class: "axis end" }, this.svg, text(tick));
        }
        for (const { values, colour, hollow } of lines) values.forEach((value, i) => {
          if (value === undefined) return;
          if (spec.bars) {
            const base = y(Math.max(low, Math.min(high, 0)));
            make("rect", { x: this.x(i) + 0.5, width: Math.max(1, inner / count - 1), y: Math.min(base, y(value)), height: Math.max(0.5, Math.abs(base - y(value))), class: "bar-mark" }, this.svg);
            return;
          }
          // No line where the azimuth wraps from −180° to 180°.
          const next = values[i + 1], marks = [];
          if (next !== undefined && Math.abs(next - value) < 180) marks.push(make("line", { x1: this.x(i + 0.5), x2: this.x(i + 1.5), y1: y(value), y2: y(next), class: "line-mark" }, this.svg));
          marks.push(make("circle", { cx: this.x(i + 0.5), cy: y(value), r: 2, class: hollow(i) ? "dot-mark hollow" : "dot-mark" }, this.svg));
          if (colour) for (const mark of marks) mark.style.setProperty("--warm", colour);
        });
      });
      const base = height - PAD.bottom;
      for (const tick of nice(0, count, Math.max(3, Math.floor(inner / 80)))) {
        make("text", { x: this.x(tick), y: base + 16, class: "axis middle" }, this.svg, tick === 0 ? "0 s" : text(tick));
      }
      this.cursor = make("line", { y1: PAD.top - 4, y2: base, class: "cursor" }, this.svg);
      this.show(this.index, this.time);
    }

    // In a part_3 observation each source has a line of its own, hollow where it is not audible; what is the clip's has no source's colour.
    lines(spec) {
      const { frames, scene } = this.data;
      if (!scene || !spec.ofSource) return [{ values: frames.map((frame) => frame[spec.value]), colour: scene ? "var(--bar)" : null, hollow: (i) => !scene && frames[i].sight === false }];
      return scene.sources.map((source) => ({ values: source[spec.value].map((v) => v ?? undefined), colour: source.colour, hollow: (i) => !source.audible[i] }));
    }

    show(index, time) {
      this.index = index; this.time = time;
      if (!this.cursor) return;
      this.cursor.setAttribute("x1", this.x(time));
      this.cursor.setAttribute("x2", this.x(time));
    }
  }

  // One quantity against another: one point per frame, with time as colour.
  class Scatter {
    constructor(host, data, seek, { title, note, across, up, law }) {
      Object.assign(this, { data, seek, across, up, law, index: 0 });
      this.figure = frame(host, title, note);
      this.svg = make("svg", { role: "img", "aria-label": title, class: "scatter" });
      this.figure.append(this.svg);
      this.svg.addEventListener("click", (event) => {
        const box = this.svg.getBoundingClientRect();
        let best = -1, least = 30;
        this.points.forEach(([x, y, i]) => {
          const away = Math.hypot(x - (event.clientX - box.left), y - (event.clientY - box.top));
          if (away < least) { least = away; best = i; }
        });
        if (best >= 0) this.seek(best);
      });
      new ResizeObserver(() => this.draw()).observe(this.figure);
    }

    renew() { this.width = 0; this.ring = null; this.draw(); }

    // Groups of [across, up, frame]: one, or in a part_3 observation one for each source.
    groups() {
      const { frames, scene } = this.data, both = ([a, b]) => (a ?? b) !== undefined && (a ?? null) !== null && (b ?? null) !== null;
      if (!scene) return [{ colour: null, points: frames.map((f, i) => [f[this.across.value], f[this.up.value], i]).filter(both) }];
      const alone = (i) => scene.sources.filter((source) => source.audible[i]).length === 1;
      return scene.sources.map((source) => ({
        colour: source.colour,
        // The level is that of the source itself; the level difference is that of the clip, which may hold others.
        points: frames.map((f, i) => [source[this.across.value][i], this.up.ofClip ? f[this.up.value] : source.levels[i], i])
          .filter(both).filter(([, , i]) => source.audible[i] && (!this.up.ofClip || alone(i))),
      }));
    }

    draw() {
      const width = this.figure.clientWidth;
      if (!width || width === this.width) return;
      this.width = width;
      const height = 282, base = height - PAD.bottom - 6;
      this.svg.replaceChildren();
      this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
      this.svg.setAttribute("width", width);
      this.svg.setAttribute("height", height);
      this.points = [];
      const groups = this.groups().filter(({ points }) => points.length), both = groups.flatMap(({ points }) => points);
      if (!both.length) {
        make("text", { x: 4, y: 40, class: "axis" }, this.svg, this.data.scene ? "there is no such frame" : "not in the data");
        return;
      }
      const range = (spec, values) => spec.range ?? (spec.symmetric
        ? ((limit) => [-limit, limit])(1.1 * Math.max(1, ...values.map(Math.abs))) : extent(values, spec.least));
      const log = this.across.log, scaled = (v) => (log ? Math.log2(v) : v);
      const [x0, x1] = range(this.across, both.map(([a]) => scaled(a)));
      const [y0, y1] = range(this.up, both.map(([, b]) => b));
      const x = (v) => PAD.left + ((width - PAD.left - PAD.right) * (scaled(v) - x0)) / (x1 - x0);
      const y = (v) => base - ((base - PAD.top) * (v - y0)) / (y1 - y0);
      for (const tick of nice(y0, y1, 5)) {
        make("line", { x1: PAD.left, x2: width - PAD.right, y1: y(tick), y2: y(tick), class: tick === 0 ? "grid zero" : "grid" }, this.svg);
        make("text", { x: PAD.left - 6, y: y(tick) + 3.5, class: "axis end" }, this.svg, text(tick));
      }
      const ticks = log ? [0.25, 0.5, 1, 1.5, 2, 3, 4, 6, 8, 12].filter((v) => scaled(v) >= x0 && scaled(v) <= x1) : this.across.ticks;
      for (const tick of ticks) {
        make("line", { x1: x(tick), x2: x(tick), y1: PAD.top, y2: base, class: tick === 0 ? "grid zero" : "grid" }, this.svg);
        make("text", { x: x(tick), y: base + 15, class: "axis middle" }, this.svg, text(tick));
      }
      make("text", { x: 4, y: 12, class: "axis name" }, this.svg, this.up.label);
      make("text", { x: width - PAD.right, y: height - 3, class: "axis name end" }, this.svg, this.across.label);
      if (this.law) {
        // The 1/r law: 6 dB per doubling of the distance, through the mean of the points.
        const clip = make("clipPath", { id: `clip-${this.across.value}` }, this.svg);
        make("rect", { x: PAD.left, y: PAD.top, width: width - PAD.left - PAD.right, height: base - PAD.top }, clip);
        for (const { colour, points } of groups) {
          const offset = mean(points.map(([a, b]) => b + 20 * Math.log10(a)));
          const ends = [2 ** x0, 2 ** x1].map((d) => [x(d), y(offset - 20 * Math.log10(d))]);
          const line = make("line", { x1: ends[0][0], y1: ends[0][1], x2: ends[1][0], y2: ends[1][1], class: "law", "clip-path": `url(#clip-${this.across.value})` }, this.svg);
          if (colour) line.style.stroke = colour;
        }
      }
      for (const group of groups) for (const [a, b, i] of group.points) {
        const colour = group.colour ?? this.data.frames[i].colour, hollow = !group.colour && this.data.frames[i].sight === false;
        make("circle", { cx: x(a), cy: y(b), r: 3.4, stroke: colour, fill: hollow ? "none" : colour, class: "point" }, this.svg);
        this.points.push([x(a), y(b), i]);
      }
      this.ring = make("circle", { r: 7.5, class: "ring" }, this.svg);
      this.show(this.index);
    }

    show(index) {
      this.index = index;
      if (!this.ring) return;
      const point = this.points.find(([, , i]) => i === index);
      this.ring.toggleAttribute("hidden", !point);
      if (point) { this.ring.setAttribute("cx", point[0]); this.ring.setAttribute("cy", point[1]); }
    }
  }

  const frame = (host, title, note) => {
    const figure = document.createElement("figure"), caption = document.createElement("figcaption");
    const aside = document.createElement("span");
    caption.append(title, " ", aside);
    aside.textContent = note;
    figure.append(caption);
    host.append(figure);
    return figure;
  };

  const AZIMUTH = { value: "azimuth", ofSource: true, label: "azimuth, °, right positive", range: [-180, 180], ticks: [-180, -90, 0, 90, 180] };
  const ILD = { value: "ild", ofClip: true, label: "ILD, dB, right − left", symmetric: true };
  const DISTANCE = { value: "distance", ofSource: true, label: "distance, m", least: 1 };
  const LEVEL = { value: "level", label: "level, dB re full scale", least: 6 };
  window.AVS3D.plots = (host, data, seek) => {
    const scene = Boolean(data.scene), over = scene ? "over time; hollow: not audible" : "over time";
    return [
      new Series(host, data, seek, { title: "Azimuth and level difference", note: over, upper: AZIMUTH, lower: { ...ILD, bars: true } }),
      new Scatter(host, data, seek, { title: "Level difference against azimuth", note: scene ? "frames with one audible source" : "hollow: no line of sight", across: { ...AZIMUTH, label: "azimuth, °" }, up: ILD }),
      new Series(host, data, seek, { title: "Distance and level", note: over, upper: DISTANCE, lower: LEVEL }),
      new Scatter(host, data, seek, { title: "Level against distance", note: scene ? "of each source where it is audible; dashed: −6 dB per doubling" : "dashed: −6 dB per doubling", across: { ...DISTANCE, log: true, least: 1, label: "distance, m" }, up: LEVEL, law: true }),
    ];
  };
})();
