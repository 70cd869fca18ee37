"""The command `avs3d sweep-curve`."""

from __future__ import annotations

from pathlib import Path

import click

from avs3d_bench.commands.click_options import HELP, PATH
from avs3d_bench.commands.outputs import OUTPUT_FOLDER


@click.command(context_settings=HELP, short_help="Draw scores against a parameter of a sweep.")
@click.argument("scores", nargs=-1, required=True, type=PATH, metavar="SCORES.json…")
@click.option(
    "-o", "--output", "folder", type=OUTPUT_FOLDER, metavar="DIR", required=True, help="Folder for the curves."
)
@click.option("--over", default=None, metavar="FIELD", help="The parameter [the only one that varies].")
@click.option(
    "--figure", "figures", multiple=True, metavar="PROTOCOL.NAME",
    help="A figure, e.g. strict.IoU; repeatable [pair accuracy, IoU, mIoU].",
)  # fmt: skip
@click.option("--plot/--no-plot", default=True, show_default=True, help="Draw a PNG too; needs matplotlib.")
def sweep_curve(scores: tuple[Path, ...], folder: Path, over: str | None, figures: tuple[str, ...], plot: bool) -> None:
    """Draw the scores of methods (avs3d-eval --json) against a parameter of a sweep.

    The files are scores on one dataset, generated from a manifest that avs3d sweep wrote. Writes curve.png, curve.csv
    and curve.md.
    """
    from evaluators.reporting.sweep_files import write_sweep

    for path in write_sweep(folder, scores, over=over, figures=figures, plot=plot):
        click.echo(str(path))
