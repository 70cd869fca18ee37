"use strict";
// What moves on the map that floor_map.py draws: the camera with its field of view, a moving source, lines to what is audible.
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
  // A click jumps to a frame at most this far away (pixels).
  const NEAR = 40;

  class FloorMap {
    constructor(host, data, seek) {
      Object.assign(this, { host, data, seek });
      host.addEventListener("click", (event) => this.jump(event));
    }

    // The map of another observation.
    renew(svg) {
      this.host.querySelector("svg")?.remove();
      this.host.insertAdjacentHTML("beforeend", svg);
    }

    place(x, z) {
      const [left, top, scale] = this.data.map;
      return [(x - left) * scale, (z - top) * scale];
    }

    show(index) {
      if (!this.data.map) return;
      const { at, source: spot, sight } = this.data.frames[index], sources = this.data.scene?.sources;
      const here = at && this.place(at[0], at[1]), there = spot && this.place(...spot);
      for (const element of this.host.querySelectorAll(".wedge, .listener")) {
        element.toggleAttribute("hidden", !at);
        if (at) element.setAttribute("transform", `translate(${here}) rotate(${(Math.atan2(at[3], at[2]) * 180) / Math.PI})`);
      }
      const rays = this.host.querySelectorAll(".ray");
      this.host.querySelectorAll(".source").forEach((star, i) => {
        const audible = sources ? Boolean(sources[i].audible[index]) : Boolean(spot), ends = {};
        star.classList.toggle("hollow", Boolean(sources) && !audible);
        star.toggleAttribute("hidden", !sources && !spot);
        rays[i].toggleAttribute("hidden", !(audible && at));
        rays[i].classList.toggle("hidden-source", !sources && sight === false);
        if (here) [ends.x1, ends.y1] = here;
        const way = sources?.[i].at, now = way ? this.place(...way[index]) : there;
        if (now) { [ends.x2, ends.y2] = now; star.setAttribute("transform", `translate(${now})`); }
        for (const [key, value] of Object.entries(ends)) rays[i].setAttribute(key, value);
      });
    }

    jump(event) {
      const svg = event.target.closest("svg");
      if (!svg) return;
      const matrix = svg.getScreenCTM(), { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
      const away = this.data.frames.map(({ at }) => (at ? matrix.a * Math.hypot(...this.place(at[0], at[1]).map((v, i) => v - [x, y][i])) : Infinity));
      const least = Math.min(...away);
      if (least < NEAR) this.seek(away.indexOf(least));
    }
  }
  Object.assign(window.AVS3D, { FloorMap, make });
})();
