"""What a head hears of a near source beyond what it hears of a far one in the same direction.

A point source at the distance r reaches the ears of a rigid sphere of radius a with other levels and delays than a
plane wave (R. O. Duda, W. L. Martens, "Range dependence of the response of a spherical head model", JASA 104 (1998)
3048–3058, eq. 3). The ratio of both responses varies slowly over frequency and is applied octave by octave, as a gain
and a delay: a *distance variation function* (A. Kan, C. Jin, A. van Schaik, "A psychophysical evaluation of near-field
head-related transfer functions synthesized using a distance variation function", JASA 125 (2009) 2233–2242). The
energy of every octave is that of the exact response. Gains and delays are tabulated over nearness a/r and angle of
incidence: from a plane wave (nearness 0) on there is no step at any distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from generators.acoustics import hrtf
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracer.receivers.bands import band_weights
from generators.acoustics.tracer.receivers.sphere import sphere_response

F64 = NDArray[np.float64]

#: Distance (m) below which a source is heard as at this distance: a head's width from the ear.
NEAREST = 0.15
#: Tabulated distances (even in nearness) and angles of incidence.
_DISTANCES, _ANGLES = 25, 361
#: Frequencies per octave of the table, and the highest of them (Hz).
_PER_OCTAVE, _HIGHEST = 16, 16_000.0


@dataclass(frozen=True, eq=False)
class NearField:
    """Gains and delays of near sources at the ears of one head.

    Attributes:
        radius: of the sphere, m.
        axes: (2, 3) unit vectors from its centre to the ears, left first, in the head's frame.
        level: (D, T, 8) natural logarithm of the gain over nearness, angle of incidence and octave.
        delay: (D, T, 8) s, beyond the difference of `path_delay`.
    """

    radius: float
    axes: F64
    level: F64
    delay: F64

    def heard(self, arrivals: Arrivals, directions: F64, ear: int) -> tuple[Arrivals, F64]:
        """The arrivals at one ear that a head for plane waves hears as the near ones are heard.

        Args:
            arrivals: at the head's centre.
            directions: (n, 3) in the head's frame.
            ear: 0 (left) or 1 (right).

        Returns:
            the plane arrivals and, for each spherical one, eight, one per octave; and their directions.
        """
        near = np.flatnonzero(arrivals.is_spherical)
        if not len(near):
            return arrivals, directions
        gain, delay = self._corrections(arrivals.time[near] * SPEED_OF_SOUND, directions[near], ear)
        bands = len(BANDS)
        pressure = np.zeros((len(near), bands, bands), dtype=np.float32)
        pressure[:, np.arange(bands), np.arange(bands)] = arrivals.pressure[near] * gain
        time = arrivals.time[near, None] + delay
        rest = ~arrivals.is_spherical
        joined = Arrivals(
            np.concatenate([time.reshape(-1), arrivals.time[rest]]),
            np.concatenate([np.repeat(arrivals.direction[near], bands, axis=0), arrivals.direction[rest]]),
            np.concatenate([pressure.reshape(-1, bands), arrivals.pressure[rest]]),
        )
        return joined, np.concatenate([np.repeat(directions[near], bands, axis=0), directions[rest]])

    def _corrections(self, distance: F64, directions: F64, ear: int) -> tuple[F64, F64]:
        """Gain (n, 8) and delay (n, 8) in s at an ear."""
        nearness = self.radius / np.maximum(distance, NEAREST)
        axis = self.axes[ear]
        cosine = directions[:, 0] * axis[0] + directions[:, 1] * axis[1] + directions[:, 2] * axis[2]
        theta = np.arccos(np.clip(cosine, -1.0, 1.0))
        row = nearness / (self.radius / NEAREST) * (_DISTANCES - 1)
        column = theta / np.pi * (_ANGLES - 1)
        level, delay = (_bilinear(table, row, column) for table in (self.level, self.delay))
        shift = path_delay(theta, nearness, self.radius) - path_delay(theta, np.zeros(1), self.radius)
        return np.exp(level), shift[:, None] + delay


def _bilinear(table: F64, row: F64, column: F64) -> F64:
    """(n, 8) values of ``table`` (D, T, 8) between its rows and columns."""
    i, j = (np.minimum(at.astype(np.int64), size - 2) for at, size in zip((row, column), table.shape, strict=False))
    u, v = (row - i)[:, None], (column - j)[:, None]
    low = (1 - v) * table[i, j] + v * table[i, j + 1]
    return np.asarray((1 - u) * low + u * ((1 - v) * table[i + 1, j] + v * table[i + 1, j + 1]))


def path_delay(theta: F64, nearness: F64, radius: float) -> F64:
    """(n,) s: arrival at a point on the sphere, relative to its centre if there were no sphere, by the shortest path.

    Straight to where the source is visible; beyond that along the tangent and round the sphere. For a plane wave
    (``nearness`` 0) it is `generators.acoustics.hrtf.ear_delay`.

    Args:
        theta: (n,) angle of incidence, radians.
        nearness: (n,) or (1,) radius over distance.
        radius: m.
    """
    cosine = np.cos(theta)
    # Of √(r² + a² − 2·r·a·cos θ) − r, divided by a, and without the difference of two large numbers.
    direct = (nearness - 2 * cosine) / (np.sqrt(1 - 2 * nearness * cosine + nearness**2) + 1)
    tangent = -nearness / (np.sqrt(1 - nearness**2) + 1)
    limit = np.arccos(nearness)
    return np.asarray(np.where(theta <= limit, direct, tangent + theta - limit) * (radius / SPEED_OF_SOUND))


def near_field(radius: float, axes: F64) -> NearField:
    """The near field of a sphere with ears along ``axes`` (2, 3), in the head's frame, left first."""
    return NearField(radius, axes, *_tables(radius))


