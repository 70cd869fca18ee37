"""Scans that an app shares as a ZIP, such as an OBJ with its MTL and pictures: unpacked beside the manifest.

What follows needs files: a renderer loads its stage itself, and each file's digest is part of a plan.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files
from generators.assets.meshcheck import SUFFIXES
from generators.library.archive import ZipLimits, unpack

#: Limits of a scan's archive. Text of an OBJ packs 1:10, a picture of one colour 1:200.
SCAN_LIMITS = ZipLimits(members=5000, total=2_000_000_000)


@contextmanager
def unpacked(file: Path, folder: Path) -> Iterator[Path]:
    """The mesh of a scan: ``file`` itself, or the mesh in it if it is a ZIP, which is unpacked to ``folder``.

    A folder that holds the same files stays as it is; a new one is removed if what follows fails.

    Raises:
        Avs3dError: in one line, if the archive is broken or hostile, if it holds no mesh or several, or if the folder
            holds something else.
    """
    if file.suffix.lower() != ".zip" or not file.is_file():
        yield file
        return
    mesh, is_new = _placed(file, folder)
    try:
        yield mesh
    except BaseException:
        if is_new:
            shutil.rmtree(folder)
        raise


def _placed(file: Path, folder: Path) -> tuple[Path, bool]:
    """The mesh of an archive below ``folder``, and whether the folder is new."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as temporary:
        # The folder of a TemporaryDirectory is for its owner alone; one made in it is as others are.
        place = Path(temporary, "scan")
        unpack(file, place, str(file), SCAN_LIMITS)
        mesh = _mesh_of(file, place).relative_to(place)
        if not folder.exists():
            place.rename(folder)
            return folder / mesh, True
        if _digests(folder) != _digests(place):
            raise Avs3dError(
                f"{folder}: holds something else than {file}; {file.name} would be unpacked there: remove it, or "
                "choose another name for the manifest"
            )
    return folder / mesh, False


def _mesh_of(file: Path, place: Path) -> Path:
    """The one mesh of what was unpacked to ``place``; of several kinds the one that holds the most."""
    # macOS adds a folder of attributes, whose files begin with a dot and end like those that they belong to.
    found = sorted(path for path in place.rglob("*") if path.is_file() and not path.name.startswith("."))
    meshes: list[Path] = []
    for suffix in SUFFIXES:
        meshes = meshes or [path for path in found if path.suffix.lower() == suffix]
    if not meshes:
        kinds = sorted({path.suffix.lower() for path in found if path.suffix})
        raise Avs3dError(
            f"{file}: holds no mesh ({', '.join(SUFFIXES)}), only {', '.join(kinds[:6]) or 'other files'}: export the "
            "scan as GLB or OBJ"
        )
    if len(meshes) > 1:
        names = ", ".join(repr(path.relative_to(place).as_posix()) for path in meshes[:3])
        raise Avs3dError(f"{file}: holds {len(meshes)} meshes ({names}); expected one: unpack it and name the mesh")
    return meshes[0]


def _digests(folder: Path) -> dict[str, str]:
    """Name → sha256 of each file below a folder."""
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): files.sha256_file(path) for path in paths}
