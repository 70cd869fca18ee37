"""Textiles: weaves, knit, bouclé, velvet, terry, carpet pile, patterned cushions and whole rugs.

Heights are in metres, and are meant for half a metre per repeat.
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


def weave(
    rng: np.random.Generator, colour: Field, *, second: Field | None = None, size: int = 512, slub: float = 1.0
) -> Surface:
    """Plain weave: warp and weft with their own slubs; ``second`` is the weft's colour (melange)."""
    shape = (size, size)
    y, x = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    warp = spectral(rng, shape, 0.5, stretch=(40.0, 1.0), finest=2)
    weft = spectral(rng, shape, 0.5, stretch=(1.0, 40.0), finest=2)
    cloud = spectral(rng, shape, 1.5, finest=16)
    # A whole number of yarns, about six pixels each, so that the weave closes at the seam.
    crimp = np.sin(2 * np.pi * np.round(size / 6) * x / size) * np.sin(2 * np.pi * np.round(size / 6) * y / size)
    shade = 1 + slub * (0.03 * warp + 0.03 * weft) + 0.03 * crimp + 0.012 * cloud
    other = colour if second is None else second
    lean = np.clip(0.5 + 0.22 * crimp + 0.12 * (warp - weft), 0, 1)
    return Surface(to_image(mix(colour, other, lean) * shade[..., None]), 2e-4 * crimp + slub * 6e-5 * (warp + weft))


def boucle(rng: np.random.Generator, colour: Field, *, size: int = 512) -> Surface:
    """Looped yarn: small round curls, light on top and dark between."""
    shape = (size, size)
    _, edge = cells(rng, shape, 4200)
    bump = blur(smoothstep(0.0, 3.0, edge), 0.8)
    swirl = spectral(rng, shape, 0.6, finest=3, coarsest=30)
    shade = 0.86 + 0.16 * bump + 0.025 * swirl - relief(bump, 0.06)
    return Surface(to_image(colour * shade[..., None]), 1.5e-3 * bump + 2e-4 * swirl)


def velvet(rng: np.random.Generator, colour: Field, *, size: int = 512) -> Surface:
    """Short pile: brushed light and dark clouds."""
    shape = (size, size)
    brushed = spectral(rng, shape, 1.7, finest=14, stretch=(1.6, 1.0))
    nap = spectral(rng, shape, 0.4, finest=2)
    return Surface(to_image(colour * (1 + 0.055 * brushed + 0.02 * nap)[..., None]), 5e-4 * brushed + 8e-5 * nap)


def knit(rng: np.random.Generator, colour: Field, *, size: int = 512, stitches: int = 40) -> Surface:
    """Stocking stitch: columns of V-shaped loops."""
    x, y = grid(size, size)
    u = (x * stitches) % 1.0 - 0.5
    v = (y * stitches * 1.0 + 1.1 * np.abs(u)) % 1.0
    strand = np.abs(v - 0.5) * 2
    valley = np.exp(-((u / 0.09) ** 2)) + np.exp(-(((np.abs(u) - 0.5) / 0.07) ** 2))
    height = np.sqrt(np.clip(1 - strand**2, 0, 1)) * (1 - 0.5 * np.clip(valley, 0, 1))
    fluff = spectral(rng, (size, size), 0.5, finest=2)
    return Surface(to_image(colour * (0.72 + 0.34 * height + 0.025 * fluff)[..., None]), 2e-3 * height + 8e-5 * fluff)


def terry(rng: np.random.Generator, colour: Field, *, size: int = 512) -> Surface:
    """Towelling: loops in loose rows."""
    shape = (size, size)
    loops = spectral(rng, shape, 0.2, finest=3.5, coarsest=14)
    cloud = spectral(rng, shape, 1.4, finest=10)
    return Surface(to_image(colour * (1 + relief(loops, 0.035) + 0.02 * loops + 0.02 * cloud)[..., None]), 5e-4 * loops)


def carpet(rng: np.random.Generator, colour: Field, *, size: int = 512) -> Surface:
    """Cut pile in several shades of one yarn."""
    shape = (size, size)
    tufts = spectral(rng, shape, 0.2, finest=3, coarsest=20)
    tread = spectral(rng, shape, 1.6, finest=20)
    shade = 1 + 0.06 * tufts + relief(tufts, 0.03) + 0.03 * tread
    return Surface(to_image(colour * shade[..., None]), 6e-4 * tufts)