@lru_cache(maxsize=4)
def diametral_near_field(radius: float = hrtf.HEAD_RADIUS) -> NearField:
    """That of `spherical.SphericalHead`."""
    axes = np.zeros((2, 3))
    axes[:, 0] = hrtf.EAR_AXES
    return near_field(radius, axes)


@lru_cache(maxsize=8)
def _tables(radius: float) -> tuple[F64, F64]:
    """`NearField.level` and `NearField.delay` of a radius."""
    theta = np.linspace(0.0, np.pi, _ANGLES)
    octaves = np.log2(_HIGHEST / BANDS[0]) + 1
    # Even in the logarithm, each counts by the width it stands for: the octave's energy for a white sound.
    frequencies = _HIGHEST * 2.0 ** -np.arange(0.0, octaves, 1 / _PER_OCTAVE)[::-1]
    shares = band_weights(frequencies) ** 2 * frequencies
    turn = 2j * np.pi * frequencies
    wave_number = 2 * np.pi * frequencies * radius / SPEED_OF_SOUND
    plane = sphere_response(theta, wave_number) * np.exp(turn * path_delay(theta, np.zeros(1), radius)[:, None])
    level, delay = np.zeros((2, _DISTANCES, _ANGLES, len(BANDS)))
    energy = np.einsum("tf,bf->tb", np.abs(plane) ** 2, shares)
    for row in range(1, _DISTANCES):
        nearness = radius / NEAREST * row / (_DISTANCES - 1)
        late = path_delay(theta, np.array([nearness]), radius)
        near = sphere_response(theta, wave_number, nearness) * np.exp(turn * late[:, None])
        level[row] = 0.5 * np.log(np.einsum("tf,bf->tb", np.abs(near) ** 2, shares) / energy)
        common = near * np.conj(plane)
        size = np.abs(common)
        middle = np.einsum("tf,bf->tb", size * frequencies, shares) / np.einsum("tf,bf->tb", size, shares)
        delay[row] = -np.angle(np.einsum("tf,bf->tb", common, shares)) / (2 * np.pi * middle)
    return level, delay
