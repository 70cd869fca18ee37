"""The table of frames: one row per scored frame, written by `avs3d-eval --frames FILE` and read by `avs3d factors`.

The suffix of the file decides its format: CSV, or Parquet, which needs pyarrow. Both have the columns of
`avs3d_bench.contract.frame_rows.FrameRow`, in that order. In CSV, null is an empty cell, and `unavailable` is JSON.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from avs3d_bench.contract.frame_rows import COLUMNS, FrameRow
from avs3d_bench.contract.schema import describe
from avs3d_bench.contract.scores import Scores
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import read_bytes, write_bytes
from avs3d_bench.runtime.imports import needing
from avs3d_bench.text.printable import no_formula
from evaluators.metrics.masks import f_measure, iou
from evaluators.reading.records import Evaluation, FrameTally
from evaluators.statistics.factors import NAMES, observation_factors

CSV, PARQUET = ".csv", ".parquet"
#: Largest table (bytes): a row takes about 500 bytes in CSV.
MAX_TABLE_BYTES = 256 * 2**20
_JSON_COLUMN = "unavailable"
#: Type in JSON Schema → name of the Arrow type; all other columns are text.
_ARROW = {"integer": "int64", "number": "float64"}
_FIELDS = FrameRow.model_json_schema()["properties"]


def check_suffix(path: Path) -> None:
    """Refuse a name that says no format, or one that cannot be written here.

    Raises:
        UsageError: if the suffix is neither .csv nor .parquet.
        Avs3dError: if it is .parquet and pyarrow is missing.
    """
    if path.suffix.lower() not in (CSV, PARQUET):
        raise UsageError(f"{path}: a table of frames is CSV or Parquet; expected a name ending in {CSV} or {PARQUET}")
    if path.suffix.lower() == PARQUET:
        _pyarrow(path)


def _pyarrow(path: Path) -> Any:
    with needing(str(path), f"pip install 'avs3d-bench[parquet]', or choose a name ending in {CSV}"):
        import pyarrow
        import pyarrow.parquet
    return pyarrow


def frame_rows(evaluation: Evaluation, dataset: Dataset) -> tuple[FrameRow, ...]:
    """The rows of an evaluation, in the order of observations and frames.

    Observations without a figure of ``strict`` or ``listen`` are left out.

    Args:
        evaluation: what `evaluators.score.score` returned.
        dataset: the one that it was scored against.

    Raises:
        Avs3dError: if observation.json or an impulse response is damaged.
    """
    rows: list[FrameRow] = []
    for scored in evaluation.scores.observations:
        if scored.strict is None and scored.listen is None:
            continue
        common = _common(evaluation.scores, "strict" if scored.listen is None else "listen")
        common |= {name: getattr(scored, name) for name in ("key", "part", "scan", "room", "group")}
        rows += _observation_rows(common, dataset[scored.key], evaluation.frames[scored.key])
    return tuple(rows)


def _common(scores: Scores, protocol: str) -> dict[str, Any]:
    return {
        "method": scores.submission.method,
        "dataset": scores.dataset.name,
        "dataset_sha256": scores.dataset.sha256,
        "protocol": protocol,
        "protocol_version": {str(name): version for name, version in scores.avs3d_eval.protocols.items()}[protocol],
    }


def _observation_rows(
    common: Mapping[str, Any], observation: Observation, tallies: Iterable[FrameTally]
) -> list[FrameRow]:
    factors = observation_factors(observation)
    return [
        FrameRow.model_validate(
            {**common, **_figures(tally)}
            | {name: getattr(factors[tally.name], name) for name in (*NAMES, "unavailable")}
        )
        for tally in tallies
    ]


def _figures(tally: FrameTally) -> dict[str, Any]:
    counts = tally.counts
    twins, pairs = tally.twins or (None, None), tally.pairs or (None, None)
    return {
        "frame": tally.name,
        "pixels": counts.pixels,
        "truth_pixels": counts.truth,
        "predicted_pixels": counts.predicted,
        "overlap_pixels": counts.overlap,
        "IoU": iou(counts) if counts.truth else None,
        "F": f_measure(counts) if counts.truth else None,
        "boundary_F": tally.boundary_f,
        "twins_visible": twins[0],
        "twins_marked": twins[1],
        "pairs": pairs[0],
        "pairs_right": pairs[1],
        "visible_share": counts.truth / counts.pixels,
    }


def write_rows(path: Path, rows: Sequence[FrameRow]) -> None:
    """Write a table atomically; the same rows give the same bytes.

    Raises:
        UsageError: if the suffix is neither .csv nor .parquet.
        Avs3dError: if pyarrow is missing or the file cannot be written.
    """
    check_suffix(path)
    write_bytes(path, _as_csv(rows) if path.suffix.lower() == CSV else _as_parquet(path, rows))


def _cells(row: FrameRow) -> dict[str, Any]:
    cells = row.model_dump()
    return cells | {_JSON_COLUMN: json.dumps(cells[_JSON_COLUMN], sort_keys=True, ensure_ascii=False)}


def _as_csv(rows: Iterable[FrameRow]) -> bytes:
    stream = io.StringIO()
    writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: _quoted(value) for name, value in _cells(row).items()})
    return stream.getvalue().encode("utf-8", "replace")


def _quoted(value: object) -> object:
    """Text that is no formula; the apostrophe of text that begins with one is doubled, so that reading removes one."""
    if not isinstance(value, str):
        return value
    return f"'{value}" if value.startswith("'") else no_formula(value)


def _arrow_type(column: str) -> str:
    """Name of the Arrow type that holds a column."""
    field = _FIELDS[column]
    kinds = {one.get("type", "string") for one in field.get("anyOf", [field])}
    return next((_ARROW[kind] for kind in _ARROW if kind in kinds), "string")


def _as_parquet(path: Path, rows: Iterable[FrameRow]) -> bytes:
    pyarrow = _pyarrow(path)
    schema = pyarrow.schema([(name, getattr(pyarrow, _arrow_type(name))()) for name in COLUMNS])
    table = pyarrow.Table.from_pylist([_cells(row) for row in rows], schema=schema)
    stream = io.BytesIO()
    pyarrow.parquet.write_table(table, stream, compression="zstd")
    return stream.getvalue()


def read_rows(path: Path) -> tuple[FrameRow, ...]:
    """Read what `write_rows` wrote, in either format.

    Raises:
        UsageError: if the suffix is neither .csv nor .parquet.
        Avs3dError: if the file is damaged: the row and the column are named.
    """
    check_suffix(path)
    data = read_bytes(path, MAX_TABLE_BYTES)
    cells = _csv_cells(path, data) if path.suffix.lower() == CSV else _parquet_cells(path, data)
    rows = [_row(path, number, each) for number, each in enumerate(cells, start=1)]
    if not rows:
        raise Avs3dError(f"{path}: no row; expected a table that avs3d-eval --frames wrote")
    known: dict[tuple[str, str], int] = {}
    for number, row in enumerate(rows, start=1):
        first = known.setdefault((row.key, row.frame), number)
        if first != number:
            raise Avs3dError(
                f"{path}: row {number}: {row.key} {row.frame} is in row {first} already; expected one row per frame"
            )
    return tuple(rows)


def _check_columns(path: Path, found: Sequence[str]) -> None:
    missing = [name for name in COLUMNS if name not in found]
    if missing:
        raise Avs3dError(
            f"{path}: no column {missing[0]!r}; expected a table of version 1.0 that avs3d-eval --frames wrote"
        )


def _csv_cells(path: Path, data: bytes) -> list[dict[str, Any]]:
    try:
        reader = csv.DictReader(io.StringIO(data.decode("utf-8"), newline=""), restkey="", strict=True)
        rows: list[dict[str, Any]] = list(reader)
    except (UnicodeDecodeError, csv.Error) as error:
        raise Avs3dError(f"{path}: no CSV ({error}); expected a table that avs3d-eval --frames wrote") from None
    _check_columns(path, reader.fieldnames or ())
    return [{name: _unquoted(value) or None for name, value in row.items()} for row in rows]


def _unquoted(value: object) -> object:
    return value.removeprefix("'") if isinstance(value, str) else value


def _parquet_cells(path: Path, data: bytes) -> list[dict[str, Any]]:
    pyarrow = _pyarrow(path)
    try:
        table = pyarrow.parquet.read_table(io.BytesIO(data))
        _check_columns(path, table.column_names)
        rows: list[dict[str, Any]] = table.to_pylist()
    except pyarrow.ArrowException as error:
        why = str(error).split("\n")[0]
        raise Avs3dError(f"{path}: no Parquet ({why}); expected a table that avs3d-eval --frames wrote") from None
    return rows


def _row(path: Path, number: int, cells: Mapping[str, Any]) -> FrameRow:
    try:
        why = json.loads(cells[_JSON_COLUMN] or "{}")
        return FrameRow.model_validate({**cells, _JSON_COLUMN: why})
    except (ValueError, TypeError) as error:
        found = describe(error)[0] if isinstance(error, ValidationError) else f"{_JSON_COLUMN}: no JSON"
        raise Avs3dError(f"{path}: row {number}: {found}; expected a row that avs3d-eval --frames wrote") from None
