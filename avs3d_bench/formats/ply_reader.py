"""Reading PLY files (Turk 1994) that anybody may have written: header, size, then the rows in bounded memory.

The header is parsed strictly, and what it announces is held against the size of the file before the body is read. ASCII
is read in blocks: one line per row, as the format says, and only numbers that C's ``%d`` and ``%g`` print.
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import open_regular
from avs3d_bench.text.printable import printable

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_LENGTHS = frozenset(name for name, kind in _TYPES.items() if kind[0] != "f")
RGB = ("red", "green", "blue")
_FORMATS = ("ascii", "binary_little_endian", "binary_big_endian")
#: Longest header (bytes).
HEADER_BYTES = 64 * 2**10
#: Bytes of an ASCII body that are parsed at once; no line is longer.
_BLOCK = 2**18
#: A number as C's printf prints it, NaN and infinity included.
_NUMBER = re.compile(
    rb"-?(?:(?:[0-9]{1,40}(?:\.[0-9]{0,40})?|\.[0-9]{1,40})(?:[eE][-+]?[0-9]{1,4})?|(?i:nan|inf|infinity))"
)
_COUNT = re.compile("[0-9]{1,18}")


@dataclass(frozen=True)
class Property:
    """A property of an element.

    Attributes:
        name: as in the header.
        kind: numpy's type of it, or of the entries of a list.
        count: numpy's type of the length of a list; None where it is a single number.
    """

    name: str
    kind: str
    count: str | None = None


@dataclass(frozen=True)
class Element:
    """A table of the file: its name, its number of rows and its columns."""

    name: str
    size: int
    properties: tuple[Property, ...] = ()

    @property
    def has_lists(self) -> bool:
        """Whether a row may have any length."""
        return any(p.count for p in self.properties)

    @property
    def words(self) -> int:
        """Numbers in a row, lists being of three entries."""
        return sum(4 if p.count else 1 for p in self.properties)

    def row(self, order: str) -> np.dtype[np.void]:
        """The type of a row, lists being of three entries: ``#name`` is the length of the list ``name``."""
        fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
        for prop in self.properties:
            if prop.count:
                fields += [(f"#{prop.name}", order + prop.count), (prop.name, order + prop.kind, (3,))]
            else:
                fields.append((prop.name, order + prop.kind))
        return np.dtype(fields)


@dataclass(frozen=True)
class PlyHeader:
    """The header of a PLY file.

    Attributes:
        form: ``ascii``, ``binary_little_endian`` or ``binary_big_endian``.
        elements: in the order of the file.
        start: where the body begins (bytes).
        size: of the whole file (bytes).
    """

    form: str
    elements: tuple[Element, ...]
    start: int
    size: int

    @property
    def vertices(self) -> int:
        """How many vertices."""
        return sum(element.size for element in self.elements if element.name == "vertex")


def read_header(path: str | Path, most: int | None = None) -> PlyHeader:
    """Read the header of a PLY file and compare it with the size of the file; the body is not read.

    Args:
        path: the file.
        most: vertices that it may announce; None: any number.

    Raises:
        Avs3dError: if the file is missing, no PLY, without x, y, z, or has another size than its header announces.
    """
    with open_regular(path) as stream:
        header = _parse_header(stream.read(HEADER_BYTES), os.fstat(stream.fileno()).st_size, path)
    if most is not None and header.vertices > most:
        raise Avs3dError(f"{path}: {header.vertices:,} points, expected at most {most:,}")
    _check_announced(header, path)
    return header


def read_tables(path: str | Path) -> tuple[PlyHeader, dict[str, NDArray[np.void]]]:
    """The header, and the rows of every element that has any.

    Raises:
        Avs3dError: as `read_header`, or if the body holds polygons or what is no number.
    """
    header = read_header(path)
    with open_regular(path) as stream:
        return header, (_ascii if header.form == "ascii" else _binary)(stream, header, path)


