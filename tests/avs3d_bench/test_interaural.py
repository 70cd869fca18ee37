"""The side of the source: no false alarm in any room with any sound, and exchanged channels are caught.

Sounds that tell their side (broadband, whistle over noise, beep, alarm, telephone, clock) are heard in a damped
room, a small hard one, and a large hard one; a steady tone, which tells nothing in a hard room, must not be an error.
"""

from __future__ import annotations

from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.geometry import Pose, direction_to
from avs3d_bench.validation.interaural import (
    SURE,
    TONAL_SURE,
    Hearing,
    SideFit,
    SideLevel,
    check_sides,
    side_level,
    tonal,
)
from avs3d_bench.validation.sound import BinauralClip
from generators.acoustics.base import BatchSession
from generators.acoustics.clips import receiver_clip
from generators.acoustics.materials import spectral_label
from generators.assets.sounds import synthesise
from generators.backends import acoustic_backend
from generators.options import EngineOptions
from tests.support.acoustic_rooms import box_scene
from tests.support.once import made_once

RATE, FRAMES = layout.SAMPLE_RATE, 24
#: Size (m), absorption and where the source is. The small hard room is that of a phone scan of 26 m³: direct sound at
#: 1.2 m is 7 to 12 dB below the rest.
ROOMS = {
    "normal": ((5.0, 2.6, 4.0), 0.3, (4.0, 1.0, 3.2)),
    "small hard": ((2.7, 2.6, 3.7), 0.12, (2.2, 0.8, 3.2)),
    "large hard": ((9.0, 3.5, 8.0), 0.1, (7.0, 1.0, 6.0)),
}
TELLING = ("noise", "whistle", "beep", "alarm", "telephone", "clock")


@cache
def signal(kind: str, seconds: int) -> NDArray[np.float64]:
    return made_once(f"interaural-{kind}-{seconds}", partial(_signal, kind, seconds))


def _signal(kind: str, seconds: int) -> NDArray[np.float64]:
    rng, t = np.random.default_rng(3), np.arange(seconds * RATE) / RATE
    if kind in ("telephone", "clock"):
        return np.asarray(synthesise(kind, seconds, rng), dtype=np.float64)
    noise, tone = rng.standard_normal(len(t)), np.sin(2 * np.pi * 2500 * t)
    if kind == "noise":
        return 0.1 * noise
    if kind == "tone":
        return 0.2 * tone
    if kind == "whistle":
        return 0.2 * tone + 0.002 * noise
    on, period = {"beep": (0.25, 1.0), "alarm": (0.06, 0.125)}[kind]
    phase = (t + 0.4) % period
    return 0.2 * tone * np.clip(np.minimum(phase, on - phase) / 0.005, 0, 1)


def path(size: tuple[float, float, float], source: tuple[float, float, float]) -> list[Pose]:
    """Round the room, the source now to the left, now to the right."""
    rng, poses = np.random.default_rng(7), []
    while len(poses) < FRAMES:
        x, z = rng.uniform(0.4, size[0] - 0.4), rng.uniform(0.4, size[2] - 0.4)
        pose = Pose.from_yaw((x, 1.5, z), rng.uniform(0, 2 * np.pi))
        if direction_to(pose, source).distance > 0.9:
            poses.append(pose)
    return poses


@cache
def heard(engine: str, room: str, kind: str) -> tuple[tuple[float, float, NDArray[np.float32]], ...]:
    """(azimuth, distance, clip) of each pose."""
    source = ROOMS[room][2]
    sound = signal(kind, FRAMES + 2)
    out = []
    for number, (pose, response) in enumerate(responses(engine, room)):
        where = direction_to(pose, source)
        out.append((where.azimuth, where.distance, receiver_clip(sound, response, number + 2)))
    return tuple(out)


@cache
def responses(engine: str, room: str) -> tuple[tuple[Pose, NDArray[np.float32]], ...]:
    size, absorption, source = ROOMS[room]
    label = spectral_label((absorption,) * 6, (0.3,) * 6)
    session = acoustic_backend(EngineOptions(audio=engine)).open(box_scene(size, label=label), source, room="kitchen")
    poses = path(size, source)
    if isinstance(session, BatchSession):
        session.prepare(poses)
    try:
        return tuple((pose, session.impulse_response(pose)) for pose in poses)
    finally:
        session.close()


class Errors:
    """Takes what the check says."""

    def __init__(self) -> None:
        self.messages: list[str] = []

    def add(self, path: str, message: str, severity: str = "error") -> None:
        self.messages.append(message)


def hearings(engine: str, room: str, kind: str, *, swapped: tuple[int, ...] = ()) -> list[Hearing]:
    found = []
    for index, (azimuth, distance, clip) in enumerate(heard(engine, room, kind)):
        samples = np.ascontiguousarray(clip[::-1]) if index in swapped else clip
        sound = BinauralClip(samples, np.sqrt(np.mean(np.square(samples.astype(float)), axis=1)))
        found.append(Hearing(SimpleNamespace(index=index), sound, azimuth, distance))  # type: ignore[arg-type]
    return found


def said(found: list[Hearing]) -> list[str]:
    errors = Errors()
    check_sides(None, found, errors)  # type: ignore[arg-type]
    return errors.messages


