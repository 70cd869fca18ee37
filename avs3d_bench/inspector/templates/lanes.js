"use strict";
// One lane for each source, and one for the background: programme, level of each frame, solo and mute.
window.AVS3D = window.AVS3D ?? {};
(() => {
  const { make } = window.AVS3D;
  const HEIGHT = 30;
  // The level at the foot of a lane, dB re full scale: below it, a source does not count as audible.
  const FOOT = -60;
  // The lowest level at the top of a lane, dB re full scale.
  const LEAST_TOP = -24;
  // With more intervals, a lane only says how many they are.
  const MOST_SPANS = 2;
  const WHY = "This dataset has no stems (the clips of the single sources), so that sources cannot be heard alone. Generate it with: avs3d generate … --with stems";
  const node = (name, attributes = {}, ...children) => {
    const element = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    element.append(...children);
    return element;
  };
  const number = (value, digits) => value.toFixed(digits).replace("-", "−");

  class Lanes {
    // `seek(frame)` jumps; `choose(on)` is told which lanes are to be heard: on(id) → true or false.
    constructor(host, data, { seek, choose }) {
      Object.assign(this, { host, data, seek, choose, index: 0, time: 0 });
      new ResizeObserver(() => this.draw()).observe(host);
      this.build();
    }

    build() {
      const { scene, frames } = this.data, { background } = scene;
      this.solo = new Set();
      this.muted = new Set();
      this.width = 0;
      this.lanes = scene.sources.map((source) => ({
        ...source,
        note: source.spans.length > MOST_SPANS ? `${source.spans.length} intervals` : source.programme,
        label: `${source.name}: ${source.programme}; audible in ${source.audible.filter(Boolean).length} of ${frames.length} frames`,
      }));
      if (background) {
        const over = scene.sources.length ? `${number(background.snr, 0)} dB below the sources` : `${number(background.level, 0)} dB`;
        this.lanes.push({
          id: background.id, name: `background, ${background.name}`, note: over, label: `background, ${background.name}: ${over}`,
          colour: null, spans: [[0, frames.length]], audible: frames.map(() => 1),
          levels: frames.map((_, i) => (background.levels.length ? background.levels[i] : background.level)),
        });
      }
      const title = node("h2", { class: "lanes-title" }, "Sources");
      if (!scene.stems && this.lanes.length) title.append(" ", node("span", { class: "why", title: WHY, tabindex: "0", role: "note", "aria-label": WHY }, "no solo and mute: no stems"));
      this.host.replaceChildren(title);
      if (!scene.sources.length) this.host.append(node("p", { class: "absent" }, background ? `No source: ${background.name} alone.` : "Silence: nothing sounds in this observation."));
      for (const lane of this.lanes) this.add(lane);
      this.draw();
      this.show(this.index, this.time);
    }

    add(lane) {
      const swatch = node("i", { class: "swatch", "aria-hidden": "true" });
      if (lane.colour) swatch.style.background = lane.colour;
      lane.state = node("span", { class: "lane-state" });
      const name = node("span", { class: "lane-name" }, node("b", {}, swatch, lane.name)), now = node("span", { class: "lane-now" }, lane.state);
      if (lane.room) name.append(node("span", { class: "tag away" }, "off-screen"));
      name.append(node("span", { class: "lane-note" }, lane.note));
      const head = node("div", { class: "lane-head" }, name, now);
      if (this.data.scene.stems) {
        lane.buttons = ["solo", "mute"].map((kind) => {
          const word = kind === "solo" ? "Solo" : "Mute";
          const button = node("button", { type: "button", "data-kind": kind, "aria-pressed": "false", "aria-label": `${word} ${lane.name}` }, word);
          button.addEventListener("click", () => this.press(kind, lane.id));
          return button;
        });
        now.append(node("span", { class: "lane-buttons" }, ...lane.buttons));
      }
      lane.svg = make("svg", { role: "img", "aria-label": lane.label, height: HEIGHT });
      lane.svg.addEventListener("click", (event) => {
        const box = lane.svg.getBoundingClientRect(), count = this.data.frames.length;
        this.seek(Math.min(count - 1, Math.max(0, Math.floor((count * (event.clientX - box.left)) / box.width))));
      });
      lane.row = node("div", { class: "lane", "data-lane": lane.id }, head, lane.svg);
      if (lane.colour) lane.row.style.setProperty("--colour", lane.colour);
      this.host.append(lane.row);
    }

    get chosen() { return this.solo.size + this.muted.size > 0; }

    on(id) { return this.solo.size ? this.solo.has(id) : !this.muted.has(id); }

    press(kind, id) {
      const chosen = kind === "solo" ? this.solo : this.muted;
      if (!chosen.delete(id)) chosen.add(id);
      this.mark();
      this.choose((name) => this.on(name));
    }

    // All lanes are heard again.
    clear() {
      this.solo.clear();
      this.muted.clear();
      this.mark();
    }

    mark() {
      for (const lane of this.lanes) {
        lane.row.classList.toggle("off", !this.on(lane.id));
        for (const button of lane.buttons ?? []) button.setAttribute("aria-pressed", String((button.dataset.kind === "solo" ? this.solo : this.muted).has(lane.id)));
      }
    }

    draw() {
      const width = this.host.clientWidth, count = this.data.frames.length;
      if (!width || width === this.width) return;
      this.width = width;
      const step = width / count;
      const top = Math.max(LEAST_TOP, ...this.lanes.flatMap((lane) => lane.levels.filter((level) => level !== null)));
      for (const lane of this.lanes) {
        lane.svg.replaceChildren();
        lane.svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
        lane.svg.setAttribute("width", width);
        make("rect", { x: 0, y: 0, width, height: HEIGHT, rx: 3, class: "lane-ground" }, lane.svg);
        for (const [start, end] of lane.spans) make("rect", { x: start * step, y: 0, width: Math.max(1, (end - start) * step), height: HEIGHT, class: "span" }, lane.svg);
        lane.levels.forEach((level, i) => {
          if (level === null && !lane.audible[i]) return;
          const tall = level === null ? 0.5 : Math.min(1, Math.max(0, (level - FOOT) / (top - FOOT)));
          const high = 2 + (HEIGHT - 5) * tall;
          make("rect", { x: i * step + 0.5, y: HEIGHT - high, width: Math.max(1, step - 1), height: high, class: lane.audible[i] ? "heard" : "unheard" }, lane.svg);
        });
        lane.cursor = make("line", { y1: 0, y2: HEIGHT, class: "cursor" }, lane.svg);
      }
      this.show(this.index, this.time);
    }

    show(index, time) {
      const moved = index !== this.index || time === 0;
      Object.assign(this, { index, time });
      for (const lane of this.lanes) {
        const x = (this.width * time) / this.data.frames.length;
        if (lane.cursor) { lane.cursor.setAttribute("x1", x); lane.cursor.setAttribute("x2", x); }
        if (moved || !lane.state.textContent) this.tell(lane, index);
      }
    }

    tell(lane, index) {
      const level = lane.levels[index], audible = Boolean(lane.audible[index]);
      const parts = [];
      if (lane.azimuth) {
        parts.push(audible ? "audible" : "not audible");
        if (typeof lane.azimuth[index] === "number") parts.push(`${lane.azimuth[index] > 0 ? "+" : ""}${number(lane.azimuth[index], 0)}°`, `${number(lane.distance[index], 1)} m`);
      }
      if (level !== null) parts.push(`${number(level, 0)} dB`);
      lane.state.textContent = parts.join(" · ");
      lane.row.classList.toggle("quiet", !audible);
    }
  }
  window.AVS3D.Lanes = Lanes;
})();
