"""The command `avs3d train`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from avs3d_bench.commands.click_options import PATH, WORKERS, Group
from avs3d_bench.commands.outputs import OUTPUT_FOLDER
from avs3d_bench.errors import UsageError

_PRECISION = {"bf16": "bf16-mixed", "fp32": "32-true"}
#: `baselines.listener.augment.CHANGES`, without the time that its import takes.
_CHANGES = (
    "disguise", "gain", "noise", "eq", "ears", "timing", "band", "codec", "decay", "clutter", "colour", "blur",
    "grain", "jpeg",
)  # fmt: skip
#: Epochs of a run that names neither steps nor epochs.
_EPOCHS = 30


@click.group(cls=Group, noun="network")
def train() -> None:
    """Train a network of this package."""


@train.command(short_help="The network that looks and listens.")
@click.option("--data", type=PATH, required=True, metavar="SHARDS", help="Folder with WebDataset shards.")
@click.option("-o", "--output", "folder", type=OUTPUT_FOLDER, required=True, metavar="DIR", help="Folder of the run.")
@click.option("--epochs", type=click.FloatRange(0, min_open=True), help=f"Passes over the pictures [{_EPOCHS}].")
@click.option("--steps", type=click.IntRange(1), help="Steps of the whole schedule, instead of --epochs.")
@click.option(
    "--picture-steps",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="How many steps, before those of --epochs, learn what is seen, without sound.",
)
@click.option(
    "--size",
    type=click.Choice(["lite", "small"]),
    help="Of the network: lite begins with an encoder of pictures that learnt from ImageNet; two CPU cores train the "
    "small one within hours [lite].",
)
@click.option("--weights", type=PATH, metavar="FILE", help="Trained weights to begin with [random ones].")
@click.option(
    "--dry", type=PATH, metavar="FILE", help="Dry sounds that half of the frames made --with rirs are dubbed with."
)
@click.option("--minutes", type=click.FloatRange(0, min_open=True), help="Stop after this time; run again to go on.")
@click.option("--stop-at", type=click.IntRange(1), metavar="STEP", help="Stop after this step; run again to go on.")
@click.option(
    "--batch-size", "batch", type=click.IntRange(1), default=256, show_default=True, help="Sounds per device."
)
@click.option("--rate", type=click.FloatRange(0, min_open=True), default=1.5e-3, show_default=True,
              help="Highest learning rate.")  # fmt: skip
@click.option(
    "--devices", type=click.IntRange(1), default=1, show_default=True, help="Number of GPUs, or of processes."
)
@click.option("--accelerator", type=click.Choice(["auto", "cpu", "cuda"]), default="auto", show_default=True)
@click.option("--precision", type=click.Choice(list(_PRECISION)), default="bf16", show_default=True)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option(
    "--homes", type=click.IntRange(1), metavar="N", help="Train on N of the homes, for learning curves [all]."
)
@click.option("--validate-every", type=click.IntRange(1), metavar="STEPS", help="[a tenth of the run]")
@click.option("--manifest", type=PATH, help="Manifest of the data, whose sha256 the model card names.")
@click.option("--compile", is_flag=True, help="Use torch.compile.")
@click.option(
    "--without", multiple=True, type=click.Choice(_CHANGES), help="Random change that is left out; repeatable."
)
@click.option(
    "--cache", type=OUTPUT_FOLDER, default=None, metavar="FOLDER",
    help="Decoded frames, which several runs on the same shards share [DIR/cache].",
)  # fmt: skip
@click.option(
    "--calibrate-on", type=PATH, metavar="SHARDS",
    help="Homes and voices for threshold and temperatures [the run's own validation homes].",
)  # fmt: skip
@click.option("--workers", type=WORKERS, default=None, help="Processes that read shards [one per core].")
def listener(
    data: Path, folder: Path, epochs: float | None, steps: int | None, manifest: Path | None, **chosen: Any
) -> None:
    """Train the listener, or go on with the run of DIR.

    Writes listener.safetensors and a model card into DIR when all steps are done. One line of JSON per report goes to
    stdout. A run that was killed goes on from its last checkpoint when it is started again with the same options.
    """
    if epochs is not None and steps is not None:
        raise UsageError("--epochs and --steps: expected one of them")
    if chosen["size"] and chosen["weights"]:
        raise UsageError("--size and --weights: the weights have a size; expected one of them")
    from baselines.listener.packages import require

    require("train")
    from baselines.listener.card import check_folder, check_manifest
    from baselines.listener.job import TrainingOptions, run_job

    check_manifest(manifest)
    check_folder(folder)
    job = TrainingOptions(data=data, folder=folder, epochs=epochs or _EPOCHS, steps=steps, manifest=manifest, **chosen)
    finished, step, total = run_job(job, _PRECISION[job.precision], progress=sys.stderr.isatty())
    if finished is None:
        return
    if not finished:
        click.echo(f"{folder}: stopped after step {step} of {total}; run the same command again to go on")
    else:
        click.echo(f"{folder}: {total} steps; weights in listener.safetensors, figures in model_card.md")
