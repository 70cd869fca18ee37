"""`python -m benchmarks.sound_rows ROW=SCORES.json … -o FILE.json`: figures of one method with different sounds.

A row is a name and a file of scores. What is kept: the dataset and its version, the number of observations, strict IoU
by part and by category, and under ``listen`` the pair accuracy by kind of pair, with their intervals.
docs/results/echosegnet-sounds.json is such a file.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from avs3d_bench.contract.scores import PAIR_KINDS, GroupScores, Scores
from avs3d_bench.formats.files import write_json
from avs3d_bench.formats.media import read_record
from benchmarks.listener_summary import share

#: Figures of ``listen`` that are kept.
LISTEN_FIGURES = ("pair_accuracy", *PAIR_KINDS, "IoU", "FP_rate")


def row_of(scores: Scores) -> dict[str, Any]:
    """The figures of a file of scores: part or category → metric → {"value", "interval"}; and what was scored."""
    groups: dict[str, GroupScores] = {str(name): group for name, group in scores.parts.items()}
    groups |= {str(name): group for name, group in scores.categories.items()}
    kept: dict[str, Any] = {name: found for name, group in groups.items() if (found := _figures(group))}
    return kept | {
        "dataset": f"{scores.submission.dataset} {scores.submission.dataset_version}",
        "observations": scores.overall.observations,
    }


def _figures(group: GroupScores) -> dict[str, Any]:
    found = {}
    for summary, names in ((group.strict, ("IoU",)), (group.listen, LISTEN_FIGURES)):
        if summary is None:
            continue
        for name in names:
            if (value := getattr(summary, name)) is not None:
                title = "strict_IoU" if summary is group.strict else name
                found[title] = {"value": value, "interval": summary.intervals.get(name)}
    return found


def with_interval(figure: Mapping[str, Any]) -> str:
    """A figure as ``.123 (.10–.15)``."""
    low, high = (share(bound, 2) for bound in figure["interval"])
    return f"{share(figure['value'])} ({low}–{high})"


def _named(_: click.Context, __: click.Parameter, values: tuple[str, ...]) -> dict[str, Path]:
    pairs = [value.split("=", 1) for value in values]
    if any(len(pair) < 2 for pair in pairs):
        raise click.BadParameter("expected ROW=SCORES.json")
    return {name: Path(file) for name, file in pairs}


@click.command()
@click.argument("rows", nargs=-1, required=True, callback=_named)
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
def main(rows: dict[str, Path], output: Path) -> None:
    """Collect the figures of files of scores; a row ``NAME/DATASET`` goes below NAME."""
    found: dict[str, Any] = {}
    for name, file in rows.items():
        place = found
        *above, last = name.split("/")
        for one in above:
            place = place.setdefault(one, {})
        place[last] = row_of(read_record(file, Scores))
    write_json(output, found)


if __name__ == "__main__":
    main()
