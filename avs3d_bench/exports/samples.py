"""The samples that all exports write: one per frame, with its facts as JSON and its files unchanged.

A sample's key is ``<observation key>/<frame name>``, e.g. ``part_1/apartment_1/kitchen/1/frame_007``. Pictures and
sound are never re-encoded. What an observation does not have (the official release has no observation.json, instance
masks, …) is absent from its samples: no member, and None in the facts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

from avs3d_bench import layout, media
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.schema import InstanceRecord
from avs3d_bench.taxonomy import PARTS

SplitChoice = Literal["train", "test", "all"]
SPLIT_CHOICES: tuple[SplitChoice, ...] = get_args(SplitChoice)
#: Name of the split of frames that an official release lists in neither split; only in ``all``.
UNLISTED = "unlisted"


@dataclass(frozen=True)
class Kind:
    """A kind of file that belongs to a frame.

    Attributes:
        folder: in the observation.
        member: the name by which an export calls it; its last suffix is the file format.
        what: one line for readers.
    """

    folder: str
    member: str
    what: str

    def file(self, observation: Path, name: str, index: int) -> Path:
        """The file of the frame ``name`` (number ``index``) below the folder of its observation."""
        audio = self.folder in (layout.BINAURAL, layout.MONO, layout.RIRS)
        stem = layout.audio_name(index) if audio else name
        return observation / self.folder / f"{stem}.{self.member.rpartition('.')[2]}"


#: What is exported where it exists, in the order of members in a sample.
KINDS = {
    "rgb": Kind(layout.INPUT, "rgb.png", "RGB picture, 8 bit"),
    "binaural": Kind(layout.BINAURAL, "binaural.wav", "one second of binaural sound, 44.1 kHz, channel 0 left"),
    "mask": Kind(layout.SEMANTIC_MASKS, "mask.png", "mask of the sounding instance, 0 or 255, visible pixels"),
    "instances": Kind(layout.INSTANCE_MASKS, "instances.png", "instance ids, grey, 8 or 16 bit, 0 = the home"),
}
#: What `--with` adds.
EXTRA_KINDS = {
    "depth": Kind(layout.DEPTH, "depth.png", "depth along the optical axis, 16-bit millimetres, 0 = nothing met"),
    "mono": Kind(layout.MONO, "mono.wav", "two seconds of the clip's mono mix, 44.1 kHz"),
    "rirs": Kind(layout.RIRS, "rir.npz", "binaural room impulse response (2, n), with its sample rate"),
}
ALL_KINDS = KINDS | EXTRA_KINDS
_RELEASE_RGB = Kind(layout.IMAGES, "rgb.png", KINDS["rgb"].what)


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


def check_output(dataset: Dataset, output: str | Path) -> None:
    """Refuse to write a description over the dataset it describes.

    Raises:
        UsageError: if ``output`` is a folder, dataset.json, or lies among the observations.
    """
    path, root = Path(output).resolve(), dataset.root.resolve()
    if path.is_dir():
        raise UsageError(f"{output}: a folder; expected a file name")
    inside = path.relative_to(root).parts if path.is_relative_to(root) else ("",)
    if inside[0] in (*PARTS, layout.DATASET_JSON):
        raise UsageError(f"{output}: would change the dataset; choose a name of its own beside {layout.DATASET_JSON}")


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


def file_kinds(observation: Observation, names: Sequence[str]) -> dict[str, Kind]:
    """Which of the named kinds the observation has a folder of; pictures of a release may lie in `images/` alone."""
    found = {}
    for name in names:
        kind = ALL_KINDS[name]
        if name == "rgb" and not (observation.path / kind.folder).is_dir():
            kind = _RELEASE_RGB
        if (observation.path / kind.folder).is_dir():
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
    kinds = file_kinds(observation, (*KINDS, *check_extras(extras)))
    recorded = observation.record.files if observation.record else {}
    out = []
    for frame in frames_of(observation, split):
        if names is not None and frame.name not in names:
            continue
        members = tuple(
            _member(kind, kind.file(observation.path, frame.name, frame.index), observation, recorded)
            for kind in kinds.values()
        )
        key = f"{observation.key}/{frame.name}"
        out.append(Sample(key, frame.split or UNLISTED, frame_facts(frame), members))
    return out


def _member(kind: Kind, path: Path, observation: Observation, recorded: dict[str, str]) -> Member:
    try:
        size = path.stat().st_size
    except OSError:
        raise Avs3dError(f"{path}: missing; expected a file, since {path.parent.name}/ exists") from None
    # Only the official release, which records no hashes, is read twice.
    known = recorded.get(path.relative_to(observation.path).as_posix())
    return Member(kind.member, path, size, known or media.sha256_file(path))


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


def frame_facts(frame: Frame) -> dict[str, Any]:
    """All facts of a frame, as JSON types; None for those that its observation does not have.

    Units and axes are the dataset's: metres, degrees, Y up, camera-to-world (w, x, y, z), azimuth positive right.
    ``source_position`` and ``sounding_position``/``sounding_rotation`` are those at the frame's time, moving or not.
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
    there = mine.instance_pose
    return facts | {
        "source_position": list(record.source_at(mine)),
        "source_moves": record.moves,
        "sounding_instance": record.sounding.id,
        "sounding_position": list(there.position if there else record.sounding.position),
        "sounding_rotation": list(there.rotation if there else record.sounding.rotation),
        "instances": [instance_facts(instance) for instance in record.instances],
        "t30": record.acoustics.t30,
        "variant_of": record.variant_of,
    }
