"""Methods that save rays in the baking: adaptive shadow rays and probes, light interpolated between blocks."""

from __future__ import annotations

import numpy as np
import pytest

from generators.assets.shapes import MeshBuilder
from generators.core.low_discrepancy import pattern_of, square_points
from generators.core.rays import Tracer
from generators.core.scene import Material, Mesh, Part
from generators.lighting.blocks import make_blocks
from generators.lighting.direct import Occlusion, direct_light
from generators.lighting.emitters import Emitters, bright_patches, find_emitters
from generators.lighting.form_factors import unoccluded_light
from generators.lighting.gather import open_texels
from generators.lighting.interpolation import Slow
from generators.lighting.radiosity import LinkTracer
from generators.lighting.sun import SUN_RADIUS, Sun, _beam_points, sun_light
from generators.lighting.surfaces import LitSurfaces
from generators.lighting.texels import Sheet, Texels, rasterise
from generators.lighting.unwrap import unwrap

GREY = Material("grey", "plaster", (0.5, 0.5, 0.5))
SIDE = 48
#: Side of a texel of the floor, metres.
STEP = 2.0 / SIDE


def lamp(half: float = 0.5, height: float = 2.0) -> Emitters:
    """A square of side 2 · half that shines down, with 16 targets."""
    corners = [(-half, height, -half), (half, height, -half), (half, height, half), (-half, height, half)]
    glow = Material("lamp", "plastic", (0.0, 0.0, 0.0), emission=(8.0, 8.0, 8.0))
    return find_emitters(LitSurfaces.of([Part("lamp", MeshBuilder().quad(corners, glow).build())]), 16)


class Floor:
    """48 × 48 points on a floor of 2 m, ordered by blocks of 4 × 4."""

    def __init__(self) -> None:
        row, column = np.divmod(np.arange(SIDE * SIDE), SIDE)
        block = row // 4 * (SIDE // 4) + column // 4
        order = np.argsort(block, kind="stable")
        row, column = row[order], column[order]
        self.block = block[order]
        x, z = (column + 0.5) * STEP - 1.0, (row + 0.5) * STEP - 1.0
        self.position = np.stack([x, np.zeros_like(x), z], axis=1).astype(np.float32)
        self.normal = np.tile(np.array([0, 1, 0], dtype=np.float32), (len(x), 1))
        self.pattern = pattern_of(column.astype(np.int32), row.astype(np.int32))


class Screen:
    """An opaque half plane at half height that hides what lies at x > 0; it counts the rays."""

    def __init__(self, height: float = 1.0) -> None:
        self.height, self.rays = height, 0

    def __call__(self, origins: np.ndarray, directions: np.ndarray, far: np.ndarray) -> np.ndarray:
        self.rays += int((far > 0).sum())
        share = self.height / np.maximum(directions[:, 1], 1e-9)
        return np.asarray((share < far) & (origins[:, 0] + share * directions[:, 0] > 0))


def visible_part(x: np.ndarray, half: float = 0.5, height: float = 2.0, screen: float = 1.0) -> np.ndarray:
    """Form-factor-weighted visible part of the lamp above points (x, 0, 0), by fine quadrature."""
    side = (np.arange(400) + 0.5) / 400 * 2 * half - half
    u, v = np.meshgrid(side, side)
    weight = 1.0 / ((u[None] - x[:, None, None]) ** 2 + v**2 + height**2) ** 2
    seen = x[:, None, None] + (u - x[:, None, None]) * screen / height <= 0
    return np.asarray((weight * seen).sum(axis=(1, 2)) / weight.sum(axis=(1, 2)))


def lit_floor(screen: Occlusion, *, saving: bool) -> tuple[np.ndarray, np.ndarray, Floor]:
    """Light on the floor over the unoccluded light, its variance, and the floor."""
    floor, emitters = Floor(), lamp()
    reach = np.ones((len(floor.position), 1), dtype=bool)
    light, variance = direct_light(
        emitters,
        reach,
        floor.pattern,
        floor.position,
        floor.normal,
        screen,
        block=floor.block if saving else None,
    )
    pair = np.arange(len(floor.position))
    whole = unoccluded_light(emitters, pair, pair * 0, floor.position, floor.normal)
    return light[:, 0] / whole[:, 0], variance, floor


