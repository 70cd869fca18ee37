"""`python -m benchmarks.results ROOT -o DIR`: EchoSegnet on a GPU, every row of docs/results.md, as files of scores.

Trains each observation once, then lifts, refines and draws with every combination of masks and variant, sweeps the
voting threshold on one observation, scores everything, and writes `training.json` (PSNR of test views, minutes, sizes,
hardware) beside the scores.
"""

from __future__ import annotations

import json
import platform
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import click
import numpy as np

from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.files import write_json
from avs3d_bench.parallel import process_each

#: File → (instance of the oracle's masks, variant, refined by sound).
RUNS = {
    "ambiguous-no-aisrm": ("category", "official", False),
    "ambiguous-official": ("category", "official", True),
    "ambiguous-spatial": ("category", "spatial", True),
    "sounding-no-aisrm": ("sounding", "official", False),
    "sounding-official": ("sounding", "official", True),
    "sounding-spatial": ("sounding", "spatial", True),
}


def train_some(root: Path, work: Path, iterations: int, share: tuple[str, tuple[str, ...]]) -> list[dict[str, object]]:
    """Train the observations of one device; what each took."""
    import torch

    from baselines.echosegnet.cache import Stages
    from baselines.echosegnet.pictures import view_psnr
    from baselines.echosegnet.pipeline import trained
    from baselines.echosegnet.rasterise import default_rasteriser
    from baselines.echosegnet.train import TrainingSettings
    from baselines.echosegnet.views import load_views, test_views, train_views

    device, keys = share
    rasteriser = default_rasteriser(device)
    out: list[dict[str, object]] = []
    for key in keys:
        views = load_views(Observation(root, key))
        start = time.perf_counter()
        said: list[tuple[int, float, float]] = []
        gaussians, _ = trained(
            Observation(root, key), views, rasteriser, TrainingSettings(iterations=iterations), Stages(work / key),
            lambda report, said=said, start=start: said.append(  # type: ignore[misc]
                (report.iteration, round(time.perf_counter() - start, 1), round(report.psnr, 2))
            ),
        )  # fmt: skip
        seconds = time.perf_counter() - start
        test = view_psnr(gaussians, test_views(views), rasteriser)
        train = view_psnr(gaussians, train_views(views)[::8], rasteriser)
        peak = torch.cuda.max_memory_allocated(rasteriser.device) / 2**30 if rasteriser.device.type == "cuda" else 0.0
        out.append(
            {
                "key": key, "seconds": round(seconds, 1), "gaussians": len(gaussians),
                "test_psnr": [round(value, 2) for value in test], "train_psnr": [round(value, 2) for value in train],
                "median_test_psnr": round(float(np.median(test)), 2), "peak_gib": round(peak, 2),
                "history": said[:: max(1, len(said) // 12)],
            }
        )  # fmt: skip
        print(json.dumps({k: v for k, v in out[-1].items() if k != "history"}), flush=True)
    return out


@click.command()
@click.argument("root", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
@click.option("--work", type=click.Path(path_type=Path), required=True)
@click.option("--iterations", default=30_000, show_default=True)
@click.option("--only", multiple=True)
@click.option("--sweep", default=None, help="Key of the observation of Table 3.")
@click.option("--train-only", is_flag=True, help="Stop after the training.")
@click.option("--runs", multiple=True, default=tuple(RUNS), show_default=True)
def main(
    root: Path,
    output: Path,
    work: Path,
    iterations: int,
    only: tuple[str, ...],
    sweep: str | None,
    runs: tuple[str, ...],
    train_only: bool,
) -> None:
    """Run everything on the observations of ROOT."""
    import torch

    from baselines.echosegnet.pipeline import Settings
    from baselines.echosegnet.run import all_devices, write_echosegnet, write_sweep
    from baselines.echosegnet.sources import OracleMasks
    from baselines.echosegnet.train import TrainingSettings
    from evaluators import evaluate

    dataset, devices = Dataset(root), all_devices()
    keys = [observation.key for observation in dataset.select(*only)]
    shares = [(device, tuple(keys[start :: len(devices)])) for start, device in enumerate(devices)]
    shares = [share for share in shares if share[1]]
    start = time.perf_counter()
    found = process_each(partial(train_some, root, work, iterations), shares, workers=len(shares))
    trained = sorted((entry for _, entries in found for entry in entries), key=lambda entry: str(entry["key"]))
    record: dict[str, object] = {
        "hardware": torch.cuda.get_device_name() if torch.cuda.is_available() else platform.processor(),
        "devices": len(devices), "torch": torch.__version__, "iterations": iterations, "observations": trained,
        "training_seconds": round(time.perf_counter() - start, 1),
        "median_test_psnr": float(np.median([entry["median_test_psnr"] for entry in trained])),  # type: ignore[arg-type]
    }  # fmt: skip
    write_json(output / "training.json", record)
    if train_only:
        return
    settings = Settings(training=TrainingSettings(iterations=iterations))
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
        parts = {
            part: (round(group.official.mIoU, 3), round(group.strict.IoU or 0, 3), group.strict.wrong_instance_rate)
            for part, group in scores.parts.items()
            if group.official and group.strict
        }
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
    main()
