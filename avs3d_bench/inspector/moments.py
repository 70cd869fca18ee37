"""One frame of an observation as pages and films show it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Moment:
    """One frame: what was there at its second. World coordinates are metres, Y up; angles are degrees.

    Attributes:
        name: ``frame_007``.
        split: ``train``, ``test`` or None.
        position: (x, y, z) of the sensor; None without a pose.
        heading: (x, z) unit vector in the floor plane, where the camera looks; None without a pose.
        source: (x, y, z) where the sound comes from at this time; None if unknown, and in a part_3 observation.
        azimuth: of the source (in a part_3 observation of its only source), 0 ahead, positive right; None if unknown.
        distance: to the same source, metres.
        line_of_sight: nothing is between sensor and that source.
        ild: level(right) − level(left) of the clip, dB; None without a clip.
        level: RMS over both channels, dB re full scale.
        visible: pixels of the sounding object (in a part_3 observation of all that are audible) in the frame.
    """

    name: str
    split: str | None
    position: tuple[float, float, float] | None
    heading: tuple[float, float] | None
    source: tuple[float, float, float] | None
    azimuth: float | None
    distance: float | None
    line_of_sight: bool | None
    ild: float | None
    level: float | None
    visible: int | None
