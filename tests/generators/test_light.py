"""Baked light against closed forms: furnace, form factors, energy, contact, leaks, the sun, inserted objects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from generators.assets.shapes import MeshBuilder
from generators.core.low_discrepancy import PATTERNS, cosine_directions, net, pattern_of
from generators.core.rays import Tracer
from generators.core.scene import LightMap, Material, Mesh, Part, Room, Scene, Texture
from generators.core.tone import develop, inverse_tone_curve, srgb_decode, tone_curve
from generators.lighting.bake import QUALITIES, bake, insert
from generators.lighting.emitters import face_areas
from generators.lighting.sun import find_sun, sun_light
from generators.lighting.surfaces import LitSurfaces
from generators.lighting.texels import Sheet, rasterise
from generators.lighting.unwrap import unwrap

SIZE = (4.0, 2.5, 3.0)
LAMP = Material("lamp", "plastic", (0.0, 0.0, 0.0), emission=(8.0, 8.0, 8.0))


def matte(albedo: float, **more: object) -> Material:
    return Material("matte", "plaster", (albedo,) * 3, **more)  # type: ignore[arg-type]


def box_room(material: Material, size: tuple[float, float, float] = SIZE, shift: float = 0.0) -> MeshBuilder:
    """A closed box seen from inside, its floor at y = 0."""
    x, y, z = size
    sides = [
        [(0, 0, z), (x, 0, z), (x, 0, 0), (0, 0, 0)],
        [(0, y, 0), (x, y, 0), (x, y, z), (0, y, z)],
        [(0, 0, 0), (x, 0, 0), (x, y, 0), (0, y, 0)],
        [(x, 0, z), (0, 0, z), (0, y, z), (x, y, z)],
        [(0, 0, z), (0, 0, 0), (0, y, 0), (0, y, z)],
        [(x, 0, 0), (x, 0, z), (x, y, z), (x, y, 0)],
    ]
    builder = MeshBuilder()
    for corners in sides:
        builder.quad(np.array(corners) + (shift, 0, 0), material)
    return builder


def ceiling_lamp(x: float, z: float, side: float, y: float) -> Mesh:
    """A square that shines down."""
    h = side / 2
    corners = [(x - h, y, z - h), (x + h, y, z - h), (x + h, y, z + h), (x - h, y, z + h)]
    return MeshBuilder().quad(corners, LAMP).build()


def scene_of(*meshes: Mesh, rooms: tuple[Room, ...] = ()) -> Scene:
    parts = tuple(Part(f"part_{k}", mesh) for k, mesh in enumerate(meshes))
    return Scene("test", parts, rooms, ())


def samples(part: Part, count: int = 4000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, 3) spread evenly over a part, their normals and their light, looked up bilinearly."""
    assert part.light is not None
    mesh, rng = part.mesh, np.random.default_rng(7)
    p = mesh.positions.astype(np.float64)
    cross = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    area = np.linalg.norm(cross, axis=1)
    face = rng.choice(len(p), count, p=area / area.sum())
    a, b = np.sqrt(rng.random(count)), rng.random(count)
    w = np.stack([1 - a, a * (1 - b), a * b], axis=1)[..., None]
    light = bilinear(part.light, (part.light.uv[face] * w).sum(axis=1))
    return (p[face] * w).sum(axis=1), cross[face] / area[face, None], light


def bilinear(light: LightMap, uv: np.ndarray) -> np.ndarray:
    height, width = light.texels.shape[:2]
    x, y = uv[:, 0] * width - 0.5, uv[:, 1] * height - 0.5
    left, low = np.floor(x).astype(int), np.floor(y).astype(int)
    out = np.zeros((len(uv), 3))
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.abs(1 - dx - (x - left)) * np.abs(1 - dy - (y - low))
            column, row = np.clip(left + dx, 0, width - 1), np.clip(low + dy, 0, height - 1)
            out += weight[:, None] * light.texels[row, column].astype(np.float64)
    return out


def area_of(mesh: Mesh) -> float:
    p = mesh.positions.astype(np.float64)
    return float(np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum() / 2)


