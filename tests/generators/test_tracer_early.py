"""Direct sound, image sources and transmission against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from generators.acoustics.analytic import Box, image_sources
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.materials import MATERIALS
from generators.acoustics.tracer.air import energy_exponents
from generators.acoustics.tracer.arrivals import BANDS
from generators.acoustics.tracer.early import early_arrivals
from generators.acoustics.tracer.surfaces import octaves
from generators.acoustics.tracer.transmission import wall_gain, wall_loss_db
from generators.core.scene import Scene
from tests.support.acoustic_rooms import box_scene, solid
from tests.support.tracer_rooms import KHZ, LISTENER, SIZE, SOURCE, box, images, label

ABSORPTION = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
SCATTERING = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3)
inside = st.tuples(*(st.floats(0.05, side - 0.05) for side in SIZE)).map(np.array)


def air(distance):
    return np.exp(-0.5 * energy_exponents() * distance)


@pytest.mark.parametrize("distance", [0.1, 0.5, 1.0, 3.0, 20.0])
def test_direct_sound_falls_as_1_over_r(distance):
    surfaces, found = images(Scene("free", (), (), ()), (0, 0, 0))
    arrivals = early_arrivals(surfaces, found, np.array([0.0, 0.0, distance]))
    assert len(arrivals) == 1
    assert arrivals.time[0] == pytest.approx(distance / SPEED_OF_SOUND, abs=1e-12)
    assert arrivals.direction[0] == pytest.approx([0, 0, -1])
    assert arrivals.pressure[0] == pytest.approx(air(distance) / distance, rel=1e-6)


def test_source_and_listener_in_one_point_are_as_loud_as_at_10_cm():
    surfaces, found = images(Scene("free", (), (), ()), (0, 0, 0))
    arrivals = early_arrivals(surfaces, found, np.zeros(3))
    assert arrivals.pressure[0] == pytest.approx(10.0)
    assert np.linalg.norm(arrivals.direction[0]) == 1.0


def expected_images(source, listener, order):
    """Distances, directions and reflections of the box's image sources of up to ``order`` reflections, by distance."""
    positions, reflections = image_sources(Box((0, 0, 0), SIZE, ()), source, listener, 60.0)
    few = reflections <= order
    offset = positions[few] - listener
    distance = np.linalg.norm(offset, axis=1)
    rank = np.argsort(distance, kind="stable")
    return distance[rank], (offset / distance[:, None])[rank], reflections[few][rank]


@given(inside, inside)
@settings(max_examples=25)
def test_a_box_has_its_image_sources_exactly(source, listener):
    """Times, directions and amplitudes of all 25 (63) images of up to 2 (3) reflections."""
    if np.linalg.norm(source - listener) < 0.15:
        return
    surfaces, found = images(box(ABSORPTION, SCATTERING), source, order=3)
    arrivals = early_arrivals(surfaces, found, listener)
    distance, direction, reflections = expected_images(source, listener, 3)
    assert len(arrivals) == len(distance) == 63
    assert (reflections <= 2).sum() == 25
    assert arrivals.time * SPEED_OF_SOUND == pytest.approx(distance, abs=1e-9)
    left = np.sqrt(1 - np.array([0.1, *ABSORPTION, 0.6])) * np.sqrt(1 - np.array([0.05, *SCATTERING, 0.3]))
    expected = left ** reflections[:, None] * np.stack([air(d) / d for d in distance])
    # Two images at one distance may come in either order: their directions are compared as a set.
    near = np.linalg.norm(arrivals.direction[:, None] - direction[None], axis=2)
    near[np.abs(arrivals.time[:, None] * SPEED_OF_SOUND - distance[None]) > 1e-9] = np.inf
    match = near.argmin(axis=1)
    assert sorted(match) == list(range(63))
    assert near.min(axis=1).max() < 1e-6
    assert arrivals.pressure == pytest.approx(expected[match], rel=1e-5)


def test_a_path_along_an_edge_counts_once():
    # Source and listener on the box's axis: the second-order paths meet the edges exactly.
    surfaces, found = images(box(), (2.0, 2.0, 1.5), order=2)
    arrivals = early_arrivals(surfaces, found, np.array([4.0, 2.0, 1.5]))
    distance, _, _ = expected_images(np.array([2.0, 2.0, 1.5]), np.array([4.0, 2.0, 1.5]), 2)
    assert len(arrivals) == 25
    assert arrivals.time * SPEED_OF_SOUND == pytest.approx(distance, abs=1e-9)


