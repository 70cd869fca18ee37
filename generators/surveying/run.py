"""The whole of `avs3d scan`: read, survey, try what fits, write."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files
from generators.assets.meshcheck import SUFFIXES
from generators.core.scene import Licence
from generators.scans.decimation import ScanMesh
from generators.scans.files import scan_files_of
from generators.scans.scan import Axes, ScanAcoustics, SoundReport, load_scan_mesh, read_scan
from generators.surveying.document import document_of, relative_name, scan_manifest, test_voices
from generators.surveying.fitting import FittingObservations, ScanFitting
from generators.surveying.measures import RoomMeasures, measure
from generators.surveying.page import scan_page
from generators.surveying.survey import KnownFrame, Survey, survey
from generators.surveying.unpacking import unpacked
from generators.vision.splats.backend import read_cloud

#: Walkable floor of a room (m²), share of holes in it, and share of open directions that are worth a warning.
LEAST_WALK, MOST_HOLES, MOST_OPEN = 1.0, 0.05, 0.15


@dataclass(frozen=True)
class ScanRequest:
    """What `avs3d scan` is asked for: the scan, the manifest, what need not be found, the manifest's name, licence.

    ``surfaces``: place → acoustic material. ``splats``: the same place in 3D Gaussians, if they are to be drawn.
    """

    file: Path
    output: Path
    known: KnownFrame = field(default_factory=KnownFrame)
    name: str | None = None
    licence: tuple[str, str] | None = None
    surfaces: dict[str, str] = field(default_factory=dict)
    splats: Path | None = None

    @property
    def page(self) -> Path:
        """The page beside the manifest."""
        return self.output.with_suffix(".html")

    @property
    def unpacked(self) -> Path:
        """The folder beside the manifest to which a ZIP is unpacked."""
        return self.output.with_suffix(".scan")

    @property
    def next_commands(self) -> tuple[str, ...]:
        """What the user types next, in the folder of this call."""
        folder = shlex.quote(str(self.output.with_suffix("")))
        vision = " --vision splats" if self.splats else ""
        return f"avs3d generate {shlex.quote(str(self.output))} -o {folder}{vision}", f"avs3d view {folder}"


@dataclass(frozen=True, eq=False)
class ScanOutcome:
    """What was found."""

    survey: Survey
    measures: tuple[RoomMeasures, ...]
    found: FittingObservations
    sound: SoundReport


def survey_scan(request: ScanRequest, command: str) -> ScanOutcome:
    """Survey a scan, write its page and its manifest; ``command``: the manifest's first line.

    A ZIP is unpacked to `ScanRequest.unpacked`.

    Raises:
        Avs3dError: one line, if the file is no scan of a room, or nothing fits into it.
        UsageError: for a wrong request.
    """
    with unpacked(request.file, request.unpacked) as file:
        return _survey_mesh(replace(request, file=file), command)


def _survey_mesh(request: ScanRequest, command: str) -> ScanOutcome:
    """Survey a mesh file, and write the page and the manifest."""
    # Pictures of the page show the decimated mesh: it has faces of a centimetre.
    loaded = ScanMesh(_read(request.file).mesh, None)
    surveyed = survey(request.file.name, loaded.mesh.positions, request.known, gltf=_is_gltf(request.file))
    name = request.name or _slug(request.output.stem)
    document = document_of(name, relative_name(request.file, request.output), surveyed, request.licence)
    if request.surfaces:
        document["scans"][name]["surfaces"] = request.surfaces
    if request.splats is not None:
        document["scans"][name]["splats"] = relative_name(request.splats, request.output)
    boxes = _rooms_of(surveyed)
    home, sound = read_scan(
        name,
        replace(scan_files_of(request.file.resolve()), splats=request.splats),
        boxes,
        licence=Licence(*request.licence, request.file.name) if request.licence else None,
        axes=_axes_of(surveyed),
        acoustics=ScanAcoustics(surfaces=request.surfaces),
        load=lambda _: loaded,
    )
    if request.splats is not None:
        read_cloud(home)
    fitting = ScanFitting(home, document, request.output.resolve().parent)
    found = fitting.observations(tuple(boxes))
    measures = tuple(measure(fitting.site(room)) for room in boxes)
    surveyed = replace(surveyed, warnings=(*surveyed.warnings, *_doubts(measures)))
    page = scan_page(name, home, surveyed, measures, found, sound, request.next_commands)
    files.write_bytes(request.page, page)
    if not found.entries:
        why = next(iter(found.refused.values()), "no room has a category")
        raise Avs3dError(f"{request.file}: no object of the benchmark has a place in it (see {request.page}): {why}")
    document["voices"] = test_voices(found.categories)
    files.write_bytes(request.output, scan_manifest(document, surveyed, found, command).encode())
    return ScanOutcome(surveyed, measures, found, sound)


def _doubts(measures: Sequence[RoomMeasures]) -> list[str]:
    """What may be wrong with the rooms as the generator uses them."""
    out = []
    for each in measures:
        name = each.room.name
        if each.area < LEAST_WALK:
            out.append(f"{name}: only {each.area:.1f} m² of floor to walk on; is its box right?")
        if each.hole_share > MOST_HOLES:
            out.append(f"{name}: {each.hole_share:.0%} of its floor are holes; the camera does not walk over them")
        if each.open_share > MOST_OPEN:
            out.append(
                f"{name}: nothing was scanned in {each.open_share:.0%} of all directions: pictures are black there"
            )
    return out


def _read(file: Path) -> ScanMesh:
    """The mesh in the axes and the unit of its file.

    Raises:
        Avs3dError: if it is missing or no mesh, or has no colours.
    """
    if not file.is_file():
        what = "is a folder" if file.is_dir() else "does not exist"
        raise Avs3dError(f"{file}: {what}; expected a mesh: {', '.join(SUFFIXES)}, or a .zip of one")
    loaded = load_scan_mesh(file)
    materials = loaded.mesh.materials
    if all(material.texture is None for material in materials) and len({m.colour for m in materials}) == 1:
        raise Avs3dError(
            f"{file}: has no colours; expected a texture or vertex colours: export it with textures "
            "(an OBJ needs its MTL and pictures beside it)"
        )
    return loaded


def find_rooms(file: Path, known: KnownFrame | None = None) -> tuple[Axes, dict[str, NDArray[np.float64]]]:
    """How the mesh of a scan lies, and its rooms, named by their size.

    Args:
        file: the mesh.
        known: what need not be found.

    Returns:
        its axes and unit, and for each room its box (2, 3): lowest and highest corner, metres.

    Raises:
        Avs3dError: one line, if it is missing, no mesh, without colours, or no room.
    """
    surveyed = survey(file.name, _read(file).mesh.positions, known or KnownFrame(), gltf=_is_gltf(file))
    return _axes_of(surveyed), _rooms_of(surveyed)


def _axes_of(surveyed: Survey) -> Axes:
    return Axes(surveyed.up, surveyed.front, surveyed.turn, surveyed.scale)


def _rooms_of(surveyed: Survey) -> dict[str, NDArray[np.float64]]:
    return {room: np.array([surveyed.boxes[n].low, surveyed.boxes[n].high]) for room, n in surveyed.rooms.items()}


def _is_gltf(file: Path) -> bool:
    return file.suffix.lower() in (".glb", ".gltf")


def _slug(text: str) -> str:
    """A name of a manifest made of a file's."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", text).strip("._-") or "my_room"
