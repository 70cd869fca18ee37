"""The manifest: a YAML file that lists what to generate. Every field is checked before generation begins.

Start reading at `Manifest`; `generators.manifest.reading` reads the file, `generators.plan` turns a manifest into one
plan per observation.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    ModelWrapValidatorHandler,
    Tag,
    model_validator,
)

from avs3d_bench.contract.layout import observation_key
from avs3d_bench.contract.schema import Category, Part, Room
from avs3d_bench.contract.taxonomy import MOST_OWN_CATEGORIES, PART_3, check_room
from avs3d_bench.errors import UsageError, excerpt
from generators.core.limits import FRAMES, MOST_INDEX, MOST_ORDER, SIZE, SOURCE_LEVEL, HeadName
from generators.manifest.categories import CategoryName, CategorySpec, Number, check_name, declared, missing_files
from generators.manifest.messages import Fault, FieldError, listed
from generators.manifest.variants import resolve_variants
from generators.options import DEFAULT_AUDIO

#: Largest coordinate of a room's box (m): far beyond any home, and small enough for millimetres in single precision.
FARTHEST = 10_000.0
#: Range of the metres in a unit of a scan's file: from tenths of a millimetre to a hundred metres.
SCAN_SCALE = (1e-4, 100.0)
#: Largest number of silent objects in a room; no room has places for more.
MOST_SILENT = 16
#: Largest number of identical objects, and of sources of a part_3 observation.
MOST_COPIES, MOST_SOURCES = 4, 8
#: Least and greatest scale of the absorption, and level of all sources above the background (dB).
ABSORPTION_SCALE, SNR_DB = (0.05, 20.0), (-30.0, 80.0)
#: Range of measured reverberation times (s).
T30 = (0.1, 3.0)
#: Shortest time for which a source sounds or pauses (s): far longer than the ramps at both ends.
SHORTEST_SOUND = 0.05
#: Largest number of intervals of a programme: more do not fit into the longest observation.
MOST_INTERVALS = round(FRAMES[1] / SHORTEST_SOUND)
#: Greatest length of a name.
LONGEST_SLUG = 200
_SLUG = re.compile(rf"[A-Za-z0-9][A-Za-z0-9._-]{{0,{LONGEST_SLUG - 1}}}")
#: Tolerance of the shortest interval (s): 0.15 − 0.1 is a little less than 0.05 in floating point.
ROUNDING = 1e-9


def _one_line(value: str) -> str:
    if not value.strip():
        raise ValueError(f"is empty (found {value!r}); expected a text")
    if len(f"{value}.".splitlines()) > 1:
        raise ValueError(f"has several lines (found {excerpt(value)}); expected one")
    return value


def _one_line_if_any(value: str) -> str:
    return _one_line(value) if value else value


def check_slug(value: str) -> str:
    """Return ``value`` if it may name a manifest, a home or an engine.

    Raises:
        ValueError: in words.
    """
    if not _SLUG.fullmatch(value):
        raise ValueError(
            f"{excerpt(value)} is no name; expected 1 to {LONGEST_SLUG} letters (a–z, A–Z), digits, '.', '_' or '-', "
            "the first a letter or a digit"
        )
    return value


def _axis(value: str) -> str:
    if value.lstrip("+-") not in ("x", "y", "z") or len(value) > 2:
        raise ValueError(f"{excerpt(value)} is no axis; expected x, y or z, with or without a sign, such as -z")
    return value


def _category(value: object) -> str:
    return check_name(value)


def _silent(value: object) -> str:
    return check_name(value, silent=True)


def _heard(value: object) -> str:
    return check_name(value, off_screen=True)


def _room(value: Any) -> str:
    return _named(check_room, value)


def _named(check: Callable[[str], str], value: str) -> str:
    """Return ``check(value)``; its error becomes a ValueError, to which pydantic adds the field's name."""
    try:
        return check(value)
    except UsageError as error:
        raise ValueError(str(error)) from None


def _ascending(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] > value[1]:
        raise ValueError(f"expected [lowest, highest] in dB, found [{value[0]:g}, {value[1]:g}]")
    return value


