"""Tables of pandas, apart from the records: scores do not depend on the version of pandas."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from avs3d_bench.runtime.imports import needing

if TYPE_CHECKING:
    from pandas import DataFrame as DataFrame


def frame_of(rows: Iterable[Mapping[str, Any]], index: str, numbers: Iterable[str]) -> DataFrame:
    """The rows as a table.

    Args:
        rows: column → value.
        index: column that names the rows.
        numbers: prefixes, before a point, of columns whose missing values are NaN even where all are missing.

    Raises:
        Avs3dError: if pandas is not installed.
    """
    with needing("scores.to_frame()", "pip install pandas"):
        from pandas import DataFrame as Table

    frame = Table(list(rows)).set_index(index)
    known = set(numbers)
    return frame.astype({name: float for name in frame.columns if name.partition(".")[0] in known})
