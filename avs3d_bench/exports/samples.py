"""The samples that all exports write: one per frame, with its facts as JSON and its files unchanged.

A sample's key is ``<observation key>/<frame name>``, e.g. ``part_1/apartment_1/kitchen/1/frame_007``. Pictures and
sound are never re-encoded. What an observation does not have (the official release has no observation.json, instance
masks, …) is absent from its samples: no member, and None in the facts. Samples of part_3 have more facts
(`part_3_facts`) and members (the category mask, stems); those of the other parts do not depend on them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

from avs3d_bench.commands.outputs import Signature, check_apart, check_replaceable
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import FrameRecord, InstanceRecord, ObservationRecord, SourceRecord
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media

SplitChoice = Literal["train", "test", "all"]
SPLIT_CHOICES: tuple[SplitChoice, ...] = get_args(SplitChoice)
#: Name of the split of frames that an official release lists in neither split; only in ``all``.
UNLISTED = "unlisted"


@dataclass(frozen=True)
class FileKind:
    """A kind of file that belongs to a frame.

    Attributes:
        folder: in the observation.
        member: the name by which an export calls it; its last suffix is the file format.
        what: one line for readers.
        sources: names of the folders inside ``folder``, one file in each; None if the files lie in ``folder``.
    """

    folder: str
    member: str
    what: str
    sources: tuple[str, ...] | None = None

    def file(self, observation: Path, name: str, index: int, source: str | None = None) -> Path:
        """The file of the frame ``name`` (number ``index``) below the folder of its observation."""
        audio = self.folder in _AUDIO
        stem = layout.audio_name(index) if audio else name
        folder = observation / self.folder if source is None else observation / self.folder / source
        return folder / f"{stem}.{self.member.rpartition('.')[2]}"

    def files(self, observation: Path, name: str, index: int) -> dict[str, Path]:
        """Name of a member → file: one, or ``source_1.…`` for each source."""
        if self.sources is None:
            return {self.member: self.file(observation, name, index)}
        return {f"{each}.{self.member}": self.file(observation, name, index, each) for each in self.sources}


#: Folders whose files have frame numbers without padding.
_AUDIO = (
    layout.BINAURAL,
    layout.MONO,
    layout.RIRS,
    layout.STEMS,
    *(layout.clips_folder(name) for name in layout.RECEIVERS),
)
#: What is exported where it exists, in the order of members in a sample.
KINDS = {
    "rgb": FileKind(layout.INPUT, "rgb.png", "RGB picture, 8 bit"),
    "binaural": FileKind(layout.BINAURAL, "binaural.wav", "one second of binaural sound, 44.1 kHz, channel 0 left"),
    "mask": FileKind(layout.SEMANTIC_MASKS, "mask.png", "mask of the sounding instance, 0 or 255, visible pixels"),
    "instances": FileKind(layout.INSTANCE_MASKS, "instances.png", "instance ids, grey, 8 or 16 bit, 0 = the home"),
}
#: The same of part_3 alone; its ``mask`` marks every audible instance.
PART_3_KINDS = {
    "categories": FileKind(
        layout.CATEGORY_MASKS, "categories.png", "class ids of the audible instances, grey, 0 = none"
    ),
}
#: What `--with` adds.
EXTRA_KINDS = {
    "depth": FileKind(layout.DEPTH, "depth.png", "depth along the optical axis, 16-bit millimetres, 0 = nothing met"),
    "mono": FileKind(layout.MONO, "mono.wav", "two seconds of the clip's mono mix, 44.1 kHz"),
    "rirs": FileKind(layout.RIRS, "rir.npz", "binaural room impulse response (2, n), with its sample rate"),
    "stems": FileKind(layout.STEMS, "stem.wav", "one second of binaural sound of one source, or of the background"),
    "ambisonics": FileKind(
        layout.clips_folder(layout.AMBISONICS), "ambisonics.wav", "one second of ambisonics, 44.1 kHz, ACN, SN3D"
    ),
    "array": FileKind(
        layout.clips_folder(layout.ARRAY), "array.wav", "one second of a microphone array, 44.1 kHz, a channel each"
    ),
}
ALL_KINDS = KINDS | PART_3_KINDS | EXTRA_KINDS
_RELEASE_RGB = FileKind(layout.IMAGES, "rgb.png", KINDS["rgb"].what)


@dataclass(frozen=True)
class Member:
    """One file of a sample: its name, its path, its size in bytes and its sha256."""

    name: str
    path: Path
    size: int
    sha256: str

    def read(self) -> bytes:
        """The file's bytes, held against the sha256.

        Raises:
            Avs3dError: if the file is missing or is not the one that was planned with.
        """
        data = media.read_bytes(self.path)
        if media.sha256_bytes(data) != self.sha256:
            raise Avs3dError(
                f"{self.path}: its sha256 is not {self.sha256[:12]}… as recorded; "
                "the file is damaged or was changed: see `avs3d validate --deep`"
            )
        return data


@dataclass(frozen=True)
class Sample:
    """A frame to be exported.

    Attributes:
        key: ``<observation key>/<frame name>``.
        split: ``train``, ``test`` or ``unlisted``.
        facts: what is known of the frame, as JSON types (see `frame_facts`).
        members: its files, in a fixed order.
    """

    key: str
    split: str
    facts: dict[str, Any]
    members: tuple[Member, ...]

    @cached_property
    def json(self) -> bytes:
        """The facts as a JSON file."""
        return media.dump_json(self.facts).encode()


def check_extras(extras: Sequence[str]) -> tuple[str, ...]:
    """``extras`` in the order of `EXTRA_KINDS`, each once.

    Raises:
        UsageError: if one is unknown.
    """
    for name in extras:
        if name not in EXTRA_KINDS:
            raise UsageError(f"--with {name}: expected one of {', '.join(EXTRA_KINDS)}")
    return tuple(name for name in EXTRA_KINDS if name in extras)


def check_split(split: str) -> SplitChoice:
    """``split`` if it is one.

    Raises:
        UsageError: if it is none of train, test, all.
    """
    for known in SPLIT_CHOICES:
        if split == known:
            return known
    raise UsageError(f"split {split!r}: expected one of {', '.join(SPLIT_CHOICES)}")


def select(root: str | Path, only: Sequence[str] = ()) -> tuple[Dataset, tuple[str, ...]]:
    """The dataset and the keys of its observations that match one of the patterns (all where none is given).

    Raises:
        UsageError: if there is no dataset, or nothing matches.
    """
    dataset = Dataset(root)
    patterns = (only,) if isinstance(only, str) else tuple(only)
    keys = tuple(observation.key for observation in dataset.select(*patterns))
    if not keys:
        asked = f" matches {', '.join(patterns)}" if patterns else ""
        raise UsageError(f"{root}: none of {len(dataset)} observations{asked}; expected at least one")
    return dataset, keys


def check_output(dataset: Dataset, output: str | Path, own: Signature) -> None:
    """Refuse to write a description over the dataset it describes, or over a file that is no such description.

    Raises:
        UsageError: if ``output`` is a folder, dataset.json, lies among the observations, or has not this signature.
    """
    check_apart(Path(output), (dataset.root,))
    check_replaceable(output, (own,))


def frames_of(observation: Observation, split: SplitChoice) -> tuple[Frame, ...]:
    """The observation's frames in a split, in the order of time.

    Raises:
        Avs3dError: if the picture of a frame that camera_splits.json lists is missing.
    """
    lost = sorted(observation.splits.keys() - set(observation.frame_names))
    if lost:
        listed = f"{observation.path / layout.SPLITS_JSON}: lists {lost[0]}"
        more = f" (and {len(lost) - 1} more)" if len(lost) > 1 else ""
        raise Avs3dError(f"{listed}{more}, whose picture is missing; the dataset is not whole: see `avs3d validate`")
    return tuple(frame for frame in observation.frames if split in ("all", frame.split))


def has_part_3(keys: Iterable[str]) -> bool:
    """Whether an observation of part_3 is among these."""
    return any(layout.parse_key(key).is_part_3 for key in keys)


def described(kinds: Mapping[str, FileKind]) -> dict[str, str]:
    """Descriptions of the members of a sample for an index; a kind with a file per source has ``source_*.…`` too."""
    several = {f"source_*.{kinds[name].member}": kinds[name].what for name in _PER_SOURCE if name in kinds}
    return {kind.member: kind.what for kind in kinds.values()} | several


#: Kinds with a folder per source in part_3.
_PER_SOURCE = ("stems", "rirs")


def file_kinds(observation: Observation, names: Sequence[str]) -> dict[str, FileKind]:
    """Which of the named kinds the observation has a folder of; pictures of a release may lie in `images/` alone."""
    return kinds_among(names, observation.record, lambda folder: (observation.path / folder).is_dir())


def kinds_among(
    names: Sequence[str], record: ObservationRecord | None, there: Callable[[str], bool]
) -> dict[str, FileKind]:
    """Which of the named kinds an observation has.

    Args:
        names: of `ALL_KINDS`.
        record: of the observation; None for the official release.
        there: tells whether the observation has files in a folder.
    """
    found = {}
    for name in names:
        kind = ALL_KINDS[name]
        if name == "rgb" and not there(kind.folder):
            kind = _RELEASE_RGB
        if name in _PER_SOURCE and record is not None and record.is_part_3:
            sources = tuple(source.id for source in record.sources or ())
            noise = (layout.BACKGROUND,) if name == "stems" and record.background is not None else ()
            kind = replace(kind, sources=sources + noise)
        if there(kind.folder):
            found[name] = kind
    return found


def samples_of(
    observation: Observation,
    split: SplitChoice,
    extras: Sequence[str] = (),
    names: frozenset[str] | None = None,
) -> list[Sample]:
    """The samples of an observation (of the frames ``names`` alone, if given), in the order of time.

    Raises:
        Avs3dError: if a frame lacks a file of a kind that its observation has.
    """
    kinds = file_kinds(observation, (*KINDS, *PART_3_KINDS, *check_extras(extras)))
    recorded = observation.record.files if observation.record else {}
    out = []
    for frame in frames_of(observation, split):
        if names is not None and frame.name not in names:
            continue
        members = tuple(
            _member(name, path, observation, recorded)
            for kind in kinds.values()
            for name, path in kind.files(observation.path, frame.name, frame.index).items()
        )
        key = f"{observation.key}/{frame.name}"
        out.append(Sample(key, frame.split or UNLISTED, frame_facts(frame), members))
    return out


def _member(name: str, path: Path, observation: Observation, recorded: dict[str, str]) -> Member:
    try:
        size = path.stat().st_size
    except OSError:
        raise Avs3dError(f"{path}: missing; expected a file, since {path.parent.name}/ exists") from None
    # Only the official release, which records no hashes, is read twice.
    known = recorded.get(path.relative_to(observation.path).as_posix())
    return Member(name, path, size, known or media.sha256_file(path))


def instance_facts(instance: InstanceRecord) -> dict[str, Any]:
    """An instance as plain data; its licence is among the dataset's attributions."""
    low, high = instance.bounds
    return {
        "id": instance.id,
        "category": instance.category,
        "sounding": instance.sounding,
        "position": list(instance.position),
        "rotation": list(instance.rotation),
        "low": list(low),
        "high": list(high),
        "asset": instance.asset,
    }


