"""The files of a sweep's curves: curve.png, curve.csv, curve.md."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from evaluators.reporting.signatures import CURVES
from evaluators.reporting.sweep_curve import csv_text, markdown_text, read_sweep
from evaluators.reporting.tables import need_matplotlib, write_beside


def write_sweep(
    folder: Path,
    score_files: Sequence[Path],
    *,
    over: str | None = None,
    figures: Sequence[str] = (),
    plot: bool = True,
) -> list[Path]:
    """Write the curves as CSV, Markdown and, with ``plot``, a picture; the same bytes for the same scores.

    Args:
        folder: made if missing; files of other names in it stay.
        score_files: as for `evaluators.reporting.sweep_curve.read_sweep`.
        over: likewise.
        figures: likewise.
        plot: draw; needs matplotlib.

    Raises:
        UsageError: as `read_sweep`, or if a file of scores would be overwritten.
        Avs3dError: as `read_sweep`, or if matplotlib is missing or nothing can be written.
    """
    if plot:
        need_matplotlib()
    found = read_sweep(score_files, over=over, figures=figures)
    files = {folder / "curve.csv": csv_text(found).encode(), folder / "curve.md": markdown_text(found, plot).encode()}
    if plot:
        from evaluators.reporting.sweep_plot import draw

        files[folder / "curve.png"] = draw(found)
    return write_beside(files, score_files, CURVES)
