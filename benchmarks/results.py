"""`python -m benchmarks.results ROOT -o DIR`: runs EchoSegnet on a GPU and writes the scores of docs/results.md.

Trains each observation once (both variants share the training), then lifts, refines and draws with every combination
of masks and variant, sweeps the voting threshold on one observation, scores everything, and writes `training.json`
(PSNR of test views, minutes, sizes, memory, hardware) beside the scores. Results that are already in ``--work`` are not
computed again: a stopped run continues, and a stopped training continues from its last checkpoint.
"""

from __future__ import annotations

import json
import platform
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_json, write_json
from avs3d_bench.scheduling.tasks import Context
from baselines.echosegnet.schedule import TrainingSettings

#: File → (instance of the oracle's masks, variant, refined by sound).
RUNS = {
    "ambiguous-no-aisrm": ("category", "official", False),
    "ambiguous-official": ("category", "official", True),
    "ambiguous-spatial": ("category", "spatial", True),
    "sounding-no-aisrm": ("sounding", "official", False),
    "sounding-official": ("sounding", "official", True),
    "sounding-spatial": ("sounding", "spatial", True),
}


@dataclass(frozen=True)
class TrainJob:
    """The training of one observation.

    Attributes:
        root: the dataset's folder.
        key: of the observation.
        work: folder of intermediate results.
        settings: of the training.
        devices: of the machine's workers.
    """

    root: Path
    key: str
    work: Path
    settings: TrainingSettings
    devices: tuple[str, ...]


