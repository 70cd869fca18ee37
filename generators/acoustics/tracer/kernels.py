"""The compiled inner loops of the tracer: rays through the tree, reflections, detection at listeners.

Written for numba's CPU and CUDA targets alike: scalars and arrays only, no recursion, no allocation in what runs per
ray (the caller hands in the stacks). All lengths in metres, directions of unit length, numbers float64.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.tracer.fading import (
    ANY,
    carried,
    zone_variance,
)
from generators.acoustics.tracer.philox import philox4x32, uniform
from generators.acoustics.tracer.tables import Listeners, MeshTables, Records, Rims, TraceLimits
from generators.core.jit import inline, njit

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]

#: A ray goes on this far (m) before the surface that it was reflected from: far above rounding (1e-14 m at 10 m), far
#: below any gap in a mesh.
OFFSET = 1e-6
#: The edges of a triangle belong to it, and a little more: no ray slips between two triangles that share one.
_EDGE = 1e-9
#: Surfaces in one place to within this distance (m), such as a cabinet's side and the wall that it stands at: far above
#: rounding, so that it is not rounding which decides what a ray meets.
_TIE = 1e-10
#: Distance that stands for infinity.
FAR = 1e30
#: Nothing is louder than at this distance (m).
NEAREST = 0.1
#: Octave bands.
_BANDS = 8
#: A source is fully behind a surface that hides ½ + ½/`_BEHIND` of it: a third of the zone's width from the edge.
_BEHIND = 4.0
#: Purpose of random numbers: third word of the counter.
LATE, RAIN = 0, 1
#: Triangles of one mirror plane lie in it to within this distance (m).
SAME_PLANE = 1e-3
_ZERO, _ONE = np.uint64(0), np.uint64(1)


@inline
def _inverse(d: float) -> float:
    return 1.0 / d if abs(d) > 1e-30 else math.copysign(FAR, d)


@inline
def _entry(bounds: F64, node: int, ox: float, oy: float, oz: float, ix: float, iy: float, iz: float) -> float:
    """Distance at which a ray enters a box (0 if it starts in it), or `FAR`."""
    a, b = (bounds[node, 0] - ox) * ix, (bounds[node, 3] - ox) * ix
    first, last = min(a, b), max(a, b)
    a, b = (bounds[node, 1] - oy) * iy, (bounds[node, 4] - oy) * iy
    first, last = max(first, min(a, b)), min(last, max(a, b))
    a, b = (bounds[node, 2] - oz) * iz, (bounds[node, 5] - oz) * iz
    first, last = max(first, min(a, b)), min(last, max(a, b))
    first = max(first, 0.0)
    # A flat box has first = last up to rounding.
    return first if first <= last * (1.0 + 1e-12) + 1e-12 else FAR


@inline
def _meets(corners: F64, i: int, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float) -> float:
    """Distance at which a ray meets triangle i, from either side, or `FAR`.

    Möller and Trumbore, "Fast, minimum storage ray-triangle intersection", J. Graphics Tools 2 (1997) 21–28.
    """
    e1x, e1y, e1z = corners[i, 3], corners[i, 4], corners[i, 5]
    e2x, e2y, e2z = corners[i, 6], corners[i, 7], corners[i, 8]
    px, py, pz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
    determinant = e1x * px + e1y * py + e1z * pz
    if abs(determinant) < 1e-18:
        return FAR
    inverse = 1.0 / determinant
    sx, sy, sz = ox - corners[i, 0], oy - corners[i, 1], oz - corners[i, 2]
    u = (sx * px + sy * py + sz * pz) * inverse
    if u < -_EDGE or u > 1.0 + _EDGE:
        return FAR
    qx, qy, qz = sy * e1z - sz * e1y, sz * e1x - sx * e1z, sx * e1y - sy * e1x
    v = (dx * qx + dy * qy + dz * qz) * inverse
    if v < -_EDGE or u + v > 1.0 + _EDGE:
        return FAR
    t = (e2x * qx + e2y * qy + e2z * qz) * inverse
    return t if t > 0.0 else FAR


@inline
def closest(
    bounds: F64,
    links: I32,
    corners: F64,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    limit: float,
    any_hit: bool,
    stack: I32,
    entries: F64,
) -> tuple[float, int]:
    """Find the first triangle nearer than ``limit`` along a ray; with ``any_hit``, any one.

    Of several triangles in one place it is the first in the order of the tree's leaves.

    Returns:
        its distance and index; ``limit`` and −1 without a hit.
    """
    best, found = limit, -1
    if corners.shape[0] == 0:
        return best, found
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    stack[0], entries[0] = 0, _entry(bounds, 0, ox, oy, oz, ix, iy, iz)
    top = 1
    while top > 0:
        top -= 1
        if entries[top] >= best + _TIE:
            continue
        node = stack[top]
        first, count = links[node, 0], links[node, 1]
        if count > 0:
            for i in range(first, first + count):
                t = _meets(corners, i, ox, oy, oz, dx, dy, dz)
                if t < best - _TIE or (t < best + _TIE and t < limit and (i < found or found < 0)):
                    best, found = t, i
            if any_hit and found >= 0:
                return best, found
        else:
            left = _entry(bounds, first, ox, oy, oz, ix, iy, iz)
            right = _entry(bounds, first + 1, ox, oy, oz, ix, iy, iz)
            near, far, near_at, far_at = first, first + 1, left, right
            if right < left:
                near, far, near_at, far_at = first + 1, first, right, left
            if far_at < best + _TIE:
                stack[top], entries[top] = far, far_at
                top += 1
            if near_at < best + _TIE:
                stack[top], entries[top] = near, near_at
                top += 1
    return best, found


@njit
def closest_hits(
    mesh: MeshTables, origins: F64, directions: F64, distance: F64, triangle: I32, stack: I32, entries: F64
) -> None:
    """First hits of many rays: ``distance`` (R,), `FAR` without a hit, and ``triangle`` (R,), −1 without."""
    for r in range(len(directions)):
        distance[r], triangle[r] = closest(
            mesh.bounds,
            mesh.links,
            mesh.corners,
            origins[r, 0],
            origins[r, 1],
            origins[r, 2],
            directions[r, 0],
            directions[r, 1],
            directions[r, 2],
            FAR,
            False,
            stack,
            entries,
        )


@njit
def crossings(
    mesh: MeshTables, rims: Rims, a: F64, b: F64, most: int, hidden: F64, share: F64, stack: I32, entries: F64
) -> int:
    """Number of surfaces between the points ``a`` and ``b`` (3,), their ends excepted; counts up to ``most``.

    ``hidden`` (8,) becomes how far the line is behind them: 0 on the edge of a surface, where the diffracted sound is
    continuous with the direct one, 1 a little away from it. ``share`` (8,) is scratch.
    """
    for k in range(_BANDS):
        hidden[k] = 0.0
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    if length <= 2.0 * OFFSET:
        return 0
    dx, dy, dz = dx / length, dy / length, dz / length
    at, count = OFFSET, 0
    while count < most:
        left = length - OFFSET - at
        if left <= 0.0:
            break
        x, y, z = a[0] + at * dx, a[1] + at * dy, a[2] + at * dz
        t, hit = closest(mesh.bounds, mesh.links, mesh.corners, x, y, z, dx, dy, dz, left, False, stack, entries)
        if hit < 0:
            break
        count += 1
        at += t
        q = mesh.plane[hit]
        variance = zone_variance(at, length - at)
        x, y, z = a[0] + at * dx, a[1] + at * dy, a[2] + at * dz
        if q >= 0 and rims.is_open[q] and carried(rims, q, ANY, x, y, z, dx, dy, dz, variance, share):
            for k in range(_BANDS):
                hidden[k] = max(hidden[k], min(_BEHIND * (2.0 * share[k] - 1.0), 1.0))
        else:
            for k in range(_BANDS):
                hidden[k] = 1.0
        at += OFFSET
    return count


@njit
def free_lines(
    mesh: MeshTables,
    point: F64,
    targets: F64,
    short: float,
    free: NDArray[np.bool_],
    stack: I32,
    entries: F64,
) -> None:
    """Whether nothing lies between ``point`` (3,) and ``short`` metres before each of ``targets`` (K, 3)."""
    for i in range(len(targets)):
        dx, dy, dz = targets[i, 0] - point[0], targets[i, 1] - point[1], targets[i, 2] - point[2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        free[i] = True
        if length > short:
            dx, dy, dz = dx / length, dy / length, dz / length
            _, hit = closest(
                mesh.bounds,
                mesh.links,
                mesh.corners,
                point[0],
                point[1],
                point[2],
                dx,
                dy,
                dz,
                length - short,
                True,
                stack,
                entries,
            )
            free[i] = hit < 0


@njit
def specular_planes(
    mesh: MeshTables, source: F64, directions: F64, first: int, last: int, planes: I32, stack: I32, entries: F64
) -> None:
    """The mirror planes that the rays ``first`` to ``last`` meet: ``planes`` (R, K) int32, −1 behind a ray's end.

    A ray ends where it leaves the scene or meets a surface that is no mirror plane.
    """
    bounds, links, corners, normals, plane = mesh.bounds, mesh.links, mesh.corners, mesh.normals, mesh.plane
    for r in range(first, last):
        ox, oy, oz = source[0], source[1], source[2]
        dx, dy, dz = directions[r, 0], directions[r, 1], directions[r, 2]
        for k in range(planes.shape[1]):
            planes[r, k] = -1
        for k in range(planes.shape[1]):
            t, hit = closest(bounds, links, corners, ox, oy, oz, dx, dy, dz, FAR, False, stack, entries)
            if hit < 0 or plane[hit] < 0:
                break
            planes[r, k] = plane[hit]
            nx, ny, nz = normals[hit, 0], normals[hit, 1], normals[hit, 2]
            cosine = dx * nx + dy * ny + dz * nz
            if cosine > 0.0:
                nx, ny, nz, cosine = -nx, -ny, -nz, -cosine
            ox, oy, oz = ox + t * dx + OFFSET * nx, oy + t * dy + OFFSET * ny, oz + t * dz + OFFSET * nz
            dx, dy, dz = dx - 2.0 * cosine * nx, dy - 2.0 * cosine * ny, dz - 2.0 * cosine * nz


@inline
def meets_plane(
    bounds: F64,
    links: I32,
    corners: F64,
    plane: I32,
    wanted: int,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    limit: float,
    stack: I32,
) -> bool:
    """Whether a ray meets a triangle of the plane ``wanted`` nearer than ``limit``, whatever lies in between."""
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if _entry(bounds, node, ox, oy, oz, ix, iy, iz) > limit:
            continue
        first, count = links[node, 0], links[node, 1]
        for i in range(first, first + count):
            if plane[i] == wanted and _meets(corners, i, ox, oy, oz, dx, dy, dz) < limit:
                return True
        if count == 0:
            stack[top], stack[top + 1] = first, first + 1
            top += 2
    return False


@inline
def _is_member(ordered: I64, key: int) -> bool:
    low, high = 0, len(ordered)
    while low < high:
        middle = (low + high) >> 1
        if ordered[middle] < key:
            low = middle + 1
        else:
            high = middle
    return low < len(ordered) and ordered[low] == key


@inline
def reflected(
    dx: float, dy: float, dz: float, nx: float, ny: float, nz: float, diffuse: bool, u: float, v: float
) -> tuple[float, float, float]:
    """Direction after a reflection at a surface whose normal faces the ray: Lambert's law, or the mirror's.

    The frame about the normal: T. Duff et al., "Building an orthonormal basis, revisited", JCGT 6 (2017).
    """
    if diffuse:
        sign = math.copysign(1.0, nz)
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        cosine, sine, turn = math.sqrt(u), math.sqrt(1.0 - u), 2.0 * math.pi * v
        x, y = sine * math.cos(turn), sine * math.sin(turn)
        rx = x * (1.0 + sign * nx * nx * a) + y * b + cosine * nx
        ry = x * sign * b + y * (sign + ny * ny * a) + cosine * ny
        rz = -x * sign * nx - y * ny + cosine * nz
    else:
        twice = 2.0 * (dx * nx + dy * ny + dz * nz)
        rx, ry, rz = dx - twice * nx, dy - twice * ny, dz - twice * nz
    # Rounding would add up over a hundred reflections.
    scale = 1.0 / math.sqrt(rx * rx + ry * ry + rz * rz)
    return rx * scale, ry * scale, rz * scale


@inline
def reflect_energy(
    energy: F64, reflection: F64, scattering: F64, mean: float, m: int, diffuse: bool, exact: bool
) -> float:
    """Multiply the energies (8,) of a ray by what a reflection leaves; return the largest of them.

    ``exact``: a ray is scattered with the mean probability s̄ and then weighted with s/s̄ or (1 − s)/(1 − s̄) per
    octave, so that the expectation is right in each octave.
    """
    largest = 0.0
    for b in range(_BANDS):
        e = energy[b] * reflection[m, b]
        if exact:
            e *= scattering[m, b] / mean if diffuse else (1.0 - scattering[m, b]) / (1.0 - mean)
        energy[b] = e
        largest = max(largest, e)
    return largest


@inline
def emit(emitted: F64, ray: int, energy: F64) -> float:
    """Fill ``energy`` (8,) with what a ray carries from the source; return the largest of it."""
    strongest = 0.0
    for b in range(_BANDS):
        energy[b] = emitted[ray, b]
        strongest = max(strongest, energy[b])
    return strongest


@inline
def write_record(
    records: Records,
    at: int,
    listener: int,
    path: float,
    x: float,
    y: float,
    z: float,
    sign: float,
    gain: float,
    energy: F64,
    air: F64,
) -> None:
    """Write record ``at``: the sound of ``energy`` (8,) times ``gain`` that comes from (x, y, z) after ``path`` m."""
    records.listener[at] = listener
    records.path[at] = path
    records.direction[at, 0], records.direction[at, 1], records.direction[at, 2] = x, y, z
    for b in range(_BANDS):
        records.pressure[at, b] = sign * math.sqrt(gain * energy[b]) * math.exp(-0.5 * air[b] * path)


@inline
def is_of_another_part(bounce: int, rained: bool, mirrored: bool, sequence: int, early: int, known: I64) -> bool:
    """Whether another part has what a ray carries on its way after ``bounce`` reflections (see `trace_late`)."""
    if bounce == 0 or rained:
        return True
    return mirrored and bounce <= early and _is_member(known, sequence)


@inline
def may_pass(box: F64, ox: float, oy: float, oz: float, ex: float, ey: float, ez: float) -> bool:
    """Whether the box about a line from o to e meets ``box`` (6,)."""
    return bool(
        min(ox, ex) <= box[3]
        and max(ox, ex) >= box[0]
        and min(oy, ey) <= box[4]
        and max(oy, ey) >= box[1]
        and min(oz, ez) <= box[5]
        and max(oz, ez) >= box[2]
    )


@inline
def write_passage(
    records: Records,
    at: int,
    j: int,
    listeners: Listeners,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    travelled: float,
    spherical: float,
    sign: float,
    share: float,
    energy: F64,
    air: F64,
) -> None:
    """Record that a ray from o along d passes the disc about listener ``j``; see `trace_late`."""
    px, py, pz = listeners.x[j] - ox, listeners.y[j] - oy, listeners.z[j] - oz
    t = px * dx + py * dy + pz * dz
    radius2 = listeners.radius2[j]
    spread = radius2 / max((spherical + t) ** 2 + px * px + py * py + pz * pz - t * t, 1e-30)
    # The rays of a point that come nearer than R: 2π·(1 − √(1 − R²/d²)), not πR²/d².
    gain = share / radius2 * 0.5 * (1.0 + math.sqrt(max(1.0 - spread, 0.0)))
    write_record(records, at, j, travelled + t, -dx, -dy, -dz, sign, gain, energy, air)


@inline
def reflect_late(
    mesh: MeshTables,
    key: NDArray[np.uint64],
    limits: TraceLimits,
    ray: int,
    bounce: int,
    hit: int,
    length: float,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    spherical: float,
    mirrored: bool,
    sequence: int,
    energy: F64,
) -> tuple[float, float, float, float, float, float, float, float, float, bool, int, bool]:
    """Reflect a ray of the late part at triangle ``hit``, ``length`` metres on; changes ``energy``.

    Returns:
        the largest energy left, the ray's new origin (3) and direction (3), the radius of its wave front, its sign,
        whether it has met mirrors alone and their sequence, and whether diffuse rain brings what it carries now.
    """
    nx, ny, nz = mesh.normals[hit, 0], mesh.normals[hit, 1], mesh.normals[hit, 2]
    if dx * nx + dy * ny + dz * nz > 0.0:
        nx, ny, nz = -nx, -ny, -nz
    m, plane = mesh.material[hit], mesh.plane[hit]
    w0, w1, w2, w3 = philox4x32(np.uint64(ray), np.uint64(bounce), np.uint64(LATE), _ZERO, key[0], key[1])
    mean = mesh.mean_scattering[m]
    diffuse = uniform(w2) < mean
    loudest = reflect_energy(energy, mesh.reflection, mesh.scattering, mean, m, diffuse, bounce < limits.exact)
    sign = 1.0 if (w3 & _ONE) == _ZERO else -1.0
    mirrored = mirrored and not diffuse and plane >= 0
    sequence = sequence * (limits.planes + 1) + plane + 1 if mirrored and bounce < limits.early else 0
    mirrored = mirrored and bounce < limits.early
    rained = diffuse and bounce < limits.rain
    # Radius of the wave front: it begins anew at each point that scatters.
    spherical = 0.0 if diffuse else spherical + length
    ox, oy, oz = ox + length * dx + OFFSET * nx, oy + length * dy + OFFSET * ny, oz + length * dz + OFFSET * nz
    dx, dy, dz = reflected(dx, dy, dz, nx, ny, nz, diffuse, uniform(w0), uniform(w1))
    return loudest, ox, oy, oz, dx, dy, dz, spherical, sign, mirrored, sequence, rained


@njit
def trace_late(
    mesh: MeshTables,
    source: F64,
    directions: F64,
    emitted: F64,
    first: int,
    last: int,
    key: NDArray[np.uint64],
    listeners: Listeners,
    known: I64,
    air: F64,
    limits: TraceLimits,
    records: Records,
    near: NDArray[np.bool_],
    energy: F64,
    stack: I32,
    entries: F64,
) -> int:
    """Follow rays from the source and record every passage by a listener.

    A ray that passes through the disc of radius R about a listener carries 1/N of the source's energy; on average over
    the rays, energy/(πR²) is the fluence there, which is what a point receiver measures. (Of the rays from a point at
    the distance d, the source or a point that scatters, not the share R²/4d² comes nearer than R but
    (1 − √(1 − R²/d²))/2; each is weighted with the ratio of both, so that the expectation is right in the near field.)

    Not recorded, because other parts have them: the direct sound; paths of mirror reflections whose sequence of planes
    is in ``known``; and the sound scattered at one of the first ``limits.rain`` reflections.

    Args:
        mesh: the triangles.
        source: (3,).
        directions: (N, 3) of all rays.
        emitted: (N, 8) energy that each carries from the source.
        first: the first ray to follow.
        last: the ray at which to stop.
        key: (2,) of the random numbers.
        listeners: L discs.
        known: sorted keys of sequences of mirror planes: k·(P + 1) + plane + 1 for each plane in turn, from k = 0.
        air: (8,) absorption of energy in the air, 1/m.
        limits: where a ray ends.
        records: written while there is room.
        near: (L,) scratch.
        energy: (8,) scratch.
        stack: scratch of the traversal.
        entries: scratch of the traversal.

    Returns:
        the number of passages, which may be more than there was room for.
    """
    bounds, links, corners = mesh.bounds, mesh.links, mesh.corners
    lx, ly, lz, radius2 = listeners.x, listeners.y, listeners.z, listeners.radius2
    count, room = 0, len(records.path)
    share = 4.0 / len(directions)  # 4π/N over πR²
    for ray in range(first, last):
        ox, oy, oz = source[0], source[1], source[2]
        dx, dy, dz = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        strongest = emit(emitted, ray, energy)
        travelled, spherical, sign = 0.0, 0.0, 1.0
        mirrored, sequence, rained = True, 0, False
        for bounce in range(limits.depth + 1):
            length, hit = closest(bounds, links, corners, ox, oy, oz, dx, dy, dz, FAR, False, stack, entries)
            reach = min(length, limits.range)
            if not is_of_another_part(bounce, rained, mirrored, sequence, limits.early, known) and may_pass(
                listeners.bounds, ox, oy, oz, ox + reach * dx, oy + reach * dy, oz + reach * dz
            ):
                # Without branches, for vector instructions.
                for j in range(len(lx)):
                    px, py, pz = lx[j] - ox, ly[j] - oy, lz[j] - oz
                    t = px * dx + py * dy + pz * dz
                    off = px * px + py * py + pz * pz - t * t
                    near[j] = (t >= 0.0) & (t < length) & (off < radius2[j])
                for j in range(len(lx)):
                    if near[j]:
                        if count < room:
                            write_passage(
                                records, count, j, listeners, ox, oy, oz, dx, dy, dz, travelled, spherical, sign,
                                share, energy, air,
                            )  # fmt: skip
                        count += 1
            travelled += length
            if hit < 0 or bounce == limits.depth or travelled > limits.range:
                break
            loudest, ox, oy, oz, dx, dy, dz, spherical, sign, mirrored, sequence, rained = reflect_late(
                mesh, key, limits, ray, bounce, hit, length, ox, oy, oz, dx, dy, dz, spherical, mirrored, sequence,
                energy,
            )  # fmt: skip
            if loudest <= 0.0 or loudest < limits.floor * strongest:
                break
    return count


@inline
def scatter_rain(
    mesh: MeshTables,
    key: NDArray[np.uint64],
    ray: int,
    bounce: int,
    hit: int,
    dx: float,
    dy: float,
    dz: float,
    exact: bool,
    energy: F64,
    diffused: F64,
) -> tuple[float, float, float, float, float, float, float, float]:
    """Fill ``diffused`` (8,) with what triangle ``hit`` scatters of a ray, and ``energy`` with what the ray keeps.

    Returns:
        the largest of ``diffused``, the sign, the normal that faces the ray (3), and the ray's new direction (3).
    """
    nx, ny, nz = mesh.normals[hit, 0], mesh.normals[hit, 1], mesh.normals[hit, 2]
    if dx * nx + dy * ny + dz * nz > 0.0:
        nx, ny, nz = -nx, -ny, -nz
    m = mesh.material[hit]
    w0, w1, w2, w3 = philox4x32(np.uint64(ray), np.uint64(bounce), np.uint64(RAIN), _ZERO, key[0], key[1])
    sign = 1.0 if (w3 & _ONE) == _ZERO else -1.0
    loudest = 0.0
    for b in range(_BANDS):
        diffused[b] = energy[b] * mesh.reflection[m, b] * mesh.scattering[m, b]
        loudest = max(loudest, diffused[b])
    mean = mesh.mean_scattering[m]
    diffuse = uniform(w2) < mean
    reflect_energy(energy, mesh.reflection, mesh.scattering, mean, m, diffuse, exact)
    dx, dy, dz = reflected(dx, dy, dz, nx, ny, nz, diffuse, uniform(w0), uniform(w1))
    return loudest, sign, nx, ny, nz, dx, dy, dz


@inline
def rain_line(
    bounds: F64,
    links: I32,
    corners: F64,
    x: float,
    y: float,
    z: float,
    ox: float,
    oy: float,
    oz: float,
    nx: float,
    ny: float,
    nz: float,
    stack: I32,
    entries: F64,
) -> tuple[float, float, float, float, float]:
    """The line from a point o of a surface with normal n to a listener: length d, direction (3), d·cos θ.

    The last is 0 where the listener is behind the surface or hidden.
    """
    px, py, pz = x - ox, y - oy, z - oz
    cosine = px * nx + py * ny + pz * nz
    if cosine <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    d = math.sqrt(px * px + py * py + pz * pz)
    px, py, pz = px / d, py / d, pz / d
    _, other = closest(bounds, links, corners, ox, oy, oz, px, py, pz, d, True, stack, entries)
    if other >= 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    return d, px, py, pz, cosine


@inline
def rain_gain(share: float, cosine: float, d: float) -> float:
    """Energy at a listener from a point that scatters after Lambert's law; ``cosine`` is cos θ times ``d``."""
    wide = max(d, NEAREST)
    return share * cosine / d / (wide * wide)


