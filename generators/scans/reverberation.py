"""Reverberation times of scanned rooms: predicted from their surfaces, measured in furnished rooms, and matched.

The prediction follows 2,000 rays over their reflections, as the tracer does, but without a listener: the energy that
is left in the room, summed over the rays, is the decay that a listener hears in a room with one volume. Where a ray
goes does not depend on the absorption, so that one trace gives the decay for every factor of it.

Measurements of furnished rooms in dwellings, means over the rooms:

- Jackson and Leventhall 1972: 50 living rooms of 25–76 m³ (mean 44 m³) 0.51 s, 50 kitchens 0.68 s, at 1 kHz [1, 2].
- Burgess and Utley 1985: 47 living rooms 0.33 s, 51 bedrooms 0.28 s, at 500 Hz [1].
- Bradley 1986: 602 homes, 0.4 s with a standard deviation below 0.1 s, 100 Hz–4 kHz [1].
- Jeong, Lee and Jeon 2015: living rooms 0.48 s, bedrooms 0.44 s, the same flats empty 1.11 s [3].
- Díaz and Pedrero 2008: 11,457 rooms; the larger a room, the longer it rings [4].

As quoted in [1] Applied Sciences 11 (2021) 2709 and [2] F. A. Everest, *Master Handbook of Acoustics* (volumes); from
the abstracts of [3] Trans. Korean Soc. Noise Vib. Eng. 25 (2015) 291 and [4] Building Acoustics 15 (2008),
doi:10.1260/147547308784050179. The papers of the first three were not at hand.

`furnished_range` takes the least and the greatest of the means of living rooms (for kitchens, theirs as the greatest)
at 44 m³ and scales them by the cube root of the volume: rooms that are furnished alike have the same mean absorption,
and V/S grows with V^⅓. Nothing was found for bathrooms, which are not held to a range.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.measures.decay import MID_BANDS, fit_decay
from generators.acoustics.geometry import LEAST_SCALE, MOST_SCALE
from generators.acoustics.materials import OCTAVE_BANDS, material_for, scaled_label
from generators.core.rays import RayCaster
from generators.core.scene import Room
from generators.scans.places import AROUND, near_room
from generators.scans.ray_walk import RayWalk, free_points, walk

Array = NDArray[np.float64]

#: Mean volume of the living rooms of Jackson and Leventhall (m³).
REFERENCE_VOLUME = 44.0
#: Least and greatest mean of the measurements (s), by room; others have those of a living room.
LIVING_ROOM = (0.33, 0.51)
MEANS: dict[str, tuple[float, float] | None] = {"kitchen": (0.33, 0.68), "bathroom": None}
#: Share by which a room's T30 may differ from the one that was measured.
TOLERANCE = 0.05
#: Step of the decay (s), and its end: no ray is followed longer.
_STEP, _END = 0.002, 6.0
#: Exponent of the energy left at the end of a trace (−52 dB) above which it is repeated, and how often at most.
_LIVE, _MOST_TURNS = -12.0, 16


def furnished_range(room: str, volume: float) -> tuple[float, float] | None:
    """Least and greatest reverberation time in s that furnished rooms have on average; None: not known.

    Args:
        room: its name; ``kitchen`` and ``bathroom`` differ from the others.
        volume: m³.
    """
    means = MEANS.get(room, LIVING_ROOM)
    if means is None:
        return None
    size = (volume / REFERENCE_VOLUME) ** (1 / 3)
    return means[0] * size, means[1] * size


@dataclass(frozen=True, eq=False)
class RayHistory:
    """Reflections of rays in a room.

    Attributes:
        walk: of the rays.
        index: (A,) of each face into ``labels``.
        labels: of the materials.
        adjustable: per label, whether `decay_time` scales its absorption.
    """

    walk: RayWalk
    index: NDArray[np.int32]
    labels: tuple[str, ...]
    adjustable: tuple[bool, ...]

    def decay_time(self, scale: float = 1.0) -> float | None:
        """T30 in s, mean of `MID_BANDS`, with ``scale`` times the Eyring exponents; None if it cannot be measured."""
        found = [self._decay_time(band, scale) for band in MID_BANDS]
        times = [time for time in found if time is not None]
        return float(np.mean(times)) if len(times) == len(found) else None

    def _decay_time(self, band: float, scale: float) -> float | None:
        column, steps = OCTAVE_BANDS.index(band), round(_END / _STEP)
        exponents = [
            math.log1p(-min(material_for(label).scaled(scale if own else 1.0).in_situ[column], 1 - 1e-9))
            for label, own in zip(self.labels, self.adjustable, strict=True)
        ]
        # The last one stands for a ray that meets nothing: −1.
        exponent = np.array([*exponents, -np.inf])[np.append(self.index, -1)[self.walk.face]]
        time = self.walk.time
        mean = float(exponent[np.isfinite(exponent)].mean())
        if mean * exponent.shape[1] > _LIVE:
            # The trace is too short for a decay so slow: each ray goes the same way again.
            turns = min(math.ceil(_LIVE / min(mean * exponent.shape[1], -1e-3)), _MOST_TURNS)
            exponent = np.tile(exponent, (1, turns))
            time = np.concatenate([time + turn * time[:, -1:] for turn in range(turns)], axis=1)
        # What a ray still has after each reflection; nothing once it has left.
        left = np.exp(np.cumsum(exponent, axis=1))
        before = np.concatenate([np.ones((len(left), 1)), left[:, :-1]], axis=1)
        bins = np.minimum(time / _STEP, steps).astype(np.int64)
        lost = np.bincount(bins.reshape(-1), (before - left).reshape(-1), steps + 1)[:steps].astype(np.float64)
        energy = len(left) - np.cumsum(lost)
        return fit_decay(np.cumsum(energy[::-1])[::-1], 1 / _STEP)


def trace_room(
    triangles: Array, labels: Sequence[str], room: Room, adjustable: NDArray[np.bool_] | None = None
) -> RayHistory:
    """Follow rays from free points of ``room``.

    Args:
        triangles: (A, 3, 3) all acoustic faces.
        labels: (A,) their labels.
        room: its box.
        adjustable: (A,) the faces that `RayHistory.decay_time` scales; None: all.
    """
    own = np.ones(len(triangles), dtype=bool) if adjustable is None else adjustable
    keys = sorted(set(zip(labels, own.tolist(), strict=True)))
    number = {key: index for index, key in enumerate(keys)}
    index = np.array([number[key] for key in zip(labels, own.tolist(), strict=True)], dtype=np.int32)
    scattering = np.array([np.mean(material_for(label).scattering[2:4]) for label, _ in keys])[index]
    caster = RayCaster(triangles)
    found = walk(caster, triangles, scattering, free_points(caster, room))
    return RayHistory(found, index, tuple(label for label, _ in keys), tuple(own for _, own in keys))


def scale_for(history: RayHistory, seconds: float) -> float:
    """The factor of the absorption with which the room has this reverberation time, within `LEAST_SCALE`–`MOST_SCALE`.

    Rounded to three digits after the point.
    """
    low, high = LEAST_SCALE, MOST_SCALE
    for _ in range(16):
        middle = math.sqrt(low * high)
        time = history.decay_time(middle)
        # What cannot be measured is over within milliseconds.
        low, high = (middle, high) if time is not None and time > seconds else (low, middle)
    return round(math.sqrt(low * high), 3)


class RoomDecay(NamedTuple):
    """The reverberation time of one room of a scan.

    Attributes:
        room: its name.
        volume: of its box, m³.
        guessed: T30 with the materials as they are, s; None if it cannot be predicted.
        usual: range of furnished rooms of this kind and volume, s; None: not known.
        wanted: T30 that the absorption was scaled to, s; None: it was left as it is.
        scale: factor of the Eyring exponent of its surfaces.
        t30: T30 with it, s.
    """

    room: str
    volume: float
    guessed: float | None
    usual: tuple[float, float] | None
    wanted: float | None
    scale: float
    t30: float | None


def match_rooms(
    triangles: Array,
    labels: Sequence[str],
    rooms: Sequence[Room],
    t30: Mapping[str, float],
    *,
    usual: bool,
) -> tuple[tuple[str, ...], tuple[RoomDecay, ...]]:
    """Scale the absorption of rooms to the reverberation times that they should have.

    Args:
        triangles: (A, 3, 3) all acoustic faces.
        labels: (A,) their labels.
        rooms: one after the other.
        t30: room → measured T30, s.
        usual: whether rooms that were not measured are brought into the range of furnished ones, to its nearer end.

    Returns:
        (A,) labels, and what was done in each room.

    Raises:
        Avs3dError: if no absorption gives a measured T30.
    """
    names, middle = np.array(labels, dtype=object), triangles.mean(axis=1)
    left, found = np.ones(len(names), dtype=bool), []
    for room in rooms:
        own = left & near_room(middle, room, AROUND)
        left &= ~own
        history = trace_room(triangles, [str(name) for name in names], room, own)
        volume = float(np.prod(np.subtract(room.high, room.low)))
        guessed, span = history.decay_time(), furnished_range(room.name, volume)
        wanted = t30.get(room.name)
        if wanted is None and usual and span is not None and guessed is not None and not span[0] <= guessed <= span[1]:
            wanted = float(np.clip(guessed, *span))
        scale = scale_for(history, wanted) if wanted is not None else 1.0
        time = history.decay_time(scale) if scale != 1.0 else guessed
        if room.name in t30 and (time is None or abs(time - t30[room.name]) > TOLERANCE * t30[room.name]):
            reached = "cannot be predicted" if time is None else f"is {time:.2f} s"
            raise Avs3dError(
                f"room {room.name}: acoustics.t30 is {t30[room.name]:g} s, but with {scale:g} times the absorption of "
                f"its surfaces the reverberation time {reached}; measure it again, or correct surfaces"
            )
        for label in np.unique(names[own].astype(str)):
            names[own & (names == label)] = scaled_label(str(label), scale)
        found.append(RoomDecay(room.name, volume, guessed, span, wanted, scale, time))
    return tuple(str(name) for name in names), tuple(found)
