"""Errors of impulse responses against decays whose figures are known in closed form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import decay_figures, onset
from evaluators import metrics
from generators.acoustics.rir import Rir

RATE = 16_000
#: Energy falls by 60 dB in T: exp(−13.8 t / T), amplitude exp(−6.9 t / T).
FALL = 3 * math.log(10)


def decay(seconds: float, delay: int = 0, length: float = 2.0) -> np.ndarray:
    """(n,) exponential decay by 60 dB in ``seconds`` after some samples of silence."""
    time = np.arange(round(length * RATE)) / RATE
    return np.concatenate([np.zeros(delay), np.exp(-FALL * time / seconds)])


def clarity(seconds: float) -> float:
    """C50 of an exponential decay: (1 − e^(−2·FALL·0.05/T)) / e^(−2·FALL·0.05/T), dB."""
    return 10 * math.log10(math.expm1(2 * FALL * 0.05 / seconds))


@pytest.mark.parametrize("seconds", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("delay", [0, 100, 1600])
def test_figures_of_an_exponential_decay(seconds: float, delay: int) -> None:
    found = decay_figures(decay(seconds, delay), RATE)
    for name in ("T60", "T30", "EDT"):
        assert found[name] == pytest.approx(seconds, rel=2e-3), name
    assert found["C50"] == pytest.approx(clarity(seconds), abs=0.01)
    assert onset(decay(seconds, delay)) == delay


def test_errors_are_percent_seconds_and_decibels() -> None:
    truth, prediction = np.stack([decay(0.5), decay(0.4)]), np.stack([decay(0.55), decay(0.3)])
    found = metrics.rir.evaluate(truth, prediction, RATE)
    assert [found["T60"], found["T30"]] == pytest.approx([17.5, 17.5], abs=0.1)
    assert found["EDT"] == pytest.approx((0.05 + 0.1) / 2, abs=1e-3)
    expected = [abs(clarity(a) - clarity(b)) for a, b in ((0.5, 0.55), (0.4, 0.3))]
    assert found["C50"] == pytest.approx(np.mean(expected), abs=0.01)
    assert found["invalid"] == 0


def test_a_two_slope_decay_tells_the_times_apart() -> None:
    """A fast early decay and a slow late one, 20 dB below: EDT < T60 < T30."""
    mixed = np.sqrt(decay(0.1) ** 2 + 0.002 * decay(1.0) ** 2)
    found = decay_figures(mixed, RATE)
    assert found["EDT"] < found["T60"] < found["T30"]  # type: ignore[operator]


def test_a_late_start_counts_from_the_first_sample_only_if_asked() -> None:
    truth, late = decay(0.5), decay(0.5, delay=800)
    same = metrics.rir.evaluate(truth, late, RATE)
    assert same["C50"] == pytest.approx(0, abs=1e-6)
    assert same["EDT"] == pytest.approx(0, abs=1e-6)
    # 50 ms of silence: all that is early is late then.
    counted = metrics.rir.evaluate(truth, decay(0.5, delay=400), RATE, from_start=True)
    lost = 10 * math.log10(math.expm1(2 * FALL * 0.025 / 0.5)) - clarity(0.5)
    assert counted["C50"] == pytest.approx(abs(lost), abs=0.02)
    assert counted["EDT"] > 0.01


def test_level_and_channels_make_no_difference() -> None:
    one = metrics.rir.evaluate(decay(0.5), decay(0.6), RATE)
    truth, prediction = np.tile(decay(0.5), (3, 2, 1)), np.tile(0.01 * decay(0.6), (3, 2, 1))
    assert metrics.rir.evaluate(truth, prediction, RATE) == pytest.approx(one)


def test_what_cannot_be_measured_in_the_prediction_is_counted() -> None:
    truth = np.stack([decay(0.5), decay(0.5)])
    cut = truth.copy()
    cut[1] = 0
    found = metrics.rir.evaluate(truth, cut, RATE)
    assert found["T60"] == pytest.approx(0)
    assert found["invalid"] == 0.5
    nothing = metrics.rir.evaluate(np.zeros(100), decay(0.5), RATE)
    assert math.isnan(nothing["T60"])
    assert math.isnan(nothing["invalid"])


def test_the_figures_of_a_response_of_the_engines_agree_with_those_of_its_octaves() -> None:
    """White noise that decays alike at all frequencies: `Rir`'s octaves and the figures over all frequencies agree."""
    rng = np.random.default_rng(3)
    noise = (rng.standard_normal(2 * RATE) * decay(0.6)).astype(np.float32)
    rir = Rir(noise[None], RATE, ("omni",), (0.0, 0.0, 0.0), Pose.from_yaw((0.001, 0.0, 0.0), 0.0))
    figures = decay_figures(noise, RATE, 0)
    assert figures["T30"] == pytest.approx(np.mean([rir.t30()[f] for f in (1000, 2000, 4000)]), rel=0.05)
    assert figures["C50"] == pytest.approx(np.mean([rir.c50()[f] for f in (1000, 2000, 4000)]), abs=0.8)


@pytest.mark.parametrize(
    ("truth", "prediction", "rate", "message"),
    [
        (decay(0.5), decay(0.5), 0, "rate: 0, expected samples per second"),
        (decay(0.5), decay(0.5), "16k", "rate: '16k'"),
        (decay(0.5), np.stack([decay(0.5)] * 2), RATE, r"prediction: shape \(2, 32000\), expected \(\) responses"),
        (decay(0.5), np.full(10, np.nan), RATE, "prediction: 10 of 10 samples are NaN or infinite"),
        (np.zeros((0, 10)), np.zeros((0, 10)), RATE, r"truth: shape \(0, 10\), expected"),
        (["a"], decay(0.5), RATE, "truth: "),
    ],
)  # fmt: skip
def test_bad_input_is_one_line(truth: Any, prediction: Any, rate: Any, message: str) -> None:
    with pytest.raises((Avs3dError, UsageError), match=message) as caught:
        metrics.rir.evaluate(truth, prediction, rate)
    assert "\n" not in str(caught.value)