def parallel_form_factor(point: np.ndarray, half: float, distance: float) -> float:
    """From a point to a parallel square of side 2·half round the axis (Howell's catalogue, B-3/B-4)."""

    def corner(a: float, b: float) -> float:
        x, y = a / distance, b / distance
        p, q = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
        return float((x / p * np.arctan(y / p) + y / q * np.arctan(x / q)) / (2 * np.pi))

    u, v = point
    return (
        corner(half - u, half - v)
        + corner(half + u, half - v)
        + corner(half - u, half + v)
        + corner(half + u, half + v)
    )


@pytest.fixture(scope="module")
def furnished() -> Scene:
    """A grey room with a ceiling lamp, a box standing on the floor, and a room description."""
    block = MeshBuilder().box((0.6, 0.8, 0.5), (1.0, 0.4, 1.0), matte(0.6), bevel=0.01).build()
    room = Room("living_room", (0.0, 0.0, 0.0), SIZE)
    return scene_of(box_room(matte(0.6)).build(), block, ceiling_lamp(2.0, 1.5, 0.8, 2.4), rooms=(room,))


@pytest.fixture(scope="module")
def lit(furnished: Scene) -> Scene:
    return bake(furnished, quality="preview")


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.8])
def test_furnace(albedo: float) -> None:
    # Everything glows with e and reflects ρ of what arrives: radiance is e / (1 - ρ) everywhere.
    baked = bake(scene_of(box_room(matte(albedo, emission=(1.0, 0.5, 0.25))).build()), quality="preview")
    _, _, light = samples(baked.parts[0])
    radiance = np.array([1.0, 0.5, 0.25]) + albedo * light
    expected = np.array([1.0, 0.5, 0.25]) / (1 - albedo)
    assert np.abs(radiance.mean(axis=0) / expected - 1).max() < 0.02
    # No look-up bleeds the black between the charts.
    assert np.abs(radiance / expected - 1).max() < 0.02


@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0])
def test_form_factor_of_a_parallel_square(distance: float) -> None:
    floor = MeshBuilder().quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], matte(0.5)).build()
    baked = bake(scene_of(floor, ceiling_lamp(0.0, 0.0, 1.0, distance)), quality="standard")
    points, _, light = samples(baked.parts[0], 400)
    expected = np.array([8.0 * parallel_form_factor(p[[0, 2]], 0.5, distance) for p in points])
    assert np.abs(light[:, 0].sum() / expected.sum() - 1) < 0.02
    assert np.abs(light[:, 0] / expected - 1).max() < 0.04


def test_half_hidden_emitter_gives_half_its_light() -> None:
    floor = MeshBuilder().quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], matte(0.0)).build()
    screen = MeshBuilder().box((2.0, 0.01, 4.0), (1.0, 1.0, 0.0), matte(0.0)).build()
    baked = bake(scene_of(floor, ceiling_lamp(0.0, 0.0, 1.0, 2.0), screen), quality="standard")
    points, _, light = samples(baked.parts[0], 4000)
    middle = np.linalg.norm(points[:, [0, 2]], axis=1) < 0.06
    whole = 8.0 * parallel_form_factor(np.zeros(2), 0.5, 2.0)
    assert light[middle, 0].mean() == pytest.approx(whole / 2, rel=0.06)


@pytest.mark.parametrize("albedo", [0.0, 0.5, 0.7])
def test_what_is_emitted_is_absorbed(albedo: float) -> None:
    baked = bake(scene_of(box_room(matte(albedo)).build(), ceiling_lamp(1.2, 1.0, 0.6, 2.0)), quality="preview")
    _, _, light = samples(baked.parts[0], 20000)
    absorbed = (1 - albedo) * light[:, 0].mean() * area_of(baked.parts[0].mesh)
    # The lamp's black front takes its share too.
    absorbed += samples(baked.parts[1])[2][:, 0].mean() * 0.36
    # Its back is no surface: what comes down from above meets the face from behind and is reflected by nothing (black).
    assert absorbed == pytest.approx(8.0 * 0.36, rel=0.04 if albedo < 0.1 else 0.06)