@njit
def trace_rain(
    mesh: MeshTables,
    source: F64,
    directions: F64,
    emitted: F64,
    first: int,
    last: int,
    key: NDArray[np.uint64],
    listeners: Listeners,
    air: F64,
    limits: TraceLimits,
    records: Records,
    energy: F64,
    diffused: F64,
    stack: I32,
    entries: F64,
) -> int:
    """Diffuse rain: the sound scattered at the first ``limits.rain`` reflections of each ray, sent to every listener.

    The scattered share s·(1 − α) of the energy leaves the surface after Lambert's law: cos θ/(π·d²) of it reaches a
    point at d metres that nothing hides (R. Heinz, Applied Acoustics 38 (1993) 145–159).

    The arguments and the result are those of `trace_late`; ``diffused`` (8,) is scratch.
    """
    bounds, links, corners = mesh.bounds, mesh.links, mesh.corners
    lx, ly, lz = listeners.x, listeners.y, listeners.z
    count, room = 0, len(records.path)
    share = 4.0 / len(directions)  # 4π/N over π
    for ray in range(first, last):
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
                for j in range(len(lx)):
                    d, px, py, pz, cosine = rain_line(
                        bounds, links, corners, lx[j], ly[j], lz[j], ox, oy, oz, nx, ny, nz, stack, entries
                    )
                    if cosine <= 0.0:
                        continue
                    if count < room:
                        gain = rain_gain(share, cosine, d)
                        write_record(records, count, j, travelled + d, -px, -py, -pz, sign, gain, diffused, air)
                    count += 1
    return count
