"""Tiles: square and rectangular grids, running bond, hexagons, mosaic, patterned cement tiles, marble, terracotta."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.assets.textures.maps import Surface
from generators.assets.textures.noise import (
    Field,
    blur,
    cells_of,
    mix,
    pick,
    relief,
    smoothstep,
    spectral,
    to_image,
)

#: Depth of the joints (m), waviness of a glaze (m, standard deviation), and spread of the slopes of tiles: hand-laid
#: tiles stand out by half a millimetre at most.
_JOINT, _GLAZE, _LEVEL = 1.5e-3, 8e-5, 0.006
#: Share by which grout is rougher (`Surface.matte`), and by which a glaze that is wiped is in places.
_GROUT, _SMUDGE = 0.85, 0.06


def marble_sheet(rng: np.random.Generator, shape: tuple[int, int], base: Field, vein: Field) -> Field:
    """Polished marble (H, W, 3): clouds, and veins along the zero contours of warped noise, thick and hair-thin."""
    cloud = spectral(rng, shape, 1.6, finest=6)
    first = spectral(rng, shape, 1.9, finest=4, stretch=(1.0, 1.8))
    second = spectral(rng, shape, 1.7, finest=3, stretch=(1.6, 1.0))
    strength = smoothstep(-0.4, 1.4, spectral(rng, shape, 1.8, finest=30))
    thick = np.exp(-((np.abs(first) / 0.07) ** 0.9)) * strength
    thin = np.exp(-((np.abs(second) / 0.03) ** 0.9)) * 0.5 * (1 - 0.6 * strength)
    amount = np.clip(0.10 * (cloud * 0.5 + 0.5) + 0.75 * thick + thin, 0, 1)
    return mix(base, vein, amount)


def _lay(
    rng: np.random.Generator,
    face: Field,
    ids: NDArray[np.int64],
    edge: Field,
    *,
    grout: Field,
    joint: float,
    bevel: float,
    tone: float,
) -> Surface:
    """Give tiles with colour ``face`` (H, W, 3) their own tone, a rounded rim and grout ``joint`` pixels wide."""
    count = int(ids.max()) + 1
    tones = 1 + rng.standard_normal((count, 1)) * tone + rng.standard_normal((count, 3)) * tone * 0.3
    height = smoothstep(joint / 2, joint / 2 + bevel, edge)
    shape = ids.shape
    wave = spectral(rng, shape, 1.2, finest=8, coarsest=200)
    tile = face * tones[ids] * (1 - relief(height, 0.10) + 0.006 * wave)[..., None]
    stain = spectral(rng, shape, 1.5, finest=16)
    grit = spectral(rng, shape, 0.4, finest=2)
    sand = 1 + 0.04 * grit + 0.05 * stain
    filled = smoothstep(joint / 2 - 0.6, joint / 2 + 0.6, edge)
    shadow = 1 - 0.10 * np.exp(-((edge / max(joint, 1.0)) ** 2))
    pixels = to_image(mix(grout * (sand * shadow)[..., None], tile, filled))
    depth = _JOINT * height + filled * _GLAZE * wave + (1 - filled) * 1e-4 * grit
    tilt = (rng.standard_normal((count, 2)) * _LEVEL)[ids] * filled[..., None]
    matte = _GROUT * (1 - filled) + _SMUDGE * filled * smoothstep(0.0, 2.5, stain)
    return Surface(pixels, depth, tilt, matte)


def _grid(size: int, columns: int, rows: int, stagger: float) -> tuple[NDArray[np.int64], Field, Field, Field]:
    """(id, local x, local y, distance to the rim) of a grid of tiles, alternate rows shifted by ``stagger`` of one."""
    y, x = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5, indexing="ij")
    width, height = size / columns, size / rows
    row = np.floor(y / height).astype(np.int64)
    slide = (x + (row % 2) * stagger * width) % size
    column = np.floor(slide / width).astype(np.int64)
    lx, ly = slide - column * width, y - row * height
    edge = np.minimum(np.minimum(lx, width - lx), np.minimum(ly, height - ly))
    return row * columns + column, lx, ly, edge


@dataclass(frozen=True)
class Tiling:
    """A grid of tiles; lengths in pixels of the image.

    Attributes:
        columns: tiles across.
        rows: tiles down; with ``stagger`` an even number.
        stagger: 0.5 is running bond (metro tiles).
        joint: width of the grout.
        bevel: width of the rounded rim.
        tone: spread of the tiles' brightness.
        mottle: spread of the brightness within a tile.
    """

    columns: int = 8
    rows: int = 8
    stagger: float = 0.0
    joint: float = 3.0
    bevel: float = 3.0
    tone: float = 0.02
    mottle: float = 0.02


def tiles(
    rng: np.random.Generator,
    colour: Field,
    grout: Field,
    *,
    tiling: Tiling = Tiling(),  # frozen
    size: int = 1024,
    vein: Field | None = None,
    palette: tuple[Field, ...] = (),
) -> Surface:
    """Glazed or stone tiles in a grid.

    Args:
        rng: source of randomness.
        colour: sRGB of the glaze.
        grout: sRGB of the joints.
        tiling: the grid.
        size: pixels of the square image.
        vein: colour of marble veins; each tile shows another piece of the slab.
        palette: further colours; each tile takes one at random (mosaic).
    """
    columns, rows, stagger = tiling.columns, tiling.rows, tiling.stagger
    if stagger and rows % 2:
        raise ValueError(f"running bond repeats only with an even number of rows, not {rows}")
    ids, lx, ly, edge = _grid(size, columns, rows, stagger)
    count = columns * rows
    shift = rng.random((count, 2)) * size
    px, py = lx + shift[ids, 0], ly + shift[ids, 1]
    if vein is not None:
        face = pick(marble_sheet(rng, (size, size), colour, vein), px, py)
    else:
        spots = spectral(rng, (size, size), 1.3, finest=4)
        base = colour
        if palette:
            choice = np.stack([colour, *palette])[rng.integers(0, len(palette) + 1, count)]
            base = choice[ids]
        face = base * (1 + tiling.mottle * pick(spots, px, py))[..., None]
    return _lay(rng, face, ids, edge, grout=grout, joint=tiling.joint, bevel=tiling.bevel, tone=tiling.tone)


def hexagons(
    rng: np.random.Generator,
    colours: tuple[Field, ...],
    grout: Field,
    *,
    size: int = 1024,
    columns: int = 12,
    joint: float = 3.0,
    tone: float = 0.03,
) -> Surface:
    """Hexagonal tiles; rows are squeezed by a per cent or two so that the pattern closes on a square."""
    rows = 2 * round(columns / np.sqrt(3))
    step = size / columns
    lattice = [((c + 0.5 * (r % 2)) * step, (r + 0.5) * size / rows) for r in range(rows) for c in range(columns)]
    ids, near, far = cells_of(np.array(lattice), (size, size))
    face = np.stack(colours)[rng.integers(0, len(colours), len(lattice))][ids]
    spots = spectral(rng, (size, size), 1.2, finest=4)
    face = face * (1 + 0.02 * spots)[..., None]
    return _lay(rng, face, ids, (far - near) / 2 * 1.1, grout=grout, joint=joint, bevel=3.0, tone=tone)


def cement(
    rng: np.random.Generator, colours: tuple[Field, Field, Field], *, size: int = 1024, columns: int = 8
) -> Surface:
    """Encaustic cement tiles: one motif with the symmetry of the square, from a few drawn shapes, slightly worn."""
    ids, lx, ly, edge = _grid(size, columns, columns, 0.0)
    cell = size / columns
    u, v = np.abs(2 * lx / cell - 1), np.abs(2 * ly / cell - 1)
    a, b = np.maximum(u, v), np.minimum(u, v)
    corner = np.hypot(1 - u, 1 - v)
    radius = np.hypot(u, v)
    angle = np.arctan2(b, a)
    petals = rng.choice([4, 8])
    bloom = radius - (rng.uniform(0.42, 0.5) + rng.uniform(0.14, 0.2) * np.cos(petals * angle))
    ring = np.abs(corner - rng.uniform(0.5, 0.6)) - rng.uniform(0.05, 0.09)
    heart = radius - rng.uniform(0.12, 0.2)
    star = a + b * rng.uniform(0.6, 1.0) - rng.uniform(0.34, 0.4)
    soft = 2.5 / cell

    def inside(distance: Field) -> Field:
        return 1 - smoothstep(-soft, soft, distance)

    face = np.broadcast_to(colours[0], (size, size, 3)).copy()
    face = mix(face, colours[1], inside(corner - rng.uniform(0.3, 0.4)))
    face = mix(face, colours[2], inside(ring))
    face = mix(face, colours[1], inside(bloom))
    face = mix(face, colours[0], inside(star))
    face = mix(face, colours[2], inside(heart))
    worn = spectral(rng, (size, size), 1.2, finest=3)
    face = face * (1 + 0.03 * worn)[..., None] + 0.02 * smoothstep(0.8, 2.0, worn)[..., None]
    return _lay(rng, face, ids, edge, grout=colours[0] * 0.8, joint=1.6, bevel=1.5, tone=0.025)


def terracotta(rng: np.random.Generator, colour: Field, grout: Field, *, size: int = 1024, columns: int = 8) -> Surface:
    """Hand-made floor tiles: strong differences of tone, cloudy faces, wide uneven joints."""
    ids, lx, ly, edge = _grid(size, columns, columns, 0.0)
    shift = rng.random((columns * columns, 2)) * size
    px, py = lx + shift[ids, 0], ly + shift[ids, 1]
    cloud = pick(spectral(rng, (size, size), 1.7, finest=10), px, py)
    grain = spectral(rng, (size, size), 0.4, finest=2)
    burnt = smoothstep(0.3, 2.2, pick(spectral(rng, (size, size), 1.7, finest=20), px, py))
    face = colour * (1 + 0.07 * cloud + 0.025 * grain)[..., None]
    face = mix(face, colour * np.array([0.72, 0.66, 0.66]), 0.5 * burnt)
    wobble = blur(spectral(rng, (size, size), 1.2, finest=12), 1.0) * 0.9
    return _lay(rng, face, ids, edge + wobble, grout=grout, joint=5.0, bevel=4.0, tone=0.07)
