"""Training the listener: from shards to weights, in steps that an interruption does not change.

A run's folder holds:

    cache/                 the frames of the shards, decoded (see `shards`)
    checkpoint.pt          network, average, optimiser and step, replaced every few minutes
    progress.jsonl         one line per report: step, losses, throughput, validation
    listener.safetensors   the averaged weights, float16, with listener.safetensors.sha256
    model_card.json, .md   what was trained on what, with which command, and how well

Every batch and every random change of it depends on (seed, step, rank) alone, so that a run that was killed goes on from
its checkpoint with the batches that it would have had.
"""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.files import atomic_path
from baselines.listener.ahead import Ahead
from baselines.listener.augment import Bank, Batch
from baselines.listener.batches import SOUNDS, Plan, Sampler
from baselines.listener.losses import Losses, losses
from baselines.listener.model import Listener, Output, Widths, hear
from baselines.listener.shards import Store, open_store, read_store
from baselines.listener.validation import validate

CACHE, CHECKPOINT, PROGRESS = "cache", "checkpoint.pt", "progress.jsonl"
#: Norm above which gradients are scaled down.
GRADIENT_NORM = 1.0
#: Steps between two lines of progress.
REPORT_STEPS = 25
#: Pictures of a batch that a message names.
_NAMED = 3
_TERMS = ("mask", "dice", "classes", "audible")


@dataclass(frozen=True)
class Settings:
    """Settings of a run; those that change what is learnt must be the same when it goes on.

    Attributes:
        steps: of the whole schedule.
        batch: sounds of a batch on each device; a picture has `SOUNDS` of them.
        rate: highest learning rate.
        decay: weight decay.
        warm_up: share of the steps in which the rate rises.
        average: decay of the exponential moving average of the weights.
        seed: of weights, batches and augmentation.
        widths: size of the network.
    """

    steps: int
    batch: int = 256
    rate: float = 1.5e-3
    decay: float = 0.05
    warm_up: float = 0.04
    average: float = 0.998
    seed: int = 0
    widths: Widths = Widths()

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise UsageError(f"--steps {self.steps}: expected at least 1")
        if self.batch < SOUNDS or self.batch % SOUNDS:
            raise UsageError(f"--batch-size {self.batch}: expected a multiple of {SOUNDS}, the sounds of a picture")

    def rate_at(self, step: int) -> float:
        """Learning rate of a step: rises linearly, then falls as half a cosine, to 1 % of the highest."""
        warm = max(1, round(self.warm_up * self.steps))
        if step < warm:
            return self.rate * (step + 1) / warm
        share = (step - warm) / max(1, self.steps - warm)
        return self.rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(1.0, share))))


@dataclass(frozen=True)
class Schedule:
    """When a run looks around.

    Attributes:
        minutes: time after which the run stops and keeps its checkpoint; None: none.
        checkpoint_minutes: time between two checkpoints.
        validate_every: steps between two validations; None: ten in a run.
        compile: whether `torch.compile` is used.
    """

    minutes: float | None = None
    checkpoint_minutes: float = 2.0
    validate_every: int | None = None
    compile: bool = False


@dataclass
class State:
    """What a checkpoint holds, beside the settings.

    Attributes:
        network: learns.
        average: the moving average of its weights.
        optimiser: AdamW.
        step: steps that are done.
        seconds: time that they took, on the clock.
        shares: sounds of each kind that were in the batches of this device.
    """

    network: Listener
    average: AveragedModel
    optimiser: torch.optim.Optimizer
    step: int = 0
    seconds: float = 0.0
    shares: Counter[str] = field(default_factory=Counter)


@dataclass
class Result:
    """How a run ended.

    Attributes:
        step: steps that are done.
        finished: whether these are all.
        validation: the last figures, see `losses.figures`.
        network: the averaged network.
        store: what it was trained on.
        state: all of it.
    """

    step: int
    finished: bool
    validation: dict[str, float | None]
    network: Listener
    store: Store
    state: State