def test_penumbra_of_a_half_plane_follows_the_closed_form() -> None:
    screen, full = Screen(), Screen()
    share, _, floor = lit_floor(screen, saving=True)
    near = np.abs(floor.position[:, 2]) < 0.2
    column = np.round((floor.position[:, 0] + 1.0) / STEP - 0.5).astype(int)
    mean = np.bincount(column[near], share[near]) / np.bincount(column[near])
    x = (np.arange(SIDE) + 0.5) * STEP - 1.0
    assert np.abs(mean - visible_part(x)).max() < 0.05
    assert np.abs(mean - visible_part(x)).mean() < 0.01
    # The penumbra is as wide as the lamp: half of the floor lies in it, and keeps its rays.
    reference, _, _ = lit_floor(full, saving=False)
    assert np.abs(share - reference).mean() < 0.004
    assert screen.rays < 0.8 * full.rays


def test_blocks_in_full_light_and_in_full_shadow_have_no_noise() -> None:
    light, noise, _ = lit_floor(lambda *ray: np.zeros(len(ray[0]), dtype=bool), saving=True)
    assert light == pytest.approx(np.ones(len(light)), abs=1e-6)
    assert not noise.any()
    dark, noise, _ = lit_floor(lambda *ray: np.ones(len(ray[0]), dtype=bool), saving=True)
    assert not dark.any()
    assert not noise.any()


def test_half_of_the_lamp_is_half_of_its_light_everywhere() -> None:
    # Close to the lamp the screen hides the same half for all.
    share, noise, _ = lit_floor(Screen(1.9), saving=True)
    assert np.abs(share - 0.5).max() < 0.2
    assert share.mean() == pytest.approx(0.5, abs=0.01)
    assert (noise > 0).all()


class Slit:
    """Hides all of the lamp of `lamp` but a strip across ``axis``, ``wide`` (m) from ``left`` on, from anywhere."""

    def __init__(self, axis: int, left: float, wide: float) -> None:
        self.axis, self.left, self.right = axis, left, left + wide

    def __call__(self, origins: np.ndarray, directions: np.ndarray, far: np.ndarray) -> np.ndarray:
        x = origins[:, self.axis] + directions[:, self.axis]
        return np.asarray((x < self.left) | (x >= self.right))


@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("left", np.arange(-0.5, 0.44, 0.0625).tolist())
def test_a_sixteenth_of_the_lamp_is_found_wherever_it_is(left: float, axis: int) -> None:
    # In the order of the sequence the first quarters of all sets would lie in four stripes of the lamp, and whole
    # blocks would take it for hidden (or for visible, with a bar before it) although a sixteenth was not.
    share, _, floor = lit_floor(Slit(axis, left, 1.0 / 16), saving=True)
    together = np.bincount(floor.block, share) / np.bincount(floor.block)
    assert (together > 0).all()
    assert share.mean() == pytest.approx(1 / 16, rel=0.12)


