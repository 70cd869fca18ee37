"""Calibrate weights of the listener that are there, as a training does at its end (docs/listener-training.md).

    python -m benchmarks.listener_calibration WEIGHTS --calibrate-on SHARDS -o FOLDER [--accelerator cuda] [--cache DIR]

FOLDER gets ``listener.safetensors`` with the same network and the new numbers, its sha256, and ``calibration.json``:
what was chosen, and the figures by which. If the folder of WEIGHTS has their model card, FOLDER gets it, with these
figures in place of its own. Decoded frames lie in ``FOLDER/calibration``, which may be deleted, or in DIR, which
several calibrations share. A FOLDER that is not empty is refused.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from avs3d_bench.cli import run
from avs3d_bench.commands.outputs import OUTPUT_FOLDER, PATH
from avs3d_bench.errors import UsageError
from avs3d_bench.formats.files import read_json, write_json


@click.command()
@click.argument("weights", type=PATH)
@click.option("--calibrate-on", required=True, type=PATH, metavar="SHARDS", help="Homes for validation.")
@click.option("-o", "--output", required=True, type=OUTPUT_FOLDER, metavar="FOLDER", help="New or empty.")
@click.option("--accelerator", type=click.Choice(["cpu", "cuda"]), default="cpu", show_default=True)
@click.option("--cache", type=OUTPUT_FOLDER, metavar="DIR", help="Decoded frames. [default: FOLDER/calibration]")
@click.option("--workers", type=click.IntRange(1), help="Processes that read shards. [default: one a core]")
def main(
    weights: Path, calibrate_on: Path, output: Path, accelerator: str, cache: Path | None, workers: int | None
) -> None:
    """Calibrate weights of the listener on homes for validation."""
    from baselines.listener.calibration import calibrate
    from baselines.listener.card import CARD_JSON, write_card
    from baselines.listener.job import make_fabric
    from baselines.listener.training import CALIBRATION, prepare
    from baselines.listener.weights import read_weights, save_weights

    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise UsageError(f"{output}: not empty; expected a new or an empty folder")
    fabric = make_fabric(accelerator, "32-true")
    loaded = read_weights(weights, device=fabric.device)
    store = prepare(calibrate_on, cache or output / CALIBRATION, fabric, workers=workers, progress=True)
    chosen, figures = calibrate(loaded.network, store, fabric, every_home=True)
    digest = save_weights(loaded.network, output / "listener.safetensors", chosen)
    beside = weights.parent / CARD_JSON
    card = read_json(beside) if beside.exists() else {}
    if card.get("weights", {}).get("sha256") == loaded.digest:
        card["weights"]["sha256"] = digest
        command = f"python -m benchmarks.listener_calibration {weights} --calibrate-on {calibrate_on} -o {output}"
        card["calibration"] = {**asdict(chosen), "command": command, "figures": figures}
        write_card(output, card)
    write_json(
        output / "calibration.json",
        {"weights": loaded.digest, "sha256": digest, "calibration": asdict(chosen), "figures": figures},
    )
    click.echo(f"{output / 'listener.safetensors'}: {chosen}; calibration error {figures['error']:.3f}")


if __name__ == "__main__":
    run(main, program="listener_calibration")