#: Level re the common loudness of all sources (dB).
Level = Annotated[Number, Field(ge=SOURCE_LEVEL[0], le=SOURCE_LEVEL[1])]
Coordinate = Annotated[Number, Field(ge=-FARTHEST, le=FARTHEST)]
Slug = Annotated[str, AfterValidator(check_slug)]
Line = Annotated[str, Field(max_length=1000), AfterValidator(_one_line)]
Source = Annotated[str, Field(max_length=1000), AfterValidator(_one_line_if_any)]
Axis = Annotated[str, AfterValidator(_axis)]
RoomName = Annotated[Room, BeforeValidator(_room)]
InstanceName = Annotated[str, BeforeValidator(_silent)]
SoundName = Annotated[str, BeforeValidator(_heard)]
Corner = tuple[Coordinate, Coordinate, Coordinate]
ReverberationTime = Annotated[Number, Field(ge=T30[0], le=T30[1])]


def _kind_of_time(value: object) -> str:
    """Tag of the type that `ReverberationTimes` has; `_finding` leaves it out of errors."""
    return "[rooms]" if isinstance(value, dict) else "[seconds]"


#: Of all rooms, or by room (s).
ReverberationTimes = Annotated[
    Annotated[ReverberationTime, Tag("[seconds]")] | Annotated[dict[RoomName, ReverberationTime], Tag("[rooms]")],
    Discriminator(_kind_of_time),
]
#: Names of procedural variants of a category; generators.plan checks that they exist.
Variants = Annotated[tuple[Line, ...], Field(min_length=1)]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class CameraSpec(_Model):
    """The camera: square frames of ``size`` pixels, ``hfov`` degrees wide, ``height`` metres above the floor."""

    size: Annotated[int, Field(ge=SIZE[0], le=SIZE[1])] = 1008
    hfov: Annotated[Number, Field(gt=10.0, lt=170.0)] = 90.0
    height: Annotated[Number, Field(gt=0.2, lt=2.4)] = 1.5
    frames: Annotated[int, Field(ge=FRAMES[0], le=FRAMES[1])] = 120


class LicenceSpec(_Model):
    """Licence and author of a file that the manifest names, and its source (default: the file's name)."""

    name: Line
    author: Line
    source: Source = ""


class ScanAcousticsSpec(_Model):
    """The reverberation of a scan's rooms: ``t30``, seconds at 500 Hz–1 kHz, as measured, of all rooms or by room.

    The absorption of all surfaces of the room is scaled until it has that time. Rooms that were not measured, in scans
    without annotations, are kept in the range of ``furnished`` rooms of their volume; false: as their materials are.
    """

    t30: ReverberationTimes | None = None
    furnished: bool = True


class ScanSpec(_Model):
    """A home: a procedural ``apartment`` from a seed, or a ``scan`` (HM3D, Matterport3D, any GLB, glTF, OBJ or PLY).

    For a scan, ``file`` names its mesh, or ``asset`` one of the lock file; without either, the mesh is found by the
    scan's id below the folder of scans. ``up`` and ``front`` are the file's axes that become +Y and +Z (default: those
    of its data set). ``turn`` (degrees) then turns it about +Y, counter-clockwise seen from above, so that its walls
    are parallel to the axes; ``scale`` is the number of metres in a unit of the file (default: 1). ``rooms``: room
    name → [[x, y, z], [x, y, z]], the lowest and highest corner of the room's inside (Y up, metres); rooms that are
    not given are taken from the scan's annotations. ``materials``: a SoundSpaces material file (JSON). ``surfaces``:
    place (floor, wall, ceiling, window, soft, shelves, curtain, furniture, other) → acoustic material, where the guess
    is wrong. ``acoustics``: the rooms' reverberation. ``splats``: the same place in 3D Gaussians (PLY of 3D-GS), in the
    frame of ``file``, for ``--vision splats``; found as ``file`` is.
    """

    #: Fields of a scan; all but ``file`` are later than the first version.
    _of_scans: ClassVar[tuple[str, ...]] = (
        "file",
        "asset",
        "up",
        "front",
        "turn",
        "scale",
        "materials",
        "surfaces",
        "acoustics",
        "splats",
    )

    source: Literal["apartment", "scan"] = "apartment"
    seed: int | None = Field(None, ge=0, strict=True)
    file: Line | None = None
    asset: Line | None = None
    up: Axis | None = None
    front: Axis | None = None
    turn: Annotated[Number, Field(ge=-180.0, le=180.0)] | None = None
    scale: Annotated[Number, Field(ge=SCAN_SCALE[0], le=SCAN_SCALE[1])] | None = None
    materials: Line | None = None
    splats: Line | None = None
    surfaces: dict[Line, Line] = {}
    acoustics: ScanAcousticsSpec | None = None
    rooms: dict[RoomName, tuple[Corner, Corner]] = {}
    licence: LicenceSpec | None = None

    @model_validator(mode="after")
    def _complete(self) -> ScanSpec:
        if self.source == "apartment" and self.seed is None:
            raise ValueError("an apartment needs a seed")
        own = [name for name in self._of_scans if getattr(self, name) not in (None, {})]
        if self.source == "apartment" and own:
            raise ValueError(f"an apartment has no {', '.join(own)}: only a scan has; write source: scan")
        if self.asset and (self.file or self.licence):
            raise ValueError(
                "asset names a scan of assets.lock.yaml, with its file and its licence; leave these two out here"
            )
        if (self.up is None) != (self.front is None):
            raise ValueError("up and front belong together: give both axes, or neither")
        if self.up and self.front and self.up[-1] == self.front[-1]:
            raise ValueError(f"up {self.up!r} and front {self.front!r} are not perpendicular")
        return self

    def identity(self) -> dict[str, Any]:
        """Content for digests: options that later versions added count only where they are set."""
        late = self._of_scans[1:]
        return {name: value for name, value in self.model_dump().items() if value not in (None, {}) or name not in late}


