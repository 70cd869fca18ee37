"""Diffraction at edges against closed forms: the infinite wedge, the shadow's boundary, barriers."""

import numpy as np
import pytest
from scipy.integrate import quad

from generators.acoustics.geometry import SPEED_OF_SOUND, AcousticMesh
from generators.acoustics.tracer.air import energy_exponents
from generators.acoustics.tracer.arrivals import BANDS
from generators.acoustics.tracer.diffraction import diffracted, diffracted_at, lit_edges
from generators.acoustics.tracer.surfaces import surfaces_of
from tests.support.acoustic_rooms import box_scene, solid
from tests.support.tiers import some
from tests.support.tracer_rooms import SIZE, SOURCE, box, label, surfaces

#: Half of the length of the edges: their ends come too late to matter.
HALF = 40.0


def mesh_of(corners, faces):
    return AcousticMesh(np.array(corners, dtype=float), {"wood": np.array(faces)})


def half_plane():
    """A thin rigid sheet x = 0, y < 0; its edge is the z axis."""
    corners = [[0, 0, -HALF], [0, 0, HALF], [0, -HALF, -HALF], [0, -HALF, HALF]]
    return surfaces_of(mesh_of(corners, [[0, 1, 2], [1, 3, 2]]))


def right_wedge():
    """A rigid quarter space x > 0, y < 0: the air fills 270° about the z axis."""
    corners = [[0, 0, -HALF], [0, 0, HALF], [0, -HALF, -HALF], [0, -HALF, HALF], [HALF, 0, -HALF], [HALF, 0, HALF]]
    return surfaces_of(mesh_of(corners, [[0, 1, 2], [1, 3, 2], [0, 1, 4], [1, 5, 4]]))


def over_the_axis(found, source, listener):
    """Arrivals over the edge on the z axis alone."""
    axis = (np.abs(found.edges.start[:, :2]) < 1e-9).all(axis=1) & (np.abs(found.edges.along[:, 2]) > 0.999)
    assert axis.sum() == 1
    keep = np.flatnonzero(axis)
    edges = type(found.edges)(*(getattr(found.edges, name)[keep] for name in found.edges.__dataclass_fields__))
    return diffracted(found, lit_edges(edges, np.array(source)), np.array(listener))


def pressure(arrivals, frequency, band, distance):
    """Complex sum at a frequency, without the absorption of the air over ``distance``."""
    sound = np.sum(arrivals.pressure[:, band] * np.exp(-2j * np.pi * frequency * arrivals.time))
    return sound * np.exp(0.5 * energy_exponents()[band] * distance)