@pytest.mark.parametrize("count", [4, 8, 16])
def test_first_quarters_of_all_sets_are_a_net_together(count: int) -> None:
    points = square_points(count, (0x9E3779B9, 0x3C6EF372))[:, : count // 4].reshape(-1, 2)
    for columns in (2**k for k in range(len(points).bit_length())):
        cell = np.floor(points * (columns, len(points) // columns)).astype(int)
        assert len(np.unique(cell, axis=0)) == len(points)


@pytest.mark.parametrize("samples", [16, 32])
def test_the_sun_s_disc_and_the_texel_are_sampled_independently(samples: int) -> None:
    # The share of rays beyond an edge, of rays that start all over a texel, to points all over the disc.
    disc, jitter = (each.reshape(-1, 2).astype(np.float64) for each in _beam_points(samples))
    rng = np.random.default_rng(2)
    radius, angle = np.sqrt(rng.random(100_000)), 2 * np.pi * rng.random(100_000)
    free_disc = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    free_jitter = rng.random((100_000, 2))
    errors = []
    for turn, other, edge in rng.uniform((0, 0, -0.8), (2 * np.pi, 2 * np.pi, 0.8), (100, 3)):
        one, two = np.array([np.cos(turn), np.sin(turn)]), 2 * np.array([np.cos(other), np.sin(other)])
        share = (disc / SUN_RADIUS @ one + (jitter - 0.5) @ two > edge).mean()
        errors.append(share - (free_disc @ one + (free_jitter - 0.5) @ two > edge).mean())
    assert np.sqrt(np.mean(np.square(errors))) < 0.018


def ball(radius: float, centre: tuple[float, float, float]) -> Emitters:
    """A ball that shines with 8."""
    glow = Material("glass", "glass", (0.0, 0.0, 0.0), emission=(8.0, 8.0, 8.0))
    mesh = MeshBuilder().sphere(radius, centre, glow, segments=32, rings=24).build()
    return find_emitters(LitSurfaces.of([Part("ball", mesh)]), 16)


@pytest.mark.parametrize("distance", [0.4, 1.0, 3.0])
def test_a_ball_shines_alike_to_all_sides(distance: float) -> None:
    # The form factor of a ball from a point that faces it is (radius / distance)², whatever the direction.
    emitters = ball(0.15, (1.0, 2.0, 3.0))
    away = np.random.default_rng(5).normal(size=(500, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    pair = np.arange(len(away))
    light = unoccluded_light(
        emitters,
        pair,
        0 * pair,
        (np.array([1.0, 2.0, 3.0]) + distance * away).astype(np.float32),
        (-away).astype(np.float32),
    )
    share = light[:, 0] / (8.0 * (0.15 / distance) ** 2)
    assert share.mean() == pytest.approx(1.0, abs=0.015)
    assert share.std() < 0.02
    assert np.abs(share - 1.0).max() < 0.06


def test_half_a_ball_behind_a_plane_gives_what_its_visible_targets_give() -> None:
    # The few targets that face a texel weigh more at one texel than at the next: the mean of the texels' own visible
    # shares, the light of a ball whose upper part is hidden, would be wrong by several per cent.
    floor, emitters = Floor(), ball(0.15, (0.0, 0.6, 0.0))

    def upper(origins: np.ndarray, directions: np.ndarray, far: np.ndarray) -> np.ndarray:
        return np.asarray(origins[:, 1] + directions[:, 1] > 0.54)

    reach = np.ones((len(floor.position), 1), dtype=bool)
    scene = (floor.position, floor.normal)
    light, _ = direct_light(emitters, reach, floor.pattern, *scene, upper, block=floor.block)
    pair = np.arange(len(floor.position))
    whole = unoccluded_light(emitters, pair, 0 * pair, *scene)[:, 0]
    target = emitters.points[0].reshape(-1, 9).astype(np.float64)
    way = target[None, :, :3] - floor.position[::7, None]
    here, there = way[..., 1], -np.einsum("nkc,kc->nk", way, target[:, 3:6])
    weight = np.maximum(here, 0) * np.maximum(there, 0) / np.einsum("nkc,nkc->nk", way, way) ** 2
    seen = (weight * (target[:, 1] <= 0.54)).sum(axis=1) / weight.sum(axis=1)
    expected = (seen * whole[::7]).sum()
    assert light[::7, 0].sum() == pytest.approx(expected, rel=0.015)


def test_shadow_rays_are_shot_in_quarters() -> None:
    count = 0

    def free(origins: np.ndarray, directions: np.ndarray, far: np.ndarray) -> np.ndarray:
        nonlocal count
        count += len(far)
        return np.zeros(len(far), dtype=bool)

    lit_floor(free, saving=True)
    assert count == SIDE * SIDE * 4
    count = 0
    lit_floor(free, saving=False)
    assert count == SIDE * SIDE * 16


def test_the_edge_of_the_sun_is_the_same_with_and_without_blocks() -> None:
    # A pane over the half x < 0 of the floor, the sun in the zenith.
    pane = [(-1.0, 1.0, -1.0), (0.0, 1.0, -1.0), (0.0, 1.0, 1.0), (-1.0, 1.0, 1.0)]
    wall = [(0.0, 1.0, -1.0), (1.0, 1.0, -1.0), (1.0, 1.0, 1.0), (0.0, 1.0, 1.0)]
    surfaces = LitSurfaces.of([Part("roof", MeshBuilder().quad(pane, GREY).quad(wall, GREY).build())])
    sun = Sun(np.array([0.05, 1.0, 0.02]), np.ones(3, dtype=np.float32), np.array([True, True, False, False]))
    floor = Floor()
    across = np.tile(np.array([[STEP, 0, 0], [0, 0, STEP]], dtype=np.float32), (len(floor.position), 1, 1))
    given = (sun, floor.pattern, floor.position, floor.normal, across, Tracer(surfaces.triangles), 32)
    whole, saved = sun_light(*given), sun_light(*given, block=floor.block)
    assert 0.3 < (whole[:, 0] > 0.5).mean() < 0.7
    assert np.abs(whole - saved).max() < 0.1
    assert np.abs(whole - saved).mean() < 0.001


def test_a_narrow_gap_between_walls_gets_the_whole_sun() -> None:
    # It is one and a half texels wide, and the rays of a texel start over two.
    roof = MeshBuilder().quad([(-1.0, 1.0, -1.0), (1.0, 1.0, -1.0), (1.0, 1.0, 1.0), (-1.0, 1.0, 1.0)], GREY)
    for side in (-1, 1):
        roof.box((0.5, 0.02, 2.0), (side * (0.25 + 0.75 * STEP), 0.01, 0.0), GREY)
    surfaces = LitSurfaces.of([Part("roof", roof.build())])
    pane = np.arange(len(surfaces.triangles)) < 2
    sun = Sun(np.array([0.0, 1.0, 0.001]), np.ones(3, dtype=np.float32), pane)
    middle = np.tile(np.array([0.0, 0.001, 0.0], dtype=np.float32), (16, 1))
    up = np.tile(np.array([0.0, 1.0, 0.0], dtype=np.float32), (16, 1))
    across = np.tile(np.array([[STEP, 0, 0], [0, 0, STEP]], dtype=np.float32), (16, 1, 1))
    given = (sun, np.arange(16, dtype=np.int32), middle, up, across, Tracer(surfaces.triangles), 32)
    assert sun_light(*given) == pytest.approx(1.0, abs=0.01)
    assert sun_light(*given, block=np.zeros(16, dtype=np.int64)) == pytest.approx(1.0, abs=0.01)


def plain(mesh: Mesh, texel: float) -> tuple[LitSurfaces, Sheet, Texels]:
    surfaces = LitSurfaces.of([Part("plain", mesh)])
    sheet = Sheet.of([unwrap(mesh.positions, texel)])
    return surfaces, sheet, rasterise(surfaces, sheet)


def test_interpolation_reproduces_a_linear_field_up_to_the_edges() -> None:
    floor = MeshBuilder().quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], GREY).build()
    surfaces, sheet, texels = plain(floor, 0.04)
    blocks = make_blocks(surfaces, sheet, texels)
    slow = Slow.of(sheet, surfaces.part[texels.face], texels, blocks, np.full(len(blocks), 5.0, dtype=np.float32))
    assert slow.is_slow.all()
    field = (2.0 + 0.5 * slow.place[:, :1] / 50 - 0.3 * slow.place[:, 1:] / 50).astype(np.float32).repeat(3, axis=1)
    sites = slow.sites(texels)
    assert 0.2 < sites.mean() < 0.35
    for measured in (None, sites):
        mean = blocks.mean(field, measured)
        out = np.zeros_like(field)
        slow.interpolate(texels, mean, out, measured)
        # The ridge of the regression costs a little at the border.
        assert np.abs(out - field).max() < 0.01
        assert np.abs(out - field).mean() < 0.001


def test_a_block_close_to_something_is_not_interpolated() -> None:
    floor = MeshBuilder().quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], GREY).build()
    surfaces, sheet, texels = plain(floor, 0.04)
    blocks = make_blocks(surfaces, sheet, texels)
    distance = np.full(len(blocks), 5.0, dtype=np.float32)
    distance[7] = 0.2
    slow = Slow.of(sheet, surfaces.part[texels.face], texels, blocks, distance)
    assert np.flatnonzero(~slow.is_slow).tolist() == [7]
    out = np.full((len(texels), 3), -1.0, dtype=np.float32)
    ones = np.ones((len(blocks), 3), dtype=np.float32)
    slow.interpolate(texels, ones, out)
    assert ((out[:, 0] < 0) == (blocks.of == 7)).all()


def test_every_other_texel_takes_the_mean_of_its_neighbours_where_something_is_rather_near() -> None:
    floor = MeshBuilder().quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], GREY).build()
    surfaces, sheet, texels = plain(floor, 0.04)
    blocks = make_blocks(surfaces, sheet, texels)
    # Two sides of a block of 4 × 0.04 m: neither far nor at a contact.
    slow = Slow.of(sheet, surfaces.part[texels.face], texels, blocks, np.full(len(blocks), 0.32, dtype=np.float32))
    assert not slow.is_slow.any()
    measured = slow.measured_apart()
    assert 0.45 < measured.mean() < 0.55
    field = (2.0 + 0.01 * slow.place[:, :1] - 0.02 * slow.place[:, 1:]).astype(np.float32).repeat(3, axis=1)
    light, noise = np.where(measured[:, None], field, -9.0).astype(np.float32), np.where(measured, 4.0, -9.0)
    slow.fill_between(light, noise)
    inner = np.all((slow.place > 0) & (slow.place < slow.place.max(axis=0)), axis=1)
    assert np.abs(light - field)[inner].max() < 1e-5
    assert np.abs(light - field).max() < 0.03
    assert (noise == 4.0).all()


