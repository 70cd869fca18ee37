"""The numbers of observation.json: against each other and against the folder."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import FrameRecord, ObservationRecord
from avs3d_bench.dataset import Observation
from avs3d_bench.geometry import direction_to
from avs3d_bench.validation.findings import Findings
from avs3d_bench.validation.motion import motion_problems
from avs3d_bench.validation.sources import check_sources

#: Tolerances of numbers in observation.json against each other: degrees, metres.
ANGLE_TOLERANCE = 0.1
DISTANCE_TOLERANCE = 2e-3
#: A model's origin may lie a little outside its box (m).
ORIGIN_MARGIN = 0.1
#: Frames are one second apart (s).
TIME_TOLERANCE = 1e-6


def check_record(
    observation: Observation, record: ObservationRecord, files: set[str], findings: Findings, irregular: set[str]
) -> None:
    """The numbers of observation.json against each other and against the folder; ``irregular`` files have no size."""
    where = layout.OBSERVATION_JSON
    if record.key != observation.key:
        findings.add(where, f"key is {record.key}, but the folder is {observation.key}")
    on_disk = files - {where}
    for path in sorted(set(record.files) - on_disk):
        findings.add(path, f"listed in {where}, but missing")
    unlisted = sorted(path for path in on_disk - set(record.files) if not path.endswith(".tmp"))
    for path in unlisted:
        findings.add(path, f"has no sha256 in {where}")
    for path, expected in sorted((record.sizes or {}).items()):
        if path in on_disk - irregular and (found := (observation.path / path).stat().st_size) != expected:
            findings.add(path, f"{found:,} bytes, expected {expected:,} ({where})")
    check_sources(record, findings)
    for instance in record.instances:
        origin, box = np.asarray(instance.position), np.asarray(instance.bounds)
        if (origin < box[0] - ORIGIN_MARGIN).any() or (origin > box[1] + ORIGIN_MARGIN).any():
            findings.add(where, f"the origin of instance {instance.id} lies outside its bounds")
    if record.acoustics.sample_rate != layout.SAMPLE_RATE:
        text = f"acoustics.sample_rate is {record.acoustics.sample_rate}, expected {layout.SAMPLE_RATE}"
        findings.add(where, text)
    if record.moves:
        for path, text in motion_problems(record):
            findings.add(path, text)
    pixels = record.intrinsics.width * record.intrinsics.height
    for number, frame in enumerate(record.frames):
        field = f"frames[{number}]"
        if abs(frame.time - number / layout.FRAME_RATE) > TIME_TOLERANCE:
            findings.add(where, f"{field}.time is {frame.time:g} s, expected {number / layout.FRAME_RATE:g} s")
        for text in _direction_problems(record, frame):
            findings.add(where, f"{field}.{text}")
        if frame.visible_pixels > pixels:
            findings.add(where, f"{field}.visible_pixels is {frame.visible_pixels} of {pixels}")


def _direction_problems(record: ObservationRecord, frame: FrameRecord) -> Iterator[str]:
    """The direction of the source (in part_3 of the first one) against its position and the pose."""
    if frame.azimuth is None or frame.elevation is None or frame.distance is None:
        return  # nothing sounds
    truth = direction_to(frame.pose, record.source_at(frame))
    turn = abs((frame.azimuth - truth.azimuth + 180.0) % 360.0 - 180.0)
    # Straight above or below, azimuth means nothing.
    if turn > ANGLE_TOLERANCE and abs(truth.elevation) < 89.0:
        yield f"azimuth is {frame.azimuth:.2f}°, pose and source give {truth.azimuth:.2f}°"
    if abs(frame.elevation - truth.elevation) > ANGLE_TOLERANCE:
        yield f"elevation is {frame.elevation:.2f}°, pose and source give {truth.elevation:.2f}°"
    if abs(frame.distance - truth.distance) > DISTANCE_TOLERANCE:
        yield f"distance is {frame.distance:.3f} m, pose and source give {truth.distance:.3f} m"
