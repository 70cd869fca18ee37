"""Points on the visible surfaces, with colour and tracks: what structure-from-motion would find without its errors.

Points are pixels of the frames lifted by their depth; a point's track lists the frames that see it, decided by a ray
from each camera.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.geometry import Intrinsics, Pose
from generators.vision.base import RenderedView

Floats = NDArray[np.float64]
#: Pixels of a frame that are lifted to points.
PER_FRAME = 200
Hidden = Callable[[int, Floats, Floats, Floats], NDArray[np.bool_]]


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Sampled surface points.

    Attributes:
        positions: (N, 3) float64 world coordinates.
        colours: (N, 3) uint8 sRGB, as the frame shows them in which the point was sampled.
        track_point: (T,) int64 index of the point of each observation, ascending.
        track_frame: (T,) int64 index of the frame that sees it.
        track_pixel: (T, 2) float64 (column, row) of the point's projection there.
    """

    positions: NDArray[np.float64]
    colours: NDArray[np.uint8]
    track_point: NDArray[np.int64]
    track_frame: NDArray[np.int64]
    track_pixel: NDArray[np.float64]


def draw_pixels(
    rng: np.random.Generator, height: int, width: int, count: int = PER_FRAME
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows and columns of the pixels of a frame that are lifted to points, (count,) each."""
    rows = rng.integers(0, height, count)
    return rows, rng.integers(0, width, count)


class SurfaceSampler:
    """Collects ``per_frame`` random pixels of every frame, then links them into tracks."""

    def __init__(self, intrinsics: Intrinsics, rng: np.random.Generator, per_frame: int = PER_FRAME) -> None:
        self._intrinsics = intrinsics
        self._rng = rng
        self._per_frame = per_frame
        self._positions: list[NDArray[np.float64]] = []
        self._colours: list[NDArray[np.uint8]] = []

    def add(self, frame: RenderedView, pose: Pose, *, instances: bool = True) -> None:
        """Sample one frame, but no pixel where nothing was hit; without ``instances``, none of any instance either.

        Points on an object that moves are in no one place: a model of a rigid scene cannot hold them. They are then
        left out on every object, since the one without points would be the one that sounds.
        """
        k = self._intrinsics
        rows, columns = draw_pixels(self._rng, k.height, k.width, self._per_frame)
        depth = frame.depth[rows, columns].astype(np.float64)
        hit = depth > 0
        if not instances:
            hit &= frame.instance_ids[rows, columns] == 0
        rows, columns, depth = rows[hit], columns[hit], depth[hit]
        camera = np.stack(
            [(columns + 0.5 - k.cx) / k.fx * depth, -(rows + 0.5 - k.cy) / k.fy * depth, -depth],
            axis=1,
        )
        self._positions.append(pose.to_world(camera))
        self._colours.append(frame.rgb[rows, columns])

    def link(self, poses: Sequence[Pose], hidden_at: Hidden, longest: int = 16) -> SurfacePoints:
        """Find which frames see each point; at most ``longest`` of them, evenly spread, are kept per point.

        Points seen by fewer than two frames are dropped: they carry no constraint, as in a real reconstruction.

        Args:
            poses: of the frames.
            hidden_at: says, of a frame, which rays (origins, directions (N, 3)) meet something within distances (N,).
            longest: frames kept per point.
        """
        positions = np.concatenate(self._positions) if self._positions else np.zeros((0, 3))
        colours = np.concatenate(self._colours) if self._colours else np.zeros((0, 3), dtype=np.uint8)
        seen_point, seen_frame, seen_pixel = [], [], []
        for index, pose in enumerate(poses):
            pixels, depth = self._intrinsics.project(pose, positions)
            with np.errstate(invalid="ignore"):
                inside = (depth > 0.05) & (pixels >= 0).all(axis=1)
                inside &= (pixels[:, 0] < self._intrinsics.width) & (pixels[:, 1] < self._intrinsics.height)
            candidates = np.flatnonzero(inside)
            delta = positions[candidates] - np.asarray(pose.position)
            distance = np.linalg.norm(delta, axis=1)
            origins = np.broadcast_to(np.asarray(pose.position), delta.shape)
            # A millimetre short of the surface, so that the surface itself does not hide its point.
            short = distance - np.maximum(2e-3, 1e-3 * distance)
            hidden = hidden_at(index, origins, delta / distance[:, None], short)
            visible = candidates[~hidden]
            seen_point.append(visible)
            seen_frame.append(np.full(len(visible), index))
            seen_pixel.append(pixels[visible])
        point, frame = np.concatenate(seen_point), np.concatenate(seen_frame)
        pixel = np.concatenate(seen_pixel)
        order = np.lexsort((frame, point))
        point, frame, pixel = point[order], frame[order], pixel[order]
        count = np.bincount(point, minlength=len(positions))
        start = np.concatenate([[0], np.cumsum(count)[:-1]])
        rank = np.arange(len(point)) - start[point]
        # Keep rank r if it is the first to reach its share of the places.
        places = np.minimum(count[point], longest)
        keep = (rank * places // np.maximum(count[point], 1)) != ((rank - 1) * places // np.maximum(count[point], 1))
        keep |= rank == 0
        keep &= count[point] >= 2
        point, frame, pixel = point[keep], frame[keep], pixel[keep]
        used, renumbered = np.unique(point, return_inverse=True)
        return SurfacePoints(
            positions=positions[used],
            colours=colours[used],
            track_point=renumbered.astype(np.int64),
            track_frame=frame.astype(np.int64),
            track_pixel=pixel,
        )
