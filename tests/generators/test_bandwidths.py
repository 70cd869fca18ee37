"""Bandwidth and floor of sounds, and their spread over categories."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import soundfile
from scipy.signal import butter, sosfilt

from benchmarks import bandwidths

RATE = 44_100


def noise(seconds: float, seed: int = 0) -> bandwidths.Array:
    return np.random.default_rng(seed).standard_normal(round(seconds * RATE))


@pytest.mark.parametrize("end", [3000.0, 9000.0])
def test_the_bandwidth_is_where_the_spectrum_ends_whatever_the_floor_below_60_db(end: float) -> None:
    steep = np.asarray(sosfilt(butter(16, end, "lowpass", fs=RATE, output="sos"), noise(3)))
    for floor_db in (-120.0, -80.0):
        found = bandwidths.bandwidth(steep + 10 ** (floor_db / 20) * noise(3, 1))
        # Sixteen poles fall by 60 dB within two thirds of an octave.
        assert 1.0 <= 1000 * found / end < 1.7
    assert bandwidths.bandwidth(steep + 0.01 * noise(3, 1)) > 20.0


def test_the_floor_is_the_level_of_the_quiet_moments() -> None:
    steady = noise(4)
    assert -2.0 < bandwidths.floor(steady) < 0.0
    steady[: RATE // 2] *= 0.01
    assert bandwidths.floor(steady) == pytest.approx(-40.0, abs=1.0)
    steady[: RATE // 2] = 0.0
    assert bandwidths.floor(steady) <= -100.0


def test_takes_of_a_long_recording_are_few_and_a_short_one_is_one(tmp_path: Path) -> None:
    (tmp_path / "clock").mkdir()
    soundfile.write(tmp_path / "clock" / "long.wav", 0.1 * noise(45), RATE)
    soundfile.write(tmp_path / "clock" / "short.wav", 0.1 * noise(2), 16_000)
    found = bandwidths.of_recordings([tmp_path])
    assert list(found) == ["clock"]
    assert np.shape(found["clock"]) == (bandwidths.TAKES + 1, 2)
    assert found["clock"][-1][0] == 8.0, "a file of 16 kHz has nothing above 8"


def test_every_category_counts_alike_and_stands_beside_its_recordings() -> None:
    voices = {"clock": [[5.0, -1.0]] * 9, "toilet": [[15.0, -3.0]]}
    report = {"voices": bandwidths.quartiles(voices), "recordings": bandwidths.quartiles({"clock": [[7.0, -20.0]] * 2})}
    assert report["voices"]["all"]["bandwidth"][1:4] == [5.0, 5.0, 15.0]
    rows = {row[0]: row[1:] for row in bandwidths.table(report)}
    assert list(rows) == [*bandwidths.CATEGORIES, "all"]
    assert rows["clock"] == [
        "2",
        "7.0 (7.0 to 7.0)",
        "-20.0 (-20.0 to -20.0)",
        "9",
        "5.0 (5.0 to 5.0)",
        "-1.0 (-1.0 to -1.0)",
    ]
    assert rows["toilet"] == ["0", "", "", "1", "15.0 (15.0 to 15.0)", "-3.0 (-3.0 to -3.0)"]
    assert rows["telephone"] == ["0", "", "", "0", "", ""]
