"""Directivity of a source: how loud it is in each direction, per octave.

A `Directivity` gives an amplitude factor per octave for directions in the source's frame. It has no phase but a sign: a
source is one point, and its sound leaves it at one time in all directions. On its axis the factor is 1 (0 dB) in every
octave, so that the spectrum of what a source plays is that on its axis at 1 m; elsewhere it is quieter, and the power
that it sends into a room is lower by the directivity index (`Directivity.index`) than without a directivity.

The frame is that of objects and of glTF: x to the left of who looks along the front, y up, z to the front. Azimuth is 0
to the front and positive to the source's own right, elevation is positive upwards; degrees.

References:
    cardioid family: H. F. Olson, "Gradient microphones", JASA 17 (1946) 192–198.
    directivity index: L. L. Beranek, *Acoustics*, McGraw-Hill 1954, § 4.5.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose, times_matrix
from generators.acoustics.tracer.arrivals import BANDS
from generators.core.limits import MOST_ORDER
from generators.core.low_discrepancy import fibonacci_directions

F64 = NDArray[np.float64]
#: Amplitudes (n, 8) of a source at its place for directions (n, 3) in the world; None: 1 in all directions.
Emission = Callable[[F64], F64] | None

#: Octaves that every table has: those of the materials; without the outer two, these repeat the nearest.
_NEEDED = BANDS[1:-1]
#: Largest gap between neighbouring azimuths of a table, and between a pole and its nearest elevation (degrees).
_WIDEST_GAP = 90.0
#: Least amplitude on the axis relative to the largest of the octave: below it the axis is no front.
_LEAST_ON_AXIS = 1e-3
#: Step of the grid on which the amplitudes of a file are tabulated (degrees).
_SOFA_STEP = 2.5
#: Directions over which the mean power is taken.
_DIRECTIONS = 20_000


@dataclass(frozen=True, eq=False)
class Directivity:
    """Amplitude of a source per direction and octave; see the module's docstring for frame and level.

    Attributes:
        name: what it is, for records.
        pattern: amplitudes (n, 8) in the octaves of `BANDS` for unit vectors (n, 3) in the source's frame.

    Examples:
        >>> speaker = Directivity.cardioid()
        >>> speaker.amplitudes([[0, 0, 1], [1, 0, 0], [0, 0, -1]])[:, 0].tolist()
        [1.0, 0.5, 0.0]
        >>> round(speaker.index()[1000], 2)
        4.77
    """

    name: str
    pattern: Callable[[F64], F64] = field(repr=False)

    @classmethod
    def cardioid(
        cls, order: int = 1, axis: Sequence[float] = (0.0, 0.0, 1.0), *, omni_share: float = 0.5
    ) -> Directivity:
        """The cardioid family, alike in all octaves: (p + (1 − p)·cos θ)ⁿ at the angle θ from the axis.

        Args:
            order: n, 0 (in all directions alike) to `MOST_ORDER`.
            axis: direction of the loudest sound in the source's frame, of any length.
            omni_share: p: 1 is a point, 0.5 a cardioid, 0.37 a supercardioid, 0.25 a hypercardioid, 0 a dipole.

        Raises:
            Avs3dError: if a number is out of range or not finite, or the axis has no length.
        """
        if isinstance(order, bool) or not isinstance(order, int) or not 0 <= order <= MOST_ORDER:
            raise Avs3dError(f"directivity: order of the cardioid is {order!r}, expected 0 to {MOST_ORDER}")
        if not 0.0 <= omni_share <= 1.0:
            raise Avs3dError(f"directivity: omni_share is {omni_share}, expected 0 to 1")
        cardioid = _Cardioid(order, _unit(axis), float(omni_share))
        share = "" if omni_share == 0.5 else f", omni share {omni_share:g}"
        x, y, z = axis
        return cls(f"cardioid of order {order}{share}, axis ({x:g}, {y:g}, {z:g})", cardioid)

    @classmethod
    def table(
        cls,
        amplitudes: ArrayLike,
        azimuths: ArrayLike,
        elevations: ArrayLike,
        frequencies: Sequence[float] = _NEEDED,
        *,
        axis: Sequence[float] = (0.0, 0.0, 1.0),
        name: str = "table",
    ) -> Directivity:
        """A table of amplitudes, linear between its directions; divided by its value on the axis in every octave.

        Beyond the highest and the lowest elevation it goes on to its mean over all azimuths at the pole.

        Args:
            amplitudes: (frequencies, azimuths, elevations) pressure, not in dB.
            azimuths: degrees, increasing, all round: without a gap of more than 90°.
            elevations: degrees, increasing, without a gap of more than 90°, also to both poles.
            frequencies: centres of the octaves (Hz), increasing: 125 to 4000, and 63 and 8000 if they are known.
            axis: direction of 0 dB in the source's frame, of any length.
            name: for records.

        Raises:
            Avs3dError: if an octave is missing, the table is empty or has holes, a shape does not fit, a number is not
                finite, or there is no sound on the axis.
        """
        where = f"directivity {name}"
        table = _DirectionTable.of(amplitudes, azimuths, elevations, frequencies, where)
        loudest = np.abs(table.values).max(axis=(0, 1))
        level = table(_unit(axis)[None])[0]
        if (np.abs(level) <= _LEAST_ON_AXIS * loudest).any():
            raise Avs3dError(f"{where}: all but silent on its axis {tuple(axis)}, expected sound; name another axis")
        return cls(name, _DirectionTable(table.azimuths, table.elevations, table.values / level))

    @classmethod
    def sofa(cls, path: str | Path) -> Directivity:
        """The directivity of a SOFA file of the convention FreeFieldDirectivityTF (AES69), read with h5py.

        The energy of each octave is the mean over its frequencies and over all measurements of a direction. Octaves
        beyond those of the file repeat the nearest. The front is the file's SourceView.

        Raises:
            Avs3dError: one line, if h5py is missing, or the file is missing, no SOFA file, of another convention, or
                has numbers that are not finite, or directions with holes.
        """
        from generators.acoustics.measured_directivity import read_directivity

        azimuths, elevations, directions = direction_grid(_SOFA_STEP)
        values, name = read_directivity(path, directions.reshape(-1, 3))
        return cls.table(values.reshape(-1, *directions.shape[:2]), azimuths, elevations, BANDS, name=name)

    @classmethod
    def file(cls, path: str | Path) -> Directivity:
        """The directivity of a file: a table as ``.csv`` or ``.npz`` (docs/directivity.md), or what `sofa` reads.

        Raises:
            Avs3dError: one line, as `table` and `sofa`, with the file's name.
        """
        from generators.acoustics.directivity_table import TABLE_ENDINGS, read_table

        if Path(path).suffix.lower() not in TABLE_ENDINGS:
            return cls.sofa(path)
        found = read_table(path)
        try:
            return cls.table(**found)
        except Avs3dError as error:
            raise Avs3dError(f"{path}: {error}") from None

    def amplitudes(self, directions: ArrayLike) -> F64:
        """(n, 8) amplitude factors in the octaves of `BANDS` for vectors (n, 3) in the source's frame, of any length.

        Raises:
            Avs3dError: if a direction is not finite or has no length.
        """
        found = np.atleast_2d(np.asarray(directions, dtype=np.float64))
        length = np.sqrt((found**2).sum(axis=1, keepdims=True)) if found.shape[-1] == 3 else np.zeros(1)
        if not np.isfinite(found).all() or length.min(initial=1.0) <= 0:
            raise Avs3dError("directivity: directions have NaN, no length or another shape; expected (n, 3) vectors")
        return self.pattern(found / length)

    def at(self, pose: Pose) -> Callable[[F64], F64]:
        """The amplitudes (n, 8) of the source at ``pose`` for unit vectors (n, 3) in the world."""
        rotation = pose.rotation_matrix
        return lambda directions: self.pattern(times_matrix(directions, rotation))

    @cached_property
    def power(self) -> F64:
        """(8,) mean of the squared amplitude over all directions: the power re a source without a directivity."""
        return np.asarray((self.pattern(fibonacci_directions(_DIRECTIONS)) ** 2).mean(axis=0))

    def index(self) -> dict[int, float]:
        """Directivity index by octave (Hz → dB): level on the axis above that of a point source of the same power."""
        return {band: float(-10 * np.log10(power)) for band, power in zip(BANDS, self.power, strict=True)}


def emission_of(directivity: Directivity | None, pose: Pose) -> Emission:
    """What a source at ``pose`` sends out; None without a directivity."""
    return None if directivity is None else directivity.at(pose)


def unit_vectors(azimuths: F64, elevations: F64) -> F64:
    """(..., 3) unit vectors in the source's frame for angles in degrees."""
    azimuth, elevation = np.broadcast_arrays(np.radians(azimuths), np.radians(elevations))
    flat = np.cos(elevation)
    return np.stack([-flat * np.sin(azimuth), np.sin(elevation), flat * np.cos(azimuth)], axis=-1)


