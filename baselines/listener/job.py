"""One run of `avs3d train listener`: options become settings and a Fabric, a finished run weights and a card."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import torch

from avs3d_bench.errors import UsageError
from avs3d_bench.runtime.freed_memory import keep_freed_memory
from baselines.listener.batches import SOUNDS, Sampler
from baselines.listener.calibration import calibrate
from baselines.listener.card import RunMachine, data_before, write_result
from baselines.listener.checkpoint import Settings
from baselines.listener.dry import read_dry
from baselines.listener.lite import installed_weights
from baselines.listener.model import SIZES
from baselines.listener.steps import Schedule
from baselines.listener.training import CACHE, CALIBRATION, prepare, train
from baselines.listener.weights import read_weights


@dataclass(frozen=True)
class TrainingOptions:
    """The options of the command, as it names them."""

    data: Path
    folder: Path
    epochs: float
    steps: int | None = None
    picture_steps: int = 0
    size: str | None = None
    manifest: Path | None = None
    minutes: float | None = None
    stop_at: int | None = None
    batch: int = 256
    rate: float = 1.5e-3
    devices: int = 1
    accelerator: str = "auto"
    precision: str = "bf16"
    seed: int = 0
    homes: int | None = None
    validate_every: int | None = None
    compile: bool = False
    workers: int | None = None
    without: tuple[str, ...] = ()
    cache: Path | None = None
    calibrate_on: Path | None = None
    weights: Path | None = None
    dry: Path | None = None


def make_fabric(accelerator: str, precision: str, devices: int = 1) -> Any:
    """A launched Lightning Fabric, from either of its packages.

    Args:
        accelerator: cpu, cuda, or auto: a GPU where there is one.
        precision: as Fabric names it.
        devices: number of GPUs, or of processes.

    Raises:
        UsageError: if there are fewer devices than asked for.
    """
    if accelerator == "auto":
        accelerator = "cuda" if torch.cuda.is_available() else "cpu"
    if accelerator == "cuda" and torch.cuda.device_count() < devices:
        raise UsageError(f"--devices {devices}: found {torch.cuda.device_count()} CUDA devices; ask for fewer")
    if accelerator == "cpu":
        keep_freed_memory()
    try:
        module: Any = import_module("lightning_fabric")
    except ImportError:
        module = import_module("lightning.fabric")
    strategy = "ddp" if devices > 1 else "auto"
    fabric = module.Fabric(accelerator=accelerator, devices=devices, precision=precision, strategy=strategy)
    fabric.launch()
    return fabric


@contextmanager
def flushed() -> Iterator[None]:
    """A block in which a CPU takes numbers below 1e-38 as 0; with such gradients it is three times as slow.

    Threads that start in the block inherit this.
    """
    tiny = torch.tensor([1e-39])
    before = not bool((tiny * 1).any())
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(before)


def run_job(job: TrainingOptions, precision: str, *, progress: bool = False) -> tuple[bool | None, int, int]:
    """Train; (finished, steps that are done, all steps). ``finished`` is None on all devices but the first.

    Raises:
        UsageError: if options contradict each other or the folder's run.
        Avs3dError: if data is damaged, memory does not suffice, or the loss is no number.
    """
    began = time.monotonic()
    torch.set_float32_matmul_precision("high")
    torch.backends.cudnn.benchmark = True
    fabric = make_fabric(job.accelerator, precision, job.devices)
    begun = read_weights(job.weights) if job.weights else None
    before = data_before(job.weights, begun.digest) if job.weights and begun else []
    dry = read_dry(job.dry) if job.dry else None
    # The settings are checked before minutes are spent on reading.
    settings = Settings(
        steps=job.steps or job.picture_steps + 1, picture_steps=job.picture_steps, batch=job.batch, rate=job.rate,
        homes=job.homes, seed=job.seed, widths=begun.network.widths if begun else SIZES[job.size or "lite"],
        without=tuple(sorted(set(job.without))), weights=begun.digest if begun else None,
        dry=dry.digest if dry else None,
    )  # fmt: skip
    if begun is None and settings.widths.encoder == "lite0":
        installed_weights()
    reading: dict[str, Any] = {"workers": job.workers, "progress": progress}
    store = replace(prepare(job.data, job.cache or job.folder / CACHE, fabric, **reading), dry=dry)
    if dry and not any(store.table.has_response):
        raise UsageError(f"--dry {job.dry}: no frame of {job.data} has an impulse response; make them --with rirs")
    # Now, not after hours of training: the shards may be missing or damaged.
    tuning = prepare(job.calibrate_on, job.folder / CALIBRATION, fabric, **reading) if job.calibrate_on else None
    if not job.steps:
        sampler = Sampler(store, job.batch // SOUNDS, job.seed, fabric.world_size, job.homes)
        settings = replace(settings, steps=job.picture_steps + max(1, round(job.epochs * sampler.steps)))
    # The time that reading took belongs to --minutes.
    left = None if job.minutes is None else job.minutes - (time.monotonic() - began) / 60
    schedule = Schedule(
        minutes=left, stop_at=job.stop_at, validate_every=job.validate_every, compile=job.compile
    )  # fmt: skip
    with flushed():
        begin = begun.network if begun else None
        result = train(store, job.folder, settings, fabric=fabric, schedule=schedule, begin=begin)
        found = None
        if result.finished:
            found = calibrate(result.network, tuning or store, fabric, every_home=tuning is not None)
    if fabric.global_rank:
        return None, result.step, settings.steps
    if found is not None:
        machine = RunMachine.of(fabric, precision)
        write_result(job.folder, result, settings, machine, found, data=job.data, manifest=job.manifest, before=before)
    sys.stdout.flush()
    return result.finished, result.step, settings.steps
