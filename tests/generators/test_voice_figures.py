"""Figures of voices beside recordings: a sound of known octaves, modulation and crest factor; what lies outside."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import soundfile
from PIL import Image
from scipy.signal import butter, sosfilt

from benchmarks import voices
from generators.assets.sounds import synthesise

RATE, SECONDS = 44_100, 8
TIME = np.arange(RATE * SECONDS) / RATE


def test_two_tones_have_the_levels_of_their_octaves_and_the_crest_factor_of_their_sum() -> None:
    """Amplitudes 1 and .1: 0 and −20 dB; the peak is 1.1, the mean square .505."""
    found = voices.figures(np.sin(2 * np.pi * 1000 * TIME) + 0.1 * np.sin(2 * np.pi * 4000 * TIME + np.pi / 2), RATE)
    assert found["octave 1000"] == pytest.approx(10 * np.log10(1 / 1.01), abs=0.01)
    assert found["octave 4000"] == pytest.approx(10 * np.log10(0.01 / 1.01), abs=0.01)
    assert found["octave 250"] < -80
    # Where the first is at its peak, the second is, too: cos(4·π/2) = 1.
    assert found["crest"] == pytest.approx(20 * np.log10(1.1 / np.sqrt(0.505)), abs=0.01)
    assert found["modulation 4"] < -60
    assert found["quiet"] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("depth", [0.2, 0.8])
@pytest.mark.parametrize("rate", [4, 16])
def test_a_tone_that_swings_has_its_modulation_in_the_band_of_its_rate(rate: int, depth: float) -> None:
    """Envelope 1 + m cos: a Hann window spreads (m/2)² over three bins, 1 + 2 · ¼ times the middle one."""
    found = voices.figures((1 + depth * np.cos(2 * np.pi * rate * TIME)) * np.sin(2 * np.pi * 1000 * TIME), RATE)
    assert found[f"modulation {rate}"] == pytest.approx(20 * np.log10(depth / 2) + 10 * np.log10(1.5), abs=0.2)
    assert all(found[f"modulation {other}"] < -40 for other in voices.MODULATIONS if other != rate)


def test_octaves_that_a_sample_rate_does_not_reach_are_left_out() -> None:
    assert "octave 4000" not in voices.figures(np.random.default_rng(0).standard_normal(16_000), 8000)


def test_units_are_left_out_of_octaves_that_their_capture_does_not_reach() -> None:
    """The octave of 8 kHz ends at 11.3 kHz, 0.9 of 12.57; that of 4 kHz at 5.66, 0.9 of 6.29."""
    noise = np.random.default_rng(0).standard_normal((3, len(TIME)))
    known = {"recording": (noise[0], RATE)}
    dull = sosfilt(butter(4, 4000, fs=RATE, output="sos"), noise[1])
    short, full = voices.Unit(dull, 12_500.0), voices.Unit(noise[2], 12_600.0)
    found = voices.compare({"both": [short, full], "short": [short]}, known)["voices"]
    assert found["both"]["figures"]["octave 8000"] == voices.figures(full.signal, RATE)["octave 8000"]
    both = [voices.figures(unit.signal, RATE)["octave 4000"] for unit in (short, full)]
    assert found["both"]["figures"]["octave 4000"] == pytest.approx(np.mean(both))
    assert "octave 8000" not in found["short"]["figures"]
    assert "octave 4000" in found["short"]["figures"]
    assert "octave 4000" not in voices.figures(dull, RATE, 6200.0)


def test_a_unit_is_what_a_source_plays_and_has_the_end_of_its_capture() -> None:
    found = voices.unit_of("clock", "carriage_lever", 1)
    played = synthesise("clock", voices.SECONDS, np.random.default_rng([1, 33]), voice="carriage_lever")
    np.testing.assert_array_equal(found.signal, played)
    assert 4000 < found.end < 18_000


def test_a_voice_is_held_to_the_spread_of_the_recordings_and_each_of_them_to_the_others() -> None:
    tone, noise = np.sin(2 * np.pi * 1000 * TIME), np.random.default_rng(0).standard_normal((3, len(TIME)))
    known = {"one": (noise[0], RATE), "other": (noise[1], RATE), "tone": (tone, RATE)}
    ours = {"hiss": [voices.Unit(noise[2], np.inf)], "low": [voices.Unit(np.sin(2 * np.pi * 100 * TIME), np.inf)]}
    report = voices.compare(ours, known)
    assert report["voices"]["hiss"]["outside"] == {}
    low, least, most = report["voices"]["low"]["outside"]["octave 125"]
    assert low == pytest.approx(0.0, abs=0.01)
    assert least < most < -10
    assert [one["number"] for one in report["recordings"].values()] == [1, 2, 3]
    assert report["recordings"]["one"]["outside"] == {}
    assert "octave 1000" in report["recordings"]["tone"]["outside"]


def test_a_sheet_is_small_enough_for_the_pages(tmp_path: Path) -> None:
    (tmp_path / "clock").mkdir()
    soundfile.write(tmp_path / "clock" / "tick.wav", 0.1 * np.sin(2 * np.pi * 440 * TIME), RATE)
    found = voices.recordings(tmp_path, "clock")
    data = voices.sheet(found | {"noise": (np.random.default_rng(0).standard_normal(len(TIME)), RATE)})
    assert len(data) <= voices.SHEET_BYTES
    assert Image.open(BytesIO(data)).format == "JPEG"