@pytest.mark.parametrize(
    ("room", "opening", "source", "listener"),
    [
        (half_plane, 2 * np.pi, (-3.0, -1.0, 0.0), (2.0, -1.5, 0.0)),
        (half_plane, 2 * np.pi, (-3.0, -1.0, 0.0), (2.0, -0.5, 3.0)),
        (right_wedge, 1.5 * np.pi, (-1.0, -2.0, 0.0), (3.0, 0.5, 0.0)),
        (right_wedge, 1.5 * np.pi, (-1.0, -2.0, 1.0), (2.0, 0.3, -2.0)),
    ],
)
def test_an_infinite_wedge_has_biot_and_tolstoys_response(room, opening, source, listener):
    """h(t) = −c·ν/(2π)·Σβ/(r_S·r_R·sinh η), cosh η = (c²t² − r_S² − r_R² − z²)/(2·r_S·r_R), from the onset on."""
    arrivals = over_the_axis(room(), source, listener)
    (xs, ys, zs), (xl, yl, zl) = source, listener
    r_s, r_l, z = np.hypot(xs, ys), np.hypot(xl, yl), zl - zs
    # Angles from the face x = 0, y < 0, through the air on the side of −x.
    angles = [np.mod(np.arctan2(-x, -y), 2 * np.pi) for x, y in ((xs, ys), (xl, yl))]
    nu, onset = np.pi / opening, np.hypot(r_s + r_l, z) / SPEED_OF_SOUND

    def response(u):
        # t = onset + u²: the singularity of the onset, 1/√, is gone.
        time = onset + u * u
        y = ((SPEED_OF_SOUND * time) ** 2 - r_s**2 - r_l**2 - z**2) / (2 * r_s * r_l)
        eta = np.arccosh(max(y, 1.0 + 1e-15))
        beta = sum(
            np.sin(nu * phi) / (np.cosh(nu * eta) - np.cos(nu * phi))
            for a in (1, -1)
            for b in (1, -1)
            for phi in [np.pi + a * angles[0] + b * angles[1]]
        )
        return -SPEED_OF_SOUND * nu / (2 * np.pi) * beta / (r_s * r_l * np.sinh(eta)) * 2 * u

    assert arrivals.time.min() == pytest.approx(onset, abs=1e-9)
    assert arrivals.direction[0, :2] == pytest.approx(
        -np.array(listener[:2]) / np.hypot(r_l, r_l / (r_s + r_l) * z), abs=1e-3
    )
    # The lowest octave has all cells; they end 16 of 40 µs after the onset, 16 of 80 µs later, …
    amplitude = arrivals.pressure[:, 0].astype(float) * np.exp(
        0.5 * energy_exponents()[0] * arrivals.time * SPEED_OF_SOUND
    )
    for end in (2e-4, 6.4e-4, 1.92e-3, 4.48e-3, 9.6e-3):
        expected = quad(response, 0, np.sqrt(end), epsabs=1e-10, limit=200)[0]
        assert amplitude[arrivals.time < onset + end - 1e-9].sum() == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("side", [-1, 1])
def test_on_the_shadows_boundary_half_of_the_direct_sound_is_left(side):
    """−6 dB at high frequencies, from both sides: the level is continuous."""
    source, listener = np.array([-3.0, -1.0, 0.0]), np.array([3.0, 1.0 + side * 1e-3, 0.0])
    arrivals = over_the_axis(half_plane(), source, listener)
    distance = np.linalg.norm(listener - source)
    for band in (5, 6, 7):
        frequency = BANDS[band]
        total = pressure(arrivals, frequency, band, distance)
        if side > 0:
            total += np.exp(-2j * np.pi * frequency * distance / SPEED_OF_SOUND) / distance
        assert 20 * np.log10(abs(total) * distance) == pytest.approx(-6.0, abs=0.6)


@pytest.mark.parametrize("height", [0.0, -1.0, -3.0])
def test_a_long_screen_attenuates_as_maekawas_chart(height):
    """10·lg(3 + 20·N) dB for the Fresnel number N, within the 2.5 dB by which the chart and exact theory differ."""
    source, listener = np.array([-3.0, -1.0, 0.0]), np.array([3.0, height, 0.0])
    arrivals = over_the_axis(half_plane(), source, listener)
    distance = np.linalg.norm(listener - source)
    detour = np.hypot(3, 1) + np.hypot(3, height) - distance
    for band in range(7):
        level = 20 * np.log10(abs(pressure(arrivals, BANDS[band], band, distance)) * distance)
        chart = -10 * np.log10(3 + 40 * detour * BANDS[band] / SPEED_OF_SOUND)
        assert level == pytest.approx(chart, abs=2.8)


def test_source_and_listener_may_change_places_round_an_edge():
    found, a, b = right_wedge(), (-1.0, -2.0, 1.0), (2.0, 0.3, -2.0)
    forth, back = over_the_axis(found, a, b), over_the_axis(found, b, a)
    assert forth.time == pytest.approx(back.time, abs=1e-12)
    assert forth.pressure == pytest.approx(back.pressure, rel=1e-4)


