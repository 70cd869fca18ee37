"use strict";
// The map: floor plan, objects with their labels, the path with time as colour, and the camera's field of view at the current frame.
window.AVS3D = window.AVS3D ?? {};
(() => {
  const NS = "http://www.w3.org/2000/svg";
  const make = (name, attributes = {}, parent = null, text = null) => {
    const element = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== null) element.textContent = text;
    parent?.append(element);
    return element;
  };
  // Dark violet, magenta, amber: distinguishable on light and on dark backgrounds.
  const RAMP = [[76, 52, 168], [196, 58, 124], [242, 160, 61]];
  const ramp = (share) => {
    const at = Math.min(0.9999, Math.max(0, share)) * (RAMP.length - 1), low = Math.floor(at), rest = at - low;
    return `rgb(${RAMP[low].map((v, i) => Math.round(v + (RAMP[low + 1][i] - v) * rest)).join(",")})`;
  };
  // How far from the border of the map the mark of a source outside of it lies (pixels).
  const INSET = 18;
  const star = (x, y, r) => Array.from({ length: 10 }, (_, i) => {
    const length = i % 2 ? r * 0.45 : r, angle = (i * Math.PI) / 5 - Math.PI / 2;
    return `${x + length * Math.cos(angle)},${y + length * Math.sin(angle)}`;
  }).join(" ");

  // Places for labels, as in labels.py: below, above or beside the mark, as near as it is free. Boxes are
  // [left, top, right, bottom] in pixels.
  const TOUCHES_LABEL = 1000, COVERS_LABEL = 1000, COVERS_MARK = 6, STEPS = 13, ROUNDING = 1e-9;
  const shared = (a, b) => Math.max(0, Math.min(a[2], b[2]) - Math.max(a[0], b[0])) * Math.max(0, Math.min(a[3], b[3]) - Math.max(a[1], b[1]));
  const places = (mark, width, height, area) => {
    const x = (mark[0] + mark[2]) / 2, y = (mark[1] + mark[3]) / 2, found = [];
    for (let step = 0; step < STEPS; step += 1) {
      const out = (0.2 + 0.5 * step) * height, beside = (mark[2] - mark[0] + width) / 2 + out, over = (mark[3] - mark[1] + height) / 2 + out;
      for (const [across, down] of [[0, over], [0, -over], [beside, 0], [-beside, 0], [beside, over], [-beside, over], [beside, -over], [-beside, -over]]) {
        const left = Math.max(area[0], Math.min(area[2] - width, x + across - width / 2));
        const top = Math.max(area[1], Math.min(area[3] - height, y + down - height / 2));
        const taste = down > 0 && !across ? 0 : across ? 0.4 : 0.15;
        const moved = Math.abs(left + width / 2 - x - across) + Math.abs(top + height / 2 - y - down);
        found.push([out + taste * height + moved, [left, top, left + width, top + height]]);
      }
    }
    return found;
  };
  const placeLabels = (marks, sizes, area, taken) => {
    const placed = [];
    marks.forEach((mark, i) => {
      const [width, height] = sizes[i];
      let best = null, least = Infinity;
      for (const [away, box] of places(mark, width, height, area)) {
        let covered = 0, touched = 0;
        for (const other of [...placed, ...taken]) {
          const both = shared(box, other);
          covered += both * COVERS_LABEL;
          if (both > ROUNDING) touched = TOUCHES_LABEL;
        }
        for (const other of marks) covered += shared(box, other) * COVERS_MARK;
        const cost = away / height + touched + covered / (width * height);
        if (cost < least) { least = cost; best = box; }
      }
      placed.push(best);
    });
    return placed;
  };
  // Height of a label, and how far its base lies above its lower edge (pixels).
  const LABEL = 15, BASE = 4;

  class FloorMap {
    constructor(host, data, seek) {
      this.host = host; this.data = data; this.seek = seek; this.index = 0; this.folder = "";
      if (!data.map) return;
      this.svg = make("svg", { role: "img", "aria-label": "Map from above: path, camera, objects" });
      host.append(this.svg);
      this.svg.addEventListener("click", (event) => this.jump(event));
      new ResizeObserver(() => this.draw()).observe(host);
      this.draw();
    }

    place(x, z) {
      const [left, top] = this.data.map;
      return [(x - left) * this.scale, (z - top) * this.scale];
    }

    // The data has changed: draw all again.
    renew(folder) {
      this.folder = folder;
      this.width = 0;
      if (this.svg) this.draw();
    }

    draw() {
      const width = this.host.clientWidth;
      if (!width || !this.data.map || width === this.width) return;
      this.width = width;
      const [, , wide, high] = this.data.map;
      const limit = Math.max(260, Math.min(620, window.innerHeight * 0.66));
      this.scale = Math.min(width / wide, limit / high);
      const w = wide * this.scale, h = high * this.scale;
      this.svg.replaceChildren();
      this.svg.setAttribute("viewBox", `0 0 ${w} ${h}`);
      this.svg.setAttribute("width", w);
      this.svg.setAttribute("height", h);
      make("image", { href: `${this.folder}floor.png`, width: w, height: h, preserveAspectRatio: "none", class: "floor" }, this.svg);
      const { frames } = this.data, at = frames.map((frame) => frame.at && this.place(frame.at[0], frame.at[1]));
      this.at = at;
      for (const thing of this.data.instances) {
        const [x0, y0] = this.place(thing.box[0], thing.box[1]), [x1, y1] = this.place(thing.box[2], thing.box[3]);
        const kind = thing.sounding ? "sounds" : thing.twin ? "twin" : "other";
        const rect = make("rect", { x: x0, y: y0, width: Math.max(3, x1 - x0), height: Math.max(3, y1 - y0), rx: 2, class: `thing ${kind}` }, this.svg);
        if (this.data.scene && kind !== "other") rect.style.stroke = rect.style.fill = thing.colour;
      }
      if (this.data.moves) {
        const way = frames.filter((frame) => frame.source).map((frame) => this.place(...frame.source).join(",")).join(" ");
        make("polyline", { points: way, class: "way" }, this.svg);
      }
      const halo = at.filter(Boolean).map((p) => p.join(",")).join(" ");
      make("polyline", { points: halo, class: "halo" }, this.svg);
      for (let i = 1; i < at.length; i += 1) {
        if (at[i] && at[i - 1]) make("line", {
          x1: at[i - 1][0], y1: at[i - 1][1], x2: at[i][0], y2: at[i][1], class: "step", stroke: ramp(i / (at.length - 1)),
        }, this.svg);
      }
      this.ray = make("line", { class: "ray" }, this.svg);
      this.wedge = make("path", { class: "wedge" }, this.svg);
      this.dot = make("circle", { r: 5.5, class: "listener" }, this.svg);
      this.source = make("polygon", { class: "source" }, this.svg);
      this.marks = (this.data.scene?.sources ?? []).map((source) => this.mark(source, w, h));
      const boxes = this.marks.map(({ x, y }) => [x - 10, y - 10, x + 10, y + 10]);
      const wanted = [];
      this.marks.forEach(({ source }, i) => { if (source.room) wanted.push([boxes[i], source.name, "label away"]); });
      for (const thing of this.data.instances) {
        const [x0, y0] = this.place(thing.box[0], thing.box[1]), [x1, y1] = this.place(thing.box[2], thing.box[3]);
        const named = this.data.scene?.sources.find((source) => source.instance === thing.id);
        const label = named ? named.name : thing.sounding ? `${thing.name}, sounds` : thing.twin ? `${thing.name}, silent twin` : thing.name;
        const kind = thing.sounding ? "sounds" : thing.twin ? "twin" : "other";
        wanted.push([[x0, y0, x1, y1], label, this.data.scene ? "label" : `label ${kind}`]);
      }
      this.label(wanted, [4, 4, w - 4, h - 4], [[6, h - 36, 18 + this.scale, h - 6]]);
      const bar = make("g", { class: "scale" }, this.svg);
      make("path", { d: `M12,${h - 17}v5h${this.scale}v-5` }, bar);
      make("text", { x: 12 + this.scale / 2, y: h - 18 }, bar, "1 m");
      this.show(this.index);
    }

    // Write labels: a thin line leads to the mark of one that lies further away.
    label(wanted, area, taken) {
      const texts = wanted.map(([, label, kind]) => make("text", { class: kind }, this.svg, label));
      // The width of a text is measured as 0 while the page is hidden.
      const sizes = texts.map((text, i) => [Math.max(text.getComputedTextLength(), wanted[i][1].length * 6.2) + 4, LABEL]);
      placeLabels(wanted.map(([box]) => box), sizes, area, taken).forEach((box, i) => {
        const mark = wanted[i][0], x = (box[0] + box[2]) / 2, y = (box[1] + box[3]) / 2;
        texts[i].setAttribute("x", x);
        texts[i].setAttribute("y", box[3] - BASE);
        const near = [Math.max(mark[0], Math.min(mark[2], x)), Math.max(mark[1], Math.min(mark[3], y))];
        const end = [Math.max(box[0], Math.min(box[2], near[0])), Math.max(box[1], Math.min(box[3], near[1]))];
        if (Math.hypot(end[0] - near[0], end[1] - near[1]) > 0.75 * LABEL) this.svg.insertBefore(make("line", { class: "leader", x1: end[0], y1: end[1], x2: near[0], y2: near[1] }), texts[0]);
      });
    }

    // A source of a part_3 observation: a star, or for one outside of the map an arrow at its border.
    mark(source, w, h) {
      let [x, y] = this.place(...source.at);
      const ray = make("line", { class: "ray" }, this.svg);
      const out = x < INSET || y < INSET || x > w - INSET || y > h - INSET;
      let points = star(x, y, 9);
      if (out) {
        const dx = x - w / 2, dy = y - h / 2, angle = Math.atan2(dy, dx);
        const share = Math.min((w / 2 - INSET) / Math.max(1e-9, Math.abs(dx)), (h / 2 - INSET) / Math.max(1e-9, Math.abs(dy)));
        [x, y] = [w / 2 + dx * share, h / 2 + dy * share];
        points = [[12, 0], [-7, -8], [-3, 0], [-7, 8]].map(([a, b]) => `${x + a * Math.cos(angle) - b * Math.sin(angle)},${y + a * Math.sin(angle) + b * Math.cos(angle)}`).join(" ");
      }
      const shape = make("polygon", { class: out ? "source away" : "source", points }, this.svg);
      for (const element of [ray, shape]) element.style.setProperty("--colour", source.colour);
      return { source, ray, shape, x, y };
    }

    // Sources that are not audible are hollow; a line leads to those that are.
    showMarks(index) {
      const here = this.at[index];
      for (const { source, ray, shape, x, y } of this.marks) {
        const audible = Boolean(source.audible[index]);
        shape.classList.toggle("hollow", !audible);
        ray.toggleAttribute("hidden", !(audible && here));
        if (here) for (const [key, value] of Object.entries({ x1: here[0], y1: here[1], x2: x, y2: y })) ray.setAttribute(key, value);
      }
    }

    show(index) {
      this.index = index;
      const frame = this.data.frames[index];
      if (!this.dot) return;
      this.showMarks(index);
      for (const element of [this.dot, this.wedge]) element.toggleAttribute("hidden", !frame.at);
      if (frame.at) {
        const [x, y] = this.at[index], [, , hx, hz] = frame.at;
        const middle = Math.atan2(hz, hx), half = (this.data.hfov * Math.PI) / 360, reach = 0.95 * this.scale;
        const edge = (angle) => `${x + reach * Math.cos(angle)},${y + reach * Math.sin(angle)}`;
        this.wedge.setAttribute("d", `M${x},${y}L${edge(middle - half)}A${reach},${reach} 0 0 1 ${edge(middle + half)}Z`);
        this.dot.setAttribute("cx", x);
        this.dot.setAttribute("cy", y);
      }
      this.source.toggleAttribute("hidden", !frame.source);
      this.ray.toggleAttribute("hidden", !(frame.source && frame.at));
      if (frame.source) {
        const [x, y] = this.place(...frame.source);
        this.source.setAttribute("points", star(x, y, 9));
        if (frame.at) {
          const [fx, fy] = this.at[index];
          for (const [key, value] of Object.entries({ x1: fx, y1: fy, x2: x, y2: y })) this.ray.setAttribute(key, value);
          this.ray.classList.toggle("hidden-source", frame.sight === false);
        }
      }
    }

    jump(event) {
      const box = this.svg.getBoundingClientRect();
      const x = event.clientX - box.left, y = event.clientY - box.top;
      let best = -1, least = 40;
      this.at.forEach((p, i) => {
        const away = p ? Math.hypot(p[0] - x, p[1] - y) : Infinity;
        if (away < least) { least = away; best = i; }
      });
      if (best >= 0) this.seek(best);
    }
  }
  Object.assign(window.AVS3D, { FloorMap, make, ramp });
})();
