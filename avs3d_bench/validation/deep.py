"""The deep checks of one observation: every file is decoded and held against its record, its twin files and physics."""

from __future__ import annotations

from collections.abc import Mapping

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import FrameRecord, ObservationRecord
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from avs3d_bench.runtime.parallel import advance
from avs3d_bench.validation.acoustics import check_gain, check_reverberation
from avs3d_bench.validation.findings import Findings, read
from avs3d_bench.validation.interaural import check_delays, check_sides, hearings
from avs3d_bench.validation.masks import (
    Contents,
    check_masks,
    check_mesh,
    check_visibility,
    frame_paths,
    read_contents,
)
from avs3d_bench.validation.model import check_model
from avs3d_bench.validation.off_screen import check_off_screen
from avs3d_bench.validation.pictures import check_twin
from avs3d_bench.validation.receivers import check_receivers
from avs3d_bench.validation.seams import check_seams
from avs3d_bench.validation.siblings import same_files
from avs3d_bench.validation.sightings import (
    Labels,
    Sightings,
    check_labels,
    colour_problem,
    depth_problem,
    sightings_by_frame,
)
from avs3d_bench.validation.solid import Boxes, Tally, check_solid
from avs3d_bench.validation.sound import BinauralClip, check_clip, check_mono, check_response
from avs3d_bench.validation.sources import has_stems
from avs3d_bench.validation.stems import Stems, check_source_response


def check_contents(
    observation: Observation,
    record: ObservationRecord | None,
    files: set[str],
    findings: Findings,
    *,
    ours: bool,
    with_group: bool = False,
) -> None:
    """All deep checks; problems go to ``findings``.

    Args:
        observation: what to check.
        record: its observation.json, None for the official release (or where it cannot be read).
        files: the files found, relative.
        findings: where problems go.
        ours: a tree of this toolkit; else what we ask beyond the release is not asked.
        with_group: the first of the observation's group is checked as well, and with it the files that both share.
    """
    known = same_files(observation, record) if record and with_group else frozenset()
    if record:
        _check_hashes(observation, record, files - known, findings)
    try:
        frames = observation.frames
    except Avs3dError:
        return  # no or odd pictures: already named
    mesh = check_mesh(observation, record, files, findings)
    sightings = _sightings(observation, files) if record else {}
    labels, boxes = Labels(), Boxes(record) if record else None
    tally = Tally(layout.INSTANCE_MASKS if record and record.is_part_3 else layout.SEMANTIC_MASKS)
    visible: dict[str, frozenset[int]] = {}
    for number, frame in enumerate(frames):
        advance(number, len(frames))
        found = read_contents(frame, record, files, findings, known)
        if ours:
            check_twin(frame, files, findings)
        entry, seen = frame.record, sightings.get(frame.name)
        if record is None or entry is None:
            continue
        check_masks(frame, entry, record, found, findings)
        if found.ids is not None:
            visible[frame.name] = frozenset(found.instances)
        if mesh is not None:
            check_solid(frame, entry, record, found, mesh, seen, tally, findings)
        if seen is not None:
            _check_witnesses(frame, entry, found, seen, findings)
            if found.ids is not None and boxes is not None and frame_paths(frame)[layout.INSTANCE_MASKS] not in known:
                labels.add(frame.name, seen, found.ids)
                boxes.add(frame, seen, found.ids, findings)
    check_labels(labels, findings)
    tally.finish(findings)
    if boxes is not None:
        boxes.finish(findings)
    check_visibility(observation, record, files, findings)
    if record:
        check_off_screen(record, sightings, findings)
    _check_sound(observation, record, visible, files, findings, ours=ours)
    if not known.issuperset(layout.COLMAP_FILES):
        check_model(observation, record, files, findings, ours=ours)


def _check_sound(
    observation: Observation,
    record: ObservationRecord | None,
    visible: Mapping[str, frozenset[int]],
    files: set[str],
    findings: Findings,
    *,
    ours: bool,
) -> None:
    """Check clips, stems and impulse responses.

    Args:
        observation: see `check_contents`, as for the other arguments.
        record: its observation.json.
        visible: frame name → ids of the instances that its picture shows.
        files: the files found.
        findings: where problems go.
        ours: a tree of this toolkit.
    """
    frames = observation.frames
    clips = [check_clip(frame, files, findings) for frame in frames]
    if ours:
        check_seams(clips, findings)
    heard = hearings(record, frames, clips, visible)
    check_sides(record, heard, findings)
    check_delays(heard, findings)
    if record:
        check_receivers(record, frames, clips, heard, files, findings)
        check_gain(record, heard, findings)
        check_reverberation(observation, record, files, findings)
    if record and record.is_part_3:
        _check_stems(record, frames, clips, files, findings)
    try:
        splits = observation.splits
    except Avs3dError:
        splits = {}  # already named
    for position, frame in enumerate(frames):
        check_mono(frames, clips, splits, position, files, findings, ours=ours)
        clip, path = clips[position], layout.rir_path(frame.index)
        response = read(findings, files, path, frame.impulse_response)
        if record and not record.moves and response is not None and clip is not None:
            clip_path = layout.audio_path(layout.BINAURAL, frame.index)
            check_response(path, clip_path, clip.samples, response, findings)


def _check_stems(
    record: ObservationRecord,
    frames: tuple[Frame, ...],
    clips: list[BinauralClip | None],
    files: set[str],
    findings: Findings,
) -> None:
    """The stems, where the observation was made with them, and the responses of its sources."""
    if not has_stems(files):
        sources = record.sources or ()
        alone = len(sources) == 1 and record.background is None
        for frame, clip in zip(frames, clips, strict=True):
            for source in sources:
                # The clip is the stem of a source that is alone.
                check_source_response(frame, source, clip.samples if clip and alone else None, files, findings)
        return
    stems = Stems(record)
    for frame, clip in zip(frames, clips, strict=True):
        stems.add(frame, clip, files, findings)
    stems.finish(findings)


def _sightings(observation: Observation, files: set[str]) -> dict[str, Sightings]:
    """The witnesses among the sparse points; none if the model is missing or damaged, which is named elsewhere."""
    if not files.issuperset(layout.COLMAP_FILES):
        return {}
    try:
        return sightings_by_frame(observation.colmap, observation.intrinsics)
    except Avs3dError:
        return {}


def _check_witnesses(
    frame: Frame, entry: FrameRecord, found: Contents, sightings: Sightings, findings: Findings
) -> None:
    """Hold picture and depth of one frame to the points that it sees."""
    paths = frame_paths(frame)
    if found.rgb is not None:
        problem = colour_problem(found.rgb, sightings)
        if problem:
            findings.add(paths[layout.INPUT], problem)
    if found.depth is not None:
        problem = depth_problem(found.depth, -entry.pose.to_camera(sightings.position)[:, 2], sightings)
        if problem:
            findings.add(paths[layout.DEPTH], problem)


def _check_hashes(observation: Observation, record: ObservationRecord, files: set[str], findings: Findings) -> None:
    known: dict[tuple[int, int], str] = {}  # images/ are hard links to input/: hash them once
    for path, expected in record.files.items():
        if path not in files:
            continue
        status = (observation.path / path).stat()
        inode = (status.st_dev, status.st_ino)
        if inode not in known:
            try:
                known[inode] = media.sha256_file(observation.path / path)
            except Avs3dError as error:
                findings.take(path, error)
                continue
        if known[inode] != expected:
            text = (
                f"sha256 {known[inode][:12]}… differs from {layout.OBSERVATION_JSON} ({expected[:12]}…): file changed"
            )
            findings.add(path, text)
