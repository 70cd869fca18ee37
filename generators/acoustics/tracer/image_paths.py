"""The compiled loop over image sources: whether the path of each to a listener exists, and how much of it.

Written for numba's CPU and CUDA targets alike, as `generators.acoustics.tracer.kernels`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.tracer.fading import (
    ANY,
    BACK,
    FRONT,
    LEAST_SHARE,
    carried,
    may_touch,
    most_left,
    obstructed,
    zone_variance,
)
from generators.acoustics.tracer.kernels import OFFSET, SAME_PLANE, closest, meets_plane
from generators.acoustics.tracer.tables import MeshTables, Rims
from generators.core.jit import inline, njit

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]

#: Octave bands.
_BANDS = 8


@inline
def _free_leg(
    mesh: MeshTables,
    rims: Rims,
    plane_equation: F64,
    own: int,
    wanted: int,
    whole: bool,
    x: float,
    y: float,
    z: float,
    dx: float,
    dy: float,
    dz: float,
    length: float,
    start: float,
    travelled: float,
    total: float,
    share: F64,
    factor: F64,
    passing: F64,
    stack: I32,
    entries: F64,
) -> bool:
    """Whether a leg of a path is free but for surfaces whose rims are near, which lower ``passing`` (8,).

    Args:
        mesh: the triangles.
        rims: of the mirror planes.
        plane_equation: (P, 4).
        own: plane that the leg begins on, or −1.
        wanted: plane that it ends on; −1 for the source.
        whole: whether it must meet a triangle of that plane there.
        x: where it begins, m.
        y: the same.
        z: the same.
        dx: unit direction.
        dy: the same.
        dz: the same.
        length: metres.
        start: metres after which obstacles count.
        travelled: metres of the path before the leg.
        total: length of the path, m.
        share: (8,) scratch.
        factor: (8,) what the surfaces carry of the path.
        passing: changed.
        stack: scratch of the traversal.
        entries: scratch of the traversal.
    """
    bounds, links, corners, plane = mesh.bounds, mesh.links, mesh.corners, mesh.plane
    at = start
    while True:
        sx, sy, sz = x + at * dx, y + at * dy, z + at * dz
        limit = length - at + (SAME_PLANE if wanted >= 0 else -OFFSET)
        if limit <= 0.0:
            return True
        t, hit = closest(bounds, links, corners, sx, sy, sz, dx, dy, dz, limit, False, stack, entries)
        if hit < 0:
            return wanted < 0 or not whole
        if wanted >= 0 and at + t >= length - SAME_PLANE:
            # Another plane is met on an edge, or where two surfaces are in one place.
            return (
                not whole
                or plane[hit] == wanted
                or meets_plane(bounds, links, corners, plane, wanted, sx, sy, sz, dx, dy, dz, limit, stack)
            )
        at += t
        q = plane[hit]
        if q >= 0:
            px, py, pz = x + at * dx, y + at * dy, z + at * dz
            variance = zone_variance(travelled + at, total - travelled - at)
            if not (rims.is_open[q] and carried(rims, q, ANY, px, py, pz, dx, dy, dz, variance, share)):
                return False
            for b in range(_BANDS):
                passing[b] = min(passing[b], 1.0 - share[b])
            if most_left(factor, passing) < LEAST_SHARE:
                return False
        elif not obstructed(
            rims, plane_equation, own, wanted, x, y, z, dx, dy, dz, length, travelled, total, at, share, factor, passing
        ):
            return False
        at += OFFSET


@njit
def visible_images(
    mesh: MeshTables,
    rims: Rims,
    plane_equation: F64,
    listener: F64,
    source: F64,
    sequences: I32,
    images: F64,
    first: int,
    last: int,
    visible: NDArray[np.bool_],
    weight: F32,
    points: F64,
    shares: F64,
    stack: I32,
    entries: F64,
) -> None:
    """How much of each image source's path to a listener exists: points on the right surfaces, all legs free.

    Args:
        mesh: the triangles.
        rims: of the mirror planes.
        plane_equation: (P, 4) unit normal and offset of the mirror planes, n·x = o.
        listener: (3,).
        source: (3,).
        sequences: (S, K) planes in the order in which the sound meets them, −1 behind the last.
        images: (S, K, 3) images of the source after 1 … K reflections.
        first: the first sequence to look at.
        last: the sequence at which to stop.
        visible: (S,) filled in from ``first`` to ``last``.
        weight: (S, 8) factor of the amplitude, filled in where ``visible``: what the surfaces carry of the path (see
            `generators.acoustics.tracer.fading`); 1 if all their rims are far away.
        points: (K, 4) scratch.
        shares: (3, 8) scratch.
        stack: scratch of the traversal.
        entries: scratch of the traversal.
    """
    share, factor, passing = shares[0], shares[1], shares[2]
    for s in range(first, last):
        visible[s] = False
        order = 0
        while order < sequences.shape[1] and sequences[s, order] >= 0:
            order += 1
        for b in range(_BANDS):
            factor[b], passing[b] = 1.0, 1.0
        x, y, z = listener[0], listener[1], listener[2]
        ex, ey, ez = images[s, order - 1, 0] - x, images[s, order - 1, 1] - y, images[s, order - 1, 2] - z
        total, travelled = math.sqrt(ex * ex + ey * ey + ez * ez), 0.0
        # Backwards from the listener: where the line to the image meets the plane, if it is near its surface.
        possible = True
        for k in range(order - 1, -1, -1):
            p = sequences[s, k]
            a, b, c, o = plane_equation[p, 0], plane_equation[p, 1], plane_equation[p, 2], plane_equation[p, 3]
            here = a * x + b * y + c * z - o
            there = a * images[s, k, 0] + b * images[s, k, 1] + c * images[s, k, 2] - o
            # On the plane already: a path by way of an edge, with two reflections in one point.
            on_plane = abs(here) < 1e-9
            if not on_plane and here * there >= 0.0:
                possible = False
                break
            part = 0.0 if on_plane else here / (here - there)
            dx, dy, dz = images[s, k, 0] - x, images[s, k, 1] - y, images[s, k, 2] - z
            far = max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-12)
            x, y, z = x + part * dx, y + part * dy, z + part * dz
            travelled += part * far
            points[k, 0], points[k, 1], points[k, 2], points[k, 3] = x, y, z, 0.0
            variance = zone_variance(travelled, total - travelled)
            if not may_touch(rims, p, x, y, z, (there - here) / far, variance):
                possible = False
                break
            side = FRONT if here > 0.0 else BACK
            if (
                rims.is_open[p]
                and not on_plane
                and carried(rims, p, side, x, y, z, dx / far, dy / far, dz / far, variance, share)
            ):
                points[k, 3] = 1.0
                for b in range(_BANDS):
                    factor[b] *= share[b]
                possible = most_left(factor, passing) > LEAST_SHARE
            if not possible:
                break
        if not possible:
            continue
        x, y, z = listener[0], listener[1], listener[2]
        travelled = 0.0
        for k in range(order - 1, -2, -1):
            tx, ty, tz = source[0], source[1], source[2]
            if k >= 0:
                tx, ty, tz = points[k, 0], points[k, 1], points[k, 2]
            dx, dy, dz = tx - x, ty - y, tz - z
            length = math.sqrt(dx * dx + dy * dy + dz * dz)
            if length < 1e-9:
                continue
            # Away from the surface of the last reflection.
            start = min(SAME_PLANE, 0.5 * length) if k < order - 1 else OFFSET
            own = sequences[s, k + 1] if k < order - 1 else -1
            possible = _free_leg(
                mesh,
                rims,
                plane_equation,
                own,
                sequences[s, k] if k >= 0 else -1,
                k >= 0 and points[k, 3] == 0.0,
                x,
                y,
                z,
                dx / length,
                dy / length,
                dz / length,
                length,
                start,
                travelled,
                total,
                share,
                factor,
                passing,
                stack,
                entries,
            )
            if not possible:
                break
            travelled += length
            x, y, z = tx, ty, tz
        if not possible:
            continue
        x, y, z = listener[0], listener[1], listener[2]
        travelled = 0.0
        for k in range(order - 1, -2, -1):  # what is near a leg without being in the way
            tx, ty, tz = source[0], source[1], source[2]
            if k >= 0:
                tx, ty, tz = points[k, 0], points[k, 1], points[k, 2]
            dx, dy, dz = tx - x, ty - y, tz - z
            length = math.sqrt(dx * dx + dy * dy + dz * dz)
            if length < 1e-9:
                continue
            own, wanted = sequences[s, k + 1] if k < order - 1 else -1, sequences[s, k] if k >= 0 else -1
            dx, dy, dz = dx / length, dy / length, dz / length
            obstructed(
                rims,
                plane_equation,
                own,
                wanted,
                x,
                y,
                z,
                dx,
                dy,
                dz,
                length,
                travelled,
                total,
                -1.0,
                share,
                factor,
                passing,
            )
            travelled += length
            x, y, z = tx, ty, tz
        for b in range(_BANDS):
            weight[s, b] = factor[b] * passing[b]
        visible[s] = most_left(factor, passing) > LEAST_SHARE
