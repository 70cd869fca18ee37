"""Where within a pixel its rays go: fixed places, so that frames come out the same every time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def stratified(count: int) -> NDArray[np.float64]:
    """(count, 2) places in the unit square whose columns and rows are all different and evenly spaced.

    Place i has column (i + ½)/n and the row of i's mirrored binary digits (a Hammersley set; ``count`` a power of
    two): n grey levels along a nearly horizontal or vertical edge, as rotated grids have.
    """
    bits = count.bit_length() - 1
    mirrored = [int(format(i, f"0{bits}b")[::-1], 2) for i in range(count)]
    return (np.stack([np.arange(count), np.array(mirrored)], axis=1) + 0.5) / count


#: Rays of a pixel at an edge.
SUB_PIXELS = stratified(8)
