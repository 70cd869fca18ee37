"""The values of a mask in memory: which arrays are taken for one, and which are refused."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError

#: Values or names in a message before it only counts.
NAMED = 5


def as_mask(mask: ArrayLike, size: tuple[int, int], where: str) -> NDArray[np.bool_]:
    """A method's mask as (H, W) bool.

    Args:
        mask: boolean, or whole numbers that are all 0 and 1 or all 0 and 255.
        size: (height, width) that is expected.
        where: what messages name.

    Raises:
        Avs3dError: if the shape, the type or a value is another. Scores and probabilities are refused rather than
            cut at a threshold that the method did not choose.
    """
    try:
        array = np.asarray(mask)
    except ValueError as error:
        raise Avs3dError(f"{where}: the mask is no array ({error}); expected {size} bool") from None
    if array.shape != size:
        raise Avs3dError(f"{where}: the mask has shape {array.shape}, expected {size} (height, width)")
    if array.dtype == np.bool_:
        return array
    if array.dtype.kind not in "iu":
        raise Avs3dError(f"{where}: the mask is {array.dtype}, expected bool, or integers 0 and 255; threshold it")
    top = int(array.max(initial=0))
    marked = np.count_nonzero(array == top) if top else 0
    if top not in (0, 1, 255) or marked != np.count_nonzero(array):
        values = ", ".join(str(value) for value in np.unique(array)[:NAMED])
        raise Avs3dError(f"{where}: the mask holds {values} …, expected only 0 and 1, or only 0 and 255; threshold it")
    return np.asarray(array != 0)