def _place_of(record: ObservationRecord, frame: FrameRecord, instance: InstanceRecord) -> dict[str, Any]:
    """Position and rotation of an instance of part_3 at a frame's time, if they are others than at the first frame."""
    if not record.is_part_3 or instance.id not in record.moving_instances:
        return {}
    pose = record.pose_at(frame, instance.id)
    return {"position": list(pose.position), "rotation": list(pose.rotation)}


def source_facts(source: SourceRecord) -> dict[str, Any]:
    """A source of part_3 as plain data; its licence is among the dataset's attributions."""
    return {
        "id": source.id,
        "instance": source.instance,
        "category": source.category,
        "room": source.room,
        "position": list(source.position),
        "programme": [list(interval) for interval in source.programme],
        "gain_db": source.gain_db,
        "asset": source.asset,
    }


def part_3_facts(record: ObservationRecord, frame: FrameRecord) -> dict[str, Any]:
    """Facts that only a frame of part_3 has.

    ``categories`` names the classes: class id c of a category mask is number c − 1 of the list.
    """
    return {
        "group": record.group,
        "sources": [
            source_facts(source) | {"position": list(record.source_at(frame, source))}
            for source in record.sources or ()
        ],
        "audible": [heard.model_dump() for heard in frame.audible or ()],
        "background": record.background.model_dump() if record.background else None,
        "categories": list(record.class_ids),
    }


