"""`python -m benchmarks.listener_best RUN …`: the number of the best of several training runs, ``seedN`` each.

Best is the one whose calibration has the largest IoU less the share of false marks over its rules of masks, on homes
and voices for validation (`baselines.listener.calibration.best_rule`). No test set takes part.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from avs3d_bench.formats.files import read_json
from baselines.listener.calibration import worth
from baselines.listener.card import CARD_JSON


def best_of(runs: Sequence[Path]) -> Path:
    """The best of runs that are finished, which are folders with a model card; the first of equals.

    Raises:
        click.UsageError: if none is finished.
    """
    finished = [run for run in runs if (run / CARD_JSON).exists()]
    if not finished:
        raise click.UsageError(f"none of {', '.join(map(str, runs))} has a {CARD_JSON}; let a training end first")
    cards = {run: read_json(run / CARD_JSON) for run in finished}
    return max(finished, key=lambda run: max(map(worth, cards[run]["calibration"]["figures"]["by_rule"])))


@click.command()
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path))
def main(runs: tuple[Path, ...]) -> None:
    """Print the number of the best run."""
    click.echo(best_of(runs).name.removeprefix("seed"))


if __name__ == "__main__":
    main()
