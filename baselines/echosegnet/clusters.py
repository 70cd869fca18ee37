"""From labelled points to candidate objects: clusters, their fragments merged, a few points to stand for each.

Nothing here depends on the order of the points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError

Points = NDArray[np.float64]
Labels = NDArray[np.int64]

#: Label of a point that belongs to no cluster, as in scikit-learn.
NOISE = -1
#: Fragments of one object lie nearer to each other than this (m): the gaps that thin legs and hoses leave.
GAP = 0.12
#: No sounding object is larger than this (diagonal of its box, m): what would be stays apart.
LARGEST = 1.6
#: The same two for what the listener marks. Its marks are uneven, which leaves wider gaps between the fragments of an
#: object; and an oven beside a microwave, marked as well, must not be joined with it. So clusters are joined only up to
#: the size of an object of the category: the diagonal of the largest of many models that the listener learns from,
#: times √2, since boxes lie along the axes and the object may be turned by 45°.
MARKED_GAP = 0.3
LARGEST_OF = {
    "washing_machine": 1.96,
    "toilet": 2.09,
    "vacuum_cleaner": 1.98,
    "microwave": 1.10,
    "coffee_machine": 0.92,
    "clock": 1.12,
    "telephone": 0.64,
}
#: Clusters whose points are fewer than this share of the largest cluster's are no candidates.
_CRUMB = 0.01


def candidates(
    points: ArrayLike, *, eps: float = 0.04, min_points: int = 6, gap: float = GAP, largest: float = LARGEST
) -> Labels:
    """(N,) candidate objects among labelled points (N, 3): DBSCAN, fragments merged, crumbs left out (−1).

    Raises:
        Avs3dError: if the shape is wrong or a coordinate is not finite.
    """
    place, _ = checked(points)
    labels = merge_fragments(place, dbscan(place, eps=eps, min_points=min_points), gap=gap, largest=largest)
    return without_crumbs(labels)


def without_crumbs(labels: Labels) -> Labels:
    """The labels (N,) with those clusters as noise that are much smaller than the largest."""
    count = np.bincount(labels[labels >= 0])
    crumbs = np.flatnonzero(count < _CRUMB * count.max(initial=0))
    return np.where(np.isin(labels, crumbs), NOISE, labels)


def marked_candidates(points: ArrayLike, classes: ArrayLike, *, eps: float = 0.04) -> Labels:
    """(N,) the same for points that the listener marked: of each category by itself, but for the crumbs.

    Args:
        points: (N, 3) metres.
        classes: (N,) class ids; a point of class 0 is no candidate.
        eps: radius of DBSCAN, metres.

    Raises:
        Avs3dError: if a shape is wrong or a coordinate is not finite.
    """
    place, number = checked(points, np.asarray(classes))
    out = np.full(len(place), NOISE, np.int64)
    for value in np.unique(number[number > 0]):
        mine = np.flatnonzero(number == value)
        fragments = dbscan(place[mine], eps=eps)
        found = merge_fragments(place[mine], fragments, gap=MARKED_GAP, largest=largest_of(int(value)))
        out[mine] = np.where(found >= 0, found + out.max(initial=NOISE) + 1, NOISE)
    return ranked(place, without_crumbs(out))


def largest_of(class_id: int) -> float:
    """Up to which diagonal clusters of a class are joined, metres; `LARGEST` for a category of a manifest's own."""
    return LARGEST_OF.get(CATEGORIES[class_id - 1], LARGEST) if 0 < class_id <= len(CATEGORIES) else LARGEST


def dbscan(points: Points, *, eps: float = 0.04, min_points: int = 6) -> Labels:
    """(N,) cluster of each of the points (N, 3), from 0 on, largest first; `NOISE` for none (Ester et al. 1996).

    A border point within reach of two clusters goes to the one of its nearest core point, not to the one met first: so
    the order of the points does not matter.
    """
    points, _ = checked(points)
    if not len(points):
        return np.zeros(0, np.int64)
    tree = cKDTree(points)
    core = np.asarray(tree.query_ball_point(points, eps, return_length=True)) >= min_points
    if not core.any():
        return np.full(len(points), NOISE, np.int64)
    # Imported late: scikit-learn takes a second.
    from sklearn.cluster import DBSCAN

    out = np.full(len(points), NOISE, np.int64)
    out[core] = DBSCAN(eps=eps, min_samples=1).fit(points[core]).labels_
    distance, nearest = _nearest(cKDTree(points[core]), points)
    reached = ~core & (distance <= eps)
    out[reached] = out[core][nearest[reached]]
    return ranked(points, out)


