"""What two ears hear of an object in a scene, with the engines, signals and levels of datasets."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import soundfile
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.errors import UsageError, excerpt
from avs3d_bench.formats.files import atomic_path
from avs3d_bench.geometry import Pose
from generators.acoustics.clips import receiver_clip
from generators.backends import acoustic_backend
from generators.core.seeds import random_numbers
from generators.options import EngineOptions

if TYPE_CHECKING:
    from generators.options import Audio
    from generators.scenes.placed import PlacedScene


@dataclass(frozen=True, eq=False)
class HeardSound:
    """The sound of an object as two ears hear it; a notebook shows it as a player.

    Attributes:
        samples: (2, n) float32 sound pressure, full scale 1; channel 0 is left.
        response: (2, m) float32 binaural room impulse response.
        sample_rate: of both, Hz.
    """

    samples: NDArray[np.float32]
    response: NDArray[np.float32]
    sample_rate: int = SAMPLE_RATE

    def __repr__(self) -> str:
        left, right = (f"{20 * np.log10(max(float(np.sqrt(np.mean(one**2))), 1e-12)):.0f}" for one in self.samples)
        seconds = self.samples.shape[1] / self.sample_rate
        return f"<HeardSound {seconds:g} s at {self.sample_rate} Hz, RMS left {left} dBFS, right {right} dBFS>"

    def save(self, path: str | Path) -> Path:
        """Write the clip as a WAV file of 32-bit floats, or FLAC, by the name's end; return its path."""
        target = Path(path)
        kind = target.suffix[1:].upper()
        with atomic_path(target) as file:
            subtype = "FLOAT" if kind == "WAV" else None
            soundfile.write(file, self.samples.T, self.sample_rate, format=kind, subtype=subtype)
        return target

    def _repr_html_(self) -> str:
        file = io.BytesIO()
        soundfile.write(file, self.samples.T, self.sample_rate, format="FLAC", subtype="PCM_16")
        return f'<audio controls src="data:audio/flac;base64,{base64.b64encode(file.getvalue()).decode()}"></audio>'


def hear(
    scene: PlacedScene,
    listener: Pose,
    sounding: int = 1,
    signal: NDArray[np.floating] | None = None,
    *,
    seconds: int = 3,
    audio: Audio | None = None,
    rng: np.random.Generator | int = 0,
) -> HeardSound:
    """What two ears at ``listener`` hear of a placed object.

    Args:
        scene: with the object, at time 0.
        listener: position (m) and orientation of the head; channel 0 is its left ear.
        sounding: id of the object; it sounds at its ``source_position``, and its own body is not in the way.
        signal: (n,) mono at 44,100 Hz, full scale 1; None: the synthesised sound of the object's category.
        seconds: length of the synthesised sound.
        audio: tracer, soundspaces or analytic; None: the tracer.
        rng: random numbers of the synthesised sound, or their seed.

    Returns:
        As long as the signal, at the level that clips of datasets have: later sound is cut off.

    Raises:
        UsageError: if no object has that id, or the signal is not mono.
        Avs3dError: if the engine is not installed, or listener or source is outside of the home.
    """
    placed = scene.placement(sounding)
    if not isinstance(listener, Pose):
        raise UsageError(f"hear: listener {excerpt(listener)}; expected avs3d_bench.geometry.Pose")
    if signal is None:
        from generators.assets.sounds import synthesise

        signal = synthesise(placed.model.category, seconds, random_numbers(rng))
    samples = np.asarray(signal, dtype=np.float32)
    if samples.ndim != 1 or not len(samples):
        raise UsageError(f"hear: a signal of shape {samples.shape}; expected mono samples (n,) at {SAMPLE_RATE} Hz")
    engine = acoustic_backend(EngineOptions(audio=audio))
    session = engine.open(
        scene.acoustic_scene, placed.source_position, room=placed.support.room, sample_rate=SAMPLE_RATE
    )
    try:
        response = session.impulse_response(listener)
    finally:
        session.close()
    first = np.pad(samples, (0, max(0, SAMPLE_RATE - len(samples))))
    heard = receiver_clip(first, response, 0, tail=max(0, len(samples) - SAMPLE_RATE))
    return HeardSound(heard[:, : len(samples)], response)
