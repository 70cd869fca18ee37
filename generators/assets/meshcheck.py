"""Checks of a mesh file before it is read, because readers fail on broken files or silently ignore missing ones."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from avs3d_bench.errors import Avs3dError
from generators.assets.gltf import read_tree, refuse_compressed

SUFFIXES = (".glb", ".gltf", ".obj", ".ply")


def check_file(file: Path) -> None:
    """Refuse a file that is missing, of an unknown kind, truncated, or that refers to a missing file.

    Raises:
        Avs3dError: with the fault and what to do.
    """
    if not file.is_file():
        raise Avs3dError(f"{file}: no such file; expected a mesh ({', '.join(SUFFIXES)})")
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        raise Avs3dError(f"{file}: unknown kind of mesh {file.suffix!r}; expected one of {', '.join(SUFFIXES)}")
    if suffix == ".obj":
        _check_obj(file)
    elif suffix in (".glb", ".gltf"):
        _check_gltf(file)


def _words(file: Path, key: str) -> Iterator[str]:
    """The rest of each line of a text file that begins with ``key``."""
    with file.open(encoding="utf-8", errors="replace") as lines:
        for line in lines:
            head, _, rest = line.strip().partition(" ")
            if head.lower() == key:
                yield rest.strip()


def _check_obj(file: Path) -> None:
    for library in _words(file, "mtllib"):
        mtl = file.parent / library
        if not mtl.is_file():
            raise Avs3dError(f"{file}: its material library {library!r} is missing beside it; put it there")
        for value in _words(mtl, "map_kd"):
            image = value.split()[-1] if value.startswith("-") else value
            if not (file.parent / image.replace("\\", "/")).is_file():
                raise Avs3dError(
                    f"{mtl}: texture {image!r} is missing; put it beside the OBJ or remove its map_Kd line"
                )


def _check_gltf(file: Path) -> None:
    tree = read_tree(file)
    refuse_compressed(file, tree)
    for kind in ("buffers", "images"):
        for item in tree.get(kind, []):
            uri = item.get("uri", "data:")
            if not uri.startswith("data:") and not (file.parent / unquote(uri)).is_file():
                what = "texture" if kind == "images" else "buffer"
                raise Avs3dError(f"{file}: {what} {uri!r} is missing; put it beside the file")
