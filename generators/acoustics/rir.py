"""A room impulse response with what made it, and the figures that acousticians read off it."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import UsageError
from avs3d_bench.formats.atomic import atomic_path
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import EARLY, SPEED_OF_SOUND, energy_ratio_db, fit_decay, octave_filtered
from avs3d_bench.runtime.imports import needing
from generators.acoustics.direct import AFTER, BEFORE
from generators.acoustics.materials import OCTAVE_BANDS

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import Scalar
    from generators.acoustics.tracer.arrivals import Arrivals

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rir:
    """The response of a room from a source to a receiver.

    Figures are given per octave as a dict {centre in Hz: value}, of the octaves 125 Hz to 4 kHz that lie below the
    Nyquist frequency. The energies of all channels are added up first.

    Attributes:
        samples: (channels, n) float32; amplitude 1 at 1 m in the free field, time 0 is the emission.
        sample_rate: Hz.
        channel_names: one per channel; of two ears, left comes first.
        source: (x, y, z) metres.
        listener: pose of the receiver; it faces −Z of its axes.
        receiver: settings of the receiver.
        provenance: settings of the engine, its version, the room.
        arrivals: times, directions and octave amplitudes of all that arrives, of `Tracer.response`; else None.

    Examples:
        >>> from generators.acoustics import Analytic, Room
        >>> rir = Analytic().response(Room.shoebox((6, 2.7, 4), 0.2), (1, 1.5, 2), (4, 1.5, 2))
        >>> sorted(rir.t30()), 0.2 < rir.t30()[1000] < 0.6
        ([125, 250, 500, 1000, 2000, 4000], True)
    """

    samples: NDArray[np.float32]
    sample_rate: int
    channel_names: tuple[str, ...]
    source: tuple[float, float, float]
    listener: Pose
    receiver: dict[str, Scalar] = field(default_factory=dict)
    provenance: dict[str, Scalar] = field(default_factory=dict)
    arrivals: Arrivals | None = None

    @property
    def octaves(self) -> tuple[int, ...]:
        """Centres (Hz) of the octaves of all figures."""
        return tuple(int(f) for f in OCTAVE_BANDS if f * math.sqrt(2) < 0.49 * self.sample_rate)

    @property
    def distance(self) -> float:
        """From the source to the listener, m."""
        return math.dist(self.source, self.listener.position)

    def t30(self) -> dict[int, float | None]:
        """Reverberation time T30 in s (ISO 3382-1), from −5 to −35 dB; None where the response falls by less."""
        return {octave: fit_decay(self._remaining(octave), self.sample_rate) for octave in self.octaves}

    def edt(self) -> dict[int, float | None]:
        """Early decay time in s (ISO 3382-1), from 0 to −10 dB; None where it cannot be measured."""
        first = min(round(self.distance / SPEED_OF_SOUND * self.sample_rate), self.samples.shape[1] - 1)
        remaining = {octave: self._remaining(octave)[first:] for octave in self.octaves}
        return {octave: fit_decay(each, self.sample_rate, 0.0, -10.0) for octave, each in remaining.items()}

    def c50(self) -> dict[int, float]:
        """Clarity C50 in dB (ISO 3382-1): energy of the first 50 ms after the direct sound over the rest."""
        last = math.ceil((self.distance / SPEED_OF_SOUND + EARLY) * self.sample_rate)
        return self._ratio(self._pieces(0, last))

    def drr(self) -> dict[int, float]:
        """Direct-to-reverberant ratio in dB: 0.5 ms before the direct sound to 2 ms after it, over all that follows.

        −inf where nothing but reverberation arrives, inf in the free field.
        """
        arrival = self.distance / SPEED_OF_SOUND
        first, last = ((arrival + offset) * self.sample_rate for offset in (-BEFORE, AFTER))
        return self._ratio(self._pieces(max(math.floor(first), 0), math.ceil(last)))

    def energy_decay(self, octave: int | None = None) -> F64:
        """Schroeder's decay curve (n,) in dB below the whole energy, −inf after the end.

        Args:
            octave: centre in Hz; None: all frequencies.

        Raises:
            UsageError: for an octave that is none of `octaves`.
        """
        if octave is not None and octave not in self.octaves:
            raise UsageError(f"energy_decay: octave is {octave!r}, expected one of {', '.join(map(str, self.octaves))}")
        remaining = self._remaining(octave)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(10 * np.log10(np.maximum(remaining / remaining[0], 0.0)))

    def __repr__(self) -> str:
        channels, count = self.samples.shape
        return (
            f"Rir({channels} channels, {count / self.sample_rate:.2f} s at {self.sample_rate} Hz, "
            f"{self.distance:.2f} m, {self.provenance.get('backend', 'unknown engine')})"
        )

    def plot(self, axes: Any = None) -> Any:
        """Draw the waveform of each channel and the decay curves of the octaves.

        Args:
            axes: two matplotlib axes; None: a new figure.

        Returns:
            the figure.
        """
        with needing("Rir.plot", "pip install 'avs3d-bench[plot]'"):
            import matplotlib.pyplot as plt
        if axes is None:
            _, axes = plt.subplots(1, 2, figsize=(10, 3.5), layout="constrained")
        wave, decay = axes
        seconds = np.arange(self.samples.shape[1]) / self.sample_rate
        for name, channel in zip(self.channel_names, self.samples, strict=True):
            wave.plot(seconds, channel, linewidth=0.6, label=name)
        wave.set(xlabel="time (s)", ylabel="amplitude (1 at 1 m)")
        wave.legend()
        for octave in self.octaves:
            decay.plot(seconds, self.energy_decay(octave), linewidth=0.9, label=f"{octave} Hz")
        decay.set(xlabel="time (s)", ylabel="energy that remains (dB)", ylim=(-70, 3))
        decay.legend()
        return wave.figure

    def save(self, path: str | Path) -> Path:
        """Write the response: ``.wav`` (32-bit float), ``.sofa`` (SingleRoomMIMOSRIR) or ``.npz`` (with the arrivals).

        The file is there as a whole or not at all.

        Raises:
            UsageError: for another ending.
            Avs3dError: if the file cannot be written, or sofar is missing for SOFA.
        """
        path = Path(path)
        writers = {".wav": self._save_wav, ".sofa": self._save_sofa, ".npz": self._save_npz}
        if path.suffix.lower() not in writers:
            raise UsageError(f"{path}: unknown ending {path.suffix!r}; expected {', '.join(writers)}")
        with atomic_path(path) as temporary:
            writers[path.suffix.lower()](temporary)
        return path

    def metadata(self) -> dict[str, Any]:
        """Source, listener, channels and provenance as plain values for JSON."""
        return {
            "sample_rate": self.sample_rate,
            "channels": list(self.channel_names),
            "source": list(self.source),
            "listener": {"position": list(self.listener.position), "rotation": list(self.listener.rotation)},
            "receiver": dict(self.receiver),
            "provenance": dict(self.provenance),
        }

    def _save_wav(self, path: Path) -> None:
        import soundfile

        with path.open("wb") as stream:
            soundfile.write(stream, self.samples.T, self.sample_rate, format="WAV", subtype="FLOAT")

    def _save_npz(self, path: Path) -> None:
        arrays: dict[str, Any] = {"samples": self.samples, "metadata": json.dumps(self.metadata())}
        if self.arrivals is not None:
            parts = ("time", "direction", "pressure")
            arrays |= {f"arrival_{part}": getattr(self.arrivals, part) for part in parts}
        with path.open("wb") as stream:  # given a name, numpy would add its ending
            np.savez_compressed(stream, **arrays)

    def _save_sofa(self, path: Path) -> None:
        """AES69: cartesian metres, X forward, Y left, Z up; the listener looks along +X of its own axes."""
        with needing("Rir.save as a SOFA file", "pip install sofar"):
            import sofar
        turn = self.listener.rotation_matrix
        file = sofar.Sofa("SingleRoomMIMOSRIR")
        for name in ("ReceiverDescriptions", "EmitterDescriptions"):  # sofar 1.3 cannot write them with netCDF4 1.7.5
            file.delete(name)
        file.GLOBAL_Title, file.GLOBAL_RoomType = "avs3d-bench room impulse response", "reverberant"
        file.GLOBAL_RoomDescription = str(self.provenance.get("room", "a room"))
        file.GLOBAL_Comment = json.dumps(self.metadata())
        file.Data_IR = self.samples[None, :, :, None].astype(np.float64)
        file.Data_SamplingRate, file.Data_Delay = float(self.sample_rate), np.zeros((1, len(self.samples), 1))
        file.ListenerPosition, file.SourcePosition = _sofa_axes([self.listener.position]), _sofa_axes([self.source])
        file.ListenerView, file.ListenerUp = _sofa_axes([-turn[:, 2]]), _sofa_axes([turn[:, 1]])
        each = (len(self.samples), 1)
        file.ReceiverPosition = np.zeros((len(self.samples), 3, 1))
        file.ReceiverView, file.ReceiverUp = (np.tile(axis, each)[:, :, None] for axis in ([1.0, 0, 0], [0, 0, 1.0]))
        named = path.with_suffix(".sofa")  # sofar writes no other ending
        sofar.write_sofa(str(named), file)
        named.replace(path)

    def _remaining(self, octave: int | None) -> F64:
        """(n,) energy from each sample on, in an octave or at all frequencies."""
        sound = self.samples if octave is None else octave_filtered(self.samples, self.sample_rate, octave)
        energy = np.square(np.asarray(sound, dtype=np.float64)).sum(axis=0)
        before = (len(energy) - self.samples.shape[1]) // 2  # what the octave filter needs at each end
        return np.asarray(np.cumsum(energy[::-1])[::-1][before : before + self.samples.shape[1]])

    def _pieces(self, first: int, last: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The response from ``first`` to ``last``, and what comes after it."""
        early, late = self.samples.copy(), self.samples.copy()
        early[:, :first], early[:, last:] = 0.0, 0.0
        late[:, :last] = 0.0
        return early, late

    def _ratio(self, pieces: tuple[NDArray[np.float32], NDArray[np.float32]]) -> dict[int, float]:
        return {
            octave: energy_ratio_db(*(octave_filtered(piece, self.sample_rate, octave) for piece in pieces))
            for octave in self.octaves
        }


def _sofa_axes(vectors: Any) -> F64:
    """World vectors (n, 3) (Y up, −Z ahead) in the axes of SOFA (Z up, X ahead)."""
    x, y, z = np.asarray(vectors, dtype=np.float64).T
    return np.stack([-z, -x, y], axis=1)