@pytest.mark.parametrize("band", some([3, 4, 5], every=3))
def test_diffraction_moves_energy_and_adds_none(band):
    """Flux through a plane behind a half plane: that of the lit part, neither more nor less (energy is conserved)."""
    found, source = half_plane(), np.array([-2.0, -1.0, 0.0])
    edges = lit_edges(found.edges, source)
    flux = lit = 0.0
    for height in np.linspace(-9.0, 11.0, 401):
        listener = np.array([2.0, height, 0.0])
        distance = np.linalg.norm(listener - source)
        direct = np.exp(-2j * np.pi * BANDS[band] * distance / SPEED_OF_SOUND) / distance if height > 1.0 else 0.0
        total = direct + pressure(diffracted(found, edges, listener), BANDS[band], band, distance)
        cosine = 4.0 / distance
        # A line source's flux: the mean over z only widens the path.
        flux += cosine * distance * abs(total) ** 2
        lit += cosine * distance * abs(direct) ** 2
    assert flux / lit == pytest.approx(1.0, abs=0.05)


def test_a_box_has_corners_but_no_edges():
    found = surfaces(box())
    assert not len(diffracted(found, lit_edges(found.edges, SOURCE), np.array([4.0, 2.0, 1.5])))


def divided(door=0.0):
    """A room with a wall up to ``door`` metres before its end."""
    wall = solid("wall", (0.1, SIZE[1], SIZE[2] - door), (3.0, SIZE[1] / 2, (SIZE[2] - door) / 2), label=label(0.2))
    return surfaces(box_scene(SIZE, label=label(0.2), extra=(wall,)))


def test_sound_bends_round_the_end_of_a_wall():
    found, source, listener = divided(door=1.0), np.array([1.0, 1.2, 2.3]), np.array([4.5, 1.2, 1.0])
    arrivals = diffracted(found, lit_edges(found.edges, source), listener)
    # Over the corner at x = 3.05, z = 2, which both see; the one at x = 2.95 is hidden from the listener.
    corner = np.array([3.05, 1.2, 2.0])
    path = np.linalg.norm(source - corner) + np.linalg.norm(listener - corner)
    assert arrivals.time.min() * SPEED_OF_SOUND == pytest.approx(path, abs=1e-6)
    first = arrivals.direction[np.argmin(arrivals.time)]
    assert first == pytest.approx((corner - listener) / np.linalg.norm(corner - listener), abs=1e-3)
    level = [abs(pressure(arrivals, BANDS[band], band, path)) * path for band in (2, 4, 6)]
    assert 1 > level[0] > level[1] > level[2] > 0.02
    # With the source behind the wall too, both corners are on the way: paths over two edges are left out.
    assert not len(diffracted(found, lit_edges(found.edges, SOURCE), listener))


def test_nothing_bends_through_a_closed_wall_or_out_of_sight():
    closed = divided()
    assert not len(diffracted(closed, lit_edges(closed.edges, SOURCE), np.array([4.5, 1.2, 1.0])))


def test_the_edges_of_a_thin_wall_count_once():
    """Both corners of the end of a wall see source and listener; the sound is that of one edge, below half."""
    found = divided(door=1.0)
    listener = np.array([5.0, 1.2, 2.75])  # just behind the line from the source past the end
    source = np.array([1.0, 1.2, 1.0])
    arrivals = diffracted(found, lit_edges(found.edges, source), listener)
    total = abs(pressure(arrivals, 2000, 5, 0.0)) * np.linalg.norm(listener - source)
    assert 0.1 < total < 0.75


def test_many_listeners_have_the_arrivals_of_each():
    found = right_wedge()
    lit = lit_edges(found.edges, np.array([-1.0, -2.0, 0.0]))
    listeners = np.random.default_rng(1).uniform(-4.0, 4.0, (200, 3))
    together = diffracted_at(found, lit, listeners)
    alone = [diffracted(found, lit, listener) for listener in listeners]
    assert 20 < sum(len(each) > 0 for each in alone) < 180
    for one, other in zip(together, alone, strict=True):
        assert (one.time.tobytes(), one.pressure.tobytes()) == (other.time.tobytes(), other.pressure.tobytes())
