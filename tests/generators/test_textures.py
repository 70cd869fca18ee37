"""Textures: they repeat without a seam, look different at every seed, and reflect as much light as real surfaces."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from generators.assets.textures import ceramic, cloth, noise, outdoors, pictures, surfaces, wood
from generators.assets.textures.maps import Surface, normal_map, roughness_map, surfaced
from generators.assets.textures.noise import Image, hex_colour, to_linear, to_srgb
from tests.support.tiers import some

H = hex_colour
Maker = Callable[[np.random.Generator], Image | Surface]
SMALL = 256

REPEATING: dict[str, Maker] = {
    **{f"veneer {s}": lambda rng, s=s: wood.veneer(rng, s, size=SMALL) for s in wood.SPECIES},  # type: ignore[misc]
    "strips": lambda rng: wood.strips(rng, "oak", size=SMALL),
    "herringbone": lambda rng: wood.herringbone(rng, "oak", size=SMALL, repeats=2),
    "herringbone straight": lambda rng: wood.herringbone(rng, "walnut", size=SMALL, diagonal=False, repeats=2),
    "butcher block": lambda rng: wood.butcher_block(rng, "oak", size=SMALL),
    "painted": lambda rng: wood.painted(rng, H("#7d8f86"), size=SMALL),
    "tiles": lambda rng: ceramic.tiles(rng, H("#e4e3de"), H("#b0aea8"), size=SMALL),
    "metro": lambda rng: ceramic.tiles(
        rng, H("#e4e3de"), H("#88867f"), size=SMALL, tiling=ceramic.Tiling(columns=4, rows=8, stagger=0.5)
    ),
    "marble tiles": lambda rng: ceramic.tiles(
        rng, H("#e4e3de"), H("#c0beb8"), size=SMALL, vein=H("#808084"), tiling=ceramic.Tiling(columns=2, rows=2)
    ),
    "hexagons": lambda rng: ceramic.hexagons(rng, (H("#dddad2"), H("#8f9a9b")), H("#c9c7c2"), size=SMALL, columns=7),
    "cement": lambda rng: ceramic.cement(rng, (H("#e6e0d2"), H("#4d6b82"), H("#b8834f")), size=SMALL, columns=4),
    "terracotta": lambda rng: ceramic.terracotta(rng, H("#b8704c"), H("#b9a58c"), size=SMALL, columns=4),
    "wall paint": lambda rng: surfaces.wall_paint(rng, H("#d9dccf"), size=SMALL),
    "lime plaster": lambda rng: surfaces.wall_paint(rng, H("#d9c9ac"), size=SMALL, rough=3.0),
    **{
        f"wallpaper {m}": lambda rng, m=m: surfaces.wallpaper(rng, H("#e2ddd0"), H("#a9b5a4"), motif=m, size=SMALL)  # type: ignore[misc]
        for m in ("stripes", "trellis", "damask", "sprigs")
    },
    "brick": lambda rng: surfaces.brick(rng, H("#96583f"), H("#b3aa9d"), size=512),
    "concrete": lambda rng: surfaces.concrete(rng, H("#a19f9b"), size=SMALL),
    "terrazzo": lambda rng: surfaces.terrazzo(rng, H("#dedad2"), (H("#8a7f74"), H("#5f6664")), size=512),
    "granite": lambda rng: surfaces.granite(rng, (H("#3f3f41"), H("#6b6a69"), H("#b0aca6")), size=SMALL),
    "brushed metal": lambda rng: surfaces.brushed(rng, H("#b6b9bb"), size=SMALL),
    "leather": lambda rng: surfaces.leather(rng, H("#7a4a2e"), size=SMALL),
    "soil": lambda rng: surfaces.soil(rng, H("#55432f"), size=SMALL),
    "wicker": lambda rng: surfaces.wicker(rng, H("#c49c68"), size=SMALL),
    "weave": lambda rng: cloth.weave(rng, H("#a5a9aa"), second=H("#c0c2c2"), size=SMALL),
    "boucle": lambda rng: cloth.boucle(rng, H("#dcd5c8"), size=SMALL),
    "velvet": lambda rng: cloth.velvet(rng, H("#44563f"), size=SMALL),
    "knit": lambda rng: cloth.knit(rng, H("#cdbfae"), size=SMALL),
    "terry": lambda rng: cloth.terry(rng, H("#d2a793"), size=SMALL),
    "carpet": lambda rng: cloth.carpet(rng, H("#8d8478"), size=SMALL),
    "curtain": lambda rng: cloth.curtain(rng, H("#d6cdbd"), size=SMALL),
    **{
        f"print {m}": lambda rng, m=m: cloth.printed(rng, H("#dfd9cb"), H("#7a8f9a"), motif=m, size=SMALL)  # type: ignore[misc]
        for m in ("stripes", "checks", "zigzag", "dots")
    },
}
COLOURS = (H("#e2d8c6"), H("#7c3b32"), H("#2f4658"), H("#c08a4e"))
FITTED: dict[str, Maker] = {
    **{
        f"rug {p}": lambda rng, p=p: cloth.rug(rng, COLOURS, pattern=p, size=128)  # type: ignore[misc]
        for p in ("berber", "bands", "oriental", "worn", "arcs", "plain")
    },
    **{
        f"painting {m}": lambda rng, m=m: pictures.painting(rng, COLOURS, motif=m, size=128) for m in pictures.PAINTINGS
    },  # type: ignore[misc]
    "outdoors": lambda rng: outdoors.outdoors(rng, size=256),
    "books": lambda rng: pictures.book_spines(rng, COLOURS, size=384),
    "leaf": lambda rng: pictures.leaf(rng, H("#4b7440"), size=128),
    "hob": lambda rng: pictures.hob(rng, size=256),
    "oven panel": lambda rng: pictures.oven_panel(rng, H("#b6b9bb")),
    "screen": lambda rng: pictures.tv_screen(rng, size=128),
}
EVERY = {**REPEATING, **FITTED}


def _image(made: Image | Surface) -> Image:
    return made.pixels if isinstance(made, Surface) else made


def _steps(image: Image, axis: int) -> np.ndarray:
    """Mean absolute difference of each line of pixels to the next one, the last being the step across the seam."""
    lines = np.moveaxis(image.astype(float), axis, 0)
    return np.abs(np.roll(lines, -1, axis=0) - lines).mean(axis=(1, 2))


@pytest.mark.parametrize("name", some(REPEATING, every=4))
def test_the_step_across_the_seam_is_an_ordinary_step(name: str) -> None:
    image = _image(REPEATING[name](np.random.default_rng(5)))
    for axis in (0, 1):
        steps = _steps(image, axis)
        assert steps[-1] <= 1.15 * steps[:-1].max() + 0.3, f"{name}: seam along axis {axis}"


def test_the_seam_test_notices_a_seam() -> None:
    image = _image(REPEATING["concrete"](np.random.default_rng(5)))[:200]
    steps = _steps(image, 0)
    assert steps[-1] > 1.15 * steps[:-1].max() + 0.3


@pytest.mark.parametrize("name", some(REPEATING, every=4))
def test_the_relief_repeats_like_the_picture(name: str) -> None:
    surface = REPEATING[name](np.random.default_rng(5))
    assert isinstance(surface, Surface)
    for field in (surface.height, surface.matte):
        for axis in (0, 1) if field is not None else ():
            steps = _steps(np.repeat(np.asarray(field)[..., None], 3, axis=2) * 1e5, axis)
            assert steps[-1] <= 1.15 * steps[:-1].max() + 0.3, f"{name}: seam along axis {axis}"


@pytest.mark.parametrize("name", some(REPEATING, every=4))
def test_reliefs_are_as_steep_as_real_ones(name: str) -> None:
    surface = REPEATING[name](np.random.default_rng(5))
    assert isinstance(surface, Surface)
    if surface.height is None:
        assert name == "granite"
        return
    normal = normal_map(surface.height, 0.5, surface.tilt).astype(float) / 127.5 - 1
    slope = np.hypot(normal[..., 0], normal[..., 1]) / normal[..., 2]
    assert 0.002 < np.median(slope) < 0.7, name
    assert np.abs(normal[..., :2].mean(axis=(0, 1))).max() < 0.03, f"{name}: leans to one side"


@pytest.mark.parametrize("slopes", [(0.5, 0.0), (0.0, 0.25), (-0.3, 0.4)])
def test_a_ramp_has_the_normal_of_its_slope(slopes: tuple[float, float]) -> None:
    """In a saw-tooth, dh/du = a (to the right) and dh/dv = b (upwards): n ∝ (−a, −b, 1) but where it falls back."""
    metres, side = 0.4, 64
    along = (np.arange(side) + 0.5) / side * metres
    a, b = slopes
    normal = normal_map(a * along[None, :] + b * along[::-1, None], metres)
    expected = np.array([-a, -b, 1.0]) / np.sqrt(a * a + b * b + 1)
    inner = normal[1:-1, 1:-1].astype(float) / 127.5 - 1
    assert np.abs(inner - expected).max() <= 1 / 127.5 + 1e-6
    # x and y are dithered: their means are exact to a small part of a step.
    assert np.abs(inner[..., :2].mean(axis=(0, 1)) - expected[:2]).max() <= 0.03 / 127.5


def test_tilts_add_to_slopes_and_large_maps_are_averages() -> None:
    flat, tilt = np.zeros((1024, 1024)), np.zeros((1024, 1024, 2))
    tilt[:, :512], tilt[:, 512:] = (0.1, 0.0), (0.0, -0.2)
    normal = normal_map(flat, 1.0, tilt).astype(float) / 127.5 - 1
    assert normal.shape == (512, 512, 3)
    np.testing.assert_allclose(normal[5, 5, :2] / normal[5, 5, 2], (-0.1, 0.0), atol=0.005)
    np.testing.assert_allclose(normal[5, -5, :2] / normal[5, -5, 2], (0.0, 0.2), atol=0.005)


def test_roughness_map_times_factor_is_the_roughness() -> None:
    matte = np.linspace(0, 0.8, 64)[None, :].repeat(8, axis=0)
    factor, pixels = roughness_map(matte, 0.4)
    np.testing.assert_allclose(factor * pixels[..., 1] / 255, 0.4 + 0.6 * matte, atol=0.5 * factor / 255 + 1e-6)
    assert factor == pytest.approx(0.88)
    assert (pixels[..., 2] == 255).all()


def test_grout_is_rougher_and_deeper_than_glaze() -> None:
    surface = ceramic.tiles(np.random.default_rng(1), H("#e4e3de"), H("#b0aea8"), size=512)
    material = surfaced("tiles", "tile", surface, 0.4, 1.2)
    assert material.roughness_map is not None
    assert material.normal_map is not None
    rough = material.roughness * material.roughness_map.pixels[..., 1] / 255
    assert np.median(rough) == pytest.approx(0.4, abs=0.03)
    assert rough.max() > 0.8
    assert surface.height is not None
    assert surface.matte is not None
    joints = surface.matte > 0.8
    assert surface.height[~joints].mean() - surface.height[joints].mean() > 0.001


@pytest.mark.parametrize("name", some(EVERY, every=4))
def test_albedo_is_that_of_real_surfaces(name: str) -> None:
    image = _image(EVERY[name](np.random.default_rng(2)))
    assert image.dtype == np.uint8
    assert image.ndim == 3
    assert image.shape[2] == 3
    assert 0.03 < float(to_linear(image / 255).mean()) < 0.85


@pytest.mark.parametrize("name", some(EVERY, every=4))
def test_same_seed_same_bytes_and_another_seed_another_image(name: str) -> None:
    make = EVERY[name]
    first, again, other = (_image(make(np.random.default_rng(s))) for s in (1, 1, 2))
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()


def test_floor_boards_differ_from_one_another() -> None:
    image = wood.strips(np.random.default_rng(3), "oak", size=512, metres=2.4, width=0.15).pixels
    rows = to_linear(image / 255).mean(axis=2).reshape(16, 32, 512)[:, 4:28].mean(axis=(1, 2))
    assert rows.std() / rows.mean() > 0.02
    correlations = np.corrcoef(image.mean(axis=2).reshape(16, -1)) - np.eye(16)
    assert correlations.max() < 0.9


def test_spectral_noise_has_unit_variance_and_falls_with_frequency() -> None:
    field = noise.spectral(np.random.default_rng(0), (256, 256), 1.5)
    assert abs(field.mean()) < 1e-6
    assert field.std() == pytest.approx(1.0)
    power = np.abs(np.fft.fft2(field)) ** 2
    assert power[0, 2:6].mean() > 30 * power[0, 40:60].mean()


def test_stretched_noise_is_smoother_along_the_stretch() -> None:
    field = noise.spectral(np.random.default_rng(0), (256, 256), 1.5, stretch=(1.0, 20.0))
    across, along = np.diff(field, axis=0).std(), np.diff(field, axis=1).std()
    assert along < 0.35 * across


def test_cells_are_as_many_as_asked_and_edges_are_at_their_borders() -> None:
    ids, edge = noise.cells(np.random.default_rng(0), (128, 128), 60)
    assert 55 <= len(np.unique(ids)) <= 60
    border = ids != np.roll(ids, 1, axis=1)
    assert edge[border].max() < 1.0
    assert edge.max() > 4


def test_srgb_round_trip() -> None:
    value = np.linspace(0, 1, 101)
    np.testing.assert_allclose(to_srgb(to_linear(value)), value, atol=1e-12)
    assert to_linear(0.5) == pytest.approx(0.21404, abs=1e-5)
    np.testing.assert_allclose(hex_colour("#ff8000"), (1, 128 / 255, 0))


@pytest.mark.parametrize(
    "make",
    [
        lambda rng: surfaces.wallpaper(rng, COLOURS[0], COLOURS[1], motif="tartan"),
        lambda rng: cloth.printed(rng, COLOURS[0], COLOURS[1], motif="tartan"),
        lambda rng: cloth.rug(rng, COLOURS, pattern="tartan"),
        lambda rng: pictures.painting(rng, COLOURS, motif="tartan"),
        lambda rng: ceramic.tiles(rng, COLOURS[0], COLOURS[1], tiling=ceramic.Tiling(rows=7, stagger=0.5)),
    ],
)
def test_unknown_motifs_are_refused(make: Maker) -> None:
    with pytest.raises(ValueError, match=r"expected|even"):
        make(np.random.default_rng(0))
