"""Levels, direct-to-reverberant ratio and decay of impulse responses; both engines with one listener without a head."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import octave_filtered, t30
from generators.acoustics.direct import AFTER, BEFORE
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.materials import OCTAVE_BANDS
from generators.acoustics.soundspaces import RaySettings, SoundSpacesBackend
from generators.acoustics.tracer.backend import TracerBackend
from generators.acoustics.tracer.receivers.ambisonics import Ambisonics
from generators.acoustics.tracer.receivers.spherical import SphericalHead
from generators.acoustics.tracer.settings import TraceSettings
from generators.core.low_discrepancy import fibonacci_directions
from generators.core.scene import Room, Scene

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Position = tuple[float, float, float]

ENGINES = ("tracer", "soundspaces")
#: Octaves that are measured: those of the materials (Hz).
OCTAVES = tuple(int(band) for band in OCTAVE_BANDS)
#: Length of the transforms (samples): 1.5 s, more than any response needs for its level.
_TRANSFORM = 1 << 16
#: Directions and distance (m) at which the level of a head is measured.
_DIRECTIONS, _DISTANCE = 60, 2.0


def decibels(ratio: ArrayLike) -> F64:
    """10·lg of a ratio of energies."""
    with np.errstate(divide="ignore"):
        return np.asarray(10 * np.log10(np.asarray(ratio, dtype=np.float64)))


def octave_energies(response: F32) -> F64:
    """(channels, 6) mean of |H|² over each of `OCTAVES`; 1 for a unit impulse."""
    spectrum = np.square(np.abs(np.fft.rfft(response, max(_TRANSFORM, response.shape[1]))))
    frequency = np.fft.rfftfreq(max(_TRANSFORM, response.shape[1]), 1 / SAMPLE_RATE)
    inside = [(frequency >= band / math.sqrt(2)) & (frequency < band * math.sqrt(2)) for band in OCTAVES]
    return np.stack([spectrum[:, chosen].mean(axis=1) for chosen in inside], axis=1)


def split(response: F32, distance: float) -> tuple[F32, F32]:
    """The direct sound of a response (channels, n) over a free path of ``distance`` m, and all the rest."""
    arrival = distance / SPEED_OF_SOUND
    first = max(math.floor((arrival - BEFORE) * SAMPLE_RATE), 0)
    last = math.ceil((arrival + AFTER) * SAMPLE_RATE)
    direct = np.zeros_like(response)
    direct[:, first:last] = response[:, first:last]
    return direct, response - direct


@dataclass(frozen=True)
class Measured:
    """Figures of one response.

    Attributes:
        energy: per channel, the energy in each of `OCTAVES`.
        white: per channel, the sum of squares: the energy of white noise.
        direct: as ``energy``, of the direct sound; empty if the path is not free.
        late: as ``energy``, of the rest; empty if the path is not free.
        white_drr: of white noise, all channels together (dB); None if the path is not free.
        t30: per channel, T30 in each of `OCTAVES` (s); None where it cannot be measured.
    """

    energy: list[list[float]]
    white: list[float]
    direct: list[list[float]]
    late: list[list[float]]
    white_drr: float | None
    t30: list[list[float | None]] = field(default_factory=list)


def measure(response: F32, distance: float | None) -> Measured:
    """Measure a response (channels, n); ``distance`` (m) of the source, None if the path to it is not free."""
    parts = None if distance is None else split(response, distance)
    bands = [octave_filtered(response, SAMPLE_RATE, band) for band in OCTAVE_BANDS]
    return Measured(
        energy=octave_energies(response).tolist(),
        white=np.square(response, dtype=np.float64).sum(axis=1).tolist(),
        direct=octave_energies(parts[0]).tolist() if parts else [],
        late=octave_energies(parts[1]).tolist() if parts else [],
        white_drr=None
        if parts is None
        else float(decibels(np.square(parts[0], dtype=float).sum() / np.square(parts[1], dtype=float).sum())),
        t30=[[t30(band[channel], SAMPLE_RATE) for band in bands] for channel in range(len(response))],
    )


def responses(
    engine: str,
    scene: Scene,
    source: Position,
    room: str,
    poses: Sequence[Pose],
    *,
    settings: TraceSettings | RaySettings | None = None,
    head: bool = True,
) -> Iterable[tuple[F32 | None, F32]]:
    """For each pose, the binaural response (2, n) and that of an omnidirectional listener (1, n).

    Args:
        engine: one of `ENGINES`.
        scene: of the simulation.
        source: metres.
        room: of the source.
        poses: of the listener.
        settings: of the engine; its own if missing.
        head: whether the binaural response is wanted; None otherwise.
    """
    if engine == "tracer":
        assert not isinstance(settings, RaySettings)
        both, centre = SphericalHead(), Ambisonics(1)
        session = TracerBackend(both, settings).open(scene, source, room=room)
        session.prepare(poses)
        for pose in poses:
            found = session.arrivals(pose)
            omni = centre.response(found, pose.rotation_matrix, SAMPLE_RATE)[:1]
            yield (both.response(found, pose.rotation_matrix, SAMPLE_RATE) if head else None), omni
        session.close()
        return
    assert not isinstance(settings, TraceSettings)
    ears = SoundSpacesBackend(settings).open(scene, source, room=room) if head else None
    omni_listener = SoundSpacesBackend(settings, omni=True).open(scene, source, room=room)
    for pose in poses:
        yield (None if ears is None else ears.impulse_response(pose)), omni_listener.impulse_response(pose)
    omni_listener.close()
    if ears is not None:
        ears.close()


def head_levels(engine: str) -> dict[str, list[float]]:
    """Level of a head in a diffuse field, dB above an omnidirectional listener: each octave, and white noise.

    The mean over both ears and over directions all around, in the free field.
    """
    free = Scene("free field", (), (Room("room", (-5.0, -5.0, -5.0), (5.0, 5.0, 5.0)),), ())
    here = Pose.from_yaw((0.0, 0.0, 0.0), 0.0)
    places = [tuple(float(c) for c in _DISTANCE * direction) for direction in fibonacci_directions(_DIRECTIONS)]
    first = (places[0][0], places[0][1], places[0][2])
    session = (SoundSpacesBackend() if engine == "soundspaces" else TracerBackend()).open(free, first, room="room")
    octaves, white = np.zeros(len(OCTAVES)), 0.0
    for x, y, z in places:
        session.move_source((x, y, z))
        response = session.impulse_response(here)
        octaves += octave_energies(response).mean(axis=0) * _DISTANCE**2 / _DIRECTIONS
        white += float(np.square(response, dtype=float).sum(axis=1).mean()) * _DISTANCE**2 / _DIRECTIONS
    session.close()
    return {"octaves": decibels(octaves).tolist(), "white": [float(decibels(white))]}
