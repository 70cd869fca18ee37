"""Late sound on fixed carriers: what stays of the arrivals, and that it changes smoothly."""

from __future__ import annotations

import json

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from generators import acoustics
from generators.acoustics.tracer.backend import TracerBackend
from generators.acoustics.tracer.carriers import on_carriers


def drawn(count: int = 6000) -> acoustics.Arrivals:
    """Arrivals that decay by 60 dB in 0.3 s, twice as many from above as from below."""
    rng = np.random.default_rng(0)
    time = rng.uniform(0.01, 0.3, count)
    direction = rng.standard_normal((count, 3))
    direction[:, 1] = np.abs(direction[:, 1]) * np.where(rng.random(count) < 2 / 3, 1, -1)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    pressure = rng.standard_normal((count, 8)) * 10 ** (-10 * time)[:, None]
    return acoustics.Arrivals(time, direction.astype(np.float32), pressure.astype(np.float32))


def weights(arrivals: acoustics.Arrivals) -> np.ndarray:
    """(n,) energy of each arrival."""
    return np.asarray(np.square(arrivals.pressure, dtype=np.float64).sum(axis=1))


def test_energy_time_and_direction_stay() -> None:
    late = drawn()
    found = on_carriers(late, 0.01, seed=3)
    np.testing.assert_allclose(found.energy, late.energy, rtol=1e-5)
    assert found.time.min() >= 0.01
    weight, wanted = weights(found), weights(late)
    assert np.average(found.time, weights=weight) == pytest.approx(np.average(late.time, weights=wanted), abs=1e-3)
    mean = np.average(late.direction, axis=0, weights=wanted)
    np.testing.assert_allclose(np.average(found.direction, axis=0, weights=weight), mean, atol=0.04)
    assert mean[1] > 0.1
    for at in (0.05, 0.1, 0.2):  # Schroeder's curve
        left, right = (10 * np.log10(w[e.time > at].sum()) for e, w in ((found, weight), (late, wanted)))
        assert left == pytest.approx(right, abs=0.7)


def test_sound_from_one_direction_comes_from_there() -> None:
    late = drawn()
    ahead = np.tile(np.array([0, 0, -1], dtype=np.float32), (len(late), 1))
    found = on_carriers(acoustics.Arrivals(late.time, ahead, late.pressure), 0.01, seed=3)
    assert np.average(found.direction, axis=0, weights=weights(found))[2] < -0.9


def test_what_moves_or_comes_and_goes_changes_amplitudes_alone() -> None:
    late = drawn()
    keep = np.ones(len(late), dtype=bool)
    keep[::40] = False  # 2.5 % of the rays miss the listener
    moved = acoustics.Arrivals(late.time[keep] + 1e-4, late.direction[keep], late.pressure[keep])
    one, two = on_carriers(late, 0.01, seed=3), on_carriers(moved, 0.01, seed=3)
    common, i, j = np.intersect1d(one.time, two.time, return_indices=True)
    assert len(common) > 0.98 * len(one)
    np.testing.assert_array_equal(np.sign(one.pressure[i]), np.sign(two.pressure[j]))
    change = np.square(one.pressure[i] - two.pressure[j]).sum() / np.square(one.pressure).sum()
    assert 10 * np.log10(change) < -30
    assert not np.array_equal(on_carriers(late, 0.01, seed=4).time, one.time)


def test_the_setting_is_named_only_where_it_is_on() -> None:
    on = acoustics.TraceSettings(fixed_carriers=True)
    assert "fixed_carriers" not in TracerBackend().describe()
    assert json.loads(json.dumps(TracerBackend(settings=on).describe()))["fixed_carriers"] is True
    with pytest.raises(Avs3dError, match="fixed_carriers is for device='cpu'"):
        acoustics.Tracer(device="cuda", settings=on)


def test_a_response_keeps_its_figures() -> None:
    room = acoustics.Room.shoebox((6, 2.7, 4), 0.2)
    found = []
    for is_on in (False, True):
        engine = acoustics.Tracer(seed=1, settings=acoustics.TraceSettings(fixed_carriers=is_on))
        found.append(engine.response(room, (1, 1.5, 2), (4, 1.5, 2), acoustics.Omni(), sample_rate=8000))
    for figure, most in (("t30", 0.02), ("drr", 0.7), ("c50", 0.7)):
        rays, fixed = (getattr(rir, figure)()[1000] for rir in found)
        assert fixed == pytest.approx(rays, abs=most), figure