def _parse_header(head: bytes, size: int, path: str | Path) -> PlyHeader:
    if not head.startswith((b"ply\n", b"ply\r\n")):
        raise Avs3dError(f"{path}: {'empty' if not head else 'not a PLY'} file; expected a PLY mesh or point cloud")
    form, elements, at = "", list[Element](), head.index(b"\n") + 1
    while (newline := head.find(b"\n", at)) >= 0:
        line = head[at:newline].removesuffix(b"\r").decode("latin-1")
        at = newline + 1
        words = line.split()
        if words == ["end_header"]:
            break
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and not form:
            form = words[1]
        elif not _parse_line(words, elements):
            raise Avs3dError(f"{path}: PLY header line {printable(line[:80])!r} is not understood")
    else:
        if size > len(head):
            raise Avs3dError(f"{path}: no end_header in its first {len(head):,} bytes; expected a mesh or point cloud")
        raise Avs3dError(f"{path}: truncated in its header; expected a whole PLY file")
    if form not in _FORMATS:
        raise Avs3dError(f"{path}: PLY format {printable(form[:40])!r}, expected {', '.join(_FORMATS)}")
    return PlyHeader(form, tuple(elements), at, size)


def _parse_line(words: list[str], elements: list[Element]) -> bool:
    """Take in a line of the header that declares an element or a property; False if it is none, or names one twice."""
    match words:
        case ["element", name, count] if _COUNT.fullmatch(count) and all(name != e.name for e in elements):
            elements.append(Element(name, int(count)))
            return True
        case ["property", kind, name] if kind in _TYPES and elements:
            new = Property(name, _TYPES[kind])
        case ["property", "list", count, kind, name] if kind in _TYPES and count in _LENGTHS and elements:
            new = Property(name, _TYPES[kind], _TYPES[count])
        case _:
            return False
    last = elements[-1]
    if any(prop.name == new.name for prop in last.properties):
        return False
    elements[-1] = Element(last.name, last.size, (*last.properties, new))
    return True


def _check_announced(header: PlyHeader, path: str | Path) -> None:
    """Refuse, before the body is read, what is no mesh and no cloud, or has another size than it announces."""
    for element in header.elements:
        if element.size and not element.properties:
            name = printable(element.name[:40])
            raise Avs3dError(f"{path}: PLY element {name} without properties; expected a mesh or point cloud")
    vertex = element_named(header, "vertex")
    found = {prop.name: prop for prop in vertex.properties} if vertex else {}
    if not {"x", "y", "z"} <= found.keys():
        raise Avs3dError(f"{path}: PLY without vertex x, y, z; expected a mesh or a point cloud")
    for name in (*"xyz", *RGB):
        if name in found and found[name].count:
            raise Avs3dError(f"{path}: vertex.{name} is a list; expected a number per vertex")
    face = element_named(header, "face")
    if face and face.size:
        index = index_property(face, path)
        if not index.count or index.kind[0] == "f":
            raise Avs3dError(f"{path}: face.{index.name} is no list of integers; expected indices of vertices")
    body = header.size - header.start
    if header.form == "ascii":
        # A digit and what parts it from the next; the last line may lack its end.
        least = sum(2 * element.words * element.size for element in header.elements) - 1
        if body < least:
            raise Avs3dError(f"{path}: truncated: {body:,} bytes of numbers, expected {least:,} or more")
        return
    expected = sum(element.row("<").itemsize * element.size for element in header.elements if element.size)
    lists = any(element.has_lists and element.size for element in header.elements)
    if body != expected and not lists:  # the reader reports what is wrong with polygons
        fault = "truncated" if body < expected else "more than its header announces"
        raise Avs3dError(f"{path}: {fault}: {header.size:,} bytes, expected {header.start + expected:,}")


def element_named(header: PlyHeader, name: str) -> Element | None:
    """The element of that name, if there is one."""
    return next((element for element in header.elements if element.name == name), None)


def index_property(face: Element, path: str | Path) -> Property:
    """The property of faces that holds the indices of their vertices.

    Raises:
        Avs3dError: if there is none.
    """
    for prop in face.properties:
        if prop.name in ("vertex_indices", "vertex_index"):
            return prop
    raise Avs3dError(f"{path}: PLY faces without vertex_indices")


def _binary(stream: io.BufferedIOBase, header: PlyHeader, path: str | Path) -> dict[str, NDArray[np.void]]:
    """Rows of every element. Lists must all have three entries (triangles)."""
    tables, at = {}, header.start
    for element in header.elements:
        if not element.size:
            continue
        row = element.row("<" if header.form == "binary_little_endian" else ">")
        stop = at + row.itemsize * element.size
        if element.has_lists and at + row.itemsize <= header.size:
            stream.seek(at)
            _triangles_only(np.frombuffer(stream.read(row.itemsize), dtype=row), element, path)
        if stop > header.size:
            raise Avs3dError(f"{path}: truncated: {header.size:,} bytes, expected {stop:,}")
        stream.seek(at)
        table = np.frombuffer(stream.read(stop - at), dtype=row)
        _triangles_only(table, element, path)
        tables[element.name], at = table, stop
    if at < header.size:
        raise Avs3dError(f"{path}: more than its header announces: {header.size:,} bytes, expected {at:,}")
    return tables


