"""The checks of a sounding object that moves: one rigid body, one continuous way, no point in sparse/0."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.colmap import ColmapModel
from avs3d_bench.geometry import Pose, rotation_angle

#: How far poses of the first frame, and the source from its place on the object, may be off: metres, degrees.
TOLERANCE = (2e-3, 0.05)
#: Nothing in a home moves faster, m/s.
MOST_SPEED = 1.0


def motion_problems(record: ObservationRecord) -> Iterator[tuple[str, str]]:
    """Problems of the path of a moving source, as (path, message).

    It must begin where the record says, be continuous, and carry the source as one body.
    """
    where, (metres, degrees) = layout.OBSERVATION_JSON, TOLERANCE
    first = record.frames[0]
    start, own = first.instance_pose, Pose(record.sounding.position, record.sounding.rotation)
    if start is None or record.source_position is None:
        return
    shift = float(np.linalg.norm(np.subtract(start.position, own.position)))
    if shift > metres or rotation_angle(start, own) > degrees:
        yield where, "frames[0].instance_position and instance_rotation differ from those of the sounding instance"
    shift = float(np.linalg.norm(np.subtract(record.source_at(first), record.source_position)))
    if shift > metres:
        yield where, f"source_position is {shift:.3f} m from that of frames[0]; expected the same"
    before = first
    for number, frame in enumerate(record.frames):
        found = np.asarray(record.source_at(frame))
        (expected,) = record.to_frame(frame, np.asarray([record.source_position]))
        off = float(np.linalg.norm(found - expected))
        if off > metres:
            yield where, f"frames[{number}].source_position is {off:.3f} m off its place on the sounding instance"
        step = float(np.linalg.norm(found - np.asarray(record.source_at(before))))
        if number and step > MOST_SPEED * (frame.time - before.time) + metres:
            text = f"frames[{number}]: the source is {step:.2f} m from where it was one frame before; expected a way"
            yield where, f"{text} of at most {MOST_SPEED:g} m/s"
        before = frame


def moving_points(observation: Observation, model: ColmapModel) -> tuple[int, int]:
    """How many sightings of sparse/0 fall inside the mask of the object that moves (0 is right), and how many are.

    A point on it would be in no one place, and what it hides must not be seen through it.
    """
    wrong = total = 0
    for image in model.images:
        frame = next((f for f in observation.frames if f"{f.name}.png" == image.name), None)
        pixels = image.pixels[image.point_ids >= 0]
        if frame is None or not len(pixels):
            continue
        try:
            mask = frame.mask()
        except Avs3dError:
            continue  # already named
        # A ray beside the outline may pass the object while the pixel's centre meets it.
        inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), dtype=np.uint8), borderValue=0)
        column, row = np.floor(pixels).astype(np.int64).T
        inside = (column >= 0) & (row >= 0) & (column < mask.shape[1]) & (row < mask.shape[0])
        wrong += int(inner[row[inside], column[inside]].sum())
        total += len(pixels)
    return wrong, total
