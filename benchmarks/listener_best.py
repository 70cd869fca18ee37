"""`python -m benchmarks.listener_best RUN … [-o FILE.json]`: the number of the best of several runs, ``seedN`` each.

Best is the one whose calibration has the largest IoU less the share of false marks over its rules of masks, on homes
and voices for validation (`baselines.listener.calibration.best_rule`). No test set takes part. FILE gets what the cards
of all runs say of validation and calibration, for docs/results/listener-runs.json.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from avs3d_bench.formats.files import read_json, write_json
from baselines.listener.calibration import worth
from baselines.listener.card import CARD_JSON
from benchmarks.listener_summary import share

#: What figures of validation are called in the docs.
TITLES = {
    "audible": "audible categories all right", "category_iou": "category that is heard, IoU",
    "class_iou": "classes of pixels, IoU", "fp_rate": "something marked where nothing sounds in view",
    "iou": "what sounds, IoU", "pair_accuracy": "pair accuracy",
}  # fmt: skip


def best_of(found: Mapping[Path, Mapping[str, float]]) -> Path:
    """The best of the runs that `figures_of` has figures of; the first of equals."""
    return max(found, key=lambda run: found[run]["IoU less false marks"])


def figures_of(runs: Sequence[Path]) -> dict[Path, dict[str, float]]:
    """Of each finished run, its minutes, and the figures of validation and of calibration.

    Raises:
        click.UsageError: if none is finished.
    """
    cards: dict[Path, Any] = {run: read_json(run / CARD_JSON) for run in runs if (run / CARD_JSON).exists()}
    if not cards:
        raise click.UsageError(f"none of {', '.join(map(str, runs))} has a {CARD_JSON}; let a training end first")
    return {run: _figures(card) for run, card in cards.items()}


def _figures(card: dict[str, Any]) -> dict[str, float]:
    chosen = card["calibration"]["figures"]
    return {
        "minutes": card.get("training", {}).get("minutes"),
        **{f"validation: {TITLES[name]}": value for name, value in card.get("validation", {}).items()},
        "IoU less false marks": round(max(map(worth, chosen["by_rule"])), 4),
        "calibration error before": chosen.get("error_before"),
        "calibration error": chosen.get("error"),
    }


def rows(found: Mapping[str, Mapping[str, float]]) -> list[list[str]]:
    """Rows of the docs: the figure, and a cell for each run.

    Args:
        found: run → what `figures_of` has of it.
    """
    names = next(iter(found.values()))
    return [[name, *(_text(name, each[name]) for each in found.values())] for name in names]


def _text(name: str, value: float | None) -> str:
    return f"{value:.1f}" if name == "minutes" and value is not None else share(value)


@click.command()
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Figures of all runs.")
def main(runs: tuple[Path, ...], output: Path | None) -> None:
    """Print the number of the best run."""
    found = figures_of(runs)
    if output is not None:
        write_json(output, {run.name: each for run, each in found.items()})
    click.echo(best_of(found).name.removeprefix("seed"))


if __name__ == "__main__":
    main()
