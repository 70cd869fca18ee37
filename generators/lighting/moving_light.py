"""The lit scene of every moment while objects move through it.

At every moment the objects gather their light again and shade one another and the surfaces around them, so that their
contact shadows move with them (generators/lighting/insertion.py). Computed once are the room's surfaces, its emitters,
and the layout of the objects' light maps. The emitters are chosen for the whole paths and the texels keep their
sampling patterns, so that nothing flickers while the objects move.
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

#: Each object gets about this many texels: fewer than objects that stand, for they are lit again in every frame.
_TEXELS = 8000


class MovingLight:
    """Lights objects at one place after the other.

    Args:
        scene: the lit home with everything that stands still. It is not changed.
        meshes: of the objects, each in its own frame.
        ways: the box of each object wherever it will be; the emitters are chosen for all of its places together.
    """

    def __init__(self, scene: Scene, meshes: Sequence[Mesh], ways: Sequence[Sequence[UprightBox]]) -> None:
        bounds = [np.array([box.bounds for box in way], dtype=np.float32) for way in ways]
        self._scene = scene = with_shadow_maps(with_scan_light(scene), [box for boxes in bounds for box in boxes])
        around = [np.stack([one[:, 0].min(axis=0), one[:, 1].max(axis=0)]).astype(np.float32) for one in bounds]
        self._room = Surroundings.of(scene, around)
        layouts = [_layout(mesh) for mesh in meshes]
        self._sheet = Sheet.of(layouts)
        self._uvs = [uv_of(layout) for layout in layouts]

    def at(self, parts: tuple[Part, ...]) -> Scene:
        """The scene with the objects, ``parts`` where they are now, as the last of its parts."""
        objects = Objects.of(LitSurfaces.of(parts), self._sheet)
        return light_parts(self._scene, self._room, objects, parts, self._uvs)


def _layout(mesh: Mesh) -> LightMapLayout:
    """The light map of a mesh in its own frame: the same wherever it stands."""
    corners: F32 = mesh.positions
    sides = (corners[:, 1:] - corners[:, :1]).astype(np.float64)
    return unwrap(corners, texel_size(sides, _TEXELS), normals=mesh.normals)
