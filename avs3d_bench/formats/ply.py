"""PLY meshes and point clouds (Turk 1994), numpy only.

Written: binary little endian, vertices ``float x y z`` (with ``uchar red green blue`` where there are colours) and
triangles, or tables of any columns (`write_tables`). Read: any PLY of triangles or points, ASCII or binary of either
byte order; further properties are skipped. Own code, because the core install must stay small and the usual library is
under the GPL.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import write_bytes
from avs3d_bench.formats.ply_reader import RGB, element_named, index_property, read_tables


@dataclass(frozen=True, eq=False)
class Ply:
    """A mesh or a point cloud.

    Attributes:
        vertices: (V, 3) float32.
        faces: (F, 3) int32; F = 0 for a point cloud.
        colours: (V, 3) uint8, or None.
        instances: (V,) int32 id of the instance that each vertex is of (property ``instance``), or None.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    colours: NDArray[np.uint8] | None = None
    instances: NDArray[np.int32] | None = None


#: Property of a vertex: id of the instance that it is of.
INSTANCE = "instance"
#: Types that are written: numpy's → the header's.
_WRITTEN = {"<f4": "float", "|u1": "uchar", "<i4": "int"}


def write_tables(path: str | Path, tables: Mapping[str, NDArray[np.void]]) -> None:
    """Write elements as they are, binary little endian, atomically.

    Args:
        path: the file.
        tables: name of the element → its rows, of fields ``<f4``, ``u1`` and ``<i4``; a list of three is a pair of
            fields ``#name`` (``u1``) and ``name``, as `avs3d_bench.formats.ply_reader.read_tables` gives it.

    Raises:
        Avs3dError: if the system refuses.
    """
    write_bytes(path, encode_tables(tables))


def encode_tables(tables: Mapping[str, NDArray[np.void]]) -> bytes:
    """The file that `write_tables` writes."""
    header, body = ["ply", "format binary_little_endian 1.0"], b""
    for element, table in tables.items():
        header.append(f"element {element} {len(table)}")
        kinds = {name: table.dtype[name].base.str for name in table.dtype.names or ()}
        for name, kind in kinds.items():
            if f"#{name}" in kinds:
                header.append(f"property list {_WRITTEN[kinds[f'#{name}']]} {_WRITTEN[kind]} {name}")
            elif not name.startswith("#"):
                header.append(f"property {_WRITTEN[kind]} {name}")
        body += table.tobytes()
    return ("\n".join([*header, "end_header"]) + "\n").encode() + body


def _encode(
    path: str | Path,
    points: ArrayLike,
    faces: ArrayLike | None,
    colours: ArrayLike | None,
    instances: ArrayLike | None = None,
) -> bytes:
    vertices = np.asarray(points, dtype=np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise Avs3dError(f"{path}: vertices have shape {vertices.shape}, expected (V, 3)")
    if not np.isfinite(vertices).all():
        raise Avs3dError(f"{path}: vertices hold NaN or infinite numbers; repair the mesh")
    columns = dict(zip("xyz", vertices.T, strict=True))
    fields = [(axis, "<f4") for axis in "xyz"]
    if colours is not None:
        rgb = np.asarray(colours)
        if rgb.shape != vertices.shape or rgb.dtype != np.uint8:
            raise Avs3dError(f"{path}: colours are {rgb.dtype} {rgb.shape}, expected uint8 {vertices.shape}")
        columns |= dict(zip(RGB, rgb.T, strict=True))
        fields += [(name, "u1") for name in RGB]
    if instances is not None:
        columns[INSTANCE] = np.broadcast_to(instances, len(vertices))
        fields.append((INSTANCE, "<i4"))
    table = np.empty(len(vertices), dtype=fields)
    for name, column in columns.items():
        table[name] = column
    tables: dict[str, NDArray[np.void]] = {"vertex": table}
    if faces is not None:
        index = np.asarray(faces)
        if index.ndim != 2 or index.shape[1] != 3 or not np.issubdtype(index.dtype, np.integer):
            raise Avs3dError(f"{path}: faces are {index.dtype} {index.shape}, expected integers (F, 3)")
        if index.size and (index.min() < 0 or index.max() >= len(vertices)):
            raise Avs3dError(f"{path}: a face names vertex {int(index.max())} of {len(vertices)}; repair the mesh")
        triangles = np.empty(len(index), dtype=[("#vertex_indices", "u1"), ("vertex_indices", "<i4", (3,))])
        triangles["#vertex_indices"], triangles["vertex_indices"] = 3, index
        tables["face"] = triangles
    return encode_tables(tables)


def write_ply_mesh(path: str | Path, vertices: ArrayLike, faces: ArrayLike, colours: ArrayLike | None = None) -> None:
    """Write a triangle mesh, binary little endian, atomically.

    Args:
        path: the file.
        vertices: (V, 3) metres, world coordinates (Y up).
        faces: (F, 3) vertex indices, counter-clockwise seen from outside.
        colours: (V, 3) uint8.

    Raises:
        Avs3dError: if numbers are not finite, indices are out of range, or the system refuses.
    """
    write_bytes(path, encode_ply_mesh(path, vertices, faces, colours))


def encode_ply_mesh(
    path: str | Path,
    vertices: ArrayLike,
    faces: ArrayLike,
    colours: ArrayLike | None = None,
    instances: ArrayLike | None = None,
) -> bytes:
    """The file that `write_ply_mesh` writes; ``path`` names it in messages.

    Args:
        path: the file.
        vertices: (V, 3) metres, world coordinates (Y up).
        faces: (F, 3) vertex indices, counter-clockwise seen from outside.
        colours: (V, 3) uint8.
        instances: (V,) id of the instance that each vertex is of.

    Raises:
        Avs3dError: if numbers are not finite, or indices are out of range.
    """
    return _encode(path, vertices, faces, colours, instances)


def write_ply_points(path: str | Path, points: ArrayLike, colours: ArrayLike | None = None) -> None:
    """Write a point cloud (N, 3), metres, with colours (N, 3) uint8 where given; binary little endian, atomically.

    Raises:
        Avs3dError: if numbers are not finite or the system refuses.
    """
    write_bytes(path, _encode(path, points, None, colours))


def read_ply(path: str | Path) -> Ply:
    """Read a triangle mesh or a point cloud.

    Raises:
        Avs3dError: if the file is missing, truncated, no PLY, or has polygons, NaN or indices out of range.
    """
    header, tables = read_tables(path)
    vertex = tables.get("vertex")
    names = vertex.dtype.names or () if vertex is not None else ()
    vertices = np.zeros((0, 3), dtype=np.float32)
    if vertex is not None:
        with np.errstate(over="ignore"):
            vertices = np.stack([vertex[axis] for axis in "xyz"], axis=1).astype(np.float32)
    if not np.isfinite(vertices).all():
        raise Avs3dError(f"{path}: vertices hold NaN or infinite numbers; repair the file")
    colours = None
    if vertex is not None and set(RGB) <= set(names):
        colours = np.stack([vertex[c] for c in RGB], axis=1).astype(np.uint8)
    faces = np.zeros((0, 3), dtype=np.int32)
    face, element = tables.get("face"), element_named(header, "face")
    if face is not None and element is not None and len(face):
        indices = face[index_property(element, path).name]
        if indices.min() < 0 or indices.max() >= len(vertices):
            raise Avs3dError(f"{path}: a face names vertex {int(indices.max())} of {len(vertices)}; repair the mesh")
        faces = indices.astype(np.int32)
    instances = vertex[INSTANCE].astype(np.int32) if vertex is not None and INSTANCE in names else None
    return Ply(vertices, faces, colours, instances)
