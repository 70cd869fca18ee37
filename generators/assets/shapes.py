"""Solid primitives with normals, metric texture coordinates and an acoustic twin, from which all models are built.

Every primitive is added to a `MeshBuilder`, in metres, Y up. Texture coordinates are metres divided by the material's
``tile`` (metres per repeat), projected along the dominant axis of each face, unless a primitive defines others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from generators.assets.forms import cap_faces, outward, skin_faces, slab_loops
from generators.core.arrays import cross, distinct_rows
from generators.core.boxes import axis_rotation
from generators.core.scene import F32, Material, Mesh

Array = NDArray[np.float64]

#: Which ends of a loft are closed.
Caps = Literal["both", "first", "none"]
#: Details smaller than this in every direction are left out of the acoustic twin (340 m/s / 0.1 m = 3.4 kHz).
ACOUSTIC_DETAIL = 0.1
_CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
#: Two triangles per face of a box whose corners are in binary order (x, y, z), counter-clockwise from outside.
BOX_FACES = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
)


def rotation(axis: str, degrees: float | Array) -> Array:
    """(…, 3, 3) right-handed rotations about ``"x"``, ``"y"`` or ``"z"`` by ``degrees`` (…)."""
    return axis_rotation(axis, np.radians(degrees))


def corner_normals(triangles: Array, crease: float = 40.0) -> Array:
    """Shading normals (F, 3, 3): faces that meet at less than ``crease`` degrees are smoothed together."""
    area = cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(area, axis=1, keepdims=True)
    face = area / np.where(length > 0, length, 1.0)
    keys = np.round(triangles.reshape(-1, 3) * 1e5).astype(np.int64)
    inverse = distinct_rows(keys)[1]
    order = np.argsort(inverse, kind="stable")
    number = np.bincount(inverse)
    starts = np.cumsum(number) - number
    limit = np.cos(np.radians(crease))
    out = np.repeat(face, 3, axis=0)
    owner = np.repeat(np.arange(len(triangles)), 3)
    # All vertices together in which equally many corners meet.
    for count in np.unique(number[number > 1]).tolist():
        corners = order[starts[number == count, None] + np.arange(count)]
        faces = owner[corners]
        near = face[faces] @ face[faces].swapaxes(1, 2) >= limit - 1e-6
        out[corners] = near.astype(float) @ area[faces]
    norm = np.linalg.norm(out, axis=1, keepdims=True)
    flat = np.repeat(face, 3, axis=0)
    out = np.where(norm > 1e-12, out / np.where(norm > 0, norm, 1.0), flat)
    out[np.linalg.norm(out, axis=1) == 0] = (0.0, 1.0, 0.0)
    return out.reshape(-1, 3, 3)


def box_uv(triangles: Array, tile: float) -> Array:
    """(F, 3, 2) coordinates in repeats of ``tile`` metres, projected along each face's dominant axis."""
    across = cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    axis = np.argmax(np.abs(across), axis=1)
    columns = np.array([[2, 1], [0, 2], [0, 1]])[axis]
    return np.take_along_axis(triangles, columns[:, None, :].repeat(3, axis=1), axis=2) / tile


