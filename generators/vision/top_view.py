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
    parts = tuple(replace(part, mesh=mesh) for part in home.parts if len((mesh := _below(part.mesh, cut)).positions))
    bounds = np.stack([[part.mesh.bounds[0] for part in parts], [part.mesh.bounds[1] for part in parts]], axis=1)
    low = np.maximum(np.array(room.low) - MARGIN, bounds[:, 0].min(axis=0))
    high = np.minimum(np.array(room.high) + MARGIN, bounds[:, 1].max(axis=0))
    left, top = round(float(low[0]), 3), round(float(low[2]), 3)
    scale = min(PIXELS_PER_METRE, MOST_PIXELS / max(high[0] - left, high[2] - top))
    width, height = max(1, math.ceil((high[0] - left) * scale)), max(1, math.ceil((high[2] - top) * scale))
    # The scale holds at the floor, on which paths are drawn.
    focal = scale * (_HEIGHT + CUT)
    camera = Intrinsics(width, height, focal, focal, width / 2, height / 2)
    middle = (left + width / scale / 2, cut + _HEIGHT, top + height / scale / 2)
    session = EmbreeBackend().open(replace(home, parts=parts), camera)
    view = session.render(Pose(middle, _DOWN))
    session.close()
    rgb = np.where(view.depth[..., None] > 0, np.maximum(view.rgb, 1), 0).astype(np.uint8)
    return TopView(rgb, left, top, round(width / scale, 4), round(height / scale, 4))


def _is_coloured(mesh: Mesh) -> bool:
    return any(material.texture is not None for material in mesh.materials)


def _below(mesh: Mesh, cut: float) -> Mesh:
    """The faces of a mesh that reach below a height."""
    keep = mesh.positions[:, :, 1].min(axis=1) < cut
    faces = {name: getattr(mesh, name)[keep] for name in ("positions", "normals", "uv", "face_material")}
    return replace(mesh, **faces)