class AssetSpec(_Model):
    """A file beside the manifest, with its licence; or the id of an asset whose record is in the lock file."""

    file: Line | None = None
    asset: Line | None = None
    licence: LicenceSpec | None = None

    @model_validator(mode="after")
    def _either(self) -> Self:
        if (self.file is None) == (self.asset is None):
            raise ValueError("expected exactly one of file (with its licence) and asset (an id of assets.lock.yaml)")
        if self.file is not None and self.licence is None:
            raise ValueError(f"file {self.file!r} needs its licence: {{name: …, author: …, source: …}}")
        given = [name for name in self.model_fields_set if name not in ("file", "asset")]
        if self.asset is not None and given:
            raise ValueError(f"{min(given)} of asset {self.asset!r} comes from the lock file; leave it out here")
        return self

    def identity(self) -> dict[str, Any]:
        """Content for digests: options that later versions added count only where they are set."""
        return {name: value for name, value in self.model_dump().items() if value is not None or name != "asset"}


class ObjectSpec(AssetSpec):
    """A mesh that replaces a category's procedural models; ``height`` (m) is for a ``file`` (GLB or OBJ)."""

    height: Number | None = Field(None, gt=0.02, lt=5)


class SoundSpec(AssetSpec):
    """A recording (WAV, FLAC or OGG) that replaces a category's synthesised sound."""


class AcousticsSpec(_Model):
    """Absorption of all surfaces: α' = 1 − (1 − α)^``absorption_scale`` for each surface and octave.

    Eyring's reverberation time is proportional to 1/ln(1 − α), so it is divided by the scale: below 1 the room becomes
    more reverberant, above 1 less. Unlike a plain product, α' stays in [0, 1).
    """

    absorption_scale: Annotated[Number, Field(ge=ABSORPTION_SCALE[0], le=ABSORPTION_SCALE[1])] = 1.0


