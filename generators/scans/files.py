"""Finding a scan by its id below a folder, and the digest of the files that it consists of.

Layouts known by name, at the root itself or any number of folders below it (``val/``, ``hm3d/minival/``,
``v1/tasks/mp3d/``, ``scans/``, …):

- HM3D: ``00800-TEEsavR23oF/TEEsavR23oF.glb`` (or ``.basis.glb``), ``.semantic.glb``, ``.semantic.txt``; the id is
  ``00800-TEEsavR23oF`` or ``TEEsavR23oF``. HM3D comes in several archives; files that one folder lacks are taken from a
  folder of the same name elsewhere below the root.
- Matterport3D: ``<id>/<id>.glb`` with ``<id>.house`` and ``<id>_semantic.ply``.
- anything else: ``<id>.glb``, ``.gltf``, ``.obj`` or ``.ply``.

The files of both data sets have Z up; others are taken as Y up unless the manifest says otherwise.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal
from urllib.parse import unquote

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files
from generators.assets.meshcheck import OTHERS, ply_header, ply_textures

Kind = Literal["hm3d", "mp3d", "file"]

#: Suffixes of a scan's mesh, the preferred first; ``.basis.glb`` comes last: its textures need a decoder.
MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".basis.glb")
#: Axes (up, front) of each kind's files: Habitat turns (x, y, z) of HM3D and Matterport3D to (x, z, −y).
AXES: dict[Kind, tuple[str, str]] = {"hm3d": ("z", "-y"), "mp3d": ("z", "-y"), "file": ("y", "+z")}
#: Folders below the root that are searched, so that a root of ``/`` is noticed rather than walked.
_MOST_FOLDERS = 200_000
_HM3D_FOLDER = re.compile(r"^(\d{5})-(\w+)$")


@dataclass(frozen=True)
class ScanFiles:
    """The files of one scan.

    Attributes:
        mesh: geometry and colour.
        up: the file's axis that points up.
        front: the file's axis that becomes +Z.
        semantic_txt: HM3D's table of objects.
        semantic_mesh: HM3D's ``.semantic.glb`` or Matterport3D's ``_semantic.ply``.
        house: Matterport3D's regions and objects.
        kind: how the files are laid out.
        splats: the same place in 3D Gaussians, if they are to be drawn.
    """

    mesh: Path
    up: str = "y"
    front: str = "+z"
    semantic_txt: Path | None = None
    semantic_mesh: Path | None = None
    house: Path | None = None
    kind: Kind = "file"
    splats: Path | None = None

    @property
    def all(self) -> tuple[Path, ...]:
        """Every file that there is, those that the mesh refers to included."""
        return self._own + _referred(self.mesh)

    @property
    def _own(self) -> tuple[Path, ...]:
        own = (self.mesh, self.semantic_txt, self.semantic_mesh, self.house, self.splats)
        return tuple(p for p in own if p is not None)

    def digests(self) -> dict[str, str]:
        """Name → sha256 of every file; files of the mesh are named as it refers to them: bare names may repeat."""
        named = {os.path.relpath(path, self.mesh.parent): path for path in _referred(self.mesh)}
        named |= {path.name: path for path in self._own}
        return {name: digest(path) for name, path in sorted(named.items())}


def _referred(mesh: Path) -> tuple[Path, ...]:
    """Files that the mesh refers to, as far as they exist.

    The buffers and textures of a .gltf, the material library of an .obj and its textures, the texture of a .ply.
    """
    names: list[str] = []
    suffix = mesh.suffix.lower()
    try:
        if suffix == ".gltf":
            tree = json.loads(mesh.read_bytes())
            items = [*tree.get("buffers", []), *tree.get("images", [])]
            names = [unquote(item["uri"]) for item in items if not item.get("uri", "data:").startswith("data:")]
        elif suffix == ".obj":
            names = _after(mesh, "mtllib")
            names += [
                image for name in names if (mesh.parent / name).is_file() for image in _images(mesh.parent / name)
            ]
        elif suffix == ".ply":
            names = ply_textures(ply_header(mesh))
    except (OSError, ValueError, AttributeError, TypeError):
        return ()  # the reader will report what is wrong with it
    return tuple(path for path in (mesh.parent / name for name in dict.fromkeys(names)) if path.is_file())


def _images(library: Path) -> list[str]:
    """Textures of a material library; options may precede a name."""
    words = _after(library, "map_kd")
    return [(word.split()[-1] if word.startswith("-") else word).replace("\\", "/") for word in words]


def _after(file: Path, key: str) -> list[str]:
    """Texts that follow ``key`` at the start of a line."""
    with file.open(encoding="utf-8", errors="replace") as lines:
        pairs = [line.strip().partition(" ") for line in lines if line.lstrip()[: len(key)].lower() == key]
    return [rest.strip() for head, _, rest in pairs if head.lower() == key and rest.strip()]


def find_scan_files(scan_id: str, root: str | Path) -> ScanFiles:
    """The files of the scan ``scan_id`` below ``root``.

    Raises:
        Avs3dError: if the root is no folder, or nothing below it is called like that; or if two different meshes are.
    """
    root = Path(root)
    if not root.is_dir():
        raise Avs3dError(
            f"scan {scan_id}: {root} is no folder; name the one that holds your scans with --scans (or $AVS3D_SCANS)"
        )
    match = _HM3D_FOLDER.match(scan_id)
    stem = match.group(2) if match else scan_id
    found = _named(root.resolve(), stem)
    meshes = [p for suffix in MESH_SUFFIXES for p in found if p.name[len(stem) :].lower() == suffix]
    if match:
        meshes = [p for p in meshes if p.parent.name == scan_id] or meshes
    if not meshes:
        hint = ""
        if any(p.name.startswith(f"{stem}.semantic") for p in found):
            hint = "; only its annotations are there: the geometry is in HM3D's archives hm3d-*-glb or hm3d-*-habitat"
        for path in (p for p in found if p.suffix.lower() in OTHERS):
            hint = f"; {path.name} is there: {OTHERS[path.suffix.lower()]}"
        raise Avs3dError(
            f"unknown scan {scan_id!r}: no {stem}.glb (or .gltf, .obj, .ply, .basis.glb) below {root}{hint}; "
            "name the folder that holds your scans with --scans (or $AVS3D_SCANS)"
        )
    mesh = meshes[0]
    same = [p for p in meshes if p.name == mesh.name]
    if len(same) > 1 and len({digest(p) for p in same}) > 1:
        raise Avs3dError(
            f"scan {scan_id}: {len(same)} different files are called {mesh.name} below {root} ({same[0].parent}, "
            f"{same[1].parent}); name a narrower --scans, or the scan's file in the manifest"
        )
    return _described(mesh, stem, found)


def scan_files_of(path: Path) -> ScanFiles:
    """The scan whose mesh is ``path``, with the annotations that lie beside it."""
    stem = path.name
    for suffix in sorted(MESH_SUFFIXES, key=len, reverse=True):
        if stem.lower().endswith(suffix):
            stem = stem[: -len(suffix)]
            break
    beside = sorted(p for p in path.parent.iterdir() if p.is_file()) if path.parent.is_dir() else []
    return _described(path, stem, beside)


def _described(mesh: Path, stem: str, found: list[Path]) -> ScanFiles:
    """``mesh`` with what else belongs to it: files beside it first, then in folders of the same name."""

    def other(name: str) -> Path | None:
        same = [p for p in found if p.name == name and (p.parent == mesh.parent or p.parent.name == mesh.parent.name)]
        same.sort(key=lambda p: p.parent != mesh.parent)
        return same[0] if same else None

    txt, glb = other(f"{stem}.semantic.txt"), other(f"{stem}.semantic.glb")
    house, ply = other(f"{stem}.house"), other(f"{stem}_semantic.ply")
    folder = _HM3D_FOLDER.match(mesh.parent.name)
    if (folder and folder.group(2) == stem) or mesh.name == f"{stem}.basis.glb" or txt is not None:
        return ScanFiles(mesh, *AXES["hm3d"], semantic_txt=txt, semantic_mesh=glb, kind="hm3d")
    if house is not None or ply is not None:
        return ScanFiles(mesh, *AXES["mp3d"], semantic_mesh=ply, house=house, kind="mp3d")
    return ScanFiles(mesh, *AXES["file"])


def _walk(root: Path) -> Iterator[Path]:
    """Every file below ``root``, in the order of names; links to folders are followed, but not twice."""
    seen: set[tuple[int, int]] = set()
    stack = [root]
    while stack:
        folder = stack.pop()
        try:
            status = folder.stat()
            entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
        except OSError:  # a folder that may not be read holds no scan for us
            continue
        if (status.st_dev, status.st_ino) in seen:
            continue
        seen.add((status.st_dev, status.st_ino))
        if len(seen) > _MOST_FOLDERS:
            raise Avs3dError(f"{root}: more than {_MOST_FOLDERS} folders; name the folder that holds your scans")
        folders = []
        for entry in entries:
            try:
                is_folder, is_file = entry.is_dir(), entry.is_file()
            except OSError:  # a link to itself, or into a folder that may not be read
                continue
            if is_folder:
                folders.append(Path(entry.path))
            elif is_file:
                yield Path(entry.path)
        stack += reversed(folders)


@lru_cache(maxsize=8)
def _index(root: Path) -> dict[str, list[Path]]:
    """Files below ``root`` by what their name holds before the first dot (or ``_semantic``)."""
    index: dict[str, list[Path]] = {}
    for path in _walk(root):
        index.setdefault(_stem(path.name), []).append(path)
    return index


def _stem(name: str) -> str:
    return name.removesuffix("_semantic.ply") if name.endswith("_semantic.ply") else name.partition(".")[0]


def _named(root: Path, stem: str) -> list[Path]:
    """Files that may belong to the scan ``stem``; an id may itself hold dots."""

    def look() -> list[Path]:
        return [p for p in _index(root).get(_stem(stem), ()) if p.name.startswith(stem) and p.is_file()]

    found = look()
    if not any(p.name[len(stem) :].lower() in MESH_SUFFIXES for p in found):  # it may have been put there since
        _index.cache_clear()
        found = look()
    return found


_DIGESTS: dict[tuple[str, int, int], str] = {}


def digest(path: Path) -> str:
    """Sha256 of a file's bytes; read once per process as long as its size and time of change stay the same."""
    status = path.stat()
    key = (str(path), status.st_size, status.st_mtime_ns)
    if key not in _DIGESTS:
        _DIGESTS[key] = files.sha256_file(path)
    return _DIGESTS[key]
