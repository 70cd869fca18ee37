"""What the listener sees with another background: the change of the pictures, and the figures."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.listener_background import SIDE, View, background_blurred, summary


def view(category: str = "clock", height: int = 5) -> View:
    rng = np.random.default_rng(0)
    truth = np.zeros((SIDE, SIDE), dtype=bool)
    truth[100:140, 100:140] = True
    return View(category, height, rng.integers(0, 256, (SIDE, SIDE, 3), dtype=np.uint8), truth)


def test_the_object_stays_sharp_and_the_background_does_not() -> None:
    seen = view()
    changed = background_blurred(seen)
    inside = np.zeros_like(seen.truth)
    inside[104:136, 104:136] = True
    assert np.abs(changed[inside].astype(int) - seen.rgb[inside]).max() <= 1
    assert changed[~seen.truth].std() < 0.3 * seen.rgb[~seen.truth].std()


def test_figures_are_means_by_category_and_height() -> None:
    found = summary([view(), view(height=35), view("telephone")], [0.8, 0.2, 0.1])
    assert found["clock"]["IoU"] == pytest.approx(0.5)
    assert found["clock"]["found"] == 0.5
    assert found["clock"]["IoU by height"] == {"5": 0.8, "35": 0.2}
    assert found["telephone"]["pictures"] == 1
    assert found["telephone"]["share of the picture"] == pytest.approx(1600 / SIDE**2, abs=1e-5)
