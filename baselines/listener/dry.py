"""Dry sounds, which sound in training frames in place of their own source.

A frame of training data has one second of one unit of a voice. Where its impulse response is stored (`avs3d generate
--with rirs`), any other sound of the category can be heard from the same place in the same room: the network learns
from as many units, voices and recordings as there are, at the cost of a convolution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.schema import AttributionRecord
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import atomic_path, sha256_file

#: Samples of an excerpt: the second that is heard, and the one before it, which still reverberates.
EXCERPT = 2 * SAMPLE_RATE


@dataclass(frozen=True)
class DrySounds:
    """Excerpts of sources, without a room.

    Attributes:
        samples: (M, EXCERPT) float16 mono.
        categories: (M,) int64, numbers of `CATEGORIES` from 0.
        digest: sha256 of the file.
        credits: who recorded what is among them.
    """

    samples: NDArray[np.float16]
    categories: NDArray[np.int64]
    digest: str
    credits: tuple[AttributionRecord, ...] = ()

    @cached_property
    def of_category(self) -> list[NDArray[np.int64]]:
        """The excerpts of each category."""
        return [np.flatnonzero(self.categories == number) for number in range(len(CATEGORIES))]


def write_dry(
    path: str | Path, samples: NDArray[np.float16], categories: Sequence[int], credits: Sequence[AttributionRecord] = ()
) -> None:
    """Write excerpts (`DrySounds`) into a file, in NumPy's format ``npz``."""
    named = np.asarray([each.model_dump_json() for each in credits], np.str_)
    with atomic_path(Path(path)) as temporary, temporary.open("wb") as stream:
        np.savez(stream, samples=samples, categories=np.asarray(categories, np.int64), credits=named)


def read_dry(path: str | Path) -> DrySounds:
    """Read what `write_dry` wrote.

    Raises:
        Avs3dError: if the file is missing, damaged, or of something else.
    """
    expected = "expected dry sounds (python -m benchmarks.listener_dry -o FILE)"
    try:
        with np.load(path) as archive:
            samples, categories = archive["samples"], archive["categories"]
            named = tuple(AttributionRecord.model_validate_json(str(each)) for each in archive["credits"])
    except Exception as error:
        raise Avs3dError(f"{path}: cannot be read ({error}); {expected}") from None
    count = len(categories)
    if samples.shape != (count, EXCERPT) or samples.dtype != np.float16 or not count:
        raise Avs3dError(f"{path}: {samples.dtype} samples of shape {samples.shape}; {expected}")
    if categories.min() < 0 or categories.max() >= len(CATEGORIES):
        raise Avs3dError(f"{path}: a category has a number beyond the {len(CATEGORIES)} of the benchmark; {expected}")
    return DrySounds(samples, categories, sha256_file(Path(path)), named)
