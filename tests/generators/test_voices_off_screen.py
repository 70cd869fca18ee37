"""Sounds of other categories: their split, their levels, and facts of their models."""

from __future__ import annotations

from collections import Counter, defaultdict

import numpy as np
import pytest
from numpy.typing import NDArray

from avs3d_bench.contract.taxonomy import CATEGORIES, OFF_SCREEN_CATEGORIES
from generators.assets.sounds import SECOND_FLOOR_DB, TARGET_LUFS, Voice, voices
from generators.assets.sounds.capture import captured
from generators.assets.sounds.devices.off_screen_animate import _bark, _dog_formants
from generators.assets.sounds.devices.off_screen_machines import _blades
from generators.assets.sounds.devices.off_screen_music import _string
from generators.assets.sounds.devices.off_screen_street import _pass
from generators.assets.sounds.formants import noises, speak, talker
from generators.assets.sounds.loudness import CEILING_DB, normalised
from generators.assets.sounds.room_tone import slow_curve, spectrum_noise
from generators.assets.sounds.signals import upsampled
from tests.support.spectra import strongest
from tests.support.tiers import some

SR = 44_100
Array = NDArray[np.float64]
VOICES = [voice for category in OFF_SCREEN_CATEGORIES for voice in voices(category)]


def test_each_category_has_devices_in_training_and_test() -> None:
    found: dict[str, list[Voice]] = defaultdict(list)
    for voice in VOICES:
        found[voice.category].append(voice)
    assert set(found) == set(OFF_SCREEN_CATEGORIES)
    assert not set(found) & set(CATEGORIES)
    for of_category in found.values():
        assert len({voice.name for voice in of_category}) == len(of_category) >= 3
        assert len({voice.mechanism for voice in of_category}) >= 3
        splits = Counter(voice.split for voice in of_category)
        assert (splits["train"], splits["validation"], splits["test"]) >= (2, 1, 1)
        assert min(splits["validation"], splits["test"]) >= 1
        # A training voice is a device of another mechanism, not the same one with other numbers.
        training = [voice.mechanism for voice in of_category if voice.split == "train"]
        assert len(set(training)) == len(training)


@pytest.mark.parametrize(
    "voice",
    some(VOICES, every=4),
    ids=[f"{voice.category}/{voice.name}" for voice in VOICES],
)
def test_a_sound_repeats_for_a_seed_and_is_never_silent(voice: Voice) -> None:
    rng = np.random.default_rng(1)
    sound = voice.play(3 * SR, rng)
    assert sound.shape == (3 * SR,)
    assert sound.dtype == np.float64
    assert np.array_equal(sound, voice.play(3 * SR, np.random.default_rng(1)))
    assert abs(np.corrcoef(sound, voice.play(3 * SR, np.random.default_rng(2)))[0, 1]) < 0.5
    power = np.abs(np.fft.rfft(sound)) ** 2
    assert power[16_000 * 3 :].sum() < 4e-3 * power.sum()
    source = normalised(captured(sound, rng), SR, TARGET_LUFS, CEILING_DB).astype(np.float64)
    assert 10 * np.log10(np.square(source.reshape(3, SR)).mean(axis=1).min()) > SECOND_FLOOR_DB


def test_speech_is_modulated_by_syllables() -> None:
    rng = np.random.default_rng(3)
    speech = speak(20 * SR, rng, talker(rng, "woman", 0.8), noises(20 * SR, rng))
    level = np.sqrt(np.square(speech).reshape(-1, SR // 100).mean(axis=1))
    swing = np.abs(np.fft.rfft(level - level.mean())) ** 2
    rates = np.fft.rfftfreq(len(level), 0.01)
    assert swing[(rates > 2) & (rates < 8)].sum() > 2 * swing[(rates > 8) & (rates < 32)].sum()
    # A woman's larynx.
    middle = speech[int(np.argmax(level)) * SR // 100 :][: SR // 8]
    assert any(120 < strongest(middle, 100, 1100, padded=4) / k < 400 for k in range(1, 6))


def test_formants_of_a_dog_are_odd_multiples() -> None:
    formants = _dog_formants(np.random.default_rng(0), 0.2)
    assert [f for f, _ in formants[:3]] == pytest.approx([437.5, 1312.5, 2187.5], rel=0.09)
    bark = _bark(np.random.default_rng(1), 400.0, 0.2, 0.3, formants)
    assert len(bark) == int(0.2 * SR)
    assert np.abs(bark[: SR // 200]).max() < np.abs(bark).max() > np.abs(bark[-SR // 200 :]).max()


@pytest.mark.parametrize("pitch", [110.0, 196.3, 440.0])
def test_a_string_is_in_tune(pitch: float) -> None:
    tone = _string(np.random.default_rng(0), pitch, 1.0, 0.5)
    assert strongest(tone, 0.8 * pitch, 1.3 * pitch, padded=4) == pytest.approx(pitch, rel=0.006)


def test_blades_pass_at_a_multiple_of_the_shaft() -> None:
    sound = _blades(4 * SR, np.random.default_rng(0), np.full(4 * SR, 20.0), 5, 0.1)
    assert strongest(sound, 10, 150, padded=4) == pytest.approx(100.0, abs=0.5)


def test_a_passing_car_is_loudest_where_it_is_near_and_its_pitch_falls() -> None:
    t = np.arange(-60, 60, 0.01)
    level, doppler = _pass(t, 0.0, 7.0, 15.0)
    assert level.max() == pytest.approx(1.0)
    assert level[0] == pytest.approx(7 / 900, rel=0.01)
    assert doppler[0] == pytest.approx(1 / (1 - 15 / 343), rel=1e-3)
    assert doppler[-1] == pytest.approx(1 / (1 + 15 / 343), rel=1e-3)
    assert np.all(np.diff(doppler) <= 0)


def test_a_kettle_whistles_between_one_and_four_kilohertz() -> None:
    kettle = next(voice for voice in VOICES if voice.name == "stove_whistle")
    whistle = kettle.play(30 * SR, np.random.default_rng(0)).reshape(30, SR)
    loud = whistle[int(np.argmax(np.square(whistle).mean(axis=1)))]
    power = np.abs(np.fft.rfft(loud * np.hanning(SR))) ** 2
    tone = int(np.argmax(power))
    assert 1300 < tone < 3900
    assert power[tone - 40 : tone + 40].sum() > 0.3 * power.sum()


def test_noise_has_the_spectrum_that_is_asked_for() -> None:
    noise = spectrum_noise(10 * SR, np.random.default_rng(0), [100, 1000, 10_000], [0, -20, -20])
    power = np.abs(np.fft.rfft(noise)) ** 2
    density = [power[10 * low : 10 * high].mean() for low, high in ((95, 105), (980, 1020), (7000, 9000))]
    assert 10 * np.log10(np.array(density) / density[0]) == pytest.approx([0, -20, -20], abs=2.0)
    assert np.std(noise) == pytest.approx(1.0)


def test_lines_between_values() -> None:
    assert upsampled(np.array([0.0, 1.0, 0.0]), 4, 8).tolist() == [0, 0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25]
    assert upsampled(np.array([1.0, 2.0]), 2, 6).tolist() == [1, 1.5, 2, 2, 2, 2]
    curve = slow_curve(60 * SR, np.random.default_rng(0), 8.0, 0.3)
    assert curve.shape == (60 * SR,)
    assert 0.2 < np.std(curve) < 0.3, "lines between values deviate less than the values"
