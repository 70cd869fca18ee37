"use strict";
// First-order ambisonics (ACN, SN3D: W, Y, Z, X; x ahead, y left) as two ears of a rigid sphere hear them, with a head
// that turns about the vertical axis. `earFilters` are those of W and Y for an ear at the left; see filters.js.
window.AVS3D = window.AVS3D ?? {};
(() => {
  const FADE = 0.05; // of a turn (s): no click

  // The new Y for a head that looks at an azimuth (degrees, positive right): its shares of the old X and Y. What was at
  // the left (Y = 1, X = 0) is straight ahead (Y = 0) after a turn to −90°.
  window.AVS3D.turned = (degrees) => {
    const angle = (degrees * Math.PI) / 180;
    return { x: Math.sin(angle), y: Math.cos(angle) };
  };

  class HeadPlayer extends window.AVS3D.StemPlayer {
    // The only stem is the ambisonics.
    route(stem) {
      const { context } = this, gain = (value) => new GainNode(context, { gain: value });
      Object.assign(stem.gate, { channelCount: 4, channelCountMode: "explicit", channelInterpretation: "discrete" });
      const [pressure, left] = window.AVS3D.earFilters.map((taps) => {
        const buffer = new AudioBuffer({ length: taps.length, numberOfChannels: 1, sampleRate: context.sampleRate });
        buffer.copyToChannel(Float32Array.from(taps), 0);
        return new ConvolverNode(context, { buffer, disableNormalization: true });
      });
      const split = new ChannelSplitterNode(context, { numberOfOutputs: 4 });
      const ears = new ChannelMergerNode(context, { numberOfInputs: 2 });
      this.shares = { x: gain(0), y: gain(1) };
      stem.gate.connect(split);
      split.connect(pressure, 0);
      split.connect(this.shares.y, 1).connect(left);
      split.connect(this.shares.x, 3).connect(left);
      pressure.connect(ears, 0, 0);
      pressure.connect(ears, 0, 1);
      left.connect(ears, 0, 0);
      left.connect(gain(-1)).connect(ears, 0, 1);
      ears.connect(this.master);
    }

    turn(degrees) {
      const found = window.AVS3D.turned(degrees), at = this.context.currentTime;
      for (const name of ["x", "y"]) this.shares[name].gain.setTargetAtTime(found[name], at, FADE / 3);
    }
  }
  window.AVS3D.HeadPlayer = HeadPlayer;
})();
