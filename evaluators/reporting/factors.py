"""Figures by factor on pages: charts and a table, for a report of one method or a page of several side by side."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from avs3d_bench.contract.frame_rows import FrameRow
from avs3d_bench.contract.scores import Metric
from avs3d_bench.errors import UsageError
from avs3d_bench.formats.files import write_bytes
from avs3d_bench.text.printable import no_formula
from avs3d_bench.text.templates import words
from evaluators.reporting.pages import write_page
from evaluators.statistics.curves import Bin, FactorCurve, FactorPoint, curves
from evaluators.statistics.frame_rows import read_rows

#: Most tables of frames on one page: so many colours can be told apart.
MOST_TABLES = 4
#: Columns of the table of `avs3d factors --csv`; ``from`` and ``to`` are empty where a bin is open, and of names.
TABLE_COLUMNS = (
    "protocol", "figure", "factor", "unit", "bin", "from", "to", "method", "value", "low", "high", "observations",
    "frames",
)  # fmt: skip
#: Width that the points of all methods take of a bin.
_SPREAD = 0.34
#: Half of the thickness of a line (pixels).
_HALF_LINE = 0.9


@dataclass(frozen=True)
class Mark:
    """A point of a chart; positions are in percent of the plot.

    Attributes:
        method: number of the method.
        left: of its middle.
        bottom: of its middle.
        low: lower end of the whisker; None without an interval.
        height: of the whisker.
    """

    method: int
    left: float
    bottom: float
    low: float | None
    height: float


@dataclass(frozen=True)
class FactorChart:
    """A curve as it is drawn.

    Attributes:
        curve: the figures.
        marks: a point for each method and bin that has one.
        lines: number of a method → CSS polygon of the line through neighbouring points; none between names.
    """

    curve: FactorCurve
    marks: tuple[Mark, ...]
    lines: tuple[tuple[int, str], ...]


def draw(curve: FactorCurve) -> FactorChart:
    """The positions of a curve's points and lines."""
    count, methods = len(curve.bins), len(curve.bins[0].points)
    marks: list[Mark] = []
    lines: list[tuple[int, str]] = []
    for method in range(methods):
        aside = (method - (methods - 1) / 2) * _SPREAD / methods
        last: Mark | None = None
        for place, each in enumerate(curve.bins):
            found = each.points[method]
            if found is None:
                last = None
                continue
            mark = _mark(method, 100 * (place + 0.5 + aside) / count, found)
            if last is not None and curve.factor.cuts is not None:
                lines.append((method, _segment(last, mark)))
            marks.append(mark)
            last = mark
    return FactorChart(curve, tuple(marks), tuple(lines))


def _mark(method: int, left: float, found: FactorPoint) -> Mark:
    low, high = found.interval or (found.value, found.value)
    return Mark(method, left, 100 * found.value, 100 * low if found.interval else None, 100 * (high - low))


def _segment(first: Mark, second: Mark) -> str:
    """A line between two points, as the corners of a thin polygon."""
    edge = [f"{m.left:.2f}% calc({100 - m.bottom:.2f}% - {_HALF_LINE}px)" for m in (first, second)]
    edge += [f"{m.left:.2f}% calc({100 - m.bottom:.2f}% + {_HALF_LINE}px)" for m in (second, first)]
    return ", ".join(edge)


def factor_values(tables: Sequence[Sequence[FrameRow]]) -> tuple[dict[str, Any], ...]:
    """The values of the charts for a template: one entry per figure.

    Args:
        tables: rows of each method, of the same frames; none at all gives no entry.
    """
    by_figure: dict[Metric, list[FactorCurve]] = {}
    for each in curves(tables) if tables and tables[0] else ():
        by_figure.setdefault(each.metric, []).append(each)
    return tuple(
        {
            "metric": metric,
            "charts": tuple(draw(each) for each in found if len(each.bins) > 1),
            "rows": tuple(each for each in found if each.bins),
            "undrawn": _notes(found),
        }
        for metric, found in by_figure.items()
    )


def factor_page(tables: Sequence[Sequence[FrameRow]]) -> dict[str, Any]:
    """Values for a page with the macros of `factor_macros.html.j2`; see `factor_values`."""
    found = factor_values(tables)
    metrics = [each["metric"] for each in found]
    return {
        "factors": found,
        "factor_options": [(f"{m.protocol}-{m.name}", f"{m.protocol} {m.title}") for m in metrics],
        "bin_label": bin_label,
    }


def _notes(found: Sequence[FactorCurve]) -> tuple[str, ...]:
    """Notes on figures that are not drawn or left out, each once with the titles of all factors that it concerns."""
    titles: dict[str, list[str]] = {}
    for each in found:
        note = _note(each)
        if note is not None:
            titles.setdefault(note, []).append(each.factor.title)
    return tuple(f"{', '.join(concerned)}: {note}" for note, concerned in titles.items())