def test_light_of_bright_patches_is_not_lost() -> None:
    # What lies beside the window is bright enough to be sampled as an emitter for the bounces.
    baked = bake(window_room("plastic"), quality="standard")
    points, _, light = samples(baked.parts[0], 100000)
    pane = (points[:, 2] < 1e-6) & (np.abs(points[:, 0] - 2.0) < 0.6) & (np.abs(points[:, 1] - 1.6) < 0.6)
    absorbed = (np.where(pane, 1.0, 0.4) * light[:, 0]).mean() * area_of(baked.parts[0].mesh)
    assert absorbed == pytest.approx(10.0 * 1.2 * 1.2, rel=0.01)


def test_a_narrow_bright_board_sends_no_more_than_it_gets() -> None:
    # A strip of lamp over a board four texels wide, in a black room.
    low, high = [(x, 0.44, z) for x, z in [(1.4, 1.53), (2.0, 1.53), (2.0, 1.47), (1.4, 1.47)]], 0.5
    board = MeshBuilder().quad(low, matte(0.8)).build()
    lamp = MeshBuilder().quad([(x, high, z) for x, _, z in low[::-1]], LAMP).build()
    baked = bake(scene_of(box_room(matte(0.0)).build(), board, lamp), quality="standard")
    room, own, front = (samples(part, 100000)[2][:, 0].mean() for part in baked.parts)
    absorbed = room * area_of(baked.parts[0].mesh) + (0.2 * own + front) * 0.06 * 0.6
    assert absorbed == pytest.approx(8.0 * 0.06 * 0.6, rel=0.03)


def test_bounces_go_on_although_one_place_is_very_bright() -> None:
    # A small lamp above the floor: the place below it is some hundred times as bright as the mean.
    lamp = Material("lamp", "plastic", (0.0, 0.0, 0.0), emission=(100.0, 100.0, 100.0))
    corners = [(1.95, 0.25, 1.45), (2.05, 0.25, 1.45), (2.05, 0.25, 1.55), (1.95, 0.25, 1.55)]
    baked = bake(scene_of(box_room(matte(0.85)).build(), MeshBuilder().quad(corners, lamp).build()), quality="standard")
    points, _, light = samples(baked.parts[0], 400000)
    # Only reflections light walls and ceiling.
    floor = points[:, 1] < 1e-6
    room = area_of(baked.parts[0].mesh)
    absorbed = 0.15 * light[:, 0].mean() * room
    assert light[floor, 0].max() > 30 * light[~floor, 0].mean()
    assert absorbed == pytest.approx(100.0 * 0.1 * 0.1, rel=0.04)


def test_texels_stand_for_the_surface_in_their_square() -> None:
    # The sides of a chart run through the middles of texels: of a board four texels wide, five lie side by side.
    board = MeshBuilder().quad([(0, 0, 0), (0, 0, 1.2), (0.16, 0, 1.2), (0.16, 0, 0)], matte(0.5)).build()
    for mesh in (box_room(matte(0.5)).build(), board, MeshBuilder().sphere(0.1, (0, 0, 0), matte(0.5)).build()):
        surfaces = LitSurfaces.of([Part("part", mesh)])
        sheet = Sheet.of([unwrap(mesh.positions, 0.04, normals=mesh.normals)])
        texels = rasterise(surfaces, sheet)
        faces = np.bincount(sheet.chart, face_areas(mesh.positions))
        assert np.bincount(sheet.chart[texels.face], texels.area) == pytest.approx(faces, rel=1e-4)


def test_colour_bleeds() -> None:
    red = Material("red", "plaster", (0.7, 0.1, 0.1))
    builder = box_room(matte(0.6))
    builder.quad([(0.005, 0, 3), (0.005, 0, 0), (0.005, 2.5, 0), (0.005, 2.5, 3)], red)
    baked = bake(scene_of(builder.build(), ceiling_lamp(2.0, 1.5, 0.8, 2.4)), quality="preview")
    points, normals, light = samples(baked.parts[0])
    floor = normals[:, 1] > 0.9
    hue = light[:, 0] / np.maximum(light[:, 1], 1e-6)
    assert hue[floor & (points[:, 0] < 0.4)].mean() > 1.02 * hue[floor & (points[:, 0] > 3.6)].mean()