def direction_grid(step: float) -> tuple[F64, F64, F64]:
    """Azimuths (A,), elevations (E,) and their unit vectors (A, E, 3), every ``step`` degrees."""
    azimuths, elevations = np.arange(-180.0, 180.0, step), np.arange(-90.0, 90.0 + step, step)
    return azimuths, elevations, unit_vectors(azimuths[:, None], elevations[None])


@dataclass(frozen=True, eq=False)
class _Cardioid:
    order: int
    axis: F64
    share: float

    def __call__(self, directions: F64) -> F64:
        cosine = np.clip(directions[:, 0] * self.axis[0] + directions[:, 1] * self.axis[1], -2, 2)
        cosine = np.clip(cosine + directions[:, 2] * self.axis[2], -1.0, 1.0)
        amplitude = (self.share + (1.0 - self.share) * cosine) ** self.order
        return np.repeat(amplitude[:, None], len(BANDS), axis=1)


@dataclass(frozen=True, eq=False)
class _DirectionTable:
    """Amplitudes on a grid that closes at both poles and behind.

    Attributes:
        azimuths: (A,) degrees, increasing, over 360°.
        elevations: (E,) degrees, −90 to 90.
        values: (A, E, 8).
    """

    azimuths: F64
    elevations: F64
    values: F64

    @classmethod
    def of(
        cls, amplitudes: ArrayLike, azimuths: ArrayLike, elevations: ArrayLike, frequencies: Sequence[float], where: str
    ) -> _DirectionTable:
        turn, tilt = (np.asarray(angles, dtype=np.float64).reshape(-1) for angles in (azimuths, elevations))
        values = np.asarray(amplitudes, dtype=np.float64)
        expected = (len(frequencies), len(turn), len(tilt))
        if not values.size or values.shape != expected:
            raise Avs3dError(
                f"{where}: amplitudes have shape {values.shape}, expected {expected}: one number or more for each "
                "frequency, azimuth and elevation"
            )
        for what, numbers in (("amplitudes", values), ("azimuths", turn), ("elevations", tilt)):
            if not np.isfinite(numbers).all():
                raise Avs3dError(f"{where}: {what} have NaN or infinite values, expected finite numbers")
        _check_angles(where, turn, tilt)
        octaves = np.moveaxis(_octaves(where, values, frequencies), 0, -1)
        turn = np.append(turn, turn[0] + 360.0)
        octaves = np.concatenate([octaves, octaves[:1]])
        for end, pole in ((0, -90.0), (-1, 90.0)):
            if tilt[end] != pole:
                mean = np.broadcast_to(octaves[:-1, [end]].mean(axis=0), octaves[:, [end]].shape)
                octaves = np.concatenate([mean, octaves] if end == 0 else [octaves, mean], axis=1)
                tilt = np.insert(tilt, 0 if end == 0 else len(tilt), pole)
        return cls(turn, tilt, octaves)

    def __call__(self, directions: F64) -> F64:
        from scipy.interpolate import RegularGridInterpolator

        azimuth = np.degrees(np.arctan2(-directions[:, 0], directions[:, 2]))
        azimuth = self.azimuths[0] + np.mod(azimuth - self.azimuths[0], 360.0)
        elevation = np.degrees(np.arcsin(np.clip(directions[:, 1], -1.0, 1.0)))
        grid = RegularGridInterpolator((self.azimuths, self.elevations), self.values)
        return np.asarray(grid(np.stack([azimuth, elevation], axis=1)), dtype=np.float64)


