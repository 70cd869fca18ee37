"""EchoSegnet over a dataset: one submission, or one per voting threshold; one observation at a time on every device."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Required, TypedDict, Unpack

from avs3d_bench.contract.schema import ProvenanceRecord, Scalar
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.imports import missing_extra
from avs3d_bench.runtime.provenance import Provenance, provenance
from avs3d_bench.scheduling.errors import UnfitError
from avs3d_bench.scheduling.options import Options
from avs3d_bench.scheduling.software import check_software
from avs3d_bench.scheduling.tasks import Context
from avs3d_bench.submission import SubmissionFolder, SubmissionWriter
from baselines.echosegnet.heard_categories import work_folder
from baselines.echosegnet.jobs import all_devices, device_of, run_each, spread
from baselines.echosegnet.network_masks import AnySource, NetworkMasks
from baselines.echosegnet.pipeline import Settings, is_relative, predict
from baselines.echosegnet.rasteriser.default import default_rasteriser
from baselines.echosegnet.train import TrainingState
from baselines.sound_control import named

__all__ = [
    "SWEEP",
    "ObservationJob",
    "all_devices",
    "method_name",
    "predict_one",
    "runtime_of",
    "write_echosegnet",
    "write_sweep",
]

#: The voting thresholds of the paper's Table 3.
SWEEP = tuple(round(0.1 * step, 1) for step in range(9, 0, -1))


@dataclass(frozen=True)
class ObservationJob:
    """One observation.

    Attributes:
        root: the dataset's folder.
        key: of the observation.
        targets: settings → where their masks and points go.
        source: of the train frames' masks.
        work: folder of intermediate results.
        devices: of the machine's workers (`jobs.spread`), e.g. ``("cuda:0", "cuda:1")``; empty: every device it has.
        software: versions that a worker must have; empty where workers are processes of this machine.
    """

    root: Path
    key: str
    targets: tuple[tuple[Settings, SubmissionFolder], ...]
    source: AnySource
    work: Path
    devices: tuple[str, ...]
    software: tuple[tuple[str, str], ...] = ()


def software(source: AnySource) -> dict[str, str]:
    """Name → version of the software that a prediction depends on, with the digest of its sources."""
    return _provenance(source).versions


def _provenance(source: AnySource) -> Provenance:
    return provenance("baselines.echosegnet", *([source.marker.entry] if isinstance(source, NetworkMasks) else []))


def method_name(settings: Settings, source: AnySource) -> str:
    """E.g. ``EchoSegnet, spatial, masks: oracle (category)``."""
    kind = settings.variant if settings.refine else f"{settings.variant} without AISRM"
    return named(f"EchoSegnet, {kind}, masks: {source.name}", settings.sound)


def runtime_of(settings: Settings, source: AnySource) -> dict[str, Scalar]:
    """The settings of a submission that `avs3d tables` reads."""
    return {
        "method": "echosegnet",
        "variant": settings.variant,
        "aisrm": settings.refine,
        "sound": settings.sound,
        "masks": source.name,
        "voting_threshold": settings.voting_threshold,
        "iterations": settings.training.iterations,
        "max_gaussians": settings.training.density.max_gaussians,
        "seed": settings.training.seed,
    }


def write_echosegnet(
    dataset: Dataset,
    path: str | Path,
    source: AnySource,
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
        devices: of this machine, e.g. ``("cuda:0", "cuda:1")``: one process each; one that is named twice works on two
            observations at a time. With one device and no time limit, in this process. Dask workers use the devices
            that they have.
        only: shell patterns of observation keys.
        overwrite: replace an existing submission.
        progress: report on stderr.
        scheduling: where it runs; None: here.

    Raises:
        UsageError: if no observation matches, the target is not free, or a device does not exist.
        Avs3dError: if something that the pipeline needs is missing, damaged or too large. The other observations are
            done all the same, and a rerun with the same ``work`` takes them from there.

    Examples:
        >>> from avs3d_bench import Dataset
        >>> from baselines.echosegnet.train import DensityControl, TrainingSettings
        >>> few = TrainingSettings(iterations=20, density=DensityControl(pixels_per_gaussian=20))  # for a trial
        >>> settings = Settings(variant="spatial", training=few)
        >>> dataset = Dataset("data/demo")
        >>> options = {"work": "work", "devices": ("cpu",), "only": ["part_1/*"]}
        >>> writer = write_echosegnet(dataset, "echosegnet", OracleMasks(), settings, **options)
        >>> writer.record.method
        'EchoSegnet, spatial, masks: oracle (category)'
    """
    writer = _writer(dataset, path, source, settings, only, overwrite)
    with writer:
        figures = _run(
            writer.observations, dataset, ((settings, writer.folder),), source, work, devices, progress, scheduling
        )
        seconds = sum(float(figure[name] or 0) for figure in figures for name in figure if name.endswith("_seconds"))
        grown = {
            "gaussians": max(int(figure["gaussians"] or 0) for figure in figures),
            "stopped_by_memory": sum(figure["memory_full_at"] is not None for figure in figures),
        }
        writer.set_runtime(runtime_of(settings, source) | grown | {"seconds": round(seconds, 1)})
    return writer


