"""The shallow checks of one observation: files, sizes and formats from headers, splits, schema, geometry of the record.

Nothing is decoded here; see `validation.deep`.
"""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

from pydantic import ValidationError

from avs3d_bench.contract import layout
from avs3d_bench.contract.layout import Part3Contents
from avs3d_bench.contract.schema import CameraSplits, ObservationRecord, describe
from avs3d_bench.dataset import Observation, parse_splits
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from avs3d_bench.formats.files import require_regular
from avs3d_bench.validation.findings import Findings
from avs3d_bench.validation.records import check_record
from avs3d_bench.validation.sources import has_stems

_OFFICIAL_FOLDERS = (layout.INPUT, layout.BINAURAL, layout.MONO, layout.SEMANTIC_MASKS)


def list_files(observation: Observation) -> set[str]:
    """All files of an observation, relative, with forward slashes."""
    found: set[str] = set()
    for folder, _, names in os.walk(observation.path):
        inside = Path(folder).relative_to(observation.path)
        found.update((inside / name).as_posix() for name in names)
    return found


def load_record(observation: Observation, findings: Findings) -> ObservationRecord | None:
    """Read observation.json, naming every field that does not fit."""
    path = observation.path / layout.OBSERVATION_JSON
    try:
        return ObservationRecord.model_validate_json(media.read_bytes(path))
    except ValidationError as error:
        for line in describe(error):
            findings.add(layout.OBSERVATION_JSON, line)
    except Avs3dError as error:
        findings.take(layout.OBSERVATION_JSON, error)
    return None


def check_structure(observation: Observation, *, ours: bool) -> tuple[Findings, ObservationRecord | None, set[str]]:
    """The shallow checks.

    Args:
        observation: what to check.
        ours: a tree of this toolkit (everything of DESIGN §4 must be there), else the official release.

    Returns:
        the problems, the record if it could be read, and the files found (by-products of the released pipeline apart).
    """
    findings = Findings(observation)
    files = _without_byproducts(list_files(observation), findings)
    irregular = _check_kinds(observation, files, findings)
    record = load_record(observation, findings) if ours else None
    if ours:
        frames = len(record.frames) if record else len(observation.frame_names)
        _check_files_of_ours(observation, record, files, frames, findings)
    else:
        _check_files_of_release(observation, files, findings)
    _check_splits(observation, findings, ours=ours)
    _check_headers(observation, record, files, findings, ours=ours)
    _check_images(observation, files, findings, ours=ours)
    if record:
        check_record(observation, record, files, findings, irregular)
    return findings, record, files


def _check_kinds(observation: Observation, files: set[str], findings: Findings) -> set[str]:
    """Name what is no regular file, also where only --deep would open it; returns these."""
    irregular = set()
    for path in sorted(files):
        try:
            require_regular(observation.path / path)
        except Avs3dError as error:
            findings.take(path, error)
            irregular.add(path)
    return irregular


def _without_byproducts(files: set[str], findings: Findings) -> set[str]:
    """The files of the dataset; for output of the released pipeline there is one note per folder."""
    made = {path: top for path in files if (top := layout.released_byproduct(path)) is not None}
    for top, count in sorted(Counter(made.values()).items()):
        what = f"{count} file{'' if count == 1 else 's'}, " if top.endswith("/") else ""
        findings.add(top.rstrip("/"), f"{what}by-product of the released pipeline; no part of the dataset", "note")
    return files - set(made)


def _check_missing(expected: set[str], files: set[str], findings: Findings) -> None:
    missing = expected - files
    for folder in sorted({path.rsplit("/", 1)[0] for path in missing if "/" in path}):
        inside = {path for path in expected if path.rsplit("/", 1)[0] == folder}
        if len(inside) > 1 and inside <= missing:
            findings.add(folder, f"missing folder; expected {len(inside)} files in it")
            missing -= inside
    for path in missing:
        findings.add(path, "missing file")