def _note(curve: FactorCurve) -> str | None:
    """Why a curve is not drawn, or how many frames are missing in it; None if it has all of them."""
    missing = "; ".join(f"{_frames(count)}: {reason}" for reason, count in curve.unknown.items())
    if not curve.bins:
        return f"not known ({missing})"
    only = "" if len(curve.bins) > 1 else f"all in the bin {bin_label(curve, curve.bins[0])}"
    left_out = f"left out: {missing}" if missing else ""
    return "; ".join(part for part in (only, left_out) if part) or None


def _frames(count: int) -> str:
    return f"{count} frame{'' if count == 1 else 's'}"


def bin_label(curve: FactorCurve, each: Bin) -> str:
    """The label of a bin with its unit."""
    unit = curve.factor.unit
    label = words(each.label) if curve.factor.cuts is None else each.label
    return f"{label}{'' if unit == '°' else ' '}{unit}".strip()


def write_factors(files: Sequence[Path], *, html: Path | None, table: Path | None) -> tuple[str, ...]:
    """Write the figures by factor of one to four methods: a page, a CSV table, or both.

    Args:
        files: tables of frames that `avs3d-eval --frames` wrote.
        html: the page; None: none.
        table: the CSV file; None: none.

    Returns:
        the names of the methods, in the order of the files.

    Raises:
        UsageError: if the number of files is wrong, or they were not scored on the same frames.
        Avs3dError: if a file is damaged, or nothing can be written.
    """
    if not 1 <= len(files) <= MOST_TABLES:
        raise UsageError(f"{len(files)} tables of frames: expected 1 to {MOST_TABLES}")
    tables = [read_rows(path) for path in files]
    for path, rows in zip(files[1:], tables[1:], strict=True):
        _check_comparable((files[0], tables[0]), (path, rows))
    names = _names(files, tables)
    if html is not None:
        values = {"methods": names, "first": tables[0][0], "frames": len(tables[0])}
        write_page(html, "factors.html.j2", values | factor_page(tables))
    if table is not None:
        write_bytes(table, _as_csv(curves(tables), names).encode("utf-8", "replace"))
    return names


def _names(files: Sequence[Path], tables: Sequence[Sequence[FrameRow]]) -> tuple[str, ...]:
    """The methods' names; of one name several, with the names of their files."""
    methods = [rows[0].method for rows in tables]
    counts = Counter(methods)
    named = [m if counts[m] == 1 else f"{m} ({path.stem})" for m, path in zip(methods, files, strict=True)]
    counts = Counter(named)
    return tuple(name if counts[name] == 1 else f"{name} [{place}]" for place, name in enumerate(named, start=1))


_Table = tuple[Path, Sequence[FrameRow]]


def _check_comparable(one: _Table, other: _Table) -> None:
    """Refuse tables that are not of the same frames of one dataset, scored in the same way.

    Raises:
        UsageError: naming the first difference.
    """
    (path, rows), (other_path, others) = one, other
    for name, what in (("dataset", "dataset"), ("dataset_sha256", "dataset.json")):
        found, expected = getattr(others[0], name), getattr(rows[0], name)
        if found != expected:
            raise UsageError(f"{other_path}: {what} {found}, but {path} has {expected}; compare scores on one dataset")
    mine, theirs = ({(row.key, row.frame): row for row in some} for some in (rows, others))
    for key, frame in sorted(mine.keys() ^ theirs.keys()):
        there, missing = (path, other_path) if (key, frame) in mine else (other_path, path)
        raise UsageError(f"{missing}: no row for {key} {frame}, which {there} has; score both on the same observations")
    for where, row in mine.items():
        match = theirs[where]
        if (row.protocol, row.protocol_version) != (match.protocol, match.protocol_version):
            raise UsageError(
                f"{other_path}: {' '.join(where)}: protocol {match.protocol} {match.protocol_version}, but {path} has "
                f"{row.protocol} {row.protocol_version}; score both with the same version"
            )
        if (row.truth_pixels, row.pixels) != (match.truth_pixels, match.pixels):
            raise UsageError(
                f"{other_path}: {' '.join(where)}: {match.truth_pixels} true pixels, but {path} has "
                f"{row.truth_pixels}; score both against the same truth"
            )


def _as_csv(found: Sequence[FactorCurve], names: Sequence[str]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(TABLE_COLUMNS)
    for each in found:
        head = (each.metric.protocol, each.metric.name, each.factor.name, each.factor.unit)
        for one in each.bins:
            ends = each.factor.ends(one.label)
            for name, at in zip(names, one.points, strict=True):
                if at is not None:
                    low, high = at.interval or (None, None)
                    # Labels of numbers may begin with a minus; names come from the dataset.
                    label = no_formula(one.label) if each.factor.cuts is None else one.label
                    text = (*head, label, *ends, no_formula(name))
                    writer.writerow((*text, at.value, low, high, at.observations, at.frames))
    return stream.getvalue()
