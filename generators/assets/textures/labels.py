"""A sheet of printed labels, cartons and notes without brands, for small things: one texture for all of them."""

from __future__ import annotations

import cv2
import numpy as np

from generators.assets.textures.noise import Field, Image, hex_colour, to_image

#: Columns and rows of the sheet: two rows of labels, one of cartons, one of written or printed papers.
LABEL_COLUMNS, LABEL_ROWS = 4, 4
#: Grounds of labels and cartons, and their inks.
_GROUNDS = (
    "#e8e3d6",
    "#d9a441",
    "#a63c32",
    "#2f5d50",
    "#3d5a80",
    "#e6e6e2",
    "#c9b79c",
    "#56423a",
    "#7d9d6a",
    "#d7c4c9",
)
_INKS = ("#2b2b2b", "#f1ede2", "#7a2e2a", "#23415c")
_PAPERS = ("#efece2", "#f3e79b", "#e9e9ea", "#dfe8d8")
#: Width of the rim of a cell that is plain, as a share of it: look-ups of a neighbour's texels show only ground.
_RIM = 0.06


def _writing(cell: Field, rng: np.random.Generator, box: tuple[int, int, int, int], ink: Field, rows: int) -> None:
    """Lines of words, each a dark bar, inside ``box`` (left, top, right, bottom; texels)."""
    left, top, right, bottom = box
    pitch = max(3.0, (bottom - top) / rows)
    for k in range(rows):
        y = int(top + k * pitch)
        x = left
        stop = right - int(rng.integers(0, max(1, (right - left) // 3)))
        while x < stop:
            end = min(x + int(rng.integers(3, 10)), stop)
            cell[y : y + max(1, int(pitch * 0.45)), x:end] = ink
            x = end + 2


def _label(cell: Field, rng: np.random.Generator, ground: Field) -> None:
    """A band of colour with a title, an emblem, and small print."""
    size = len(cell)
    ink = hex_colour(_INKS[int(rng.integers(len(_INKS)))])
    if abs(ink.mean() - ground.mean()) < 0.25:
        ink = 1 - 0.9 * ground
    band = hex_colour(_GROUNDS[int(rng.integers(len(_GROUNDS)))])
    top = int(size * rng.uniform(0.1, 0.3))
    cell[top : top + int(size * rng.uniform(0.2, 0.4)), :] = band
    middle = (size // 2, int(size * rng.uniform(0.35, 0.5)))
    axes = (int(size * rng.uniform(0.12, 0.24)), int(size * rng.uniform(0.1, 0.2)))
    emblem = hex_colour(_GROUNDS[int(rng.integers(len(_GROUNDS)))])
    cv2.ellipse(cell, middle, axes, float(rng.uniform(-20, 20)), 0, 360, emblem.tolist(), -1, cv2.LINE_AA)
    cv2.ellipse(cell, middle, axes, 0, 0, 360, ink.tolist(), 1, cv2.LINE_AA)
    rim = int(size * 0.18)
    _writing(cell, rng, (rim, int(size * 0.12), size - rim, int(size * 0.24)), ink, 1)
    _writing(cell, rng, (rim, int(size * 0.68), size - rim, int(size * 0.9)), ink, 4)


def _note(cell: Field, rng: np.random.Generator, *, printed: bool) -> None:
    """Lines of writing, on printed sheets below a heading and beside a picture."""
    size = len(cell)
    ink = hex_colour("#3a3d46" if printed else "#2c3f73")
    rim = int(size * 0.12)
    top = rim
    if printed:
        _writing(cell, rng, (rim, rim, int(size * 0.7), rim + 8), ink, 1)
        colour = hex_colour(_GROUNDS[int(rng.integers(1, len(_GROUNDS)))])
        top = int(size * rng.uniform(0.25, 0.55))
        cell[int(size * 0.22) : top, rim : size - rim] = colour
        top += 5
    _writing(cell, rng, (rim, top, size - rim, size - rim), ink, max(3, (size - rim - top) // 8))


def label_sheet(rng: np.random.Generator, *, size: int = 512) -> Image:
    """(size, size, 3): `LABEL_ROWS` × `LABEL_COLUMNS` different prints on grounds of different colours."""
    edge = size // LABEL_COLUMNS
    sheet = np.empty((size, size, 3))
    grounds = rng.permutation(len(_GROUNDS))
    for k in range(LABEL_COLUMNS * LABEL_ROWS):
        row, column = divmod(k, LABEL_COLUMNS)
        is_paper = row == LABEL_ROWS - 1
        code = _PAPERS[column % len(_PAPERS)] if is_paper else _GROUNDS[int(grounds[k % len(_GROUNDS)])]
        ground = hex_colour(code)
        cell = np.ascontiguousarray(np.broadcast_to(ground, (edge, edge, 3)))
        if is_paper:
            _note(cell, rng, printed=column % 2 == 1)
        else:
            _label(cell, rng, ground)
        rim = int(edge * _RIM)
        framed = np.broadcast_to(ground, cell.shape).copy()
        framed[rim:-rim, rim:-rim] = cell[rim:-rim, rim:-rim]
        sheet[row * edge : (row + 1) * edge, column * edge : (column + 1) * edge] = framed
    return to_image(sheet)
