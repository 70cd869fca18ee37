"""Checks of a mesh file before it is read, because readers fail on broken files or silently ignore missing ones."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from PIL import Image

from avs3d_bench.errors import Avs3dError
from generators.assets.gltf import LARGEST_TEXTURE, read_tree, refuse_compressed
from generators.assets.gltf_materials import check_materials

SUFFIXES = (".glb", ".gltf", ".obj", ".ply")
#: Other files that scanning apps write, and what to do with them.
OTHERS = {
    ".usdz": "export the scan as GLB, or open it in Blender and save it as GLB",
    ".zip": "avs3d scan unpacks it; elsewhere unpack it yourself, keep its files together and name the .obj or .glb",
    ".fbx": "export the scan as GLB, or open it in Blender and save it as GLB",
    ".dae": "export the scan as GLB, or open it in Blender and save it as GLB",
    ".stl": "it has no colours: export the scan as GLB with its texture",
    ".spz": "it holds Gaussian splats: export the scan as a mesh (GLB)",
    ".splat": "it holds Gaussian splats: export the scan as a mesh (GLB)",
    ".las": "it holds points: export the scan as a mesh (GLB)",
    ".laz": "it holds points: export the scan as a mesh (GLB)",
    ".e57": "it holds points: export the scan as a mesh (GLB)",
    ".xyz": "it holds points: export the scan as a mesh (GLB)",
    ".pts": "it holds points: export the scan as a mesh (GLB)",
}
OTHERS |= {".usdc": OTHERS[".usdz"], ".usda": OTHERS[".usdz"], ".usd": OTHERS[".usdz"]}
#: Bytes of a PLY that are looked through for the end of its header.
_PLY_HEADER = 65_536


def check_file(file: Path) -> None:
    """Refuse a file that is missing, of an unknown kind, truncated, or that refers to a missing file.

    Raises:
        Avs3dError: with the fault and what to do.
    """
    if not file.is_file():
        raise Avs3dError(f"{file}: no such file; expected a mesh ({', '.join(SUFFIXES)})")
    suffix = file.suffix.lower()
    if suffix in OTHERS:
        raise Avs3dError(f"{file}: {suffix} is not read; {OTHERS[suffix]}")
    if suffix not in SUFFIXES:
        raise Avs3dError(f"{file}: unknown kind of mesh {file.suffix!r}; expected one of {', '.join(SUFFIXES)}")
    if suffix == ".obj":
        _check_obj(file)
    elif suffix in (".glb", ".gltf"):
        _check_gltf(file)
    else:
        _check_ply(file)


def ply_header(file: Path) -> list[str]:
    """The lines of a PLY's header; empty if it has none.

    Raises:
        OSError: if the file cannot be read.
    """
    with file.open("rb") as stream:
        head, end, _ = stream.read(_PLY_HEADER).partition(b"end_header")
    return head.decode("utf-8", "replace").splitlines() if end else []


def ply_textures(header: list[str]) -> list[str]:
    """Textures that the comments of a PLY's header name."""
    words = [line.split(maxsplit=2) for line in header]
    return [rest[2].strip() for rest in words if len(rest) == 3 and rest[:2] == ["comment", "TextureFile"]]


def _check_ply(file: Path) -> None:
    header = [line.strip() for line in ply_header(file)]
    counts = {word[1]: word[2] for word in (line.split() for line in header) if len(word) == 3 and word[0] == "element"}
    if counts and counts.get("face", "0") == "0" and "tristrips" not in counts:
        splats = any(line.split()[-1:] == ["f_dc_0"] for line in header)
        what = "3D Gaussian splats" if splats else "a point cloud"
        raise Avs3dError(
            f"{file}: holds {what} ({counts.get('vertex', '0')} points), no faces; export the scan as a mesh (GLB)"
        )
    names = ply_textures(header)
    if len(names) > 1:
        raise Avs3dError(f"{file}: has {len(names)} textures, of which only one could be read; export it as GLB or OBJ")
    for name in names:
        if not (file.parent / name).is_file():
            raise Avs3dError(f"{file}: texture {name!r} is missing; put it beside the file")


def _words(file: Path, key: str) -> Iterator[str]:
    """The rest of each line of a text file that begins with ``key``."""
    with file.open(encoding="utf-8", errors="replace") as lines:
        for line in lines:
            head, _, rest = line.strip().partition(" ")
            if head.lower() == key:
                yield rest.strip()


def check_obj_sizes(file: Path) -> None:
    """Refuse an OBJ with a huge texture, which its reader would leave out without a word.

    Raises:
        Avs3dError: naming the texture.
    """
    for mtl, name in _obj_textures(file):
        try:
            with Image.open(file.parent / name.replace("\\", "/")) as picture:
                side = max(picture.size)
        except Image.DecompressionBombError:
            side = LARGEST_TEXTURE + 1
        except OSError:  # the reader tells
            continue
        if side > LARGEST_TEXTURE:
            raise Avs3dError(f"{mtl}: texture {name!r} is larger than {LARGEST_TEXTURE} texels to a side; reduce it")


def _obj_textures(file: Path) -> Iterator[tuple[Path, str]]:
    """The material library of an OBJ and the textures that it names.

    Raises:
        Avs3dError: if a library is missing.
    """
    for library in _words(file, "mtllib"):
        mtl = file.parent / library
        if not mtl.is_file():
            raise Avs3dError(f"{file}: its material library {library!r} is missing beside it; put it there")
        for value in _words(mtl, "map_kd"):
            yield mtl, value.split()[-1] if value.startswith("-") else value


def _check_obj(file: Path) -> None:
    for mtl, image in _obj_textures(file):
        if not (file.parent / image.replace("\\", "/")).is_file():
            raise Avs3dError(f"{mtl}: texture {image!r} is missing; put it beside the OBJ or remove its map_Kd line")


def _check_gltf(file: Path) -> None:
    tree = read_tree(file)
    refuse_compressed(file, tree)
    check_materials(file, tree)
    for kind in ("buffers", "images"):
        for item in tree.get(kind, []):
            uri = item.get("uri", "data:")
            if not uri.startswith("data:") and not (file.parent / unquote(uri)).is_file():
                what = "texture" if kind == "images" else "buffer"
                raise Avs3dError(f"{file}: {what} {uri!r} is missing; put it beside the file")
