"""Rays against triangles on a CUDA device: the tree as the device reads it, its traversal, and `DeviceTracer`.

The counterpart of `generators.core.rays.Tracer`. Boxes are tested in float32 with a margin for rounding (T. Ize,
"Robust BVH ray traversal", JCGT 2 (2013) 12–27), triangles in float64: it costs little, since a ray tests few
triangles, and no ray slips between two that share an edge. The functions that one ray needs are compiled for the CPU as
well, where the tests hold them to Embree.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

import numba.cuda
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.core.bvh import STACK, build
from generators.core.cuda import allocate, in_batches, kernel, launch, pinned, require_device, upload
from generators.core.jit import inline
from generators.core.scene import F32, I32

cuda: Any = numba.cuda

#: Distance (direction lengths) of a ray that meets nothing: Embree's value, as `generators.core.rays` returns it.
FAR = np.float32(1e37)
#: Rays per launch at first: 45 bytes each on the device.
BATCH = 1 << 20
#: Smallest batch that is tried when memory runs out.
_LEAST = 1 << 14
#: Triangles of a leaf are counted in the lowest bits of its code.
_COUNT_BITS = 4
#: A direction's component below this counts as this: its reciprocal stays finite in float32.
_TINY = np.float32(1e-30)
#: Twice the relative rounding error of three operations, γ(3), by which a box's far side is moved away (Ize 2013).
_ROUNDING = np.float32(1.0 + 2.0 * 3.0 * 2.0**-24)
#: The edges of a triangle belong to it, and a little more.
_EDGE = 1e-9
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


class RayTree(NamedTuple):
    """Triangles in a tree, as kernels read them (on the device or on the host).

    Attributes:
        boxes: (N, 12) float32, of each inner node the lowest and highest corners of its two children.
        children: (N, 2) int32, number of an inner node, or −1 − code of a leaf: its first triangle · 16 + their number.
        corners: (T, 9) float32 corners of the triangles in the order of the leaves, metres.
        face: (T,) int32, the input's number of each of them.
    """

    boxes: F32
    children: I32
    corners: F32
    face: I32


def build_tree(triangles: F32) -> RayTree:
    """The tree over (F, 3, 3) float32 triangles.

    Raises:
        Avs3dError: if there is none, or a coordinate is not finite.
    """
    triangles = np.ascontiguousarray(triangles, dtype=np.float32)
    if triangles.ndim != 3 or triangles.shape[1:] != (3, 3) or len(triangles) == 0:
        raise Avs3dError(f"ray casting: triangles have shape {triangles.shape}, expected (F, 3, 3) with F ≥ 1")
    tree = build(triangles.astype(np.float64), "ray casting")
    first, count = tree.links[:, 0].astype(np.int64), tree.links[:, 1].astype(np.int64)
    is_inner = count == 0
    number = np.cumsum(is_inner) - 1
    code = np.where(is_inner, number, -1 - ((first << _COUNT_BITS) + count))
    if is_inner.any():
        left = first[is_inner]
        # Exact: every bound is a coordinate of a float32 corner.
        boxes = np.concatenate([tree.bounds[left], tree.bounds[left + 1]], axis=1)
        children = np.stack([code[left], code[left + 1]], axis=1)
    else:  # one leaf: a node whose second child has no triangles
        boxes = np.concatenate([tree.bounds[0], tree.bounds[0]])[None]
        children = np.array([[code[0], -1]])
    return RayTree(
        np.ascontiguousarray(boxes, dtype=np.float32),
        np.ascontiguousarray(children, dtype=np.int32),
        np.ascontiguousarray(triangles[tree.order].reshape(-1, 9)),
        tree.order.astype(np.int32),
    )


@inline
def _reciprocal(d: np.float32) -> np.float32:
    return _ONE / d if abs(d) > _TINY else np.float32(math.copysign(_ONE / _TINY, d))


@inline
def _entry(
    boxes: F32,
    node: int,
    first: int,
    ox: np.float32,
    oy: np.float32,
    oz: np.float32,
    ix: np.float32,
    iy: np.float32,
    iz: np.float32,
) -> np.float32:
    """Distance at which a ray enters the box of a child (0 if it starts in it), or `FAR`."""
    a, b = (boxes[node, first] - ox) * ix, (boxes[node, first + 3] - ox) * ix
    near, far = min(a, b), max(a, b)
    a, b = (boxes[node, first + 1] - oy) * iy, (boxes[node, first + 4] - oy) * iy
    near, far = max(near, min(a, b)), min(far, max(a, b))
    a, b = (boxes[node, first + 2] - oz) * iz, (boxes[node, first + 5] - oz) * iz
    near, far = max(near, min(a, b)), min(far, max(a, b))
    near = max(near, _ZERO)
    return near if near <= far * _ROUNDING else FAR


@inline
def _meets(
    corners: F32, i: int, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float
) -> tuple[float, float, float]:
    """Distance at which a ray meets triangle i from either side, and the weights of its corners 1 and 2; −1 if not.

    Möller and Trumbore, "Fast, minimum storage ray-triangle intersection", J. Graphics Tools 2 (1997) 21–28.
    """
    ax, ay, az = np.float64(corners[i, 0]), np.float64(corners[i, 1]), np.float64(corners[i, 2])
    e1x, e1y, e1z = corners[i, 3] - ax, corners[i, 4] - ay, corners[i, 5] - az
    e2x, e2y, e2z = corners[i, 6] - ax, corners[i, 7] - ay, corners[i, 8] - az
    px, py, pz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
    determinant = e1x * px + e1y * py + e1z * pz
    if abs(determinant) < 1e-20:
        return -1.0, 0.0, 0.0
    inverse = 1.0 / determinant
    sx, sy, sz = ox - ax, oy - ay, oz - az
    u = (sx * px + sy * py + sz * pz) * inverse
    if u < -_EDGE or u > 1.0 + _EDGE:
        return -1.0, 0.0, 0.0
    qx, qy, qz = sy * e1z - sz * e1y, sz * e1x - sx * e1z, sx * e1y - sy * e1x
    v = (dx * qx + dy * qy + dz * qz) * inverse
    if v < -_EDGE or u + v > 1.0 + _EDGE:
        return -1.0, 0.0, 0.0
    return (e2x * qx + e2y * qy + e2z * qz) * inverse, u, v


@inline
def first_hit(
    boxes: F32,
    children: I32,
    corners: F32,
    ox: np.float32,
    oy: np.float32,
    oz: np.float32,
    dx: np.float32,
    dy: np.float32,
    dz: np.float32,
    limit: np.float32,
    any_hit: bool,
    stack: I32,
    entries: F32,
) -> tuple[int, float, float, float]:
    """Find the first triangle nearer than ``limit`` along a ray; with ``any_hit``, any one.

    Args:
        boxes: see `RayTree`.
        children: see `RayTree`.
        corners: see `RayTree`.
        ox: origin, float32.
        oy: see ox.
        oz: see ox.
        dx: direction of any length, float32.
        dy: see dx.
        dz: see dx.
        limit: direction lengths.
        any_hit: whether any triangle will do.
        stack: (STACK,) int32 scratch.
        entries: (STACK,) float32 scratch.

    Returns:
        place of the triangle in `RayTree.corners` (−1 without a hit), its distance, and weights of its corners 1 and 2.
    """
    found = -1
    best: float = np.float64(limit)
    best_u, best_v = 0.0, 0.0
    ix, iy, iz = _reciprocal(dx), _reciprocal(dy), _reciprocal(dz)
    px, py, pz, rx, ry, rz = (
        np.float64(ox),
        np.float64(oy),
        np.float64(oz),
        np.float64(dx),
        np.float64(dy),
        np.float64(dz),
    )
    stack[0], entries[0] = 0, _ZERO
    top = 1
    while top > 0:
        top -= 1
        if entries[top] >= best:
            continue
        code = stack[top]
        if code < 0:
            code = -1 - code
            first = code >> _COUNT_BITS
            for i in range(first, first + (code & ((1 << _COUNT_BITS) - 1))):
                t, u, v = _meets(corners, i, px, py, pz, rx, ry, rz)
                if 0.0 <= t < best:
                    found, best, best_u, best_v = i, t, u, v
            if any_hit and found >= 0:
                return found, best, best_u, best_v
        else:
            left = _entry(boxes, code, 0, ox, oy, oz, ix, iy, iz)
            right = _entry(boxes, code, 6, ox, oy, oz, ix, iy, iz)
            near, far, near_at, far_at = children[code, 0], children[code, 1], left, right
            if right < left:
                near, far, near_at, far_at = far, near, right, left
            if far_at < best:
                stack[top], entries[top] = far, far_at
                top += 1
            if near_at < best:
                stack[top], entries[top] = near, near_at
                top += 1
    return found, best, best_u, best_v


@kernel
def _intersect(tree: RayTree, rays: F32, count: int, face: I32, hit: F32) -> None:
    """First hits of ``count`` rays: ``face`` (N,), −1 without one, and ``hit`` (N, 3) distance and weights."""
    i = cuda.grid(1)
    if i >= count:
        return
    stack, entries = cuda.local.array(STACK, np.int32), cuda.local.array(STACK, np.float32)
    ox, oy, oz, dx, dy, dz = rays[i, 0], rays[i, 1], rays[i, 2], rays[i, 3], rays[i, 4], rays[i, 5]
    found, t, u, v = first_hit(
        tree.boxes, tree.children, tree.corners, ox, oy, oz, dx, dy, dz, rays[i, 6], False, stack, entries
    )
    face[i] = tree.face[found] if found >= 0 else -1
    hit[i, 0], hit[i, 1], hit[i, 2] = t, u, v


@kernel
def _occluded(tree: RayTree, rays: F32, count: int, hidden: NDArray[np.uint8]) -> None:
    """Whether ``count`` rays meet anything: ``hidden`` (N,)."""
    i = cuda.grid(1)
    if i >= count:
        return
    stack, entries = cuda.local.array(STACK, np.int32), cuda.local.array(STACK, np.float32)
    ox, oy, oz, dx, dy, dz = rays[i, 0], rays[i, 1], rays[i, 2], rays[i, 3], rays[i, 4], rays[i, 5]
    found, _, _, _ = first_hit(
        tree.boxes, tree.children, tree.corners, ox, oy, oz, dx, dy, dz, rays[i, 6], True, stack, entries
    )
    hidden[i] = found >= 0


class _Buffers:
    """Memory for the rays of one call, used again and again: allocating stops the device.

    Attributes:
        rays: how many there is room for.
        stream: CUDA stream of the call.
        here: (N, 7) float32 origins, directions and limits on the host.
        there: the same on the device.
        face: (N,) int32, hit: (N, 3) float32, hidden: (N,) uint8: the results, each on the device and the host.
    """

    def __init__(self, rays: int) -> None:
        what = f"{rays:,} rays"
        self.rays = rays
        self.stream = cuda.stream()
        self.here = pinned((rays, 7), np.float32)
        self.there = allocate((rays, 7), np.float32, what)
        self.face = allocate(rays, np.int32, what), pinned(rays, np.int32)
        self.hit = allocate((rays, 3), np.float32, what), pinned((rays, 3), np.float32)
        self.hidden = allocate(rays, np.uint8, what), pinned(rays, np.uint8)

    def send(self, origins: F32, directions: F32, far: F32 | None) -> None:
        """Copy rays to the device."""
        count = len(directions)
        rows = self.here[:count]
        rows[:, :3], rows[:, 3:6], rows[:, 6] = origins, directions, FAR if far is None else far
        self.there[:count].copy_to_device(rows, stream=self.stream)

    def fetch(self, *results: tuple[Any, NDArray[Any]], count: int) -> list[NDArray[Any]]:
        """The first ``count`` rows of results, in memory of their own, once the device is done."""
        for there, here in results:
            there[:count].copy_to_host(here[:count], stream=self.stream)
        self.stream.synchronize()
        return [here[:count].copy() for _, here in results]


#: Buffers that no thread uses at the moment.
_IDLE: list[_Buffers] = []
#: Buffers have room for a power of two of rays, at least this many.
_SMALLEST = 1 << 14


@contextmanager
def _buffers(rays: int) -> Iterator[_Buffers]:
    """Buffers for ``rays`` rays; those that were used before are taken if they are large enough."""
    own = None
    with suppress(IndexError):
        own = _IDLE.pop()
    if own is None or own.rays < rays:
        own = _Buffers(max(_SMALLEST, 1 << (rays - 1).bit_length()))
    try:
        yield own
    finally:
        _IDLE.append(own)


class DeviceTracer:
    """Rays on the CUDA device, with the methods of `generators.core.rays.Tracer`; safe to call from several threads.

    Args:
        triangles: (F, 3, 3) metres; a hit's ``primID`` is the row number.

    Raises:
        Avs3dError: if CUDA cannot be used, there is no triangle, or a coordinate is not finite.
        OutOfDeviceMemoryError: if the triangles do not fit.
    """

    #: See `Tracer.calls_together`: a call costs about 0.5 ms, whatever the number of its rays; but a job in few large
    #: pieces leaves threads idle that wait for the last ones.
    calls_together = 8

    def __init__(self, triangles: F32) -> None:
        require_device()
        self.tree = upload(build_tree(triangles), f"a scene of {len(triangles):,} triangles")
        self._batch = BATCH

    def intersect(self, origins: F32, directions: F32, far: F32 | None = None) -> dict[str, Any]:
        """See `generators.core.rays.Tracer.intersect`.

        Raises:
            OutOfDeviceMemoryError: if not even a small batch of rays fits.
        """
        found: list[tuple[NDArray[Any], NDArray[Any]]] = []

        def work(first: int, last: int) -> None:
            part, count = slice(first, last), last - first
            with _buffers(count) as own:
                own.send(origins[part], directions[part], None if far is None else far[part])
                launch(_intersect, count, self.tree, own.there, count, own.face[0], own.hit[0], stream=own.stream)
                face, hit = own.fetch(own.face, own.hit, count=count)
                found.append((face, hit))

        self._batch = in_batches(work, len(directions), self._batch, _LEAST)
        face = np.concatenate([part for part, _ in found]) if found else np.empty(0, dtype=np.int32)
        hit = np.concatenate([part for _, part in found]) if found else np.empty((0, 3), dtype=np.float32)
        distance, u, v = np.ascontiguousarray(hit.T)
        return {"primID": face, "tfar": distance, "u": u, "v": v}

    def occluded(self, origins: F32, directions: F32, far: F32) -> NDArray[np.bool_]:
        """See `generators.core.rays.Tracer.occluded`.

        Raises:
            OutOfDeviceMemoryError: if not even a small batch of rays fits.
        """
        hidden = np.empty(len(directions), dtype=np.uint8)

        def work(first: int, last: int) -> None:
            part, count = slice(first, last), last - first
            with _buffers(count) as own:
                own.send(origins[part], directions[part], far[part])
                launch(_occluded, count, self.tree, own.there, count, own.hidden[0], stream=own.stream)
                (hidden[part],) = own.fetch(own.hidden, count=count)

        self._batch = in_batches(work, len(directions), self._batch, _LEAST)
        return hidden.view(np.bool_)
