"""Walls and solid surfaces: paint, wallpaper, brick, concrete, stone, terrazzo, metal, leather, soil, wicker.

Heights are in metres, and are meant for the sizes of `generators.assets.materials.TILES`.
"""

from __future__ import annotations

import numpy as np

from generators.assets.textures.maps import Surface
from generators.assets.textures.noise import (
    Field,
    blur,
    cells,
    grid,
    mix,
    relief,
    smoothstep,
    spectral,
    to_image,
)


def wall_paint(rng: np.random.Generator, colour: Field, *, size: int = 512, rough: float = 1.0) -> Surface:
    """Emulsion on plaster: the stipple of a roller under very faint clouds; ``rough`` 3 is lime plaster."""
    shape = (size, size)
    cloud = spectral(rng, shape, 1.7, finest=30)
    stipple = spectral(rng, shape, 0.7, finest=3, coarsest=30)
    trowel = spectral(rng, shape, 1.5, stretch=(1.0, 2.5), finest=6)
    shade = 1 + (0.004 + 0.002 * rough) * cloud + relief(stipple, 0.004 * rough) + 0.005 * (rough - 1) * trowel
    height = rough * 2.5e-4 * stipple + (rough - 1) * 3e-4 * trowel
    return Surface(to_image(colour * shade[..., None]), height)


def wallpaper(rng: np.random.Generator, base: Field, ink: Field, *, motif: str = "stripes", size: int = 512) -> Surface:
    """Wallpaper of 1.06 m (two widths); ``motif``: ``stripes``, ``trellis``, ``damask`` or ``sprigs``."""
    x, y = grid(size, size)
    soft = 1.5 / size
    if motif == "stripes":
        wave = np.abs((x * 8) % 1.0 - 0.5)
        amount = 1 - smoothstep(0.25 - soft * 8, 0.25 + soft * 8, wave)
        hair = np.exp(-(((wave - 0.31) / 0.012) ** 2))
        amount = 0.75 * amount + 0.6 * hair
    elif motif == "trellis":
        d = np.minimum(
            np.abs(np.sin(np.pi * (4 * x + 4 * y + 0.08 * np.sin(8 * np.pi * x)))),
            np.abs(np.sin(np.pi * (4 * x - 4 * y + 0.08 * np.sin(8 * np.pi * x)))),
        )
        amount = 1 - smoothstep(0.06, 0.13, d)
    elif motif == "damask":
        u, v = np.abs((x * 4) % 1 - 0.5), (y * 2 + 0.5 * (np.floor(x * 4) % 2)) % 1 - 0.5
        r, a = np.hypot(u * 1.5, v), np.arctan2(v, u)
        leaf = 0.30 + 0.10 * np.cos(6 * a) * np.cos(2 * a) + 0.03 * np.cos(14 * a)
        inner = np.abs(r - 0.6 * leaf) - 0.018
        amount = np.maximum(1 - smoothstep(-0.012, 0.012, r - leaf), 0) - 0.8 * (1 - smoothstep(-0.01, 0.01, inner))
    elif motif == "sprigs":
        # One sprig per cell of an 8 x 8 lattice, alternate rows shifted, each turned and moved a little.
        row = np.floor(y * 8).astype(np.int64)
        slide = (x * 8 + 0.5 * (row % 2)) % 8
        cell = row * 8 + np.floor(slide).astype(np.int64)
        turn, push = rng.uniform(-0.6, 0.6, 64)[cell], rng.uniform(-0.012, 0.012, 64)[cell]
        dx, dy = (slide % 1 - 0.5) / 8 - push, (y * 8 % 1 - 0.5) / 8
        p, q = dx * np.cos(turn) - dy * np.sin(turn), dx * np.sin(turn) + dy * np.cos(turn)
        amount = np.exp(-((p / 0.0016) ** 2)) * (np.abs(q) < 0.042)
        for side, at in ((-1, -0.018), (1, 0.002), (-1, 0.02), (1, -0.032)):
            r, s = p - side * 0.013, q - at
            leaf = np.hypot((r * 0.8 + s * 0.6 * side) / 0.005, (s * 0.8 - r * 0.6 * side) / 0.013)
            amount = np.maximum(amount, 1 - smoothstep(0.8, 1.2, leaf))
    else:
        raise ValueError(f"unknown wallpaper motif {motif!r}: expected stripes, trellis, damask or sprigs")
    paper = 1 + 0.008 * spectral(rng, (size, size), 0.8, finest=3, coarsest=60)
    amount = np.clip(amount, 0, 1)
    # The print is a tenth of a millimetre thick, and the paper is embossed.
    return Surface(to_image(mix(base, ink, amount) * paper[..., None]), 1e-4 * amount + 5e-3 * (paper - 1))


