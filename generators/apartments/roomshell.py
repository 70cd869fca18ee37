"""Draws the surfaces of one room in the coordinates of its walls: along, height, depth into the room."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from generators.apartments.floorplan import WallFrame
from generators.assets.materials import TILES
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material, Part

Array = NDArray[np.float64]


class RoomShell:
    """Draws the surfaces of one room, in the coordinates of its walls (along, height, depth into the room)."""

    def __init__(self) -> None:
        self.builder = MeshBuilder(TILES)
        self._acoustic: list[Array] = []
        self._labels: list[str] = []

    def quad(self, corners: Array, material: Material, *, sound: bool = False) -> None:
        """A rectangle, counter-clockwise from its lower left; ``sound``: it is in the acoustic twin too."""
        self.builder.quad(corners, material, acoustic=False)
        if sound:
            self.sound(corners, material)

    def pane(self, corners: Array, material: Material, u: tuple[float, float], v: tuple[float, float]) -> None:
        """A rectangle that shows the stretch ``u`` × ``v`` of its texture; sound does not meet it."""
        corner_uv = np.array([(u[0], v[0]), (u[1], v[0]), (u[1], v[1]), (u[0], v[1])])
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        self.builder.add(corners, faces, material, uv=corner_uv[faces], acoustic=False)

    def sound(self, corners: Array, material: Material) -> None:
        """A rectangle of the acoustic twin alone."""
        p = np.asarray(corners, dtype=np.float64)
        self._acoustic.append(p[[[0, 1, 2], [0, 2, 3]]])
        self._labels += [material.acoustic] * 2

    def block(
        self,
        wall: WallFrame,
        along: tuple[float, float],
        height: tuple[float, float],
        depth: tuple[float, float],
        material: Material,
        faces: str = "front left right top bottom",
    ) -> None:
        """A box on a wall without its back; ``faces`` names the faces that show."""
        (s0, s1), (y0, y1), (d0, d1) = along, height, depth
        at = wall.point
        sides = {
            "front": ((s0, y0, d1), (s1, y0, d1), (s1, y1, d1), (s0, y1, d1)),
            "left": ((s0, y0, d0), (s0, y0, d1), (s0, y1, d1), (s0, y1, d0)),
            "right": ((s1, y0, d1), (s1, y0, d0), (s1, y1, d0), (s1, y1, d1)),
            "top": ((s0, y1, d1), (s1, y1, d1), (s1, y1, d0), (s0, y1, d0)),
            "bottom": ((s0, y0, d0), (s1, y0, d0), (s1, y0, d1), (s0, y0, d1)),
        }
        for face in faces.split():
            self.quad(np.array([at(*corner) for corner in sides[face]]), material)

    def reveal(
        self,
        wall: WallFrame,
        along: tuple[float, float],
        height: tuple[float, float],
        depth: float,
        lining: Material,
        base: Material,
    ) -> None:
        """The four inner faces of a hole that reaches ``depth`` behind the wall's surface; ``base`` is the lowest."""
        (s0, s1), (y0, y1), d = along, height, -depth
        faces = (
            (((s0, y0, 0), (s0, y0, d), (s0, y1, d), (s0, y1, 0)), lining),
            (((s1, y0, d), (s1, y0, 0), (s1, y1, 0), (s1, y1, d)), lining),
            (((s0, y1, d), (s1, y1, d), (s1, y1, 0), (s0, y1, 0)), lining),
            (((s0, y0, 0), (s1, y0, 0), (s1, y0, d), (s0, y0, d)), base),
        )
        for corners, material in faces:
            self.quad(np.array([wall.point(*corner) for corner in corners]), material, sound=True)

    def wall(
        self,
        wall: WallFrame,
        room_height: float,
        holes: list[tuple[float, float, float, float]],
        paint: Material,
        tiles: Material | None,
        tile_height: float,
    ) -> None:
        """A wall with rectangular ``holes`` (along from, to, height from, to), tiled up to ``tile_height``.

        Its cells share their corners, so that it unwraps into one chart; the acoustic twin has fewer, larger ones.
        """
        split = [tile_height] if tiles is not None else []
        along = np.unique([0.0, wall.length, *(v for h in holes for v in h[:2])])
        heights = np.unique([0.0, room_height, *split, *(v for h in holes for v in h[2:])])

        def inside(s: float, y: float) -> bool:
            return any(h[0] < s < h[1] and h[2] < y < h[3] for h in holes)

        def covering(y: float) -> Material:
            return tiles if tiles is not None and y < tile_height else paint

        for material in (paint, tiles):
            if material is None:
                continue
            corners: list[tuple[float, float]] = []
            faces: list[tuple[int, int, int]] = []
            for s0, s1 in pairwise(along):
                for y0, y1 in pairwise(heights):
                    middle = ((s0 + s1) / 2, (y0 + y1) / 2)
                    if inside(*middle) or covering(middle[1]) is not material:
                        continue
                    first = len(corners)
                    corners += [(s0, y0), (s1, y0), (s1, y1), (s0, y1)]
                    faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
            if faces:
                flat, index = np.array(corners), np.array(faces)
                uv = flat[index] / TILES.get(material.name, 1.0)
                points = np.array([wall.point(s, y) for s, y in corners])
                self.builder.add(points, index, material, uv=uv, acoustic=False)
        for s0, s1 in pairwise(along):
            centre = (s0 + s1) / 2
            cuts = sorted({0.0, room_height, *split, *(v for h in holes if h[0] < centre < h[1] for v in h[2:])})
            for y0, y1 in pairwise(cuts):
                if not inside(centre, (y0 + y1) / 2):
                    corner = ((s0, y0), (s1, y0), (s1, y1), (s0, y1))
                    self.sound(np.array([wall.point(*c) for c in corner]), covering((y0 + y1) / 2))

    def part(self, name: str) -> Part:
        """The finished part with its own acoustic twin."""
        mesh = self.builder.build()
        acoustic = np.concatenate([np.zeros((0, 3, 3)), *self._acoustic]).astype(np.float32)
        return Part(name, replace(mesh, acoustic_positions=acoustic, acoustic_labels=tuple(self._labels)))
