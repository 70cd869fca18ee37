"""A scanned flat from a file (HM3D, Matterport3D, a phone's scan, any GLB or OBJ) as a `Scene`.

The texture of a scan already holds its light, so its part has none. Rooms are boxes that the manifest gives, or those
that the scan's annotations show (generators/scans/rooms.py); what can carry an object is found by ray casting
(generators/scans/patches.py); what its surfaces sound like, by annotations or by where they are
(generators/scans/sound.py).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError
from generators.acoustics.materialfile import read_material_file
from generators.assets.acoustic_twin import clustered
from generators.assets.meshfile import load_mesh
from generators.assets.modelframe import upright
from generators.core.boxes import yaw_matrix
from generators.core.scene import DenseMesh, Licence, Material, Mesh, Part, Room, Scene, SplatFile, StageFile, Support
from generators.scans.annotations import Annotations
from generators.scans.backing import backing_of
from generators.scans.decimation import ScanMesh, for_rays
from generators.scans.files import ScanFiles, find_scan_files, scan_files_of
from generators.scans.hm3d import read_hm3d
from generators.scans.mp3d import read_mp3d
from generators.scans.patches import find_supports
from generators.scans.reverberation import RoomDecay, match_rooms
from generators.scans.rooms import find_rooms, missing_room
from generators.scans.sound import (
    DEFAULT_LABEL,
    FLOOR_OF_ROOM,
    MATERIAL_OF,
    SurfaceRow,
    labelled,
    no_table,
    surface_table,
)

#: Largest number of faces the acoustic engine gets in and around the rooms: above it, its rays slow down and gain
#: nothing. The rest of a house, which may be many times larger, is heard through doors only.
ACOUSTIC_FACES, ACOUSTIC_FACES_BEYOND = 20_000, 6_000
#: No part of a scan is farther from its origin (m): single precision has millimetres there.
FARTHEST = 10_000.0
#: What lies this near to a room belongs to it acoustically, metres: its walls do.
_AROUND = 0.5
#: Linear-light albedo of a scan that is read without its textures: objects placed in it are lit as among grey walls.
PLAIN = (0.45, 0.44, 0.42)
#: A room's box is moved to the floor that is found in it from this far away, metres.
_FLOOR_SLACK = 0.35
#: Where along its sides a top is asked what it is.
_SHARES = (0.15, 0.5, 0.85)


@dataclass(frozen=True)
class Axes:
    """Axes and unit of a scan's file; None: as its data set has them.

    Attributes:
        up: the axis that points up (HM3D, Matterport3D: ``z``; else ``y``).
        front: the one that becomes +Z (HM3D, Matterport3D: ``-y``; else ``+z``).
        turn: degrees about +Y by which the scan is turned after that, counter-clockwise seen from above.
        scale: metres in a unit of the file.
    """

    up: str | None = None
    front: str | None = None
    turn: float = 0.0
    scale: float = 1.0

    def rotation(self, files: ScanFiles) -> NDArray[np.float64]:
        """(3, 3) rotation from the axes of ``files`` to the world's.

        Raises:
            UsageError: if ``up`` and ``front`` are not two perpendicular axes.
        """
        return yaw_matrix(np.radians(self.turn)) @ upright(self.up or files.up, self.front or files.front)


@dataclass(frozen=True)
class ScanAcoustics:
    """How the surfaces of a scan sound, as far as its user says.

    Attributes:
        materials: a SoundSpaces material file.
        surfaces: place (one of `generators.scans.places.PLACES`) → acoustic material.
        t30: measured reverberation time, s, of every room or by room.
        furnished: whether rooms of a scan without annotations are kept in the range of furnished rooms.
    """

    materials: Path | None = None
    surfaces: Mapping[str, str] = field(default_factory=dict)
    t30: float | Mapping[str, float] | None = None
    furnished: bool = True

    def times(self, scan: str, rooms: Sequence[Room]) -> dict[str, float]:
        """Room → its measured reverberation time, s.

        Raises:
            Avs3dError: for a room that the scan does not have.
        """
        names = [room.name for room in rooms]
        if self.t30 is None:
            return {}
        if not isinstance(self.t30, Mapping):
            return dict.fromkeys(names, self.t30)
        for name in self.t30:
            if name not in names:
                raise Avs3dError(f"scan {scan}: acoustics.t30: no room {name}; expected one of {', '.join(names)}")
        return dict(self.t30)


@dataclass(frozen=True)
class SoundReport:
    """What was guessed about the sound of a scan.

    Attributes:
        surfaces: what its rooms are made of.
        rooms: their reverberation times.
        escaped: share of the flights of sound from surface to surface that left the scan before its holes were closed.
    """

    surfaces: tuple[SurfaceRow, ...]
    rooms: tuple[RoomDecay, ...]
    escaped: float


def load_scan(
    name: str,
    source: str | Path | ScanFiles,
    rooms: Mapping[str, ArrayLike] | None = None,
    *,
    licence: Licence | None = None,
    axes: Axes = Axes(),  # frozen
    textures: bool = True,
    acoustics: ScanAcoustics = ScanAcoustics(),  # frozen
    need: Sequence[str] = (),
) -> Scene:
    """Read a scan; see `read_scan`.

    ``textures``: whether colour is read; a renderer that reads `Scene.stage` itself needs none.
    """
    load = partial(load_scan_mesh, textures=textures)
    return read_scan(name, source, rooms, licence=licence, axes=axes, acoustics=acoustics, need=need, load=load)[0]


def load_scan_mesh(path: Path, textures: bool = True) -> ScanMesh:
    """The mesh of a scan in the axes and the unit of its file; without ``textures`` it is plain.

    Its materials are matte and do not shine: what reflects or shines is in the pictures already.

    Raises:
        Avs3dError: if it is broken.
    """
    mesh = load_mesh(path, acoustic=DEFAULT_LABEL, twin="surface", max_acoustic_faces=sys.maxsize, textures=textures)
    looks = ((m.colour, m.texture) if textures else (PLAIN, None) for m in mesh.materials)
    pictures = (Material(m.name, m.acoustic, *look) for m, look in zip(mesh.materials, looks, strict=True))
    return for_rays(replace(mesh, materials=tuple(pictures)))


def read_scan(
    name: str,
    source: str | Path | ScanFiles,
    rooms: Mapping[str, ArrayLike] | None = None,
    *,
    licence: Licence | None = None,
    axes: Axes = Axes(),  # frozen
    acoustics: ScanAcoustics = ScanAcoustics(),  # frozen
    need: Sequence[str] = (),
    load: Callable[[Path], ScanMesh] = load_scan_mesh,
) -> tuple[Scene, SoundReport]:
    """Read a scan.

    Args:
        name: the scan's id.
        source: its mesh file, a folder below which it is found by its id, or its files.
        rooms: the box (2, 3) of each room: lowest and highest corner, metres, Y up, after ``axes``. Rooms
            that are missing here are looked for in the annotations.
        licence: of the scan; without it, that it comes from ``source`` and its terms are not known.
        axes: of the file.
        acoustics: materials and reverberation times that are known.
        need: rooms without which the scan is of no use.
        load: reads the mesh of the file.

    Returns:
        One part with instance id 0, without a light map, decimated if the scan is dense (see
        `generators.scans.decimation`); the rooms; the supports found in each; the stage's file and that of the splats.
        And what was guessed about its sound.

    Raises:
        Avs3dError: if the scan is unknown, a file of it is missing or broken, its textures need a decoder that is not
            there, a box is no box, a box that was given or is needed holds no floor, a room that is needed is not
            found, or a reverberation time is out of reach.
    """
    files = _files(name, source)
    rotation = axes.rotation(files)
    annotations = _read_annotations(files, rotation)
    if annotations is not None and axes.scale != 1.0:
        raise Avs3dError(f"scan {name}: scale {axes.scale:g}, but annotated scans are in metres; leave it out")
    given = dict(rooms or {})
    boxes: dict[str, ArrayLike] = {**(find_rooms(annotations) if annotations is not None else {}), **given}
    for label in need:
        if label not in boxes:
            raise missing_room(name, label, given, annotations)
    if not boxes:
        raise Avs3dError(
            f"scan {name}: no rooms given, and no annotations show any; expected the box of at least one room"
        )
    mesh, dense = _placed(files.mesh, load(files.mesh), rotation, axes.scale)
    supports: list[Support] = []
    found: list[tuple[Room, float]] = []
    for label, box in boxes.items():
        what = f"scan {name}, room {label}"
        try:
            room = _room(what, label, box, mesh)
            floor, own = find_supports(mesh.positions, room, what)
        except Avs3dError:
            if label in given or label in need:
                raise
            continue
        found.append((_on_floor(room, floor), floor))
        supports += own if annotations is None else [s for s in own if _usable(s, annotations)]
    mesh, report = _with_sound(mesh, found, annotations, acoustics, acoustics.times(name, [room for room, _ in found]))
    licence = licence or Licence("unknown", "unknown", files.mesh.name)
    part = Part(name, mesh, licence=licence, dense=None if dense is None else DenseMesh(dense))
    stage = StageFile(files.mesh, axes.up or files.up, axes.front or files.front, axes.turn, axes.scale)
    splats = SplatFile(files.splats, similarity(rotation, axes.scale)) if files.splats is not None else None
    return Scene(name, (part,), tuple(room for room, _ in found), tuple(supports), stage=stage, splats=splats), report


def _with_sound(
    mesh: Mesh,
    found: Sequence[tuple[Room, float]],
    annotations: Annotations | None,
    acoustics: ScanAcoustics,
    times: Mapping[str, float],
) -> tuple[Mesh, SoundReport]:
    """The mesh with its acoustic twin: labelled, decimated, closed, with the reverberation that it should have.

    Raises:
        Avs3dError: if the material file is broken or a reverberation time is out of reach.
    """
    table = read_material_file(acoustics.materials) if acoustics.materials is not None else None
    known = labelled(mesh, found, annotations, table, acoustics.surfaces)
    rows, rooms = surface_table(known, found), [room for room, _ in found]
    mesh = _decimated(known.mesh, rooms)
    backing = backing_of(mesh.acoustic_positions.astype(np.float64), rooms)
    floors = {FLOOR_OF_ROOM.get(room.name, MATERIAL_OF["floor"]) for room in rooms}
    usual = {**MATERIAL_OF, "floor": floors.pop() if len(floors) == 1 else MATERIAL_OF["floor"], **acoustics.surfaces}
    triangles = np.concatenate([mesh.acoustic_positions, backing.triangles.astype(np.float32)])
    labels = (*mesh.acoustic_labels, *(usual[place] for place in backing.places.tolist()))
    decays: tuple[RoomDecay, ...] = ()
    if annotations is None or times:
        held = annotations is None and acoustics.furnished
        labels, decays = match_rooms(triangles.astype(np.float64), labels, rooms, times, usual=held)
    mesh = replace(mesh, acoustic_positions=triangles, acoustic_labels=labels)
    return mesh, SoundReport(rows, decays, backing.escaped)


def similarity(rotation: NDArray[np.float64], scale: float = 1.0) -> NDArray[np.float64]:
    """(4, 4) float64: p → rotation · (scale · p), as `Mesh.transformed` moves the mesh."""
    out = np.eye(4)
    out[:3, :3] = scale * rotation
    return out


def _placed(path: Path, loaded: ScanMesh, rotation: NDArray[np.float64], scale: float) -> ScanMesh:
    """A mesh in the world's axes and metres.

    Raises:
        Avs3dError: if it reaches too far.
    """
    mesh = loaded.mesh.transformed(rotation, np.zeros(3), scale)
    reach = float(np.abs(mesh.bounds).max())
    if reach > FARTHEST:
        raise Avs3dError(
            f"{path}: reaches {reach:,.0f} m from its origin; expected at most {FARTHEST:,.0f} m; is it in "
            "millimetres, or has it a stray vertex? repair or rescale it"
        )
    return ScanMesh(mesh, loaded.dense and loaded.dense.transformed(rotation, np.zeros(3), scale))


def _files(name: str, source: str | Path | ScanFiles) -> ScanFiles:
    if isinstance(source, ScanFiles):
        return source
    path = Path(source)
    if path.is_file():
        return scan_files_of(path)
    if path.is_dir():
        return find_scan_files(name, path)
    raise Avs3dError(f"scan {name}: {path} does not exist; expected its mesh file, or a folder that holds it")


def _room(what: str, label: str, box: ArrayLike, mesh: Mesh) -> Room:
    try:
        corners = np.asarray(box, dtype=np.float64)
    except (TypeError, ValueError):
        corners = np.zeros(0)
    if corners.shape != (2, 3) or not np.isfinite(corners).all():
        raise Avs3dError(f"{what}: its box is {box!r}; expected the lowest and highest corner [[x, y, z], [x, y, z]]")
    if (corners[1] - corners[0] < 0.5).any():
        raise Avs3dError(
            f"{what}: its box {corners.tolist()} is thinner than 0.5 m; expected metres, lowest corner first"
        )
    bounds = mesh.bounds
    if (corners[0] >= bounds[1]).any() or (corners[1] <= bounds[0]).any():
        where = np.round(bounds.astype(np.float64), 2).tolist()
        raise Avs3dError(f"{what}: its box {corners.tolist()} lies outside the scan, which spans {where}")
    low, high = ((float(c[0]), float(c[1]), float(c[2])) for c in corners)
    return Room(label, low, high)


def _decimated(mesh: Mesh, rooms: Sequence[Room]) -> Mesh:
    """``mesh`` with an acoustic twin of few faces: finer in and around the rooms than in the rest of the house."""
    triangles, labels = mesh.acoustic_positions.astype(np.float64), np.array(mesh.acoustic_labels)
    if len(triangles) <= ACOUSTIC_FACES:
        return mesh
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    near = np.zeros(len(triangles), dtype=bool)
    for room in rooms:
        near |= ((low <= np.array(room.high) + _AROUND) & (high >= np.array(room.low) - _AROUND)).all(axis=1)
    pieces = [
        clustered(triangles[own], labels[own], most)
        for own, most in ((near, ACOUSTIC_FACES), (~near, ACOUSTIC_FACES_BEYOND))
        if own.any()
    ]
    return replace(
        mesh,
        acoustic_positions=np.concatenate([piece[0] for piece in pieces]).astype(np.float32),
        acoustic_labels=tuple(label for piece in pieces for label in piece[1]),
    )


def _on_floor(room: Room, floor: float) -> Room:
    """The room with its box on the floor that was found: boxes are drawn by hand, and everything counts from there."""
    x, y, z = room.low
    return replace(room, low=(x, round(floor, 4) + 0.0, z)) if abs(floor - y) <= _FLOOR_SLACK else room


def _usable(support: Support, annotations: Annotations) -> bool:
    """Whether things may stand on a top by what it is: seats, beds and basins are level, too."""
    if support.kind in ("floor", "wall"):
        return True
    u, v = np.asarray(support.u), np.asarray(support.v)
    points = np.array([np.asarray(support.origin) + a * u + b * v for a in _SHARES for b in _SHARES])
    owners = annotations.owners(points)
    seats = [no_table(annotations.objects[number]) for number in owners if number >= 0]
    return not seats or sum(seats) < len(seats) / 2


def _read_annotations(files: ScanFiles, rotation: NDArray[np.float64]) -> Annotations | None:
    """The annotations of a scan, or None where it has none; ``rotation`` (3, 3) takes the file's axes to the world's.

    Raises:
        Avs3dError: if a file of them is broken.
    """
    if files.house is not None:
        return read_mp3d(files.house, files.semantic_mesh, rotation)
    if files.semantic_txt is not None:
        return read_hm3d(files.semantic_txt, files.semantic_mesh, rotation)
    return None
