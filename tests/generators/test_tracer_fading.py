"""Specular paths at the edges of surfaces of finite size, against closed forms and from one step to the next."""

import math

import numpy as np
import pytest
from scipy.special import erf

from generators.acoustics.geometry import SPEED_OF_SOUND, AcousticMesh
from generators.acoustics.tracer.air import energy_exponents
from generators.acoustics.tracer.arrivals import BANDS
from generators.acoustics.tracer.diffraction import diffracted, lit_edges
from generators.acoustics.tracer.early import early_arrivals, images_of
from generators.acoustics.tracer.fading import BACK, FRONT, carried, zone_variance
from generators.acoustics.tracer.surfaces import surfaces_of
from generators.acoustics.tracer.transmission import wall_gain
from tests.support.tracer_rooms import LISTENER, box, images, label

#: Octaves of which the zone is as wide as that of 250 Hz.
WIDE = BANDS.index(250)


def rectangle(low, high, axis=0):
    """Corners of a rectangle across an axis, counterclockwise."""
    a, b = (k for k in range(3) if k != axis)
    corners = np.tile(np.array(low, dtype=float), (4, 1))
    corners[1:3, a], corners[2:, b] = high[a], high[b]
    return corners


def mesh_of(**rectangles):
    """A mesh of named groups of rectangles (4, 3), two triangles each."""
    corners, groups = [], {}
    for name, each in rectangles.items():
        groups.setdefault(name.split("_")[0], []).extend(
            [[len(corners), len(corners) + 1, len(corners) + 2], [len(corners), len(corners) + 2, len(corners) + 3]]
        )
        corners += list(each)
    known = {"wood": label(0.1, 0.0), "cloth": label(0.6, 0.0)}
    return AcousticMesh(np.array(corners), {known[name]: np.array(faces) for name, faces in groups.items()})


def shares(surfaces, point, direction, variance, plane=0, side=FRONT):
    out = np.empty(8)
    near = carried(surfaces.rims, plane, side, *point, *direction, variance, out)
    return near, out


def sigma(variance):
    """(8,) standard deviation of the zone per octave."""
    return np.sqrt(variance * 250 / np.maximum(250.0 * 2.0 ** (np.arange(8) - WIDE), 250.0))


@pytest.mark.parametrize("beside", [-0.9, -0.3, -0.05, -1e-9, 1e-9, 0.05, 0.3, 0.9])
def test_the_share_at_a_straight_edge_is_an_error_function(beside):
    """A large sheet that ends at z = 0, met at right angles: ½ at the edge, from both sides."""
    surfaces = surfaces_of(mesh_of(wood=rectangle((0, -30, -30), (0, 30, 0))))
    for sign in (1, -1):
        _, found = shares(surfaces, (0, 0, beside), (sign, 0, 0), 0.2, side=FRONT if sign < 0 else BACK)
        exact = 0.5 * (1 - erf(beside / sigma(0.2) / math.sqrt(2)))
        assert found == pytest.approx(exact, abs=0.012)
        if abs(beside) < 1e-6:
            assert found == pytest.approx(0.5, abs=1e-6)


def test_a_small_panel_carries_what_its_size_does_in_each_octave():
    surfaces = surfaces_of(mesh_of(wood=rectangle((0, -0.4, -0.3), (0, 0.4, 0.3))))
    variance = zone_variance(2.0, 3.0)
    near, found = shares(surfaces, (0, 0.1, 0.05), (1, 0, 0), variance)
    s = sigma(variance) * math.sqrt(2)
    exact = (erf(0.3 / s) + erf(0.5 / s)) / 2 * (erf(0.25 / s) + erf(0.35 / s)) / 2
    assert near
    assert found == pytest.approx(exact, abs=0.02)
    assert found[-1] > 0.95
    assert found[0] < 0.4
    # From the side the zone is longer by 1/cos, as the panel is seen shorter.
    _, found = shares(surfaces, (0, 0.1, 0.05), (0.5, 0, math.sqrt(0.75)), variance)
    exact = (erf(0.3 / s) + erf(0.5 / s)) / 2 * (erf(0.125 / s) + erf(0.175 / s)) / 2
    assert found == pytest.approx(exact, abs=0.02)


def test_a_zone_is_that_of_fresnels_knife_edge():
    # The amplitude behind a knife edge falls by 1/2 per unit of v = x·√(2(d₁ + d₂)/(λ·d₁·d₂)) at its edge.
    near, far = 1.5, 4.0
    per_metre = math.sqrt(2 * (near + far) / (SPEED_OF_SOUND / 250 * near * far))
    slope = 1 / math.sqrt(2 * math.pi * zone_variance(near, far))
    assert slope == pytest.approx(0.5 * per_metre)


def test_a_box_is_as_exact_as_ever():
    """No wall of a room ends where it meets another one, and everything is carried in full."""
    surfaces, found = images(box())
    middle = np.array([3.0, 2.0, 1.5])
    for plane, equation in enumerate(surfaces.plane_equation):
        inside = FRONT if equation[:3] @ middle > equation[3] else BACK
        edges = slice(surfaces.rims.first[plane], surfaces.rims.first[plane + 1])
        assert not surfaces.rims.ends_surface[edges, inside].any()
    arrivals = early_arrivals(surfaces, found, LISTENER)
    distance = arrivals.time * SPEED_OF_SOUND
    plain = arrivals.pressure * distance[:, None] / np.exp(-0.5 * np.outer(distance, energy_exponents()))
    assert len(arrivals) == 63
    assert np.unique(np.round(plain[:, 3], 4)).size == 4  # one amplitude for each number of reflections