def test_floor_is_darker_at_a_contact_than_a_metre_away(lit: Scene) -> None:
    points, normals, light = samples(lit.parts[0], 60000)
    floor = normals[:, 1] > 0.9
    # Behind the box, on the side away from the lamp, and at the same distance from the lamp in the open.
    contact = floor & (np.abs(points[:, 0] - 0.64) < 0.05) & (np.abs(points[:, 2] - 1.0) < 0.2)
    away = floor & (np.abs(points[:, 0] - 3.36) < 0.1) & (np.abs(points[:, 2] - 2.0) < 0.2)
    assert light[contact].mean() < 0.6 * light[away].mean()


def test_light_does_not_pass_walls() -> None:
    bright, dark = box_room(matte(0.6)).build(), box_room(matte(0.6), shift=SIZE[0] + 0.1).build()
    baked = bake(scene_of(bright, dark, ceiling_lamp(2.0, 1.5, 0.8, 2.4)), quality="preview")
    assert samples(baked.parts[0])[2].min() > 0.05
    assert samples(baked.parts[1])[2].max() < 1e-3


def test_result_does_not_depend_on_workers_or_on_the_size_of_calls(
    furnished: Scene, lit: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    for workers, together in ((1, 1), (2, 1), (3, 16)):
        monkeypatch.setattr(Tracer, "calls_together", together)
        again = bake(furnished, quality="preview", workers=workers)
        assert again.rooms == lit.rooms
        for one, other in zip(lit.parts, again.parts, strict=True):
            assert one.light is not None
            assert other.light is not None
            assert one.light.texels.tobytes() == other.light.texels.tobytes()
            assert one.light.uv.tobytes() == other.light.uv.tobytes()


def test_parts_with_light_keep_it(furnished: Scene) -> None:
    own = LightMap(
        np.full((len(furnished.parts[1].mesh.positions), 3, 2), 0.5, np.float32), np.ones((1, 1, 3), np.float16)
    )
    parts = (furnished.parts[0], replace(furnished.parts[1], light=own), furnished.parts[2])
    baked = bake(replace(furnished, parts=parts), quality="preview")
    assert baked.parts[1].light is own
    assert baked.parts[0].light is not None


def test_unknown_quality_is_refused(furnished: Scene) -> None:
    with pytest.raises(Avs3dError, match="no quality 'ultra'; expected one of preview, standard, high"):
        bake(furnished, quality="ultra")


def test_exposure_follows_the_light(furnished: Scene, lit: Scene) -> None:
    strong = Material("lamp", "plastic", (0.0, 0.0, 0.0), emission=(32.0, 32.0, 32.0))
    lamp = replace(furnished.parts[2], mesh=replace(furnished.parts[2].mesh, materials=(strong,)))
    brighter = bake(replace(furnished, parts=(*furnished.parts[:2], lamp)), quality="preview")
    assert brighter.rooms[0].exposure == pytest.approx(lit.rooms[0].exposure / 4, rel=0.01)
    shown = tone_curve(lit.rooms[0].exposure * 0.6 * samples(lit.parts[0])[2].mean(axis=1))
    assert 0.15 < np.median(shown) < 0.45


def window_room(glass: str = "glass") -> Scene:
    """A box with a window of 1.2 m × 1.2 m in the wall at z = 0; the sun shines through it only if it is of glass."""
    x, y, z = SIZE
    white, pane = matte(0.6), Material("sky", glass, (0.0, 0.0, 0.0), emission=(10.0, 10.0, 10.0))
    b = MeshBuilder()
    b.quad([(0, 0, z), (x, 0, z), (x, 0, 0), (0, 0, 0)], white)
    b.quad([(0, y, 0), (x, y, 0), (x, y, z), (0, y, z)], white)
    b.quad([(x, 0, z), (0, 0, z), (0, y, z), (x, y, z)], white)
    b.quad([(0, 0, z), (0, 0, 0), (0, y, 0), (0, y, z)], white)
    b.quad([(x, 0, 0), (x, 0, z), (x, y, z), (x, y, 0)], white)
    for x0, x1, y0, y1 in ((0, 1.4, 0, y), (2.6, x, 0, y), (1.4, 2.6, 0, 1.0), (1.4, 2.6, 2.2, y)):
        b.quad([(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0)], white)
    b.quad([(1.4, 1.0, 0), (2.6, 1.0, 0), (2.6, 2.2, 0), (1.4, 2.2, 0)], pane)
    return scene_of(b.build())


def test_sun_draws_the_window_on_the_floor() -> None:
    scene = window_room()
    surfaces = LitSurfaces.of(scene.parts)
    sun = find_sun(scene.name, surfaces, Tracer(surfaces.triangles))
    assert sun is not None
    assert sun.pane.sum() == 2
    baked = bake(scene, quality="preview")
    points, normals, light = samples(baked.parts[0], 20000)
    d = sun.direction
    way = points[:, 2] / -d[2]
    x, y = points[:, 0] + way * d[0], points[:, 1] + way * d[1]
    open_side = normals @ d > 0.1
    edge = 0.15
    inside = open_side & (x > 1.4 + edge) & (x < 2.6 - edge) & (y > 1.0 + edge) & (y < 2.2 - edge)
    outside = open_side & ((x < 1.4 - edge) | (x > 2.6 + edge) | (y < 1.0 - edge) | (y > 2.2 + edge))
    assert inside.sum() > 50
    beam = sun.radiance.astype(float) * (normals @ d)[:, None]
    near_window = points[:, 2] < 0.5
    assert (light[inside] > 0.9 * beam[inside]).all()
    assert (light[outside & ~near_window] < 0.6 * beam[outside & ~near_window].max()).all()


def test_sunlight_of_a_texel_does_not_depend_on_the_texels_around() -> None:
    """On the floor with leaning normals; a matrix product of normals and the sun's direction would fail here."""
    scene = window_room()
    surfaces = LitSurfaces.of(scene.parts)
    tracer = Tracer(surfaces.triangles)
    sun = find_sun(scene.name, surfaces, tracer)
    assert sun is not None
    rng, count = np.random.default_rng(5), 20_000
    place = np.stack([rng.uniform(0, SIZE[0], count), np.full(count, 1e-3), rng.uniform(0, SIZE[2], count)], axis=1)
    leaning = rng.normal([0, 3, 0], 1, (count, 3))
    leaning /= np.linalg.norm(leaning, axis=1, keepdims=True)
    position, normal, across = (
        np.asarray(each, dtype=np.float32) for each in (place, leaning, np.zeros((count, 2, 3)))
    )
    pattern = np.arange(count, dtype=np.int32) % PATTERNS

    def light(first: int, last: int) -> np.ndarray:
        own = slice(first, last)
        return sun_light(sun, pattern[own], position[own], normal[own], across[own], tracer, 4)

    whole = light(0, count)
    assert (whole > 0).any()
    for piece in (192, 3072):
        assert np.concatenate([light(k, k + piece) for k in range(0, count, piece)]).tobytes() == whole.tobytes()


def test_screen_before_a_wall_is_no_window() -> None:
    screen = Material("screen", "glass", (0.0, 0.0, 0.0), emission=(2.0, 2.0, 2.0))
    mesh = MeshBuilder().box((1.2, 0.7, 0.05), (2.0, 1.2, 0.1), screen).build()
    surfaces = LitSurfaces.of(scene_of(box_room(matte(0.5)).build(), mesh).parts)
    assert find_sun("test", surfaces, Tracer(surfaces.triangles)) is None


def new_object(x: float, z: float, albedo: float = 0.5) -> Part:
    mesh = MeshBuilder().box((0.4, 0.5, 0.4), (x, 0.25, z), matte(albedo), bevel=0.01).build()
    return Part("new", mesh, instance_id=1, category="microwave")


def test_insertion_darkens_near_and_leaves_far_texels_alone(lit: Scene) -> None:
    before = [part.light.texels.tobytes() for part in lit.parts if part.light is not None]
    placed = insert(lit, (new_object(3.3, 2.2),))
    assert [part.light.texels.tobytes() for part in lit.parts if part.light is not None] == before
    assert placed.parts[-1].light is not None
    points, normals, old = samples(lit.parts[0], 30000)
    new = samples(placed.parts[0], 30000)[2]
    gap = np.linalg.norm(np.maximum(np.abs(points - (3.3, 0.25, 2.2)) - (0.2, 0.25, 0.2), 0), axis=1)
    rim = (normals[:, 1] > 0.9) & (gap > 0.02) & (gap < 0.1)
    assert (new[rim].mean() / old[rim].mean()) < 0.85
    assert (new[gap > 1.4] == old[gap > 1.4]).all()
    # The box by the far wall is out of reach: its map is not even copied.
    assert placed.parts[1].light is lit.parts[1].light


def test_a_shadow_that_meets_the_edge_of_the_sun_is_no_darker_than_the_room() -> None:
    lit = bake(window_room(), quality="preview")
    surfaces = LitSurfaces.of(lit.parts)
    sun = find_sun(lit.name, surfaces, Tracer(surfaces.triangles))
    assert sun is not None
    d = sun.direction
    x, z = 2.0 - 1.6 / d[1] * d[0], -1.6 / d[1] * d[2]  # the middle of the patch on the floor
    placed = insert(lit, (new_object(x, z),))
    points, normals, old = samples(lit.parts[0], 120_000)
    new = samples(placed.parts[0], 120_000)[2]
    way = points[:, 1] / d[1]
    at = points - way[:, None] * d  # on the floor, along the rays of the sun
    gap = np.linalg.norm(np.maximum(np.abs(points - (x, 0.25, z)) - (0.2, 0.25, 0.2), 0), axis=1)
    floor = (normals[:, 1] > 0.9) & (gap > 0.15)
    around = floor & (np.hypot(at[:, 0] - x, at[:, 2] - z) < 1.5)
    beam = sun.radiance.mean() * d[1]
    dim = np.median(old[around & (old.mean(axis=1) < 0.3 * beam)].mean(axis=1))
    taken = around & (new.mean(axis=1) < old.mean(axis=1) - 0.1 * beam)
    assert taken.sum() > 500
    assert new[taken].mean(axis=1).min() > 0.5 * dim


def test_inserted_light_agrees_with_a_bake_of_the_whole(furnished: Scene, lit: Scene) -> None:
    part = new_object(3.0, 2.0)
    whole = bake(furnished.with_parts((part,)), quality="standard")
    placed = insert(lit, (part,))
    _, normals, reference = samples(whole.parts[-1], 8000)
    _, _, light = samples(placed.parts[-1], 8000)
    for axis in range(3):
        for sign in (-1, 1):
            side = normals[:, axis] * sign > 0.9
            if (axis, sign) != (1, -1):
                assert light[side].mean() == pytest.approx(reference[side].mean(), rel=0.06), (axis, sign)
    points, up, shaded = samples(whole.parts[0], 30000)
    mine = samples(placed.parts[0], 30000)[2]
    gap = np.linalg.norm(np.maximum(np.abs(points - (3.0, 0.25, 2.0)) - (0.2, 0.25, 0.2), 0), axis=1)
    ring = (up[:, 1] > 0.9) & (gap > 0.1) & (gap < 0.5)
    assert mine[ring].mean() == pytest.approx(shaded[ring].mean(), rel=0.05)


def test_inserted_objects_shade_one_another(lit: Scene) -> None:
    alone = insert(lit, (new_object(3.0, 2.0, 0.0),)).parts[-1]
    beside = insert(lit, (new_object(3.0, 2.0, 0.0), new_object(3.45, 2.0, 0.0))).parts[-2]
    _, normals, free = samples(alone)
    _, _, close = samples(beside)
    facing = normals[:, 0] > 0.9
    assert close[facing].mean() < 0.5 * free[facing].mean()


def test_a_scan_lights_objects_by_its_texture() -> None:
    # All walls of the scan show the same colour: what stands in it receives from everywhere above the radiance that is
    # developed to that colour, so that a white thing in it looks like the walls.
    grey = Texture("scan", np.full((8, 8, 3), 188, dtype=np.uint8))
    scan = scene_of(box_room(replace(matte(1.0), texture=grey)).build())
    placed = insert(scan, (new_object(2.0, 1.5, 0.0),))
    assert placed.parts[0] is scan.parts[0]
    _, normals, light = samples(placed.parts[-1])
    radiance = float(inverse_tone_curve(srgb_decode(188 / 255)))
    assert develop(radiance) == 188
    assert light[normals[:, 1] > 0.9].mean() == pytest.approx(radiance, rel=0.01)
    assert light[np.abs(normals[:, 0]) > 0.9].mean() == pytest.approx(radiance, rel=0.02)


def test_directions_follow_the_cosine() -> None:
    directions = cosine_directions(64).reshape(-1, 3).astype(np.float64)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(np.ones(len(directions)), abs=1e-6)
    # E[z] = 2/3 and E[x] = E[y] = 0 for density cos θ / π.
    assert directions.mean(axis=0) == pytest.approx([0, 0, 2 / 3], abs=0.005)


def test_net_is_stratified() -> None:
    points = net(256, (123, 456))
    for rows in (1, 2, 16, 64, 256):
        cells = np.floor(points * (256 // rows, rows)).astype(int)
        assert len(np.unique(cells, axis=0)) == 256


def test_every_tile_holds_every_pattern() -> None:
    x, y = np.meshgrid(np.arange(4, dtype=np.int32) + 3, np.arange(4, dtype=np.int32) + 6)
    assert sorted(pattern_of(x, y).ravel()) == list(range(PATTERNS))


def test_unwrapped_faces_have_the_texel_size_asked_for_and_do_not_overlap() -> None:
    mesh = MeshBuilder().box((0.6, 0.8, 0.5), (0, 0, 0), matte(0.5), bevel=0.05).build()
    texel = 0.01
    layout = unwrap(mesh.positions, texel)
    p, t = mesh.positions.astype(np.float64), layout.uv.astype(np.float64)
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1) / 2
    e, f = t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]
    cells = np.abs(e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]) / 2
    assert cells.sum() == pytest.approx(area.sum() / texel**2, rel=0.05)
    # A texel centre lies in at most one face.
    x, y = np.meshgrid(np.arange(layout.width) + 0.5123, np.arange(layout.height) + 0.4871)
    hits = np.zeros(x.shape, dtype=int)
    for a, b, c in t:
        det = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(det) < 1e-9:
            continue
        v = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / det
        w = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / det
        hits += (v > 1e-6) & (w > 1e-6) & (v + w < 1 - 1e-6)
    assert hits.max() == 1


