"use strict";
// The map: floor plan, objects, the path with time as colour, and the camera's field of view at the current frame.
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
      const taken = [];
      this.marks = (this.data.scene?.sources ?? []).map((source) => this.mark(source, w, h, taken));
      for (const thing of this.data.instances) {
        const [x0] = this.place(thing.box[0], thing.box[1]), [x1, y1] = this.place(thing.box[2], thing.box[3]);
        const named = this.data.scene?.sources.find((source) => source.instance === thing.id);
        const label = named ? named.name : thing.sounding ? `${thing.name}, sounds` : thing.twin ? `${thing.name}, silent twin` : thing.name;
        const kind = thing.sounding ? "sounds" : thing.twin ? "twin" : "other";
        const text = make("text", { class: this.data.scene ? "label" : `label ${kind}` }, this.svg, label);
        // Half the width of the text, which is measured as 0 while the page is hidden.
        const half = Math.max(text.getComputedTextLength() / 2 + 2, label.length * 3.1);
        const x = Math.min(w - half - 4, Math.max(half + 4, (x0 + x1) / 2));
        let y = Math.min(h - 6, y1 + 15);
        while (taken.some(([a, b, c]) => Math.abs(b - y) < 13 && Math.abs(a - x) < half + c)) y += 13;
        taken.push([x, y, half]);
        text.setAttribute("x", x);
        text.setAttribute("y", y);
      }
      const bar = make("g", { class: "scale" }, this.svg);
      make("path", { d: `M12,${h - 17}v5h${this.scale}v-5` }, bar);
      make("text", { x: 12 + this.scale / 2, y: h - 18 }, bar, "1 m");
      this.show(this.index);
    }

    // A source of a sound scene: a star, or for one outside of the map an arrow at its border with the name of its room.
    mark(source, w, h, taken) {
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
      if (source.room) {
        const text = make("text", { class: "label away" }, this.svg, source.name);
        const half = Math.max(text.getComputedTextLength() / 2 + 2, source.name.length * 3.1);
        const at = [Math.min(w - half - 4, Math.max(half + 4, x)), y > h - 40 ? y - 16 : y + 24];
        while (taken.some(([a, b, c]) => Math.abs(b - at[1]) < 13 && Math.abs(a - at[0]) < half + c)) at[1] += y > h - 40 ? -13 : 13;
        taken.push([...at, half]);
        text.setAttribute("x", at[0]);
        text.setAttribute("y", at[1]);
      }
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
