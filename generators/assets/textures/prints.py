"""What is printed on paper and plastic: pages of text, keys of a keyboard, corrugated board."""

from __future__ import annotations

import numpy as np

from generators.assets.textures.noise import Field, Image, blur, spectral, to_image

_PAPER = np.array([0.90, 0.88, 0.83])


def page(rng: np.random.Generator, *, size: int = 256) -> Image:
    """A printed page (H = ``size``, W = 0.72 · size): headline, paragraphs with ragged ends, a figure."""
    height, width = size, int(0.72 * size)
    ink = np.zeros((height, width))
    margin, right = int(0.1 * width), int(0.9 * width)
    row = int(0.09 * height)
    ink[row : row + 7, margin : int(0.62 * width)] = 0.8
    row += 18
    figure = int(rng.integers(int(0.35 * height), int(0.6 * height)))
    while row < 0.92 * height:
        if figure <= row < figure + 0.16 * height:
            bottom = row + int(0.16 * height)
            ink[row:bottom, margin:right] = 0.35
            row, figure = bottom + 8, height
            continue
        last = rng.random() < 0.14
        end = margin + int((right - margin) * (rng.uniform(0.3, 0.8) if last else 1.0))
        at = margin
        while at < end:
            word = int(rng.integers(3, 14))
            ink[row : row + 2, at : min(at + word, end)] = rng.uniform(0.45, 0.75)
            at += word + 3
        row += 12 if last else 6
    tint = 1 + 0.006 * spectral(rng, (height, width), 1.4, finest=6)
    return to_image(_PAPER * (tint * (1 - 0.85 * blur(ink, 0.5)))[..., None])


def keyboard(rng: np.random.Generator, *, size: int = 256) -> Image:
    """The keys of a keyboard, 3 : 1: dark caps with light legends in six rows."""
    height, width = size // 3, size
    image = np.full((height, width, 3), 0.1)
    rows = 6
    for r in range(rows):
        y0, y1 = int(r * height / rows) + 1, int((r + 1) * height / rows) - 1
        at = 2.0 + 3.0 * float(rng.random())
        while at < width - 6:
            wide = 16.0 if rng.random() < 0.85 else float(rng.choice([24.0, 32.0]))
            if r == rows - 1 and 0.25 * width < at < 0.35 * width:
                wide = 0.4 * width
            x0, x1 = int(at), int(min(at + wide - 2, width - 2))
            image[y0:y1, x0:x1] = 0.2
            image[y0, x0:x1] = 0.27
            if wide < 20:
                image[y0 + 4 : y0 + 6, x0 + 4 : x0 + 7] = 0.6
            at += wide
    return to_image(image)


def cardboard(rng: np.random.Generator, colour: Field, *, size: int = 256) -> Image:
    """Corrugated board: flutes that show faintly through the paper, fibres and scuffs."""
    shape = (size, size)
    y = np.arange(size)[:, None] / size
    flutes = np.sin(2 * np.pi * 48 * y) * np.ones(shape)
    fibre = spectral(rng, shape, 0.5, finest=2)
    scuff = spectral(rng, shape, 1.5, finest=8)
    return to_image(colour * (1 + 0.015 * flutes + 0.03 * fibre + 0.025 * scuff)[..., None])