def test_charts_end_where_the_shading_normals_of_two_faces_differ() -> None:
    # A level square and a slope of 50°, which meet in an edge along x.
    turn = np.radians(50.0)
    up, lean = np.array([0, 1, 0]), np.array([0, np.cos(turn), np.sin(turn)])
    slope = np.array([0, -np.sin(turn), np.cos(turn)])
    a, b = np.array([0.0, 0.0, 0.0]), np.array([0.5, 0.0, 0.0])
    back = np.array([0.0, 0.0, -0.4])
    faces = [(a, b, b + back), (a, b + back, a + back), (b, a, a + 0.4 * slope), (b, a + 0.4 * slope, b + 0.4 * slope)]
    positions = np.array(faces, dtype=np.float32)
    sharp = np.array([[up] * 3] * 2 + [[lean] * 3] * 2, dtype=np.float32)
    soft = np.tile((up + lean) / np.linalg.norm(up + lean), (4, 3, 1)).astype(np.float32)

    def side_by_side(normals: np.ndarray) -> bool:
        chart = unwrap(positions, 0.02, normals=normals).chart
        assert chart[0] == chart[1]
        assert chart[2] == chart[3]
        return bool(chart[0] == chart[2])

    assert side_by_side(soft)
    assert not side_by_side(sharp)


def test_presets_are_ordered() -> None:
    coarse, middle, fine = (QUALITIES[name] for name in ("preview", "standard", "high"))
    assert coarse.fineness.texel > middle.fineness.texel > fine.fineness.texel
    assert coarse.gather_rays < middle.gather_rays < fine.gather_rays
