"""The learning curve of the listener: the same run on more and more homes, measured on the same others.

    python -m benchmarks.listener_curve data/train -o runs/curve --homes 12 --homes 24 --homes 47 \\
        --test data/open-s34-o7-sh3d --scores docs/results --picture docs/images/listener-curve.png \\
        -- --picture-steps 1300 --steps 3300

What follows ``--`` goes to `avs3d train listener`. Homes of a smaller number are among those of a larger one, and the
homes kept for validation are the same; every run takes the same number of steps. The frames of the shards are decoded
once. Writes ``listener-curve.json``: for each number of homes the figures of the validation at the end of the run, and
the scores of the row in 2D of each dataset. A run that is finished is not repeated.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.files import read_json, write_bytes, write_json
from avs3d_bench.parallel import available_cores
from baselines.listener.card import CARD_JSON, WEIGHTS
from baselines.listener.shards import read_store
from baselines.listener.steps import PROGRESS
from baselines.listener.training import CACHE
from benchmarks.listener_tables import ROWS, Plan, labelled, run_row

CURVE_JSON = "listener-curve.json"
#: Figures that are drawn, and what they are called.
DRAWN = {
    "class_iou": "classes of pixels, IoU",
    "category_iou": "category that is heard, IoU",
    "iou": "what sounds, IoU",
    "pair_accuracy": "pair accuracy",
}
#: Figures of a test set: protocol and name.
SCORED = (("strict", "IoU"), ("listen", "IoU"), ("listen", "pair_accuracy"))


def last_validation(folder: Path) -> dict[str, float | None]:
    """The figures at the end of a run."""
    lines = [json.loads(line) for line in (folder / PROGRESS).read_text().splitlines()]
    found = [line for line in lines if line["event"] == "validation"][-1]
    return {name: value for name, value in found.items() if name not in ("event", "step", "seconds")}


def make_run(data: Path, folder: Path, homes: int, options: Sequence[str]) -> None:
    """Train on a number of homes; go on if the run was stopped.

    Raises:
        Avs3dError: if the training failed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / CACHE).is_symlink():
        (folder / CACHE).symlink_to(os.path.relpath(folder.parent / CACHE, folder), target_is_directory=True)
    if (folder / WEIGHTS).exists():
        return
    command = [sys.executable, "-m", "benchmarks.listener_training", "--data", str(data), "-o", str(folder)]
    ended = subprocess.run([*command, "--homes", str(homes), *options], check=False)
    if ended.returncode or not (folder / WEIGHTS).exists():
        raise Avs3dError(f"{folder}: the training ended without weights (exit code {ended.returncode}); see above")


def point(folder: Path, tests: Mapping[str, Path], plan: Plan) -> dict[str, Any]:
    """What one run is worth."""
    card = read_json(folder / CARD_JSON)
    found: dict[str, Any] = {
        "homes": card["data"]["training_homes"],
        "steps": card["training"]["steps"],
        "minutes": card["training"]["minutes"],
        "devices": card["training"]["devices"],
        "validation_homes": card["data"]["validation_homes"],
        "weights": card["weights"]["sha256"],
        "validation": last_validation(folder),
        "tests": {},
    }
    for label, root in tests.items():
        dataset = Dataset(root)
        run_row(label, dataset, ROWS["2d"], plan)
        scores = read_json(plan.scores(label, ROWS["2d"]))
        found["tests"][label] = {
            part: {
                f"{protocol}.{name}": value
                for protocol, name in SCORED
                if (value := (group.get(protocol) or {}).get(name)) is not None
            }
            for part, group in scores["parts"].items()
        }
    return found


def table(points: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines of a Markdown table: a row for each number of homes."""
    tests = sorted({(label, part, name) for point in points for label, parts in point["tests"].items()
                    for part, figures in parts.items() for name in figures})  # fmt: skip
    head = ["homes", *DRAWN.values(), *(f"{label}, {part}: {name.replace('.', ' ')}" for label, part, name in tests)]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for one in points:
        values = [one["validation"].get(name) for name in DRAWN]
        values += [one["tests"].get(label, {}).get(part, {}).get(name) for label, part, name in tests]
        shown = ("–" if value is None else f"{value:.3f}" for value in values)
        lines.append(f"| {one['homes']} | {' | '.join(shown)} |")
    return lines


def draw(points: Sequence[Mapping[str, Any]]) -> bytes:
    """The PNG: figures of the validation homes over the number of homes, on a logarithmic axis."""
    from evaluators.reporting.tables_plot import COLOURS, encode, new_figure, style

    with style():
        figure = new_figure(6.4, 3.6)
        axes = figure.subplots()
        homes = [one["homes"] for one in points]
        for (name, title), colour in zip(DRAWN.items(), COLOURS, strict=False):
            values = [one["validation"].get(name) for one in points]
            axes.plot(homes, [float("nan") if v is None else v for v in values], "o-", color=colour, label=title)
        axes.set_xscale("log")
        axes.set_xticks(homes, [str(number) for number in homes])
        axes.set_xticks([], minor=True)
        axes.set_ylim(0, 1)
        axes.grid(axis="y")
        axes.set_xlabel("homes that were learnt from")
        axes.legend(frameon=False, loc="upper left", ncols=2)
        return encode(figure, "png", {"Software": None})


@click.command()
@click.argument("data", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="Folder of the runs.")
@click.option("--homes", type=click.IntRange(1), multiple=True, required=True, help="Number of homes; repeatable.")
@click.option("--test", "tests", multiple=True, metavar="[LABEL=]ROOT", help="Dataset for the row in 2D; repeatable.")
@click.option("--device", default="cpu", show_default=True, help="Of the rows in 2D.")
@click.option("--scores", type=click.Path(path_type=Path), default=None, help="Folder of listener-curve.json [OUTPUT].")
@click.option("--picture", type=click.Path(path_type=Path), default=None, help="Draw the curve as a PNG.")
@click.argument("options", nargs=-1)
def main(
    data: Path,
    output: Path,
    homes: tuple[int, ...],
    tests: tuple[str, ...],
    device: str,
    scores: Path | None,
    picture: Path | None,
    options: tuple[str, ...],
) -> None:
    """Train on several numbers of homes, and write what each is worth."""
    try:
        read_store(data, output / CACHE)
        points = []
        for number in sorted(set(homes)):
            folder = output / f"homes-{number}"
            make_run(data, folder, number, options)
            weights = (folder / WEIGHTS).absolute()
            digest = read_json(folder / CARD_JSON)["weights"]["sha256"]
            plan = Plan(folder / "scores", folder / "work", weights, digest, "category", (device,), available_cores(),
                        iterations=0, max_gaussians=None, only=())  # fmt: skip
            points.append(point(folder, labelled(tests), plan))
            write_json((scores or output) / CURVE_JSON, {"options": list(options), "points": points})
        click.echo("\n".join(table(points)))
        if picture is not None:
            write_bytes(picture, draw(points))
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None


if __name__ == "__main__":
    # The module under its own name: worker processes find `_predict` there.
    from benchmarks.listener_curve import main as _main

    _main()