def frame_facts(frame: Frame) -> dict[str, Any]:
    """All facts of a frame, as JSON types; None for those that its observation does not have.

    Units and axes are the dataset's: metres, degrees, Y up, camera-to-world (w, x, y, z), azimuth positive right.
    ``source_position`` and ``sounding_position``/``sounding_rotation`` are those at the frame's time, moving or not; in
    part_3 they and the direction are those of the first source, None where there is none (or no instance of the room),
    and ``position`` and ``rotation`` of sources and ``instances`` are those at the frame's time as well.
    Frames of part_3 have the facts of `part_3_facts` as well, those heard by more than the two ears ``receivers``.
    """
    observation, place = frame.observation, frame.observation.place
    camera, pose = observation.intrinsics, frame.pose if frame.has_pose else None
    facts: dict[str, Any] = {
        "key": observation.key,
        "frame": frame.name,
        "index": frame.index,
        "split": frame.split or UNLISTED,
        "part": place.part,
        "scan": place.scan,
        "room": place.room,
        "category": observation.category,
        "width": camera.width,
        "height": camera.height,
        "intrinsics": [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]],
        "position": list(pose.position) if pose else None,
        "rotation": list(pose.rotation) if pose else None,
        "camera_to_world": pose.matrix.tolist() if pose else None,
    }
    record, mine = observation.record, frame.record
    measured = ("time", "azimuth", "elevation", "distance", "line_of_sight", "visible_pixels", "rms_left", "rms_right")
    facts |= {name: getattr(mine, name) if mine else None for name in measured}
    if record is None or mine is None:
        empty = ("source_position", "source_moves", "sounding_instance", "sounding_position", "sounding_rotation")
        return facts | dict.fromkeys((*empty, "instances", "t30", "variant_of"))
    sounding = record.first_instance
    there = record.pose_at(mine, sounding.id) if sounding else None
    facts |= {
        "source_position": list(record.source_at(mine)) if record.source_position else None,
        "source_moves": any(map(record.source_moves, record.sound_sources[:1])),
        "sounding_instance": sounding.id if sounding else None,
        "sounding_position": list(there.position) if there else None,
        "sounding_rotation": list(there.rotation) if there else None,
        "instances": [instance_facts(instance) | _place_of(record, mine, instance) for instance in record.instances],
        "t30": record.acoustics.t30,
        "variant_of": record.variant_of,
    }
    if record.acoustics.receivers:
        facts["receivers"] = receiver_facts(record)
    return facts | part_3_facts(record, mine) if record.is_part_3 else facts


def receiver_facts(record: ObservationRecord) -> dict[str, Any]:
    """The receivers beside the two ears: name → channels, as plain data."""
    return {name: found.model_dump(mode="json") for name, found in record.acoustics.receivers.items()}
