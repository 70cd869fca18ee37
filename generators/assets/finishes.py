"""Floors, walls and worktops: texture and acoustic label of each named finish of a style."""

from __future__ import annotations

import numpy as np

from avs3d_bench.errors import UsageError
from generators.assets.styles import Style
from generators.assets.textures import ceramic, surfaces, wood
from generators.assets.textures.maps import Surface, surfaced
from generators.assets.textures.noise import Field, Image, grid, hex_colour, mix, shift_colour, to_image
from generators.core.scene import Material

#: Metres per repeat of floors, walls, tiles on walls, and worktops.
FLOOR, WALL, WALL_TILES, WORKTOP = 2.4, 2.12, 1.2, 0.9

#: Acoustic label and roughness of the floors of `dry_floor`.
DRY_FLOORS = {
    "strips": ("parquet", 0.72),
    "strips_wide": ("parquet", 0.72),
    "strips_narrow": ("parquet", 0.64),
    "herringbone": ("parquet", 0.64),
    "herringbone_straight": ("parquet", 0.64),
    "concrete": ("concrete", 0.64),
    "terracotta": ("tile", 0.81),
}


def dry_floor(kind: str, spec: str, rng: np.random.Generator) -> Surface:
    """The floor of a living room, hall or bedroom: 2.4 m per repeat; ``spec`` is a species or a colour."""
    if kind == "strips":
        return wood.strips(rng, spec, width=0.12, length=1.2)
    if kind == "strips_wide":
        return wood.strips(rng, spec, width=0.2, length=2.4, tone=0.12)
    if kind == "strips_narrow":
        return wood.strips(rng, spec, width=0.08, length=0.6)
    if kind == "herringbone":
        return wood.herringbone(rng, spec)
    if kind == "herringbone_straight":
        return wood.herringbone(rng, spec, diagonal=False, repeats=3)
    if kind == "concrete":
        return surfaces.concrete(rng, hex_colour(spec))
    if kind == "terracotta":
        return ceramic.terracotta(rng, hex_colour(spec), hex_colour("#b7a58c"))
    raise UsageError(f"unknown floor {kind!r}: expected one of {', '.join(DRY_FLOORS)}")


def _checker(rng: np.random.Generator, colours: tuple[Field, ...]) -> Surface:
    """Light and dark squares of 30 cm with slight variations."""
    light = ceramic.tiles(
        rng, colours[0], colours[0] * 0.7, tiling=ceramic.Tiling(columns=8, rows=8, joint=2.5, tone=0.012)
    )
    dark = ceramic.tiles(
        rng, colours[1], colours[0] * 0.7, tiling=ceramic.Tiling(columns=8, rows=8, joint=2.5, tone=0.03, mottle=0.04)
    )
    x, y = grid(*light.pixels.shape[:2])
    odd = (np.floor(x * 8) + np.floor(y * 8)) % 2 > 0

    def either(own: Field | Image | None, other: Field | Image | None) -> Field | Image | None:
        return None if own is None or other is None else np.where(odd if own.ndim == 2 else odd[..., None], other, own)

    return Surface(*(either(own, other) for own, other in zip(light, dark, strict=True)))  # type: ignore[arg-type]


def wet_floor(role: str, kind: str, colours: tuple[Field, ...], rng: np.random.Generator) -> Material:
    """The floor of a kitchen or bathroom: 2.4 m per repeat."""
    roughness = 0.49
    if kind == "hex":
        surface = ceramic.hexagons(rng, colours, shift_colour(colours[0], value=-0.2), columns=16)
    elif kind == "square":
        surface = ceramic.tiles(
            rng, colours[0], colours[1], tiling=ceramic.Tiling(columns=6, rows=6, mottle=0.03, tone=0.015)
        )
    elif kind == "slate":
        surface = ceramic.tiles(
            rng, colours[0], colours[1], tiling=ceramic.Tiling(columns=4, rows=8, mottle=0.06, tone=0.04)
        )
    elif kind == "concrete_tile":
        surface = ceramic.tiles(
            rng, colours[0], colours[1], tiling=ceramic.Tiling(columns=4, rows=4, mottle=0.05, tone=0.02, joint=2.5)
        )
    elif kind == "marble":
        surface = ceramic.tiles(
            rng, colours[0], colours[1], vein=colours[1] * 0.9, tiling=ceramic.Tiling(columns=4, rows=4, joint=2.0)
        )
    elif kind == "checker":
        surface = _checker(rng, colours)
    elif kind == "terrazzo":
        surface, roughness = surfaces.terrazzo(rng, colours[0], colours[1:]), 0.56
    elif kind == "cement":
        surface, roughness = ceramic.cement(rng, (colours[0], colours[1], colours[2]), columns=12), 0.72
    elif kind == "terracotta":
        surface, roughness = ceramic.terracotta(rng, colours[0], colours[1]), 0.81
    else:
        raise UsageError(f"unknown wet floor {kind!r}: see the wet_floors of generators/assets/styles.py")
    return surfaced(role, "tile", surface, roughness, FLOOR)


