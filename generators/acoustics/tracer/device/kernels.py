"""The tracer's kernels on a CUDA device: one thread per ray, image source or line of diffuse rain.

What happens to a ray is in `generators.acoustics.tracer.kernels`, whose functions the CPU's loops call as well.

Records are appended in the order in which threads come to them, which is another one in every run. Each has a ``rank``
that gives back the CPU's order; receivers add up integers (`generators.acoustics.tracer.device.binaural`), in whose
sums no order matters.
"""

from __future__ import annotations

from typing import Any

import numba.cuda
import numpy as np

from generators.acoustics.tracer.image_paths import visible_images
from generators.acoustics.tracer.kernels import (
    FAR,
    OFFSET,
    closest,
    crossings,
    emit,
    is_of_another_part,
    may_pass,
    rain_gain,
    rain_line,
    reflect_late,
    scatter_rain,
    specular_planes,
    write_passage,
    write_record,
)
from generators.core.bvh import STACK
from generators.core.cuda import kernel

cuda: Any = numba.cuda

#: Octave bands.
_BANDS = 8
#: Most threads per block of `late`: few, since all of them go on until the last ray of the block has ended.
LATE_BLOCK = 32
#: Most reflections of an image source.
_MOST_ORDER = 4


@kernel
def search(mesh: Any, source: Any, directions: Any, planes: Any) -> None:  # pragma: no cover  # compiled
    """`specular_planes`, one thread per ray."""
    ray = cuda.grid(1)
    if ray < directions.shape[0]:
        stack, entries = cuda.local.array(STACK, np.int32), cuda.local.array(STACK, np.float64)
        specular_planes(mesh, source, directions, ray, ray + 1, planes, stack, entries)


@kernel
def visibility(  # pragma: no cover  # compiled
    mesh: Any,
    rims: Any,
    plane_equation: Any,
    listeners: Any,
    source: Any,
    sequences: Any,
    images: Any,
    visible: Any,
    weight: Any,
) -> None:
    """`visible_images` into ``visible`` (L, S) and ``weight`` (L, S, 8), one thread per listener and image source."""
    i = cuda.grid(1)
    if i < visible.shape[0] * visible.shape[1]:
        stack, entries = cuda.local.array(STACK, np.int32), cuda.local.array(STACK, np.float64)
        points = cuda.local.array((_MOST_ORDER, 4), np.float64)
        shares = cuda.local.array((3, _BANDS), np.float64)
        j = i // visible.shape[1]
        s = i - j * visible.shape[1]
        visible_images(
            mesh, rims, plane_equation, listeners[j], source, sequences, images, s, s + 1, visible[j], weight[j],
            points, shares, stack, entries,
        )  # fmt: skip


@kernel
def walls_between(  # pragma: no cover  # compiled
    mesh: Any, rims: Any, listeners: Any, source: Any, most: int, between: Any, hidden: Any
) -> None:
    """`crossings` into ``between`` (L,) and ``hidden`` (L, 8), one thread per listener."""
    j = cuda.grid(1)
    if j < between.shape[0]:
        stack, entries = cuda.local.array(STACK, np.int32), cuda.local.array(STACK, np.float64)
        share = cuda.local.array(_BANDS, np.float64)
        between[j] = crossings(mesh, rims, listeners[j], source, most, hidden[j], share, stack, entries)


