"""Binaural responses on a CUDA device, from records that never leave it.

The steps are those of `generators.acoustics.tracer.receivers.synthesis`: arrivals are spread over the grids of the
octaves, the grids are transformed, filtered and added up, and the sum is transformed back. Three things differ:

- The grids are integers (multiples of 2^−44). Their sums are exact, in whatever order the threads come.
- The left ear is the real part and the right ear the imaginary part of one complex series: one transform for both.
- The transform back has float64, the ones before float32, as on the CPU.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numba.cuda
import numpy as np
from numpy.typing import NDArray

from generators.acoustics import hrtf
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracer.device.ears import SPHERE, Ears
from generators.acoustics.tracer.device.fft import factors, transform
from generators.acoustics.tracer.receivers.gridding import FRACTIONS, TAPS, Grids, window_table
from generators.acoustics.tracer.receivers.measured import PLANE_WIDTH, STEP
from generators.acoustics.tracer.receivers.near_field import NearField
from generators.acoustics.tracer.receivers.spherical import STEPS
from generators.acoustics.tracer.receivers.synthesis import TAIL, checked, grids_of_length
from generators.core.cuda import allocate, in_batches, is_simulated, kernel, launch, upload
from generators.core.jit import inline

cuda: Any = numba.cuda

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

#: One unit of pressure in a grid: sums up to 2^19 fit, and the smallest step is 6e-14.
_UNIT = float(2**44)
#: Threads that share a record: those of a warp add to neighbouring numbers.
_LANES = 1 if is_simulated() else 32
#: Most responses that are computed together, and most bytes of them, a part of what a worker process may take
#: (`generators.core.cuda.WORKER_MEMORY`). One of a second at 44.1 kHz takes 26 MB.
_TOGETHER, _MEMORY = 128, 1 << 30
#: Lengths of response whose tables are kept on the device.
_LENGTHS = 8
_OCTAVES = len(BANDS)
_BEFORE = TAPS // 2 - 1
_AZIMUTHS = 360 // STEP
_PLANE_DELAY = PLANE_WIDTH * hrtf.HEAD_RADIUS / SPEED_OF_SOUND
_CREEP = hrtf.HEAD_RADIUS / SPEED_OF_SOUND
_HALF_TURN = math.pi / 2
_ANGLES = STEPS / math.pi


class DeviceRecords(NamedTuple):
    """Records of many listeners on the device, in any order.

    Attributes:
        listener: (C,) int32.
        path: (C,) float64.
        direction: (C, 3) float32.
        pressure: (C, 8) float32.
        records: their number; the arrays may be longer.
        per_second: what ``path`` counts in a second: the speed of sound if it is metres, 1 if it is seconds.
        first_ear: that hears them, 0 (left) or 1 (right).
        last_ear: 1 more than the last ear that hears them.
    """

    listener: Any
    path: Any
    direction: Any
    pressure: Any
    records: int
    per_second: float
    first_ear: int = 0
    last_ear: int = 2


class _OctaveLayout(NamedTuple):
    """Where the octaves are in a row of numbers; (8,) int64 each.

    Attributes:
        first: of the integers of one ear.
        length: samples of the grid; 0 without one.
        rank: number of components.
        column: first of the octave's weights.
        folded: first of the complex numbers.
        bins: that the octave contributes to.
        filters: first of the filters.
        swapped: 1 if the transform ends in the second of its two arrays.
    """

    first: Any
    length: Any
    rank: Any
    column: Any
    folded: Any
    bins: Any
    filters: Any
    swapped: Any


@inline
def _nearest(x: float) -> int:
    """The nearest integer; halves away from 0."""
    return int(x + 0.5) if x >= 0.0 else -int(0.5 - x)


@inline
def _sphere_ear(x: float, ear: int) -> tuple[int, float]:
    """Row of the weights and delay (s) at an ear of the sphere; ``x``: of the direction, to the right."""
    cosine = min(max(x if ear == 1 else -x, -1.0), 1.0)
    theta = math.acos(cosine)
    delay = -cosine if theta < _HALF_TURN else theta - _HALF_TURN
    return _nearest(theta * _ANGLES), _CREEP * delay


@inline
def _grid_node(x: float, y: float, z: float) -> int:
    """The nearest node of the grid of directions."""
    azimuth = math.atan2(x, -z) * (180.0 / math.pi)
    elevation = math.asin(min(max(y, -1.0), 1.0)) * (180.0 / math.pi)
    column = _nearest(azimuth / STEP)
    column = column + _AZIMUTHS if column < 0 else column
    column = column - _AZIMUTHS if column >= _AZIMUTHS else column
    return _nearest((elevation + 90.0) / STEP) * _AZIMUTHS + column


@kernel
def _clear(values: Any, count: int) -> None:  # pragma: no cover  # compiled
    i = cuda.grid(1)
    if i < count:
        values[i] = 0


@kernel
def _spread(  # pragma: no cover  # compiled
    heard: DeviceRecords,
    response_of: Any,
    rotations: Any,
    kind: int,
    first_row: int,
    residual: Any,
    rows: Any,
    window: Any,
    layout: _OctaveLayout,
    period: float,
    grids: Any,
) -> None:
    """Add every record to the grids of its response.

    Args:
        heard: the records.
        response_of: (L,) int32, the response of each listener; −1 without one.
        rotations: (R, 3, 3) listener to world.
        kind: of the ears.
        first_row: of the right ear's weights.
        residual: (2, K) s.
        rows: (T, C) weights.
        window: `window_table`.
        layout: of the octaves.
        period: of the grids, s.
        grids: (R, 2, G) int64; changed.
    """
    i = cuda.grid(1)
    lane = i % _LANES
    i = i // _LANES
    if i >= heard.records:
        return
    r = response_of[heard.listener[i]]
    if r < 0:
        return
    time = heard.path[i] / heard.per_second
    dx, dy, dz = heard.direction[i, 0], heard.direction[i, 1], heard.direction[i, 2]
    x = dx * rotations[r, 0, 0] + dy * rotations[r, 1, 0] + dz * rotations[r, 2, 0]
    node = 0
    if kind != SPHERE:
        y = dx * rotations[r, 0, 1] + dy * rotations[r, 1, 1] + dz * rotations[r, 2, 1]
        z = dx * rotations[r, 0, 2] + dy * rotations[r, 1, 2] + dz * rotations[r, 2, 2]
        node = _grid_node(x, y, z)
    for ear in range(heard.first_ear, heard.last_ear):
        if kind == SPHERE:
            index, delay = _sphere_ear(x, ear)
        else:
            index = node + ear * first_row
            delay = (-x if ear == 1 else x) * _PLANE_DELAY + residual[ear, node]
        place = (time + delay) / period
        if place < 0.0:
            place += 1.0
        for band in range(_OCTAVES):
            length, rank, column = layout.length[band], layout.rank[band], layout.column[band]
            p = heard.pressure[i, band]
            if length == 0 or p == 0.0:
                continue
            u = place * length
            whole = int(u)
            step = int((u - whole) * FRACTIONS)
            start = layout.first[band] + whole * rank
            for e in range(lane, TAPS * rank, _LANES):
                tap = e // rank
                amount = p * window[step, tap] * rows[index, column + e - tap * rank]
                cuda.atomic.add(grids, (r, ear, start + e), _nearest(amount * _UNIT))


@kernel
def _fold(
    grids: Any, responses: int, numbers: int, layout: _OctaveLayout, out: Any
) -> None:  # pragma: no cover  # compiled
    """Join the ends of each grid: (R, 2, G) integers to (R, ``numbers``, 2), the left ear real, the right imaginary."""
    i = cuda.grid(1)
    r = i // numbers
    if r >= responses:
        return
    e = i - r * numbers
    band = _OCTAVES - 1
    while band > 0 and (layout.length[band] == 0 or layout.folded[band] > e):
        band -= 1
    rank, length = layout.rank[band], layout.length[band]
    place = e - layout.folded[band]
    n = place // rank
    at = layout.first[band] + place
    for ear in range(2):
        total = grids[r, ear, at + _BEFORE * rank]
        if n >= length - _BEFORE:
            total += grids[r, ear, at - (length - _BEFORE) * rank]
        if n < TAPS - _BEFORE:
            total += grids[r, ear, at + (_BEFORE + length) * rank]
        out[r, e, ear] = total / _UNIT


@kernel
def _filtered(  # pragma: no cover  # compiled
    first: Any, second: Any, responses: int, samples: int, layout: _OctaveLayout, filters: Any, out: Any
) -> None:
    """Filter and add up the spectra of all octaves and components: (R, ``samples``, 2), both ears in one spectrum.

    Args:
        first: (R, n, 2) spectra of the octaves that are not swapped.
        second: (R, n, 2) spectra of the others.
        responses: R.
        samples: of the response's transform; even.
        layout: of the octaves.
        filters: (F, 2) real and imaginary parts.
        out: filled in.
    """
    i = cuda.grid(1)
    half = samples // 2
    r = i // (half + 1)
    if r >= responses:
        return
    f = i - r * (half + 1)
    left_re, left_im, right_re, right_im = 0.0, 0.0, 0.0, 0.0
    for band in range(_OCTAVES):
        if f < layout.bins[band]:
            rank, length = layout.rank[band], layout.length[band]
            up = layout.folded[band] + f * rank
            down = layout.folded[band] + ((length - f) % length) * rank
            weight = layout.filters[band] + f * rank
            for k in range(rank):
                if layout.swapped[band] == 1:
                    a, b = second[r, up + k, 0], second[r, up + k, 1]
                    c, d = second[r, down + k, 0], second[r, down + k, 1]
                else:
                    a, b = first[r, up + k, 0], first[r, up + k, 1]
                    c, d = first[r, down + k, 0], first[r, down + k, 1]
                g, h = filters[weight + k, 0], filters[weight + k, 1]
                # Both ears from the sum: left = (z(f) + z*(−f))/2, right = (z(f) − z*(−f))/2i.
                x, y = 0.5 * (a + c), 0.5 * (b - d)
                left_re += x * g - y * h
                left_im += x * h + y * g
                x, y = 0.5 * (b + d), 0.5 * (c - a)
                right_re += x * g - y * h
                right_im += x * h + y * g
    if f == 0 or f == half:
        left_im, right_im = 0.0, 0.0
    out[r, f, 0], out[r, f, 1] = left_re - right_im, left_im + right_re
    if f > 0 and f < half:
        out[r, samples - f, 0], out[r, samples - f, 1] = left_re + right_im, right_re - left_im


@kernel
def _taken(  # pragma: no cover  # compiled
    spectra: Any, responses: int, period: int, samples: Any, first: Any, longest: int, out: Any
) -> None:
    """The beginnings of series of ``period`` samples, one after the other: left ear, right ear of each response.

    Args:
        spectra: (R, period, 2).
        responses: R.
        period: of the series.
        samples: (R,) int64, length of each response.
        first: (R,) int64, where each response begins.
        longest: of ``samples``.
        out: float32, filled in.
    """
    i = cuda.grid(1)
    r = i // longest
    if r < responses:
        n = i - r * longest
        if n < samples[r]:
            out[first[r] + n] = spectra[r, n, 0] / period
            out[first[r] + samples[r] + n] = spectra[r, n, 1] / period


@dataclass(frozen=True, eq=False)
class _Tables:
    """Tables for responses of one length.

    Attributes:
        layout: on the device.
        swapped: per octave.
        integers: of one ear of a response.
        numbers: complex ones of a response.
        memory: device memory of a response, bytes.
        filters: (F, 2) on the device.
    """

    layout: _OctaveLayout
    integers: int
    numbers: int
    memory: int
    filters: Any


def _tables(ears: Ears, grids: Grids) -> _Tables:
    columns, ranks = np.array(ears.basis.columns).T
    lengths = grids.lengths
    sizes = np.where(lengths > 0, lengths + TAPS, 0) * ranks
    inside = lengths * ranks
    filters = [each for each, length in zip(ears.basis.filters(grids), lengths, strict=True) if length]
    weights = np.where(lengths > 0, grids.bins * ranks, 0)
    layout = _OctaveLayout(
        np.cumsum(sizes) - sizes,
        lengths,
        ranks,
        columns,
        np.cumsum(inside) - inside,
        np.where(lengths > 0, grids.bins, 0),
        np.cumsum(weights) - weights,
        np.array([len(factors(int(length))) % 2 if length else 0 for length in lengths]),
    )
    flat = np.concatenate([each.reshape(-1) for each in filters])
    # Integers of both ears, two arrays of spectra, two of the response as float64, and the response.
    memory = 2 * 8 * int(sizes.sum()) + 2 * 8 * int(inside.sum()) + (2 * 16 + 2 * 4) * grids.samples
    return _Tables(
        upload(_OctaveLayout(*(np.ascontiguousarray(each, dtype=np.int64) for each in layout)), "tables of a receiver"),
        int(sizes.sum()),
        int(inside.sum()),
        memory,
        upload(np.stack([flat.real, flat.imag], axis=1).astype(np.float32), "filters of a receiver"),
    )


class DeviceEars:
    """Both ears of a head on the device, at one sample rate.

    Raises:
        Avs3dError: if the sample rate is out of range.
        OutOfDeviceMemoryError: if the tables do not fit.
    """

    def __init__(self, ears: Ears, sample_rate: int) -> None:
        checked(Arrivals.none(), np.eye(3), sample_rate)
        self._ears, self._rate = ears, sample_rate
        self._rows = upload(ears.basis.rows, "weights of a receiver")
        self._residual = upload(np.ascontiguousarray(ears.residual), "delays of a receiver")
        self._window = upload(window_table(), "tables of a receiver")
        self._lengths: OrderedDict[int, _Tables] = OrderedDict()
        self._together = 1 if is_simulated() else _TOGETHER

    @property
    def near(self) -> NearField | None:
        """See `Ears.near`."""
        return self._ears.near

    def responses(
        self, heard: Sequence[DeviceRecords], latest: F64, listeners: Sequence[int], rotations: Sequence[F64]
    ) -> list[F32]:
        """Binaural responses (2, m) float32, one for each of ``listeners``, no two of which are the same.

        Args:
            heard: records.
            latest: (L,) s, the last arrival at each listener.
            listeners: numbers of the listeners.
            rotations: (3, 3) each, orthonormal, listener to world.

        Raises:
            OutOfDeviceMemoryError: if the device has too little memory for one response.
        """
        samples = [math.ceil((float(latest[j]) + self._ears.reach + TAIL) * self._rate) for j in listeners]
        grids = [grids_of_length(each, self._rate) for each in samples]
        found: list[F32] = [np.zeros((2, 0), dtype=np.float32)] * len(listeners)
        for length in sorted({each.samples for each in grids}):
            members = [at for at, each in enumerate(grids) if each.samples == length]

            def work(first: int, last: int, members: list[int] = members) -> None:
                some = members[first:last]
                out = self._of_one_length(
                    heard,
                    grids[some[0]],
                    len(latest),
                    [listeners[at] for at in some],
                    np.stack([np.asarray(rotations[at], dtype=np.float64) for at in some]),
                    [samples[at] for at in some],
                )
                for response, at in zip(out, some, strict=True):
                    found[at] = response

            batch = self._batch(self._tables(grids[members[0]]))
            fitted = in_batches(work, len(members), batch)
            if fitted < batch:
                self._together = fitted
        return found

    def _batch(self, tables: _Tables) -> int:
        """How many responses of one length are computed together."""
        return max(1, min(self._together, _MEMORY // tables.memory))

    def _of_one_length(
        self,
        heard: Sequence[DeviceRecords],
        grids: Grids,
        heads: int,
        listeners: list[int],
        rotations: F64,
        samples: list[int],
    ) -> list[F32]:
        """(2, m) of each response, m samples; all of them are parts of one array."""
        count = len(listeners)
        tables = self._tables(grids)
        response_of = np.full(heads, -1, dtype=np.int32)
        response_of[listeners] = np.arange(count)
        integers = allocate((count, 2, tables.integers), np.int64, "the grids of responses")
        launch(_clear, integers.size, integers.reshape(integers.size), integers.size)
        where, turns = upload(response_of), upload(np.ascontiguousarray(rotations))
        ears = self._ears
        for part in heard:
            launch(
                _spread, part.records * _LANES, part, where, turns, ears.kind, ears.first_row, self._residual,
                self._rows, self._window, tables.layout, grids.period, integers,
            )  # fmt: skip
        x = allocate((count, tables.numbers, 2), np.float32, "the spectra of responses")
        y = allocate((count, tables.numbers, 2), np.float32, "the spectra of responses")
        launch(_fold, count * tables.numbers, integers, count, tables.numbers, tables.layout, x)
        at = 0
        for length, (_, rank) in zip(grids.lengths.tolist(), ears.basis.columns, strict=True):
            if length:
                transform(x, y, count, at, length, rank)
                at += length * rank
        a = allocate((count, grids.samples, 2), np.float64, "responses")
        b = allocate((count, grids.samples, 2), np.float64, "responses")
        bins = grids.samples // 2 + 1
        launch(_filtered, count * bins, x, y, count, grids.samples, tables.layout, tables.filters, a)
        series = b if transform(a, b, count, 0, grids.samples, 1, inverse=True) else a
        ends = 2 * np.cumsum(np.array(samples, dtype=np.int64))
        out = allocate(int(ends[-1]), np.float32, "responses")
        lengths, first = np.array(samples, dtype=np.int64), np.concatenate([[0], ends[:-1]])
        launch(
            _taken, count * max(samples), series, count, grids.samples, upload(lengths), upload(first), max(samples),
            out,
        )  # fmt: skip
        flat = out.copy_to_host()
        return [part.reshape(2, -1) for part in np.split(flat, ends[:-1])]

    def _tables(self, grids: Grids) -> _Tables:
        if grids.samples not in self._lengths:
            if len(self._lengths) >= _LENGTHS:
                self._lengths.popitem(last=False)
            self._lengths[grids.samples] = _tables(self._ears, grids)
        self._lengths.move_to_end(grids.samples)
        return self._lengths[grids.samples]