def curtain(rng: np.random.Generator, colour: Field, *, size: int = 512) -> Surface:
    """Linen voile: long vertical and horizontal slubs."""
    shape = (size, size)
    warp = spectral(rng, shape, 0.4, stretch=(30.0, 1.0), finest=2)
    weft = spectral(rng, shape, 0.4, stretch=(1.0, 30.0), finest=2)
    return Surface(to_image(colour * (1 + 0.03 * warp + 0.022 * weft)[..., None]), 6e-5 * (warp + weft))


def printed(rng: np.random.Generator, base: Field, ink: Field, *, motif: str = "stripes", size: int = 512) -> Surface:
    """A cushion or bed cover; ``motif``: ``stripes``, ``checks``, ``zigzag`` or ``dots``."""
    x, y = grid(size, size)
    if motif == "stripes":
        wave = (y * 10) % 1.0
        amount = (
            smoothstep(0.0, 0.03, wave) - smoothstep(0.42, 0.45, wave) + 0.7 * np.exp(-(((wave - 0.72) / 0.05) ** 2))
        )
    elif motif == "checks":
        bar_x = (np.abs((x * 6) % 1.0 - 0.5) < 0.25).astype(np.float64)
        bar_y = (np.abs((y * 6) % 1.0 - 0.5) < 0.25).astype(np.float64)
        amount = 0.5 * (bar_x + bar_y)
    elif motif == "zigzag":
        wave = (y * 10 + np.abs((x * 10) % 1.0 - 0.5) * 1.2) % 1.0
        amount = (np.abs(wave - 0.5) < 0.25).astype(np.float64)
    elif motif == "dots":
        shift = 0.5 * (np.floor(y * 12) % 2)
        d = np.hypot((x * 12 + shift) % 1.0 - 0.5, (y * 12) % 1.0 - 0.5)
        amount = 1 - smoothstep(0.2, 0.25, d)
    else:
        raise ValueError(f"unknown print {motif!r}: expected stripes, checks, zigzag or dots")
    shape = (size, size)
    threads = 1 + 0.02 * spectral(rng, shape, 0.5, stretch=(30.0, 1.0), finest=2)
    threads += 0.02 * spectral(rng, shape, 0.5, stretch=(1.0, 30.0), finest=2)
    pixels = to_image(mix(base, ink, np.clip(blur(amount, 0.7), 0, 1)) * threads[..., None])
    return Surface(pixels, 3e-3 * (threads - 1))


def _pile(rng: np.random.Generator, colour: Field) -> Surface:
    shape = (colour.shape[0], colour.shape[1])
    tufts = spectral(rng, shape, 0.2, finest=2.5, coarsest=16)
    # Abrash: the dye lots of hand-knotted rugs change from row to row.
    abrash = spectral(rng, shape, 1.2, stretch=(1.0, 12.0), finest=8)
    tread = spectral(rng, shape, 1.6, finest=30)
    shade = 1 + 0.045 * tufts + relief(tufts, 0.02) + 0.03 * abrash + 0.03 * tread
    # A rug is some two metres high: a tuft has a few millimetres.
    return Surface(to_image(colour * shade[..., None]), 1e-3 * tufts)


def _border(x: Field, y: Field, aspect: float) -> Field:
    """Distance to the rug's rim in units of its height (x runs along the longer side)."""
    return np.minimum(np.minimum(x, 1 - x) * aspect, np.minimum(y, 1 - y))


