"""Low-discrepancy directions, and the pattern that distributes them over neighbouring texels.

Texels are coloured in 4 × 4 tiles (`PATTERNS` = 16 colours); a texel of colour p uses the p-th block of one long
(0, 2)-sequence. Every 4 × 4 window of texels therefore holds the whole sequence once, and a filter that gives every
colour the same weight removes the sampling pattern exactly where light varies slowly (interleaved sampling: Keller &
Heidrich, EGWR 2001).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from generators.core.scene import F32

#: Side of a tile (texels), and the number of sample sets.
TILE = 4
PATTERNS = TILE * TILE
# A permutation of the 16 blocks that puts consecutive blocks, which complement each other, far apart in the tile.
_ORDER = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]], dtype=np.int32)


def pattern_of(x: NDArray[np.int32], y: NDArray[np.int32]) -> NDArray[np.int32]:
    """The colour 0 … 15 of the texels in columns ``x`` and rows ``y``."""
    return _ORDER[y % TILE, x % TILE]


def net(count: int, scramble: tuple[int, int] = (0, 0)) -> NDArray[np.float64]:
    """The first ``count`` points (count, 2) of the (0, 2)-sequence in [0, 1)².

    Every aligned block of 2^m points is stratified in all elementary intervals of area 2^-m (Sobol' 1967).

    Args:
        count: how many points.
        scramble: 32-bit masks XORed to the digits; they give another sequence of the same quality.
    """
    index = np.arange(count, dtype=np.uint32)
    first = np.zeros(count, dtype=np.uint32)
    second = np.zeros(count, dtype=np.uint32)
    direction = np.uint32(1 << 31)
    for bit in range(32):
        digit = (index >> np.uint32(bit)) & np.uint32(1)
        first ^= digit * np.uint32(1 << (31 - bit))
        second ^= digit * direction
        direction ^= direction >> np.uint32(1)
    masks = np.array(scramble, dtype=np.uint32)
    points = np.stack([first ^ masks[0], second ^ masks[1]], axis=1)
    return (points.astype(np.float64) + 0.5) / 2.0**32


def cosine_directions(count: int, scramble: tuple[int, int] = (0, 0)) -> F32:
    """(16, count, 3) unit directions about +Z with density cos θ / π, one set per pattern."""
    points = net(PATTERNS * count, scramble)
    radius = np.sqrt(points[:, 0])
    angle = 2 * np.pi * points[:, 1]
    up = np.sqrt(np.maximum(1.0 - points[:, 0], 0.0))
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), up], axis=1)
    return directions.reshape(PATTERNS, count, 3).astype(np.float32)


def square_points(count: int, scramble: tuple[int, int] = (0, 0)) -> F32:
    """(16, count, 2) points in the unit square, one set per pattern.

    If ``count`` is a power of two, 4 or more, the first quarters of the sets cover the square together. In the order of
    the sequence they would lie in stripes: their numbers would have two binary digits in common, and with them two
    digits of a coordinate.
    """
    points = net(PATTERNS * count, scramble).reshape(PATTERNS, count, 2).astype(np.float32)
    if count >= 4 and count & (count - 1) == 0:
        # The quarter of its set that a pattern uses first is a linear function of the pattern's digits: the one of all
        # such functions that makes the first quarters of the 16 sets of 8 or 16 points a (0, 2)-net together.
        number = np.arange(PATTERNS)
        first = ((number >> 3 ^ number >> 2) & 1) + 2 * (number >> 2 & 1)
        order = np.arange(count) ^ (count // 4 * first)[:, None]
        points = np.take_along_axis(points, order[..., None], axis=1)
    return points


def fibonacci_directions(count: int) -> NDArray[np.float64]:
    """(N, 3) evenly spread unit vectors (R. Swinbank, R. J. Purser, Q. J. R. Meteorol. Soc. 132 (2006) 1769–1793)."""
    k = np.arange(count) + 0.5
    y, turn = 1 - 2 * k / count, np.pi * (3 - np.sqrt(5)) * k
    flat = np.sqrt(1 - y * y)
    return np.stack([flat * np.cos(turn), y, flat * np.sin(turn)], axis=1)