def test_two_materials_of_one_plane_share_a_reflection():
    """On their border each carries one half, and together, with one absorption, all of it everywhere."""
    source = np.array([2.0, 0.0, 0.5])
    halves = {"low": rectangle((0, -20, -20), (0, 20, 0)), "high": rectangle((0, -20, 0), (0, 20, 20))}
    surfaces = surfaces_of(mesh_of(wood=halves["low"], cloth=halves["high"]))
    found = images_of(surfaces, source, 1, 0)
    assert surfaces.planes == 2
    gains = []
    for z in (-6.0, -0.5, 6.0):
        heard = early_arrivals(surfaces, found, np.array([2.0, 0.0, z]))
        assert len(heard) == 2  # the direct sound and one reflection
        distance = heard.time[1] * SPEED_OF_SOUND
        gains.append(heard.pressure[1, 6] * distance * np.exp(0.5 * distance * energy_exponents()[6]))
    wood, both, cloth = gains
    assert both == pytest.approx((wood + cloth) / 2, rel=1e-3)
    assert cloth < 0.8 * wood


def home_like():
    """A floor, a panel on feet before it and a table over it: free edges, and surfaces that hide each other."""
    return mesh_of(
        wood_floor=rectangle((-4, 0, -4), (4, 0, 4), axis=1),
        wood_panel=rectangle((0, 0, -0.6), (0, 1.2, 0.6)),
        wood_table=rectangle((1.2, 0.7, -0.4), (1.8, 0.7, 0.8), axis=1),
    )


def test_six_millimetres_are_no_step():
    surfaces, source = surfaces_of(home_like()), np.array([1.5, 1.0, -0.5])
    found, lit = images_of(surfaces, source, 3, 0), lit_edges(surfaces.edges, source)
    levels = []
    for z in np.arange(-1.0, 3.0, 0.006):
        listener = np.array([1.4, 1.3, z])
        energy = early_arrivals(surfaces, found, listener).energy + diffracted(surfaces, lit, listener).energy
        levels.append(10 * np.log10(energy))
    # The direct sound alone changes by 0.08 dB per step near the source; a path that comes or goes made 0.96 dB.
    assert np.abs(np.diff(levels, axis=0)).max() < 0.12


def test_no_step_where_a_source_goes_behind_a_wall():
    """What the wall lets through begins at 0 on its edge, where the diffracted sound is half of the direct one."""
    surfaces, source = surfaces_of(mesh_of(wood=rectangle((0, -3, -3), (0, 3, 0)))), np.array([-0.8, 0.0, -0.3])
    found, lit = images_of(surfaces, source, 1, 0), lit_edges(surfaces.edges, source)
    levels = []
    for z in (0.2994, 0.2998, 0.3002, 0.3006):
        listener = np.array([0.8, 0.0, z])
        parts = [early_arrivals(surfaces, found, listener), diffracted(surfaces, lit, listener)]
        heard = [part.pressure[:, :5].sum(axis=0, dtype=float) for part in parts if len(part)]
        levels.append(20 * np.log10(np.abs(sum(heard))))
    assert np.abs(np.diff(levels, axis=0)).max() < 0.1  # 0.4 to 3 dB with all of what the wall lets through
    deep = early_arrivals(surfaces, found, np.array([0.8, 0.0, -2.0]))
    distance = deep.time[0] * SPEED_OF_SOUND
    assert deep.pressure[0] * distance == pytest.approx(
        wall_gain(1) * np.exp(-0.5 * distance * energy_exponents()), rel=1e-5
    )


def test_a_rug_does_not_end_the_floor_and_no_step_ends_a_surface():
    """A step that is small beside the zones is none: the lower surface goes on from the upper one."""
    rug = {"wood": rectangle((-4, 0, -4), (4, 0, 4), axis=1), "cloth": rectangle((-1, 0.01, -1), (1, 0.01, 1), axis=1)}
    surfaces = surfaces_of(mesh_of(**rug))
    height = surfaces.plane_equation[:, 3] / surfaces.plane_equation[:, 1]
    upper = int(np.argmax(height))
    of_rug = slice(surfaces.rims.first[upper], surfaces.rims.first[upper + 1])
    up = FRONT if surfaces.plane_equation[upper, 1] > 0 else BACK
    assert not surfaces.rims.ends_surface[of_rug, up].any()


def test_a_corner_ends_a_surface_from_outside_alone():
    """Two walls that meet at a right angle: inside the corner neither ends, outside both do."""
    floor, wall = rectangle((0, 0, 0), (3, 0, 3), axis=1), rectangle((0, 0, 0), (0, 3, 3))
    surfaces = surfaces_of(mesh_of(wood_floor=floor, wood_wall=wall))
    for plane in range(2):
        edges = slice(surfaces.rims.first[plane], surfaces.rims.first[plane + 1])
        ends = surfaces.rims.ends[edges]
        common = (np.abs(ends[:, [0, 1, 3, 4]]) < 1e-9).all(axis=1)
        assert common.sum() == 1
        assert len(ends) == 4
        inside = FRONT if surfaces.plane_equation[plane, :3].sum() > 0 else BACK
        assert surfaces.rims.ends_surface[edges][common, inside].tolist() == [False]
        assert surfaces.rims.ends_surface[edges][common, 1 - inside].tolist() == [True]
        assert surfaces.rims.ends_surface[edges][~common].all()
