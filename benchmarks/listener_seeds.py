"""`python -m benchmarks.listener_seeds SCORES … -o FILE.json`: figures of several training seeds, row by row.

Each folder has the files of `benchmarks.listener_tables` for one seed. Of each row and dataset, the file has strict
IoU of each part and category, and under ``listen`` the pair accuracy by kind of pair: the mean over the seeds, the
smallest and the largest, and the interval over homes of the first seed. `--table` prints them as a table.
"""

from __future__ import annotations

from pathlib import Path
from statistics import fmean
from typing import Any

import click

from avs3d_bench.contract.scores import Scores
from avs3d_bench.formats.files import write_json
from avs3d_bench.formats.media import read_record
from benchmarks.listener_summary import share
from benchmarks.listener_tables import ROWS, RUN_JSON
from benchmarks.sound_rows import row_of


def figures_of(folders: tuple[Path, ...]) -> dict[str, dict[str, Any]]:
    """``DATASET-ROW`` → group → metric → {"mean", "least", "most", "interval", "seeds"}; rows of the first folder."""
    found: dict[str, dict[str, Any]] = {}
    for path in sorted(folders[0].glob("listener-*.json")):
        if path.name == RUN_JSON:
            continue
        rows = [row_of(read_record(folder / path.name, Scores)) for folder in folders if (folder / path.name).exists()]
        found[path.stem.removeprefix("listener-")] = {
            group: {metric: _over([row[group][metric] for row in rows]) for metric in metrics}
            for group, metrics in rows[0].items()
            if isinstance(metrics, dict)
        }
    return found


def _over(each: list[dict[str, Any]]) -> dict[str, Any]:
    values = [figure["value"] for figure in each]
    return {
        "mean": round(fmean(values), 9), "least": min(values), "most": max(values), "interval": each[0]["interval"],
        "seeds": len(values),
    }  # fmt: skip


def table(found: dict[str, dict[str, Any]]) -> list[list[str]]:
    """Rows: dataset, row, and for each part its headline figures with the range over the seeds."""
    lines = []
    for name, groups in found.items():
        row = next((known for known in sorted(ROWS, key=len, reverse=True) if name.endswith(f"-{known}")), name)
        cells = [
            f"{part} {metric} {share(figure['mean'])} ({share(figure['least'])}–{share(figure['most'])})"
            for part, metrics in groups.items()
            if part.startswith("part_")
            for metric, figure in metrics.items()
        ]
        lines.append([name.removesuffix(f"-{row}"), row, "; ".join(cells)])
    return lines


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
@click.option("--table", "show", is_flag=True, help="Print the figures as a table.")
def main(folders: tuple[Path, ...], output: Path, show: bool) -> None:
    """Collect the figures of several training seeds."""
    found = figures_of(folders)
    write_json(output, found)
    for cells in table(found) if show else ():
        click.echo(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
