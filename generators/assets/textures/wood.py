"""Wood: veneer for furniture, strip floors, herringbone parquet, butcher's block.

The grain of every image runs along its columns (u).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from generators.assets.textures.maps import Surface
from generators.assets.textures.noise import (
    Field,
    blur,
    hex_colour,
    mix,
    pick,
    smoothstep,
    spectral,
    to_image,
)


@dataclass(frozen=True)
class Species:
    """Appearance of a kind of wood.

    Attributes:
        light, dark: sRGB hex of early and late wood.
        rings: annual rings across a metre of straight grain.
        figure: deviation of the rings from straight lines (0: straight, 3: strongly figured).
        contrast: weight of the rings.
        pores: weight of the dark pores (oak, walnut) or 0 (pine, maple).
        fibre: weight of the fine streaks.
    """

    light: str
    dark: str
    rings: float
    figure: float
    contrast: float
    pores: float
    fibre: float


#: Depth (m) of the grain where it is darkest: late wood and pores lie deeper under the finish.
_GRAIN = 2.5e-4
#: Depth (m) of the joints between boards, and of their rounded rims.
_JOINT, _RIM = 1.5e-3, 3e-4
#: Spread of the boards' slopes: laid on a screed that is level to a few millimetres in a metre.
_LEVEL = 0.004

SPECIES = {
    "oak": Species("#c8a678", "#96703f", 42, 2.2, 0.42, 0.40, 0.20),
    "oak_pale": Species("#d9c3a0", "#b0916a", 42, 2.0, 0.38, 0.30, 0.18),
    "oak_smoked": Species("#8a6a4c", "#573d28", 42, 2.0, 0.42, 0.40, 0.20),
    "walnut": Species("#7d573c", "#46301f", 30, 2.6, 0.50, 0.30, 0.24),
    "pine": Species("#e0bd86", "#c08b4c", 24, 2.4, 0.45, 0.0, 0.10),
    "birch": Species("#e2cfae", "#cbb089", 22, 1.8, 0.30, 0.0, 0.12),
    "cherry": Species("#b37a50", "#8a5433", 34, 2.0, 0.36, 0.08, 0.16),
    "ash_grey": Species("#aea597", "#857b6e", 40, 2.2, 0.45, 0.30, 0.20),
    "wenge": Species("#4a3a30", "#2c211b", 60, 1.2, 0.45, 0.30, 0.25),
    "mahogany": Species("#8b4a30", "#5e2c1c", 36, 1.6, 0.36, 0.25, 0.20),
}


def grain(rng: np.random.Generator, shape: tuple[int, int], metres: float, species: Species) -> Field:
    """Darkness (H, W) about [0, 1] of a flat-sawn board; the image is ``metres`` high and wide per ``shape``."""
    height, _ = shape
    y = (np.arange(height) + 0.5)[:, None] / height
    # Contours of a field that is stretched along the grain give the arched figure of flat-sawn wood.
    bend = spectral(rng, shape, 1.9, stretch=(1.0, 9.0), finest=10)
    cycles = max(1, round(species.rings * metres * 0.45))
    phase = cycles * y + bend * species.figure * species.rings * metres * 0.10
    saw = phase - np.floor(phase)
    rings = saw**2.5 * (1 - smoothstep(0.9, 1.0, saw))
    rings = blur(rings, (0.7, 1.5))
    fibre = spectral(rng, shape, 0.35, stretch=(1.0, 45.0), finest=2)
    drift = spectral(rng, shape, 1.4, stretch=(1.0, 5.0), finest=24)
    out = 0.32 + species.contrast * (rings - 0.28) + 0.10 * species.fibre / 0.2 * fibre * 0.6 + 0.07 * drift
    if species.pores:
        dots = (rng.random(shape) > 0.988).astype(np.float64)
        streaks = blur(dots, (0.6, height * 0.012 / metres))
        streaks = streaks / max(float(np.quantile(streaks, 0.995)), 1e-9)
        out = out + species.pores * np.clip(streaks, 0, 1) * (0.35 + 0.65 * rings)
    return out


def _colour(dark: Field, species: Species) -> Field:
    return mix(hex_colour(species.light), hex_colour(species.dark), np.clip(dark, -0.2, 1.25))


def veneer(rng: np.random.Generator, species: str, *, size: int = 512, metres: float = 0.8) -> Surface:
    """A sheet of furniture veneer, ``metres`` square."""
    kind = SPECIES[species]
    dark = grain(rng, (size, size), metres, kind)
    return Surface(to_image(_colour(dark, kind)), -_GRAIN * dark)


def painted(rng: np.random.Generator, colour: Field, *, size: int = 256) -> Surface:
    """Lacquer on wood: nearly flat, with the faint orange peel and brush marks of real paint."""
    peel = spectral(rng, (size, size), 0.6, finest=3, coarsest=40)
    brush = spectral(rng, (size, size), 0.6, stretch=(1.0, 20.0), finest=3)
    broad = spectral(rng, (size, size), 1.8, finest=20)
    pixels = to_image(colour * (1 + 0.005 * peel + 0.003 * brush + 0.006 * broad)[..., None])
    return Surface(pixels, 5e-5 * peel + 4e-5 * brush)


@dataclass(frozen=True, eq=False)
class _Boards:
    """Layout of the boards; all arrays are (H, W), lengths in pixels of the result.

    Attributes:
        ids: number of the board, from 0.
        along: position on the board, lengthwise.
        across: position across the board.
        edge: distance to the board's rim.
    """

    ids: np.ndarray
    along: Field
    across: Field
    edge: Field


def _paint_boards(
    rng: np.random.Generator,
    species: Species,
    *,
    boards: _Boards,
    metres: float,
    gap: float,
    tone: float,
) -> Surface:
    """Colour boards: each gets another piece of one large sheet of grain, its own tone and a dark joint."""
    ids, along, across, edge = boards.ids, boards.along, boards.across, boards.edge
    size = ids.shape[0]
    count = int(ids.max()) + 1
    sheet = grain(rng, (size, size), metres, species)
    shift = rng.random((count, 2)) * size
    flip = rng.choice([-1.0, 1.0], size=(count, 2))
    dark = pick(sheet, along * flip[ids, 0] + shift[ids, 0], across * flip[ids, 1] + shift[ids, 1])
    board = rng.standard_normal(count) * tone
    warm = rng.standard_normal((count, 1)) * np.array([0.012, 0.0, -0.02])
    colour = _colour(dark + board[ids], species) * (1 + warm[ids])
    joint = 1 - smoothstep(gap * 0.4, gap * 1.3, edge)
    rounding = 1 - smoothstep(gap, gap * 4, edge)
    shade = (1 - 0.62 * joint) * (1 - 0.07 * rounding)
    height = -_GRAIN * dark - _JOINT * joint - _RIM * rounding
    tilt = (rng.standard_normal((count, 2)) * _LEVEL)[ids]
    worn = 0.15 * np.clip(dark, 0, 1)
    return Surface(to_image(colour * shade[..., None]), height, tilt, np.maximum(worn, 0.8 * joint))


def strips(
    rng: np.random.Generator,
    species: str,
    *,
    size: int = 1024,
    metres: float = 2.4,
    width: float = 0.15,
    length: float = 1.2,
    tone: float = 0.16,
    gap: float = 0.9,
) -> Surface:
    """Floor boards of one ``width``, laid in rows with staggered butt joints (wild bond)."""
    rows = max(2, round(metres / width))
    per_row = max(1, round(metres / length))
    y, x = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5, indexing="ij")
    row_height = size / rows
    row = np.floor(y / row_height).astype(np.int64)
    across = y - row * row_height
    ids = np.zeros((size, size), dtype=np.int64)
    along, end = np.zeros((size, size)), np.zeros((size, size))
    start = rng.random()
    for r in range(rows):
        # The golden ratio keeps joints of neighbouring rows apart; the jitter hides the regularity.
        start = (start + 0.618034 / per_row * 1.0 + rng.uniform(-0.06, 0.06) / per_row) % 1.0
        cuts = (start + np.arange(per_row) / per_row + rng.uniform(-0.18, 0.18, per_row) / per_row) % 1.0
        cuts = np.sort(cuts) * size
        inside = row[:, 0] == r
        cx = x[inside]
        after = np.searchsorted(cuts, cx)
        left, right = cuts[(after - 1) % per_row], cuts[after % per_row]
        ids[inside] = r * per_row + (after - 1) % per_row
        along[inside] = (cx - left) % size
        end[inside] = np.minimum((cx - left) % size, (right - cx) % size)
    edge = np.minimum(np.minimum(across, row_height - across), end)
    boards = _Boards(ids, along, across, edge)
    return _paint_boards(rng, SPECIES[species], boards=boards, metres=metres, gap=gap, tone=tone)


def herringbone(
    rng: np.random.Generator,
    species: str,
    *,
    size: int = 1024,
    metres: float = 2.4,
    ratio: int = 5,
    repeats: int = 4,
    diagonal: bool = True,
    tone: float = 0.15,
) -> Surface:
    """Herringbone parquet of blocks ``ratio`` times as long as wide, at 45° to the walls or along them.

    In units of a block's width the pattern repeats under (2·ratio, 0) and (1, 1); turned by 45° its orthogonal periods
    are √2 and ratio·√2, so both layouts close on a square image.
    """
    period = ratio * np.sqrt(2) if diagonal else 2 * ratio
    unit = size / (period * repeats)
    y, x = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5, indexing="ij")
    root = np.sqrt(0.5)
    a, b = ((x + y) * root / unit, (y - x) * root / unit) if diagonal else (x / unit, y / unit)
    i, j = np.floor(a).astype(np.int64), np.floor(b).astype(np.int64)
    m = (i - j) % (2 * ratio)
    lying = m < ratio
    si = np.where(lying, i - m, i)
    sj = np.where(lying, j, j - (2 * ratio - 1 - m))
    along = np.where(lying, a - si, b - sj)
    across = np.where(lying, b - sj, a - si)
    px, py = ((si - sj) * root * unit, (si + sj) * root * unit) if diagonal else (si * unit, sj * unit)
    key = np.rint(px % size).astype(np.int64) % size * (4 * size) + np.rint(py % size).astype(np.int64) % size * 2
    _, ids = np.unique(key + lying, return_inverse=True)
    edge = np.minimum(np.minimum(across, 1 - across), np.minimum(along, ratio - along)) * unit
    boards = _Boards(ids.reshape(size, size), along * unit, across * unit, edge)
    return _paint_boards(rng, SPECIES[species], boards=boards, metres=metres, gap=0.8, tone=tone)


def butcher_block(rng: np.random.Generator, species: str, *, size: int = 512, metres: float = 0.9) -> Surface:
    """A worktop of narrow glued staves."""
    return strips(rng, species, size=size, metres=metres, width=0.045, length=0.45, tone=0.12, gap=0.3)