class RunOptions(TypedDict, total=False):
    """Where and how a run does its work; see `write_echosegnet`."""

    work: Required[str | Path]
    devices: Required[Sequence[str]]
    only: Iterable[str]
    overwrite: bool
    progress: bool
    scheduling: Options | None


def write_sweep(
    dataset: Dataset,
    path: str | Path,
    source: AnySource,
    settings: Settings,
    *,
    thresholds: Sequence[float] = SWEEP,
    **options: Unpack[RunOptions],
) -> tuple[SubmissionWriter, ...]:
    """One submission per voting threshold, ``<path>/voting-threshold-0.3`` and so on; else as `write_echosegnet`.

    Args:
        dataset: what to look at.
        path: the folder of the submissions.
        source: of the train frames' 2D masks.
        settings: of the pipeline, but for the threshold.
        thresholds: shares of votes, from 0 to below 1.
        options: ``work``, ``devices``, … of `write_echosegnet`.

    Returns:
        The writers, in the order of the thresholds.

    Raises:
        UsageError, Avs3dError: see `write_echosegnet`.

    Examples:
        >>> from avs3d_bench import Dataset
        >>> from baselines.echosegnet.train import DensityControl, TrainingSettings
        >>> few = TrainingSettings(iterations=20, density=DensityControl(pixels_per_gaussian=20))  # for a trial
        >>> options = {"work": "work", "devices": ("cpu",), "only": ["part_1/*"]}
        >>> writers = write_sweep(
        ...     Dataset("data/demo"), "sweep", OracleMasks(), Settings(training=few), thresholds=(0.3, 0.5), **options
        ... )
        >>> [writer.path.name for writer in writers]
        ['voting-threshold-0.3', 'voting-threshold-0.5']
    """
    writers = []
    for threshold in thresholds:
        mine = replace(settings, voting_threshold=threshold)
        target = Path(path) / f"voting-threshold-{threshold:g}"
        writers.append(write_echosegnet(dataset, target, source, mine, **options))
    return tuple(writers)


def _writer(
    dataset: Dataset,
    path: str | Path,
    source: AnySource,
    settings: Settings,
    only: Iterable[str],
    overwrite: bool,
) -> SubmissionWriter:
    training = settings.training
    relative = is_relative(settings.variant, source)
    of = " of what well-marked Gaussians have (part_3 observations: of all votes)" if relative else ""
    notes = (
        f"{settings.variant} variant; AISRM {'on' if settings.refine else 'off'}; voting threshold "
        f"{settings.voting_threshold:g}{of}; {training.iterations} iterations, seed {training.seed}; "
        f"masks of train frames: {source.name}"
    )
    oracle = source.name.startswith("oracle")
    made_by = ProvenanceRecord.of(_provenance(source))
    if isinstance(source, NetworkMasks):
        notes += f": {source.marker.notes}"
    if oracle:
        notes += "; uses the ground truth of train frames"
    return SubmissionWriter(
        path, dataset, method=method_name(settings, source), notes=notes, only=tuple(only), overwrite=overwrite,
        truth="masks of train frames" if oracle else None, provenance=made_by,
    )  # fmt: skip


