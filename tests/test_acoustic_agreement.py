"""The measures by which two acoustic engines are compared, on signals whose figures are known."""

import numpy as np
import pytest

from avs3d_bench.layout import SAMPLE_RATE

pytest.importorskip("rlr_audio_propagation", reason="the acoustic engine (extra soundspaces) is not installed")
from benchmarks.acoustic_agreement import Rows, even_surfaces
from benchmarks.acoustic_measures import OCTAVES, measure, octave_energies, split
from generators.acoustics.materials import MATERIALS, material_for

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
    assert rows.decay("omni")[0] == pytest.approx([0.6] * 6)
    assert rows.signs() == (2, 1)
    assert rows.signs(1.0) == (1, 1)
    # The source is on the left: there the tracer's ILD is right.
    assert rows.sides() == (1, 1, 0)
    assert rows.largest_opposite() == pytest.approx(0.8)


def test_even_surfaces_absorb_as_before_on_the_mean():
    from acoustic_rooms import box_scene

    scene = even_surfaces(box_scene((3, 3, 3), label="carpet"))
    (label,) = set(scene.parts[0].mesh.acoustic_labels)
    expected = np.mean(MATERIALS["carpet"].in_situ)
    assert material_for(label).in_situ == pytest.approx([expected] * 6, abs=1e-4)
    assert set(material_for(label).scattering) == {1.0}
