"""The numbers of observation.json: against each other and against the folder."""

from __future__ import annotations

import numpy as np

from avs3d_bench import layout
from avs3d_bench.dataset import Observation
from avs3d_bench.geometry import direction_to
from avs3d_bench.schema import ObservationRecord
from avs3d_bench.validation.findings import Findings
from avs3d_bench.validation.motion import motion_problems

#: Tolerances of numbers in observation.json against each other: degrees, metres.
ANGLE_TOLERANCE = 0.1
DISTANCE_TOLERANCE = 2e-3
#: The sound may come from a little outside the instance's box (a horn, a speaker grille): metres.
SOURCE_MARGIN = 0.1
#: So may a model's origin (m).
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
    source = np.asarray(record.source_position)
    low, high = (np.asarray(corner) for corner in record.sounding.bounds)
    outside = float(np.linalg.norm(np.maximum(np.maximum(low - source, source - high), 0.0)))
    if outside > SOURCE_MARGIN:
        findings.add(where, f"source_position lies {outside:.2f} m outside the bounds of the sounding instance")
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
        truth = direction_to(frame.pose, record.source_at(frame))
        turn = abs((frame.azimuth - truth.azimuth + 180.0) % 360.0 - 180.0)
        # Straight above or below, azimuth means nothing.
        if turn > ANGLE_TOLERANCE and abs(truth.elevation) < 89.0:
            findings.add(where, f"{field}.azimuth is {frame.azimuth:.2f}°, pose and source give {truth.azimuth:.2f}°")
        if abs(frame.elevation - truth.elevation) > ANGLE_TOLERANCE:
            text = f"{field}.elevation is {frame.elevation:.2f}°, pose and source give {truth.elevation:.2f}°"
            findings.add(where, text)
        if abs(frame.distance - truth.distance) > DISTANCE_TOLERANCE:
            text = f"{field}.distance is {frame.distance:.3f} m, pose and source give {truth.distance:.3f} m"
            findings.add(where, text)
        if frame.visible_pixels > pixels:
            findings.add(where, f"{field}.visible_pixels is {frame.visible_pixels} of {pixels}")