def _check_angles(where: str, azimuths: F64, elevations: F64) -> None:
    """Refuse directions in another order, or with holes."""
    for what, angles in (("azimuths", azimuths), ("elevations", elevations)):
        if (np.diff(angles) <= 0).any():
            raise Avs3dError(f"{where}: {what} do not increase, expected degrees in increasing order")
    around = np.append(azimuths, azimuths[0] + 360.0)
    if around[-2] - around[0] >= 360.0 or np.diff(around).max() > _WIDEST_GAP:
        raise Avs3dError(
            f"{where}: azimuths from {around[0]:g}° to {around[-2]:g}° leave a gap or are listed twice; expected all "
            f"round once, without a gap of more than {_WIDEST_GAP:g}°"
        )
    along = np.concatenate([[-90.0], elevations, [90.0]])
    if abs(elevations).max() > 90.0 or np.diff(along).max() > _WIDEST_GAP:
        raise Avs3dError(
            f"{where}: elevations from {elevations[0]:g}° to {elevations[-1]:g}°, expected −90° to 90° without a gap "
            f"of more than {_WIDEST_GAP:g}°"
        )


def _octaves(where: str, values: F64, frequencies: Sequence[float]) -> F64:
    """(8, …) the rows of ``values`` by octave; without the outer two, these repeat the nearest."""
    given = list(frequencies)
    missing = [band for band in _NEEDED if band not in given]
    foreign = [each for each in given if each not in BANDS]
    if missing or foreign or given != sorted(set(given)):
        found = f"octave {missing[0]} Hz is missing" if missing else f"frequencies are {given}"
        raise Avs3dError(
            f"{where}: {found}; expected the octaves {_NEEDED[0]} to {_NEEDED[-1]} Hz once each, and {BANDS[0]} and "
            f"{BANDS[-1]} Hz if they are known"
        )
    return np.stack([values[given.index(min(given, key=lambda each: abs(each - band)))] for band in BANDS])


def _unit(axis: Sequence[float]) -> F64:
    found = np.asarray(axis, dtype=np.float64)
    length = float(np.sqrt((found**2).sum())) if found.shape == (3,) else 0.0
    if not np.isfinite(length) or length <= 0.0:
        raise Avs3dError(f"directivity: axis is {axis}, expected three numbers that are finite and not all 0")
    return np.asarray(found / length)
