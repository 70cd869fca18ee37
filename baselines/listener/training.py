"""Training the listener: from shards to weights, in steps that an interruption does not change.

A run's folder holds:

    cache/                 the frames of the shards, decoded (see `shards`)
    calibration/           the same of --calibrate-on, if it is given
    checkpoint.pt          network, average, optimiser and step, replaced every few minutes
    progress.jsonl         one line per report: step, losses, throughput, validation
    listener.safetensors   the averaged weights, float16, with listener.safetensors.sha256
    model_card.json, .md   what was trained on what, with which command, and how well

Every batch and every random change of it depends on (seed, step, rank) alone: a run that was killed goes on from its
checkpoint with the batches that it would have had.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch

from avs3d_bench.errors import Avs3dError
from baselines.listener.augment import Bank
from baselines.listener.checkpoint import Settings, State, new_state, resume
from baselines.listener.model import Listener
from baselines.listener.shards import ShardStore, open_store, read_store
from baselines.listener.steps import Result, Run, Schedule

CACHE, CALIBRATION = "cache", "calibration"


def prepare(
    data: str | Path, folder: str | Path, fabric: Any, *, workers: int | None = None, progress: bool = False
) -> ShardStore:
    """The frames of the shards; the first process reads them, all map them.

    Args:
        data: folder of shards.
        folder: of the decoded frames; runs on the same shards may share one, if it is filled by one of them.
        fabric: a launched `lightning.fabric.Fabric`.
        workers: processes that read shards; None: one per core.
        progress: show bars on stderr.

    Raises:
        UsageError: if there are no shards.
        Avs3dError: if shards are damaged or lack what training needs.

    Examples:
        >>> from avs3d_bench.exports import write_webdataset
        >>> from lightning_fabric import Fabric
        >>> fabric = Fabric(accelerator="cpu", devices=1, precision="32-true")
        >>> fabric.launch()
        >>> _ = write_webdataset("data/listen", "listen-shards", workers=1)
        >>> store = prepare("listen-shards", "prepared", fabric, workers=1)
        >>> store.pictures.shape, store.sounds.shape, len(store.table.groups)
        ((6, 252, 252, 3), (30, 2, 44100), 6)
    """
    folder = Path(folder)
    if fabric.global_rank == 0:
        folder.parent.mkdir(parents=True, exist_ok=True)
        read_store(data, folder, workers=workers, progress=progress)
    fabric.barrier()
    store = open_store(folder)
    assert store is not None
    return store


def train(
    store: ShardStore,
    folder: str | Path,
    settings: Settings,
    *,
    fabric: Any,
    schedule: Schedule,
    bank: Bank | None = None,
    begin: Listener | None = None,
) -> Result:
    """Train, or go on with, the run of a folder.

    Args:
        store: of `prepare`.
        folder: of the run.
        settings: what is learnt.
        fabric: a launched `lightning.fabric.Fabric`.
        schedule: when to stop and to look around.
        bank: the same on the device; None: it is put there.
        begin: see `checkpoint.new_state`; a run that goes on has its own weights.

    Raises:
        UsageError: if the folder's run has other settings or data.
        Avs3dError: if memory does not suffice, or the loss is no number any more.

    Examples:
        >>> from avs3d_bench.exports import write_webdataset
        >>> from lightning_fabric import Fabric
        >>> fabric = Fabric(accelerator="cpu", devices=1, precision="32-true")
        >>> fabric.launch()
        >>> from baselines.listener.steps import Schedule
        >>> _ = write_webdataset("data/listen", "train-shards", workers=1)
        >>> store = prepare("train-shards", "run/cache", fabric, workers=1)
        >>> small = Widths(
        ...     image=(8, 8, 16, 16, 16), blocks=(0, 1, 1, 1, 1), decoder=(16, 16, 8, 8), audio=(8, 8, 16, 16)
        ... )
        >>> settings = Settings(steps=2, batch=4, widths=small)
        >>> schedule = Schedule(validate_every=1_000_000)
        >>> result = train(store, "run", settings, fabric=fabric, schedule=schedule)  # doctest: +ELLIPSIS
        {"event": "start", "step": 0, "steps": 2, ...
        >>> result.finished, result.step
        (True, 2)
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    state = new_state(settings, fabric.device, begin)
    resume(state, folder, settings, store.table.digest)
    with _enough_memory(fabric.device, state, settings):
        return Run(folder, settings, schedule, store, state, fabric, bank).go()


@contextmanager
def _enough_memory(device: torch.device, state: State, settings: Settings) -> Iterator[None]:
    """A block after which too little memory has become one line."""
    try:
        yield
    except (torch.OutOfMemoryError, MemoryError) as error:
        raise Avs3dError(
            f"step {state.step}: too little memory on {device} for --batch-size {settings.batch}; take a smaller one"
        ) from error
