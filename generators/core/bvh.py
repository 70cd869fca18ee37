"""A bounding volume hierarchy over triangles: flat arrays, built by binned surface area heuristic.

I. Wald, "On fast construction of SAH-based bounding volume hierarchies", IEEE Symp. on Interactive Ray Tracing 2007.

Who traverses it: `generators.acoustics.tracer.kernels`, and on CUDA `generators.core.device_rays`.
"""

from __future__ import annotations

import math
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
#: Rows of the scratch boxes behind those of the bins: the boxes on one side of a split, and that of all centres.
_SIDE, _CENTRES = _BINS, _BINS + 1


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
    counts, boxes, right = np.empty(_BINS, dtype=np.int64), np.empty((_CENTRES + 1, 6)), np.empty(_BINS)
    count = _build(low, high, 0.5 * (low + high), order, bounds, links, waiting, counts, boxes, right)
    return Bvh(bounds[:count].copy(), links[:count].copy(), order)


@inline
def _half_area(boxes: F64, i: int) -> float:
    x, y, z = boxes[i, 3] - boxes[i, 0], boxes[i, 4] - boxes[i, 1], boxes[i, 5] - boxes[i, 2]
    return x * y + y * z + z * x if x >= 0.0 and y >= 0.0 and z >= 0.0 else 0.0


@inline
def _clear(boxes: F64, i: int) -> None:
    for k in range(3):
        boxes[i, k], boxes[i, 3 + k] = math.inf, -math.inf


@inline
def _extend(boxes: F64, i: int, low: F64, high: F64, j: int) -> None:
    """Extend box i by the points or boxes from ``low`` (T, 3) to ``high`` in row j."""
    for k in range(3):
        boxes[i, k] = min(boxes[i, k], low[j, k])
        boxes[i, 3 + k] = max(boxes[i, 3 + k], high[j, k])


@inline
def _join(boxes: F64, i: int, j: int) -> None:
    """Extend box i by box j."""
    for k in range(3):
        boxes[i, k] = min(boxes[i, k], boxes[j, k])
        boxes[i, 3 + k] = max(boxes[i, 3 + k], boxes[j, 3 + k])


@inline
def _bin(centre: F64, j: int, axis: int, boxes: F64) -> int:
    low, high = boxes[_CENTRES, axis], boxes[_CENTRES, 3 + axis]
    return min(int((centre[j, axis] - low) / (high - low) * _BINS), _BINS - 1)


@njit
def _build(
    low: F64,
    high: F64,
    centre: F64,
    order: I64,
    bounds: F64,
    links: I32,
    work: I64,
    counts: I64,
    boxes: F64,
    right: F64,
) -> int:
    """Fill ``order``, ``bounds`` and ``links``; ``work`` (N, 4) holds node, begin, end, depth. Returns the nodes.

    ``counts``, ``boxes`` and ``right`` are scratch: triangles and box of each bin, half the area to the right of it.
    """
    nodes, waiting = 1, 1
    work[0, 0], work[0, 1], work[0, 2], work[0, 3] = 0, 0, len(order), 0
    while waiting:
        waiting -= 1
        node, begin, end, depth = work[waiting, 0], work[waiting, 1], work[waiting, 2], work[waiting, 3]
        _clear(bounds, node)
        _clear(boxes, _CENTRES)
        for i in range(begin, end):
            _extend(bounds, node, low, high, order[i])
            _extend(boxes, _CENTRES, centre, centre, order[i])
        size = end - begin
        middle = begin
        if size > _LEAF:
            # Cost of a leaf against the cheapest split: areas times triangles, relative to this node's box.
            best, best_axis, best_bin = (size - _STEP) * _half_area(bounds, node), -1, 0
            for axis in range(3):
                if boxes[_CENTRES, 3 + axis] - boxes[_CENTRES, axis] <= 1e-9 or depth >= _DEEP:
                    continue
                for b in range(_BINS):
                    counts[b] = 0
                    _clear(boxes, b)
                for i in range(begin, end):
                    b = _bin(centre, order[i], axis, boxes)
                    counts[b] += 1
                    _extend(boxes, b, low, high, order[i])
                _clear(boxes, _SIDE)
                for b in range(_BINS - 1, 0, -1):
                    _join(boxes, _SIDE, b)
                    right[b] = _half_area(boxes, _SIDE)
                _clear(boxes, _SIDE)
                left = 0
                for b in range(1, _BINS):
                    left += counts[b - 1]
                    _join(boxes, _SIDE, b - 1)
                    if 0 < left < size:
                        cost = left * _half_area(boxes, _SIDE) + (size - left) * right[b]
                        if cost < best:
                            best, best_axis, best_bin = cost, axis, b
            if best_axis >= 0:
                for i in range(begin, end):
                    if _bin(centre, order[i], best_axis, boxes) < best_bin:
                        order[i], order[middle] = order[middle], order[i]
                        middle += 1
            elif size > _MOST:
                middle = begin + size // 2  # nothing tells them apart, or the tree is deep: halve
        if middle == begin:
            links[node, 0], links[node, 1] = begin, size
            continue
        links[node, 0], links[node, 1] = nodes, 0
        for child in range(2):
            work[waiting, 0], work[waiting, 3] = nodes + child, depth + 1
            work[waiting, 1], work[waiting, 2] = middle if child else begin, end if child else middle
            waiting += 1
        nodes += 2
    return nodes
