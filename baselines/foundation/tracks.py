"""Instances in pictures from several places become tracks: one object, with the point where its rays meet.

Every mask has a ray, from the camera through the mask's middle. Two rays of different frames that nearly meet propose
a point; all masks that the point's projection falls into (or near) support it. The point with most support is refined
(least squares: the point nearest to all its rays), its masks leave, and the next one is looked for. A frame has at most
one mask of a track. A mask that nothing supports is a track by itself, `ALONE` metres away: what is heard depends on
its direction, hardly on its distance.

This needs poses and a walk, no depth and no appearance: equal objects (twins) stay apart by place. It is the method of
midpoints (R. Hartley, P. Sturm, "Triangulation", CVIU 68, 1997, §5) with consensus in place of given matches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.geometry import Intrinsics, Pose

Array = NDArray[np.float64]

#: Distance (m) at which a mask without support is taken to be.
ALONE = 2.0
#: Two places nearer to each other (m) show too little parallax.
_BASELINE = 0.1
#: Rays that pass each other at more than this (m) are not of one object: the middles of masks differ by the view.
_GAP = 0.25
#: Depths (m) of a point that is believed.
_NEAREST, _FARTHEST = 0.3, 12.0
#: A point supports a mask if it falls into the mask's box, grown by this share of its sides.
_GROWN = 0.25


@dataclass(frozen=True, eq=False)
class Sighting:
    """An instance in a picture.

    Attributes:
        frame: index of the frame.
        index: of the mask among those of the frame.
        centre: (2,) middle of the mask, column and row.
        box: (4,) x0 y0 x1 y1, the mask's bounds in pixels.
    """

    frame: int
    index: int
    centre: Array
    box: Array


@dataclass(frozen=True, eq=False)
class ObjectTrack:
    """An object.

    Attributes:
        point: (3,) where its rays meet, metres, world coordinates.
        sightings: its masks, by frame.
    """

    point: Array
    sightings: tuple[Sighting, ...]


def sighting(frame: int, index: int, mask: NDArray[np.bool_]) -> Sighting:
    """A mask (H, W), which is not empty, as a sighting."""
    rows, columns = np.nonzero(mask)
    box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], np.float64)
    return Sighting(frame, index, np.array([columns.mean() + 0.5, rows.mean() + 0.5]), box)


def join(sightings: Sequence[Sighting], poses: Sequence[Pose], camera: Intrinsics) -> list[ObjectTrack]:
    """The tracks of an observation, those with most sightings first.

    Args:
        sightings: all instances of one text in all frames.
        poses: of the frames.
        camera: of all frames.

    Returns:
        Tracks; every sighting is in exactly one of them.
    """
    left = list(sightings)
    found: list[ObjectTrack] = []
    proposals = _proposals(left, poses, camera)
    while len(left) > 1 and len(proposals):
        support = _support(proposals, left, poses, camera)
        counts = (support >= 0).sum(axis=1)
        best = int(counts.argmax())
        if counts[best] < 2:
            break
        members = [left[k] for k in support[best] if k >= 0]
        point = _nearest(members, poses, camera)
        # The refined point may be seen by masks that the proposal missed, and by none that it had: it decides if it is
        # no worse.
        again = _support(point[None], left, poses, camera)[0]
        if (again >= 0).sum() >= counts[best]:
            members = [left[k] for k in again if k >= 0]
        else:
            point = proposals[best]
        found.append(ObjectTrack(point, tuple(members)))
        taken = {id(one) for one in members}
        left = [one for one in left if id(one) not in taken]
    for one in left:
        ray = camera.unproject(poses[one.frame], one.centre[None], np.ones(1))[0] - poses[one.frame].position
        point = np.asarray(poses[one.frame].position) + ALONE * ray / np.linalg.norm(ray)
        found.append(ObjectTrack(point, (one,)))
    return found


def _proposals(sightings: Sequence[Sighting], poses: Sequence[Pose], camera: Intrinsics) -> Array:
    """(P, 3) points where rays of two frames nearly meet, in front of both cameras."""
    origin, ray = _rays(sightings, poses, camera)
    frames = np.array([one.frame for one in sightings])
    pairs = np.array(list(combinations(range(len(sightings)), 2)), np.intp).reshape(-1, 2)
    a, b = pairs.T
    apart = (frames[a] != frames[b]) & (np.linalg.norm(origin[a] - origin[b], axis=1) > _BASELINE)
    a, b = a[apart], b[apart]
    # The nearest points o + t·d of two lines solve a system of two equations.
    cosine, offset = (ray[a] * ray[b]).sum(1), origin[b] - origin[a]
    sine2 = np.maximum(1 - cosine**2, 1e-9)
    along_a, along_b = (offset * ray[a]).sum(1), (offset * ray[b]).sum(1)
    t = (along_a - cosine * along_b) / sine2
    s = (cosine * along_a - along_b) / sine2
    first, second = origin[a] + t[:, None] * ray[a], origin[b] + s[:, None] * ray[b]
    near = np.minimum(t, s) > _NEAREST
    kept = near & (np.maximum(t, s) < _FARTHEST) & (np.linalg.norm(first - second, axis=1) < _GAP)
    return np.asarray((first + second)[kept] / 2)


def _rays(sightings: Sequence[Sighting], poses: Sequence[Pose], camera: Intrinsics) -> tuple[Array, Array]:
    """(N, 3) origins and (N, 3) unit directions."""
    origin = np.array([poses[one.frame].position for one in sightings]).reshape(-1, 3)
    ends = np.array([camera.unproject(poses[s.frame], s.centre[None], np.ones(1))[0] for s in sightings])
    ray = ends.reshape(-1, 3) - origin
    return origin, ray / np.linalg.norm(ray, axis=1, keepdims=True)


def _support(
    points: Array, sightings: Sequence[Sighting], poses: Sequence[Pose], camera: Intrinsics
) -> NDArray[np.intp]:
    """(P, frames) for each point the sighting of each frame that it falls into, −1 where there is none.

    Of several in a frame the one whose middle is nearest counts.
    """
    frames = sorted({one.frame for one in sightings})
    found = np.full((len(points), len(frames)), -1, np.intp)
    for column, frame in enumerate(frames):
        pixels, depth = camera.project(poses[frame], points)
        best = np.full(len(points), np.inf)
        for k, one in enumerate(sightings):
            if one.frame != frame:
                continue
            margin = _GROWN * (one.box[2:] - one.box[:2])
            inside = ((pixels >= one.box[:2] - margin) & (pixels <= one.box[2:] + margin)).all(axis=1)
            inside &= (depth > _NEAREST) & (depth < _FARTHEST)
            distance = np.where(inside, np.linalg.norm(pixels - one.centre, axis=1), np.inf)
            nearer = distance < best
            found[nearer, column] = k
            best = np.minimum(best, distance)
    return found


def _nearest(members: Sequence[Sighting], poses: Sequence[Pose], camera: Intrinsics) -> Array:
    """(3,) the point with the least sum of squared distances to the members' rays."""
    origin, ray = _rays(members, poses, camera)
    across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
    return np.asarray(np.linalg.lstsq(across.sum(0), (across @ origin[:, :, None]).sum(0)[:, 0], rcond=None)[0])
