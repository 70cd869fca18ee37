"""Palettes: every role has one material, which depends on the seed and not on the order of requests."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from avs3d_bench.errors import UsageError
from generators.apartments.plain import UNTEXTURED
from generators.assets import materials
from generators.assets.finishes import DRY_FLOORS, accent_wall, dry_floor, wall_tiles, wet_floor, worktop
from generators.assets.materials import ROLES, ROOM_KINDS, TILES, Palette
from generators.assets.styles import STYLES, Style
from generators.assets.textures.noise import hex_colour, to_linear
from generators.core.scene import Material

LABELS = {
    *("plaster", "concrete", "brick", "wood", "parquet", "tile", "ceramic", "glass", "metal", "plastic"),
    *("fabric", "carpet", "curtain", "upholstery", "foliage", "paper", "water"),
}


@pytest.fixture(scope="module", autouse=True)
def _one_view() -> Iterator[None]:
    """The view from the windows takes longest and is drawn from its random stream alone: once for all styles."""
    draw, seen = materials._RECIPES["window_view"], {}

    def once(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        stream = repr(rng.bit_generator.state)
        if stream not in seen:
            seen[stream] = draw(palette, style, role, rng)
        return seen[stream]

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(materials._RECIPES, "window_view", once)
        yield


@pytest.fixture(scope="module", params=list(STYLES))
def palette(request: pytest.FixtureRequest) -> Palette:
    return Palette.from_seed(np.random.default_rng(4), request.param)


def test_there_are_ten_styles_and_seeds_reach_them_all() -> None:
    assert len(STYLES) == 10
    assert {Palette.from_seed(np.random.default_rng(s)).style for s in range(60)} == set(STYLES)


@pytest.mark.slow
def test_every_role_has_a_material_that_is_bright_and_labelled_like_a_real_one(palette: Palette) -> None:
    linear = to_linear(np.arange(256) / 255)
    for role in ROLES:
        material = palette.material(role)
        assert material.name == role
        assert material.acoustic in LABELS, role
        assert (material.texture is None) == (role in UNTEXTURED), role
        assert 0 <= material.roughness <= 1
        colour = np.array(material.colour)
        if material.texture is not None:
            colour = colour * [linear[material.texture.pixels[..., channel]].mean() for channel in range(3)]
        assert 0.03 < colour.mean() < 0.86, f"{role}: albedo {colour.mean():.3f}"
        assert material is palette.material(role)


def test_materials_do_not_depend_on_the_order_they_are_asked_for() -> None:
    roles = ("wood", "floor_hall", "sofa", "picture_1", "floor_bedroom", "metal")
    one, two = (Palette.from_seed(np.random.default_rng(9), "industrial") for _ in range(2))
    forward = [one.material(r) for r in roles]
    backward = [two.material(r) for r in reversed(roles)][::-1]
    for a, b in zip(forward, backward, strict=True):
        assert a.colour == b.colour
        assert (a.texture is None) == (b.texture is None)
        if a.texture is not None and b.texture is not None:
            assert a.texture.pixels.tobytes() == b.texture.pixels.tobytes()


@pytest.mark.slow
def test_threads_that_ask_for_a_material_at_once_get_the_same_one(monkeypatch: pytest.MonkeyPatch) -> None:
    roles, made = ("soil", "floor_hall", "metal"), []
    own = Palette.from_seed(np.random.default_rng(9), "industrial")
    alone = Palette.from_seed(np.random.default_rng(9), "industrial")
    monkeypatch.setattr(materials, "ROLES", roles)
    monkeypatch.setattr(materials, "_LONGEST", ())
    stream = Palette.stream
    monkeypatch.setattr(Palette, "stream", lambda self, name: made.append((self, name)) or stream(self, name))
    with ThreadPoolExecutor(4) as pool:
        own.prepare(pool)
        found = list(pool.map(own.material, roles * 5))
    assert len({id(material) for material in found}) == len(roles)
    assert [made.count((own, role)) for role in roles] == [1, 1, 1]
    for material in found[:2]:
        texture, expected = material.texture, alone.material(material.name).texture
        assert texture is not None
        assert expected is not None
        assert texture.pixels.tobytes() == expected.pixels.tobytes()


def test_a_material_that_cannot_be_made_says_so_to_everyone(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise UsageError("no paint")

    monkeypatch.setitem(materials._RECIPES, "metal", fail)
    own = Palette.from_seed(np.random.default_rng(9), "industrial")
    for _ in range(2):
        with pytest.raises(UsageError, match="no paint"):
            own.material("metal")


def test_another_seed_is_another_flat() -> None:
    one, two = (Palette.from_seed(np.random.default_rng(s), "mediterranean") for s in (1, 2))
    a, b = (p.material("wood").texture for p in (one, two))
    assert a is not None
    assert b is not None
    assert a.pixels.tobytes() != b.pixels.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("room", ROOM_KINDS)
def test_a_room_has_all_its_surfaces(palette: Palette, room: str) -> None:
    finish = palette.finish(room)
    wet = room in ("bathroom", "kitchen")
    assert (finish.wall_tiles is not None) == wet
    assert (finish.tile_height > 1) == (room == "bathroom")
    assert (finish.accent_wall is finish.wall) == wet
    assert finish.floor.acoustic in {"parquet", "tile", "concrete"}
    assert finish.ceiling.acoustic == "plaster"
    assert TILES[finish.floor.name] >= 2.0
    assert finish.floor.texture is not None
    assert min(finish.floor.texture.pixels.shape[:2]) >= 1024


def test_dry_rooms_share_one_floor(palette: Palette) -> None:
    floors = [palette.finish(r).floor.texture for r in ("living_room", "hall", "bedroom")]
    assert floors[0] is not None
    assert all(f is not None and f.pixels is floors[0].pixels for f in floors)


@pytest.mark.slow
def test_lamps_shine_and_other_things_do_not(palette: Palette) -> None:
    lamps = {role for role in ROLES if max(palette.material(role).emission) > 0}
    assert lamps == {"lamp_shade", "lamp_glass", "bulb", "hood_light"}
    shade, bulb = palette.material("lamp_shade").emission, palette.material("bulb").emission
    assert 10 <= np.mean(shade) <= 25
    assert np.mean(bulb) > 2 * np.mean(shade)
    assert bulb[0] > bulb[2]


def test_metals_and_glass_are_glossy(palette: Palette) -> None:
    assert palette.material("chrome").roughness == pytest.approx(0.05)
    assert all(
        palette.material(r).roughness < 0.64 for r in ("metal", "tap", "chrome", "steel", "glass", "black_glass")
    )


def test_every_tile_entry_names_a_role_and_every_repeating_texture_has_a_size(palette: Palette) -> None:
    assert set(TILES) <= set(ROLES)
    assert all(size > 0 for size in TILES.values())


def test_unknown_names_are_refused_in_one_line() -> None:
    rng = np.random.default_rng(0)
    grey = hex_colour("#808080")
    palette = Palette.from_seed(rng)
    for call in (
        lambda: Palette("baroque", 1),
        lambda: palette.material("marmalade"),
        lambda: palette.finish("cellar"),
        lambda: dry_floor("grass", "oak", rng),
        lambda: wet_floor("floor_bathroom", "grass", (grey, grey), rng),
        lambda: wall_tiles("tiles_bathroom", "grass", grey, grey, rng),
        lambda: worktop("worktop", "grass:#808080", rng),
    ):
        with pytest.raises(UsageError, match=r"^unknown .*(expected|see)") as error:
            call()  # type: ignore[no-untyped-call]
        assert "\n" not in str(error.value)


@pytest.mark.slow
def test_every_finish_a_style_names_can_be_made() -> None:
    rng = np.random.default_rng(0)
    for style in STYLES.values():
        assert {kind for kind, _ in style.floors} <= set(DRY_FLOORS)
        assert all(
            accent_wall("accent_hall", finish, style, rng).texture is not None for finish in set(style.wall_finish)
        )
    for spec in dict.fromkeys(spec for style in STYLES.values() for spec in style.worktops):
        assert worktop("worktop", spec, rng).texture is not None
    for kind, colours in {k: c for s in STYLES.values() for k, c in s.wet_floors}.items():
        assert wet_floor("floor_bathroom", kind, tuple(hex_colour(c) for c in colours), rng).acoustic == "tile"
    for kind, colour, grout in {t[0]: t for s in STYLES.values() for t in s.wall_tiles}.values():
        assert wall_tiles("tiles_bathroom", kind, hex_colour(colour), hex_colour(grout), rng).acoustic == "tile"
