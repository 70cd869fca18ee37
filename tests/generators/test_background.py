"""Background noise against the formula of the diffuse field."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import csd, welch

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.acoustics.background import EAR_DISTANCE, Kind, coherence, diffuse_noise
from tests.support.tiers import some

KINDS: tuple[Kind, ...] = ("room_tone", "noise")


def test_the_formula_is_that_of_cook() -> None:
    """sin(kd)/(kd) for d = 17.5 cm: 1 at 0 Hz, its first zero at c/2d = 980 Hz."""
    assert coherence(np.array([0.0]))[0] == 1.0
    k = 2 * np.pi * 500 / 343.0
    assert coherence(np.array([500.0]))[0] == pytest.approx(np.sin(k * EAR_DISTANCE) / (k * EAR_DISTANCE))
    assert coherence(np.array([343.0 / (2 * EAR_DISTANCE)]))[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("kind", some(KINDS, every=2))
def test_the_ears_have_the_coherence_of_a_diffuse_field(kind: Kind) -> None:
    left, right = diffuse_noise(kind, 60, np.random.default_rng(3))
    frequency, cross = csd(left, right, SAMPLE_RATE, nperseg=4096)
    powers = [welch(ear, SAMPLE_RATE, nperseg=4096)[1] for ear in (left, right)]
    found = np.real(cross) / np.sqrt(powers[0] * powers[1])
    below = (frequency > 30) & (frequency < 1000)
    assert np.abs(found - coherence(frequency))[below].max() < 0.1
    assert np.abs(np.imag(cross) / np.sqrt(powers[0] * powers[1]))[below].max() < 0.1
    assert np.abs(found - coherence(frequency))[frequency < 10_000].mean() < 0.03


@pytest.mark.parametrize(("kind", "slope"), some([("noise", -3.01), ("room_tone", -9.03)], every=2))
def test_its_spectrum_falls_as_documented(kind: Kind, slope: float) -> None:
    ears = diffuse_noise(kind, 60, np.random.default_rng(4))
    frequency, power = welch(ears[0], SAMPLE_RATE, nperseg=8192)
    octaves = 1000.0 * 2.0 ** np.arange(4)
    bands = [10 * np.log10(power[(frequency > f / 1.1) & (frequency < f * 1.1)].mean()) for f in octaves]
    np.testing.assert_allclose(np.diff(bands), slope, atol=0.5)


def test_both_ears_are_equally_loud_and_its_rms_is_one() -> None:
    ears = diffuse_noise("noise", 20, np.random.default_rng(5)).astype(np.float64)
    assert np.sqrt(np.mean(ears**2)) == pytest.approx(1.0, abs=1e-6)
    left, right = 10 * np.log10(np.mean(ears**2, axis=1))
    assert left == pytest.approx(right, abs=0.5)


def test_the_same_generator_gives_the_same_bytes() -> None:
    one, two = (diffuse_noise("noise", 2, np.random.default_rng(6)) for _ in range(2))
    assert one.tobytes() == two.tobytes()
    assert one.shape == (2, 2 * SAMPLE_RATE)
