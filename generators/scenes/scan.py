"""A scanned flat from a file (HM3D, Matterport3D, a phone's scan, any GLB or OBJ) as a `Scene`.

The texture of a scan already holds its light, so its part has none. Rooms are boxes that the manifest gives; what can
carry an object is found by ray casting (generators/scenes/patches.py). Faces whose material's name does not tell how
they sound are parquet on the floor, wood on level tops, and plaster elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError
from generators.assets.meshcheck import SUFFIXES
from generators.assets.meshfile import load_mesh
from generators.assets.modelframe import upright
from generators.scenes.patches import LEVEL, find_supports
from generators.scenes.scene import F32, Licence, Mesh, Part, Room, Scene, Support

#: Largest number of faces the acoustic engine gets: above it, its rays slow down and gain nothing.
ACOUSTIC_FACES = 20_000
DEFAULT_LABEL = "plaster"


def load_scan(
    name: str,
    path: str | Path,
    rooms: Mapping[str, ArrayLike],
    *,
    licence: Licence | None = None,
    up: str = "y",
    front: str = "+z",
) -> Scene:
    """Read a scan.

    Args:
        name: the scan's id.
        path: its file, or a folder below which ``<name>.glb`` (.gltf, .obj, .ply) lies.
        rooms: the box (2, 3) of each room: lowest and highest corner, metres, Y up, after ``up`` and ``front``.
        licence: of the scan; without it, that it comes from ``path`` and its terms are not known.
        up: the file's axis that points up (Matterport3D: ``z``).
        front: the file's axis that becomes +Z.

    Returns:
        One part with instance id 0, without a light map; the rooms; the supports found in each.

    Raises:
        Avs3dError: if the scan is unknown, its file is missing or broken, a box is no box, or holds no floor.
    """
    file = find_scan(name, Path(path))
    if not rooms:
        raise Avs3dError(f"scan {name}: no rooms given; expected the box of at least one room")
    mesh = load_mesh(file, acoustic=DEFAULT_LABEL, twin="surface", max_acoustic_faces=ACOUSTIC_FACES)
    mesh = mesh.transformed(upright(up, front), np.zeros(3))
    supports: list[Support] = []
    found: list[tuple[Room, float]] = []
    for label, box in rooms.items():
        room = _room(f"scan {name}, room {label}", label, box, mesh)
        floor, own = find_supports(_near(mesh.positions, room), room, f"scan {name}, room {label}")
        found.append((room, floor))
        supports += own
    part = Part(name, _labelled(mesh, found), licence=licence or Licence("unknown", "unknown", file.name))
    return Scene(name, (part,), tuple(room for room, _ in found), tuple(supports))


def find_scan(name: str, path: Path) -> Path:
    """The scan's file: ``path`` itself, or the first (by name) ``<name>.<suffix>`` below the folder ``path``.

    Raises:
        Avs3dError: if there is none.
    """
    if path.is_file():
        return path
    if path.is_dir():
        matches = sorted(p for p in path.rglob(f"{name}.*") if p.is_file() and p.suffix.lower() in SUFFIXES)
        if matches:
            return matches[0]
        raise Avs3dError(f"unknown scan {name!r}: no {name}.glb (or .gltf, .obj, .ply) below {path}")
    raise Avs3dError(f"scan {name}: {path} does not exist; expected its mesh file, or a folder that holds it")


def _room(what: str, label: str, box: ArrayLike, mesh: Mesh) -> Room:
    try:
        corners = np.asarray(box, dtype=np.float64)
    except (TypeError, ValueError):
        corners = np.zeros(0)
    if corners.shape != (2, 3) or not np.isfinite(corners).all():
        raise Avs3dError(f"{what}: its box is {box!r}; expected the lowest and highest corner [[x, y, z], [x, y, z]]")
    if (corners[1] - corners[0] < 0.5).any():
        raise Avs3dError(
            f"{what}: its box {corners.tolist()} is thinner than 0.5 m; expected metres, lowest corner first"
        )
    bounds = mesh.bounds
    if (corners[0] >= bounds[1]).any() or (corners[1] <= bounds[0]).any():
        where = np.round(bounds.astype(np.float64), 2).tolist()
        raise Avs3dError(f"{what}: its box {corners.tolist()} lies outside the scan, which spans {where}")
    low, high = ((float(c[0]), float(c[1]), float(c[2])) for c in corners)
    return Room(label, low, high)


def _near(triangles: F32, room: Room, margin: float = 1.0) -> F32:
    """The triangles in and near a room."""
    low = np.asarray(room.low, dtype=np.float32) - margin
    high = np.asarray(room.high, dtype=np.float32) + margin
    keep = ((triangles.min(axis=1) <= high) & (triangles.max(axis=1) >= low)).all(axis=1)
    near: F32 = triangles[keep]
    return near


def _labelled(mesh: Mesh, rooms: list[tuple[Room, float]]) -> Mesh:
    """``mesh`` with its acoustic faces of unknown kind labelled by slope and height above the floor of their room."""
    triangles = mesh.acoustic_positions.astype(np.float64)
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(cross, axis=1)
    level = np.abs(cross[:, 1]) >= LEVEL * np.maximum(length, 1e-20)
    middle = triangles.mean(axis=1)
    labels = np.array(mesh.acoustic_labels, dtype="<U16")
    unknown: NDArray[np.bool_] = (labels == DEFAULT_LABEL) & level
    for room, floor in rooms:
        low, high = np.asarray(room.low)[[0, 2]], np.asarray(room.high)[[0, 2]]
        inside = unknown & ((middle[:, [0, 2]] >= low) & (middle[:, [0, 2]] <= high)).all(axis=1)
        above = middle[:, 1] - floor
        labels[inside & (np.abs(above) <= 0.12)] = "parquet"
        labels[inside & (above > 0.3) & (above < 1.2)] = "wood"
    return replace(mesh, acoustic_labels=tuple(str(label) for label in labels))
