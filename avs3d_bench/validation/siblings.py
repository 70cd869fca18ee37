"""Groups of part_3: siblings share home, objects, path and pictures, and differ in sound alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from avs3d_bench.commands.report import Problem
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import InstanceRecord, ObservationRecord
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError

#: Folders and files that are the same, byte for byte, in all siblings.
SHARED = (*(f"{folder}/" for folder in layout.SIBLING_FOLDERS), layout.SPLITS_JSON)


def check_groups(records: Mapping[str, ObservationRecord], keys: frozenset[str]) -> Iterator[Problem]:
    """Hold each sibling to the first of its group.

    The sha256 of observation.json are compared; that files have them is what `--deep` checks of each observation.

    Args:
        records: the observation.json of every observation that has one that can be read, by key.
        keys: keys of all observations of the dataset.
    """
    for key, record in sorted(records.items()):
        if record.group is None or record.group == key:
            continue
        where = f"{key}/{layout.OBSERVATION_JSON}"
        first = records.get(record.group)
        if first is None:
            if record.group not in keys:
                text = f"group {record.group} is not in this dataset: its pictures cannot be compared"
                yield Problem("warning", where, text)
            continue
        if first.group != first.key:
            text = f"group {first.key} is itself in the group {first.group}; expected the key of the first, no chain"
            yield Problem("error", where, text)
            continue
        for path, text in (*_records(record, first), *_files(record, first)):
            yield Problem("error", f"{key}/{path}", text)
    yield from _shared_takes(records)


def _records(record: ObservationRecord, first: ObservationRecord) -> Iterator[tuple[str, str]]:
    where = layout.OBSERVATION_JSON
    of_group = f"that of {first.key}, the first of its group"
    for name in ("seed", "intrinsics", "vision", "categories"):
        mine, other = getattr(record, name), getattr(first, name)
        if mine != other:
            yield where, f"{name} differs from {of_group}"
    if len(record.frames) != len(first.frames):
        yield where, f"{len(record.frames)} frames, {len(first.frames)} in {first.key}, the first of its group"
    for number, (frame, other_frame) in enumerate(zip(record.frames, first.frames, strict=False)):
        if (frame.time, frame.pose) != (other_frame.time, other_frame.pose):
            yield where, f"frames[{number}]: time or pose differs from {of_group}"
            break  # the others most likely differ as well
    mine_by_id = {instance.id: _placed(instance) for instance in record.instances}
    others_by_id = {instance.id: _placed(instance) for instance in first.instances}
    for number in sorted(mine_by_id.keys() | others_by_id.keys()):
        if mine_by_id.get(number) != others_by_id.get(number):
            yield where, f"instance {number} differs from {of_group}; expected the same but for sounding"


def _placed(instance: InstanceRecord) -> InstanceRecord:
    """The instance without what siblings differ in."""
    return instance.model_copy(update={"sounding": False})


def _files(record: ObservationRecord, first: ObservationRecord) -> Iterator[tuple[str, str]]:
    mine = {path: digest for path, digest in record.files.items() if path.startswith(SHARED)}
    others = {path: digest for path, digest in first.files.items() if path.startswith(SHARED)}
    for path in sorted(mine.keys() | others.keys()):
        if path not in mine:
            yield path, f"is in {first.key}, the first of its group, but not here"
        elif path not in others:
            yield path, f"is not in {first.key}, the first of its group"
        elif mine[path] != others[path]:
            yield path, f"differs from that of {first.key}, the first of its group; expected the same bytes"


def _shared_takes(records: Mapping[str, ObservationRecord]) -> Iterator[Problem]:
    """Siblings with the same sound: who compares their files knows what sounds without listening.

    Variants share the takes of their original by design, and are not compared with it.
    """
    owners: dict[tuple[str, str], ObservationRecord] = {}
    for key, record in sorted(records.items()):
        if record.group is None:
            continue
        found: dict[str, list[str]] = {}
        for path, digest in _sounding_files(record):
            other = owners.setdefault((record.group, digest), record)
            if _take_of(other) != _take_of(record):
                found.setdefault(other.key, []).append(path)
        for other_key, paths in found.items():
            more = f" (so have {len(paths) - 1} more files)" if len(paths) > 1 else ""
            text = (
                f"same bytes as a clip of its sibling {other_key}{more}: comparing files tells what sounds; expected a "
                "take of its own; generate the group again"
            )
            yield Problem("warning", f"{key}/{paths[0]}", text)


def _take_of(record: ObservationRecord) -> str:
    """Key of the observation whose takes it plays."""
    return record.variant_of or record.key


def _sounding_files(record: ObservationRecord) -> Iterator[tuple[str, str]]:
    """Path and sha256 of the clips and stems in which something can be heard."""
    for index, frame in enumerate(record.frames):
        paths = [layout.audio_path(layout.BINAURAL, index)] if max(frame.rms_left, frame.rms_right) > 0 else []
        paths += [layout.stem_path(entry.source, index) for entry in frame.audible or ()]
        yield from ((path, record.files[path]) for path in paths if path in record.files)


def same_files(observation: Observation, record: ObservationRecord) -> frozenset[str]:
    """The files of a sibling that are hard links to those of the first of its group, and recorded with their digests.

    What is checked of such a file alone is checked with the first; in a copy without hard links there are none.
    """
    if record.group is None or record.group == record.key:
        return frozenset()
    try:
        first = Observation(observation.root, record.group)
        digests = first.record.files if first.record and first.record.group == record.group else {}
    except Avs3dError:
        return frozenset()  # the first of the group is named itself
    return frozenset(
        path
        for path, digest in record.files.items()
        if path.startswith(SHARED) and digests.get(path) == digest and _same_file(observation, first, path)
    )


def _same_file(observation: Observation, first: Observation, path: str) -> bool:
    try:
        return (observation.path / path).samefile(first.path / path)
    except OSError:
        return False  # one is missing: already named
