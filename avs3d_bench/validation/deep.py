"""The deep checks of one observation: every file is decoded and held against its record, its twin files and physics."""

from __future__ import annotations

from avs3d_bench import layout, media
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.schema import ObservationRecord
from avs3d_bench.validation.findings import Findings, read
from avs3d_bench.validation.masks import check_mesh, check_pictures, check_visibility
from avs3d_bench.validation.model import check_model
from avs3d_bench.validation.pictures import check_twin
from avs3d_bench.validation.sound import check_clip, check_levels, check_mono


def check_contents(
    observation: Observation, record: ObservationRecord | None, files: set[str], findings: Findings, *, ours: bool
) -> None:
    """All deep checks; problems go to ``findings``.

    Args:
        observation: what to check.
        record: its observation.json, None for the official release (or where it cannot be read).
        files: the files found, relative.
        findings: where problems go.
        ours: a tree of this toolkit; else what we ask beyond the release is not asked.
    """
    if record:
        _check_hashes(observation, record, files, findings)
    try:
        frames = observation.frames
    except Avs3dError:
        return  # no or odd pictures: already named
    mesh = check_mesh(observation, record, files, findings)
    for frame in frames:
        check_pictures(frame, record, mesh, files, findings)
        if ours:
            check_twin(frame, files, findings)
    check_visibility(observation, record, files, findings)
    clips = [check_clip(frame, files, findings) for frame in frames]
    check_levels(frames, clips, findings)
    try:
        splits = observation.splits
    except Avs3dError:
        splits = {}  # already named
    for position, frame in enumerate(frames):
        check_mono(frames, clips, splits, position, files, findings, severity="error" if ours else "warning")
        path = layout.rir_path(frame.index)
        read(findings, files, path, frame.impulse_response)
    check_model(observation, record, files, findings, ours=ours)


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