def test_an_enclosed_block_is_interpolated() -> None:
    floor = MeshBuilder().quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], GREY).build()
    lid = MeshBuilder().quad([(-1, 0.02, -1), (0, 0.02, -1), (0, 0.02, 1), (-1, 0.02, 1)], GREY).build()
    surfaces = LitSurfaces.of([Part("floor", floor), Part("lid", lid)])
    sheet = Sheet.of([unwrap(floor.positions, 0.04), unwrap(lid.positions, 0.04)])
    texels = rasterise(surfaces, sheet, surfaces.part == 0)
    blocks = make_blocks(surfaces, sheet, texels)
    links = LinkTracer(surfaces, sheet, texels, blocks, Tracer(surfaces.triangles), 1).trace(128)
    x, _, z = blocks.mean(texels.position).T
    assert links.is_enclosed[(x > -0.7) & (x < -0.3) & (np.abs(z) < 0.7)].all()
    assert not links.is_enclosed[x > 0.1].any()
    # Only the first half of the rays is shot at this stage.
    assert (links.block[:, 64:] == -2).all()
    slow = Slow.of(sheet, surfaces.part[texels.face], texels, blocks, links.distance, links.is_enclosed)
    assert slow.is_slow[links.is_enclosed].all()


def test_light_of_an_emitter_does_not_depend_on_what_is_computed_together() -> None:
    rng = np.random.default_rng(3)
    position = rng.uniform(-2, 2, (200, 3)).astype(np.float32)
    normal = rng.normal(size=(200, 3)).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    pair = np.arange(200)
    whole = unoccluded_light(lamp(), pair, pair * 0, position, normal)
    single = [
        unoccluded_light(
            lamp(),
            np.zeros(1, np.int64),
            np.zeros(1, np.int64),
            position[k : k + 1],
            normal[k : k + 1],
        )
        for k in range(200)
    ]
    assert (whole > 0).any()
    assert (whole == np.concatenate(single)).all()


