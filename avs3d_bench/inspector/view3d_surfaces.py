"""The surfaces of a room for `avs3d view-3d`: pictures of a few frames, on triangles between the sparse points.

No dataset holds a mesh of the room. In a frame, neighbouring points of `sparse/0` mostly lie on one surface. Their
Delaunay triangulation in the picture, without the triangles that span a jump in depth, is a mesh of what the frame
shows, with the frame as its texture (as in view-dependent texture mapping: Debevec, Taylor and Malik, SIGGRAPH 1996).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.geometry import Intrinsics
from avs3d_bench.inspector.pictures import shrunk

#: At most this many frames, each with a picture of this many pixels a side.
MOST_FRAMES, SIDE = 12, 512
#: A frame is used if it shows this share of all points that no frame before it shows.
LEAST_NEW = 0.01
#: An edge may be this many times longer than at the same depth across the line of sight: a floor seen at 10° reaches 6.
STRETCH = 6.0
#: The longest edge (metres).
LONGEST = 1.0


@dataclass(frozen=True, eq=False)
class Surface:
    """What one frame shows of the room.

    Attributes:
        name: of the frame.
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
class View:
    """The points that a frame shows: their rows (N,) in the list of all points, places (N, 3) and pixels (N, 2)."""

    frame: Frame
    rows: NDArray[np.int64]
    positions: NDArray[np.float64]
    pixels: NDArray[np.float64]


def room_surfaces(observation: Observation, top: float) -> tuple[Surface, ...]:
    """The surfaces of the room below the height ``top`` (metres), from the frames that show most of its points.

    Raises:
        Avs3dError: if a file is missing or damaged.
    """
    camera, views = observation.undistorted_intrinsics, _views(observation)
    shown = np.zeros(1 + max((int(view.rows.max(initial=-1)) for view in views), default=-1), dtype=bool)
    out: list[Surface] = []
    while views and len(out) < MOST_FRAMES:
        best = max(views, key=lambda view: int((~shown[view.rows]).sum()))
        new = ~shown[best.rows]
        if new.sum() < max(3, LEAST_NEW * len(shown)):
            break
        views.remove(best)
        shown[best.rows] = True
        faces = triangles(best, camera)
        # A triangle between points that an earlier frame shows is there already.
        faces = faces[new[faces].any(axis=1) & (best.positions[faces, 1] <= top).all(axis=1)]
        if len(faces):
            out.append(_surface(best, camera, faces))
    return tuple(out)


def _views(observation: Observation) -> list[View]:
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
        rows = rows[known]
        views.append(View(frame, rows, model.points.positions[rows], image.pixels[known]))
    return views


def triangles(view: View, camera: Intrinsics) -> NDArray[np.int32]:
    """(M, 3) the Delaunay triangles whose edges lie on one surface, as far as one can tell."""
    if len(view.pixels) < 3:
        return np.zeros((0, 3), dtype=np.int32)
    try:
        faces = np.asarray(Delaunay(view.pixels).simplices, dtype=np.int32)
    except QhullError:  # all on one line
        return np.zeros((0, 3), dtype=np.int32)
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1)
    away = view.positions - np.asarray(view.frame.pose.position)
    depth = -(away @ view.frame.pose.rotation_matrix)[:, 2]
    length = np.linalg.norm(view.positions[ends[..., 0]] - view.positions[ends[..., 1]], axis=-1)
    across = np.linalg.norm((view.pixels[ends[..., 0]] - view.pixels[ends[..., 1]]) / (camera.fx, camera.fy), axis=-1)
    plain = across * depth[ends].min(axis=-1)
    kept = ((length <= STRETCH * plain) & (length <= LONGEST)).all(axis=1)
    # Rows grow downwards: what turns clockwise in (column, row) is counter-clockwise as the camera sees it.
    one, two = (view.pixels[faces[:, k]] - view.pixels[faces[:, 0]] for k in (1, 2))
    turned = one[:, 0] * two[:, 1] > one[:, 1] * two[:, 0]
    faces[turned] = faces[turned, ::-1]
    return np.asarray(faces[kept])


def _surface(view: View, camera: Intrinsics, faces: NDArray[np.int32]) -> Surface:
    used, renumbered = np.unique(faces, return_inverse=True)
    return Surface(
        view.frame.name,
        view.positions[used].astype(np.float32),
        renumbered.reshape(faces.shape).astype(np.int32),
        (view.pixels[used] / (camera.width, camera.height)).astype(np.float32),
        shrunk(view.frame.undistorted_rgb(), SIDE),
    )