class SoundingModel(torch.nn.Module):
    """The network with the sound's features in front: what one device computes for a batch."""

    def __init__(self, network: Listener) -> None:
        super().__init__()
        self.network = network

    def forward(self, pictures: Tensor, sounds: Tensor, cameras: Tensor) -> Output:
        """See `Listener.forward`; ``cameras`` are those of the B pictures."""
        repeats = len(sounds) // len(pictures)
        heard = hear(sounds, cameras.repeat_interleave(repeats, 0), (pictures.shape[-2], pictures.shape[-1]))
        return self.network(pictures, heard)  # type: ignore[no-any-return]


def new_state(settings: Settings, device: Any = "cpu") -> State:
    """Before the first step; the same for the same seed."""
    torch.manual_seed(settings.seed)
    network = Listener(settings.widths).to(device, memory_format=torch.channels_last)
    decayed = [p for p in network.parameters() if p.ndim > 1]
    others = [p for p in network.parameters() if p.ndim <= 1]
    groups = [{"params": decayed, "weight_decay": settings.decay}, {"params": others, "weight_decay": 0.0}]
    optimiser = torch.optim.AdamW(
        groups, lr=settings.rate, betas=(0.9, 0.99), fused=torch.device(device).type == "cuda"
    )
    average = AveragedModel(network, multi_avg_fn=get_ema_multi_avg_fn(settings.average))
    return State(network, average, optimiser)


def prepare(
    data: str | Path, folder: str | Path, fabric: Any, *, workers: int | None = None, progress: bool = False
) -> Store:
    """The frames of the shards; the first process reads them, all map them.

    Args:
        data: folder of shards.
        folder: of the run.
        fabric: a launched `lightning.fabric.Fabric`.
        workers: processes that read shards; None: one per core.
        progress: show bars on stderr.

    Raises:
        UsageError: if there are no shards.
        Avs3dError: if shards are damaged or lack what training needs.
    """
    folder = Path(folder)
    if fabric.global_rank == 0:
        folder.mkdir(parents=True, exist_ok=True)
        read_store(data, folder / CACHE, workers=workers, progress=progress)
    fabric.barrier()
    store = open_store(folder / CACHE)
    assert store is not None
    return store


def train(
    store: Store,
    folder: str | Path,
    settings: Settings,
    *,
    fabric: Any,
    schedule: Schedule = Schedule(),  # noqa: B008
) -> Result:
    """Train, or go on with, the run of a folder.

    Args:
        store: of `prepare`.
        folder: of the run.
        settings: what is learnt.
        fabric: a launched `lightning.fabric.Fabric`.
        schedule: when to stop and to look around.

    Raises:
        UsageError: if the folder's run has other settings or data.
        Avs3dError: if memory does not suffice, or the loss is no number any more.
    """
    folder = Path(folder)
    state = new_state(settings, fabric.device)
    resume(state, folder, settings, store.table.digest)
    with _enough_memory(fabric.device, state, settings):
        return _Run(folder, settings, schedule, store, state, fabric).go()


def resume(state: State, folder: Path, settings: Settings, digest: str) -> None:
    """Take over the folder's checkpoint, if there is one.

    Raises:
        UsageError: if it was made with other settings or data.
        Avs3dError: if it is damaged.
    """
    path = folder / CHECKPOINT
    if not path.exists():
        return
    try:
        saved = torch.load(path, map_location="cpu", weights_only=True)
        settled, trained = json.loads(saved["settings"]), saved["data"]
        for name, value in json.loads(_as_json(settings)).items():
            if settled[name] != value:
                raise UsageError(
                    f"{path}: a run with {name} {settled[name]}, asked for {value}; use the same, or another folder"
                )
        if trained != digest:
            raise UsageError(
                f"{path}: a run on other shards ({trained[:12]}…, found {digest[:12]}…); use another folder"
            )
        state.network.load_state_dict(saved["network"])
        state.average.load_state_dict(saved["average"])
        state.optimiser.load_state_dict(saved["optimiser"])
        state.step, state.seconds, state.shares = saved["step"], saved["seconds"], Counter(saved["shares"])
    except Avs3dError:
        raise
    except Exception as error:
        raise Avs3dError(f"{path}: cannot go on from this checkpoint ({type(error).__name__}); delete it") from error


