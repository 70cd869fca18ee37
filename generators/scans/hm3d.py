"""HM3D's semantic annotations: a table of objects, and a mesh whose colours say which object is where.

``<id>.semantic.txt`` is headed ``HM3D Semantic Annotations``; each line is ``id,RRGGBB,"category",region``.
``<id>.semantic.glb`` has the scan's own surface, coloured by its texture (or its vertices) with those codes. Regions
have numbers only: their boxes are measured on their objects, and what room they are is left to generators/scenes/rooms.

Reference: K. Yadav et al., "Habitat-Matterport 3D Semantics Dataset", CVPR 2023.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_bytes
from generators.assets.meshfile import open_scene, world_triangles
from generators.core.scene import I32
from generators.scans.annotations import AnnotatedObject, Annotations, Region, boxed, spread_over

Array = NDArray[np.float64]

HEADER = "HM3D Semantic Annotations"
#: What an object is called whose name is empty.
UNKNOWN = "unknown"
#: Distance of the points at which the coloured surface is read, and the most on one face.
SPACING, MOST = 0.07, 400
#: Percentage of a region's surface beyond each side of its box: stray texels, reveals of windows.
STRAY = 1.0
_ELSEWHERE = ("outside", "other room", "outdoor")


def read_hm3d(table: Path, mesh: Path | None, rotation: Array) -> Annotations:
    """Read both files; without the mesh it is not known where the objects are, and no region has a box.

    Raises:
        Avs3dError: if one is broken, or they do not belong together.
    """
    rows = read_table(table)
    if mesh is None:
        objects = tuple(AnnotatedObject(category, region) for _, category, region in rows)
        return Annotations(table, objects, ())
    points, owner = _coloured_points(mesh, [colour for colour, _, _ in rows], rotation)
    if not len(points):
        raise Avs3dError(f"{mesh}: none of its colours stands in {table.name}; do both belong to the same scan?")
    order = np.argsort(owner, kind="stable")
    clouds = np.split(points[order], np.searchsorted(owner[order], np.arange(1, len(rows))))
    objects = tuple(boxed(category, region, cloud) for (_, category, region), cloud in zip(rows, clouds, strict=True))
    return Annotations(table, objects, _regions(objects, points, owner), points.astype(np.float32), owner)


def read_table(path: Path) -> list[tuple[int, str, int]]:
    """Colour (24 bits), category and region of every object.

    Raises:
        Avs3dError: with the line that is none.
    """
    try:
        lines = read_bytes(path).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise Avs3dError(f"{path}: cannot be read ({error}); expected HM3D's table of objects") from error
    if not lines or HEADER not in lines[0]:
        raise Avs3dError(f"{path}: does not start with {HEADER!r}; is it HM3D's .semantic.txt?")
    out = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        try:
            # Line by line, so that an unclosed quote affects one line only.
            _, code, *words, region = next(csv.reader([line], skipinitialspace=True))
            colour = int(code, 16)
            if len(code) != 6 or not words:
                raise ValueError
            category = " ".join(", ".join(words).lower().split()).strip('"')
            out.append((colour, category or UNKNOWN, int(np.int32(int(region)))))
        except (ValueError, OverflowError, csv.Error):
            raise Avs3dError(f'{path}: line {number} is {line!r:.80}; expected id,RRGGBB,"category",region') from None
    if not out:
        raise Avs3dError(f"{path}: has no objects; is it whole?")
    return out


def _coloured_points(mesh: Path, colours: list[int], rotation: Array) -> tuple[Array, I32]:
    """Points of the surface whose colour is one of ``colours`` (each the first of its kind), and which one."""
    codes, first = np.unique(np.array(colours, dtype=np.int64), return_index=True)
    every, owners = [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)]
    images: dict[int, NDArray[np.uint8]] = {}
    for triangles, faces, part in world_triangles(mesh, open_scene(mesh)):
        weight, face, points = spread_over(triangles, SPACING, MOST)
        found = _codes(part, faces, weight, face, images)
        at = np.minimum(np.searchsorted(codes, found), len(codes) - 1)
        known = codes[at] == found
        every.append(points[known] @ rotation.T)
        owners.append(first[at[known]])
    return np.concatenate(every), np.concatenate(owners).astype(np.int32)


def _codes(
    part: Any, faces: NDArray[np.int64], weight: Array, face: NDArray[np.int64], images: dict[int, NDArray[np.uint8]]
) -> NDArray[np.int64]:
    """(P,) the 24-bit colour at points of a part, as in the file; −1 where it has none.

    ``images`` holds the textures met so far: parts share them, and they are decoded once.
    """
    visual = part.visual
    if getattr(visual, "kind", None) == "vertex":
        # The corner nearest to the point: a mixture of two codes would be a third.
        rgb = np.asarray(visual.vertex_colors)[faces[face, np.argmax(weight, axis=1)], :3].astype(np.int64)
    else:
        material = getattr(visual, "material", None)
        image, uv = getattr(material, "baseColorTexture", None), getattr(visual, "uv", None)
        if image is None or uv is None:
            return np.full(len(face), -1, dtype=np.int64)
        if id(image) not in images:
            images[id(image)] = np.asarray(image.convert("RGB"))
        pixels = images[id(image)]
        rows, columns = pixels.shape[:2]
        at = np.einsum("pk,pkc->pc", weight, np.nan_to_num(np.asarray(uv, dtype=np.float64))[faces[face]])
        column = np.floor(at[:, 0] * columns).astype(np.int64) % columns
        row = np.floor((1.0 - at[:, 1]) * rows).astype(np.int64) % rows
        rgb = pixels[row, column].astype(np.int64)
    return np.asarray((rgb[:, 0] << 16) | (rgb[:, 1] << 8) | rgb[:, 2])


def _head(category: str) -> str:
    """The noun of a name: ``floor`` of ``floor /other room``, ``lamp`` of ``floor lamp``."""
    words = category.partition("/")[0].split()
    return words[-1] if words else ""


def _regions(objects: tuple[AnnotatedObject, ...], points: Array, owner: I32) -> tuple[Region, ...]:
    """Each region with the box of its surface: to the sides of all of it, from the floor's height to the ceiling's."""
    region = np.array([item.region for item in objects])[owner]
    is_floor = np.array([_head(item.category) == "floor" for item in objects])[owner]
    is_ceiling = np.array([_head(item.category) == "ceiling" for item in objects])[owner]
    # What is seen through a window or a door is annotated as ``window /outside``, ``floor /other room``.
    own_room = np.array([not any(word in item.category for word in _ELSEWHERE) for item in objects])[owner]
    out = []
    for index in sorted({item.region for item in objects}):
        own = own_room & (region == index)
        if own.sum() < 8:
            continue
        low, high = np.percentile(points[own], [STRAY, 100 - STRAY], axis=0)
        if (own & is_floor).any():
            low[1] = np.median(points[own & is_floor, 1])
        if (own & is_ceiling).any():
            high[1] = max(np.median(points[own & is_ceiling, 1]), low[1])
        out.append(Region(index, "", np.stack([low, high])))
    return tuple(out)