def train_one(context: Context, job: TrainJob) -> dict[str, Any]:
    """Train an observation, evaluate it on its test views, and store the record of both beside the Gaussians."""
    import torch

    from baselines.echosegnet.cache import Stages
    from baselines.echosegnet.heard_categories import work_folder
    from baselines.echosegnet.jobs import device_of
    from baselines.echosegnet.pictures import view_psnr
    from baselines.echosegnet.train import TrainingState
    from baselines.echosegnet.training_stage import trained
    from baselines.echosegnet.views import load_views, test_views, train_views

    rasteriser = device_of(context, job.devices)
    observation = Observation(job.root, job.key)
    views, stages = load_views(observation), Stages(work_folder(job.work, observation))
    start = time.perf_counter()
    said: list[tuple[int, float, float, int]] = []

    def say(report: TrainingState) -> None:
        said.append((report.iteration, round(time.perf_counter() - start, 1), round(report.psnr, 2), report.gaussians))
        if report.iteration % 5_000 == 0:
            context.report("training", f"{job.key}: {report.iteration:,}, {report.psnr:.1f} dB, {report.gaussians:,}")

    gaussians, key, full_at = trained(observation, views, rasteriser, job.settings, stages, say)
    seconds = time.perf_counter() - start
    record = stages.path("trained", key, ".json")
    if not said and record.exists():
        found: dict[str, Any] = read_json(record)
        return found
    test = view_psnr(gaussians, test_views(views), rasteriser)
    train = view_psnr(gaussians, train_views(views)[::8], rasteriser)
    peak = torch.cuda.max_memory_allocated(rasteriser.device) / 2**30 if rasteriser.device.type == "cuda" else 0.0
    out: dict[str, Any] = {
        "key": job.key, "seconds": round(seconds, 1), "gaussians": len(gaussians), "memory_full_at": full_at,
        "test_psnr": [round(value, 2) for value in test], "train_psnr": [round(value, 2) for value in train],
        "median_test_psnr": round(float(np.median(test)), 2), "peak_gib": round(peak, 2),
        "history": said[:: max(1, len(said) // 12)],
    }  # fmt: skip
    write_json(record, out)
    context.report("done", json.dumps({name: value for name, value in out.items() if name != "history"}))
    return out


def train_all(
    dataset: Dataset, work: Path, settings: TrainingSettings, devices: tuple[str, ...], only: tuple[str, ...]
) -> dict[str, Any]:
    """Train every observation, but only one of siblings, and return the record for training.json.

    Raises:
        Avs3dError: if a training failed, after all others are done.
    """
    import torch

    from baselines.echosegnet.heard_categories import work_folder
    from baselines.echosegnet.jobs import run_each, spread
    from baselines.echosegnet.rasteriser.default import default_rasteriser

    # Siblings have the same pictures and the same folder.
    keys = list({work_folder(work, one): one.key for one in reversed(dataset.select(*only))}.values())[::-1]
    workers = spread(devices, len(keys))
    for device in dict.fromkeys(workers):
        default_rasteriser(device)
    start = time.perf_counter()
    jobs = [TrainJob(dataset.root.absolute(), key, work.absolute(), settings, workers) for key in keys]
    outcome = run_each(train_one, jobs, workers, progress=True)
    outcome.check(work)
    found = sorted(outcome.values, key=lambda entry: str(entry["key"]))
    return {
        "hardware": torch.cuda.get_device_name() if torch.cuda.is_available() else platform.processor(),
        "devices": len(set(devices)), "workers": len(workers), "torch": torch.__version__,
        "iterations": settings.iterations, "max_gaussians": settings.density.max_gaussians,
        "max_screen": settings.density.max_screen, "observations": found,
        "training_seconds": round(time.perf_counter() - start, 1),
        "median_test_psnr": float(np.median([entry["median_test_psnr"] for entry in found])),
    }  # fmt: skip


@click.command()
@click.argument("root", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
@click.option("--work", type=click.Path(path_type=Path), required=True)
@click.option("--iterations", default=30_000, show_default=True)
@click.option("--max-gaussians", type=int, default=None, help="A cap on the number of Gaussians [none].")
@click.option("--screen-pruning", is_flag=True, help="Apply the limit of 20 pixels that the reference names.")
@click.option("--device", "devices", multiple=True, help="As `avs3d baseline echosegnet`: repeat to share [all].")
@click.option("--only", multiple=True)
@click.option("--sweep", default=None, help="Key of the observation of Table 3.")
@click.option("--train-only", is_flag=True, help="Stop after the training.")
@click.option("--runs", multiple=True, default=tuple(RUNS), show_default=True)
def main(
    root: Path,
    output: Path,
    work: Path,
    iterations: int,
    max_gaussians: int | None,
    screen_pruning: bool,
    devices: tuple[str, ...],
    only: tuple[str, ...],
    sweep: str | None,
    runs: tuple[str, ...],
    train_only: bool,
) -> None:
    """Run everything on the observations of ROOT."""
    from baselines.echosegnet.densify import DensityControl
    from baselines.echosegnet.jobs import all_devices
    from baselines.echosegnet.pipeline import Settings
    from baselines.echosegnet.run import write_echosegnet, write_sweep
    from baselines.echosegnet.sources import OracleMasks
    from evaluators import evaluate

    dataset, devices = Dataset(root), devices or all_devices()
    density = DensityControl(max_gaussians=max_gaussians, max_screen=20.0 if screen_pruning else None)
    settings = Settings(training=TrainingSettings(iterations=iterations, density=density))
    try:
        record = train_all(dataset, work, settings.training, devices, only)
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    write_json(output / "training.json", record)
    if train_only:
        return
    times: dict[str, float] = {}
    for name in runs:
        instance, variant, refine = RUNS[name]
        begin = time.perf_counter()
        mine = replace(settings, variant=variant, refine=refine)  # type: ignore[arg-type]
        write_echosegnet(
            dataset, work / "submissions" / name, OracleMasks(instance), mine,  # type: ignore[arg-type]
            work=work, devices=devices, only=only, overwrite=True, progress=True,
        )  # fmt: skip
        times[name] = round(time.perf_counter() - begin, 1)
        scores = evaluate(work / "submissions" / name, root, only=only, workers=None).scores
        write_json(output / f"{name}.json", scores)
        parts: dict[str, tuple[float | None, ...]] = {
            part: (round(group.official.mIoU, 3), round(group.strict.IoU or 0, 3), group.strict.wrong_instance_rate)
            for part, group in scores.parts.items()
            if group.official and group.strict
        }
        if listen := scores.overall.listen:
            parts["listen"] = (listen.pair_accuracy, listen.IoU, listen.FP_rate, listen.class_mIoU)
        print(name, times[name], parts, flush=True)
    if sweep:
        write_sweep(
            dataset, work / "sweep", OracleMasks("sounding"), settings,
            work=work, devices=devices[:1], only=[sweep], overwrite=True,
        )  # fmt: skip
        for path in sorted((work / "sweep").iterdir()):
            write_json(output / f"{path.name}.json", evaluate(path, root, only=[sweep]).scores)
    write_json(output / "training.json", record | {"pipeline_seconds": times})


if __name__ == "__main__":
    # The module under its own name: worker processes find `train_one` there.
    from benchmarks.results import main as _main

    _main()
