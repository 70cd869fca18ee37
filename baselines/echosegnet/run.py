"""EchoSegnet over a dataset: one submission, or one per voting threshold; one process per device."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch

from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.parallel import process_each
from avs3d_bench.schema import Scalar
from avs3d_bench.submission import SubmissionFolder, SubmissionWriter
from baselines.echosegnet.pipeline import Settings, predict
from baselines.echosegnet.rasterise import default_rasteriser
from baselines.echosegnet.sources import MaskSource
from baselines.echosegnet.train import Report

#: The voting thresholds of the paper's Table 3.
SWEEP = tuple(round(0.1 * step, 1) for step in range(9, 0, -1))


@dataclass(frozen=True)
class Job:
    """One device's share of the work.

    Attributes:
        device: e.g. ``cuda:1``.
        root: the dataset's folder.
        keys: of its observations.
        targets: settings → where their masks and points go.
        source: of the train frames' masks.
        work: folder of intermediate results.
        verbose: report training on stderr.
    """

    device: str
    root: Path
    keys: tuple[str, ...]
    targets: tuple[tuple[Settings, SubmissionFolder], ...]
    source: MaskSource
    work: Path
    verbose: bool


def all_devices() -> tuple[str, ...]:
    """Every CUDA device, else the CPU."""
    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    return tuple(f"cuda:{index}" for index in range(count)) or ("cpu",)


def method_name(settings: Settings, source: MaskSource) -> str:
    """E.g. ``EchoSegnet, spatial, masks: oracle (category)``."""
    kind = settings.variant if settings.refine else f"{settings.variant} without AISRM"
    return f"EchoSegnet, {kind}, masks: {source.name}"


def runtime_of(settings: Settings, source: MaskSource) -> dict[str, Scalar]:
    """What `avs3d tables` needs to know of a submission."""
    return {
        "method": "echosegnet",
        "variant": settings.variant,
        "aisrm": settings.refine,
        "masks": source.name,
        "voting_threshold": settings.voting_threshold,
        "iterations": settings.training.iterations,
        "seed": settings.training.seed,
    }


def write_echosegnet(
    dataset: Dataset,
    path: str | Path,
    source: MaskSource,
    settings: Settings,
    *,
    work: str | Path,
    devices: Sequence[str],
    only: Iterable[str] = (),
    overwrite: bool = False,
    progress: bool = False,
) -> SubmissionWriter:
    """Run EchoSegnet and write its submission.

    Args:
        dataset: what to look at.
        path: the submission's folder.
        source: of the train frames' 2D masks.
        settings: of the pipeline.
        work: folder of intermediate results; a second run with other settings reuses what they do not change.
        devices: e.g. ``("cuda:0", "cuda:1")``: one process each; with one device, in this process.
        only: shell patterns of observation keys.
        overwrite: take the place of a submission that stands there.
        progress: report on stderr.

    Raises:
        UsageError: if no observation matches, the target is not free, or a device does not exist.
        Avs3dError: if something that the pipeline needs is missing, damaged or too large.
    """
    writer = _writer(dataset, path, source, settings, only, overwrite)
    with writer:
        figures = _run(writer.observations, dataset, ((settings, writer.folder),), source, work, devices, progress)
        seconds = sum(float(figure[name] or 0) for figure in figures for name in figure if name.endswith("_seconds"))
        writer.set_runtime(runtime_of(settings, source) | {"seconds": round(seconds, 1)})
    return writer


def write_sweep(
    dataset: Dataset,
    path: str | Path,
    source: MaskSource,
    settings: Settings,
    *,
    thresholds: Sequence[float] = SWEEP,
    work: str | Path,
    devices: Sequence[str],
    only: Iterable[str] = (),
    overwrite: bool = False,
    progress: bool = False,
) -> tuple[SubmissionWriter, ...]:
    """One submission per voting threshold, ``<path>/voting-threshold-0.3`` and so on; else as `write_echosegnet`."""
    writers = []
    for threshold in thresholds:
        mine = replace(settings, voting_threshold=threshold)
        target = Path(path) / f"voting-threshold-{threshold:g}"
        writers.append(
            write_echosegnet(
                dataset, target, source, mine,
                work=work, devices=devices, only=only, overwrite=overwrite, progress=progress,
            )
        )  # fmt: skip
    return tuple(writers)


def _writer(
    dataset: Dataset, path: str | Path, source: MaskSource, settings: Settings, only: Iterable[str], overwrite: bool
) -> SubmissionWriter:
    training = settings.training
    notes = (
        f"{settings.variant} variant; AISRM {'on' if settings.refine else 'off'}; voting threshold "
        f"{settings.voting_threshold:g}; {training.iterations} iterations, seed {training.seed}; "
        f"masks of train frames: {source.name}"
    )
    if source.name.startswith("oracle"):
        notes += "; uses the ground truth of train frames"
    return SubmissionWriter(
        path, dataset, method=method_name(settings, source), notes=notes, only=tuple(only), overwrite=overwrite
    )


def _run(
    observations: Sequence[Observation],
    dataset: Dataset,
    targets: tuple[tuple[Settings, SubmissionFolder], ...],
    source: MaskSource,
    work: str | Path,
    devices: Sequence[str],
    progress: bool,
) -> list[dict[str, Scalar]]:
    keys = [observation.key for observation in observations]
    for device in devices:
        default_rasteriser(device)  # a device that is not there is named before anything starts
    jobs = [
        Job(device, dataset.root, tuple(keys[start :: len(devices)]), targets, source, Path(work), progress)
        for start, device in enumerate(devices)
        if keys[start :: len(devices)]
    ]
    done = process_each(run_job, jobs, workers=len(jobs), label="EchoSegnet")
    return [figure for _, figures in done for figure in figures]


def run_job(job: Job) -> list[dict[str, Scalar]]:
    """Predict the job's observations on its device and write them; figures of each."""
    rasteriser = default_rasteriser(job.device)
    figures = []
    for key in job.keys:
        observation = Observation(job.root, key)
        for settings, folder in job.targets:
            say = partial(_say, key) if job.verbose else None
            try:
                prediction = predict(observation, job.source, rasteriser, settings, job.work / key, progress=say)
            except Avs3dError as error:
                text = str(error)
                raise type(error)(text if key in text else f"{key}: {text}") from None
            for frame in observation.test:
                folder.write_mask(frame, prediction.masks[frame.name])
            folder.write_points(observation, prediction.points)
            figures.append({"key": key, **prediction.figures})
            if job.verbose:
                _report(key, prediction.figures)
    return figures


#: Iterations between two lines of progress.
_SAID_EVERY = 5_000


def _say(key: str, report: Report) -> None:
    if report.iteration % _SAID_EVERY == 0 or report.iteration == report.iterations:
        print(
            f"{key}: iteration {report.iteration:,} of {report.iterations:,}, loss {report.loss:.4f}, "
            f"{report.psnr:.1f} dB, {report.gaussians:,} Gaussians",
            file=sys.stderr,
        )


def _report(key: str, figures: dict[str, Scalar]) -> None:
    said = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in figures.items())
    print(f"{key}: {said}", file=sys.stderr)
