"use strict";
// The player. The audio element is the clock: frame k is shown while second k plays. Without sound, a timer is used.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const by = (id) => document.getElementById(id);
  // Pictures stay those of this page; sound and truth are those of `folder`, which a sibling of a group changes.
  const home = new URL(".", document.baseURI);
  let folder = home;
  const stage = by("stage"), screen = by("screen"), pen = screen.getContext("2d");
  const sound = by("sound"), scrub = by("scrub"), say = by("say"), strip = by("strip");
  const count = data.frames.length;
  // Okabe & Ito: colours that are distinguishable with any colour vision; missed pixels are also hatched.
  const HIT = "rgb(86,180,233)", MISSED = "rgb(240,228,66)", FALSE = "rgb(213,94,0)", TRUTH = "rgb(255,122,69)", MARKED = "rgb(64,190,255)";
  const AHEAD = 4, KEPT = 48;
  const state = { index: -1, playing: false, mask: false, instances: false, errors: false, submission: 0, wanted: 0, drawn: 0, floor: 0 };

  // ---- the clock ----------------------------------------------------------------------------------------------
  const clock = {
    base: 0, since: null, rate: 1, silent: !sound, stems: null, loading: null,
    now() {
      if (this.loading !== null) return this.loading;
      if (this.stems) return Math.min(count, this.stems.now());
      if (!this.silent) return Math.min(count, sound.currentTime);
      const run = this.since === null ? 0 : ((performance.now() - this.since) / 1000) * this.rate;
      return Math.min(count, this.base + run);
    },
    set(time) {
      const at = Math.min(count, Math.max(0, time));
      if (this.loading !== null) this.loading = at;
      else if (this.stems) this.stems.set(at);
      else if (!this.silent) sound.currentTime = at;
      this.base = at;
      if (this.since !== null) this.since = performance.now();
    },
    start() {
      if (this.loading !== null) return Promise.resolve();
      if (this.stems) return this.stems.start();
      if (!this.silent) return sound.play();
      this.since = performance.now();
      return Promise.resolve();
    },
    stop() {
      this.base = this.now();
      this.since = null;
      this.stems?.stop();
      if (!this.silent) sound.pause();
    },
    speed(rate) {
      this.base = this.now();
      if (this.since !== null) this.since = performance.now();
      this.rate = rate;
      this.stems?.speed(rate);
      if (sound) sound.playbackRate = rate;
    },
    // If the sound cannot be played, the pictures go on with the timer.
    mute() {
      if (this.silent) return;
      const at = Math.min(count, this.loading ?? (sound.currentTime || 0));
      this.silent = true;
      this.loading = null;
      this.base = at;
      if (state.playing) this.since = performance.now();
      draw();
    },
    // From here on, the stems are heard instead of the whole track, at the same time.
    use(stems) {
      const at = this.now();
      this.stems?.close();
      if (!this.silent) sound.pause();
      this.stems = stems;
      stems.rate = this.rate;
      stems.volume(sound ? sound.volume : 1);
      stems.set(at);
      if (state.playing) stems.start();
    },
    // The whole track again, at the same time.
    leave() {
      const at = this.now();
      this.stems?.close();
      this.stems = null;
      this.set(at);
      if (state.playing) this.start().catch(() => null);
    },
    // The whole track of another observation, at the same time.
    async change(address) {
      const at = this.now(), ticket = (this.ticket = (this.ticket ?? 0) + 1);
      this.stems?.close();
      this.stems = null;
      if (!sound) return;
      this.loading = at;
      this.silent = false;
      sound.src = address;
      sound.playbackRate = this.rate;
      sound.addEventListener("loadedmetadata", () => {
        if (ticket !== this.ticket || this.loading === null) return;
        sound.currentTime = this.loading;
        this.loading = null;
        if (state.playing) sound.play().catch(() => null);
      }, { once: true });
    },
  };

  // ---- cache of the pictures that are needed soon -------------------------------------------------------------
  const cache = new Map();
  const load = ([from, name]) => {
    const address = new URL(name, from).href;
    let entry = cache.get(address);
    if (entry) { cache.delete(address); cache.set(address, entry); return entry; }
    const image = new Image();
    image.src = address;
    // Decode in advance, too, so that drawing does not wait for it.
    entry = { image, done: image.decode().then(() => image, () => null) };
    cache.set(address, entry);
    while (cache.size > KEPT) cache.delete(cache.keys().next().value);
    return entry;
  };
  // After a jump, cancel the unfinished downloads of pictures that are no longer needed.
  const forget = (index) => {
    const keep = new Set(Object.values(needed(index)).filter(Boolean).map(([from, name]) => new URL(name, from).href));
    for (const [address, entry] of cache) {
      if (entry.image.complete || keep.has(address)) continue;
      entry.image.src = "";
      cache.delete(address);
    }
  };
  const submission = () => data.submissions.find((entry) => entry.number === state.submission);
  const predicted = (index) => Boolean(submission()?.frames.includes(data.frames[index].name));
  const needed = (index) => {
    const { name } = data.frames[index];
    const comparing = state.errors && predicted(index);
    return {
      frame: [home, `frames/${name}.webp`],
      mask: data.has.masks && (state.mask || comparing) ? [folder, `masks/${name}.png`] : null,
      instances: data.has.instances && state.instances ? [folder, `instances/${name}.png`] : null,
      prediction: predicted(index) ? [folder, `predictions/${state.submission}/${name}.png`] : null,
    };
  };

  // ---- drawing ------------------------------------------------------------------------------------------------
  const shown = Math.min(1, 1008 / Math.max(...data.size));
  screen.width = Math.max(1, Math.round(data.size[0] * shown));
  screen.height = Math.max(1, Math.round(data.size[1] * shown));
  screen.style.aspectRatio = `${screen.width} / ${screen.height}`;
  const sheet = () => { const c = document.createElement("canvas"); c.width = screen.width; c.height = screen.height; return c.getContext("2d"); };
  const first = sheet(), second = sheet();
  const W = screen.width, H = screen.height, LINE = Math.max(1.5, W / 380), WIDER = 1.5;
  const hatch = (() => {
    const tile = document.createElement("canvas"), side = Math.max(8, Math.round(W / 80));
    tile.width = tile.height = side;
    const brush = tile.getContext("2d");
    brush.fillStyle = MISSED;
    brush.globalAlpha = 0.35;
    brush.fillRect(0, 0, side, side);
    brush.globalAlpha = 1;
    brush.strokeStyle = MISSED;
    brush.lineWidth = side * 0.42;
    for (const shift of [-side, 0, side]) { brush.beginPath(); brush.moveTo(shift - 2, side + 2); brush.lineTo(shift + side + 2, -2); brush.stroke(); }
    return pen.createPattern(tile, "repeat");
  })();
  const wipe = (context) => { context.globalCompositeOperation = "source-over"; context.clearRect(0, 0, W, H); };
  const paint = (context, operation, image) => { context.globalCompositeOperation = operation; context.drawImage(image, 0, 0, W, H); };
  const fill = (context, colour) => { context.globalCompositeOperation = "source-in"; context.fillStyle = colour; context.fillRect(0, 0, W, H); };
  // The part of one mask inside (or outside) another, in one colour.
  const area = (mask, colour, other = null, inside = true) => {
    wipe(first);
    paint(first, "source-over", mask);
    if (other) paint(first, inside ? "destination-in" : "destination-out", other);
    fill(first, colour);
    return first.canvas;
  };
  const coloured = (mask) => { wipe(first); paint(first, "source-over", mask); return first.canvas; };
  const ring = (mask, width) => {
    wipe(second);
    for (let i = 0; i < 8; i += 1) {
      const angle = (i * Math.PI) / 4;
      second.drawImage(mask, width * Math.cos(angle), width * Math.sin(angle), W, H);
    }
    paint(second, "destination-out", mask);
  };
  // Without a colour, the outline has that of the mask itself.
  const outline = (mask, colour) => {
    for (const [width, ink, alpha] of [[2 * LINE, "#000", 0.55], [LINE, colour, 1]]) {
      ring(mask, colour ? width : WIDER * width);
      if (ink) fill(second, ink);
      pen.globalAlpha = alpha;
      pen.drawImage(second.canvas, 0, 0);
    }
    pen.globalAlpha = 1;
  };
  const lay = (canvas, alpha) => { pen.globalAlpha = alpha; pen.drawImage(canvas, 0, 0); pen.globalAlpha = 1; };
  const muted = () => {
    pen.globalCompositeOperation = "saturation";
    pen.fillStyle = "hsl(0 0% 50%)";
    pen.fillRect(0, 0, W, H);
    pen.globalCompositeOperation = "source-over";
    pen.fillStyle = "rgba(24,24,28,.28)";
    pen.fillRect(0, 0, W, H);
  };

  const draw = async () => {
    const index = state.index, ticket = ++state.wanted, addresses = needed(index);
    const names = Object.keys(addresses);
    const images = await Promise.all(names.map((name) => (addresses[name] ? load(addresses[name]).done : null)));
    // Pictures may arrive late and out of order. A late one is drawn unless a newer one is already shown, or a jump or
    // a change of layers came after its request.
    if (ticket < state.drawn || ticket < state.floor) return;
    state.drawn = ticket;
    const got = Object.fromEntries(names.map((name, i) => [name, images[i]]));
    pen.globalCompositeOperation = "source-over";
    pen.globalAlpha = 1;
    pen.imageSmoothingQuality = "high";
    if (got.frame) pen.drawImage(got.frame, 0, 0, W, H);
    else { pen.fillStyle = "#333"; pen.fillRect(0, 0, W, H); }
    if (got.instances) lay(got.instances, 0.5);
    if (got.prediction && state.errors && got.mask) {
      muted();
      lay(area(got.prediction, HIT, got.mask), 0.78);
      lay(area(got.prediction, FALSE, got.mask, false), 0.82);
      lay(area(got.mask, hatch, got.prediction, false), 0.95);
      outline(got.mask, "#fff");
    } else {
      if (got.mask && data.scene) { lay(coloured(got.mask), 0.34); outline(got.mask, null); }
      else if (got.mask) { lay(area(got.mask, TRUTH), 0.34); outline(got.mask, "#fff"); }
      if (got.prediction) { lay(area(got.prediction, MARKED), 0.45); outline(got.prediction, MARKED); }
    }
    const failed = names.filter((name) => addresses[name] && !got[name]);
    tell(failed.length ? `${failed.map((name) => addresses[name][1]).join(", ")} cannot be shown`
      : state.submission && !predicted(index) ? (data.frames[index].split === "test" ? "The submission has no mask for this frame." : "Train frame: submissions mark test frames only.")
      : clock.silent && sound ? "The sound cannot be played in this browser; the pictures are shown without it." : "");
    screen.dataset.frame = data.frames[index].name;
    screen.dataset.layers = names.filter((name) => got[name]).join(" ");
    // Preload only after the current frame is drawn.
    const ahead = state.playing ? AHEAD : 1;
    for (let i = 1; i <= ahead && index + i < count; i += 1) Object.values(needed(index + i)).filter(Boolean).forEach(load);
  };

  // ---- values beside the picture ------------------------------------------------------------------------------
  const tell = (line) => { say.textContent = line; say.hidden = !line; };
  const clockText = (time) => `${Math.floor(time / 60)}:${String(Math.floor(time % 60)).padStart(2, "0")}`;
  const signed = (value, digits) => `${value > 0 ? "+" : value < 0 ? "−" : ""}${Math.abs(value).toFixed(digits)}`;
  const side = (azimuth) => {
    const off = Math.abs(azimuth), hand = azimuth < 0 ? "left" : "right";
    return off <= 10 ? "ahead" : off >= 170 ? "behind" : off > 100 ? `behind, ${hand}` : hand;
  };
  const share = (pixels) => {
    const percent = (100 * pixels) / (data.size[0] * data.size[1]);
    return percent < 0.1 ? "< 0.1 %" : `${percent.toFixed(percent < 10 ? 1 : 0)} %`;
  };
  const readout = by("readout");
  const audible = (index) => data.scene.sources.filter((source) => source.audible[index]);
  const heardCell = () => {
    const { length } = data.scene.sources, now = audible(state.index).length;
    return now ? [`${now} of ${length}`, now === 1 ? audible(state.index)[0].name : "sources"] : ["none", length ? `of ${length} source${length > 1 ? "s" : ""}` : data.scene.nothing];
  };
  readout.classList.toggle("of-scene", Boolean(data.scene));
  const cells = [
    ...(data.scene ? [["Audible", heardCell]] : []),
    ["Azimuth", (f) => (f.azimuth === undefined ? null : [`${signed(f.azimuth, 0)}°`, side(f.azimuth)])],
    ["ILD", (f) => (f.ild === undefined ? null : [`${signed(f.ild, 1)} dB`, Math.abs(f.ild) < 0.5 ? "even" : `louder ${f.ild > 0 ? "right" : "left"}`])],
    ["Distance", (f) => (f.distance === undefined ? null : [`${f.distance.toFixed(1)} m`, f.sight === false ? "no line of sight" : "line of sight"])],
    ["Level", (f) => (f.level === undefined ? null : [`${signed(f.level, 0)} dB`, "re full scale"])],
    ["In view", (f) => (f.pixels === undefined ? null : [f.pixels ? share(f.pixels) : "no", f.pixels ? `${f.pixels.toLocaleString("en")} px` : "\u00a0"])],
  ].map(([label, value]) => {
    const cell = document.createElement("div"), name = document.createElement("small"), big = document.createElement("b"), more = document.createElement("span");
    name.textContent = label;
    cell.append(name, big, more);
    readout.append(cell);
    return (frame) => { const found = value(frame); cell.hidden = !found; if (found) [big.textContent, more.textContent] = found; };
  });

  // ---- play and seek ------------------------------------------------------------------------------------------
  const seekFrame = (index) => { clock.set(Math.min(count - 1, Math.max(0, index)) + 0.001); sync(); };
  const floorMap = new window.AVS3D.FloorMap(by("map"), data, seekFrame);
  const plots = window.AVS3D.plots(by("plots"), data, seekFrame);
  const lanes = data.scene ? new window.AVS3D.Lanes(by("lanes"), data, { seek: seekFrame, choose: (on) => listen(on) }) : null;
  const buttons = [...document.querySelectorAll(".submission")];

  const sync = () => {
    const time = clock.now(), index = Math.min(count - 1, Math.floor(time));
    by("time").textContent = clockText(time);
    if (document.activeElement !== scrub || !scrub.matches(":active")) scrub.value = time;
    scrub.style.setProperty("--at", `${(100 * time) / count}%`);
    plots.forEach((plot) => plot.show(index, time));
    lanes?.show(index, time);
    if (index !== state.index) {
      if (state.index >= 0 && (index < state.index || index > state.index + AHEAD)) {
        state.floor = state.wanted + 1;
        forget(index);
      }
      state.index = index;
      const frame = data.frames[index];
      stage.dataset.index = index;
      by("frame-name").textContent = frame.name;
      const tag = by("frame-split");
      tag.textContent = frame.split ?? "in no split";
      tag.dataset.split = frame.split ?? "";
      scrub.setAttribute("aria-valuetext", `${frame.name}, ${clockText(time)} of ${clockText(count)}`);
      screen.setAttribute("aria-label", `Camera frame ${index + 1} of ${count}`);
      cells.forEach((cell) => cell(frame));
      floorMap.show(index);
      const full = by("full");
      if (full) full.href = `full/${frame.name}.png`;
      describe();
      draw();
    }
  };
  const describe = () => {
    const { name } = data.frames[state.index];
    for (const button of buttons) {
      const entry = data.submissions.find((s) => s.number === Number(button.dataset.number));
      const iou = entry.iou[name];
      button.querySelector("small").textContent = iou === undefined || iou === null ? "" : `IoU ${iou.toFixed(2)}`;
      explain(button, "why-submissions", entry.frames.includes(name) ? "" : absence(data.frames[state.index]));
    }
    const absent = buttons.some((button) => button.classList.contains("absent-here"));
    by("why-submissions")?.classList.toggle("off", !absent);
    if (absent) by("why-text").textContent = absence(data.frames[state.index]);
  };
  // A grey button says why, to the eye, to the mouse and to a screen reader.
  const absence = (frame) => (frame.split === "test" ? "Grey: the submission has no mask for this frame." : "Grey: this is a train frame; submissions have masks for test frames only.");
  const explain = (button, note, why) => {
    button.classList.toggle("absent-here", Boolean(why));
    if (why) { button.title = why; button.setAttribute("aria-describedby", note); }
    else { button.removeAttribute("title"); button.removeAttribute("aria-describedby"); }
  };
  const explainLayers = () => {
    const off = ["mask", "instances", "errors"].filter((name) => by(name)?.disabled);
    const missing = [...new Set(off.map((name) => (name === "instances" ? "instance masks" : "masks of the truth")))];
    const why = missing.length ? `Grey: the observation has no ${missing.join(" and no ")}.` : "";
    for (const name of ["mask", "instances", "errors"]) if (by(name)) explain(by(name), "why-layers", by(name).disabled ? why : "");
    by("why-layers").textContent = why;
    by("why-layers").hidden = !why;
  };
  const tick = () => {
    if (!state.playing) return;
    sync();
    if ((clock.silent || clock.stems) && clock.now() >= count) { pause(); return; }
    next();
  };
  // Only one loop runs, even after a quick stop and start.
  const next = () => { cancelAnimationFrame(state.loop); state.loop = requestAnimationFrame(tick); };
  const face = () => {
    stage.classList.toggle("playing", state.playing);
    by("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
  };
  const play = async () => {
    if (clock.now() >= count - 0.02) clock.set(0);
    state.playing = true;
    face();
    try { await clock.start(); } catch (error) {
      if (error.name === "NotSupportedError") clock.mute();
      else if (error.name !== "AbortError") { pause(); return; }
    }
    next();
  };
  const pause = () => { state.playing = false; clock.stop(); face(); sync(); };
  const toggle = () => (state.playing ? pause() : play());

  // ---- layers -------------------------------------------------------------------------------------------------
  const legend = by("legend");
  const press = () => {
    for (const name of ["mask", "instances", "errors"]) by(name)?.setAttribute("aria-pressed", String(state[name]));
    for (const button of buttons) button.setAttribute("aria-pressed", String(Number(button.dataset.number) === state.submission));
    showHead();
    const rows = [];
    if (state.instances && data.has.instances) for (const thing of data.instances) rows.push([thing.colour, `${thing.name}${thing.sounding ? ", sounds" : thing.twin ? ", silent twin" : ""}`]);
    if (state.mask && data.scene && !state.instances && !(state.errors && state.submission)) for (const source of data.scene.sources) if (!source.room) rows.push([source.colour, `truth: ${source.name}`]);
    if (state.errors && state.submission) rows.push([HIT, "hit"], [MISSED, "missed (hatched)"], [FALSE, "false positive"]);
    else {
      if (state.mask && data.has.masks && !data.scene) rows.push([TRUTH, "truth, white outline"]);
      if (state.submission) rows.push([MARKED, submission().name]);
    }
    legend.replaceChildren(...rows.map(([colour, label]) => {
      const row = document.createElement("li"), dot = document.createElement("i");
      dot.style.background = colour;
      row.append(dot, label);
      return row;
    }));
    legend.hidden = !rows.length;
    state.floor = state.wanted + 1;
    draw();
  };
  const flip = (name) => {
    if (by(name)?.disabled ?? true) return;
    state[name] = !state[name];
    // Errors are shown for a submission, so one must be selected.
    if (name === "errors" && state.errors && !state.submission) choose(1);
    else press();
  };
  const choose = (number) => {
    if (number && !data.submissions.some((entry) => entry.number === number)) return;
    state.submission = state.submission === number ? 0 : number;
    if (!state.submission) state.errors = false;
    // Submissions have masks for test frames only: go to the nearest one.
    if (state.submission && !state.playing && !predicted(state.index)) {
      const found = data.frames.map((_, i) => i).filter(predicted).sort((a, b) => Math.abs(a - state.index) - Math.abs(b - state.index));
      if (found.length) seekFrame(found[0]);
    }
    press();
  };
  const nextTest = (step) => {
    for (let i = state.index + step; i >= 0 && i < count; i += step) if (data.frames[i].split === "test") { seekFrame(i); return true; }
    return false;
  };

  // ---- the head that turns: ambisonics instead of the binaural track ---------------------------------------------
  const look = by("look");
  let opening = null;
  const turning = () => Boolean(clock.stems?.turn);
  const showHead = () => {
    if (!look) return;
    const degrees = Number(look.value);
    by("head").setAttribute("aria-pressed", String(turning()));
    look.disabled = !turning();
    by("look-value").textContent = degrees ? `${Math.abs(degrees)}° ${degrees < 0 ? "left" : "right"}` : "ahead";
    stage.dataset.head = turning() ? degrees : "";
  };
  const turnHead = async () => {
    if (!look || opening) return;
    const { key } = data;
    if (turning()) { clock.leave(); showHead(); return; }
    opening = key;
    tell("Loading the ambisonics …");
    try {
      const head = await window.AVS3D.HeadPlayer.open(folder, key, ["ambisonics"], data.head.gain);
      if (data.key !== key) head.close();
      else {
        lanes?.clear();
        delete stage.dataset.stems;
        clock.use(head);
        head.turn(Number(look.value));
        tell("");
      }
    } catch (error) {
      tell(`The ambisonics cannot be played: ${error.message}`);
    } finally { opening = null; }
    showHead();
  };

  // ---- part_3 observations: stems, and siblings of the group -----------------------------------------------------------
  const listen = async (on) => {
    const { key, scene } = data;
    if (clock.stems && !turning()) { clock.stems.choose(on); return; }
    if (opening) return; // the choice is read again when they are there
    opening = key;
    tell("Loading the stems …");
    try {
      const names = [...scene.sources.map((source) => source.id), ...(scene.background ? [scene.background.id] : [])];
      const stems = await window.AVS3D.StemPlayer.open(folder, key, names, scene.gain);
      if (data.key !== key) stems.close();
      else {
        clock.use(stems);
        stems.choose((name) => lanes.on(name));
        stage.dataset.stems = key;
        showHead();
        tell("");
      }
    } catch (error) {
      if (data.key === key) lanes.clear();
      tell(`The stems cannot be played: ${error.message}`);
    } finally { opening = null; }
    // Another sibling is shown since, and a choice was made there.
    if (data.key !== key && lanes.chosen) listen((name) => lanes.on(name));
  };
  const swap = (payload, where) => {
    const other = payload.data;
    if (other.frames.length !== count || String(other.size) !== String(data.size)) return false;
    for (const name of Object.keys(data)) delete data[name];
    Object.assign(data, other);
    folder = where;
    delete stage.dataset.stems;
    by("heading").textContent = payload.heading;
    by("key").textContent = data.key;
    document.title = `${payload.heading} · ${data.key}`;
    by("facts").innerHTML = payload.facts;
    window.dispatchEvent(new CustomEvent("avs3d:tables"));
    document.querySelector(".bar nav").outerHTML = payload.nav;
    for (const [name, there] of [["mask", data.has.masks], ["instances", data.has.instances], ["errors", data.has.masks]]) if (by(name)) by(name).disabled = !there;
    explainLayers();
    clock.change(new URL("sound.flac", folder).href);
    floorMap.renew(payload.map);
    plots.forEach((plot) => plot.renew());
    lanes.build();
    drawStrip();
    state.index = -1;
    sync();
    press();
    return true;
  };
  const siblings = by("siblings") ? new window.AVS3D.Siblings(by("siblings"), home, swap) : null;

  // ---- strip below the picture: frames with the object in view, and test frames -------------------------------
  const drawStrip = () => {
    const style = getComputedStyle(document.documentElement), ratio = window.devicePixelRatio || 1;
    const width = strip.clientWidth, height = strip.clientHeight;
    if (!width) return;
    strip.width = Math.round(width * ratio);
    strip.height = Math.round(height * ratio);
    const brush = strip.getContext("2d");
    brush.scale(ratio, ratio);
    const step = width / count, most = Math.max(1, ...data.frames.map((frame) => frame.pixels ?? 0));
    data.frames.forEach((frame, i) => {
      brush.fillStyle = style.getPropertyValue(frame.split === "test" ? "--ink" : "--line");
      brush.fillRect(i * step, height - 3, Math.max(1, step - 1), 3);
      if (!frame.pixels) return;
      const tall = (height - 6) * (0.15 + 0.85 * Math.sqrt(frame.pixels / most));
      brush.fillStyle = style.getPropertyValue("--warm");
      brush.fillRect(i * step, height - 5 - tall, Math.max(1, step - 1), tall);
    });
  };

  // ---- mouse and keyboard -------------------------------------------------------------------------------------
  by("duration").textContent = clockText(count);
  by("play").addEventListener("click", toggle);
  screen.addEventListener("click", toggle);
  document.querySelectorAll("[data-step]").forEach((button) => button.addEventListener("click", () => seekFrame(state.index + Number(button.dataset.step))));
  scrub.addEventListener("input", () => { clock.set(Number(scrub.value)); sync(); });
  by("rate").addEventListener("change", (event) => clock.speed(Number(event.target.value)));
  by("volume")?.addEventListener("input", (event) => { if (sound) sound.volume = Number(event.target.value); clock.stems?.volume(Number(event.target.value)); });
  by("head")?.addEventListener("click", turnHead);
  look?.addEventListener("input", () => { clock.stems?.turn?.(Number(look.value)); showHead(); });
  for (const name of ["mask", "instances", "errors"]) by(name)?.addEventListener("click", () => flip(name));
  buttons.forEach((button) => button.addEventListener("click", () => choose(Number(button.dataset.number))));
  if (sound) {
    sound.addEventListener("ended", () => { if (!clock.stems) pause(); });
    sound.addEventListener("error", () => clock.mute());
    sound.addEventListener("seeked", sync);
    // Something else, such as a media key, may have stopped it.
    sound.addEventListener("pause", () => { if (state.playing && sound.paused && !clock.silent && !clock.stems && clock.loading === null && !sound.ended) pause(); });
  }
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const target = event.target, key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (target.matches("input:not([type=range]), select, textarea") || ((target === by("volume") || target === look) && key !== " ") || (target.matches(".scroll") && key.startsWith("Arrow"))) return;
    const far = event.shiftKey ? 10 : 1;
    const actions = {
      " ": () => (target.matches("button, a, summary") ? null : (toggle(), true)),
      ArrowLeft: () => (seekFrame(state.index - far), true),
      ArrowRight: () => (seekFrame(state.index + far), true),
      Home: () => (seekFrame(0), true),
      End: () => (seekFrame(count - 1), true),
      m: () => (flip("mask"), true),
      i: () => (flip("instances"), true),
      e: () => (flip("errors"), true),
      h: () => (turnHead(), true),
      t: () => (nextTest(event.shiftKey ? -1 : 1), true),
      g: () => (siblings ? (siblings.step(event.shiftKey ? -1 : 1), true) : false),
      0: () => (state.submission && choose(state.submission), true),
    };
    const done = /^[1-9]$/.test(key) ? (choose(Number(key)), true) : actions[key]?.();
    if (done) event.preventDefault();
  });
  new ResizeObserver(drawStrip).observe(strip);
  window.addEventListener("avs3d:theme", drawStrip);

  // The URL may name a frame: …#frame_007.
  const linked = () => { const at = data.frames.findIndex((frame) => `#${frame.name}` === location.hash); if (at >= 0) seekFrame(at); return at >= 0; };
  window.addEventListener("hashchange", linked);
  by("next-test")?.addEventListener("click", () => { if (!nextTest(1)) nextTest(-1); });
  explainLayers();
  if (!linked()) seekFrame(data.open);
  press();
})();
