"""EchoSegnet over a dataset: one submission, or one per voting threshold; one observation at a time on every device."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import torch

from avs3d_bench.cli import missing_extra
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.provenance import provenance
from avs3d_bench.scheduling.errors import UnfitError
from avs3d_bench.scheduling.options import Options, scheduler_of
from avs3d_bench.scheduling.software import check_software
from avs3d_bench.scheduling.tasks import Context, Event, Failure, Task
from avs3d_bench.schema import Scalar
from avs3d_bench.submission import SubmissionFolder, SubmissionWriter
from baselines.echosegnet.pipeline import Settings, predict
from baselines.echosegnet.rasterise import Rasteriser, default_rasteriser
from baselines.echosegnet.sources import MaskSource
from baselines.echosegnet.train import Report

#: What makes a prediction (see `avs3d_bench.provenance`).
METHOD = (
    "baselines.echosegnet.pipeline:predict",
    "baselines.echosegnet.sources:mask_source",
    "avs3d_bench.submission:SubmissionFolder",
)
#: The voting thresholds of the paper's Table 3.
SWEEP = tuple(round(0.1 * step, 1) for step in range(9, 0, -1))


#: An observation takes minutes; one that takes longer than this hangs, seconds.
LIMIT = 6 * 3600.0


@dataclass(frozen=True)
class Job:
    """One observation.

    Attributes:
        root: the dataset's folder.
        key: of the observation.
        targets: settings → where their masks and points go.
        source: of the train frames' masks.
        work: folder of intermediate results.
        devices: what the tasks of a machine share, e.g. ``("cuda:0", "cuda:1")``; empty: every device it has.
        software: versions that a worker must have; empty where workers are processes of this machine.
    """

    root: Path
    key: str
    targets: tuple[tuple[Settings, SubmissionFolder], ...]
    source: MaskSource
    work: Path
    devices: tuple[str, ...]
    software: tuple[tuple[str, str], ...] = ()


def software() -> dict[str, str]:
    """Name → version of the software that a prediction depends on, with the digest of its sources."""
    return provenance(*METHOD).versions


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
    scheduling: Options | None = None,
) -> SubmissionWriter:
    """Run EchoSegnet and write its submission.

    Args:
        dataset: what to look at.
        path: the submission's folder.
        source: of the train frames' 2D masks.
        settings: of the pipeline.
        work: folder of intermediate results; a second run with other settings reuses what they do not change.
        devices: of this machine, e.g. ``("cuda:0", "cuda:1")``: one process each; with one device and no time limit,
            in this process. Dask workers use the devices that they have.
        only: shell patterns of observation keys.
        overwrite: take the place of a submission that stands there.
        progress: report on stderr.
        scheduling: where it runs; None: here.

    Raises:
        UsageError: if no observation matches, the target is not free, or a device does not exist.
        Avs3dError: if something that the pipeline needs is missing, damaged or too large.
    """
    writer = _writer(dataset, path, source, settings, only, overwrite)
    with writer:
        figures = _run(
            writer.observations, dataset, ((settings, writer.folder),), source, work, devices, progress, scheduling
        )
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
    scheduling: Options | None = None,
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
                scheduling=scheduling,
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
    scheduling: Options | None,
) -> list[dict[str, Scalar]]:
    options = scheduling or Options()
    here = options.address is None and options.jobqueue is None
    if here:
        for device in devices:
            default_rasteriser(device)  # a device that is not there is named before anything starts
    mine = tuple(devices) if here else ()
    wanted = () if here else tuple(software().items())
    jobs = [
        Job(dataset.root.absolute(), observation.key, targets, source, Path(work).absolute(), mine, wanted)
        for observation in observations
    ]

    def say(kind: str, text: str) -> None:
        if progress:
            print("  ".join(filter(None, (kind, text))), file=sys.stderr)

    if not options.remote and len(devices) == 1 and options.time_limit is None:
        return [predict_one(Context(0, lambda _, text: say("", text)), job) for job in jobs]

    def listen(event: Event) -> None:
        say("" if event.kind in ("training", "done") else event.kind, event.text)

    tasks = [Task(job.key, predict_one, (job,), limit=options.limit(LIMIT)) for job in jobs]
    figures: list[dict[str, Scalar]] = []
    failed: list[Failure] = []
    gpus = any(device != "cpu" for device in devices)
    with scheduler_of(options, min(len(devices), len(jobs)), gpus=gpus) as pool:
        results = pool.run(tasks, options.policy(one_thread=False), listen)
        with closing(results):
            for result in results:
                if isinstance(result, Failure):
                    failed.append(result)
                    say("failed", f"{result.task.name}: {result.message}")
                    if options.max_failures is not None and len(failed) > options.max_failures:
                        break
                else:
                    figures.append(result.value)
    if failed:
        more = f" (and {len(failed) - 1} more)" if len(failed) > 1 else ""
        text, key = failed[0].message, failed[0].task.name
        raise Avs3dError((text if key in text else f"{key}: {text}") + more)
    return figures


def predict_one(context: Context, job: Job) -> dict[str, Scalar]:
    """Predict an observation on the device of the task's slot and write it; its figures."""
    try:
        if job.software:
            check_software(software(), dict(job.software))
        devices = job.devices or all_devices()
        rasteriser = _rasteriser(devices[context.slot % len(devices)])
        observation = Observation(job.root, job.key)
        figures: dict[str, Scalar] = {}
        for settings, folder in job.targets:
            say = partial(_say, context, job.key, set())
            prediction = predict(observation, job.source, rasteriser, settings, job.work / job.key, progress=say)
            for frame in observation.test:
                folder.write_mask(frame, prediction.masks[frame.name])
            folder.write_points(observation, prediction.points)
            figures = {"key": job.key, **prediction.figures}
            said = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in prediction.figures.items())
            context.report("done", f"{job.key}: {said}")
        return figures
    except ModuleNotFoundError as error:
        raise UnfitError(missing_extra(error, "baselines")) from error
    except Avs3dError as error:
        text = str(error)
        raise type(error)(text if job.key in text else f"{job.key}: {text}") from None


@lru_cache(maxsize=1)
def _rasteriser(device: str) -> Rasteriser:
    return default_rasteriser(device)


#: Iterations between two lines of progress.
_SAID_EVERY = 5_000


def _say(context: Context, key: str, told: set[str], report: Report) -> None:
    if report.full_at is not None and key not in told:
        told.add(key)
        context.report(
            "note",
            f"{key}: the device's memory is nearly used: growth ended at iteration {report.full_at:,} with "
            f"{report.gaussians:,} Gaussians",
        )
    if report.iteration % _SAID_EVERY == 0 or report.iteration == report.iterations:
        context.report(
            "training",
            f"{key}: iteration {report.iteration:,} of {report.iterations:,}, loss {report.loss:.4f}, "
            f"{report.psnr:.1f} dB, {report.gaussians:,} Gaussians",
        )