ENGINES = ("analytic", "tracer", "soundspaces")


@pytest.fixture
def engine(request: pytest.FixtureRequest) -> str:
    if request.param == "soundspaces":
        pytest.importorskip("rlr_audio_propagation")
    return str(request.param)


@pytest.mark.slow
@pytest.mark.parametrize("room", ROOMS)
@pytest.mark.parametrize("engine", ENGINES, indirect=True)
def test_swapped_channels_are_caught_and_right_ones_never_blamed(engine: str, room: str):
    for kind in TELLING:
        assert said(hearings(engine, room, kind)) == [], kind
        found = said(hearings(engine, room, kind, swapped=tuple(range(FRAMES))))
        assert len(found) == 1, kind
        assert "channels swapped?" in found[0], kind


@pytest.mark.slow
@pytest.mark.parametrize("room", ROOMS)
@pytest.mark.parametrize("engine", ENGINES, indirect=True)
def test_a_steady_tone_is_no_error(engine: str, room: str):
    assert said(hearings(engine, room, "tone")) == []


def test_one_swapped_clip_is_named_where_the_others_tell():
    found = hearings("analytic", "normal", "noise")
    most = int(np.argmax([one.level.db * np.sin(np.radians(one.azimuth)) for one in found if one.level]))
    (message,) = said(hearings("analytic", "normal", "noise", swapped=(most,)))
    assert "the ear away from the source is" in message


def test_clips_in_another_order_are_named_where_they_tell():
    found = hearings("analytic", "normal", "noise")
    azimuths = [one.azimuth for one in found]
    moved = [Hearing(one.frame, one.sound, azimuths[number - 7], one.distance) for number, one in enumerate(found)]
    assert any("clips of other frames?" in each or "swapped?" in each for each in said(moved))


def test_the_loudest_tone_does_not_outvote_the_noise_beside_it():
    """Bands count alike: with the tone 40 dB above the noise, the noise's bands tell the side."""
    rng, t = np.random.default_rng(1), np.arange(RATE) / RATE
    noise, tone = rng.standard_normal(RATE), np.sin(2 * np.pi * 2500 * t)
    level = side_level(np.stack([0.01 * noise + 2 * tone, 0.02 * noise + tone]))
    assert level is not None
    assert level.db > 3.0
    alone = side_level(np.stack([2 * tone, tone]))
    assert alone is not None
    assert alone.db == pytest.approx(-6.0, abs=0.5)


@pytest.mark.parametrize(
    ("kind", "expected"),
    [("tone", True), ("hum", True), ("two tones", True), ("whistle", False), ("beep", False), ("noise", False)],
)
def test_steady_tones_and_hums_are_known(kind: str, expected: bool):
    t = np.arange(RATE) / RATE
    if kind == "hum":
        mono = sum(0.1 / k * np.sin(2 * np.pi * 100 * k * t + k * k) for k in range(1, 11))
    elif kind == "two tones":
        mono = 0.1 * np.sin(2 * np.pi * 440 * t) + 0.1 * np.sin(2 * np.pi * 480 * t)
    else:
        mono = signal(kind, 1)
    level = side_level(np.stack([mono, 0.7 * mono]).astype(np.float32))
    assert level is not None
    assert tonal([level]) == expected


def test_a_tone_whose_levels_are_on_the_wrong_side_by_chance_is_no_error():
    """Standing waves give the level of a tone any sign; noise with the same levels has exchanged channels."""
    rng, t = np.random.default_rng(0), np.arange(RATE) / RATE
    azimuths = rng.uniform(-90, 90, 16)
    wrong = -5.0 * np.sin(np.radians(azimuths)) + rng.normal(0, 4.0, 16)

    def heard_as(mono: NDArray[np.float64]) -> list[Hearing]:
        found = []
        for number, (azimuth, db) in enumerate(zip(azimuths, wrong, strict=True)):
            samples = np.stack([mono * 10 ** (-db / 40), mono * 10 ** (db / 40)]).astype(np.float32)
            sound = BinauralClip(samples, samples.std(axis=1))
            found.append(Hearing(SimpleNamespace(index=number), sound, float(azimuth), 2.0))  # type: ignore[arg-type]
        return found

    tone, noise = heard_as(0.2 * np.sin(2 * np.pi * 440 * t)), heard_as(0.1 * rng.standard_normal(RATE))
    fits = [
        SideFit.of([one.level for one in each if one.level], np.sin(np.radians(azimuths))) for each in (tone, noise)
    ]
    assert -TONAL_SURE < fits[0].certainty < -SURE
    assert fits[1].certainty < -SURE
    assert said(tone) == []
    assert any("channels swapped?" in line for line in said(noise))


def test_few_bands_that_agree_are_no_proof():
    sines = np.array([0.5, -0.5, 0.5, -0.5])
    one = [SideLevel(float(-4 * np.sign(sine)), 1, 49.0, 1) for sine in sines]
    many = [SideLevel(float(-4 * np.sign(sine)), 13, 0.1, 13) for sine in sines]
    assert SideFit.of(one, sines).certainty > -SURE
    assert SideFit.of(many, sines).certainty < -SURE
