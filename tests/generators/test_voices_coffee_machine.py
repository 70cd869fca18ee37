"""The voices of coffee machines: splits, strokes at the mains, pressure, motors, slugs."""

import numpy as np
import pytest

from generators.assets.sounds import find_voice, voices
from generators.assets.sounds.devices.coffee_machine_parts import (
    Housing,
    VibrationPump,
    cracks,
    motor,
    run_up,
    slugs,
)
from generators.assets.sounds.water import Take
from tests.support.spectra import energy_at, prominence

SR = 44_100
VOICES = voices("coffee_machine")


def lines(signal, frequencies):
    """Energy within 1.5 Hz of each frequency."""
    return energy_at(signal, frequencies, 1.5)


def pump(mains, skip=0):
    return VibrationPump(mains, Housing(np.random.default_rng(0), 180, 5000, 12, 0.06), 0.3, 0.2, 0.1, skip)


@pytest.mark.parametrize("mains", [50.0, 60.0])
def test_a_vibration_pump_strokes_once_a_cycle_and_never_repeats(mains):
    heard = pump(mains).runs(np.random.default_rng(1), 4.0, [(0.0, 0.0), (4.0, 0.0)])
    harmonic = mains * np.arange(1, 11)
    assert lines(heard, harmonic).sum() > 20 * lines(heard, harmonic + 0.25 * mains).sum()
    period = round(SR / mains)
    steady = heard[SR // 2 : 3 * SR]
    assert 0.3 < np.corrcoef(steady[period:], steady[:-period])[0, 1] < 0.98


def test_pressure_makes_a_pump_quieter_above_the_hum():
    free, loaded = (
        pump(50.0).runs(np.random.default_rng(1), 3.0, [(0.0, share), (3.0, share)])[SR // 2 : 2 * SR]
        for share in (0.0, 1.0)
    )
    above = [np.square(np.abs(np.fft.rfft(each))[1000:]).sum() for each in (free, loaded)]
    assert above[0] > 1.5 * above[1]


def test_skipped_strokes_add_subharmonics():
    # Of strokes (0, 1, 1, 1), each line between two harmonics has (1/4)² / (3/4)² of the power of a harmonic.
    share = []
    for skip in (0, 4):
        heard = pump(50.0, skip).runs(np.random.default_rng(2), 4.0, [(0.0, 0.5), (4.0, 0.5)])
        between = [50.0 * k + step for k in (2, 3, 4, 5) for step in (12.5, 25.0, 37.5)]
        share.append(lines(heard, between).mean() / lines(heard, [100.0, 150.0, 200.0, 250.0, 300.0]).mean())
    assert share[1] - share[0] == pytest.approx(1 / 9, rel=0.5)


def test_a_motor_runs_up_and_coasts_to_a_stop():
    speed = run_up(2.0, 0.1, 0.5, 1.5)
    assert speed[0] == 0.0
    assert speed[SR] == pytest.approx(1.0, abs=1e-3)
    assert speed[int(2.5 * SR)] == pytest.approx(np.exp(-1.0), abs=0.02)
    assert speed[-1] < 1e-3


def test_a_motor_has_the_line_of_its_strongest_order():
    orders = np.full(20, 0.02)
    orders[11] = 1.0
    heard = motor(np.random.default_rng(0), np.full(2 * SR, 25.0), orders, 0.2)
    power = np.abs(np.fft.rfft(heard)) ** 2
    axis = np.fft.rfftfreq(len(heard), 1 / SR)
    assert axis[power.argmax()] == pytest.approx(300.0, rel=0.03)


def test_fractures_follow_their_rate():
    rate = np.where(np.arange(4 * SR) < 2 * SR, 400.0, 40.0)
    heard = cracks(np.random.default_rng(0), rate, 500, 8000, 0.012)
    ratio = np.square(heard[: 2 * SR]).sum() / np.square(heard[2 * SR :]).sum()
    assert 4.0 < ratio < 25.0


def test_slugs_come_quicker_towards_the_end():
    take = Take(40 * SR, np.random.default_rng(0))
    slugs(take, "spit", (2.0, 38.0), (0.8, 4.0), 300.0, 1.0)
    moments = np.array([moment for moment, _ in take.events])
    assert 2.0 <= moments.min() < moments.max() < 38.0
    assert (moments > 29.0).sum() > 2 * (moments < 11.0).sum()
    assert np.diff(moments).std() > 0.05


def test_an_espresso_machine_is_a_buzz_at_its_mains_and_a_moka_pot_is_not():
    by_name = {voice.name: voice for voice in VOICES}
    share = {}
    for name in ("vibration_pump_espresso", "moka_pot"):
        heard = by_name[name].play(12 * SR, np.random.default_rng(2))[-4 * SR :]
        tones = [lines(heard, mains * np.arange(2, 13)).sum() for mains in (50.0, 60.0)]
        share[name] = max(tones) / lines(heard, 55.0 * np.arange(2, 13)[np.arange(2, 13) % 10 != 0]).sum()
    assert share["vibration_pump_espresso"] > 5 * share["moka_pot"]


def test_steam_has_no_line_of_a_pump_and_a_whipper_has_that_of_its_motor():
    stands = {
        name: [
            prominence(find_voice("coffee_machine", name).play(6 * SR, np.random.default_rng(seed)), 100, 900)
            for seed in range(3)
        ]
        for name in ("steam_espresso", "instant_whipper", "vibration_pump_espresso")
    }
    assert max(stands["steam_espresso"]) < 11.0 < min(stands["instant_whipper"])
    assert min(stands["vibration_pump_espresso"]) > 20.0
