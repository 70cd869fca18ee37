"""The lit scene of every moment while one object moves through it.

The object gathers its light anew wherever it is, and takes from the surfaces around it what it is in the way of, so
that its contact shadow goes with it (generators/lighting/insertion.py). What does not change is done once: the room's
surfaces, its emitters, chosen for the whole way and so the same in every frame, and the layout of the object's light
map, whose texels keep their sampling patterns: nothing flickers while it moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from generators.core.boxes import UprightBox
from generators.core.scene import F32, LightMap, Mesh, Part, Scene
from generators.lighting.insertion import gather_light, light_on
from generators.lighting.shadowing import shadowed
from generators.lighting.surfaces import Surfaces, Tracer
from generators.lighting.surroundings import Objects, Surroundings
from generators.lighting.texels import Sheet, rasterise
from generators.lighting.unwrap import Layout, unwrap

#: The object gets about this many texels, within the limits of size that follow (metres).
_TEXELS = 8000
_FINEST, _COARSEST = 0.008, 0.025


class MovingLight:
    """Lights one object at one place after the other.

    Args:
        scene: the lit home with everything that stands still. It is not changed.
        mesh: of the object, in its own frame.
        way: the object's box wherever it will be; the emitters are chosen for all of these places together.
    """

    def __init__(self, scene: Scene, mesh: Mesh, way: Sequence[UprightBox]) -> None:
        self._scene = scene
        bounds = np.array([box.bounds for box in way])
        around = np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)]).astype(np.float32)
        self._room = Surroundings.of(scene, [around])
        layout = _layout(mesh)
        self._sheet = Sheet.of([layout])
        self._uv = (layout.uv / np.array([layout.width, layout.height])).astype(np.float32)

    def at(self, part: Part) -> Scene:
        """The scene with the object, ``part`` where it is now, as the last of its parts."""
        room = self._room
        surfaces = Surfaces.of((part,))
        texels = rasterise(surfaces, self._sheet)
        objects = Objects(surfaces, self._sheet, texels, Tracer(surfaces.triangles))
        gathered = gather_light(objects, room)
        # It throws light on the room and takes light from it; it stands in what is left of it.
        first = light_on(objects, room.dim, gathered)
        around, ratio = shadowed(self._scene.parts, room, objects, first)
        cells = light_on(objects, replace(room.dim, light=room.dim.light * ratio), gathered)
        light = LightMap(self._uv, np.minimum(self._sheet.image(0, cells), 6e4).astype(np.float16))
        return replace(self._scene, parts=(*around, replace(part, light=light)))


def _layout(mesh: Mesh) -> Layout:
    """The light map of a mesh in its own frame: the same wherever it stands."""
    corners: F32 = mesh.positions
    sides = (corners[:, 1:] - corners[:, :1]).astype(np.float64)
    area = float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()) / 2
    return unwrap(corners, float(np.clip(np.sqrt(area / _TEXELS), _FINEST, _COARSEST)))
