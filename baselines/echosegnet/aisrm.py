"""AISRM, the released audio-informed refinement: an intensity map from loudness, and the cluster nearest to its peak.

Left and right are told apart in the xz plane of the Y-down world. With two unequal clusters only the larger is ever
kept, so sound decides only from three clusters on (`spatial` does better).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError
from baselines.echosegnet.lift import LiftCamera

Array = NDArray[np.float64]

#: Clips in the trailing moving average of loudness.
WINDOW = 6
#: Points above this intensity make the audio centre (τ_ref).
REFERENCE_INTENSITY = 0.85
#: DBSCAN's radius (metres) and least number of points.
EPS = 0.04
MIN_POINTS = 6
_TINY = 1e-6


def loudness(clips: Sequence[NDArray[np.floating]] | NDArray[np.floating]) -> Array:
    """(T, 2) smoothed RMS of both ears: a trailing mean over six clips; the first five are not averaged.

    Args:
        clips: (T, 2, n), channel 0 left, in the order of time.

    Raises:
        Avs3dError: if they have another shape or hold NaN.
    """
    array = np.asarray(clips, dtype=np.float64)
    if array.ndim != 3 or array.shape[1] != 2:
        raise Avs3dError(f"clips have shape {array.shape}, expected (T, 2, n)")
    rms = np.sqrt(np.mean(array**2, axis=2))
    if not np.isfinite(rms).all():
        raise Avs3dError("clips hold NaN or infinite numbers; regenerate the dataset")
    out: Array = rms.copy()
    if len(rms) >= WINDOW:
        out[WINDOW - 1 :] = np.lib.stride_tricks.sliding_window_view(rms, WINDOW, axis=0).mean(axis=-1)
    return out


def audio_intensity_map(
    views: Sequence[LiftCamera], clips: Sequence[NDArray[np.floating]] | NDArray[np.floating], points: ArrayLike
) -> Array:
    """(N,) float64 in [0, 1]: how much the louder ears pointed towards each point.

    A frame gives |L − R| / (max(L, R) + 1e-6) to every point on the louder side of the camera's heading in the xz
    plane; the sum over frames is divided by its maximum. Where nothing was ever heard it is 0 everywhere.

    The heading is the released one: at the angle atan2(R[0, 2], R[0, 0]) of the camera-to-world rotation R, that is
    (x, z) = (R[0, 2], R[0, 0]). It is the forward axis (R[0, 2], R[2, 2]) only where the camera neither pitches nor
    rolls.

    Args:
        views: train views in the order of time.
        clips: (T, 2, n) their binaural clips.
        points: (N, 3) Y-down world.

    Raises:
        Avs3dError: if numbers of views and clips differ, or clips are malformed.
    """
    levels = loudness(clips)
    if len(levels) != len(views) or not len(views):
        raise Avs3dError(f"{len(levels)} clips for {len(views)} train views, expected one each and at least one")
    flat = np.asarray(points, dtype=np.float64)[:, [0, 2]]
    total = np.zeros(len(flat))
    for view, (left, right) in zip(views, levels, strict=True):
        heading = view.rotation[0, [2, 0]]
        offset = flat - view.position[[0, 2]]
        side = heading[0] * offset[:, 1] - heading[1] * offset[:, 0]
        weight = abs(left - right) / (max(left, right) + _TINY)
        total += weight * (side > 0 if left > right else side < 0)
    highest = total.max(initial=0.0)
    return total / highest if highest > 0 else total


def audio_centre(points: ArrayLike, intensity: Array, threshold: float = REFERENCE_INTENSITY) -> Array | None:
    """(3,) mean of the points above the threshold, weighted by their intensity; None if there is none."""
    loud = intensity > threshold
    if not loud.any():
        return None
    return np.asarray(np.average(np.asarray(points, dtype=np.float64)[loud], axis=0, weights=intensity[loud]))


@dataclass(frozen=True, eq=False)
class Refinement:
    """The remaining labelled points.

    Attributes:
        chosen: (N,) bool: the points of the chosen cluster; all False if none was kept.
        kept: number of clusters larger than mean + ½ standard deviation.
        is_none: no cluster was kept: then all labelled points stay.
        labels: (N,) DBSCAN's clusters, −1 for none.
    """

    chosen: NDArray[np.bool_]
    kept: int
    is_none: bool
    labels: NDArray[np.int64]

    @property
    def staying(self) -> NDArray[np.bool_]:
        """(N,) bool: the points that stay."""
        return np.ones_like(self.chosen) if self.is_none else self.chosen


def refine(points: ArrayLike, centre: ArrayLike, *, eps: float = EPS, min_points: int = MIN_POINTS) -> Refinement:
    """The cluster of labelled points that is nearest to the audio centre among the large ones.

    Clusters by DBSCAN (Ester et al. 1996); kept are those with more points than mean + 0.5·std over clusters
    (population, strict); nearest is measured between means in the xz plane.

    Args:
        points: (N, 3) centres of the labelled Gaussians.
        centre: (3,) from `audio_centre`.
        eps: metres.
        min_points: of a core point's neighbourhood, itself included.
    """
    from sklearn.cluster import DBSCAN

    array, target = np.asarray(points, dtype=np.float64), np.asarray(centre, dtype=np.float64)
    nothing = np.zeros(len(array), np.bool_)
    if not len(array):
        return Refinement(nothing, 0, True, np.zeros(0, np.int64))
    labels = DBSCAN(eps=eps, min_samples=min_points).fit(array).labels_.astype(np.int64)
    sizes = np.bincount(labels[labels >= 0])
    if not len(sizes):
        return Refinement(nothing, 0, True, labels)
    kept = np.flatnonzero(sizes > sizes.mean() + 0.5 * sizes.std())
    if not len(kept):
        return Refinement(nothing, 0, True, labels)
    means = np.stack([array[labels == cluster].mean(axis=0) for cluster in kept])
    distances = np.linalg.norm((means - target)[:, [0, 2]], axis=1)
    return Refinement(labels == kept[int(distances.argmin())], len(kept), False, labels)
