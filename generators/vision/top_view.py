"""A scan seen from above, without what is above head height and without placed objects: the floor plan of its maps.

Walls, furniture and floor of a procedural home are traced from sparse points (avs3d_bench/inspector/floorplan.py).
On a scan, whose furniture is cluttered and whose walls have holes, the outlines say little and a picture says all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.scene import Mesh, Part, Room, Scene
from generators.vision.embree import EmbreeBackend

#: What is above this height over the floor is left out: lamps and ceilings would hide the room (m).
CUT = 1.9
#: How far the picture reaches beyond the room's box (m): as far as the maps of the inspector.
MARGIN = 1.25
PIXELS_PER_METRE, MOST_PIXELS = 96.0, 1600.0
#: Height of the camera above the cut (m). What is 1.9 m high leans outwards by 1 % of its distance from the middle:
#: 5 cm at the edge of a picture of 10 m.
_HEIGHT = 190.0
#: The camera looks down, the picture's upper side towards −Z: a quarter turn about X (w, x, y, z).
_DOWN = (math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class TopView:
    """A room of a scan from above.

    Attributes:
        rgb: (H, W, 3) uint8 sRGB; x to the right, z downwards; black where nothing is.
        left: x of its left side, metres.
        top: z of its upper side, metres.
        width: metres.
        height: metres.
    """

    rgb: NDArray[np.uint8]
    left: float
    top: float
    width: float
    height: float


def render_top_view(home: Scene, room: Room) -> TopView | None:
    """Draw a room of a scan, with what is around it, from above.

    Args:
        home: without placed objects.
        room: in the middle of the picture; its lowest corner is on the floor.

    Returns:
        The picture; None for a home that is no scan, or one that was read without its textures.

    Raises:
        Avs3dError: for a scene that cannot be rendered, or a missing package of ``[generate]``.
    """
    if home.stage is None or not any(_is_coloured(part.mesh) for part in home.parts):
        return None
    known = _view_cache.setdefault(home.parts[0], {})
    if room not in known:
        known[room] = _render(home, room)
    return known[room]


#: Pictures of the scans that are open, by their first part: the observations of a room share one.
_view_cache: WeakKeyDictionary[Part, dict[Room, TopView]] = WeakKeyDictionary()


def _render(home: Scene, room: Room) -> TopView:
    cut = room.low[1] + CUT
    parts = _below(home, cut)
    bounds = np.stack([[part.mesh.bounds[0] for part in parts], [part.mesh.bounds[1] for part in parts]], axis=1)
    low = np.maximum(np.array(room.low) - MARGIN, bounds[:, 0].min(axis=0))
    high = np.minimum(np.array(room.high) + MARGIN, bounds[:, 1].max(axis=0))
    left, top = round(float(low[0]), 3), round(float(low[2]), 3)
    width, depth = float(high[0]) - left, float(high[2]) - top
    scale = min(PIXELS_PER_METRE, MOST_PIXELS / max(width, depth))
    rgb = view_from_above(home, (left, top), (width, depth), (room.low[1], cut), scale)
    return TopView(rgb, left, top, round(rgb.shape[1] / scale, 4), round(rgb.shape[0] / scale, 4))


def view_from_above(
    home: Scene, corner: tuple[float, float], sides: tuple[float, float], heights: tuple[float, float], scale: float
) -> NDArray[np.uint8]:
    """Draw a scan from above, without what is wholly above a height.

    Args:
        home: without placed objects.
        corner: x and z of the picture's upper left corner, metres.
        sides: along x and z, metres; rounded up to whole pixels.
        heights: of the floor, on which the scale holds, and of the cut, metres.
        scale: pixels per metre.

    Returns:
        (H, W, 3) sRGB; black where nothing is, and only there.
    """
    floor, cut = heights
    width, height = (max(1, math.ceil(side * scale)) for side in sides)
    focal = scale * (_HEIGHT + cut - floor)
    camera = Intrinsics(width, height, focal, focal, width / 2, height / 2)
    middle = (corner[0] + width / scale / 2, cut + _HEIGHT, corner[1] + height / scale / 2)
    session = EmbreeBackend().open(replace(home, parts=_below(home, cut)), camera)
    view = session.render(Pose(middle, _DOWN))
    session.close()
    return np.where(view.depth[..., None] > 0, np.maximum(view.rgb, 1), 0).astype(np.uint8)


def _is_coloured(mesh: Mesh) -> bool:
    return any(material.texture is not None for material in mesh.materials)


def _below(home: Scene, cut: float) -> tuple[Part, ...]:
    """The parts of a home without the faces that are wholly above a height; of dense scans, decimated ones.

    Their faces are as wide as a pixel of the picture.
    """
    parts = []
    for part in home.parts:
        keep = part.mesh.positions[:, :, 1].min(axis=1) < cut
        if keep.any():
            faces = {name: getattr(part.mesh, name)[keep] for name in ("positions", "normals", "uv", "face_material")}
            parts.append(replace(part, mesh=replace(part.mesh, **faces), dense=None))
    return tuple(parts)