def save_checkpoint(state: State, folder: Path, settings: Settings, digest: str) -> None:
    """Replace the folder's checkpoint, atomically."""
    content = {
        "settings": _as_json(settings),
        "data": digest,
        "network": state.network.state_dict(),
        "average": state.average.state_dict(),
        "optimiser": state.optimiser.state_dict(),
        "step": state.step,
        "seconds": state.seconds,
        "shares": dict(state.shares),
    }
    with atomic_path(folder / CHECKPOINT) as temporary:
        torch.save(content, temporary)


def _as_json(settings: Settings) -> str:
    return json.dumps({each.name: getattr(settings, each.name) for each in fields(settings)}, default=asdict)


@dataclass(frozen=True)
class _Taken:
    """The last step: its number, its batch and its losses, which may still be under way on the device."""

    step: int
    plan: Plan
    terms: Losses
    total: Tensor
    norm: Tensor


class _Run:
    """The steps of one process."""

    def __init__(
        self, folder: Path, settings: Settings, schedule: Schedule, store: Store, state: State, fabric: Any
    ) -> None:
        self.folder, self.settings, self.schedule = folder, settings, schedule
        self.store, self.state, self.fabric = store, state, fabric
        self.bank = Bank(store, fabric.device)
        self.sampler = Sampler(store, settings.batch // SOUNDS, settings.seed, fabric.world_size)
        model: Any = SoundingModel(state.network)
        if schedule.compile:
            model = torch.compile(model)
        self.model, self.optimiser = fabric.setup(model, state.optimiser)
        self.validation: dict[str, float | None] = {}
        self.began, self.before = time.monotonic(), state.seconds
        self.pending: _Taken | None = None

    def go(self) -> Result:
        """Take the steps that are left."""
        state, settings, every = self.state, self.settings, self._validate_every()
        saved = reported = time.monotonic()
        since = state.step
        self._note({"event": "start", "step": state.step, "steps": settings.steps, **self._description()})
        with Ahead(self._plan, range(state.step, settings.steps)) as plans:
            for step, plan in plans:
                self._step(step, plan)
                now = time.monotonic()
                if (step + 1) % REPORT_STEPS == 0 or step + 1 == settings.steps:
                    frames = (state.step - since) * settings.batch * self.fabric.world_size
                    self._report(frames / (now - reported))
                    reported, since = time.monotonic(), state.step
                if (step + 1) % every == 0 or step + 1 == settings.steps:
                    self._validate()
                    reported = time.monotonic()
                stopping = self._out_of_time()
                if stopping or now - saved > 60 * self.schedule.checkpoint_minutes:
                    self._save()
                    saved = time.monotonic()
                if stopping:
                    break
        self._save()
        if not self.validation:
            self._validate()
        average = self.state.average.module
        assert isinstance(average, Listener)
        return Result(state.step, state.step == settings.steps, self.validation, average, self.store, state)

    def _plan(self, step: int) -> Plan:
        return self.sampler.plan(step, self.fabric.global_rank)

    def _gather(self, step: int, plan: Plan) -> Batch:
        seed = np.random.SeedSequence((self.settings.seed, 2, step, self.fabric.global_rank)).generate_state(1)[0]
        generator = torch.Generator(self.fabric.device).manual_seed(int(seed))
        return self.bank.gather(plan, generator)

    def _step(self, step: int, plan: Plan) -> None:
        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.rate_at(step)
        batch = self._gather(step, plan)
        terms = losses(self.model(batch.pictures, batch.sounds, batch.cameras), batch)
        total = terms.total
        self.optimiser.zero_grad(set_to_none=True)
        self.fabric.backward(total)
        # The loss of the step before is read only now, so that the device never waits for this process.
        self._check()
        norm = torch.nn.utils.clip_grad_norm_(self.model.parameters(), GRADIENT_NORM)
        self.pending = _Taken(step, plan, terms.detached(), total.detach(), norm.detach())
        self.optimiser.step()
        self.state.average.update_parameters(self.state.network)
        self.state.step = step + 1
        self.state.shares += plan.shares()

    def _check(self) -> None:
        """Stop if the loss of the last step is no number.

        The norm of the gradients is the same on all devices: they stop together, wherever the loss went wrong.

        Raises:
            Avs3dError: naming the step and what was in the batch.
        """
        last = self.pending
        if last is None or (math.isfinite(float(last.total)) and math.isfinite(float(last.norm))):
            return
        keys = ", ".join(self.store.table.groups[view] for view in last.plan.views[:_NAMED])
        parts = ", ".join(f"{name} {float(getattr(last.terms, name)):g}" for name in _TERMS)
        raise Avs3dError(
            f"step {last.step}: the loss is {float(last.total):g} ({parts}), the gradients' norm {float(last.norm):g}; the "
            f"batch has {len(last.plan.views)} pictures, the first are {keys}; lower the learning rate or check these frames"
        )

    def _report(self, throughput: float) -> None:
        self._check()
        assert self.pending is not None
        plan, total = self.pending.plan, self.pending.total
        shown = {name: round(float(getattr(self.pending.terms, name)), 5) for name in _TERMS}
        self._note(
            {"event": "step", "step": self.state.step, "loss": round(float(total), 5), **shown,
             "rate": round(self.settings.rate_at(self.state.step - 1), 7), "frames_per_second": round(throughput, 1),
             "counterfactual": round(plan.counterfactual, 3), "seconds": round(self._seconds(), 1)}
        )  # fmt: skip

    def _validate(self) -> None:
        self._check()
        self.validation = validate(self.state.average.module, self.store, self.bank, self.fabric)
        self._note(
            {"event": "validation", "step": self.state.step, **self.validation, "seconds": round(self._seconds(), 1)}
        )

    def _save(self) -> None:
        self._check()
        self.state.seconds = self._seconds()
        if self.fabric.global_rank == 0:
            save_checkpoint(self.state, self.folder, self.settings, self.store.table.digest)
        self.fabric.barrier()

    def _seconds(self) -> float:
        return self.before + time.monotonic() - self.began

    def _out_of_time(self) -> bool:
        """Whether --minutes are over, on the first device's clock."""
        if self.schedule.minutes is None or self.state.step % REPORT_STEPS:
            return False
        return bool(self.fabric.broadcast(time.monotonic() - self.began > 60 * self.schedule.minutes))

    def _validate_every(self) -> int:
        return self.schedule.validate_every or max(1, self.settings.steps // 10)

    def _description(self) -> dict[str, Any]:
        table = self.store.table
        return {
            "pictures": len(table.groups), "sounds": len(table.keys), "homes": len(set(table.homes)),
            "batch": self.settings.batch, "devices": self.fabric.world_size, "device": str(self.fabric.device),
            "store_on_device": self.bank.resident, "steps_per_epoch": self.sampler.steps,
        }  # fmt: skip

    def _note(self, line: dict[str, Any]) -> None:
        """One line of progress, to stdout and to the folder."""
        if self.fabric.global_rank:
            return
        text = json.dumps(line)
        print(text, flush=True)
        with (self.folder / PROGRESS).open("a") as file:
            file.write(text + "\n")


@contextmanager
def _enough_memory(device: Any, state: State, settings: Settings) -> Iterator[None]:
    """A block after which too little memory has become one line."""
    try:
        yield
    except (torch.OutOfMemoryError, MemoryError) as error:
        raise Avs3dError(
            f"step {state.step}: too little memory on {device} for --batch-size {settings.batch}; take a smaller one"
        ) from error