def _part_3(observation: Observation, record: ObservationRecord | None, files: set[str]) -> Part3Contents | None:
    """Facts that decide the files of a part_3 observation: from its record, or from folders if that is unreadable."""
    if not observation.is_part_3:
        return None
    stems = any(has_stems(files, receiver) for receiver in (None, *_receivers(record, files)))
    if record is not None and record.sources is not None:
        names = tuple(source.id for source in record.sources)
        in_room = any(source.instance is not None for source in record.sources)
        return Part3Contents(names, in_room=in_room, stems=stems, background=record.background is not None)
    inside = {path.split("/")[1] for path in files if path.startswith((f"{layout.STEMS}/", f"{layout.RIRS}/"))}
    names = tuple(sorted(inside - {layout.BACKGROUND}))
    return Part3Contents(
        names, in_room=layout.SOUNDING_OBJECT in files, stems=stems, background=layout.BACKGROUND in inside
    )


def _has(files: set[str], folder: str) -> bool:
    """Whether there is a file in a folder."""
    return any(path.startswith(f"{folder}/") for path in files)


def _receivers(record: ObservationRecord | None, files: set[str]) -> tuple[str, ...]:
    """The receivers beside the two ears: from the record, or the folders where that cannot be read."""
    if record is not None:
        return tuple(record.acoustics.receivers)
    return tuple(name for name in layout.RECEIVERS if _has(files, layout.clips_folder(name)))


def _sounds(record: ObservationRecord | None) -> dict[str, tuple[int, int]]:
    """Folder of clips (or top folder of stems) → channels and samples of its files."""
    found = {
        layout.BINAURAL: (2, layout.BINAURAL_SAMPLES),
        layout.STEMS: (2, layout.BINAURAL_SAMPLES),
        layout.MONO: (1, layout.MONO_SAMPLES),
    }
    for name, channels in (record.acoustics.receivers if record else {}).items():
        for folder in (layout.clips_folder(name), layout.stems_folder(name)):
            found[folder] = (channels.channels, layout.BINAURAL_SAMPLES)
    return found


def _check_files_of_ours(
    observation: Observation, record: ObservationRecord | None, files: set[str], frames: int, findings: Findings
) -> None:
    scene = _part_3(observation, record, files)
    receivers = _receivers(record, files)
    responses = [layout.rirs_folder(receiver) for receiver in (None, *receivers)]
    expected = set(
        layout.expected_files(
            frames,
            depth=_has(files, layout.DEPTH),
            rirs=any(_has(files, folder) for folder in responses),
            part_3=scene,
            receivers=receivers,
            top_view=layout.TOP_VIEW in files if record is None else record.top_view is not None,
        )
    )
    _check_missing(expected, files, findings)
    for path in files - expected - {layout.OBSERVATION_JSON}:
        kind = "left over from an interrupted run" if path.endswith(".tmp") else "surplus file; the layout has no such"
        if path == layout.SOUNDING_OBJECT:
            kind = "surplus file: no instance of the room sounds, so that there is no mesh"
        findings.add(path, kind)


def _check_files_of_release(observation: Observation, files: set[str], findings: Findings) -> None:
    findings.add("", "official release: no observation.json, instance masks or mesh to check against", "note")
    names = observation.frame_names
    if not names:
        findings.add(layout.INPUT, "no pictures; expected frame_000.png and on")
        return
    expected = {layout.SPLITS_JSON, *layout.COLMAP_FILES}
    for name in names:
        try:
            index = layout.frame_index(name)
        except Avs3dError as error:
            findings.add(f"{layout.INPUT}/{name}.png", str(error))
            continue
        expected.add(f"{layout.SEMANTIC_MASKS}/{name}.png")
        expected.update(layout.audio_path(folder, index) for folder in (layout.BINAURAL, layout.MONO))
    _check_missing(expected, files, findings)
    known = {f"{folder}/" for folder in (*_OFFICIAL_FOLDERS, layout.IMAGES, layout.COLMAP)}
    for path in files - expected:
        if not any(path.startswith(folder) for folder in known):
            findings.add(path, "not part of the layout", "note")


