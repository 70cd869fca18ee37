"""The scores of the reference rows of ``listen``, in one table.

The evaluator is another package: it is called as a user calls it, by the command `avs3d eval`, which writes the file of
scores beside each submission. What is printed is read from there.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from contextlib import redirect_stdout
from importlib import metadata
from pathlib import Path

from avs3d_bench.commands.report import screen
from avs3d_bench.contract.schema import parse_record
from avs3d_bench.contract.scores import PAIR_FIGURES, Metric, Scores, metrics_of
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_bytes

#: Entry points of commands, and the one that scores.
_GROUP, _EVAL = "avs3d.commands", "eval"
#: Largest file of scores (bytes).
_MOST_BYTES = 64 * 2**20


def score_all(
    folder: Path, names: Iterable[str], root: Path, *, only: Iterable[str] = (), workers: int | None = None
) -> dict[str, Scores]:
    """Score submissions under ``listen``; ``NAME.json`` beside each has its scores.

    Args:
        folder: with a submission of each name.
        names: of the submissions.
        root: the dataset's.
        only: shell patterns of observation keys.
        workers: processes; None: one per core.

    Raises:
        Avs3dError: if the evaluator is not installed, or cannot score.
    """
    point = next(iter(metadata.entry_points(group=_GROUP, name=_EVAL)), None)
    if point is None:
        raise Avs3dError("avs3d eval: not installed; reinstall avs3d-bench to score the references")
    command = point.load()
    found = {}
    for name in names:
        path = folder / f"{name}.json"
        options = ["--dataset", str(root), "--protocol", "listen", "--json", str(path)]
        options += [each for pattern in only for each in ("--only", pattern)]
        options += [] if workers is None else ["--workers", str(workers)]
        with redirect_stdout(io.StringIO()):  # its own table; ours has all rows
            command.main([*options, "--", str(folder / name)], standalone_mode=False)
        found[name] = parse_record(read_bytes(path, _MOST_BYTES), Scores, path)
    return found


def print_table(found: Mapping[str, Scores]) -> None:
    """Print the pair accuracy of each submission, over twins, all pairs, and the other kinds, and its IoU."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    metrics = _metrics()
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("reference", no_wrap=True)
    for metric in metrics:
        table.add_column(metric.title.replace(" ", "\n").replace("-", "-\n"), justify="right", no_wrap=True)
    for name, scores in found.items():
        table.add_row(name, *(_text(scores, metric) for metric in metrics))
    screen().print(table)


def summary(found: Mapping[str, Scores]) -> dict[str, object]:
    """The same for a file: dataset, number of observations, and the figures of each submission."""
    data = next(iter(found.values())).dataset
    rows = {
        name: {metric.name: getattr(scores.overall.listen, metric.name, None) for metric in _metrics()}
        for name, scores in found.items()
    }
    return {"dataset": data.name, "version": data.version, "scored": data.scored, "references": rows}


def _metrics() -> list[Metric]:
    return [metric for metric in metrics_of("listen") if metric.name in (*PAIR_FIGURES, "IoU")]


def _text(scores: Scores, metric: Metric) -> str:
    value = getattr(scores.overall.listen, metric.name, None)
    return "–" if value is None else f"{value:.3f}"
