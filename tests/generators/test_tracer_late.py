"""The stochastic part against closed forms: levels, decay, energy, noise.

Settings of the tests follow fewer rays than the default where the noise allows it; the slow ones follow many.
"""

import numpy as np
import pytest

from avs3d_bench.measures.decay import eyring
from generators.acoustics.analytic import Box, image_sources
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.air import energy_exponents
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracer.early import early_arrivals
from generators.acoustics.tracer.kernels import NEAREST
from generators.acoustics.tracer.late import rays_for, trace
from generators.acoustics.tracer.settings import TraceSettings
from tests.support.acoustic_rooms import box_scene, solid
from tests.support.tiers import some
from tests.support.tracer_rooms import (
    KHZ,
    LISTENER,
    SIZE,
    SOURCE,
    SURFACE,
    VOLUME,
    box,
    decay_time,
    diffuse_energy,
    energies,
    images,
    label,
    without_air,
)

LISTENERS = np.array([LISTENER, (2.0, 3.0, 1.0), (5.0, 1.0, 1.2), (3.0, 2.0, 1.5)])


def whole(scene, listeners, rays, source=SOURCE, **settings):
    """All arrivals at each listener."""
    chosen = TraceSettings(**settings)
    surfaces, found = images(scene, source, chosen.early_order)
    late = trace(surfaces, found, np.asarray(listeners, dtype=float), chosen, rays)
    return [
        Arrivals.joined([early_arrivals(surfaces, found, listener), tail])
        for listener, tail in zip(np.asarray(listeners, dtype=float), late, strict=True)
    ]


def decibels(ratio):
    return 10 * np.log10(ratio)