def _run(
    observations: Sequence[Observation],
    dataset: Dataset,
    targets: tuple[tuple[Settings, SubmissionFolder], ...],
    source: AnySource,
    work: str | Path,
    devices: Sequence[str],
    progress: bool,
    scheduling: Options | None,
) -> list[dict[str, Scalar]]:
    options = scheduling or Options()
    here = options.address is None and options.jobqueue is None
    workers = spread(devices, len(observations))
    if here:
        for device in dict.fromkeys(workers):
            default_rasteriser(device)  # a device that is not there is named, and kernels compiled, before all else
    mine = workers if here else ()
    wanted = () if here else tuple(software(source).items())
    jobs = [
        ObservationJob(dataset.root.absolute(), observation.key, targets, source, Path(work).absolute(), mine, wanted)
        for observation in observations
    ]
    outcome = run_each(predict_one, jobs, workers, progress=progress, scheduling=scheduling)
    outcome.check(Path(work))
    return outcome.values


def predict_one(context: Context, job: ObservationJob) -> dict[str, Scalar]:
    """Predict an observation on the device of the task's slot and write it; its figures."""
    try:
        if job.software:
            check_software(software(job.source), dict(job.software))
        rasteriser = device_of(context, job.devices)
        observation = Observation(job.root, job.key)
        figures: dict[str, Scalar] = {}
        for settings, folder in job.targets:
            teller = _Teller(context, job.key)
            prediction = predict(
                observation, job.source, rasteriser, settings, work_folder(job.work, observation), progress=teller.tell
            )
            for frame in observation.test:
                folder.write_mask(frame, prediction.masks[frame.name], (prediction.categories or {}).get(frame.name))
            folder.write_points(observation, prediction.points)
            figures = {"key": job.key, **prediction.figures}
            told = {name.replace("_", " "): value for name, value in prediction.figures.items() if value is not None}
            said = ", ".join(f"{name} {value}" for name, value in told.items())
            context.report("done", f"{job.key}: {said}")
        return figures
    except ModuleNotFoundError as error:
        raise UnfitError(missing_extra(error, "baselines")) from error
    except Avs3dError as error:
        text = str(error)
        raise type(error)(text if job.key in text else f"{job.key}: {text}") from None


#: Iterations between two lines of progress, and the longest time without one (s).
_SAID_EVERY = 5_000
_SAID_SECONDS = 30.0


class _Teller:
    """Tells how an observation's training goes."""

    def __init__(self, context: Context, key: str) -> None:
        self._context, self._key = context, key
        self._full = False
        self._said = time.monotonic()

    def tell(self, report: TrainingState) -> None:
        """Tell what is worth a line."""
        if report.full_at is not None and not self._full:
            self._full = True
            self._context.report(
                "note",
                f"{self._key}: the device's memory is nearly used: growth ended at iteration {report.full_at:,} with "
                f"{report.gaussians:,} Gaussians",
            )
        now = time.monotonic()
        due = report.iteration % _SAID_EVERY == 0 or report.iteration == report.iterations
        if due or now - self._said > _SAID_SECONDS:
            self._said = now
            self._context.report(
                "training",
                f"{self._key}: iteration {report.iteration:,} of {report.iterations:,}, loss {report.loss:.4f}, "
                f"{report.psnr:.1f} dB, {report.gaussians:,} Gaussians",
            )
