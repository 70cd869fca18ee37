"""Meshes of users as named triangles; all of trimesh that acoustics needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError, UsageError, did_you_mean
from avs3d_bench.runtime.imports import needing

#: Attributes of faces that name them, as exporters call them.
_FACE_NAMES = ("label", "labels", "category", "category_id", "object_id", "semantic", "segment")
#: Formats that trimesh reads without other packages.
_FORMATS = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")

Names = tuple[str, ...]


def named_faces(
    mesh: Any, labels: Sequence[str] | Mapping[str, Sequence[str]] | None, most: int
) -> tuple[str, NDArray[np.float64], list[Names]]:
    """The name of a mesh, its triangles (F, 3, 3) in the mesh's unit, and the names of each: label, mesh, material.

    Raises:
        Avs3dError: if a file cannot be read, there are more than ``most`` faces, or labels do not fit them.
    """
    with needing("Room.from_mesh", "pip install 'avs3d-bench[acoustics]'"):
        import trimesh
    title = "mesh"
    if isinstance(mesh, str | Path):
        path = Path(mesh)
        title, mesh = path.name, _load(path)
    if isinstance(mesh, trimesh.Trimesh):
        named: dict[str, Any] = {Path(title).stem: mesh}
        mesh = trimesh.Scene(named)
    if not isinstance(mesh, trimesh.Scene):
        raise UsageError(f"Room.from_mesh: got {type(mesh).__name__}, expected a path, a trimesh.Trimesh or Scene")
    if isinstance(labels, Mapping):
        unknown = next((name for name in labels if name not in mesh.geometry), None)
        if unknown is not None:
            raise UsageError(f"{title}: labels of {unknown!r}, which is no mesh{did_you_mean(unknown, mesh.geometry)}")
    nodes = [(str(node), *mesh.graph[node]) for node in sorted(mesh.graph.nodes_geometry)]
    count = sum(len(getattr(mesh.geometry[key], "faces", ())) for _, _, key in nodes)
    if count > most:
        raise Avs3dError(
            f"{title}: {count:,} faces, expected at most {most:,}; simplify it first, for example with trimesh's "
            "simplify_quadric_decimation(face_count=100_000): sound does not see small detail"
        )
    triangles: list[NDArray[np.float64]] = []
    names: list[Names] = []
    for node, transform, key in nodes:
        part = mesh.geometry[key]
        if not isinstance(part, trimesh.Trimesh):
            continue
        corners = np.asarray(part.vertices, dtype=np.float64)[np.asarray(part.faces)]
        triangles.append(corners @ np.asarray(transform)[:3, :3].T + np.asarray(transform)[:3, 3])
        names += _names(part, (str(key), node), _labels_of(part, str(key), labels, title))
    return title, np.concatenate(triangles) if triangles else np.zeros((0, 3, 3)), names


def _load(path: Path) -> Any:
    import trimesh

    if path.suffix.lower() not in _FORMATS:
        raise Avs3dError(f"{path}: unknown format; expected a mesh in {', '.join(_FORMATS)}")
    if not path.is_file():
        raise Avs3dError(f"{path}: no such file; expected a mesh ({', '.join(_FORMATS)})")
    options: dict[str, Any] = {"split_object": True} if path.suffix.lower() == ".obj" else {}
    try:
        return trimesh.load(path, force="scene", process=False, **options)
    except Exception as error:  # the readers of trimesh raise whatever their parsers do
        reason = " ".join(str(error).split()) or type(error).__name__
        raise Avs3dError(f"{path}: cannot be read as a mesh ({reason:.120}); export it again") from error


def _labels_of(
    part: Any, key: str, labels: Sequence[str] | Mapping[str, Sequence[str]] | None, title: str
) -> Sequence[str] | None:
    """One label per face, if there are any."""
    found: Any = labels.get(key) if isinstance(labels, Mapping) else labels
    if found is None:
        raw = (part.metadata or {}).get("_ply_raw", {}).get("face", {}).get("data", {})
        columns = {**(raw if isinstance(raw, Mapping) else {}), **dict(part.face_attributes)}
        found = next((columns[name] for name in _FACE_NAMES if name in columns), None)
        found = None if found is None else [str(value) for value in np.ravel(np.asarray(found))]
        if found is not None and len(found) != len(part.faces):
            return None
    if found is not None and len(found) != len(part.faces):
        raise UsageError(f"{title}: {len(found)} labels for the {len(part.faces)} faces of {key!r}")
    return None if found is None else [str(value) for value in found]


def _names(part: Any, mesh_names: Names, labels: Sequence[str] | None) -> list[Names]:
    material = getattr(getattr(part.visual, "material", None), "name", None)
    of_mesh = tuple(dict.fromkeys(name for name in (*mesh_names, material) if name))
    if labels is None:
        return [of_mesh] * len(part.faces)
    return [(label, *of_mesh) for label in labels]
