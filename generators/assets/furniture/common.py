"""`Furniture`, and its mesh builder `Kit`, which adds wood grain, soft shapes and acoustic boxes.

Pieces are modelled in any convenient frame (usually back at z = 0, floor at y = 0, x about 0) with the front towards
+Z; `Kit.finish` moves the origin to the place that the conventions require.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from generators.assets.forms import (
    CHAMFER_FACES,
    CHAMFER_NORMALS,
    INSET,
    SIGNS,
    Array,
    grid_faces,
    outward,
)
from generators.assets.materials import TILES, Palette
from generators.assets.shapes import BOX_FACES, MeshBuilder, rotation
from generators.assets.styles import STYLES
from generators.core.scene import Material, Mesh, Support, SupportKind

Mount = Literal["floor", "wall", "ceiling"]
Point = Sequence[float] | Array


@dataclass(frozen=True, eq=False)
class Furniture:
    """A piece of furniture in its own frame.

    Attributes:
        kind: a key of `generators.assets.furniture.KINDS`.
        mesh: Y up, front +Z. Origin: floor pieces at the centre of the footprint on the floor, wall pieces at the
            centre of the back face (z = 0 is the wall), ceiling pieces at the contact with the ceiling (y = 0).
        supports: free surfaces for objects, in the local frame, with ``room`` empty.
        mount: kind of surface to which it is fixed.
    """

    kind: str
    mesh: Mesh
    supports: tuple[Support, ...] = ()
    mount: Mount = "floor"


class Kit(MeshBuilder):
    """A mesh builder for furniture.

    It differs from its base in three ways: a wooden part's grain follows its longest side (or ``grain``); each part
    uses another piece of the texture; and the acoustic twin has only the boxes added by `sound`, so that the acoustic
    engine gets two boxes for a chair and not forty.
    """

    def __init__(self, palette: Palette, rng: np.random.Generator) -> None:
        super().__init__(TILES)
        self.palette = palette
        self.rng = rng
        self.mount: Mount = "floor"
        self.grain: int | None = None
        self._edge = STYLES[palette.style].edge * float(palette.stream("edge").uniform(0.8, 1.25))
        self._whole = False
        self._supports: list[Support] = []

    def m(self, role: str) -> Material:
        """The palette's material for a role."""
        return self.palette.material(role)

    def pick(self, *options: str) -> str:
        """One of the options, chosen by this piece's random numbers."""
        return options[int(self.rng.integers(len(options)))]

    def near(self, value: float, spread: float = 0.06) -> float:
        """A size within ± ``spread`` (relative) of ``value``."""
        return float(value * self.rng.uniform(1 - spread, 1 + spread))

    @contextmanager
    def one_slab(self) -> Iterator[None]:
        """Parts added in this context share one texture, as if they were cut from one slab."""
        self._whole = True
        try:
            yield
        finally:
            self._whole = False

    @contextmanager
    def grained(self, axis: str) -> Iterator[None]:
        """Parts added in this context have their grain along ``"x"``, ``"y"`` or ``"z"``."""
        before, self.grain = self.grain, "xyz".index(axis)
        try:
            yield
        finally:
            self.grain = before

    def add(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        material: Material,
        *,
        centre: Sequence[float] | Array = (0.0, 0.0, 0.0),
        rotate: Array | None = None,
        uv: Array | None = None,
        normals: Array | None = None,
        crease: float = 40.0,
        acoustic: bool | str = True,
    ) -> Self:
        """As `MeshBuilder.add`, without an acoustic twin; default texture coordinates follow the grain."""
        points = np.asarray(vertices, dtype=np.float64)
        if uv is None and material.texture is not None:
            uv = self._grain_uv(points + (np.asarray(centre) if self._whole else 0.0), np.asarray(faces), material)
        super().add(
            points,
            faces,
            material,
            centre=centre,
            rotate=rotate,
            uv=uv,
            normals=normals,
            crease=crease,
            acoustic=False,
        )
        return self

    def _grain_uv(self, points: Array, faces: NDArray[np.int64], material: Material) -> Array:
        triangles = points[faces]
        cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        dominant = np.argmax(np.abs(cross), axis=1)
        along = self.grain if self.grain is not None else int(np.argmax(np.ptp(points, axis=0)))
        # (u, v) axes of a face: the grain, and the remaining axis; on end grain any pair is possible.
        table = np.array([[1, 2], [0, 2], [0, 1]])
        for axis in range(3):
            if axis != along:
                table[axis] = [along, 3 - axis - along]
        columns = table[dominant]
        flat = np.take_along_axis(triangles, columns[:, None, :].repeat(3, axis=1), axis=2)
        shift = np.zeros(2) if self._whole else self.rng.random(2)
        return flat / self.tiles.get(material.name, 1.0) + shift

    def panel(
        self, low: Point, high: Point, material: Material, *, bevel: float = 0.003, rotate: Array | None = None
    ) -> Self:
        """A board between two corners with softened edges (44 triangles; 12 with ``bevel`` 0).

        The style of the home makes edges sharper or rounder than ``bevel``; ``rotate`` turns it about its own centre.
        """
        lower, upper = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        centre, half = (lower + upper) / 2, (upper - lower) / 2
        radius = min(bevel * self._edge, 0.45 * 2 * float(half.min()))
        if radius <= 0:
            self.box(tuple(2 * half), tuple(centre), material, rotate=rotate)
            return self
        vertices = SIGNS * half - SIGNS * INSET * radius
        return self.add(
            vertices,
            CHAMFER_FACES,
            material,
            centre=tuple(centre),
            rotate=rotate,
            normals=CHAMFER_NORMALS[CHAMFER_FACES],
        )

    def soft(
        self,
        size: Point,
        centre: Point,
        material: Material,
        *,
        radius: float = 0.05,
        puff: Point = (0.0, 0.0, 0.0),
        cells: int = 6,
        rotate: Array | None = None,
    ) -> Self:
        """An upholstered block: rounded edges of ``radius``, faces bulging outwards by ``puff`` metres per axis."""
        half = np.asarray(size, dtype=np.float64) / 2
        r = min(radius, 0.49 * 2 * float(half.min()))
        # Cut lines dense near the edges, where the curvature is.
        cut = np.sign(np.linspace(-1, 1, cells + 1)) * np.abs(np.linspace(-1, 1, cells + 1)) ** 0.6
        s, t = (k.reshape(-1) for k in np.meshgrid(cut, cut, indexing="ij"))
        vertices: list[Array] = []
        faces: list[NDArray[np.int64]] = []
        for axis in range(3):
            for sign in (-1.0, 1.0):
                p = np.empty((len(s), 3))
                p[:, axis], p[:, (axis + 1) % 3], p[:, (axis + 2) % 3] = sign, s, t
                index = grid_faces(cells + 1, cells + 1) + len(vertices) * len(s)
                faces.append(index[:, ::-1] if sign < 0 else index)
                vertices.append(p)
        unit = np.concatenate(vertices)
        cube = unit * half
        inner = np.clip(cube, -(half - r), half - r)
        offset = cube - inner
        length = np.linalg.norm(offset, axis=1, keepdims=True)
        shaped = inner + offset * (r / np.where(length > 0, length, 1.0))
        crown = 1 - unit**2
        for axis, rise in enumerate(puff):
            if rise:
                others = crown[:, (axis + 1) % 3] * crown[:, (axis + 2) % 3]
                shaped[:, axis] += rise * unit[:, axis] * np.sqrt(np.clip(others, 0, 1))
        joined = np.concatenate(faces)
        return self.add(shaped, outward(shaped, joined), material, centre=tuple(centre), rotate=rotate, crease=75.0)

    def pillow(
        self, size: Point, centre: Point, material: Material, *, rotate: Array | None = None, cells: int = 7
    ) -> Self:
        """A stuffed cushion lying in its local x–y plane, ``size`` = (width, height, thickness).

        Its rim is thin and pinched; its faces have a dent and folds towards the corners, which differ from place to
        place.
        """
        w, h, d = (float(k) / 2 for k in size)
        cut = np.sin(np.linspace(-np.pi / 2, np.pi / 2, cells + 1))
        s, t = (k.reshape(-1) for k in np.meshgrid(cut, cut, indexing="ij"))
        # The sides are curved inwards between the corners, as in a stuffed cushion.
        x = w * s * (1 - 0.07 * (1 - t**2))
        y = h * t * (1 - 0.07 * (1 - s**2))
        thick = d * (np.clip(1 - np.abs(s) ** 2.4, 0, 1) * np.clip(1 - np.abs(t) ** 2.4, 0, 1)) ** 0.42
        at = np.abs(np.asarray(centre, dtype=np.float64))
        phase = np.random.default_rng(np.rint(at * 1e4).astype(np.int64).tolist()).uniform(0, 2 * np.pi, 3)
        folds = 0.13 * np.sin(7 * np.arctan2(t, s) + phase[0]) * np.hypot(s, t) ** 2
        folds += 0.07 * np.sin(4 * s + 5 * t + phase[1])
        dent = 0.24 * np.exp(-((s - 0.3 * np.sin(phase[2])) ** 2 + (t - 0.25 * np.cos(phase[2])) ** 2) / 0.2)
        front = np.stack([x, y, thick * (1 + folds - dent)], axis=1)
        back = np.stack([x, y, -thick * (1 - folds)], axis=1)
        index = grid_faces(cells + 1, cells + 1)
        faces = np.concatenate([index, index[:, ::-1] + len(front)])
        vertices = np.concatenate([front, back])
        return self.add(vertices, outward(vertices, faces), material, centre=tuple(centre), rotate=rotate, crease=60.0)

    def round_top(self, radius: float, low: float, high: float, material: Material) -> Self:
        """A round table top or seat about the Y axis with softened edges, its grain straight across."""
        angle = np.linspace(0, 2 * np.pi, 44, endpoint=False)
        soft = min(0.008, 0.4 * (high - low))
        rings = [
            np.stack([r * np.cos(angle), np.full(44, y), r * np.sin(angle)], axis=1)
            for r, y in (
                (radius - soft, low),
                (radius - 0.3 * soft, low + 0.3 * soft),
                (radius, low + soft),
                (radius, high - soft),
                (radius - 0.3 * soft, high - 0.3 * soft),
                (radius - soft, high),
            )
        ]
        with self.grained("x"):
            return self.loft(rings, material, crease=60.0)

    def shell(self, surface: ArrayLike, thickness: float, material: Material, *, fit: bool = False) -> Self:
        """Cloth: a grid of points (R, C, 3) given a thickness (half to each side) and closed round its rim.

        The texture runs along the grid at the material's scale; ``fit`` stretches it once over the front.
        """
        mid = np.asarray(surface, dtype=np.float64)
        rows, columns = mid.shape[:2]
        normal = np.cross(np.gradient(mid, axis=1), np.gradient(mid, axis=0))
        normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)
        front, back = mid + normal * thickness / 2, mid - normal * thickness / 2
        across = np.zeros((rows, columns))
        across[:, 1:] = np.cumsum(np.linalg.norm(np.diff(mid, axis=1), axis=2), axis=1)
        down = np.zeros((rows, columns))
        down[1:] = np.cumsum(np.linalg.norm(np.diff(mid, axis=0), axis=2), axis=0)
        span = (float(across.max()), float(down.max())) if fit else (self.tiles.get(material.name, 1.0),) * 2
        chart = np.stack([across / span[0], (down.max() - down) / span[1]], axis=2).reshape(-1, 2)
        index = grid_faces(rows, columns)
        total = rows * columns
        vertices = np.concatenate([front.reshape(-1, 3), back.reshape(-1, 3)])
        order = np.arange(total).reshape(rows, columns)
        rim = np.concatenate([order[0, :-1], order[:-1, -1], order[-1, :0:-1], order[:0:-1, 0]])
        after = np.roll(rim, -1)
        sides = np.concatenate(
            [np.stack([rim, rim + total, after], axis=1), np.stack([after, rim + total, after + total], axis=1)]
        )
        faces = outward(vertices, np.concatenate([index, index[:, ::-1] + total, sides]))
        return self.add(vertices, faces, material, uv=np.concatenate([chart, chart])[faces], crease=60.0)

    def rod(
        self,
        start: Point,
        end: Point,
        radius: float,
        material: Material,
        *,
        end_radius: float | None = None,
        sides: int = 8,
    ) -> Self:
        """A round bar or tapered leg between two points."""
        radii = [radius, radius if end_radius is None else end_radius]
        self.tube(np.array([start, end]), radii, material, segments=sides)
        return self

    def cloth_quad(self, corners: ArrayLike, material: Material, *, fit: bool = True) -> Self:
        """A flat printed face (picture, screen, hob) without an acoustic twin."""
        self.quad(corners, material, fit=fit, acoustic=False)
        return self

    def sound(self, low: Point, high: Point, material: Material) -> Self:
        """Add a box between two corners to the acoustic twin, with the material's acoustic label."""
        lower, upper = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (upper - lower) + lower
        self._sound(corners[BOX_FACES], material)
        return self

    def support(
        self, kind: SupportKind, x: tuple[float, float], z: tuple[float, float], y: float, clearance: float = 0.6
    ) -> Self:
        """Declare a free horizontal rectangle at height ``y``, in modelling coordinates."""
        self._supports.append(
            Support(
                kind,
                "",
                (x[0], y, z[0]),
                (x[1] - x[0], 0.0, 0.0),
                (0.0, 0.0, z[1] - z[0]),
                (0.0, 1.0, 0.0),
                (0.0, 0.0, 1.0),
                clearance,
            )
        )
        return self

    def finish(self, kind: str) -> Furniture:
        """The piece, with its origin moved to the place that its mount requires."""
        mesh = self.build()
        low, high = mesh.bounds.astype(np.float64)
        middle = (low + high) / 2
        origin = {
            "floor": (middle[0], low[1], middle[2]),
            "wall": (middle[0], middle[1], low[2]),
            "ceiling": (middle[0], high[1], middle[2]),
        }[self.mount]
        shift = -np.array(origin)
        mesh = mesh.transformed(np.eye(3), shift)
        moved = tuple(
            replace(
                s, origin=(s.origin[0] + float(shift[0]), s.origin[1] + float(shift[1]), s.origin[2] + float(shift[2]))
            )
            for s in self._supports
        )
        return Furniture(kind, mesh, moved, self.mount)


#: A turn that lays an extrusion flat: its outline (x, y) becomes (x, −z).
LIE_DOWN = rotation("x", -90)