def brick(rng: np.random.Generator, colour: Field, mortar: Field, *, size: int = 1024) -> Surface:
    """A brick wall of 2 m: 8 × 28 stretchers in running bond, each with its own tone."""
    rows, columns = 28, 8
    y, x = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5, indexing="ij")
    wobble = 1.2 * spectral(rng, (size, size), 1.4, finest=8)
    row = np.floor(y / size * rows).astype(np.int64)
    slide = (x + (row % 2) * size / columns / 2) % size
    column = np.floor(slide / size * columns).astype(np.int64)
    lx, ly = slide - column * size / columns, y - row * size / rows
    edge = np.minimum(np.minimum(lx, size / columns - lx), np.minimum(ly, size / rows - ly)) + wobble
    count = rows * columns
    tones = 1 + 0.12 * rng.standard_normal((count, 1)) + 0.03 * rng.standard_normal((count, 3))
    fire = spectral(rng, (size, size), 1.1, finest=3)
    height = smoothstep(1.5, 6.0, edge)
    face = colour * tones[row * columns + column] * (1 + 0.07 * fire - relief(height, 0.16))[..., None]
    sand = mortar * (1 + 0.06 * spectral(rng, (size, size), 0.6, finest=2))[..., None]
    relief_depth = 0.008 * height + 6e-4 * fire
    return Surface(to_image(mix(sand, face, smoothstep(2.6, 4.4, edge))), relief_depth)


def concrete(rng: np.random.Generator, colour: Field, *, size: int = 1024) -> Surface:
    """Polished screed or cast concrete: clouds, trowel marks, pinholes."""
    shape = (size, size)
    cloud = spectral(rng, shape, 1.6, finest=4)
    sweep = spectral(rng, shape, 1.4, stretch=(1.0, 3.0), finest=8)
    grit = spectral(rng, shape, 0.3, finest=2)
    holes = blur((rng.random(shape) > 0.9995).astype(np.float64), 1.1)
    holes = np.clip(holes / 0.12, 0, 1)
    shade = 1 + 0.035 * cloud + 0.022 * sweep + 0.012 * grit - 0.25 * holes
    height = 2e-4 * sweep + 4e-5 * grit - 8e-4 * holes
    matte = 0.12 * smoothstep(-0.5, 2.0, cloud) + 0.5 * holes
    return Surface(to_image(colour * shade[..., None]), height, matte=matte)


def terrazzo(rng: np.random.Generator, base: Field, chips: tuple[Field, ...], *, size: int = 1024) -> Surface:
    """Chips of several sizes in a cement matrix."""
    shape = (size, size)
    out = base * (1 + 0.02 * spectral(rng, shape, 1.2, finest=3))[..., None]
    cement = np.ones(shape)
    for count, keep in ((5000, 0.4), (1400, 0.32), (400, 0.22)):
        ids, edge = cells(rng, shape, count)
        radius = np.sqrt(size * size / count)
        chosen = rng.random(count) < keep
        size_of = rng.uniform(0.05, 0.2, count) * radius
        mask = smoothstep(0.0, 1.5, 2 * edge - size_of[ids]) * chosen[ids]
        colour = np.stack(chips)[rng.integers(0, len(chips), count)] * (1 + 0.06 * rng.standard_normal((count, 1)))
        out = mix(out, colour[ids], mask)
        cement *= 1 - mask
    # Polishing takes more of the cement than of the chips, and leaves it duller.
    return Surface(to_image(out), -5e-5 * cement, matte=0.15 * cement)