@pytest.mark.slow
def test_a_box_of_mirrors_has_the_energy_of_its_image_sources():
    """Without scattering, early and late part together are the image sources of all orders; nothing counts twice."""
    arrivals = whole(box(0.3, 0.0), LISTENERS, 20_000)
    for listener, found in zip(LISTENERS, arrivals, strict=True):
        positions, reflections = image_sources(Box((0, 0, 0), SIZE, ()), SOURCE, listener, 90.0)
        distance = np.linalg.norm(positions - listener, axis=1)
        each = 0.7**reflections * np.exp(-energy_exponents()[KHZ] * distance) / distance**2
        energy = energies(found)
        for first, last in ((0, 0.02), (0.02, 0.05), (0.05, 0.1)):
            inside = (distance >= first * SPEED_OF_SOUND) & (distance < last * SPEED_OF_SOUND)
            heard = energy[(found.time >= first) & (found.time < last)].sum()
            assert decibels(heard / each[inside].sum()) == pytest.approx(0, abs=0.4)
        assert decibels(energy.sum() / each.sum()) == pytest.approx(0, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_the_energy_does_not_depend_on_how_many_orders_are_image_sources(order):
    found = whole(box(0.3, 0.2), LISTENERS, 20_000, early_order=order)
    reference = whole(box(0.3, 0.2), LISTENERS, 20_000, seed=1)
    for a, b in zip(found, reference, strict=True):
        # Image sources are exact at a point; a disc takes the mean over its area, near the source up to 0.2 dB less.
        assert decibels(energies(a).sum() / energies(b).sum()) == pytest.approx(0, abs=0.35)


@pytest.mark.parametrize(
    "rain", some([{"rain_order": 0}, {"rain_order": 1}, {"rain_order": 2, "rain_rays": 4000}], every=3)
)
def test_rain_replaces_what_the_discs_would_detect(rain):
    """With walls that scatter all, rain and detection give the same energy in each window of the first reflections."""
    found = whole(box(0.4, 1.0), LISTENERS, 40_000, **rain)
    reference = whole(box(0.4, 1.0), LISTENERS, 40_000, seed=7, rain_rays=8000)
    for first, last in ((0.0, 0.015), (0.015, 0.03), (0.03, 0.06)):
        levels = [[energies(x)[(x.time >= first) & (x.time < last)].sum() for x in y] for y in (found, reference)]
        # A listener's standard deviation without rain is 0.1 to 0.3 dB; this is the mean of four.
        assert decibels(np.divide(*levels)).mean() == pytest.approx(0, abs=0.25)


def test_first_order_rain_is_the_integral_over_the_walls():
    """Lambert walls: p² = Σ over surface elements of (1 − α)·cos θs/(4π ds²)·4π·cos θl/(π dl²), over all six walls."""
    surfaces, found = images(box(0.4, 1.0))
    # Rays that end after the first reflection.
    settings = TraceSettings(rain_order=1, rain_rays=20_000, most_reflections=1, least_rays=1)
    heard = energies(trace(surfaces, found, LISTENERS[:1], settings, 1)[0])
    expected, steps = 0.0, 300
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        u, v = ((np.arange(steps) + 0.5) / steps * SIZE[k] for k in others)
        grid = np.zeros((steps, steps, 3))
        grid[..., others[0]], grid[..., others[1]] = u[:, None], v[None, :]
        element = SIZE[others[0]] * SIZE[others[1]] / steps**2
        for side in (0.0, SIZE[axis]):
            grid[..., axis] = side
            to_source, to_listener = SOURCE - grid, LISTENERS[0] - grid
            ds, dl = np.linalg.norm(to_source, axis=2), np.linalg.norm(to_listener, axis=2)
            cos_s, cos_l = np.abs(to_source[..., axis]) / ds, np.abs(to_listener[..., axis]) / dl
            air = np.exp(-energy_exponents()[KHZ] * (ds + dl))
            expected += np.sum(0.6 * cos_s / ds**2 * cos_l / (np.pi * dl**2) * air) * element
    assert heard.sum() == pytest.approx(expected, rel=0.02)


def test_a_closed_room_without_absorption_keeps_its_energy():
    """The energy that passes a point per second stays 4π·c/V for ever, with any scattering."""
    for scattering in (0.0, 0.3, (0.05, 0.1, 0.2, 0.3, 0.5, 0.9)):
        found = whole(box(0.0, scattering), LISTENERS, 6000, seconds=0.5, decay_db=120)
        steady = 4 * np.pi * SPEED_OF_SOUND / VOLUME
        for band in (1, KHZ, 6):
            times = np.concatenate([x.time for x in found])
            energy = without_air(np.concatenate([energies(x, band) for x in found]), times, band) / len(LISTENERS)
            for first in (0.1, 0.2, 0.3, 0.4):
                flow = energy[(times >= first) & (times < first + 0.1)].sum() / 0.1
                # Where the octaves scatter very differently, the weights of the rays add to the noise.
                assert decibels(flow / steady) == pytest.approx(0, abs=0.15 if np.isscalar(scattering) else 0.5)
        assert max(x.time.max() for x in found) < 0.55


def test_a_closed_room_never_gains():
    """With absorption, the flow of energy falls from window to window."""
    found = whole(box(0.1, (0.05, 0.1, 0.2, 0.3, 0.5, 0.9)), LISTENERS, 6000)
    for band in range(len(BANDS)):
        flow = np.sum(
            [np.histogram(x.time, np.arange(1, 14) * 0.05, weights=energies(x, band))[0] for x in found], axis=0
        )
        assert np.all(np.diff(flow) < 0)


@pytest.mark.slow
@pytest.mark.parametrize("absorption", [0.05, 0.1, 0.2, 0.4])
def test_steady_level_is_that_of_the_diffuse_field(absorption):
    """Mean over the room: 16π·(1 − α)/(S·α) beside the direct sound (Kuttruff, *Room Acoustics*, eq. 5.44)."""
    rng = np.random.default_rng(0)
    listeners = rng.uniform(0.1, np.array(SIZE) - 0.1, (200, 3))
    found = whole(box(absorption, 0.5), listeners, 3000, source=np.array([2.0, 1.5, 1.2]))
    level = []
    for listener, arrivals in zip(listeners, found, strict=True):
        energy = without_air(energies(arrivals, KHZ), arrivals.time, KHZ)
        level.append(energy.sum() - 1 / max(np.sum((listener - (2.0, 1.5, 1.2)) ** 2), NEAREST**2))
    assert decibels(np.mean(level) / diffuse_energy(absorption)) == pytest.approx(0, abs=0.3)


CUBE = (5.0, 5.0, 5.0)


@pytest.mark.slow
def test_decay_is_eyrings_in_every_octave():
    """T30 within 5 % for absorption 0.05 to 0.4, one value in each octave of a single trace."""
    absorption = (0.05, 0.1, 0.2, 0.25, 0.3, 0.4)
    listeners = np.array([(3.5, 2.1, 1.9), (2.0, 3.0, 1.0), (4.0, 1.0, 3.2)])
    found = whole(box(absorption, 0.3, CUBE), listeners, 20_000)
    for band, alpha in enumerate((absorption[0], *absorption, absorption[-1])):
        times = [decay_time(x.time, without_air(energies(x, band), x.time, band)) for x in found]
        assert np.mean(times) == pytest.approx(eyring(125.0, 150.0, alpha), rel=0.05), BANDS[band]


@pytest.mark.slow
@pytest.mark.parametrize("absorption", [0.05, 0.1, 0.2, 0.3, 0.4])
def test_decay_in_a_diffuse_room_is_kuttruffs(absorption):
    """Eyring takes all free paths for equal; with their variance γ² the exponent is −ln(1 − α)·(1 + γ²/2·ln(1 − α)).

    H. Kuttruff, *Room Acoustics*, 5th edition, eq. 5.21. γ² = 0.36 for a box of 6 × 4 × 3 m with Lambert walls: between
    the 0.342 of a cube and the 0.363 of a box of 1 : 2 : 2 in his table 5.1.
    """
    found = whole(box(absorption, 1.0), LISTENERS, 20_000)
    logarithm = np.log(1 - absorption)
    exponent = -logarithm * (1 + 0.36 / 2 * logarithm)
    expected = 24 * np.log(10) * VOLUME / (SPEED_OF_SOUND * SURFACE * exponent)
    times = [decay_time(x.time, without_air(energies(x), x.time, KHZ)) for x in found]
    assert np.mean(times) == pytest.approx(expected, rel=0.02)


def test_decay_is_eyrings_at_1_khz():
    found = whole(box(0.2, 0.3, CUBE), [(3.5, 2.1, 1.9), (2.0, 3.0, 1.0)], 4000)
    times = [decay_time(x.time, without_air(energies(x), x.time, KHZ)) for x in found]
    assert np.mean(times) == pytest.approx(eyring(125.0, 150.0, 0.2), rel=0.05)


def furnished():
    """A room of several materials, with a wardrobe, a table and a wall that half divides it."""
    extra = (
        solid("wardrobe", (0.6, 2.0, 1.5), (5.6, 1.0, 2.0), label=label((0.3, 0.2, 0.2, 0.1, 0.1, 0.1), 0.15)),
        solid("table", (1.2, 0.05, 0.8), (2.2, 0.75, 1.9), label=label(0.1, 0.1)),
        solid("wall", (0.1, 4.0, 1.8), (3.2, 2.0, 0.9), label=label(0.15, 0.1)),
    )
    return box_scene(SIZE, label=label((0.1, 0.15, 0.2, 0.25, 0.3, 0.35), (0.05, 0.1, 0.1, 0.2, 0.3, 0.4)), extra=extra)


@pytest.mark.slow
@pytest.mark.parametrize("listener", [(1.5, 1.6, 2.6), (4.2, 2.1, 1.2)])
def test_source_and_listener_may_change_places(listener):
    """Reciprocity, with and without line of sight, in every octave."""
    listener = np.array(listener)
    forth = whole(furnished(), [listener], 40_000)[0]
    back = whole(furnished(), [SOURCE], 40_000, source=listener, seed=1)[0]
    # The standard deviation of each is about 0.06 dB; a source behind the wall is heard by its reflections alone.
    assert decibels(forth.energy / back.energy) == pytest.approx(np.zeros(8), abs=0.3)
    for last in (0.02, 0.05):
        shares = [x.energy - np.square(x.pressure[x.time < last].astype(float)).sum(axis=0) for x in (forth, back)]
        assert decibels(shares[0] / shares[1]) == pytest.approx(np.zeros(8), abs=0.5)


def test_scattering_is_right_in_each_octave_on_the_average():
    """One trace with a spectrum of scattering has in each octave the energy of a room that has this value in all."""
    spectrum = (0.05, 0.1, 0.2, 0.4, 0.7, 0.9)

    # A carpet alone absorbs, so that the energy depends on the scattering of the other walls.
    def room(scattering):
        carpet = solid("carpet", (5.9, 0.01, 2.9), (3.0, 0.005, 1.5), label=label(0.8, scattering))
        return box_scene(SIZE, label=label(0.05, scattering), extra=(carpet,))

    together = Arrivals.joined(whole(room(spectrum), LISTENERS, 20_000, exact_scattering=1000, decay_db=30))
    for band, scattering in ((1, 0.05), (4, 0.4), (6, 0.9)):
        alone = Arrivals.joined(whole(room(scattering), LISTENERS, 20_000, seed=band, decay_db=30))
        # The weights of the rays multiply: the later, the more noise.
        for first, last, most in ((0.01, 0.03, 0.3), (0.03, 0.08, 0.8)):
            share = [energies(x, band)[(x.time >= first) & (x.time < last)].sum() for x in (together, alone)]
            assert decibels(share[0] / share[1]) == pytest.approx(0, abs=most)


def test_late_sound_comes_from_everywhere_with_either_sign():
    found = whole(box(0.1, 0.5), LISTENERS, 6000)
    for arrivals in found:
        late = arrivals.time > 0.08
        weight = energies(arrivals)[late] / energies(arrivals)[late].sum()
        direction = arrivals.direction[late].astype(float)
        assert np.linalg.norm(direction, axis=1) == pytest.approx(1.0, abs=1e-5)
        assert weight @ direction == pytest.approx([0, 0, 0], abs=0.06)
        assert (weight[:, None] * direction).T @ direction == pytest.approx(np.eye(3) / 3, abs=0.05)
        assert np.mean(arrivals.pressure[late, 0] > 0) == pytest.approx(0.5, abs=0.03)
        assert np.all(np.sign(arrivals.pressure[late]) == np.sign(arrivals.pressure[late, :1]))


@pytest.mark.slow
def test_the_late_field_has_the_coherence_of_a_diffuse_field():
    """Two microphones d apart: sin(kd)/(kd) along every axis (Cook et al., JASA 27 (1955) 1072–1077)."""
    listeners = np.random.default_rng(0).uniform(0.6, np.array(SIZE) - 0.6, (16, 3))
    found = Arrivals.joined(whole(box(0.1, 1.0), listeners, 4000, rain_rays=0, rain_order=0))
    late = found.time > 0.06
    energy, direction = energies(found)[late], found.direction[late].astype(float)
    wave = np.linspace(0, 4 * np.pi, 60)  # kd
    for axis in np.eye(3):
        # Signs are random: on average each arrival correlates with itself alone.
        coherence = np.exp(1j * wave[:, None] * (direction @ axis)) @ energy / energy.sum()
        assert coherence == pytest.approx(np.sinc(wave / np.pi), abs=0.03)


def test_a_listener_near_a_wall_hears_the_same_late_level():
    """The disc shrinks with the distance to the wall; down to 6 cm the expectation stays."""
    listeners = np.array([(3.0, 2.0, 1.5), (3.0, 2.0, 0.2), (3.0, 2.0, 0.06)])
    found = whole(box(0.1, 0.5), listeners, 20_000)
    level = [decibels(energies(x)[x.time > 0.05].sum()) for x in found]
    # At a wall of random phase the field is the same on average: rays carry energy, not interference.
    assert level[1] == pytest.approx(level[0], abs=0.3)
    assert level[2] == pytest.approx(level[0], abs=0.8)


@pytest.mark.slow
def test_noise_falls_as_one_over_the_root_of_the_rays():
    surfaces, found = images(furnished())
    spread = []
    for rays in (500, 2000, 8000):
        traces = [trace(surfaces, found, LISTENERS, TraceSettings(seed=seed, rain_order=0), rays) for seed in range(16)]
        levels = [decibels(heard[j].energy[KHZ]) for heard in traces for j in (0, 2)]
        spread.append(np.mean(np.std(np.reshape(levels, (16, 2)), axis=0, ddof=1)))
    # 16 draws of two listeners know a standard deviation to ±13 %, the ratio of two to ±18 %.
    assert spread[0] / spread[1] == pytest.approx(2, rel=0.4)
    assert spread[1] / spread[2] == pytest.approx(2, rel=0.4)
    # 1/N^¼ would give 2.
    assert spread[0] / spread[2] == pytest.approx(4, rel=0.35)


def test_rays_are_chosen_for_the_wanted_arrivals():
    settings = TraceSettings(arrivals=3000, least_rays=100)
    rays = rays_for(SURFACE, 60, settings)
    surfaces, found = images(box(0.2, 0.3))
    heard = trace(surfaces, found, LISTENERS[3:], TraceSettings(rain_order=0, most_reflections=60), rays)[0]
    assert len(heard) == pytest.approx(3000, rel=0.15)
    assert rays_for(1e6, 60, settings) == settings.most_rays
    assert rays_for(1.0, 60, settings) == settings.least_rays


def test_arrivals_are_in_the_order_of_rays_and_reflections():
    """Threads, blocks and other listeners change nothing: the bytes are equal."""
    surfaces, found = images(furnished())
    settings = TraceSettings()
    alone = trace(surfaces, found, LISTENERS[1:2], settings, 3000)[0]
    for threads, listeners, at in ((1, LISTENERS, 1), (3, LISTENERS, 1), (2, LISTENERS[::-1].copy(), 2)):
        other = trace(surfaces, found, listeners, settings, 3000, threads)[at]
        for name in ("time", "direction", "pressure"):
            assert getattr(alone, name).tobytes() == getattr(other, name).tobytes()
