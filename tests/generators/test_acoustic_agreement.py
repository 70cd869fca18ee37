"""The measures by which two acoustic engines are compared, on signals whose figures are known."""

import numpy as np
import pytest

from avs3d_bench.contract.layout import SAMPLE_RATE
from benchmarks.acoustic_agreement import Rows, even_surfaces
from benchmarks.acoustic_closed_forms import filtered_t30
from benchmarks.acoustic_measures import OCTAVES, measure, octave_energies, split
from generators.acoustics.materials import MATERIALS, material_for
from generators.acoustics.tracer.arrivals import Arrivals
from generators.acoustics.tracer.receivers.ambisonics import Ambisonics

HEADS = {
    "tracer": {"octaves": [1.0] * 6, "white": [2.0]},
    "soundspaces": {"octaves": [0.0, 0.0, 0.0, 3.0, 3.0, 3.0], "white": [0.0]},
}


def impulse(at, gain=1.0, length=4000):
    response = np.zeros((1, length), dtype=np.float32)
    response[0, at] = gain
    return response


def test_an_impulse_has_its_energy_in_every_octave():
    assert octave_energies(impulse(100, 0.5)) == pytest.approx(np.full((1, 6), 0.25))


def test_the_direct_sound_is_what_arrives_within_2_ms():
    distance = 3.43  # 10 ms
    response = impulse(441) + impulse(441 + 80, 0.5) + impulse(441 + 100, 0.25)
    direct, late = split(response, distance)
    assert np.flatnonzero(direct[0]).tolist() == [441, 521]
    assert np.flatnonzero(late[0]).tolist() == [541]
    found = measure(response, distance)
    assert found.white_drr == pytest.approx(10 * np.log10((1 + 0.25) / 0.0625))
    assert measure(response, None).direct == []


def test_t30_of_decaying_noise_is_its_own():
    rng = np.random.default_rng(0)
    seconds = np.arange(SAMPLE_RATE) / SAMPLE_RATE
    noise = rng.standard_normal((16, SAMPLE_RATE)) * 10 ** (-3 * seconds / 0.4)
    found = np.array(measure(noise.astype(np.float32), None).t30)
    # In the lowest octave, 30 dB of a decay are 27 independent samples.
    assert found.mean(axis=0) == pytest.approx([0.4] * len(OCTAVES), rel=0.1)


#: T of each octave (s): 125 Hz decays much faster than 250 Hz, as in a room of plaster.
STEEP = (0.29, 0.29, 0.66, 0.95, 1.04, 0.78, 0.63, 0.5)


def decaying_arrivals(times, rng, count=20_000):
    """Late arrivals from all around whose octaves decay with ``times``."""
    seconds = rng.uniform(0, 1.5 * max(times), count)
    direction = rng.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    pressure = rng.choice([-1.0, 1.0], count)[:, None] * 10 ** (-3 * seconds[:, None] / np.array(times))
    return Arrivals(seconds, direction.astype(np.float32), pressure.astype(np.float32))


@pytest.mark.slow
def test_t30_behind_the_filters_is_what_noise_of_known_decays_reads():
    rng = np.random.default_rng(0)
    found = []
    for _ in range(24):
        response = Ambisonics(1).response(decaying_arrivals(STEEP, rng), np.eye(3), SAMPLE_RATE)[:1]
        found.append(measure(response, None).t30[0])
    expected = filtered_t30(STEEP)
    assert np.mean(found, axis=0)[0] == pytest.approx(expected[0], rel=0.1)
    assert np.mean(found, axis=0)[1:] == pytest.approx(expected[1:], rel=0.04)
    assert expected[0] > 1.5 * STEEP[1]


def test_t30_behind_the_filters_is_the_decay_where_octaves_decay_alike():
    for octaves in (False, True):
        for measured in (False, True):
            found = filtered_t30([0.4] * 8, sharp_octaves=octaves, sharp_measure=measured)
            assert found == pytest.approx([0.4] * len(OCTAVES), rel=1e-6)


def test_either_filter_alone_hides_a_fast_decay_beside_a_slow_one():
    both = filtered_t30(STEEP)
    assert filtered_t30(STEEP, sharp_octaves=True)[0] == pytest.approx(both[0], rel=0.05)
    assert filtered_t30(STEEP, sharp_measure=True)[0] == pytest.approx(both[0], rel=0.05)
    assert filtered_t30(STEEP, sharp_octaves=True, sharp_measure=True) == pytest.approx(STEEP[1:-1], rel=0.01)


def figures(level, drr, t30, ild):
    energy = [[10 ** (level / 10)] * 6] * 2
    white = [10 ** (ild / 10), 1.0]
    ratio = {"direct": [[10 ** (drr / 10)] * 6], "late": [[1.0] * 6]}
    return {"energy": energy, "white": white, "t30": [[t30] * 6] * 2} | ratio


def pose(tracer, soundspaces, azimuth=-40.0, free=True, sight=True):
    engines = {"tracer": tracer, "soundspaces": soundspaces}
    row = {"distance": 1.0, "azimuth": azimuth, "free": free, "sight": sight}
    return row | {name: {"head": figures(*given), "omni": figures(*given)} for name, given in engines.items()}


def test_differences_are_the_tracer_minus_the_other():
    hidden = pose((0, 9, 0.6, 3), (0, -9, 0.6, -3), free=False, sight=False)
    rows = Rows([pose((3, 4, 0.6, 5), (1, 1, 0.4, 2)), pose((0, 0, 0.6, 0.4), (0, 0, 0.4, -0.8)), hidden], HEADS)
    assert rows.levels("omni") == pytest.approx(np.array([[2.0] * 6, [0.0] * 6, [0.0] * 6]))
    assert rows.levels("head")[0] == pytest.approx([1.0] * 3 + [4.0] * 3)
    assert rows.ratios("omni") == pytest.approx(np.array([[3.0] * 6, [0.0] * 6]))
    assert rows.part("direct") == pytest.approx(np.array([[3.0] * 6, [0.0] * 6]))
    assert rows.part("late") == pytest.approx(np.zeros((2, 6)))
    assert rows.decay("omni")[0] == pytest.approx([0.6] * 6)
    assert rows.signs() == (2, 1)
    assert rows.signs(1.0) == (1, 1)
    # The source is on the left: there the tracer's ILD is right.
    assert rows.sides() == (1, 1, 0)
    assert rows.largest_opposite() == pytest.approx(0.8)


def test_even_surfaces_absorb_as_before_on_the_mean():
    from tests.support.acoustic_rooms import box_scene

    scene = even_surfaces(box_scene((3, 3, 3), label="carpet"))
    (label,) = set(scene.parts[0].mesh.acoustic_labels)
    expected = np.mean(MATERIALS["carpet"].in_situ)
    assert material_for(label).in_situ == pytest.approx([expected] * 6, abs=1e-4)
    assert set(material_for(label).scattering) == {1.0}
