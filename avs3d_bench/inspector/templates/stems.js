"use strict";
// The stems of a part_3 observation: each source's own track, played at the same samples, each with its own gain. head.js
// plays the ambisonics in the same way, as the only stem.
window.AVS3D = window.AVS3D ?? {};
(() => {
  const RATE = 44100;
  // Length of the fade when a source is switched on or off (s): no click.
  const FADE = 0.015;
  // Time from the command to the first sample (s), so that all stems can be started at one moment of the audio clock.
  const AHEAD = 0.03;
  const waiting = new Map();

  // Called by the scripts stems/<name>.js and ambisonics.js; a page opened from disk may load scripts, but may not read other files.
  window.AVS3D.stem = (key, name, gain, data) => waiting.get(`${key}/${name}`)?.({ gain, data });

  const bytes = (base64) => {
    const text = atob(base64), out = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i += 1) out[i] = text.charCodeAt(i);
    return out.buffer;
  };
  const read = (folder, key, name) => new Promise((done, fail) => {
    const script = document.createElement("script"), file = name === "ambisonics" ? `${name}.js` : `stems/${name}.js`;
    const end = () => { waiting.delete(`${key}/${name}`); script.remove(); };
    waiting.set(`${key}/${name}`, (stem) => { end(); done(stem); });
    script.addEventListener("error", () => { end(); fail(new Error(`${file} cannot be loaded`)); });
    script.src = new URL(file, folder).href;
    document.head.append(script);
  });

  class StemPlayer {
    // All stems of an observation. `gain`: by how many dB the page's own track is louder than the files.
    static async open(folder, key, names, gain) {
      const context = new AudioContext({ sampleRate: RATE }), stems = new Map();
      try {
        await Promise.all(names.map(async (name) => {
          const stem = await read(folder, key, name);
          stems.set(name, { buffer: await context.decodeAudioData(bytes(stem.data)), scale: 10 ** ((gain - stem.gain) / 20) });
        }));
      } catch (error) {
        context.close();
        throw error;
      }
      return new this(context, stems);
    }

    constructor(context, stems) {
      Object.assign(this, { context, stems, rate: 1, base: 0, since: null });
      this.master = context.createGain();
      this.master.connect(context.destination);
      for (const stem of stems.values()) {
        stem.gate = context.createGain();
        stem.gate.gain.value = stem.scale;
        this.route(stem);
      }
    }

    // From the gain of a stem to what is heard.
    route(stem) { stem.gate.connect(this.master); }

    now() {
      if (this.since === null) return this.base;
      const run = this.context.currentTime - (this.context.outputLatency || 0) - this.since;
      return this.base + Math.max(0, run) * this.rate;
    }

    async start() {
      await this.context.resume();
      this.since = this.context.currentTime + AHEAD;
      for (const stem of this.stems.values()) {
        stem.node = new AudioBufferSourceNode(this.context, { buffer: stem.buffer, playbackRate: this.rate });
        stem.node.connect(stem.gate);
        // One moment and one offset for all: the stems stay at the same sample.
        stem.node.start(this.since, this.base);
      }
    }

    stop() {
      this.base = this.now();
      this.since = null;
      for (const stem of this.stems.values()) { stem.node?.stop(); stem.node?.disconnect(); stem.node = null; }
    }

    set(time) {
      const running = this.since !== null;
      this.stop();
      this.base = time;
      if (running) this.start();
    }

    speed(rate) {
      const running = this.since !== null;
      this.stop();
      this.rate = rate;
      if (running) this.start();
    }

    choose(on) {
      for (const [name, stem] of this.stems) stem.gate.gain.setTargetAtTime(on(name) ? stem.scale : 0, this.context.currentTime, FADE / 3);
    }

    volume(share) { this.master.gain.value = share; }

    close() { this.stop(); this.context.close(); }
  }
  window.AVS3D.StemPlayer = StemPlayer;
})();
