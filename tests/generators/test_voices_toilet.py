"""The voices of toilets and the water they share: splits, bubbles, valves, pipes, flows of given power."""

import numpy as np
import pytest

from generators.assets.sounds import voices
from generators.assets.sounds.water import (
    BANDS,
    bubble_cloud,
    cavity,
    flow,
    frame_times,
    gulps,
    hammer,
    moving_peak,
    pipe,
    source,
    whistle,
)

SR = 44_100
VOICES = voices("toilet")


def test_a_flow_has_the_level_and_the_spectrum_that_are_asked_for():
    count = 4 * SR
    times = frame_times(count)
    # As much in every octave: a density of −3 dB per octave, at level 0.5, then at 0.1.
    level = np.where(times < 2.0, 0.5, 0.1)
    rng = np.random.default_rng(0)
    heard = flow(count, rng, source(np.zeros(len(BANDS)), level, rng, unrest=0.0))
    assert np.std(heard[: int(1.9 * SR)]) == pytest.approx(0.5, rel=0.04)
    assert np.std(heard[int(2.1 * SR) :]) == pytest.approx(0.1, rel=0.04)
    power = np.abs(np.fft.rfft(heard)) ** 2
    frequencies = np.fft.rfftfreq(count, 1 / SR)
    octaves = [power[(frequencies >= f / 2**0.5) & (frequencies < f * 2**0.5)].sum() for f in (500, 1000, 4000)]
    assert 10 * np.log10(octaves) == pytest.approx(10 * np.log10(octaves[0]), abs=0.6)


def test_a_bubble_of_three_millimetres_rings_at_minnaerts_frequency():
    rng = np.random.default_rng(0)
    rate = np.full(len(frame_times(2 * SR)), 4.0)
    heard = bubble_cloud(2 * SR, rng, rate, (2.999, 3.001), rise=0.0)
    power = np.abs(np.fft.rfft(heard)) ** 2
    assert np.fft.rfftfreq(2 * SR, 1 / SR)[power.argmax()] == pytest.approx(3.26 / 0.003, rel=0.06)


def test_an_open_pipe_resonates_at_multiples_of_half_a_wavelength():
    noise = np.random.default_rng(0).standard_normal(4 * SR)
    power = np.abs(np.fft.rfft(pipe(noise, 1.8, 0.7))) ** 2
    frequencies = np.fft.rfftfreq(len(noise), 1 / SR)
    base = 343.0 / (2 * 1.8)
    near = [power[np.abs(frequencies - base * k) < 8.0].mean() for k in (3, 4, 5)]
    between = [power[np.abs(frequencies - base * (k + 0.5)) < 8.0].mean() for k in (3, 4, 5)]
    assert min(near) > 4 * max(between)


def test_water_hammer_repeats_at_a_quarter_wave_of_its_pipe_and_decays():
    heard = hammer(np.random.default_rng(1), 12.0, 0.6)
    energy = np.square(heard)
    assert np.abs(heard).max() < 2.5
    assert energy[: SR // 5].sum() > 5 * energy[SR // 2 :].sum()


def test_a_gulp_has_its_slugs_in_time():
    rng = np.random.default_rng(3)
    heard = gulps(rng, 8, 130.0, 5.0)
    assert 8 / 5.0 < len(heard) / SR - 0.6 < 2.6
    power = np.abs(np.fft.rfft(heard)) ** 2
    frequencies = np.fft.rfftfreq(len(heard), 1 / SR)
    assert 90.0 < frequencies[power.argmax()] < 330.0


def test_a_whistle_is_a_line_that_is_never_exactly_periodic():
    rng = np.random.default_rng(0)
    heard = whistle(rng, np.full(SR, 1000.0), np.ones(SR))
    power = np.abs(np.fft.rfft(heard)) ** 2
    assert abs(int(power.argmax()) - 1000) < 40
    period = SR // 1000
    later = heard[200 * period :]
    assert np.corrcoef(heard[: len(later)], later)[0, 1] < 0.9


def test_a_peak_moves_with_its_frequency():
    factor = moving_peak(np.array([300.0, 3000.0]), 4.0, 10.0)
    assert BANDS[factor.argmax(axis=1)] == pytest.approx([300.0, 3000.0], rel=0.07)
    assert factor.max() == pytest.approx(11.0, rel=0.1)


def test_a_body_adds_its_modes_and_keeps_the_blow():
    blow = np.zeros(SR)
    blow[100] = 1.0
    heard = cavity(blow, np.random.default_rng(0), 200.0, 2000.0, 10, 1.5)
    assert np.abs(heard[:100]).max() < 1e-9
    assert heard[100] == pytest.approx(1.0, abs=0.3)
    assert np.square(heard[200:2000]).sum() > 100 * np.square(heard[8000:]).sum() > 0.0


def test_a_flush_ends_and_a_running_cistern_does_not():
    by_name = {voice.name: voice for voice in VOICES}
    spread = {}
    for name in ("pressure_assisted", "running_ballcock"):
        heard = by_name[name].play(40 * SR, np.random.default_rng(0)).reshape(-1, SR)
        levels = 10 * np.log10(np.mean(np.square(heard), axis=1))
        spread[name] = levels.max() - levels.min()
    assert spread["pressure_assisted"] > 12.0 > spread["running_ballcock"]
