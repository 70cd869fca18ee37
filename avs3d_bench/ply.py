"""PLY meshes and point clouds (Turk 1994), numpy only.

Written: binary little endian, vertices ``float x y z`` (with ``uchar red green blue`` where there are colours) and
triangles. Read: any PLY of triangles or points, ASCII or binary of either byte order; further properties are skipped.
Own code, because the core install must stay small and the usual library is under the GPL.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.files import read_bytes, write_bytes

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_RGB = ("red", "green", "blue")


@dataclass(frozen=True, eq=False)
class Ply:
    """A mesh or a point cloud.

    Attributes:
        vertices: (V, 3) float32.
        faces: (F, 3) int32; F = 0 for a point cloud.
        colours: (V, 3) uint8, or None.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    colours: NDArray[np.uint8] | None = None


@dataclass(frozen=True)
class _Property:
    name: str
    kind: str
    count: str | None = None  # type of the length, for lists


@dataclass(frozen=True)
class _Element:
    name: str
    size: int
    properties: tuple[_Property, ...]

    @property
    def has_lists(self) -> bool:
        return any(p.count for p in self.properties)


def _write(path: str | Path, points: ArrayLike, faces: ArrayLike | None, colours: ArrayLike | None) -> None:
    vertices = np.asarray(points, dtype=np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise Avs3dError(f"{path}: vertices have shape {vertices.shape}, expected (V, 3)")
    if not np.isfinite(vertices).all():
        raise Avs3dError(f"{path}: vertices hold NaN or infinite numbers; repair the mesh")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {axis}" for axis in "xyz"]
    fields = [(axis, "<f4") for axis in "xyz"]
    if colours is not None:
        rgb = np.asarray(colours)
        if rgb.shape != vertices.shape or rgb.dtype != np.uint8:
            raise Avs3dError(f"{path}: colours are {rgb.dtype} {rgb.shape}, expected uint8 {vertices.shape}")
        header += [f"property uchar {name}" for name in _RGB]
        fields += [(name, "u1") for name in _RGB]
    table = np.empty(len(vertices), dtype=fields)
    for column, axis in enumerate("xyz"):
        table[axis] = vertices[:, column]
    if colours is not None:
        for column, name in enumerate(_RGB):
            table[name] = rgb[:, column]
    body = table.tobytes()
    if faces is not None:
        index = np.asarray(faces)
        if index.ndim != 2 or index.shape[1] != 3 or not np.issubdtype(index.dtype, np.integer):
            raise Avs3dError(f"{path}: faces are {index.dtype} {index.shape}, expected integers (F, 3)")
        if index.size and (index.min() < 0 or index.max() >= len(vertices)):
            raise Avs3dError(f"{path}: a face names vertex {int(index.max())} of {len(vertices)}; repair the mesh")
        triangles = np.empty(len(index), dtype=[("n", "u1"), ("v", "<i4", (3,))])
        triangles["n"], triangles["v"] = 3, index
        header += [f"element face {len(index)}", "property list uchar int vertex_indices"]
        body += triangles.tobytes()
    write_bytes(path, ("\n".join([*header, "end_header"]) + "\n").encode() + body)


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
    _write(path, vertices, faces, colours)


def write_ply_points(path: str | Path, points: ArrayLike, colours: ArrayLike | None = None) -> None:
    """Write a point cloud (N, 3), metres, with colours (N, 3) uint8 where given; binary little endian, atomically.

    Raises:
        Avs3dError: if numbers are not finite or the system refuses.
    """
    _write(path, points, None, colours)


def _header(data: bytes, path: str | Path) -> tuple[str, list[_Element], int]:
    """Format, elements, and where the body starts."""
    if data[:4] not in (b"ply\n", b"ply\r"):
        raise Avs3dError(f"{path}: {'empty' if not data else 'not a PLY'} file; expected a PLY mesh or point cloud")
    stop = data.find(b"end_header")
    newline = data.find(b"\n", stop)
    if stop < 0 or newline < 0:
        raise Avs3dError(f"{path}: truncated in its header; expected a whole PLY file")
    form, elements = "", list[_Element]()
    for line in data[:stop].decode("latin-1").splitlines()[1:]:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        try:
            if words[0] == "format":
                form = words[1]
            elif words[0] == "element":
                size = int(words[2])
                if size < 0:
                    raise ValueError
                elements.append(_Element(words[1], size, ()))
            elif words[0] == "property":
                prop = (
                    _Property(words[4], _TYPES[words[3]], _TYPES[words[2]])
                    if words[1] == "list"
                    else _Property(words[2], _TYPES[words[1]])
                )
                last = elements.pop()
                elements.append(_Element(last.name, last.size, (*last.properties, prop)))
            else:
                raise KeyError(words[0])
        except (IndexError, KeyError, ValueError):
            raise Avs3dError(f"{path}: PLY header line {line.strip()!r} is not understood") from None
    if form not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise Avs3dError(f"{path}: PLY format {form!r}, expected ascii, binary_little_endian or binary_big_endian")
    return form, elements, newline + 1


def _binary(data: bytes, at: int, element: _Element, order: str, path: str | Path) -> tuple[NDArray[np.void], int]:
    """Rows of an element. Lists must all have three entries (triangles)."""
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    for prop in element.properties:
        if prop.count:
            fields += [(f"#{prop.name}", order + prop.count), (prop.name, order + prop.kind, (3,))]
        else:
            fields.append((prop.name, order + prop.kind))
    row = np.dtype(fields)
    stop = at + row.itemsize * element.size
    if element.size and element.has_lists and at + row.itemsize <= len(data):
        first = np.frombuffer(data, dtype=row, count=1, offset=at)
        _triangles_only(first, element, path)
    if stop > len(data):
        raise Avs3dError(f"{path}: truncated: {len(data)} bytes, expected {stop}; make it anew")
    table = np.frombuffer(data, dtype=row, count=element.size, offset=at)
    _triangles_only(table, element, path)
    return table, stop


def _triangles_only(table: NDArray[np.void], element: _Element, path: str | Path) -> None:
    for prop in element.properties:
        if prop.count and np.any(table[f"#{prop.name}"] != 3):
            raise Avs3dError(f"{path}: {element.name}.{prop.name} has lists of other than 3 entries; triangulate it")


def _ascii(words: list[bytes], at: int, element: _Element, path: str | Path) -> tuple[NDArray[np.void], int]:
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    width = 0
    for prop in element.properties:
        fields += [(f"#{prop.name}", "i8"), (prop.name, "f8", (3,))] if prop.count else [(prop.name, "f8")]
        width += 4 if prop.count else 1
    stop = at + width * element.size
    if stop > len(words):
        raise Avs3dError(f"{path}: truncated: {len(words)} numbers, expected {stop} (triangles only)")
    try:
        numbers = np.array(words[at:stop], dtype=np.float64).reshape(element.size, width)
    except ValueError:
        raise Avs3dError(f"{path}: {element.name} holds something that is no number") from None
    table, column = np.empty(element.size, dtype=fields), 0
    for prop in element.properties:
        if prop.count:
            table[f"#{prop.name}"] = numbers[:, column]
            table[prop.name] = numbers[:, column + 1 : column + 4]
        else:
            table[prop.name] = numbers[:, column]
        column += 4 if prop.count else 1
    _triangles_only(table, element, path)
    return table, stop


def read_ply(path: str | Path) -> Ply:
    """Read a triangle mesh or a point cloud.

    Raises:
        Avs3dError: if the file is missing, truncated, no PLY, or has polygons, NaN or indices out of range.
    """
    data = read_bytes(path)
    form, elements, at = _header(data, path)
    tables: dict[str, NDArray[np.void]] = {}
    words, position = (data[at:].split(), 0) if form == "ascii" else ([], at)
    for element in elements:
        if form == "ascii":
            tables[element.name], position = _ascii(words, position, element, path)
        else:
            order = "<" if form == "binary_little_endian" else ">"
            tables[element.name], position = _binary(data, position, element, order, path)
    vertex = tables.get("vertex")
    names = vertex.dtype.names or () if vertex is not None else ()
    if vertex is None or not {"x", "y", "z"} <= set(names):
        raise Avs3dError(f"{path}: PLY without vertex x, y, z; expected a mesh or a point cloud")
    vertices = np.stack([vertex[axis] for axis in "xyz"], axis=1).astype(np.float32)
    if not np.isfinite(vertices).all():
        raise Avs3dError(f"{path}: vertices hold NaN or infinite numbers; repair the file")
    colours = np.stack([vertex[c] for c in _RGB], axis=1).astype(np.uint8) if set(_RGB) <= set(names) else None
    faces = np.zeros((0, 3), dtype=np.int32)
    face = tables.get("face")
    if face is not None:
        key = next((n for n in ("vertex_indices", "vertex_index") if n in (face.dtype.names or ())), None)
        if key is None:
            raise Avs3dError(f"{path}: PLY faces without vertex_indices")
        faces = face[key].astype(np.int32)
        if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
            raise Avs3dError(f"{path}: a face names vertex {int(faces.max())} of {len(vertices)}; repair the mesh")
    return Ply(vertices, faces, colours)