def rug(rng: np.random.Generator, colours: tuple[Field, ...], *, pattern: str, size: int = 512) -> Surface:
    """A whole rug, 3 : 2 (H = ``size``, W = 1.5 · size), not repeating.

    ``pattern``: ``berber`` (diamonds), ``bands``, ``oriental`` (border and medallion), ``arcs`` (mid-century),
    ``plain`` (with a bound edge) or ``worn`` (a faded vintage piece). ``colours``: ground first, at least three.
    """
    width = size * 3 // 2
    x, y = grid(size, width)
    aspect = 1.5
    ground, one = colours[0], colours[1]
    out = np.broadcast_to(ground, (size, width, 3)).copy()
    shape = (size, width)
    sway = 0.006 * spectral(rng, shape, 1.6, finest=20)
    rim = _border(x, y, aspect)
    if pattern == "berber":
        n = int(rng.integers(4, 6))
        for tilt in (1.0, -1.0):
            phase = (x * aspect * n * 0.62 + tilt * y * n * 0.5 + sway * n) % 1.0
            out = mix(out, one, np.exp(-(((phase - 0.5) / 0.028) ** 4)))
    elif pattern == "bands":
        at = 0.0
        while at < 1.0:
            wide = rng.uniform(0.03, 0.13)
            band = colours[int(rng.integers(0, len(colours)))]
            inside = smoothstep(at - 0.003, at + 0.003, x + sway) - smoothstep(
                at + wide - 0.003, at + wide + 0.003, x + sway
            )
            out = mix(out, band, inside * rng.uniform(0.55, 1.0))
            at += wide
    elif pattern in ("oriental", "worn"):
        out = _oriental(rng, out, colours, x, y, rim)
        if pattern == "worn":
            fade = smoothstep(-0.8, 1.6, spectral(rng, shape, 1.3, finest=5))
            out = mix(out, np.clip(ground * 0.5 + 0.42, 0, 1), 0.35 + 0.55 * fade)
    elif pattern == "arcs":
        for _ in range(7):
            cx, cy, radius = (
                rng.uniform(-0.1, 1.6),
                float(rng.choice([0.0, 1.0])) + rng.uniform(-0.15, 0.15),
                rng.uniform(0.25, 0.6),
            )
            colour = colours[int(rng.integers(1, len(colours)))]
            d = np.hypot(x * aspect - cx, y - cy) + sway
            out = mix(out, colour, 1 - smoothstep(radius - 0.003, radius + 0.003, d))
            if rng.random() < 0.6:
                out = mix(out, ground, np.exp(-(((d - radius * 0.72) / 0.008) ** 4)))
    elif pattern == "plain":
        out = mix(out, one, (rim < 0.025).astype(np.float64))
        ribs = np.sin(2 * np.pi * y * 90)
        out = out * (1 + 0.02 * ribs)[..., None]
    else:
        raise ValueError(f"unknown rug {pattern!r}: expected berber, bands, oriental, worn, arcs or plain")
    return _pile(rng, np.clip(out, 0, 1))


def _oriental(
    rng: np.random.Generator, out: Field, colours: tuple[Field, ...], x: Field, y: Field, rim: Field
) -> Field:
    """Draw a border and a medallion over a rug; ``rim``: distance to its edge in units of its height."""
    shape, aspect = rim.shape, 1.5
    ground, one, two = colours[0], colours[1], colours[2]
    for start, stop, colour in ((0.015, 0.03, two), (0.03, 0.13, one), (0.13, 0.145, two)):
        out = mix(out, colour, ((rim > start) & (rim < stop)).astype(np.float64))
    petals = np.cos(x * aspect * 2 * np.pi * 10) * np.cos(y * 2 * np.pi * 10)
    in_border = (rim > 0.035) & (rim < 0.125)
    out = mix(out, ground, in_border * smoothstep(0.25, 0.45, petals))
    out = mix(out, two, in_border * smoothstep(0.6, 0.75, -petals))
    u, v = np.abs(x - 0.5) * aspect, np.abs(y - 0.5)
    field = rim > 0.15
    folded = spectral(rng, shape, 1.1, finest=9, coarsest=90)
    floral = (folded + folded[::-1] + folded[:, ::-1] + folded[::-1, ::-1]) / 2
    out = mix(out, one, field * 0.85 * smoothstep(0.5, 0.75, floral))
    out = mix(out, two, field * 0.9 * smoothstep(0.9, 1.1, -floral))
    r, a = np.hypot(u * 0.75, v), np.arctan2(v, u * 0.75)
    medallion = 0.24 + 0.025 * np.cos(16 * a) + 0.03 * np.cos(4 * a)
    for scale, colour in ((1.0, two), (0.93, one), (0.6, ground), (0.52, two), (0.25, one)):
        out = mix(out, colour, 1 - smoothstep(-0.004, 0.004, r - medallion * scale))
    return out
