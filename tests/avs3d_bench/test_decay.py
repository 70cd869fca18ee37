"""Reverberation times of recorded hand claps, and of energies that fall exponentially."""

from __future__ import annotations

import numpy as np
import pytest

from avs3d_bench.measures.decay import clap_time, fit_decay
from tests.support.tiers import some

RATE = 48_000


def clap(seconds: float, noise_db: float, seed: int, quieter: bool = False) -> np.ndarray:
    """(2, n) a second of noise, a decay of ``seconds`` per 60 dB, and maybe a quieter clap before it."""
    rng = np.random.default_rng(seed)
    t = np.arange(3 * RATE) / RATE
    sound = np.concatenate([np.zeros(RATE), rng.normal(size=len(t)) * 10 ** (-3 * t / seconds)])
    if quieter:
        sound[: RATE // 2] += 0.1 * rng.normal(size=RATE // 2) * 10 ** (-3 * t[: RATE // 2] / 0.05)
    return np.stack([sound, sound]) + rng.normal(size=len(sound)) * 10 ** (-noise_db / 20)


@pytest.mark.parametrize("seconds", some([0.25, 0.35, 0.6, 1.2], every=4))
@pytest.mark.parametrize("noise_db", [70, 50])
def test_the_mean_of_a_few_claps_is_the_time_of_the_room(seconds: float, noise_db: float) -> None:
    found = [clap_time(clap(seconds, noise_db, seed), RATE) for seed in range(5)]
    assert np.mean(found) == pytest.approx(seconds, rel=0.05)


def test_the_loudest_clap_counts() -> None:
    assert clap_time(clap(0.5, 60, 1, quieter=True), RATE) == pytest.approx(0.5, rel=0.12)


def test_a_clap_in_noise_and_silence_have_no_time() -> None:
    assert clap_time(clap(0.5, 15, 1), RATE) is None
    assert clap_time(np.zeros(RATE), RATE) is None


def test_energy_that_falls_by_60_db_a_second_takes_a_second() -> None:
    remaining = 10.0 ** (-6.0 * np.arange(2000) / 1000)
    assert fit_decay(remaining, 1000) == pytest.approx(1.0, rel=1e-6)
    assert fit_decay(np.zeros(100), 1000) is None
