"""The whole of `avs3d scan`: read, survey, try what fits, write."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files
from generators.assets.meshfile import load_mesh
from generators.core.scene import Licence, Mesh
from generators.scans.files import MESH_SUFFIXES, scan_files_of
from generators.scans.scan import Axes, load_scan
from generators.scans.sound import DEFAULT_LABEL
from generators.surveying.document import document_of, relative_name, scan_manifest, test_voices
from generators.surveying.fitting import FittingObservations, ScanFitting
from generators.surveying.survey import KnownFrame, Survey, survey


@dataclass(frozen=True)
class ScanRequest:
    """What `avs3d scan` is asked for: the scan, the manifest, what need not be found, the manifest's name, licence."""

    file: Path
    output: Path
    known: KnownFrame = KnownFrame()
    name: str | None = None
    licence: tuple[str, str] | None = None


@dataclass(frozen=True, eq=False)
class ScanOutcome:
    """What was found, and lines that say so."""

    survey: Survey
    found: FittingObservations
    lines: tuple[str, ...]


def survey_scan(request: ScanRequest, command: str) -> ScanOutcome:
    """Survey a scan and write its manifest; ``command``: its first line.

    Raises:
        Avs3dError: one line, if the file is no scan of a room, or nothing fits into it.
        UsageError: for a wrong request.
    """
    mesh = _read(request.file)
    surveyed = survey(request.file.name, mesh.positions, request.known, gltf=_is_gltf(request.file))
    name = request.name or _slug(request.output.stem)
    document = document_of(name, relative_name(request.file, request.output), surveyed, request.licence)
    boxes = {room: np.array([surveyed.boxes[n].low, surveyed.boxes[n].high]) for room, n in surveyed.rooms.items()}
    home = load_scan(
        name,
        scan_files_of(request.file.resolve()),
        boxes,
        licence=Licence(*request.licence, request.file.name) if request.licence else None,
        axes=Axes(surveyed.up, surveyed.front, surveyed.turn, surveyed.scale),
    )
    fitting = ScanFitting(home, document, request.output.resolve().parent)
    found = fitting.observations(tuple(boxes))
    if not found.entries:
        why = next(iter(found.refused.values()), "no room has a category")
        raise Avs3dError(f"{request.file}: no object of the benchmark has a place in it: {why}")
    document["voices"] = test_voices(found.categories)
    files.write_bytes(request.output, scan_manifest(document, surveyed, found, command).encode())
    return ScanOutcome(surveyed, found, (f"{request.output}: {len(found.entries)} observations",))


def _read(file: Path) -> Mesh:
    """The mesh as its file has it.

    Raises:
        Avs3dError: if it is missing or no mesh, or has no colours.
    """
    if not file.is_file() or not file.name.lower().endswith(MESH_SUFFIXES):
        what = "is no scan" if file.is_file() else "does not exist" if not file.exists() else "is a folder"
        raise Avs3dError(f"{file}: {what}; expected a mesh: {', '.join(MESH_SUFFIXES)}")
    mesh = load_mesh(file, acoustic=DEFAULT_LABEL, twin="surface", max_acoustic_faces=sys.maxsize)
    if all(material.texture is None for material in mesh.materials) and len({m.colour for m in mesh.materials}) == 1:
        raise Avs3dError(
            f"{file}: has no colours; expected a texture or vertex colours: export it with textures "
            "(an OBJ needs its MTL and pictures beside it)"
        )
    return mesh


def _is_gltf(file: Path) -> bool:
    return file.suffix.lower() in (".glb", ".gltf")


def _slug(text: str) -> str:
    """A name of a manifest made of a file's."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", text).strip("._-") or "my_room"
