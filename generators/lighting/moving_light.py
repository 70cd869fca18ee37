"""The lit scene of every moment while one object moves through it.

At every moment the object gathers its light again and shades the surfaces around it, so that its contact shadow moves
with it (generators/lighting/insertion.py). Computed once are the room's surfaces, its emitters, and the layout of the
object's light map. The emitters are chosen for the whole path and the texels keep their sampling patterns, so that
nothing flickers while the object moves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from generators.core.boxes import UprightBox
from generators.core.scene import F32, Mesh, Part, Scene
from generators.lighting.insertion import light_parts, texel_size, uv_of
from generators.lighting.scan_light import with_scan_light
from generators.lighting.scan_shadow import with_shadow_maps
from generators.lighting.surfaces import LitSurfaces
from generators.lighting.surroundings import Objects, Surroundings
from generators.lighting.texels import Sheet
from generators.lighting.unwrap import LightMapLayout, unwrap

#: The object gets about this many texels: fewer than objects that stand, for they are lit again in every frame.
_TEXELS = 8000


class MovingLight:
    """Lights one object at one place after the other.

    Args:
        scene: the lit home with everything that stands still. It is not changed.
        mesh: of the object, in its own frame.
        way: the object's box wherever it will be; the emitters are chosen for all of these places together.
    """

    def __init__(self, scene: Scene, mesh: Mesh, way: Sequence[UprightBox]) -> None:
        bounds = np.array([box.bounds for box in way], dtype=np.float32)
        self._scene = scene = with_shadow_maps(with_scan_light(scene), list(bounds))
        around = np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)]).astype(np.float32)
        self._room = Surroundings.of(scene, [around])
        layout = _layout(mesh)
        self._sheet = Sheet.of([layout])
        self._uv = uv_of(layout)

    def at(self, part: Part) -> Scene:
        """The scene with the object, ``part`` where it is now, as the last of its parts."""
        objects = Objects.of(LitSurfaces.of((part,)), self._sheet)
        return light_parts(self._scene, self._room, objects, (part,), (self._uv,))


def _layout(mesh: Mesh) -> LightMapLayout:
    """The light map of a mesh in its own frame: the same wherever it stands."""
    corners: F32 = mesh.positions
    sides = (corners[:, 1:] - corners[:, :1]).astype(np.float64)
    return unwrap(corners, texel_size(sides, _TEXELS), normals=mesh.normals)