class MeshBuilder:
    """Collects primitives and builds one `Mesh`.

    ``tiles`` maps a material's name to metres per repeat of its texture (1 for names not in it).
    """

    def __init__(self, tiles: dict[str, float] | None = None) -> None:
        self.tiles = tiles or {}
        self._materials: list[Material] = []
        self._positions: list[Array] = []
        self._normals: list[Array] = []
        self._uv: list[Array] = []
        self._face_material: list[NDArray[np.int32]] = []
        self._acoustic: list[Array] = []
        self._labels: list[str] = []

    def _index(self, material: Material) -> int:
        for index, known in enumerate(self._materials):
            if known is material:
                return index
        self._materials.append(material)
        return len(self._materials) - 1

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
        """Add any triangle mesh.

        Args:
            vertices: (V, 3).
            faces: (F, 3) indices, counter-clockwise from outside.
            material: the material of all its faces.
            centre: added after the rotation.
            rotate: (3, 3) rotation.
            uv: (F, 3, 2) coordinates in repeats; default: box projection.
            normals: (F, 3, 3); default: smoothed at edges below ``crease`` degrees.
            crease: see `corner_normals`.
            acoustic: geometry for sound: True: its bounding box, or nothing for a small detail; "exact": its own faces;
                False: nothing.
        """
        local = np.asarray(vertices, dtype=np.float64)
        index = np.asarray(faces, dtype=np.int64)
        turn = np.eye(3) if rotate is None else np.asarray(rotate, dtype=np.float64)
        shift = np.asarray(centre, dtype=np.float64)
        triangles = local[index]
        across = cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        keep = np.linalg.norm(across, axis=1) > 1e-12
        triangles = triangles[keep]
        uv = box_uv(triangles, self.tiles.get(material.name, 1.0)) if uv is None else np.asarray(uv)[keep]
        normals = corner_normals(triangles, crease) if normals is None else np.asarray(normals)[keep]
        self._positions.append(triangles @ turn.T + shift)
        self._normals.append(normals @ turn.T)
        self._uv.append(uv)
        self._face_material.append(np.full(len(triangles), self._index(material), dtype=np.int32))
        if acoustic == "exact":
            self._sound(triangles @ turn.T + shift, material)
        elif acoustic:
            low, high = local.min(axis=0), local.max(axis=0)
            if (high - low).max() >= ACOUSTIC_DETAIL:
                corners = _CUBE * (high - low) + (low + high) / 2
                self._sound((corners @ turn.T + shift)[BOX_FACES], material)
        return self

    def _sound(self, triangles: Array, material: Material) -> None:
        self._acoustic.append(triangles)
        self._labels.extend([material.acoustic] * len(triangles))

    def box(
        self,
        size: Sequence[float],
        centre: Sequence[float] | Array,
        material: Material,
        *,
        bevel: float = 0.0,
        segments: int = 2,
        rotate: Array | None = None,
        acoustic: bool | str = True,
    ) -> Self:
        """An axis-aligned box (``size`` = x, y, z extents) about ``centre``, its edges rounded by ``bevel`` metres."""
        extents = np.asarray(size, dtype=np.float64)
        radius = min(bevel, 0.49 * float(extents.min()))
        if radius <= 0:
            return self.add(_CUBE * extents, BOX_FACES, material, centre=centre, rotate=rotate, acoustic=acoustic)
        # A cube whose faces are split near the edges; the rim is moved onto a sphere around the inner corner.
        ring = np.sin(np.linspace(-np.pi / 2, 0, segments + 1))
        steps = np.concatenate([ring, -ring[::-1]])
        vertices: list[Array] = []
        faces: list[list[int]] = []
        normals: list[Array] = []
        count = len(steps)
        inner = extents / 2 - radius
        for axis in range(3):
            a, b = (axis + 1) % 3, (axis + 2) % 3
            for sign in (-1.0, 1.0):
                grid = np.zeros((count, count, 3))
                sides = np.sign(np.arange(count) - (count - 1) / 2)
                tangent = np.tan(np.arcsin(np.clip(steps, -1, 1)) / 2)
                grid[..., a] = tangent[:, None]
                grid[..., b] = tangent[None, :]
                grid[..., axis] = sign
                grid /= np.linalg.norm(grid, axis=2, keepdims=True)
                base = np.zeros_like(grid)
                base[..., a] = sides[:, None] * inner[a]
                base[..., b] = sides[None, :] * inner[b]
                base[..., axis] = sign * inner[axis]
                start = len(vertices) * count * count
                vertices.append((base + radius * grid).reshape(-1, 3))
                normals.append(grid.reshape(-1, 3))
                for i in range(count - 1):
                    for j in range(count - 1):
                        p, q, r, s = (
                            start + x * count + y for x, y in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))
                        )
                        quad = [[p, q, r], [p, r, s]] if sign > 0 else [[p, r, q], [p, s, r]]
                        faces.extend(quad)
        every, index = np.concatenate(vertices), np.array(faces)
        return self.add(
            every,
            index,
            material,
            centre=centre,
            rotate=rotate,
            normals=np.concatenate(normals)[index],
            acoustic=acoustic,
        )

    def lathe(
        self,
        profile: ArrayLike,
        material: Material,
        *,
        centre: Sequence[float] | Array = (0.0, 0.0, 0.0),
        segments: int = 40,
        rotate: Array | None = None,
        scale: Sequence[float] = (1.0, 1.0, 1.0),
        crease: float = 40.0,
        acoustic: bool | str = True,
    ) -> Self:
        """Revolve ``profile`` (N, 2: radius, height; from bottom to top seen from outside) about Y.

        ``scale`` stretches the result, so that an ellipse is a lathe with scale (a, 1, b).
        """
        line = np.asarray(profile, dtype=np.float64)
        angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
        x = line[:, 0, None] * np.sin(angle)
        z = line[:, 0, None] * np.cos(angle)
        y = np.repeat(line[:, 1, None], segments, axis=1)
        vertices = np.stack([x, y, z], axis=2).reshape(-1, 3) * np.asarray(scale)
        faces = skin_faces(len(line), segments)
        i, j = np.meshgrid(np.arange(len(line) - 1), np.arange(segments), indexing="ij")
        around = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        tile = self.tiles.get(material.name, 1.0)
        width = 2 * np.pi * max(float(line[:, 0].max()), 1e-3) / tile
        corner_u = np.stack([j, j + 1, j + 1, j], axis=2) / segments * width
        corner_v = around[np.stack([i, i, i + 1, i + 1], axis=2)] / tile
        corner = np.stack([corner_u, corner_v], axis=3)
        uv = np.concatenate([corner[:, :, [0, 1, 2]], corner[:, :, [0, 2, 3]]]).reshape(-1, 3, 2)
        return self.add(
            vertices, faces, material, centre=centre, rotate=rotate, uv=uv, crease=crease, acoustic=acoustic
        )

    def cylinder(
        self,
        radius: float,
        height: float,
        centre: Sequence[float] | Array,
        material: Material,
        *,
        axis: str = "y",
        segments: int = 32,
        bevel: float = 0.0,
        top_radius: float | None = None,
        acoustic: bool | str = True,
    ) -> Self:
        """A closed cylinder (a cone frustum with ``top_radius``) about ``centre`` along ``axis``."""
        top = radius if top_radius is None else top_radius
        b = min(bevel, 0.45 * height, 0.9 * max(radius, 1e-6), 0.9 * max(top, 1e-6))
        h = height / 2
        if b > 0:
            arc = np.linspace(0, np.pi / 2, 4)
            lower = [(radius - b + b * np.sin(t), -h + b - b * np.cos(t)) for t in arc]
            upper = [(top - b + b * np.cos(t), h - b + b * np.sin(t)) for t in arc]
            profile = [(0.0, -h), *lower, *upper, (0.0, h)]
        else:
            profile = [(0.0, -h), (radius, -h), (top, h), (0.0, h)]
        turn = {"y": None, "x": rotation("z", -90), "z": rotation("x", 90)}[axis]
        return self.lathe(profile, material, centre=centre, segments=segments, rotate=turn, acoustic=acoustic)

    def sphere(
        self,
        radius: float | Sequence[float],
        centre: Sequence[float] | Array,
        material: Material,
        *,
        rings: int = 16,
        segments: int = 32,
        rotate: Array | None = None,
        acoustic: bool | str = True,
    ) -> Self:
        """A sphere, or an ellipsoid with three radii."""
        radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), 3)
        t = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
        profile = np.stack([np.cos(t), np.sin(t)], axis=1)
        profile[[0, -1], 0] = 0.0
        return self.lathe(
            profile, material, centre=centre, segments=segments, scale=tuple(radii), rotate=rotate, acoustic=acoustic
        )

    def tube(
        self,
        path: ArrayLike,
        radius: float | ArrayLike,
        material: Material,
        *,
        segments: int = 12,
        closed: bool = False,
        acoustic: bool | str = False,
    ) -> Self:
        """A round tube along ``path`` (N, 3), with one radius or one per point; its ends are capped unless closed."""
        line = np.asarray(path, dtype=np.float64)
        count = len(line)
        radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), count)
        ahead = np.roll(line, -1, axis=0) - line
        behind = line - np.roll(line, 1, axis=0)
        if not closed:
            ahead[-1], behind[0] = behind[-1], ahead[0]
        tangent = ahead / np.linalg.norm(ahead, axis=1, keepdims=True) + behind / np.linalg.norm(
            behind, axis=1, keepdims=True
        )
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        # Parallel transport keeps the cross-section from twisting.
        first = np.cross(tangent[0], [0.0, 1.0, 0.0] if abs(tangent[0, 1]) < 0.9 else [1.0, 0.0, 0.0])
        sides = [first / np.linalg.norm(first)]
        for k in range(1, count):
            side = sides[-1] - tangent[k] * (sides[-1] @ tangent[k])
            sides.append(side / np.linalg.norm(side))
        u = np.array(sides)
        v = np.cross(tangent, u)
        angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
        ring = u[:, None] * np.cos(angle)[None, :, None] + v[:, None] * np.sin(angle)[None, :, None]
        vertices = (line[:, None] + radii[:, None, None] * ring).reshape(-1, 3)
        faces = skin_faces(count, segments, closed=closed)
        if not closed:
            vertices = np.concatenate([vertices, line[[0]], line[[-1]]])
            faces = np.concatenate([faces, *cap_faces(count, segments)])
        return self.add(vertices, faces, material, acoustic=acoustic, crease=50.0)

    def torus(
        self,
        major: float,
        minor: float,
        centre: Sequence[float] | Array,
        material: Material,
        *,
        axis: str = "y",
        segments: int = 40,
        minor_segments: int = 12,
        acoustic: bool | str = False,
    ) -> Self:
        """A torus about ``centre``, with its hole along ``axis``."""
        t = np.linspace(0, 2 * np.pi, segments, endpoint=False)
        flat = np.stack([major * np.cos(t), np.zeros_like(t), major * np.sin(t)], axis=1)
        turn = {"y": np.eye(3), "x": rotation("z", 90), "z": rotation("x", 90)}[axis]
        path = flat @ turn.T + np.asarray(centre)
        return self.tube(path, minor, material, segments=minor_segments, closed=True, acoustic=acoustic)

    def loft(
        self,
        loops: ArrayLike,
        material: Material,
        *,
        caps: Caps = "both",
        centre: Sequence[float] | Array = (0.0, 0.0, 0.0),
        rotate: Array | None = None,
        crease: float = 40.0,
        acoustic: bool | str = True,
    ) -> Self:
        """Add the skin over a stack of closed loops. A hollow vessel goes up its outside, over the rim and down inside.

        Args:
            loops: (L, N, 3); loop k's point j is joined to loop k+1's point j. Unless both ends are closed, the loops
                run counter-clockwise seen from the end of the stack, so that the skin faces outwards.
            material: of all faces.
            caps: ends to close, with a fan around the mean of the loop (the loop must be star-shaped about it).
            centre: added after the rotation.
            rotate: (3, 3).
            crease: smoothing angle, degrees.
            acoustic: see `add`.
        """
        stack = np.asarray(loops, dtype=np.float64)
        count, points, _ = stack.shape
        first, last = cap_faces(count, points)
        faces = np.concatenate(
            [skin_faces(count, points), *([] if caps == "none" else [first]), *([last] if caps == "both" else [])]
        )
        vertices = np.concatenate([stack.reshape(-1, 3), stack[0].mean(axis=0)[None], stack[-1].mean(axis=0)[None]])
        if caps == "both":
            faces = outward(vertices, faces)
        return self.add(vertices, faces, material, centre=centre, rotate=rotate, crease=crease, acoustic=acoustic)

    def slab(
        self,
        size: Sequence[float],
        centre: Sequence[float] | Array,
        material: Material,
        *,
        corner: float = 0.02,
        bevel: float = 0.004,
        steps: int = 5,
        rotate: Array | None = None,
        acoustic: bool | str = False,
    ) -> Self:
        """A plate of ``size`` (x, y, z) about ``centre``: corners rounded in x–y, the edge of its +Z face bevelled."""
        loops = slab_loops(size, corner=corner, bevel=bevel, steps=steps)
        return self.loft(loops, material, centre=centre, rotate=rotate, acoustic=acoustic)

    def extrude(
        self,
        outline: ArrayLike,
        depth: float,
        material: Material,
        *,
        holes: Sequence[ArrayLike] = (),
        centre: Sequence[float] | Array = (0.0, 0.0, 0.0),
        rotate: Array | None = None,
        acoustic: bool | str = True,
    ) -> Self:
        """Extrude a polygon (N, 2: x, y) by ``depth`` along +Z from z = 0; ``holes`` are polygons cut out of it."""
        import trimesh
        from shapely.geometry import Polygon

        solid = trimesh.creation.extrude_polygon(Polygon(np.asarray(outline), [np.asarray(h) for h in holes]), depth)
        return self.add(
            solid.vertices, solid.faces, material, centre=centre, rotate=rotate, crease=30.0, acoustic=acoustic
        )

    def quad(
        self,
        corners: ArrayLike,
        material: Material,
        *,
        fit: bool = False,
        subdivide: float | None = None,
        acoustic: bool | str = "exact",
    ) -> Self:
        """A rectangle: ``corners`` (4, 3) counter-clockwise from its lower left, seen from its front.

        ``fit`` stretches the texture over it once (a dial, a display, a picture); else it repeats every ``tile``
        metres from the lower left corner. ``subdivide``: split into cells of at most that many metres.
        """
        p = np.asarray(corners, dtype=np.float64)
        width, height = np.linalg.norm(p[1] - p[0]), np.linalg.norm(p[3] - p[0])
        nu = nv = 1
        if subdivide:
            nu, nv = max(1, int(np.ceil(width / subdivide))), max(1, int(np.ceil(height / subdivide)))
        s, t = np.meshgrid(np.linspace(0, 1, nu + 1), np.linspace(0, 1, nv + 1), indexing="ij")
        s, t = s.reshape(-1, 1), t.reshape(-1, 1)
        vertices = p[0] * (1 - s) * (1 - t) + p[1] * s * (1 - t) + p[2] * s * t + p[3] * (1 - s) * t
        i, j = (k.reshape(-1) for k in np.meshgrid(np.arange(nu), np.arange(nv), indexing="ij"))
        a, b, c, d = i * (nv + 1) + j, (i + 1) * (nv + 1) + j, (i + 1) * (nv + 1) + j + 1, i * (nv + 1) + j + 1
        faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
        tile = 1.0 if fit else self.tiles.get(material.name, 1.0)
        span = np.array([1.0, 1.0]) if fit else np.array([width, height]) / tile
        uv = (np.concatenate([s, t], axis=1) * span)[faces]
        return self.add(vertices, faces, material, uv=uv, acoustic=acoustic)

    def disc(
        self,
        radius: float,
        centre: Sequence[float] | Array,
        normal: str,
        material: Material,
        *,
        segments: int = 48,
        fit: bool = True,
    ) -> Self:
        """A flat disc facing ``normal`` ("x", "y" or "z"); it is inscribed in the texture's unit square."""
        angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
        flat = np.concatenate([[[0.0, 0.0]], np.stack([np.cos(angle), np.sin(angle)], axis=1)])
        ring = np.arange(segments)
        faces = np.stack([np.zeros(segments, dtype=int), 1 + ring, 1 + (ring + 1) % segments], axis=1)
        vertices = np.concatenate([flat * radius, np.zeros((segments + 1, 1))], axis=1)
        turn = {"z": None, "x": rotation("y", 90), "y": rotation("x", -90)}[normal]
        scale = 1.0 if fit else 2 * radius / self.tiles.get(material.name, 1.0)
        uv = ((flat + 1) / 2 * scale)[faces]
        return self.add(vertices, faces, material, centre=centre, rotate=turn, uv=uv, acoustic=False)

    def merge(
        self, mesh: Mesh, *, centre: Sequence[float] | Array = (0.0, 0.0, 0.0), rotate: Array | None = None
    ) -> Self:
        """Add a finished mesh, rotated and moved."""
        moved = mesh.transformed(np.eye(3) if rotate is None else rotate, np.asarray(centre, dtype=np.float64))
        remap = np.array([self._index(m) for m in mesh.materials], dtype=np.int32)
        self._positions.append(moved.positions.astype(np.float64))
        self._normals.append(moved.normals.astype(np.float64))
        self._uv.append(moved.uv.astype(np.float64))
        self._face_material.append(remap[moved.face_material])
        if len(moved.acoustic_positions):
            self._acoustic.append(moved.acoustic_positions.astype(np.float64))
            self._labels.extend(moved.acoustic_labels)
        return self

    def build(self) -> Mesh:
        """The mesh of all added parts."""

        def joined(arrays: list[Array], empty: tuple[int, ...]) -> F32:
            return np.concatenate(arrays).astype(np.float32) if arrays else np.zeros(empty, dtype=np.float32)

        mesh = Mesh(
            positions=joined(self._positions, (0, 3, 3)),
            normals=joined(self._normals, (0, 3, 3)),
            uv=joined(self._uv, (0, 3, 2)),
            face_material=np.concatenate(self._face_material) if self._face_material else np.zeros(0, dtype=np.int32),
            materials=tuple(self._materials),
            acoustic_positions=joined(self._acoustic, (0, 3, 3)),
            acoustic_labels=tuple(self._labels),
        )
        mesh.check("mesh builder")
        return mesh


def built(build: Callable[[MeshBuilder], object], tiles: dict[str, float] | None = None) -> Mesh:
    """Run ``build`` on a fresh builder and return its mesh."""
    builder = MeshBuilder(tiles)
    build(builder)
    return builder.build()
