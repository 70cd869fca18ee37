"""Off-screen sources of part_3: they are in another room, which the cameras do not look into.

The room's walls are not recorded. Two things say where it is: cameras and instances are in it, and a sparse point shows
how far one can see in its direction. A source among them that nothing hides from most cameras is in the room.
"""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord, SourceRecord
from avs3d_bench.validation.findings import Findings
from avs3d_bench.validation.sightings import Sightings

#: A sparse point says how far one sees in directions this near to it (degrees): about its spacing in full-size frames.
NEAR_DIRECTION = 6.0
#: A source nearer than the point by more than this is not hidden (m, and share of the distance).
FREE_BEYOND = (0.1, 0.05)
#: Frames that must have a point in the direction of the source, and the share of them in which nothing may hide it.
LEAST_FRAMES, MOST_FREE = 3, 0.5


def check_off_screen(record: ObservationRecord, sightings: Mapping[str, Sightings], findings: Findings) -> None:
    """Name off-screen sources that are in the observation's room.

    Args:
        record: the observation's.
        sightings: frame name → the sparse points that it sees.
        findings: where problems go.
    """
    for source in record.sources or ():
        if source.instance is not None or not _among(record, source):
            continue
        free, judged = _free(record, source, sightings)
        if judged >= LEAST_FRAMES and free > MOST_FREE * judged:
            text = f"{source.id} is off-screen ({source.room}), but its position is among the cameras and instances"
            findings.add(
                layout.OBSERVATION_JSON,
                f"{text} of the {record.room}, and {free} of {judged} frames that look there see past it",
            )


def _among(record: ObservationRecord, source: SourceRecord) -> bool:
    """Whether a source is within the convex hull, in plan, of the cameras and instances, and not on another floor."""
    corners = [np.asarray(frame.position) for frame in record.frames]
    for instance in record.instances:
        (x0, y0, z0), (x1, y1, z1) = instance.bounds
        corners += [np.asarray(each) for each in ((x0, y0, z0), (x0, y1, z1), (x1, y0, z0), (x1, y1, z1))]
    points = np.asarray(corners)
    if not points[:, 1].min() - 1.0 <= source.position[1] <= points[:, 1].max() + 1.0:
        return False
    hull = cv2.convexHull(points[:, (0, 2)].astype(np.float32))
    return cv2.pointPolygonTest(hull, (float(source.position[0]), float(source.position[2])), measureDist=False) > 0


def _free(record: ObservationRecord, source: SourceRecord, sightings: Mapping[str, Sightings]) -> tuple[int, int]:
    """In how many frames nothing hides the source, and how many have a sparse point in its direction."""
    free = judged = 0
    place = np.asarray(source.position)
    for frame in record.frames:
        seen = sightings.get(frame.name)
        if seen is None or not len(seen):
            continue
        rays: NDArray[np.float64] = seen.position - np.asarray(frame.position)
        reach = np.linalg.norm(rays, axis=1)
        way = place - np.asarray(frame.position)
        distance = float(np.linalg.norm(way))
        cosine = rays @ way / np.maximum(reach * distance, 1e-9)
        nearest = int(cosine.argmax())
        if cosine[nearest] < np.cos(np.radians(NEAR_DIRECTION)):
            continue
        judged += 1
        free += int(reach[nearest] > distance * (1 + FREE_BEYOND[1]) + FREE_BEYOND[0])
    return free, judged
