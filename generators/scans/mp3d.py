"""Matterport3D's annotations: the ``.house`` file and, where it lies beside it, the mesh with an object id per face.

Of the house file's records three matter here: ``R`` (a region with a one-letter label and a box), ``C`` (a category)
and ``O`` (an object with its region, category and oriented box). Z is up.

Reference: A. Chang et al., "Matterport3D: Learning from RGB-D Data in Indoor Environments", 3DV 2017; format:
github.com/niessner/Matterport, data_organization.md.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_bytes
from generators.scans.annotations import AnnotatedObject, Annotations, Region

Array = NDArray[np.float64]

#: Fields of the records that are read (those that follow are padding).
_FIELDS = {"R": 15, "C": 6, "O": 16}
#: Names of the face property that holds the object: in the files made for Habitat, and in the original ones.
_OBJECT_IDS = ("object_id", "face_segment", "segment_id")


def read_mp3d(house: Path, mesh: Path | None, rotation: Array) -> Annotations:
    """Read the house file, and the mesh where there is one.

    Raises:
        Avs3dError: if one is broken.
    """
    regions, objects, number_of = _read_house(house)
    turned = tuple(item.turned(rotation) for item in objects)
    boxes = []
    for region in regions:
        corners = region.box @ rotation.T
        boxes.append(Region(region.index, region.label, np.stack([corners.min(axis=0), corners.max(axis=0)])))
    if mesh is None:
        return Annotations(house, turned, tuple(boxes))
    points, ids = _face_objects(mesh)
    owner = np.array([number_of.get(int(value), -1) for value in ids], dtype=np.int32)
    known = owner >= 0
    return Annotations(house, turned, tuple(boxes), (points[known] @ rotation.T).astype(np.float32), owner[known])


def _read_house(path: Path) -> tuple[list[Region], list[AnnotatedObject], dict[int, int]]:
    """Regions and objects in the file's axes, and object index in the file → place in the list."""
    lines = read_bytes(path).decode("utf-8-sig", errors="replace").splitlines()
    if not lines or not lines[0].startswith("ASCII"):
        raise Avs3dError(f"{path}: does not start with 'ASCII'; is it a house file of Matterport3D?")
    regions: list[Region] = []
    categories: dict[int, tuple[str, str]] = {}
    found: list[tuple[int, int, int, list[float]]] = []
    for number, line in enumerate(lines[1:], start=2):
        word, *rest = line.split() or [""]
        if word not in _FIELDS:
            continue
        try:
            if len(rest) < _FIELDS[word] - 1:
                raise ValueError("fields are missing")
            if word == "R":
                box = np.array([float(v) for v in rest[8:14]]).reshape(2, 3)
                regions.append(Region(int(rest[0]), rest[4], box))
            elif word == "C":
                categories[int(rest[0])] = (_plain(rest[2]), _plain(rest[4]))
            else:
                found.append((int(rest[0]), int(rest[1]), int(rest[2]), [float(v) for v in rest[3:15]]))
        except ValueError as error:
            raise Avs3dError(
                f"{path}: line {number} ({line:.60}) is no record {word} ({error}); is it whole?"
            ) from None
    if not regions and not found:
        raise Avs3dError(f"{path}: has neither regions nor objects; is it whole?")
    objects: list[AnnotatedObject] = []
    number_of: dict[int, int] = {}
    for index, region, category, values in found:
        name, group = categories.get(category, ("unknown", ""))
        first, second = np.array(values[3:6]), np.array(values[6:9])
        axes = np.stack([first, second, np.cross(first, second)])
        number_of[index] = len(objects)
        objects.append(AnnotatedObject(name, region, group, np.array(values[:3]), axes, np.array(values[9:12])))
    return regions, objects, number_of


def _plain(name: str) -> str:
    return name.replace("#", " ").replace("_", " ").strip().lower()


def _face_objects(mesh: Path) -> tuple[Array, NDArray[np.int64]]:
    """Middle (F, 3) and object id (F,) of the faces of a semantic PLY; nothing where it has no ids."""
    try:
        loaded: Any = trimesh.load(mesh, process=False, force="mesh")
        faces = loaded.metadata["_ply_raw"]["face"]["data"]
        vertices = np.asarray(loaded.vertices, dtype=np.float64)
    except Exception as error:  # every reader has its own
        reason = " ".join(str(error).split()) or type(error).__name__
        raise Avs3dError(f"{mesh}: cannot be read as ply ({reason}); is it whole?") from error
    names = faces.dtype.names if isinstance(faces, np.ndarray) else tuple(faces)
    name = next((name for name in _OBJECT_IDS if name in (names or ())), None)
    if name is None or len(loaded.faces) != len(faces[name]):
        return np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    return vertices[loaded.faces].mean(axis=1), np.asarray(faces[name]).reshape(-1).astype(np.int64)
