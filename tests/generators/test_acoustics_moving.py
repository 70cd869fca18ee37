"""Moving sources and listeners against exact answers, and without seams."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from generators import acoustics
from generators.acoustics.clips import MovingSource, heard_from
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.air import energy_exponents
from generators.acoustics.tracer.settings import TraceSettings
from generators.acoustics.tracks import as_pose, as_track
from tests.support.tiers import some

F64 = NDArray[np.float64]

RATE = 44_100
EAR = 0.0875
LISTENER = np.array([0.0, 1.5, 0.0])
#: Early sound alone: rays end after 3.4 m.
EARLY = TraceSettings(arrivals=1, least_rays=1, most_rays=1, rain_rays=0, diffraction=False, seconds=0.01)


def tones(seconds: F64) -> F64:
    """A sum of tones from 100 Hz to 4 kHz that has always sounded."""
    rng = np.random.default_rng(0)
    parts = zip(rng.uniform(100, 4000, 40), rng.uniform(0, 2 * np.pi, 40), strict=True)
    return np.asarray(sum(np.sin(2 * np.pi * f * seconds + phase) for f, phase in parts) / 9)


def circle(centre: tuple[float, float, float], turns: float) -> Callable[[F64], F64]:
    """Position (n, 3) on a circle of 2 m at times (n,)."""

    def at(seconds: F64) -> F64:
        angle = 2 * np.pi * turns * seconds
        flat = np.stack([2 * np.sin(angle), np.zeros_like(angle), -2 * np.cos(angle)], axis=1)
        return np.asarray(flat + np.array(centre))

    return at


def exact(at: Callable[[F64], F64], ear: F64, seconds: F64) -> F64:
    """The plane wave that a microphone ``ear`` metres beside the listener hears: retarded delay, 1/r."""
    emitted = seconds
    for _ in range(30):
        towards = at(emitted) - LISTENER
        distance = np.linalg.norm(towards, axis=1)
        emitted = seconds - distance / SPEED_OF_SOUND
    return tones(emitted + (towards / distance[:, None]) @ ear / SPEED_OF_SOUND) / distance


@pytest.mark.parametrize(
    ("centre", "turns"),
    some([((0.0, 1.5, 0.0), 0.25), ((0.0, 1.5, 1.2), 0.5)], every=2),
    ids=["itd alone", "doppler and 1/r"],
)
def test_a_source_that_circles_in_the_free_field_is_exact(centre: tuple[float, float, float], turns: float) -> None:
    seconds = np.arange(RATE // 2) / RATE
    at = circle(centre, turns)
    times = np.arange(-0.1, 0.55, 0.01)
    path = [(float(t), tuple(map(float, place))) for t, place in zip(times, at(times), strict=True)]
    ears = np.array([[-EAR, 0.0, 0.0], [EAR, 0.0, 0.0]])
    heard = acoustics.Tracer().render(
        acoustics.Room.free_field(), tones(seconds), path, LISTENER, acoustics.Array(ears), sample_rate=RATE
    )
    window = 4410
    for channel, ear in zip(heard, ears, strict=True):
        wanted = exact(at, ear, seconds)
        for first in range(2205, len(seconds) - window, window):
            a, b = channel[first : first + window], wanted[first : first + window]
            assert abs(10 * np.log10(np.square(a).sum() / np.square(b).sum())) < 0.1
            lags = [float(a @ wanted[first + lag : first + lag + window]) for lag in range(-3, 4)]
            assert np.argmax(lags) == 3  # to the sample
        rest = slice(1000, -10)
        error = np.square((channel - wanted)[rest]).sum() / np.square(wanted[rest]).sum()
        assert 10 * np.log10(error) < -40
        crest = [np.abs(np.diff(x[rest])).max() / np.diff(x[rest]).std() for x in (channel, wanted)]
        assert crest[0] < 1.05 * crest[1]  # no click


def test_the_doppler_shift_of_an_approaching_source() -> None:
    seconds, speed, rate = np.arange(8000) / 16_000, 10.0, 16_000
    path = [(0.0, (0.0, 0.0, -30.0)), (0.5, (0.0, 0.0, -30.0 + speed * 0.5))]
    tone = np.sin(2 * np.pi * 1000 * seconds)
    heard = acoustics.Tracer().render(
        acoustics.Room.free_field(), tone, path, (0.0, 0.0, 0.0), acoustics.Omni(), sample_rate=rate
    )[0]
    late = heard[3000:7900]
    crossings = np.flatnonzero((late[:-1] < 0) & (late[1:] >= 0))
    place = crossings - late[crossings] / (late[crossings + 1] - late[crossings])
    found = (len(place) - 1) / (place[-1] - place[0]) * rate
    assert found == pytest.approx(1000 / (1 - speed / SPEED_OF_SOUND), abs=0.05)


def in_a_room(rate: int) -> tuple[acoustics.Room, F64]:
    rng = np.random.default_rng(0)
    spectrum = np.fft.rfft(rng.standard_normal(rate // 2))
    frequency = np.fft.rfftfreq(rate // 2, 1 / rate)
    spectrum[(frequency < 200) | (frequency > 4000)] = 0
    room = acoustics.Room.shoebox((6, 2.7, 4), {"floor": 0.3, "*": 0.2})
    return room, np.fft.irfft(spectrum)


def through_static(responses: Iterable[NDArray[np.float32]], count: int, signal: F64) -> F64:
    """(1, n) the signal cross-faded through ``count`` responses of places evenly along the way."""
    knots = np.rint(np.linspace(0, len(signal), count)).astype(np.int64)
    moving, wanted = MovingSource(knots, np.zeros(count)), np.zeros((1, len(signal)))
    for k, response in enumerate(responses):
        offset, sound = heard_from(signal, response, moving, k, (0, len(signal)))
        wanted[:, offset : offset + sound.shape[1]] += sound
    return wanted


def error_db(heard: NDArray[np.float32], wanted: F64) -> float:
    """Energy of the difference relative to what is wanted, without the beginning."""
    rest = slice(1000, None)
    return float(10 * np.log10(np.square((heard - wanted)[:, rest]).sum() / np.square(wanted[:, rest]).sum()))


@pytest.mark.slow
def test_a_room_sounds_as_through_many_static_responses() -> None:
    rate, count, listener = 16_000, 250, (4.2, 1.2, 2.9)
    room, signal = in_a_room(rate)
    path = [(0.0, (1.0, 1.5, 1.5)), (0.5, (1.25, 1.4, 1.6))]
    engine, omni = acoustics.Tracer(settings=EARLY), acoustics.Omni()
    heard = engine.render(room, signal, path, listener, omni, sample_rate=rate)
    session = engine.backend(omni).open(room.scene, path[0][1], room="room", sample_rate=rate)

    def responses() -> Iterator[NDArray[np.float32]]:
        for place in as_track(path, "source").position_at(np.linspace(0, 0.5, count)):
            session.move_source((float(place[0]), float(place[1]), float(place[2])))
            yield omni.response(session.early(as_pose(listener)), np.eye(3), rate)

    assert error_db(heard, through_static(responses(), count, signal)) < -40


@pytest.mark.slow
def test_with_fixed_carriers_the_late_sound_is_that_of_static_responses_too() -> None:
    """The whole clip; `benchmarks.moving_error` has 1,000 responses of full length."""
    rate, count, listener = 8000, 40, (4.2, 1.2, 2.9)
    room, signal = in_a_room(rate)
    ends = np.array([(1.0, 1.5, 1.5), (1.1, 1.46, 1.54)])
    path = [(0.0, ends[0]), (len(signal) / rate, ends[1])]
    places = ends[0] + np.linspace(0, 1, count)[:, None] * (ends[1] - ends[0])
    found = {}
    for fixed in (False, True):
        settings = TraceSettings(seconds=0.12, fixed_carriers=fixed)
        engine, omni = acoustics.Tracer(seed=1, settings=settings), acoustics.Omni()
        heard = engine.render(room, signal, path, listener, omni, sample_rate=rate)
        rirs = engine.responses(room, places, [listener], receiver=omni, sample_rate=rate)
        found[fixed] = error_db(heard, through_static((rir.samples for rir in rirs), count, signal))
    assert found[True] < -40
    assert found[False] > -20  # of rays, which are other ones a few centimetres on


@pytest.mark.parametrize("engine", [acoustics.Tracer(seed=1), acoustics.Analytic()], ids=["tracer", "analytic"])
@pytest.mark.parametrize("moves", some(["both", "source", "listener"], every=3))
def test_the_level_is_that_of_static_responses_and_does_not_pump(engine: acoustics.Engine, moves: str) -> None:
    rate = 8000
    room, signal = in_a_room(rate)
    signal = np.tile(signal, 3)
    ends = {"source": ((1.0, 1.5, 1.5), (1.2, 1.4, 1.6)), "listener": ((4.2, 1.2, 2.9), (4.0, 1.2, 2.9))}
    places = {name: [(0.0, a), (1.5, b)] if moves in (name, "both") else a for name, (a, b) in ends.items()}
    heard = engine.render(room, signal, places["source"], places["listener"], sample_rate=rate)
    assert heard.shape == (2, len(signal))
    middle = [np.mean(pair, axis=0) if moves in (name, "both") else pair[0] for name, pair in ends.items()]
    still = engine.render(room, signal, *middle, sample_rate=rate)
    late = slice(rate // 2, None)
    level = 10 * np.log10(np.square(heard[:, late]).sum() / np.square(still[:, late]).sum())
    assert abs(level) < 1.0
    windows = [np.square(x[:, late].reshape(2, -1, 400)).sum(axis=(0, 2)) for x in (heard, still)]
    spread = [np.std(10 * np.log10(each)) for each in windows]
    assert spread[0] < spread[1] + 0.3


def test_what_stands_still_is_the_convolution_with_its_response() -> None:
    room, signal = in_a_room(8000)
    engine = acoustics.Analytic()
    heard = engine.render(room, signal, (1, 1.5, 2), (4, 1.5, 2), sample_rate=8000)
    response = engine.response(room, (1, 1.5, 2), (4, 1.5, 2), sample_rate=8000).samples
    wanted = np.stack([np.convolve(signal, channel)[: len(signal)] for channel in response])
    np.testing.assert_allclose(heard, wanted, atol=1e-5)
    path = [(0.0, (1, 1.5, 2)), (0.5, (1, 1.5, 2))]
    np.testing.assert_array_equal(engine.render(room, signal, path, (4, 1.5, 2), sample_rate=8000), heard)


def test_a_listener_who_turns_hears_the_source_change_ears() -> None:
    rate = 16_000
    signal = np.random.default_rng(0).standard_normal(rate // 2)
    turn = [(0.0, Pose.from_yaw((0, 0, 0), np.pi / 2)), (0.5, Pose.from_yaw((0, 0, 0), -np.pi / 2))]
    heard = acoustics.Tracer().render(acoustics.Room.free_field(), signal, (0, 0, -2), turn, sample_rate=rate)
    left, right = (np.square(channel.reshape(8, -1)).sum(axis=1) for channel in heard)
    level = 10 * np.log10(left / right)
    assert (level[1:4] < -2).all()
    assert (level[4:7] > 2).all()


def test_a_directional_source_that_turns_fades() -> None:
    """From its front almost to its back in half a second: (1 + cos θ)/2 at every moment."""
    rate, listener = 16_000, (0.0, 0.0, 1.0)
    signal = np.random.default_rng(0).standard_normal(rate // 2)
    turn = [(0.1 * k, Pose.from_yaw((0, 0, 0), 0.9 * np.pi * k / 5)) for k in range(6)]
    cardioid, free = acoustics.Directivity.cardioid(), acoustics.Room.free_field()
    heard, plain = (
        acoustics.Tracer().render(free, signal, source, listener, acoustics.Omni(), shape, rate)[0].reshape(10, -1)
        for source, shape in ((turn, cardioid), ((0, 0, 0), None))
    )
    amplitude = np.sqrt(np.square(heard).sum(axis=1) / np.square(plain).sum(axis=1))
    angle = 0.9 * np.pi * (np.arange(10) + 0.5) / 10
    np.testing.assert_allclose(amplitude, (1 + np.cos(angle)) / 2, atol=0.02)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"signal": np.array([0.0, np.nan])}, "signal: 1 of 2 samples are NaN or infinite"),
        ({"signal": np.zeros((2, 9))}, r"signal: has shape \(2, 9\), expected \(n,\) mono samples"),
        (
            {"source": [(0.0, (1, 1.5, 2)), (0.0, (2, 1.5, 2))]},
            "source: the times of its path must be finite and ascend",
        ),
        ({"source": [(0.0, (1, 1.5, 2)), (1.0, (2, 1.5))]}, r"source, entry 1 of its path: \(2, 1.5\); expected"),
        ({"listener": [("now", (1, 1.5, 2))]}, "listener: a time of its path is no number"),
        ({"source": [(0.0, (1, 1.5, 2)), (0.01, (9, 1.5, 2))]}, "source position .* lies outside the scene"),
    ],
)
def test_bad_signals_and_paths_are_said_in_one_line(change: dict[str, object], text: str) -> None:
    room = acoustics.Room.shoebox((6, 2.7, 4), 0.2)
    asked: dict[str, object] = {"signal": np.ones(800), "source": (1, 1.5, 2), "listener": (4, 1.5, 2)}
    with pytest.raises(Avs3dError, match=text) as error:
        acoustics.Analytic(images=50, tail=False).render(room, **(asked | change), sample_rate=8000)  # type: ignore[arg-type]
    assert "\n" not in str(error.value)


def test_air_takes_what_it_takes_from_tones() -> None:
    """The exact answer of the free field leaves out the air, which is below the tolerance at 2 m and 4 kHz."""
    assert 10 * np.log10(np.e) * energy_exponents()[6] * 2 < 0.1