def test_a_screen_hides_what_it_should():
    # A screen 2.2 m high and 2 m wide between source and listener hides the floor and both end walls; the ways by the
    # ceiling and the side walls pass it.
    source, listener = np.array([1.5, 1.2, 2.0]), np.array([4.5, 1.2, 2.0])
    screen = solid("screen", (0.1, 2.2, 2.0), (3.0, 1.1, 2.0), label=label(0.2))
    surfaces, found = images(box_scene((6.0, 4.0, 4.0), label=label(0.2), extra=(screen,)), source, order=1)
    arrivals = early_arrivals(surfaces, found, listener)
    offsets = arrivals.direction * (arrivals.time * SPEED_OF_SOUND)[:, None]
    # What it hides passes its edges, in the low octaves alone.
    high, low = (arrivals.pressure[:, k] * np.linalg.norm(offsets, axis=1) for k in (6, 2))
    hidden = high < 0.05 * low
    assert 1 <= hidden.sum() <= 3
    assert low[hidden].max() < 0.4
    offsets, pressure = offsets[~hidden], arrivals.pressure[~hidden]
    expected = [
        (-3.0, 0.0, 0.0),  # through the screen
        (-3.0, 0.0, -4.0),
        (-3.0, 0.0, 4.0),
        (-3.0, 5.6, 0.0),
    ]
    assert sorted(np.round(offsets.astype(float), 4).tolist()) == pytest.approx(np.array(sorted(expected)), abs=1e-4)
    distance = np.linalg.norm(offsets, axis=1)
    assert pressure[0] == pytest.approx(wall_gain(2) * air(3.0) / 3.0, rel=1e-5)
    assert pressure[1, 7] == pytest.approx(np.sqrt(0.8 * 0.7) * air(5.0)[7] / 5.0, rel=1e-4)
    assert distance[1] == pytest.approx(5.0)


def test_small_facets_are_no_mirrors():
    crate = solid("crate", (0.4, 0.4, 0.4), (3.0, 0.3, 2.0))
    with_crate, _ = images(box(extra=(crate,)))
    without, _ = images(box())
    assert with_crate.planes == without.planes == 6


def test_the_sound_through_a_wall_is_the_mass_laws():
    # ISO 717: such walls have 30 to 40 dB at 500 Hz; the mass law grows by 6 dB per octave.
    loss = wall_loss_db()
    assert loss[BANDS.index(500)] == pytest.approx(20 * np.log10(17 * 500) - 47)
    assert np.diff(loss)[:3] == pytest.approx(6.02, abs=0.2)
    assert loss.max() == 40.0
    wall = solid("wall", (0.1, 4.0, 3.0), (3.0, 2.0, 1.5), label=label(0.2))
    surfaces, found = images(box(extra=(wall,)), order=2)
    arrivals = early_arrivals(surfaces, found, LISTENER)
    distance = np.linalg.norm(LISTENER - SOURCE)
    assert len(arrivals) == 1  # nothing else gets through
    assert arrivals.time[0] == pytest.approx(distance / SPEED_OF_SOUND)
    assert arrivals.pressure[0] == pytest.approx(10 ** (-loss / 20) * air(distance) / distance, rel=1e-5)


@pytest.mark.parametrize(("surfaces", "walls"), [(1, 1), (2, 1), (3, 2), (4, 2)])
def test_a_pair_of_surfaces_is_one_wall(surfaces, walls):
    assert 20 * np.log10(wall_gain(surfaces)) == pytest.approx(-walls * wall_loss_db())


def test_nothing_is_heard_through_three_walls():
    walls = [solid(f"wall {x}", (0.1, 4.0, 3.0), (x, 2.0, 1.5), label=label(0.2)) for x in (2.0, 2.8, 3.6)]
    for count, arrivals in ((2, 1), (3, 0)):
        surfaces, found = images(box(extra=tuple(walls[:count])), order=2)
        assert len(early_arrivals(surfaces, found, LISTENER)) == arrivals
    assert not wall_gain(5).any()


def test_bands_are_octaves_and_outer_ones_repeat_the_nearest():
    surfaces, _ = images(box(ABSORPTION, SCATTERING))
    assert surfaces.mesh.reflection[0] == pytest.approx([0.9, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.4])
    assert surfaces.mesh.scattering[0] == pytest.approx([0.05, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.3])
    assert BANDS[KHZ] == 1000


@pytest.mark.parametrize("name", sorted(MATERIALS))
def test_what_passes_a_wall_is_part_of_what_it_absorbs(name):
    """Nothing is gained: the transmitted share of the energy is below the absorption of every material."""
    assert np.all(wall_gain(1) ** 2 <= octaves(MATERIALS[name].in_situ))