def _triangles_only(table: NDArray[np.void], element: Element, path: str | Path) -> None:
    for prop in element.properties:
        if prop.count and np.any(table[f"#{prop.name}"] != 3):
            raise Avs3dError(f"{path}: {element.name}.{prop.name} has lists of other than 3 entries; triangulate it")


def _blocks(stream: io.BufferedIOBase, path: str | Path) -> Iterator[list[bytes]]:
    """Lines of the body, some thousands at a time, each without its end."""
    rest = b""
    while block := stream.read(_BLOCK):
        *lines, rest = (rest + block).split(b"\n")
        if len(rest) > _BLOCK:
            raise Avs3dError(f"{path}: a line of more than {_BLOCK:,} bytes; expected one row of numbers per line")
        yield [line.removesuffix(b"\r") for line in lines]
    yield [rest.removesuffix(b"\r")] if rest else []


def _ascii(stream: io.BufferedIOBase, header: PlyHeader, path: str | Path) -> dict[str, NDArray[np.void]]:
    """Rows of every element, a line each; after them, nothing but empty lines."""
    stream.seek(header.start)
    blocks = _blocks(stream, path)
    tables: dict[str, NDArray[np.void]] = {}
    lines: list[bytes] = []
    for element in header.elements:
        table, filled = np.empty(element.size, dtype=element.row("<")), 0
        while filled < element.size:
            if not lines:
                found = next(blocks, None)
                if found is None:
                    raise Avs3dError(
                        f"{path}: truncated: {filled:,} lines of {element.name}, expected {element.size:,}"
                    )
                lines = found
                continue
            part, lines = lines[: element.size - filled], lines[element.size - filled :]
            _fill(table[filled : filled + len(part)], part, element, path)
            filled += len(part)
        tables[element.name] = table
    while True:
        if any(line.strip(b" \t") for line in lines):
            raise Avs3dError(f"{path}: text after its last row; expected the lines that the header announces")
        more = next(blocks, None)
        if more is None:
            return tables
        lines = more


def _fill(table: NDArray[np.void], lines: list[bytes], element: Element, path: str | Path) -> None:
    """Parse lines into rows, strictly."""
    words: list[bytes] = []
    for line in lines:
        row = line.replace(b"\t", b" ").split(b" ")
        row = [word for word in row if word] if b"" in row else row
        if len(row) != element.words:
            lists = " (of triangles; triangulate it)" if element.has_lists else ""
            raise Avs3dError(f"{path}: a line of {len(row)} numbers in {element.name}, expected {element.words}{lists}")
        words += row
    odd = next((word for word in words if not _NUMBER.fullmatch(word)), None)
    if odd is not None:
        text = printable(odd[:40].decode("latin-1"))
        raise Avs3dError(f"{path}: {element.name} holds {text!r}; expected a number such as -1.5 or 2e-05")
    numbers = np.array(words, dtype=np.float64).reshape(len(lines), element.words)
    column = 0
    for prop in element.properties:
        if prop.count:
            _put(table[f"#{prop.name}"], numbers[:, column], prop.count, f"{element.name}.{prop.name}", path)
            _triangles_only(table, Element(element.name, element.size, (prop,)), path)
            _put(table[prop.name], numbers[:, column + 1 : column + 4], prop.kind, f"{element.name}.{prop.name}", path)
        else:
            _put(table[prop.name], numbers[:, column], prop.kind, f"{element.name}.{prop.name}", path)
        column += 4 if prop.count else 1


def _put(target: NDArray[np.generic], numbers: NDArray[np.float64], kind: str, name: str, path: str | Path) -> None:
    """Store numbers as the type that the header declares."""
    if kind[0] != "f":
        limits = np.iinfo(kind)
        fits = (numbers >= limits.min) & (numbers <= limits.max) & (numbers == np.floor(numbers))
        if not fits.all():
            value = float(numbers[~fits].flat[0])
            raise Avs3dError(f"{path}: {name} holds {value:g}; expected integers from {limits.min} to {limits.max}")
    with np.errstate(over="ignore"):  # beyond float32: infinite, which is refused later
        target[...] = numbers
