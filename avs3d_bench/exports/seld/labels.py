"""CSV of labels: whole degrees and centimetres, as the challenges have them.

    foa       no header        frame,class,source,azimuth,elevation,distance        STARSS23
    stereo    with a header    frame,class,source,azimuth,distance,onscreen         DCASE 2025

The stereo azimuth is that of the view; directions behind are mirrored to the front, because a pair of channels does not
tell them apart. `onscreen` is 1 if the direction is in a picture that is 100° wide at 16 : 9, hidden or not.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from avs3d_bench.exports.seld.events import LABELS_PER_SECOND, SeldEvent
from avs3d_bench.exports.seld.recordings import SeldClip

#: Tangents of half of the field of view of a perspective film: 100° wide, 16 : 9.
HALF_WIDTH = math.tan(math.radians(50.0))
HALF_HEIGHT = HALF_WIDTH * 9 / 16
_STEREO_HEADER = "frame,class,source,azimuth,distance,onscreen"


def foa_csv(events: Iterable[SeldEvent]) -> str:
    """The labels of a recording of ambisonics."""
    rows = (
        (e.frame, e.class_index, e.source, round(e.azimuth), round(e.elevation), round(100 * e.distance))
        for e in events
    )
    return "".join(f"{','.join(map(str, row))}\n" for row in rows)


def stereo_csv(events: Iterable[SeldEvent], clip: SeldClip) -> str:
    """The labels of a stereo clip: those of the recording's events that lie in it."""
    first = clip.start * LABELS_PER_SECOND
    lines = [_STEREO_HEADER]
    for event in events:
        frame = event.frame - first
        if 0 <= frame < clip.seconds * LABELS_PER_SECOND:
            x, y, z = in_view(event, clip.view)
            azimuth = folded(math.degrees(math.atan2(y, x)))
            shown = x > 0 and abs(y) <= HALF_WIDTH * x and abs(z) <= HALF_HEIGHT * x
            row = (frame, event.class_index, event.source, round(azimuth), round(100 * event.distance), int(shown))
            lines.append(",".join(map(str, row)))
    return "\n".join(lines) + "\n"


def in_view(event: SeldEvent, view: int) -> tuple[float, float, float]:
    """The direction of an event, (x, y, z) forward, left, up, for who looks ``view`` degrees to the right."""
    (x, y, z), angle = event.direction, math.radians(view)
    return x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle), z


def folded(azimuth: float) -> float:
    """An azimuth (degrees, −180 to 180) with what is behind mirrored to the front.

    Examples:
        >>> folded(170.0), folded(-100.0), folded(45.0)
        (10.0, -80.0, 45.0)
    """
    if azimuth > 90:
        return 180 - azimuth
    return -180 - azimuth if azimuth < -90 else azimuth
