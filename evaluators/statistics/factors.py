"""The factors of a frame on which figures may depend: direction, room acoustics, noise, silent twins.

They come from observation.json. Of part_1 and part_2 it has no ratio of direct sound to reverberation; that is computed
from the impulse responses of `rirs/` where the dataset has them. What cannot be known is None, with a reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AudibleRecord, FrameRecord, ObservationRecord
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.geometry import direction_to

NO_RECORD = "the dataset has no observation.json"
NOTHING_AUDIBLE = "no source is audible in the frame"
NO_T30 = "observation.json has no reverberation time"
NO_RESPONSES = "the dataset has no rirs/"
NO_DIRECT_SOUND = "no direct sound arrives"
NO_REVERBERATION = "nothing but direct sound arrives"
ALONE = "the clip contains nothing but the source"
NO_TWIN = "no silent object of the category is in the room"
#: Every factor that can be None.
NAMES = (
    "category", "distance_m", "azimuth_deg", "elevation_deg", "t30_s", "drr_db", "snr_db", "twins", "twin_distance_m",
)  # fmt: skip

#: Speed of sound of the acoustic engines (m/s), which sets when direct sound arrives.
SPEED_OF_SOUND = 343.0
#: The direct sound lies between these times after its arrival at the centre of the head (s): the nearer ear hears it up
#: to 0.3 ms early, and the response of a head is over after 2 ms.
BEFORE, AFTER = 0.0005, 0.002
#: Energy below this share of a response is rounding, no sound.
_NO_PART = 1e-9


@dataclass(frozen=True)
class Factors:
    """The factors of one frame; see the fields of the same names of `avs3d_bench.contract.frame_rows.FrameRow`.

    Attributes:
        category: of the source.
        distance_m: to the source.
        azimuth_deg: of the source.
        elevation_deg: of the source.
        t30_s: of the room.
        drr_db: of the source.
        snr_db: of the source.
        twins: silent objects of the category in the room.
        twin_distance_m: from the source to the nearest of them.
        unavailable: factor that is None → reason.
    """

    category: str | None = None
    distance_m: float | None = None
    azimuth_deg: float | None = None
    elevation_deg: float | None = None
    t30_s: float | None = None
    drr_db: float | None = None
    snr_db: float | None = None
    twins: int | None = None
    twin_distance_m: float | None = None
    unavailable: dict[str, str] = field(default_factory=dict)


def frame_factors(frame: Frame) -> Factors:
    """The factors of a frame.

    Raises:
        Avs3dError: if observation.json or an impulse response is damaged.
    """
    record, here = frame.observation.record, frame.record
    if record is None or here is None:
        return Factors(unavailable=dict.fromkeys(NAMES, NO_RECORD))
    t30 = record.acoustics.t30
    why = {} if t30 is not None else {"t30_s": NO_T30}
    heard = _heard(frame, record, here, why)
    if heard is None:
        why |= {name: NOTHING_AUDIBLE for name in NAMES if name != "t30_s"}
        return Factors(t30_s=t30, unavailable={name: why[name] for name in NAMES if name in why})
    twins, nearest = _twins(record, here, heard.category, heard.position)
    missing = {"drr_db": (heard.drr_db, NO_DIRECT_SOUND), "snr_db": (heard.snr_db, ALONE)}
    missing |= {"twin_distance_m": (nearest, NO_TWIN)}
    why = {name: reason for name, (value, reason) in missing.items() if value is None} | why
    return Factors(
        heard.category, heard.distance, heard.azimuth, heard.elevation, t30, heard.drr_db, heard.snr_db, twins,
        nearest, {name: why[name] for name in NAMES if name in why},
    )  # fmt: skip


@dataclass(frozen=True)
class _Heard:
    """The source whose factors a frame has, at the frame's time; units as in `Factors`."""

    category: str
    position: tuple[float, float, float]
    distance: float | None
    azimuth: float | None
    elevation: float | None
    drr_db: float | None
    snr_db: float | None = None


def _heard(frame: Frame, record: ObservationRecord, here: FrameRecord, why: dict[str, str]) -> _Heard | None:
    """The loudest audible source, None if there is none; in part_1 and part_2 the one that always sounds, alone."""
    if here.audible is None:
        (source,) = record.sound_sources
        drr = _response_drr(frame, here, why)
        place = record.source_at(here)
        return _Heard(source.category, place, here.distance, here.azimuth, here.elevation, drr)
    loudest = _loudest(here.audible)
    if loudest is None:
        return None
    source = record.source(loudest.source)
    place = record.source_at(here, source)
    to = direction_to(here.pose, place)
    return _Heard(source.category, place, to.distance, to.azimuth, to.elevation, loudest.drr_db, loudest.snr_db)


def _response_drr(frame: Frame, here: FrameRecord, why: dict[str, str]) -> float | None:
    """The ratio from the frame's impulse response; a reason goes into ``why`` where there is none."""
    observation = frame.observation
    if not observation.where(layout.rir_path(frame.index)).exists():
        why["drr_db"] = NO_RESPONSES
    elif not here.line_of_sight or here.distance is None:
        why["drr_db"] = NO_DIRECT_SOUND
    else:
        ratio = direct_to_reverberant(frame.impulse_response(), here.distance)
        if math.isfinite(ratio):
            return ratio
        why["drr_db"] = NO_DIRECT_SOUND if ratio < 0 else NO_REVERBERATION
    return None


def direct_to_reverberant(response: ArrayLike, distance: float, rate: int = layout.SAMPLE_RATE) -> float:
    """Energy of the direct sound of an impulse response over that of all that comes later, dB.

    The direct sound lies between 0.5 ms before and 2 ms after distance / 343 m/s.

    Args:
        response: (channels, n), from the source at time 0.
        distance: from the source to the listener, metres.
        rate: Hz.

    Returns:
        −inf without direct sound, inf without anything else.
    """
    power = np.square(np.asarray(response, dtype=np.float64)).sum(axis=0)
    arrival = distance / SPEED_OF_SOUND
    first, last = max(math.floor((arrival - BEFORE) * rate), 0), math.ceil((arrival + AFTER) * rate)
    early, whole = float(power[first:last].sum()), float(power.sum())
    late = whole - early
    if early <= _NO_PART * whole:
        return -math.inf
    return math.inf if late <= _NO_PART * whole else 10 * math.log10(early / late)


def _loudest(audible: Iterable[AudibleRecord]) -> AudibleRecord | None:
    """The source with the highest level, the first of equals; None if none is audible."""
    return max(audible, key=lambda one: one.level_db, default=None)


def _twins(
    record: ObservationRecord, here: FrameRecord, category: str, source: tuple[float, float, float]
) -> tuple[int, float | None]:
    """Number of objects of a category that are silent in a frame, and the distance of the nearest from the source."""
    audible = record.audible_instances(here)
    silent = [one for one in record.instances if one.category == category and one.id not in audible]
    if not silent:
        return 0, None
    middles = np.array([record.middle_at(here, one) for one in silent])
    return len(silent), float(np.linalg.norm(middles - np.asarray(source), axis=1).min())


def observation_factors(observation: Observation) -> dict[str, Factors]:
    """Name of a test frame → its factors."""
    return {frame.name: frame_factors(frame) for frame in observation.test}
