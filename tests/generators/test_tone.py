"""The tone curve and the sRGB transfer function: fixed points, shape, inverses and the tables kernels read."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from generators.core import tone

radiances = st.floats(0.0, 1e6)
fractions = st.floats(0.0, 1.0)


def test_fixed_points() -> None:
    assert tone.tone_curve(0.0) == 0.0
    assert tone.tone_curve(tone.MID_GREY) == pytest.approx(tone.MID_GREY, abs=1e-12)
    assert tone.tone_curve(tone.WHITE) == 1.0
    assert tone.tone_curve([-1.0, np.inf]).tolist() == [0.0, 1.0]


def test_contrast_like_a_photograph() -> None:
    # The numbers the module documents: shadows fall as x^a, mid-tones steepen a little, white walls keep headroom.
    x = np.array([1e-5, 1.01e-5])
    toe = np.diff(np.log(tone.tone_curve(x))) / np.diff(np.log(x))
    assert toe[0] == pytest.approx(tone.CONTRAST, abs=0.01)
    x = tone.MID_GREY * np.array([0.99, 1.01])
    assert 1.05 < (np.diff(np.log(tone.tone_curve(x))) / np.diff(np.log(x)))[0] < 1.2
    assert tone.develop([1.0, tone.MID_GREY]).tolist() == [216, 118]


def test_shoulder_is_smooth() -> None:
    # The slope falls steadily from mid-grey to white: highlights roll off instead of clipping in the middle.
    slope = np.diff(tone.tone_curve(np.linspace(tone.MID_GREY, tone.WHITE, 1000)))
    assert (slope > 0).all()
    assert (np.diff(slope) < 0).all()


@given(radiances, radiances)
def test_monotone(a: float, b: float) -> None:
    low, high = min(a, b), max(a, b)
    assert 0.0 <= tone.tone_curve(low) <= tone.tone_curve(high) <= 1.0
    assert tone.develop(low) <= tone.develop(high)


@given(fractions)
def test_inverses(y: float) -> None:
    assert tone.tone_curve(tone.inverse_tone_curve(y)) == pytest.approx(y, abs=1e-9)
    assert tone.srgb_decode(tone.srgb_encode(y)) == pytest.approx(y, abs=1e-6)


def test_srgb_reference_values() -> None:
    # IEC 61966-2-1: linear below 0.0031308; 18 % grey is 0.4614; both branches meet.
    assert tone.srgb_encode(0.002) == pytest.approx(0.02584)
    assert tone.srgb_encode(0.18) == pytest.approx(0.46135, abs=1e-4)
    assert tone.srgb_encode(0.0031308) == pytest.approx(0.04045, abs=1e-5)
    assert np.rint(255 * tone.srgb_encode(tone.decode_table())).astype(int).tolist() == list(range(256))


@given(st.floats(1e-4, 1e4), st.integers(1, 254))
def test_the_inverse_curve_gives_the_exposure_of_a_level(radiance: float, level: int) -> None:
    exposure = float(tone.inverse_tone_curve(tone.srgb_decode(level / 255))) / radiance
    assert tone.develop(exposure * radiance) == level


def test_tables_agree_with_the_formulas() -> None:
    table, srgb = tone.tone_table(), tone.srgb_table()
    assert (table[0], table[-1], srgb[0], srgb[-1]) == (0.0, 1.0, 0, 255)
    x = np.random.default_rng(1).uniform(0, tone.WHITE, 10_000)
    position = np.sqrt(x / tone.WHITE) * (len(table) - 1)
    np.testing.assert_allclose(np.interp(position, np.arange(len(table)), table), tone.tone_curve(x), atol=2e-6)
    y = np.linspace(0, 1, 10_001)
    found = srgb[np.rint(y * (len(srgb) - 1)).astype(int)].astype(int)
    assert np.abs(found - 255 * tone.srgb_encode(y)).max() < 0.55