@kernel
def late(  # pragma: no cover  # compiled
    mesh: Any,
    source: Any,
    directions: Any,
    emitted: Any,
    key: Any,
    listeners: Any,
    known: Any,
    air: Any,
    limits: Any,
    records: Any,
    ranks: Any,
    first_rank: int,
    latest: Any,
    count: Any,
) -> None:
    """`trace_late`, one thread per ray, in blocks of at most `LATE_BLOCK`.

    Args:
        mesh: and what follows: as for `trace_late`.
        source: (3,).
        directions: (N, 3).
        emitted: (N, 8).
        key: (2,).
        listeners: L discs.
        known: sorted keys.
        air: (8,).
        limits: where a ray ends.
        records: written while there is room.
        ranks: (C,) int64, place of each record in the CPU's order, up to the listener.
        first_rank: of these records.
        latest: (L,) float64, longest path at each listener; raised.
        count: (1,) int64, number of records so far; raised by the passages found, more than there was room for perhaps.
    """
    ray = cuda.grid(1)
    own, threads = cuda.threadIdx.x, cuda.blockDim.x
    stack, entries = cuda.local.array(STACK, np.int32), cuda.local.array(STACK, np.float64)
    energy = cuda.local.array(_BANDS, np.float64)
    # A ray that passes one of many listeners passes most of its neighbours: the threads of a block share this work.
    lines = cuda.shared.array((LATE_BLOCK, 10), np.float64)
    energies = cuda.shared.array((LATE_BLOCK, _BANDS), np.float64)
    passing = cuda.shared.array(LATE_BLOCK, np.int64)
    bounds, links, corners = mesh.bounds, mesh.links, mesh.corners
    lx, ly, lz, radius2 = listeners.x, listeners.y, listeners.z, listeners.radius2
    room = records.path.shape[0]
    share = 4.0 / directions.shape[0]
    ox, oy, oz, dx, dy, dz = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0
    going, strongest = ray < directions.shape[0], 0.0
    if going:
        ox, oy, oz = source[0], source[1], source[2]
        dx, dy, dz = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        strongest = emit(emitted, ray, energy)
    travelled, spherical, sign = 0.0, 0.0, 1.0
    mirrored, sequence, rained = True, 0, False
    bounce = 0
    while cuda.syncthreads_or(np.int32(1) if going else np.int32(0)):
        length, hit = 0.0, -1
        passing[own] = -1
        if going:
            length, hit = closest(bounds, links, corners, ox, oy, oz, dx, dy, dz, FAR, False, stack, entries)
            reach = min(length, limits.range)
            if not is_of_another_part(bounce, rained, mirrored, sequence, limits.early, known) and may_pass(
                listeners.bounds, ox, oy, oz, ox + reach * dx, oy + reach * dy, oz + reach * dz
            ):
                passing[own] = first_rank + ray * (limits.depth + 1) + bounce
                lines[own, 0], lines[own, 1], lines[own, 2] = ox, oy, oz
                lines[own, 3], lines[own, 4], lines[own, 5] = dx, dy, dz
                lines[own, 6], lines[own, 7], lines[own, 8], lines[own, 9] = length, travelled, spherical, sign
                for b in range(_BANDS):
                    energies[own, b] = energy[b]
        cuda.syncthreads()
        for k in range(threads):
            if passing[k] < 0:
                continue
            sx, sy, sz, tx, ty, tz = lines[k, 0], lines[k, 1], lines[k, 2], lines[k, 3], lines[k, 4], lines[k, 5]
            for j in range(own, lx.shape[0], threads):
                px, py, pz = lx[j] - sx, ly[j] - sy, lz[j] - sz
                t = px * tx + py * ty + pz * tz
                off = px * px + py * py + pz * pz - t * t
                if t >= 0.0 and t < lines[k, 6] and off < radius2[j]:
                    at = cuda.atomic.add(count, 0, 1)
                    if at < room:
                        write_passage(
                            records, at, j, listeners, sx, sy, sz, tx, ty, tz, lines[k, 7], lines[k, 8], lines[k, 9],
                            share, energies[k], air,
                        )  # fmt: skip
                        ranks[at] = passing[k]
                        cuda.atomic.max(latest, j, lines[k, 7] + t)
        cuda.syncthreads()
        if going:
            travelled += length
            if hit < 0 or bounce == limits.depth or travelled > limits.range:
                going = False
            else:
                loudest, ox, oy, oz, dx, dy, dz, spherical, sign, mirrored, sequence, rained = reflect_late(
                    mesh, key, limits, ray, bounce, hit, length, ox, oy, oz, dx, dy, dz, spherical, mirrored,
                    sequence, energy,
                )  # fmt: skip
                going = loudest > 0.0 and loudest >= limits.floor * strongest
        bounce += 1


@kernel
def rain(  # pragma: no cover  # compiled
    mesh: Any,
    source: Any,
    directions: Any,
    emitted: Any,
    key: Any,
    listeners: Any,
    air: Any,
    limits: Any,
    records: Any,
    ranks: Any,
    latest: Any,
    count: Any,
) -> None:
    """`trace_rain`, one thread per ray and listener, with ranks from 0 on; the arguments are those of `late`."""
    i = cuda.grid(1)
    heads = listeners.x.shape[0]
    if i >= directions.shape[0] * heads:
        return
    stack, entries = cuda.local.array(STACK, np.int32), cuda.local.array(STACK, np.float64)
    energy, diffused = cuda.local.array(_BANDS, np.float64), cuda.local.array(_BANDS, np.float64)
    bounds, links, corners = mesh.bounds, mesh.links, mesh.corners
    # Neighbouring threads have the same ray, and other listeners.
    ray = i // heads
    j = i - ray * heads
    room = records.path.shape[0]
    share = 4.0 / directions.shape[0]
    ox, oy, oz = source[0], source[1], source[2]
    dx, dy, dz = directions[ray, 0], directions[ray, 1], directions[ray, 2]
    emit(emitted, ray, energy)
    travelled = 0.0
    for bounce in range(limits.rain):
        length, hit = closest(bounds, links, corners, ox, oy, oz, dx, dy, dz, FAR, False, stack, entries)
        travelled += length
        if hit < 0 or travelled > limits.range:
            break
        ox, oy, oz = ox + length * dx, oy + length * dy, oz + length * dz
        loudest, sign, nx, ny, nz, dx, dy, dz = scatter_rain(
            mesh, key, ray, bounce, hit, dx, dy, dz, bounce < limits.exact, energy, diffused
        )
        ox, oy, oz = ox + OFFSET * nx, oy + OFFSET * ny, oz + OFFSET * nz
        if loudest > 0.0:
            d, px, py, pz, cosine = rain_line(
                bounds, links, corners, listeners.x[j], listeners.y[j], listeners.z[j], ox, oy, oz, nx, ny, nz,
                stack, entries,
            )  # fmt: skip
            if cosine > 0.0:
                at = cuda.atomic.add(count, 0, 1)
                if at < room:
                    gain = rain_gain(share, cosine, d)
                    write_record(records, at, j, travelled + d, -px, -py, -pz, sign, gain, diffused, air)
                    ranks[at] = ray * limits.rain + bounce
                    cuda.atomic.max(latest, j, travelled + d)