def _check_splits(observation: Observation, findings: Findings, *, ours: bool) -> None:
    path = observation.path / layout.SPLITS_JSON
    if not path.exists():
        return  # already named as missing
    names = observation.frame_names
    try:
        splits = parse_splits(media.read_json(path), path)
        if ours:
            media.read_record(path, CameraSplits)
    except Avs3dError as error:
        findings.take(layout.SPLITS_JSON, error)
        return
    unknown = sorted(set(splits) - set(names))
    if unknown:
        findings.add(layout.SPLITS_JSON, f"{len(unknown)} names without a picture in {layout.INPUT}/: {_some(unknown)}")
    absent = sorted(set(names) - set(splits))
    if absent:
        # COLMAP drops frames from the release that it could not register; a tree of ours knows every pose.
        findings.add(
            layout.SPLITS_JSON, f"{len(absent)} frames in no split: {_some(absent)}", "error" if ours else "note"
        )
    listed = [name for name in names if name in splits]
    wrong = [name for at, name in enumerate(listed) if (splits[name] == "test") != layout.is_test(at)]
    if wrong:
        text = (
            f"{len(wrong)} frames break the rule that every {layout.TEST_EVERY}th sorted name is test: {_some(wrong)}"
        )
        findings.add(layout.SPLITS_JSON, text, "error" if ours else "note")
    if ours and not wrong:
        record = media.read_record(path, CameraSplits)
        if list(record.train) != sorted(record.train) or list(record.test) != sorted(record.test):
            findings.add(layout.SPLITS_JSON, "names are not sorted")


def _some(names: list[str], limit: int = 8) -> str:
    return ", ".join(names[:limit]) + (f" and {len(names) - limit} more" if len(names) > limit else "")


def _check_headers(
    observation: Observation, record: ObservationRecord | None, files: set[str], findings: Findings, *, ours: bool
) -> None:
    """Size and pixel format of every picture, rate, channels and length of every clip."""
    size = (record.intrinsics.width, record.intrinsics.height) if record else None
    allowed = {
        layout.INPUT: {(2, 8)} if ours else {(2, 8), (6, 8)},
        layout.IMAGES: {(2, 8)} if ours else {(2, 8), (6, 8)},
        layout.SEMANTIC_MASKS: {(0, 8)} if ours else {(0, 1), (0, 8), (2, 8), (3, 8), (6, 8)},
        layout.INSTANCE_MASKS: {(0, 8), (0, 16)},
        layout.CATEGORY_MASKS: {(0, 8)},
        layout.DEPTH: {(0, 16)},
    }
    wanted = {
        layout.INPUT: "RGB, 8 bit",
        layout.IMAGES: "RGB, 8 bit",
        layout.SEMANTIC_MASKS: "grey, 8 bit",
        layout.INSTANCE_MASKS: "grey, 8 or 16 bit",
        layout.CATEGORY_MASKS: "grey, 8 bit",
        layout.DEPTH: "grey, 16 bit",
    }
    sounds = _sounds(record)
    for path in sorted(files):
        folder, _, name = path.rpartition("/")
        try:
            if path == layout.TOP_VIEW:
                media.png_header(observation.path / path)
            elif folder in allowed and name.endswith(".png"):
                header = media.png_header(observation.path / path)
                if (header.colour_type, header.bits) not in allowed[folder]:
                    findings.add(path, f"{header.mode}, expected {wanted[folder]}")
                found = (header.width, header.height)
                if folder == layout.INPUT and size is None:
                    size = found
                # The release's images/ are undistorted: their size is COLMAP's affair.
                if size and found != size and (ours or folder != layout.IMAGES):
                    findings.add(path, f"{found[0]}×{found[1]} pixels, expected {size[0]}×{size[1]}")
            elif (top := path.partition("/")[0]) in sounds and name.endswith(".wav"):
                sound = media.wav_header(observation.path / path)
                channels, samples = sounds[top]
                if sound.rate != layout.SAMPLE_RATE:
                    findings.add(path, f"{sound.rate} Hz, expected {layout.SAMPLE_RATE} Hz")
                if sound.channels != channels:
                    findings.add(path, f"{sound.channels} channel(s), expected {channels}")
                if sound.samples != samples:
                    findings.add(path, f"{sound.samples} samples, expected {samples}")
        except Avs3dError as error:
            findings.take(path, error)


def _check_images(observation: Observation, files: set[str], findings: Findings, *, ours: bool) -> None:
    """images/ holds the pixels of input/: the same file, or at least as many bytes (`--deep` compares them)."""
    if not ours:
        return
    for name in observation.frame_names:
        first, second = f"{layout.INPUT}/{name}.png", f"{layout.IMAGES}/{name}.png"
        if first in files and second in files:
            a, b = (observation.path / first).stat(), (observation.path / second).stat()
            if (a.st_dev, a.st_ino) != (b.st_dev, b.st_ino) and a.st_size != b.st_size:
                findings.add(second, f"differs from {first} ({b.st_size} bytes, expected {a.st_size})")
