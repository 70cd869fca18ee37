"""docs/results/leaderboard.json, all recorded files of scores as one leaderboard, and docs/leaderboard.md made of it.

`benchmarks.docs_tables` writes both. For other files of scores: `avs3d leaderboard FILES -o DIR --json FILE`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from avs3d_bench.contract.scores import metrics_of
from avs3d_bench.formats.files import dump_json, read_json
from benchmarks.listener_summary import MISSING, share, table
from evaluators.reporting.board import Board, BoardRow, BoardTable, board_of
from evaluators.reporting.leaderboard import read_entries

#: Name of the JSON file in docs/results.
BOARD_JSON = "leaderboard.json"
#: Digits of a digest in a table.
_SHORT = 7
_HEAD = """\
# Leaderboard

All recorded rows of this project, as [one JSON file]({json}) with the digests of the files of scores;
`make docs-tables` writes both. Every table is of one dataset, by the digest of its `dataset.json`, and one protocol.
Means are over all parts; the columns `part_1` and `part_2` have the figure that ranks.

- Methods that no test of paired differences separates share a place
  ([comparing](comparing.md#differences-between-methods)).
- Rows without a place are not ranked: references, oracles (their masks are made from the truth), and runs over a part
  of a dataset.
- What the rows are and which questions they answer: [results](results.md), [the listener](listener.md).
- Rank your own files of scores beside them: `avs3d leaderboard docs/results/listener-*-2d.json mine.json -o board`
  ([how to organise](organise.md)).
"""


def board(results: Path) -> Board:
    """The leaderboard of all files of scores in a folder.

    Raises:
        Avs3dError: if one is broken.
    """
    files = [path for path in sorted(results.glob("*.json")) if "avs3d_eval" in read_json(path)]
    return board_of(read_entries(files, reports=False))


def pages(docs: Path) -> dict[Path, str]:
    """The JSON file and the page, as they are to be."""
    found = board(docs / "results")
    return {docs / "results" / BOARD_JSON: dump_json(found), docs / "leaderboard.md": page(found)}


def page(found: Board) -> str:
    """The page in Markdown."""
    lines = [_HEAD.format(json=f"results/{BOARD_JSON}")]
    dataset = ""
    whole = [one for one in found.tables if one.part == "overall"]
    ranked = {one.dataset_sha256 for one in whole if any(row.place for row in one.rows)}
    # Datasets on which methods are ranked come before those of ablations.
    for one in sorted(whole, key=lambda one: one.dataset_sha256 not in ranked):
        name = f"{one.dataset} {one.dataset_version or ''}".strip()
        title = f"## {name} ({(one.dataset_sha256 or 'release')[:_SHORT]})"
        if title != dataset:
            lines.append(f"{title}\n")
        dataset = title
        lines += _table(found, one)
    return "\n".join(lines).rstrip() + "\n"


def _table(found: Board, whole: BoardTable) -> Iterator[str]:
    """Lines of a table, with the figure that ranks in each part."""
    same = ("dataset_sha256", "dataset", "dataset_version", "protocol", "protocol_version")
    parts = {
        one.part: {_key(row): row.figures.get(one.ranked_by) for row in (*one.rows, *one.partial)}
        for one in found.tables
        if one.part != "overall" and all(getattr(one, name) == getattr(whole, name) for name in same)
    }
    # A dataset of one part needs no column for it.
    parts = parts if len(parts) > 1 else {}
    shown = {key for row in (*whole.rows, *whole.partial) for key in row.figures}
    metrics = [metric for metric in metrics_of(whole.protocol) if metric.name in shown]
    title = next(metric.title for metric in metrics if metric.name == whole.ranked_by)
    scored = {entry.digest: entry for entry in found.entries}
    rows = []
    for row in (*whole.rows, *whole.partial):
        entry = scored.get(row.digest or "")
        name = row.title
        if entry is not None and entry.scored < entry.observations:
            name += f", {entry.scored} of {entry.observations} observations"
        link = f"[{entry.digest[:_SHORT]}](results/{entry.file})" if entry else MISSING
        figures = [share(row.figures.get(metric.name)) for metric in metrics]
        rows.append(
            [str(row.place or MISSING), name, *figures, *(share(one.get(_key(row))) for one in parts.values()), link]
        )
    yield f"Protocol `{whole.protocol}` {whole.protocol_version}, ranked by {title}:\n"
    yield from table(["place", "method", *(metric.title for metric in metrics), *parts, "scores"], rows)


def _key(row: BoardRow) -> str:
    return row.digest or row.title
