"""The surfaces of a room for `avs3d view-3d`: pictures of a few frames, on a patch of surface around each sparse point.

No dataset holds a mesh of the room. The neighbours of a point of `sparse/0` mostly lie on one plane with it; the part
of the plane that they span is a rectangle, which shows what a frame saw there (surface elements with projected
textures: Pfister et al., SIGGRAPH 2000; Debevec, Taylor and Malik, SIGGRAPH 1996). Triangles between the points of a
picture would span the gaps between near and far surfaces; patches end where their surface ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.formats import media
from avs3d_bench.geometry import Intrinsics
from avs3d_bench.inspector.pictures import shrunk

#: At most this many frames, each with a picture of this many pixels a side.
MOST_FRAMES, SIDE = 12, 512
#: A frame is used if it shows this share of all points that no frame before it shows.
LEAST_NEW = 0.01
#: Neighbours of a point that its patch spans.
NEIGHBOURS = 10
#: Greatest share of the variance across a surface: above it, the neighbours lie on no plane, as at the edge of a table.
FLAT = 0.02
#: Least share of the variance along the shorter axis of a surface: below it, the neighbours lie on a line.
LINE = 0.01
#: Neighbours lie on the plane of a point up to this angle from it (sine).
OFF_PLANE = 0.15
#: How far a patch goes on beyond the neighbours that it spans, in distances to the nearest of them, and at most (m).
#: Where a floor meets a wall, no point lies in the corner itself.
BEYOND, MOST_BEYOND = 0.6, 0.06
#: Patches that come nearer to their camera are left out: their picture would be stretched without bounds (m).
LEAST_DEPTH = 0.05
#: The farthest that a patch reaches from its point (m).
LONGEST = 0.35
#: The picture from above lies this far below the floor, so that patches of the floor hide it (m).
BELOW_FLOOR = 0.02
#: Side of its squares (pixels): those at the edge of what is known are left out.
CELL = 4


@dataclass(frozen=True, eq=False)
class VisibleSurface:
    """The surface of the room that one picture shows.

    Attributes:
        name: of the frame, or ``floor``.
        vertices: (N, 3) float32, world, metres.
        faces: (M, 3) int32, counter-clockwise as the camera sees them.
        pixels: (N, 2) float32 (column, row) of the vertices in the picture, as shares of its width and height.
        picture: (H, W, 3) uint8 RGB.
    """

    name: str
    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    pixels: NDArray[np.float32]
    picture: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Patches:
    """A rectangle of surface around each of N points.

    Attributes:
        centres: (N, 3) the points, metres.
        normals: (N, 3) unit vectors across the surface, to either side; zero where the neighbours lie on no plane.
        axes: (N, 2, 3) unit vectors along the sides; undefined without a normal.
        reach: (N, 2, 2) from the centre to the low and the high side along each axis, metres; signed.
    """

    centres: NDArray[np.float64]
    normals: NDArray[np.float64]
    axes: NDArray[np.float64]
    reach: NDArray[np.float64]

    @classmethod
    def around(cls, positions: NDArray[np.float64]) -> Patches:
        """The patches of points (N, 3), from each point's neighbours: what these span along the surface."""
        count = len(positions)
        if count <= NEIGHBOURS:
            none = np.zeros((count, 3))
            return cls(positions, none, np.zeros((count, 2, 3)), np.zeros((count, 2, 2)))
        found = KDTree(positions).query(positions, k=NEIGHBOURS + 1)
        distance, near = np.asarray(found[0]), np.asarray(found[1])
        spread = positions[near] - positions[near].mean(axis=1, keepdims=True)
        values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))
        # Points on a line lie on many planes, and so on none.
        flat = (values[:, 0] <= FLAT * values[:, 1]) & (values[:, 1] > LINE * values[:, 2])
        normals = np.where(flat[:, None], vectors[:, :, 0], 0.0)
        axes = _axes(normals)
        away = positions[near[:, 1:]] - positions[:, None]
        on_plane = np.abs(np.einsum("nki,ni->nk", away, normals)) <= OFF_PLANE * distance[:, 1:]
        along = np.einsum("nki,nai->nka", away, axes) * (on_plane & flat[:, None])[..., None]
        # Without a plane, a patch is a small square that faces the camera.
        nearest = distance[:, 1 + NEIGHBOURS // 4]
        beyond = np.minimum(BEYOND * nearest, MOST_BEYOND)
        low = np.where(flat[:, None], along.min(axis=1), 0.0) - beyond[:, None]
        high = np.where(flat[:, None], along.max(axis=1), 0.0) + beyond[:, None]
        return cls(positions, normals, axes, np.clip(np.stack([low, high], axis=-1), -LONGEST, LONGEST))

    def corners(self, rows: NDArray[np.int64], camera: NDArray[np.float64], top: float) -> NDArray[np.float64]:
        """The corners (M, 4, 3) of patches, counter-clockwise as the camera at (3,) sees them, cut at a height.

        Args:
            rows: (M,) which.
            camera: its position, metres.
            top: height above which nothing is left (metres): walls end in a straight edge.
        """
        towards = camera - self.centres[rows]
        towards /= np.maximum(np.linalg.norm(towards, axis=1), 1e-9)[:, None]
        faced = np.where((self.normals[rows] != 0).any(axis=1)[:, None], self.normals[rows], towards)
        axes = np.where((self.normals[rows] != 0).any(axis=1)[:, None, None], self.axes[rows], _axes(towards))
        (left, right), (low, high) = self.reach[rows].transpose(1, 2, 0)
        # The second axis of what stands upright points upwards.
        rise = axes[:, 1, 1]
        room = np.where(rise > 0.1, (top - self.centres[rows, 1]) / np.maximum(rise, 0.1), np.inf)
        high = np.maximum(np.minimum(high, room), low)
        sides = [(left, low), (right, low), (right, high), (left, high)]
        out = np.stack(
            [self.centres[rows] + a[:, None] * axes[:, 0] + b[:, None] * axes[:, 1] for a, b in sides], axis=1
        )
        across = np.cross(out[:, 1] - out[:, 0], out[:, 3] - out[:, 0])
        away = (across * np.where((faced * towards).sum(axis=1) < 0, -1, 1)[:, None] * faced).sum(axis=1) < 0
        out[away] = out[away, ::-1]
        return np.asarray(out)


def _axes(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Two unit vectors (N, 2, 3) across each unit vector (N, 3): a horizontal one, and the other, which goes upwards.

    Across an upright vector they are X and −Z.
    """
    across = np.cross([0.0, 1.0, 0.0], normals)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(length > 0.1, across / np.maximum(length, 1e-9), [1.0, 0.0, 0.0])
    up = np.cross(normals, across)
    up = np.where(up[:, 1:2] < 0, -up, up)
    return np.asarray(np.stack([across, up], axis=1))


@dataclass(frozen=True, eq=False)
class VisiblePoints:
    """The points that a frame shows: their rows (N,) in the list of all points, sorted."""

    frame: Frame
    rows: NDArray[np.int64]


def room_surfaces(observation: Observation, top: float) -> tuple[VisibleSurface, ...]:
    """The surfaces of the room below the height ``top`` (metres), from the frames that show most of its points.

    Raises:
        Avs3dError: if a file is missing or damaged.
    """
    camera, views = observation.undistorted_intrinsics, _views(observation)
    positions = observation.colmap.points.positions
    patches = Patches.around(positions)
    wanted = positions[:, 1] <= top
    shown = ~wanted
    chosen: list[VisiblePoints] = []
    while views and len(chosen) < MOST_FRAMES:
        best = max(views, key=lambda view: int((~shown[view.rows]).sum()))
        if (~shown[best.rows]).sum() < max(3, LEAST_NEW * wanted.sum()):
            break
        views.remove(best)
        shown[best.rows] = True
        chosen.append(best)
    surfaces = (_surface(view, rows, patches, camera, top) for view, rows in _shared_out(chosen, patches, wanted))
    return tuple(surface for surface in surfaces if len(surface.faces))


def floor_picture(observation: Observation, floor: float) -> VisibleSurface | None:
    """The picture from above of a scan, laid on its floor; None without such a picture.

    Patches show what the frames saw; between and behind them lies the floor plan.

    Args:
        observation: in a scan.
        floor: height of the floor, metres.

    Raises:
        Avs3dError: if the picture is missing or damaged.
    """
    area = observation.record.top_view if observation.record else None
    if area is None:
        return None
    picture = media.read_png_rgb(observation.where(layout.TOP_VIEW))
    rows, columns = (-(-side // CELL) for side in picture.shape[:2])
    padded = np.zeros((rows * CELL, columns * CELL), dtype=bool)
    padded[: picture.shape[0], : picture.shape[1]] = picture.any(axis=2)
    row, column = np.nonzero(padded.reshape(rows, CELL, columns, CELL).all(axis=(1, 3)))
    # Counter-clockwise as seen from above: x to the right, z downwards.
    corners = np.array([(0, 0), (0, 1), (1, 1), (1, 0)])
    pixels = ((np.stack([column, row], axis=1)[:, None] + corners) * CELL).reshape(-1, 2).astype(np.float64)
    pixels = np.minimum(pixels / picture.shape[1::-1], 1.0)
    places = pixels * (area.width, area.height) + (area.left, area.top)
    vertices = np.insert(places, 1, floor - BELOW_FLOOR, axis=1)
    first = 4 * np.arange(len(row), dtype=np.int32)[:, None]
    return VisibleSurface(
        "floor",
        vertices.astype(np.float32),
        np.concatenate([first + (0, 1, 2), first + (0, 2, 3)]).astype(np.int32),
        pixels.astype(np.float32),
        picture,
    )


def _views(observation: Observation) -> list[VisiblePoints]:
    """The points of `sparse/0` in every frame with a pose."""
    model = observation.colmap
    images = {image.name.rpartition(".")[0]: image for image in model.images}
    views = []
    for frame in observation.frames:
        image = images.get(frame.name)
        if image is None:
            continue
        rows = np.searchsorted(model.points.ids, image.point_ids)
        known = rows < len(model.points.ids)
        known[known] = model.points.ids[rows[known]] == image.point_ids[known]
        views.append(VisiblePoints(frame, np.unique(rows[known])))
    return views


def _shared_out(
    views: list[VisiblePoints], patches: Patches, wanted: NDArray[np.bool_]
) -> list[tuple[VisiblePoints, NDArray[np.int64]]]:
    """Which patches each view shows: every patch in the view that sees most of it, from near and from the front."""
    sharpest, owner = np.zeros(len(wanted)), np.full(len(wanted), -1)
    for number, view in enumerate(views):
        away = np.asarray(view.frame.pose.position) - patches.centres[view.rows]
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-6)
        normals = patches.normals[view.rows]
        facing = np.where((normals != 0).any(axis=1), np.abs((away * normals).sum(axis=1)) / distance, 0.5)
        better = (facing / distance**2 > sharpest[view.rows]) & wanted[view.rows]
        rows = view.rows[better]
        sharpest[rows], owner[rows] = (facing / distance**2)[better], number
    return [(view, np.flatnonzero(owner == number)) for number, view in enumerate(views)]


def _surface(
    view: VisiblePoints, rows: NDArray[np.int64], patches: Patches, camera: Intrinsics, top: float
) -> VisibleSurface:
    pose = view.frame.pose
    corners = patches.corners(rows, np.asarray(pose.position, dtype=np.float64), top)
    _, depth = camera.project(pose, corners.reshape(-1, 3))
    corners = corners[(depth.reshape(-1, 4) > LEAST_DEPTH).all(axis=1)]
    pixels, _ = camera.project(pose, corners.reshape(-1, 3))
    first = 4 * np.arange(len(corners), dtype=np.int32)[:, None]
    return VisibleSurface(
        view.frame.name,
        corners.reshape(-1, 3).astype(np.float32),
        np.concatenate([first + (0, 1, 2), first + (0, 2, 3)]).astype(np.int32),
        # A patch at the border of the picture shows the border.
        np.clip(pixels / (camera.width, camera.height), 0, 1).astype(np.float32),
        shrunk(view.frame.undistorted_rgb(), SIDE),
    )