def test_a_patch_has_the_same_power_near_and_far() -> None:
    # A radiance that grows along the patch: few cells of it are no fair sample.
    x, z = (a.ravel() for a in np.meshgrid(np.linspace(0.01, 0.99, 40), np.linspace(0.01, 0.99, 40)))
    position = np.stack([x, np.zeros_like(x), z], axis=1).astype(np.float32)
    normal = np.tile(np.array([0, 1, 0], dtype=np.float32), (len(x), 1))
    radiance = (10 * x**3)[:, None].repeat(3, axis=1).astype(np.float32)
    patches, used = bright_patches(position, normal, np.full(len(x), 1 / 1600, np.float32), radiance, 16)
    assert used.all()
    power = patches.cells[0, :, 6].mean()
    for level in range(3):
        few = patches.cells[0, : 256 >> (2 * level), 6].mean() * patches.balance[0, level, 0]
        assert few == pytest.approx(power, rel=1e-5)
    assert power == pytest.approx(radiance.mean(), rel=0.02)


def test_buried_texels_are_found_with_few_probes() -> None:
    # A floor with a closed box on it that hides a part of it.
    floor = MeshBuilder().quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], GREY).build()
    box = MeshBuilder().box((0.6, 0.4, 0.6), (0.1, 0.15, -0.2), GREY).build()
    surfaces = LitSurfaces.of([Part("floor", floor), Part("box", box)])
    sheet = Sheet.of([unwrap(floor.positions, 0.02), unwrap(box.positions, 0.02)])
    texels = rasterise(surfaces, sheet)
    tiles = make_blocks(surfaces, sheet, texels)
    found = open_texels(surfaces, texels, tiles, Tracer(surfaces.triangles), 1)
    on_floor = surfaces.part[texels.face] == 0
    offset = np.abs(texels.position[:, [0, 2]] - (0.1, -0.2)).max(axis=1)
    assert not found[on_floor & (offset < 0.29)].any()
    assert found[on_floor & (offset > 0.31)].all()