def wall_tiles(role: str, kind: str, colour: Field, grout: Field, rng: np.random.Generator) -> Material:
    """The tiles of a bathroom's walls or a kitchen's splash-back: 1.2 m per repeat."""
    if kind == "metro":
        surface = ceramic.tiles(
            rng, colour, grout, tiling=ceramic.Tiling(columns=6, rows=12, stagger=0.5, bevel=9.0, tone=0.012, joint=3.5)
        )
    elif kind == "metro_v":
        # Upright bricks in a straight bond.
        surface = ceramic.tiles(
            rng, colour, grout, tiling=ceramic.Tiling(columns=16, rows=6, bevel=5.0, tone=0.03, mottle=0.03, joint=3.0)
        )
    elif kind == "square":
        surface = ceramic.tiles(
            rng, colour, grout, tiling=ceramic.Tiling(columns=8, rows=8, bevel=4.0, tone=0.010, joint=3.5, mottle=0.01)
        )
    elif kind == "square_small":
        surface = ceramic.tiles(
            rng, colour, grout, tiling=ceramic.Tiling(columns=12, rows=12, bevel=6.0, tone=0.025, joint=3.5)
        )
    elif kind == "mosaic":
        near = (shift_colour(colour, value=0.16, saturation=-0.3), shift_colour(colour, value=-0.18, saturation=0.15))
        surface = ceramic.tiles(
            rng, colour, grout, palette=near, tiling=ceramic.Tiling(columns=40, rows=40, tone=0.035, joint=4.0)
        )
    elif kind == "marble":
        surface = ceramic.tiles(
            rng, colour, colour * 0.85, vein=grout, tiling=ceramic.Tiling(columns=2, rows=4, joint=2.5, tone=0.006)
        )
    elif kind == "slate":
        surface = ceramic.tiles(rng, colour, grout, tiling=ceramic.Tiling(columns=2, rows=4, mottle=0.05, joint=3.0))
    else:
        raise UsageError(f"unknown wall tile {kind!r}: see the wall_tiles of generators/assets/styles.py")
    return surfaced(role, "tile", surface, 0.42, WALL_TILES)


def accent_wall(role: str, finish: str, style: Style, rng: np.random.Generator) -> Material:
    """A feature wall, 2.12 m per repeat: wallpaper in half of the flats whose style has any, else paint or brick."""
    if finish == "brick":
        return surfaced(role, "brick", surfaces.brick(rng, hex_colour("#96583f"), hex_colour("#b3aa9d")), 1, WALL)
    if style.papers and rng.random() < 0.5:
        motif, ground, ink = style.papers[int(rng.integers(len(style.papers)))]
        paper = surfaces.wallpaper(rng, hex_colour(ground), hex_colour(ink), motif=motif)
        height = None if paper.height is None else np.tile(paper.height, (2, 2))
        return surfaced(role, "plaster", Surface(np.tile(paper.pixels, (2, 2, 1)), height), 1, WALL)
    colour = hex_colour(style.accents[int(rng.integers(len(style.accents)))])
    paint = surfaces.wall_paint(rng, colour, rough=3.0 if finish == "lime" else 1.0)
    return surfaced(role, "plaster", paint, 1, WALL)


def worktop(role: str, spec: str, rng: np.random.Generator) -> Material:
    """A kitchen's worktop, 0.9 m per repeat, of ``kind:value`` (see `Style.worktops`)."""
    kind, value = spec.split(":")
    if kind == "wood":
        return surfaced(role, "wood", wood.butcher_block(rng, value), 0.72, WORKTOP)
    colour = hex_colour(value)
    if kind == "granite":
        minerals = (colour, shift_colour(colour, value=0.35), shift_colour(colour, value=1.0, saturation=-0.3))
        return surfaced(role, "ceramic", surfaces.granite(rng, minerals), 0.36, WORKTOP)
    if kind == "marble":
        sheet = ceramic.marble_sheet(rng, (512, 512), colour, mix(colour, np.full(3, 0.4), np.array([0.75]))[0])
        return surfaced(role, "ceramic", to_image(sheet), 0.36, WORKTOP)
    if kind == "terrazzo":
        chips = (hex_colour("#8d7a66"), hex_colour("#b9785a"), hex_colour("#6d7a74"))
        return surfaced(role, "ceramic", surfaces.terrazzo(rng, colour, chips, size=512), 0.49, WORKTOP)
    if kind == "steel":
        return surfaced(role, "metal", surfaces.brushed(rng, colour), 0.25, WORKTOP)
    raise UsageError(f"unknown worktop {spec!r}: expected wood:, granite:, marble:, terrazzo: or steel:")