def _axis_vector(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(value):
        raise ValueError("[0, 0, 0] is no direction; expected [x, y, z] in the object's frame, such as [0, 0, 1]")
    return value


class DirectivitySpec(_Model):
    """Directivity of a source, turned as its object is (see docs/directivity.md); exactly one of these.

    The words ``omni``, alike in all directions, and ``auto``, the model of the source's category; ``cardioid``, its
    order, with ``axis`` (x, y, z in the object's frame: y up, z to the front) and ``omni_share``; ``file``, a SOFA file
    (FreeFieldDirectivityTF) or a table as CSV or NPZ, with its ``licence``.
    """

    word: Literal["omni", "auto"] | None = None
    cardioid: int | None = Field(default=None, ge=0, le=MOST_ORDER, strict=True)
    axis: Annotated[Corner, AfterValidator(_axis_vector)] = (0.0, 0.0, 1.0)
    omni_share: Annotated[Number, Field(ge=0.0, le=1.0)] = 0.5
    file: Line | None = None
    licence: LicenceSpec | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = [name for name in ("word", "cardioid", "file") if getattr(self, name) is not None]
        if len(kinds) != 1:
            raise ValueError(
                f"found {' and '.join(kinds) or 'nothing'}; expected exactly one of omni, auto, {{cardioid: ORDER}}, "
                "{file: FILE.sofa or .csv or .npz, licence: …}"
            )
        if self.cardioid is None and self.model_fields_set & {"axis", "omni_share"}:
            raise ValueError("axis and omni_share belong to cardioid; leave them out")
        if (self.file is None) != (self.licence is None):
            raise ValueError("file and licence belong together: {file: FILE.sofa, licence: {name: …, author: …}}")
        return self


def _directivity(value: object) -> object:
    """A word stands for itself."""
    if value in ("omni", "auto"):
        return {"word": value}
    if not isinstance(value, dict | DirectivitySpec) or (isinstance(value, dict) and "word" in value):
        raise ValueError(
            f"found {excerpt(value)}; expected omni, auto, {{cardioid: ORDER}} or {{file: FILE.sofa, licence: …}}"
        )
    return value


#: Alike in all directions.
OMNI = DirectivitySpec(word="omni")
Directed = BeforeValidator(_directivity)
SourceMotion = Literal["static", "path"]
Twins = Literal["apart", "alike"]
Agent = Literal["walking", "turning", "standing"]
Seconds = Annotated[Number, Field(ge=0.0, le=float(FRAMES[1]))]
Count = Annotated[int, Field(ge=1, le=MOST_COPIES, strict=True)]


def _kind_of_instances(value: object) -> str | None:
    """Tag of the type that `instances` has; errors name it, and `_finding` leaves it out."""
    return "[objects]" if isinstance(value, dict) else "[number]" if isinstance(value, int) else None


Instances = Annotated[
    Annotated[Count, Tag("[number]")] | Annotated[dict[InstanceName, Count], Tag("[objects]")],
    Discriminator(
        _kind_of_instances,
        custom_error_type="instances",
        custom_error_message="expected a number, or in part_3 the objects of the room, e.g. {microwave: 2}",
    ),
]


class BurstsSpec(_Model):
    """Random bursts: pause and sound take turns; each lasts as long as is drawn uniformly from its range (s)."""

    sound: tuple[Seconds, Seconds]
    pause: tuple[Seconds, Seconds]
    seed: int = Field(0, ge=0, strict=True)

    @model_validator(mode="after")
    def _ranges(self) -> Self:
        for name, (low, high) in (("sound", self.sound), ("pause", self.pause)):
            if not SHORTEST_SOUND <= low <= high:
                raise ValueError(f"{name} is [{low:g}, {high:g}]; expected [least, most] from {SHORTEST_SOUND} s on")
        return self


class TurnSpec(_Model):
    """Turn ``number`` of ``of`` sources that sound one after the other, ``seconds`` each, with a ``pause`` between."""

    number: int = Field(ge=1, strict=True)
    of: int = Field(ge=2, le=MOST_SOURCES, strict=True)
    seconds: Annotated[Seconds, Field(ge=SHORTEST_SOUND)]
    pause: Seconds = 0.0

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if self.number > self.of:
            raise ValueError(f"turn {self.number} of {self.of} does not exist; expected 1 to {self.of}")
        return self

    @property
    def start(self) -> float:
        """When the source sounds for the first time, seconds from the first frame."""
        return (self.number - 1) * (self.seconds + self.pause)


def _intervals(value: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    last = 0.0
    for start, end in value:
        if end - start < SHORTEST_SOUND - ROUNDING:
            what = "is empty" if end <= start else "is too short"
            raise ValueError(f"interval [{start:g}, {end:g}] {what}; expected at least {SHORTEST_SOUND} s")
        if start < last:
            raise ValueError(f"interval [{start:g}, {end:g}] begins before {last:g} s, where the one before ends")
        last = end
    return value


def _not_too_many(value: object) -> object:
    """Refuse a list that is too long before each of its entries is looked at."""
    if isinstance(value, list | tuple) and len(value) > MOST_INTERVALS:
        raise ValueError(f"{len(value):,} intervals; expected at most {MOST_INTERVALS:,}")
    return value


Intervals = Annotated[
    tuple[tuple[Seconds, Seconds], ...],
    Field(min_length=1),
    AfterValidator(_intervals),
    BeforeValidator(_not_too_many),
]


class ProgrammeSpec(_Model):
    """When a source sounds: exactly one of intervals [start, end) in seconds, random bursts, a turn."""

    intervals: Intervals | None = None
    bursts: BurstsSpec | None = None
    turn: TurnSpec | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = [name for name, value in self if value is not None]
        if len(kinds) != 1:
            raise ValueError(
                f"found {' and '.join(kinds) or 'nothing'}; expected exactly one of intervals, bursts, turn"
            )
        return self

    def check_within(self, seconds: int) -> None:
        """Check that it fits an observation of this length: it begins in it, and its intervals end in it.

        Raises:
            ValueError: with the time that was found and the one that was expected.
        """
        if self.intervals is not None:
            start, end = self.intervals[-1]
            if end > seconds:
                raise ValueError(
                    f"interval [{start:g}, {end:g}] ends after the last frame; expected at most {seconds} s"
                )
            return
        earliest = self.turn.start if self.turn else self.bursts.pause[0] if self.bursts else 0.0
        if earliest > seconds - SHORTEST_SOUND + ROUNDING:
            raise ValueError(f"programme begins at {earliest:g} s at the earliest; expected less than {seconds} s")


def _programme(value: object) -> object:
    """``always`` stands for None, a list for its intervals."""
    if value == "always":
        return None
    if isinstance(value, list | tuple):
        return {"intervals": value}
    if not isinstance(value, dict | ProgrammeSpec):
        raise ValueError(f"found {excerpt(value)}; expected always, [[start, end], …], {{bursts: …}} or {{turn: …}}")
    return value


class SourceSpec(_Model):
    """A source of a part_3 observation.

    ``instance``: which of the observation's objects of that category, from 1; drawn if it is left out. ``room``:
    another room, in which the source stands unseen; it has no instance then. ``programme``: ``always``,
    ``[[start, end], …]`` (s), ``{bursts: …}`` or ``{turn: …}``. ``gain_db``: level re the common loudness (dB).
    ``directivity``: see `DirectivitySpec`; the observation's if it is left out.
    """

    category: Annotated[Category, BeforeValidator(_heard)]
    instance: int | None = Field(None, ge=1, strict=True)
    room: RoomName | None = None
    programme: Annotated[ProgrammeSpec | None, BeforeValidator(_programme)] = None
    gain_db: Level = 0.0
    directivity: Annotated[DirectivitySpec | None, Directed] = None

    @model_validator(mode="after")
    def _seen_or_not(self) -> Self:
        if self.room is not None and self.instance is not None:
            raise ValueError(f"instance {self.instance} is an object of the observation's room; leave out it or room")
        if self.room is not None and self.directivity not in (None, OMNI):
            raise ValueError("a source in another room has no object, and faces nowhere; leave out directivity")
        if self.room is None:
            try:
                _category(self.category)
            except ValueError as error:
                raise FieldError((("category",), str(error))) from None
        return self


class BackgroundSpec(_Model):
    """Diffuse background ``snr_db`` below the mean level of all sources (see docs/part-3.md)."""

    kind: Literal["room_tone", "noise"]
    snr_db: Annotated[Number, Field(ge=SNR_DB[0], le=SNR_DB[1])]


#: Fields of an entry of part_3, and of the other parts.
_PART_3_FIELDS = ("sources", "background", "variant_of", "twins", "moving")
_ONE_SOURCE_FIELDS = ("category", "silent", "variant")


class ObservationSpec(_Model):
    """One observation: its place in the tree, its objects, what sounds.

    In part_1 and part_2, ``category`` is that of the sounding object, ``instances`` the number of its kind, and
    ``silent`` lists the categories of the other objects. In part_3, ``instances`` is a mapping of categories to numbers
    of identical objects, and ``sources`` says which of them sound, with a diffuse ``background`` if there is one.
    All objects of the categories in ``moving`` move, whether they sound or not.
    With ``twins: alike`` identical objects stand near one another, and the walk keeps their distances alike.

    The ``agent`` is walking, or it stays at a place of its walk: turning slowly, or standing.

    ``acoustics``, ``source_motion``, ``agent`` and ``directivity`` default to those of the manifest. ``like`` is the
    key of the observation that this one is an acoustic variant or a sibling of, ``variant_of`` that of which a part_3
    observation is a variant (see `Manifest`).
    """

    part: Part
    scan: Slug
    room: Annotated[Room, BeforeValidator(_room)]
    index: int = Field(ge=1, le=MOST_INDEX, strict=True)
    category: Annotated[Category, BeforeValidator(_category)] | None = None
    instances: Instances | None = None
    silent: tuple[InstanceName, ...] = Field((), max_length=MOST_SILENT)
    sources: tuple[SourceSpec, ...] | None = Field(None, max_length=MOST_SOURCES)
    background: BackgroundSpec | None = None
    twins: Twins = "apart"
    moving: tuple[InstanceName, ...] = Field((), max_length=MOST_SILENT)
    variant: Line | None = None
    acoustics: AcousticsSpec = AcousticsSpec()
    source_motion: SourceMotion = "static"
    agent: Agent = "walking"
    directivity: Annotated[DirectivitySpec, Directed] = OMNI
    like: Line | None = None
    variant_of: Line | None = None

    @model_validator(mode="after")
    def _counts(self) -> ObservationSpec:
        foreign = _ONE_SOURCE_FIELDS if self.is_part_3 else _PART_3_FIELDS
        surplus = [name for name in foreign if getattr(self, name) != type(self).model_fields[name].default]
        if surplus:
            raise ValueError(f"{surplus[0]} does not belong to {self.part}; leave it out, or write another part")
        if self.is_part_3:
            self._check_sources()
            return self
        if self.category is None:
            raise ValueError(f"category is missing; {self.part} has one source")
        if isinstance(self.instances, dict):
            raise ValueError(
                f"instances is a mapping; in {self.part} expected the number of objects of {self.category}"
            )
        if self.part == "part_1" and self.instances not in (None, 1):
            raise ValueError(f"part_1 is single-instance, found instances: {self.instances}; use part_2 or drop it")
        if self.part == "part_2" and (self.instances or 2) < 2:
            raise ValueError("part_2 is multi-instance, found instances: 1; expected 2, 3 or 4")
        if self.category in self.silent:
            raise ValueError(f"{self.category} is both category and silent; for silent twins use part_2 and instances")
        return self

    def _check_sources(self) -> None:
        """Check what a part_3 observation says.

        Raises:
            ValueError: naming the source.
        """
        if not isinstance(self.instances, dict) or not self.instances:
            raise ValueError("instances: expected the objects of the room, e.g. {microwave: 2, telephone: 1}")
        if sum(self.instances.values()) > MOST_SILENT:
            raise ValueError(f"instances: {sum(self.instances.values())} objects; expected at most {MOST_SILENT}")
        if self.sources is None:
            raise ValueError("sources is missing; expected a list, [] for silence")
        if self.source_motion != "static":
            raise ValueError(
                "source_motion belongs to part_1 and part_2; in part_3 name the categories that move, whether they "
                "sound or not: moving: [vacuum_cleaner, …]"
            )
        self._check_moving(self.instances)
        taken: dict[str, list[int | None]] = {}
        faults = [
            (("sources", number), fault)
            for number, source in enumerate(self.sources)
            if (fault := self._fault_of(source, taken.setdefault(source.category, [])))
        ]
        if faults:
            raise FieldError(*faults)

    def _check_moving(self, instances: dict[str, int]) -> None:
        """Check which categories move.

        Raises:
            ValueError: naming the category.
        """
        for name in self.moving:
            if name not in instances:
                raise ValueError(
                    f"moving: no {name} stands in this {self.room}; instances has {listed(tuple(instances))}"
                )
            if self.moving.count(name) > 1:
                raise ValueError(f"moving: {name} is listed twice")
        if self.moving and self.twins == "alike":
            raise ValueError(
                "moving and twins: alike exclude each other: what moves is not equally far away all the time"
            )

    def _fault_of(self, source: SourceSpec, among: list[int | None]) -> str:
        """The fault of a source; empty if there is none.

        Args:
            source: one of ``sources``.
            among: the instances of the sources of its category before it; its own is added.
        """
        assert isinstance(self.instances, dict)
        if source.room is not None:
            same = source.room == self.room
            return f"room {source.room} is the observation's own; name another, or leave it out" if same else ""
        there = self.instances.get(source.category, 0)
        if not there:
            found = listed(tuple(self.instances))
            return f"no {source.category} stands in this {self.room}; instances has {found}"
        if source.instance is not None and source.instance > there:
            return f"instance {source.instance} of {source.category} does not exist; expected 1 to {there}"
        if source.instance is not None and source.instance in among:
            return f"instance {source.instance} of {source.category} sounds already"
        among.append(source.instance)
        return f"{len(among)} sources, but there is only {there} × {source.category}" if len(among) > there else ""

    @property
    def is_part_3(self) -> bool:
        """Whether it belongs to part_3."""
        return self.part == PART_3

    @property
    def objects(self) -> dict[str, int]:
        """Category → number of objects in the room, sorted by category."""
        if isinstance(self.instances, dict):
            return dict(sorted(self.instances.items()))
        counts = {name: self.silent.count(name) for name in self.silent}
        return dict(sorted((counts | ({self.category: self.copies} if self.category else {})).items()))

    @property
    def sounding(self) -> tuple[SourceSpec, ...]:
        """Its sources; in part_1 and part_2 one of its ``category``, which always sounds."""
        if self.sources is None and self.category is not None:
            return (SourceSpec.model_construct(category=self.category),)  # the category is validated already
        return self.sources or ()

    def directivity_of(self, source: SourceSpec) -> DirectivitySpec:
        """The directivity of one of `sounding`; a source in another room has none, since it has no object."""
        return OMNI if source.room is not None else source.directivity or self.directivity

    @property
    def directed(self) -> bool:
        """Whether a source may be louder in one direction than in another."""
        return any(self.directivity_of(source) != OMNI for source in self.sounding)

    @property
    def heard(self) -> tuple[str, ...]:
        """Categories of all sources, sorted."""
        return tuple(sorted({source.category for source in self.sounding}))

    @property
    def key(self) -> str:
        """``part/scan/room/index``."""
        return observation_key(self.part, self.scan, self.room, self.index)

    @property
    def copies(self) -> int:
        """Number of instances of the category that sounds, in part_1 and part_2."""
        assert not isinstance(self.instances, dict)
        return self.instances or (1 if self.part == "part_1" else 2)

    def identity(self) -> dict[str, Any]:
        """Content for digests: options that later versions added count only where they are set."""
        usual: dict[str, Any] = {"acoustics": AcousticsSpec().model_dump(), "source_motion": "static", "twins": "apart"}
        usual["agent"] = "walking"
        usual["moving"] = ()
        usual |= dict.fromkeys(("like", "variant_of", "sources", "background"))
        usual["directivity"] = OMNI.model_dump()
        document = self.model_dump()
        for source in document["sources"] or ():
            if source["directivity"] is None:
                del source["directivity"]
        return {name: value for name, value in document.items() if name not in usual or value != usual[name]}


class Manifest(_Model):
    """A benchmark: its homes, its observations, its camera, and the files that replace procedural assets.

    An entry ``{like: KEY, index: 2, acoustics: {…}}`` is an acoustic variant of the observation KEY of the same
    manifest: it takes everything except index and acoustics from that entry, and all its random draws are those of
    KEY, so that both have the same pictures and the same source signal.

    In part_3 such an entry is a sibling of KEY: it may have its own ``sources`` and ``background``, too. What its
    sources play is its own.

    In part_3 an entry ``{variant_of: KEY, index: 3, acoustics: {…}, background: {…}}`` is a variant of KEY, which may
    be a sibling: the same sources play the same signals, and only acoustics and background differ.

    ``categories`` adds categories to the seven of the paper; each that is used needs ``objects``, and ``sounds`` if it
    sounds.

    ``audio`` names the acoustic engine that the benchmark is made with, unless another one is asked for; ``hrtf`` the
    head that hears with the tracer, unless another one is asked for.

    ``models`` restricts the procedural variants from which the objects of a category are drawn, ``voices`` names the
    devices by which its sound is synthesised. ``levels`` is the range from which the level of each source re the common
    loudness is drawn (dB), beside its ``gain_db``.

    ``version`` goes into dataset.json; ``notes`` is for readers; ``light`` is the quality of the baked light.
    ``source_motion``, ``agent``, ``directivity`` and ``acoustics`` hold for every entry that has none of its own.

    Raises:
        pydantic.ValidationError: by `Manifest.model_validate`; `read_manifest` names the file and its lines as well.

    Examples:
        >>> observation = {"part": "part_1", "scan": "flat", "room": "kitchen", "index": 1, "category": "microwave"}
        >>> manifest = Manifest.model_validate(
        ...     {"name": "mine", "seed": 7, "scans": {"flat": {"seed": 3}}, "observations": [observation]}
        ... )
        >>> manifest.camera
        CameraSpec(size=1008, hfov=90.0, height=1.5, frames=120)
        >>> manifest.observations[0].key, manifest.engine()
        ('part_1/flat/kitchen/1', 'tracer')
    """

    name: Slug
    version: Line = "1.0.0"
    seed: int = Field(ge=0, strict=True)
    camera: CameraSpec = CameraSpec()
    light: Literal["preview", "standard", "high"] = "standard"
    audio: Slug | None = None
    hrtf: HeadName | None = None
    scans: dict[Slug, ScanSpec]
    categories: dict[CategoryName, CategorySpec] = Field({}, max_length=MOST_OWN_CATEGORIES)
    models: dict[InstanceName, Variants] = {}
    voices: dict[SoundName, Variants] = {}
    levels: Annotated[tuple[Level, Level], AfterValidator(_ascending)] | None = None
    objects: dict[InstanceName, tuple[ObjectSpec, ...]] = {}
    sounds: dict[SoundName, tuple[SoundSpec, ...]] = {}
    notes: str = ""
    acoustics: AcousticsSpec = AcousticsSpec()
    source_motion: SourceMotion = "static"
    agent: Agent = "walking"
    directivity: Annotated[DirectivitySpec, Directed] = OMNI
    observations: tuple[ObservationSpec, ...] = Field(min_length=1)

    @model_validator(mode="wrap")
    @classmethod
    def _declare(cls, document: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Validate the rest with the categories that the manifest adds."""
        own = document.get("categories") if isinstance(document, dict) else None
        with declared(name for name in (own if isinstance(own, dict) else ()) if isinstance(name, str)):
            return handler(document)

    @model_validator(mode="before")
    @classmethod
    def _expand(cls, document: Any) -> Any:
        """Fill in the fields that entries take from the manifest, and variants from their original."""
        if not isinstance(document, dict) or not isinstance(document.get("observations"), list | tuple):
            return document
        shared = {
            name: document[name] for name in ("acoustics", "source_motion", "agent", "directivity") if name in document
        }
        entries, faults = resolve_variants(document["observations"], shared)
        if faults:
            raise FieldError(*faults)
        return document | {"observations": entries}

    def engine(self, asked: str | None = None) -> str:
        """The acoustic engine: the one that is asked for, else the manifest's, else `DEFAULT_AUDIO`."""
        return asked or self.audio or DEFAULT_AUDIO

    @model_validator(mode="after")
    def _consistent(self) -> Manifest:
        """Refuse what no field shows by itself, all of it at once."""
        faults = [*self._faults_of_models()]
        seen: set[str] = set()
        for number, entry in enumerate(self.observations):
            faults += [(("observations", number, *below), said) for below, said in self._faults_of(entry)]
            if entry.key in seen:
                faults.append((("observations", number), f"{entry.key} is listed twice"))
            seen.add(entry.key)
        if faults:
            raise FieldError(*faults)
        return self

    def _faults_of(self, entry: ObservationSpec) -> Iterator[Fault]:
        """Yield the faults of an observation: of its home, its programmes, the files of its categories, its variant."""
        if entry.scan not in self.scans:
            expected = listed(tuple(self.scans))
            yield ("scan",), f"{entry.key}: unknown scan {entry.scan!r}; expected {expected}"
        for number, source in enumerate(entry.sources or ()):
            try:
                if source.programme is not None:
                    source.programme.check_within(self.camera.frames)
            except ValueError as error:
                yield ("sources", number, "programme"), f"{entry.key}: {error}"
        for field, names, table in (("objects", entry.objects, self.objects), ("sounds", entry.heard, self.sounds)):
            for name in names:
                if name in self.categories and not table.get(name):
                    yield (), f"{entry.key}: {missing_files(name, field)}"
        allowed = self.models.get(entry.category or "", ())
        if allowed and entry.variant is not None and entry.variant not in allowed:
            yield (
                ("variant",),
                f"{entry.key}: variant {entry.variant!r} is not among models of {entry.category}; "
                f"expected one of {listed(allowed)}",
            )

    def _faults_of_models(self) -> Iterator[Fault]:
        """Variants and voices of a category that has files instead, and those that are listed twice."""
        for field, files_field, kind in (("models", "objects", "procedural models"), ("voices", "sounds", "voices")):
            for name, allowed in getattr(self, field).items():
                place = (field, name)
                if name in self.categories:
                    yield place, f"{name} is a category of this manifest and has no {kind}"
                if getattr(self, files_field).get(name):
                    yield place, f"the files in {files_field} replace the {field} of {name}; leave out one of both"
                twice = next((variant for variant in allowed if allowed.count(variant) > 1), None)
                if twice is not None:
                    yield place, f"{twice!r} is listed twice"
