"""A bounding volume hierarchy over triangles: flat arrays, built by binned surface area heuristic.

I. Wald, "On fast construction of SAH-based bounding volume hierarchies", IEEE Symp. on Interactive Ray Tracing 2007.

Who traverses it: `generators.acoustics.tracer.kernels`, and on CUDA `generators.core.device_rays`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.core.jit import inline, njit

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]

#: Bins per axis; the split planes lie between them.
_BINS = 16
#: Triangles per leaf up to which a leaf is never split, and beyond which it always is.
_LEAF, _MOST = 2, 8
#: Cost of a step down the tree, in tests of a triangle.
_STEP = 1.0
#: Depth of the tree from which on ranges are halved, so that the traversal's stack of `STACK` entries always suffices.
_DEEP = 36
#: Entries of the traversal's stack: one per level, 36 + log2 of the most triangles (2^26).
STACK = 64


@dataclass(frozen=True, eq=False)
class Bvh:
    """The tree.

    Attributes:
        bounds: (N, 6) float64, lowest and highest corner of each node, metres; node 0 is the root.
        links: (N, 2) int32: first triangle and number of triangles of a leaf; the left child (the right one follows it)
            and 0 of an inner node.
        order: (T,) int64, the input's triangle in each place of the leaves.
    """

    bounds: F64
    links: I32
    order: I64


def build(triangles: F64, what: str = "mesh") -> Bvh:
    """The tree over triangles (T, 3, 3) of ``what``.

    Raises:
        Avs3dError: if a coordinate is not finite.
    """
    corners = np.ascontiguousarray(triangles, dtype=np.float64)
    bad = int((~np.isfinite(corners)).any(axis=(1, 2)).sum())
    if bad:
        raise Avs3dError(f"{what}: {bad} of {len(corners)} triangles are NaN or infinite; repair the mesh")
    if not len(corners):
        return Bvh(np.zeros((1, 6)), np.zeros((1, 2), dtype=np.int32), np.zeros(0, dtype=np.int64))
    low, high = corners.min(axis=1), corners.max(axis=1)
    bounds = np.empty((2 * len(corners), 6))
    links = np.zeros((2 * len(corners), 2), dtype=np.int32)
    order = np.arange(len(corners), dtype=np.int64)
    waiting = np.empty((2 * len(corners), 4), dtype=np.int64)
    count = _build(low, high, 0.5 * (low + high), order, bounds, links, waiting)
    return Bvh(bounds[:count].copy(), links[:count].copy(), order)


@inline
def _half_area(box: F64) -> float:
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return x * y + y * z + z * x if x >= 0.0 and y >= 0.0 and z >= 0.0 else 0.0


@njit
def _build(low: F64, high: F64, centre: F64, order: I64, bounds: F64, links: I32, work: I64) -> int:
    """Fill ``order``, ``bounds`` and ``links``; ``work`` (N, 4) holds node, begin, end, depth. Returns the nodes."""
    counts = np.zeros(_BINS, dtype=np.int64)
    boxes = np.empty((_BINS, 6))
    right_area = np.empty(_BINS)
    box = np.empty(6)
    nodes, waiting = 1, 1
    work[0, 0], work[0, 1], work[0, 2], work[0, 3] = 0, 0, len(order), 0
    while waiting:
        waiting -= 1
        node, begin, end, depth = work[waiting, 0], work[waiting, 1], work[waiting, 2], work[waiting, 3]
        c_low, c_high = np.full(3, np.inf), np.full(3, -np.inf)
        for k in range(3):
            bounds[node, k], bounds[node, 3 + k] = np.inf, -np.inf
        for i in range(begin, end):
            for k in range(3):
                bounds[node, k] = min(bounds[node, k], low[order[i], k])
                bounds[node, 3 + k] = max(bounds[node, 3 + k], high[order[i], k])
                c_low[k] = min(c_low[k], centre[order[i], k])
                c_high[k] = max(c_high[k], centre[order[i], k])
        size = end - begin
        middle = begin
        if size > _LEAF:
            # Cost of a leaf against the cheapest split: areas times triangles, relative to this node's box.
            best, best_axis, best_bin = (size - _STEP) * _half_area(bounds[node]), -1, 0
            for axis in range(3):
                extent = c_high[axis] - c_low[axis]
                if extent <= 1e-9 or depth >= _DEEP:
                    continue
                counts[:] = 0
                boxes[:, :3], boxes[:, 3:] = np.inf, -np.inf
                for i in range(begin, end):
                    b = min(int((centre[order[i], axis] - c_low[axis]) / extent * _BINS), _BINS - 1)
                    counts[b] += 1
                    for k in range(3):
                        boxes[b, k] = min(boxes[b, k], low[order[i], k])
                        boxes[b, 3 + k] = max(boxes[b, 3 + k], high[order[i], k])
                box[:3], box[3:] = np.inf, -np.inf
                for b in range(_BINS - 1, 0, -1):
                    for k in range(3):
                        box[k], box[3 + k] = min(box[k], boxes[b, k]), max(box[3 + k], boxes[b, 3 + k])
                    right_area[b] = _half_area(box)
                box[:3], box[3:] = np.inf, -np.inf
                left = 0
                for b in range(1, _BINS):
                    left += counts[b - 1]
                    for k in range(3):
                        box[k], box[3 + k] = min(box[k], boxes[b - 1, k]), max(box[3 + k], boxes[b - 1, 3 + k])
                    if 0 < left < size:
                        cost = left * _half_area(box) + (size - left) * right_area[b]
                        if cost < best:
                            best, best_axis, best_bin = cost, axis, b
            if best_axis >= 0:
                extent = c_high[best_axis] - c_low[best_axis]
                middle = begin
                for i in range(begin, end):
                    b = min(int((centre[order[i], best_axis] - c_low[best_axis]) / extent * _BINS), _BINS - 1)
                    if b < best_bin:
                        order[i], order[middle] = order[middle], order[i]
                        middle += 1
            elif size > _MOST:
                middle = begin + size // 2  # nothing tells them apart, or the tree is deep: halve
        if middle == begin:
            links[node, 0], links[node, 1] = begin, size
            continue
        links[node, 0], links[node, 1] = nodes, 0
        work[waiting, 0], work[waiting, 1], work[waiting, 2], work[waiting, 3] = nodes, begin, middle, depth + 1
        waiting += 1
        work[waiting, 0], work[waiting, 1], work[waiting, 2], work[waiting, 3] = nodes + 1, middle, end, depth + 1
        waiting += 1
        nodes += 2
    return nodes