def granite(rng: np.random.Generator, colours: tuple[Field, Field, Field], *, size: int = 512) -> Surface:
    """Crystals of three minerals, clustered at two scales."""
    shape = (size, size)
    out = np.broadcast_to(colours[0], (*shape, 3)).copy()
    drift = spectral(rng, shape, 1.3, finest=12)
    for colour, count, cut in ((colours[1], 9000, 0.1), (colours[2], 5000, 0.55), (colours[1] * 1.15, 16000, 0.9)):
        ids, _ = cells(rng, shape, count)
        amount = (rng.standard_normal(count)[ids] + 0.5 * drift > cut).astype(np.float64)
        out = mix(out, colour, blur(amount, 0.6))
    return Surface(to_image(out * (1 + 0.02 * spectral(rng, shape, 0.3, finest=2))[..., None]))


def brushed(rng: np.random.Generator, colour: Field, *, size: int = 512) -> Surface:
    """Brushed metal: hair-fine streaks along the columns under a slow sheen."""
    shape = (size, size)
    hair = spectral(rng, shape, 0.2, stretch=(1.0, 120.0), finest=1.5)
    sheen = spectral(rng, shape, 1.6, stretch=(1.0, 6.0), finest=30)
    # Slopes across the streaks stretch highlights, which is what tells brushed metal from polished.
    height = 3e-5 * hair
    return Surface(to_image(colour * (1 + 0.022 * hair + 0.025 * sheen)[..., None]), height, matte=_smudge(sheen))


def leather(rng: np.random.Generator, colour: Field, *, size: int = 512) -> Surface:
    """Pebbled hide with worn clouds."""
    shape = (size, size)
    _, edge = cells(rng, shape, 9000)
    crease = 1 - smoothstep(0.0, 1.2, edge)
    height = blur(smoothstep(0.0, 2.0, edge), 0.7)
    worn = spectral(rng, shape, 1.7, finest=12)
    shade = 1 + 0.06 * worn - 0.16 * crease - relief(height, 0.05)
    return Surface(to_image(colour * shade[..., None]), 3e-4 * height, matte=0.4 * crease)


def soil(rng: np.random.Generator, colour: Field, *, size: int = 256) -> Surface:
    """Potting soil: crumbs of every tone."""
    ids, edge = cells(rng, (size, size), 2600)
    tone = rng.uniform(0.55, 1.5, 2600)[ids]
    crumb = smoothstep(0, 1.5, edge)
    return Surface(to_image(colour * (tone * (0.6 + 0.4 * crumb))[..., None]), 1e-3 * tone * crumb)


def wicker(rng: np.random.Generator, colour: Field, *, size: int = 512, strands: int = 24) -> Surface:
    """Basket weave: strands across over and under stakes."""
    x, y = grid(size, size)
    stakes = strands // 2
    row = np.floor(y * strands)
    over = np.cos(np.pi * (x * stakes * 2 / 1.0 + row))
    local = (y * strands) % 1.0 - 0.5
    roundness = np.sqrt(np.clip(1 - (2 * local) ** 2, 0, 1))
    shade = 0.45 + 0.38 * roundness + 0.2 * over * roundness
    tone = 1 + 0.07 * rng.standard_normal(strands)[row.astype(np.int64) % strands]
    fibre = 1 + 0.05 * spectral(rng, (size, size), 0.5, stretch=(1.0, 14.0), finest=2)
    height = roundness * (0.003 + 0.0015 * over)
    return Surface(to_image(colour * (shade * tone * fibre)[..., None]), height)


def _smudge(noise: Field) -> Field:
    """`Surface.matte` (H, W) of a polished surface that hands have touched and wiped; ``noise`` has unit variance."""
    return 0.10 * smoothstep(0.0, 2.5, noise)


def smudges(rng: np.random.Generator, *, size: int = 256) -> Field:
    """`Surface.matte` (H, W) of glass and enamel: wiped streaks and a few touched places."""
    wiped = spectral(rng, (size, size), 1.3, stretch=(1.0, 3.0), finest=4)
    touched = spectral(rng, (size, size), 1.6, finest=6)
    return 0.03 * smoothstep(0.0, 2.5, wiped) + 0.05 * smoothstep(1.2, 2.6, touched)