def merge_fragments(points: Points, labels: Labels, *, gap: float = GAP, largest: float = LARGEST) -> Labels:
    """Join clusters that are pieces of one object.

    Two clusters are joined if their nearest points are at most ``gap`` apart and the box round both has a diagonal of
    at most ``largest``; the narrowest gaps first, until none is left. Noise goes to the cluster within ``gap`` of it,
    if there is just one.

    Args:
        points: (N, 3) metres.
        labels: (N,) integers; negative ones mean no cluster.
        gap: metres; 0 joins nothing.
        largest: metres.

    Returns:
        (N,) labels from 0 on, the cluster with the most points first; -1 for noise.

    Raises:
        Avs3dError: if shapes do not fit, a coordinate is not finite, or a length is not.
    """
    points, labels = checked(points, labels)
    if not (np.isfinite(gap) and gap >= 0 and largest > 0):
        raise Avs3dError(f"merging fragments: gap {gap} and largest {largest}, expected metres, gap from 0 on")
    found = np.unique(labels[labels >= 0])
    if not len(found) or gap == 0:
        return ranked(points, labels)
    members = [points[labels == k] for k in found]
    trees = [cKDTree(m) for m in members]
    low, high = (np.stack([f(m, axis=0) for m in members]) for f in (np.min, np.max))
    gaps = []
    for i in range(len(found)):
        # Boxes further apart than the gap need no closer look.
        apart = np.maximum(0.0, np.maximum(low[i] - high[i + 1 :], low[i + 1 :] - high[i]))
        for j in i + 1 + np.flatnonzero(np.linalg.norm(apart, axis=1) <= gap):
            few, many = sorted((i, int(j)), key=lambda k: len(members[k]))
            distance = float(_nearest(trees[many], members[few], 2 * gap)[0].min())
            if distance <= gap:
                gaps.append((distance, tuple(low[i]), tuple(low[j]), i, int(j)))
    owner = np.arange(len(found))
    for *_, one, other in sorted(gaps):
        a, b = owner[one], owner[other]
        if a == b:
            continue
        bottom, top = np.minimum(low[a], low[b]), np.maximum(high[a], high[b])
        if np.linalg.norm(top - bottom) <= largest:
            owner[owner == b] = a
            low[a], high[a] = bottom, top
    out = np.full(len(points), NOISE, np.int64)
    out[labels >= 0] = owner[np.searchsorted(found, labels[labels >= 0])]
    return ranked(points, _absorb(points, out, gap))


def _nearest(tree: cKDTree, points: Points, within: float = np.inf) -> tuple[Points, Labels]:
    """(N,) distance and index of the nearest point of the tree; infinite where none is ``within`` reach."""
    distance, index = tree.query(points, distance_upper_bound=within)
    return np.asarray(distance, dtype=np.float64), np.asarray(index, dtype=np.int64)


def _absorb(points: Points, labels: Labels, gap: float) -> Labels:
    """Noise within ``gap`` of one cluster alone becomes its own."""
    noise = np.flatnonzero(labels < 0)
    if not len(noise):
        return labels
    near = np.zeros(len(noise), np.int64)
    which = np.full(len(noise), NOISE, np.int64)
    for k in np.unique(labels[labels >= 0]):
        reached = _nearest(cKDTree(points[labels == k]), points[noise], 2 * gap)[0] <= gap
        near += reached
        which[reached] = k
    out = labels.copy()
    out[noise] = np.where(near == 1, which, NOISE)
    return out


def ranked(points: Points, labels: Labels) -> Labels:
    """The same clusters numbered from 0, the one with the most points first, equals by their lowest corner."""
    found, inverse, count = np.unique(labels, return_inverse=True, return_counts=True)
    order = [k for k in range(len(found)) if found[k] >= 0]
    corner = {k: tuple(points[labels == found[k]].min(axis=0)) for k in order}
    order.sort(key=lambda k: (-int(count[k]), corner[k]))
    number = np.full(len(found), NOISE, np.int64)
    number[order] = np.arange(len(order))
    return number[inverse.reshape(-1)]


def representatives(points: Points, count: int = 12) -> Points:
    """(≤ count, 3) points spread over a cluster (N, 3): the most central, then each time the farthest from those taken.

    The twentieth of the points that lies farthest from the median is left out, because splats stray.
    """
    points = points[np.lexsort(points.T)]  # ties are broken by place, not by order
    off = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    points = points[off <= np.quantile(off, 0.95)]
    taken = [int(np.argmin(np.linalg.norm(points - np.median(points, axis=0), axis=1)))]
    nearest = np.linalg.norm(points - points[taken[0]], axis=1)
    while len(taken) < count and nearest.max() > 0:
        taken.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[taken[-1]], axis=1))
    return points[taken]


def checked(points: ArrayLike, labels: ArrayLike | None = None) -> tuple[Points, Labels]:
    """(N, 3) float64 and (N,) int64, or a clear line (labels None: all 0).

    Raises:
        Avs3dError: if shapes do not fit or a coordinate is NaN or infinite.
    """
    place = np.asarray(points, dtype=np.float64)
    if place.ndim != 2 or place.shape[1] != 3:
        raise Avs3dError(f"candidate points: shape {place.shape}, expected (N, 3)")
    bad = int((~np.isfinite(place)).any(axis=1).sum())
    if bad:
        raise Avs3dError(f"candidate points: {bad} of {len(place)} are NaN or infinite; train the Gaussians again")
    number = np.zeros(len(place), np.int64) if labels is None else np.asarray(labels)
    if number.shape != (len(place),) or not np.issubdtype(number.dtype, np.integer):
        raise Avs3dError(f"labels: {number.dtype} {number.shape}, expected one whole number for each of {len(place)}")
    return place, number.astype(np.int64)
