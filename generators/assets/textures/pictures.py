"""Images that do not repeat: pictures for frames, book spines, leaves, appliance fronts."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from generators.assets.textures.noise import (
    Field,
    Image,
    grid,
    hex_colour,
    mix,
    shift_colour,
    smoothstep,
    spectral,
    to_image,
)

#: Spines per row and rows of `book_spines`.
SPINES = (12, 4)


def _paper(rng: np.random.Generator, shape: tuple[int, int], colour: Field) -> Field:
    return colour * (1 + 0.012 * spectral(rng, shape, 0.8, finest=2))[..., None]


#: Colour of unpainted paper.
PAPER = hex_colour("#efe9dd")


def _horizon(rng: np.random.Generator, out: Field, colours: tuple[Field, ...], canvas: Field) -> Field:
    """A sea below a cloudy sky."""
    shape = out.shape[:2]
    _, y = grid(*shape)
    line = rng.uniform(0.5, 0.68)
    sky = mix(shift_colour(colours[0], value=0.3, saturation=-0.5), colours[1] * 0.3 + 0.68, np.clip(y / line, 0, 1))
    cloud = smoothstep(0.2, 1.8, spectral(rng, shape, 1.7, stretch=(1.0, 3.0), finest=8))
    out = mix(sky, np.array([0.97, 0.95, 0.92]), 0.7 * cloud * (y < line))
    sea = mix(colours[0] * 0.8, colours[2] * 0.6, np.clip((y - line) / (1 - line), 0, 1))
    glint = smoothstep(0.6, 2.2, spectral(rng, shape, 0.9, stretch=(1.0, 9.0), finest=2))
    sea = mix(sea, np.array([0.95, 0.93, 0.88]), 0.5 * glint)
    return mix(out, sea, smoothstep(line - 0.003, line + 0.003, y + 0.002 * canvas))


def _blocks(rng: np.random.Generator, out: Field, colours: tuple[Field, ...], canvas: Field) -> Field:
    """Rectangles over one another."""
    shape = out.shape[:2]
    x, y = grid(*shape)
    for _ in range(9):
        cx, cy, w, h = rng.uniform(0.1, 0.9, 2).tolist() + rng.uniform(0.08, 0.3, 2).tolist()
        d = np.maximum(np.abs(x - cx) - w, np.abs(y - cy) - h) + 0.004 * spectral(rng, shape, 1.5, finest=4)
        tint = colours[int(rng.integers(0, len(colours)))]
        out = mix(out, tint, 0.88 * (1 - smoothstep(-0.004, 0.004, d)))
    return out


def _discs(rng: np.random.Generator, out: Field, colours: tuple[Field, ...], canvas: Field) -> Field:
    """Discs and two curved lines."""
    x, y = grid(*out.shape[:2])
    for k in range(4):
        cx, cy, r = rng.uniform(0.25, 0.75), rng.uniform(0.2, 0.8), rng.uniform(0.1, 0.26)
        d = np.hypot(x - cx, y - cy) - r
        out = mix(out, colours[k % len(colours)], 0.9 * (1 - smoothstep(-0.003, 0.003, d)))
    for _ in range(2):
        a, b = rng.uniform(0.2, 0.8), rng.uniform(0.1, 0.3)
        out = mix(out, np.full(3, 0.12), np.exp(-(((np.abs(y - a - b * np.sin(2.2 * x + a * 6))) / 0.004) ** 4)))
    return out


def _botanical(rng: np.random.Generator, out: Field, colours: tuple[Field, ...], canvas: Field) -> Field:
    """A stalk with leaves."""
    size = out.shape[0]
    image = (out * 255).astype(np.uint8)
    tint = colours[0] * 0.75
    ink = tuple(float(c) for c in tint * 255)
    base, tip = np.array([0.5, 0.93]) * size, np.array([0.5 + rng.uniform(-0.1, 0.1), 0.12]) * size
    bend = np.array([rng.uniform(-0.08, 0.08) * size, 0])
    for k in range(11):
        t = 0.12 + 0.84 * k / 10
        p = (1 - t) * base + t * tip + 4 * t * (1 - t) * bend
        length, side = size * 0.19 * (1.15 - t * 0.75), 1 if k % 2 else -1
        angle = np.degrees(np.arctan2(-0.75, side * 0.85)) + rng.uniform(-8, 8)
        if k == 10:
            angle = -90.0
        mid = p + 0.55 * length * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        shade = tuple(float(c) for c in np.clip(tint * rng.uniform(0.8, 1.35) * 255, 0, 255))
        cv2.ellipse(
            image,
            (int(mid[0]), int(mid[1])),
            (int(length * 0.55), int(length * 0.19)),
            angle,
            0,
            360,
            shade,
            -1,
            cv2.LINE_AA,
        )
    stalk = np.array([(1 - t) * base + t * tip + 4 * t * (1 - t) * bend for t in np.linspace(0, 1, 24)])
    cv2.polylines(image, [stalk.astype(np.int32)], False, ink, 3, cv2.LINE_AA)
    return image / 255.0


def _strokes(rng: np.random.Generator, out: Field, colours: tuple[Field, ...], canvas: Field) -> Field:
    """Broad strokes of a brush."""
    shape = out.shape[:2]
    x, y = grid(*shape)
    for _ in range(16):
        tint = colours[int(rng.integers(0, len(colours)))]
        cy, tilt, thick = rng.uniform(0.1, 0.9), rng.uniform(-0.4, 0.4), rng.uniform(0.02, 0.08)
        left, right = rng.uniform(-0.1, 0.4), rng.uniform(0.5, 1.1)
        bristle = spectral(rng, shape, 0.8, stretch=(1.0, 25.0), finest=2)
        d = np.abs(y - cy - tilt * (x - 0.5) - 0.05 * np.sin(5 * x + cy * 9)) / thick
        mask = (
            smoothstep(0, 0.06, x - left)
            * smoothstep(0, 0.06, right - x)
            * (1 - smoothstep(0.7, 1.0, d + 0.12 * bristle))
        )
        out = mix(out, tint * (1 + 0.06 * bristle)[..., None], 0.92 * mask)
    return out


def _hills(rng: np.random.Generator, out: Field, colours: tuple[Field, ...], canvas: Field) -> Field:
    """A sun above rows of hills."""
    shape = out.shape[:2]
    x, y = grid(*shape)
    far = mix(PAPER, shift_colour(colours[1], value=0.3, saturation=-0.4), np.clip(1 - y, 0, 1))
    sun = np.hypot(x - rng.uniform(0.3, 0.7), y - rng.uniform(0.2, 0.32))
    out = mix(far, colours[3 % len(colours)], 1 - smoothstep(0.085, 0.09, sun))
    for k in range(5):
        top = 0.38 + 0.13 * k
        ridge = top + sum(
            rng.uniform(0.01, 0.05) / f * np.sin(2 * np.pi * (f * x + rng.random())) for f in (1, 2, 3, 5)
        )
        tint = mix(np.broadcast_to(PAPER, (*shape, 3)), colours[k % 2], np.full(shape, 0.25 + 0.18 * k))
        out = mix(out, tint, smoothstep(-0.003, 0.003, y - ridge))
    return out


#: Motif → what draws it on paper (H, W, 3); the last argument is the weave of the canvas (H, W).
_MOTIFS: dict[str, Callable[[np.random.Generator, Field, tuple[Field, ...], Field], Field]] = {
    "horizon": _horizon,
    "blocks": _blocks,
    "discs": _discs,
    "botanical": _botanical,
    "strokes": _strokes,
    "hills": _hills,
}
PAINTINGS = tuple(_MOTIFS)


def painting(rng: np.random.Generator, colours: tuple[Field, ...], *, motif: str, size: int = 512) -> Image:
    """A square picture in the given colours (at least four); see `PAINTINGS`.

    Raises:
        ValueError: if there is no such motif.
    """
    if motif not in _MOTIFS:
        raise ValueError(f"unknown picture {motif!r}: expected one of {', '.join(PAINTINGS)}")
    paper = _paper(rng, (size, size), PAPER)
    canvas = spectral(rng, (size, size), 0.3, finest=2)
    out = _MOTIFS[motif](rng, paper, colours, canvas)
    return to_image(np.clip(out * (1 + 0.012 * canvas)[..., None], 0, 1))


def book_spines(rng: np.random.Generator, colours: tuple[Field, ...], *, size: int = 768) -> Image:
    """An atlas of `SPINES` columns × rows of spines, upright, with bands, titles and publisher's marks."""
    columns, rows = SPINES
    w, h = size // columns, size // rows
    image = np.zeros((h * rows, w * columns, 3))
    for k in range(columns * rows):
        r, c = divmod(k, columns)
        base = shift_colour(
            colours[int(rng.integers(0, len(colours)))],
            value=rng.uniform(-0.2, 0.15),
            saturation=rng.uniform(-0.3, 0.2),
        )
        bright = float(base.mean()) > 0.5
        ink = np.full(3, 0.12) if bright else np.array([0.9, 0.86, 0.74])
        spine = np.broadcast_to(base, (h, w, 3)).copy()
        spine *= (1 + 0.03 * spectral(rng, (h, w), 0.6, finest=2))[..., None]
        style = int(rng.integers(0, 4))
        if style == 0:
            for at in (0.08, 0.11, 0.86, 0.89):
                spine[int(at * h) : int(at * h) + 2, 3:-3] = ink
        elif style == 1:
            label = colours[int(rng.integers(0, len(colours)))]
            spine[int(0.1 * h) : int(0.34 * h)] = label * 0.9
        elif style == 2:
            spine[int(0.8 * h) :] = base * 0.7
        # A title from top to bottom: a row of strokes of different length, which looks like lettering from a distance.
        at, stop = int(rng.uniform(0.14, 0.2) * h), int(rng.uniform(0.55, 0.78) * h)
        thick = int(rng.integers(w // 5, w // 3))
        while at < stop:
            letter = int(rng.integers(3, 7))
            left = w // 2 - thick // 2
            spine[at : at + letter - 1, left + int(rng.integers(0, 3)) : left + thick - int(rng.integers(0, 3))] = ink
            at += letter + (5 if rng.random() < 0.2 else 1)
        spine[int(0.92 * h) : int(0.92 * h) + 5, w // 2 - 4 : w // 2 + 4] = ink
        lateral = np.linspace(-1, 1, w)
        spine *= (1 - 0.28 * np.abs(lateral) ** 4)[None, :, None]
        image[r * h : (r + 1) * h, c * w : (c + 1) * w] = spine
    return to_image(image)


def leaf(rng: np.random.Generator, colour: Field, *, size: int = 256) -> Image:
    """A leaf's face: midrib along the columns (u), side veins, paler towards the rim."""
    x, y = grid(size, size)
    off = np.abs(y - 0.5)
    midrib = np.exp(-((off / 0.012) ** 2))
    vein = np.abs(((x * 9 - off * 5) % 1.0) - 0.5)
    veins = np.exp(-((vein / 0.07) ** 2)) * smoothstep(0.0, 0.05, off)
    mottle = spectral(rng, (size, size), 1.4, finest=4)
    out = colour * (1 + 0.06 * mottle + 0.10 * (1 - 2 * off))[..., None]
    pale = np.clip(colour * 1.35 + 0.06, 0, 1)
    return to_image(mix(mix(out, pale, 0.22 * veins), pale, 0.6 * midrib))


def hob(rng: np.random.Generator, *, size: int = 512) -> Image:
    """A glass-ceramic hob from above: four zones, touch keys at the front (bottom)."""
    x, y = grid(size, size)
    out = np.full((size, size, 3), 0.20) * (1 + 0.02 * spectral(rng, (size, size), 1.0, finest=3))[..., None]
    for cx, cy, r in ((0.27, 0.28, 0.15), (0.73, 0.28, 0.19), (0.27, 0.66, 0.19), (0.73, 0.66, 0.15)):
        d = np.hypot(x - cx, y - cy)
        out = mix(out, np.full(3, 0.42), np.exp(-(((d - r) / 0.005) ** 2)))
        out = mix(out, np.full(3, 0.30), np.exp(-(((d - r * 0.55) / 0.004) ** 2)))
        cross = np.minimum(np.abs(x - cx), np.abs(y - cy)) < 0.003
        out = mix(out, np.full(3, 0.4), (cross & (d < 0.02)).astype(np.float64))
    for k in range(7):
        d = np.hypot(x - (0.26 + 0.08 * k), y - 0.93)
        out = mix(out, np.full(3, 0.62), np.exp(-(((d - 0.014) / 0.003) ** 2)))
    return to_image(np.clip(out, 0, 1))


def oven_panel(rng: np.random.Generator, base: Field, *, size: int = 512) -> Image:
    """An oven's control strip (4 : 1): a display with digits between two groups of symbols."""
    height, width = size // 4, size
    out = base * (1 + 0.015 * spectral(rng, (height, width), 0.3, stretch=(1.0, 60.0), finest=2))[..., None]
    image = np.ascontiguousarray(to_image(out))
    h, w = height, width
    cv2.rectangle(image, (int(0.36 * w), int(0.28 * h)), (int(0.64 * w), int(0.72 * h)), (12, 14, 16), -1)
    text = f"{int(rng.integers(7, 22)):02d}:{int(rng.integers(0, 60)):02d}"
    cv2.putText(
        image, text, (int(0.425 * w), int(0.6 * h)), cv2.FONT_HERSHEY_SIMPLEX, 1.0, (235, 120, 40), 3, cv2.LINE_AA
    )
    return image


def tv_screen(rng: np.random.Generator, *, size: int = 256) -> Image:
    """A television that is off: nearly black with a faint reflection of a window."""
    x, y = grid(size, size)
    ghost = 1 - smoothstep(0.05, 0.3, np.maximum(np.abs(x - 0.7) / 1.2, np.abs(y - 0.4)))
    out = np.array([0.19, 0.20, 0.215]) * (1 + 0.25 * ghost)[..., None]
    return to_image(out * (1 + 0.02 * spectral(rng, (size, size), 1.0, finest=4))[..., None])
