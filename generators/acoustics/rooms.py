"""Rooms for acoustics by itself: a shoebox, a mesh, or the free field, each face with an acoustic material."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError, UsageError, excerpt
from generators.acoustics.materials import material_for, triangle_areas
from generators.acoustics.surface_materials import SurfaceMaterials, nearest_names, surface_materials
from generators.core.scene import Mesh, Part, Scene
from generators.core.scene import Room as RoomBox

if TYPE_CHECKING:
    import trimesh

F64 = NDArray[np.float64]

#: Extent (m) of a mesh below and above which its unit is taken to be no metre, and its most faces.
LEAST_EXTENT, MOST_EXTENT, MOST_FACES = 0.3, 500.0, 2_000_000
#: Least and most length of a shoebox's edges (m).
_LEAST_EDGE, _MOST_EDGE = 0.1, 500.0
#: Corners of the faces of a box, in halves of its edges, counter-clockwise seen from inside; and the faces' names.
_BOX = {
    ("floor",): ((0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0)),
    ("ceiling",): ((0, 1, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1)),
    ("west", "walls"): ((0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)),
    ("east", "walls"): ((1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)),
    ("north", "walls"): ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)),
    ("south", "walls"): ((0, 0, 1), (0, 1, 1), (1, 1, 1), (1, 0, 1)),
}
#: Distance (m) to a wall of a shoebox below which a point is in the wall.
_IN_WALL = 1e-3
#: Extent (m) from which a mesh is asked whether its unit is the metre: few buildings are as long.
_LARGE = 100.0
#: Name of the only room of a room's scene.
_BOX_NAME = "room"


@dataclass(frozen=True)
class MaterialUse:
    """Where one line of the materials was used.

    Attributes:
        pattern: the line's glob.
        material: name of the material, or ``given`` for coefficients.
        absorption: per octave of `OCTAVE_BANDS`, as the engines use it (in situ).
        faces: number of triangles; 0 for a line that matched nothing.
        area: m².
        names: of the meshes, materials or labels that it matched, sorted.

    Examples:
        >>> Room.shoebox((6, 2.7, 4), {"floor": "carpet", "*": "plaster"}).materials_used()[0].area
        24.0
    """

    pattern: str
    material: str
    absorption: tuple[float, ...]
    faces: int
    area: float
    names: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Room:
    """What sound meets: triangles with materials.

    Made by `shoebox`, `from_mesh` and `free_field`.

    Attributes:
        name: for messages.
        triangles: (F, 3, 3) float64, metres, Y up.
        labels: (F,) acoustic label of each triangle.
        uses: see `materials_used`.
        is_shoebox: whether the room is an empty box.
    """

    name: str
    triangles: F64
    labels: tuple[str, ...]
    uses: tuple[MaterialUse, ...] = ()
    is_shoebox: bool = False

    @classmethod
    def shoebox(cls, size: ArrayLike, materials: Any = "plaster") -> Room:
        """A box from (0, 0, 0) to ``size``.

        Args:
            size: (x, y, z) metres; y is the height.
            materials: a name, coefficients, or a dict with ``floor``, ``ceiling``, ``walls``; ``west`` (x = 0),
                ``east``, ``north`` (z = 0) and ``south`` are single walls. See `surface_materials`.

        Raises:
            Avs3dError: if the size is no three lengths, or a material is unknown or missing.

        Examples:
            >>> room = Room.shoebox((6, 2.7, 4), {"walls": "plaster", "floor": "parquet", "ceiling": 0.1})
            >>> round(room.volume, 1)
            64.8
        """
        try:
            edges = np.array(size, dtype=np.float64)
        except (TypeError, ValueError):
            edges = np.zeros(0)
        if edges.shape != (3,) or not ((edges >= _LEAST_EDGE) & (edges <= _MOST_EDGE)).all():
            raise Avs3dError(
                f"shoebox: size is {excerpt(size)}, expected (x, y, z), each {_LEAST_EDGE:g} to {_MOST_EDGE:g} m"
            )
        names, faces = [], []
        for face, corners in _BOX.items():
            a, b, c, d = np.array(corners) * edges
            faces += [(a, b, c), (a, c, d)]
            names += [face, face]
        return _with_materials("shoebox", np.array(faces), names, surface_materials(materials), is_shoebox=True)

    @classmethod
    def from_mesh(
        cls,
        mesh: str | Path | trimesh.Trimesh | trimesh.Scene,
        materials: Any,
        *,
        labels: Sequence[str] | Mapping[str, Sequence[str]] | None = None,
        scale: float = 1.0,
        up: str = "y",
    ) -> Room:
        """A room from a mesh: a file (GLB, glTF, OBJ, PLY, STL, OFF), or one in memory. It may hold many rooms.

        A mesh may have holes (sound that leaves is lost; a source that sees more than a few of them warns) and its
        faces may be turned either way: both sides of a face reflect.

        Args:
            mesh: what `trimesh` can load.
            materials: ``{glob: name or coefficients}``, or a file; see `surface_materials`. The globs are matched with
                the labels of faces, the names of meshes and nodes, and the names of their materials.
            labels: name of each face (semantic labels): a sequence for a single mesh, a dict by mesh for a scene.
                Without it, the face attributes ``label``, ``category``, ``object_id`` and ``semantic`` count.
            scale: metres in a unit of the mesh: 0.001 for millimetres.
            up: ``y``, or ``z`` for a mesh whose Z axis points up.

        Raises:
            Avs3dError: if the file cannot be read, is in another unit or too large, or a face has no material.
        """
        from generators.acoustics.meshes import named_faces

        name, triangles, names = named_faces(mesh, labels, MOST_FACES)
        if up not in ("y", "z"):
            raise UsageError(f"{name}: up is {up!r}, expected 'y' or 'z'")
        if not (math.isfinite(scale) and scale > 0):
            raise UsageError(f"{name}: scale is {scale!r}, expected the metres in a unit of the mesh")
        triangles = triangles * scale
        if up == "z":  # (x, y, z) → (x, z, −y)
            triangles = np.stack([triangles[..., 0], triangles[..., 2], -triangles[..., 1]], axis=-1)
        _check_mesh(name, triangles)
        room = _with_materials(name, triangles, names, surface_materials(materials))
        if isinstance(materials, Mapping):  # a file may be one for many rooms
            _warn_of_unused(room, names)
        return room

    @classmethod
    def free_field(cls) -> Room:
        """No surface at all: direct sound alone."""
        return cls("free field", np.zeros((0, 3, 3)), ())

    def materials_used(self) -> tuple[MaterialUse, ...]:
        """What each line of the materials matched, in the order of the lines; those that matched nothing too.

        Examples:
            >>> room = Room.shoebox((6, 2.7, 4), {"floor": "carpet", "*": "plaster"})
            >>> [use.material for use in room.materials_used()]
            ['carpet', 'plaster']
        """
        return self.uses

    @property
    def bounds(self) -> F64 | None:
        """(2, 3) lowest and highest corner, m; None in the free field."""
        if not len(self.triangles):
            return None
        return np.stack([self.triangles.min(axis=(0, 1)), self.triangles.max(axis=(0, 1))])

    @property
    def volume(self) -> float:
        """m³ of the box that holds it; 0 in the free field."""
        return 0.0 if self.bounds is None else float(np.prod(self.bounds[1] - self.bounds[0]))

    @cached_property
    def scene(self) -> Scene:
        """The scene that the engines open; its only room is called `box_name`."""
        empty = np.zeros((0, 3, 3), dtype=np.float32)
        uv, none = np.zeros((0, 3, 2), dtype=np.float32), np.zeros(0, dtype=np.int32)
        mesh = Mesh(empty, empty, uv, none, (), self.triangles.astype(np.float32), self.labels)
        low, high = (np.zeros(3), np.zeros(3)) if self.bounds is None else self.bounds
        box = RoomBox(_BOX_NAME, _point(low), _point(high), is_whole_mesh=not self.is_shoebox)
        return Scene(self.name, (Part(self.name, mesh),), (box,), ())

    def check_inside(self, what: str, position: ArrayLike) -> None:
        """Refuse a point in a wall or outside of a shoebox; a mesh is looked at by the engines.

        Args:
            what: the word for the point, for the message.
            position: (3,) metres.

        Raises:
            Avs3dError: naming the point and the box.
        """
        if not self.is_shoebox or self.bounds is None:
            return
        point = np.asarray(position, dtype=np.float64)
        if ((point < self.bounds[0] + _IN_WALL) | (point > self.bounds[1] - _IN_WALL)).any():
            size = ", ".join(f"{edge:g}" for edge in self.bounds[1])
            raise Avs3dError(
                f"{self.name}: {what} position {tuple(point.tolist())} lies outside the scene or in a wall; expected a "
                f"point inside the box from (0, 0, 0) to ({size}), {1000 * _IN_WALL:g} mm or more from its walls"
            )

    @property
    def box_name(self) -> str:
        """Name of the only room of `scene`."""
        return _BOX_NAME

    def __repr__(self) -> str:
        size = "" if self.bounds is None else " × ".join(f"{edge:.2f}" for edge in self.bounds[1] - self.bounds[0])
        return f"Room({self.name!r}, {size or 'no walls'}{' m' if size else ''}, {len(self.triangles)} faces)"


def _point(values: F64) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _check_mesh(name: str, triangles: F64) -> None:
    """Refuse what would hang an engine or is no room in metres."""
    if not len(triangles):
        raise Avs3dError(f"{name}: has no faces; expected a triangle mesh")
    bad = int((~np.isfinite(triangles)).any(axis=(1, 2)).sum())
    if bad:
        raise Avs3dError(f"{name}: {bad} of {len(triangles)} faces have corners that are NaN or infinite; repair it")
    extent = np.ptp(triangles.reshape(-1, 3), axis=0)
    if extent.max() > MOST_EXTENT or extent.max() < LEAST_EXTENT:
        size = " × ".join(f"{edge:.4g}" for edge in extent)
        hint = "0.001 for millimetres, 0.01 for centimetres" if extent.max() > MOST_EXTENT else "the metres in its unit"
        raise Avs3dError(
            f"{name}: spans {size} m, expected {LEAST_EXTENT:g} to {MOST_EXTENT:g} m; if its unit is no metre, "
            f"give scale={hint}"
        )
    if extent.max() > _LARGE:
        size = " × ".join(f"{edge:.4g}" for edge in extent)
        warnings.warn(f"{name}: spans {size} m; if its unit is the centimetre, give scale=0.01", stacklevel=3)


def _warn_of_unused(room: Room, names: Sequence[tuple[str, ...]]) -> None:
    """Warn of patterns that match nothing, which are often misspelt."""
    unused = [use.pattern for use in room.uses if not use.faces and use.pattern != "*"]
    if unused:
        known = list(dict.fromkeys(name for kind in names for name in kind))
        shown = ", ".join(map(repr, known[:6])) + (f" and {len(known) - 6} more" if len(known) > 6 else "")
        warnings.warn(
            f"{room.name}: {', '.join(map(repr, unused[:6]))}: no surface has such a name; the names are "
            f"{shown or 'none'}: correct the pattern, or give labels= of faces",
            stacklevel=3,
        )


def _with_materials(
    name: str,
    triangles: F64,
    names: Sequence[tuple[str, ...]],
    materials: SurfaceMaterials,
    *,
    is_shoebox: bool = False,
) -> Room:
    """The room, each face with the material that its names match.

    Raises:
        Avs3dError: if faces match none, with their names and the nearest patterns.
    """
    kinds = list(dict.fromkeys(names))
    found = {kind: materials.match(kind) for kind in kinds}
    unmatched = [kind for kind in kinds if found[kind] is None]
    if unmatched:
        raise Avs3dError(_unmatched(name, unmatched, materials.patterns))
    lines = [found[kind] for kind in names]
    area = triangle_areas(triangles)
    uses = []
    for number, (pattern, label, material) in enumerate(materials.lines):
        mine = np.array([line is not None and line[0] == number for line in lines], dtype=bool)
        matched = sorted({line[1] for line in lines if line is not None and line[0] == number})
        uses.append(
            MaterialUse(
                pattern, material, material_for(label).in_situ, int(mine.sum()), float(area[mine].sum()), tuple(matched)
            )
        )
    labels = tuple(materials.lines[line[0]][1] for line in lines if line is not None)
    return Room(name, np.asarray(triangles, dtype=np.float64), labels, tuple(uses), is_shoebox)


def _unmatched(name: str, kinds: Iterable[tuple[str, ...]], patterns: Sequence[str]) -> str:
    texts = [" / ".join(kind) or "(without a name)" for kind in kinds]
    shown = ", ".join(texts[:4]) + (f" and {len(texts) - 4} more" if len(texts) > 4 else "")
    near = nearest_names(texts[0].split(" / "), patterns)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return (
        f"{name}: no material for {shown}; the patterns are {', '.join(map(repr, patterns[:6]))}{hint} "
        "Add one, or '*' for all others"
    )
