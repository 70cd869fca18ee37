"""The steps of a training run, as one process takes them: batches, losses, progress, checkpoints."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.optim.swa_utils import update_bn

from avs3d_bench.errors import Avs3dError
from baselines.listener.ahead import Ahead
from baselines.listener.augment import Bank, Batch
from baselines.listener.batches import SOUNDS, BatchPlan, Sampler
from baselines.listener.checkpoint import Settings, State, save_checkpoint
from baselines.listener.losses import Losses, losses
from baselines.listener.model import Listener, ListenerOutput, hear
from baselines.listener.shards import ShardStore
from baselines.listener.validation import validate

PROGRESS = "progress.jsonl"
#: Norm above which gradients are scaled down.
GRADIENT_NORM = 1.0
#: Steps between two lines of progress.
REPORT_STEPS = 25
#: Batches over which means and variances of the averaged network are measured.
SETTLING_STEPS = 40
#: Pictures of a batch that a message names.
_NAMED = 3
_TERMS = ("mask", "dice", "classes", "audible")


@dataclass(frozen=True)
class Schedule:
    """When a run stops, keeps a checkpoint and validates.

    Attributes:
        minutes: time after which the run stops and keeps its checkpoint; None: none.
        stop_at: step after which it does; None: none.
        checkpoint_minutes: time between two checkpoints.
        validate_every: steps between two validations; None: ten in a run; 0: none, not even at the end.
        compile: whether the network is compiled (`torch.compile`).
    """

    minutes: float | None = None
    stop_at: int | None = None
    checkpoint_minutes: float = 2.0
    validate_every: int | None = None
    compile: bool = False


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
    store: ShardStore
    state: State


class SoundingModel(torch.nn.Module):
    """The network with the sound's features in front: what one device computes for a batch."""

    def __init__(self, network: Listener) -> None:
        super().__init__()
        self.network = network

    def forward(self, pictures: Tensor, sounds: Tensor, cameras: Tensor) -> ListenerOutput:
        """See `Listener.forward`; ``cameras`` are those of the B pictures, and there may be no sounds."""
        if not len(sounds):
            output: ListenerOutput = self.network(pictures)
            # Several devices wait for the gradient of every parameter.
            return output._replace(classes=output.classes + 0 * sum(p.sum() for p in self.network.parameters()))
        repeats = len(sounds) // len(pictures)
        heard = hear(sounds, cameras.repeat_interleave(repeats, 0), (pictures.shape[-2], pictures.shape[-1]))
        return self.network(pictures, heard)  # type: ignore[no-any-return]


class _OfBatch(torch.nn.Module):
    """The same, called with a batch as `update_bn` does."""

    def __init__(self, network: Listener) -> None:
        super().__init__()
        self.model = SoundingModel(network)

    def forward(self, batch: Batch) -> ListenerOutput:
        return self.model(batch.pictures, batch.sounds, batch.cameras)  # type: ignore[no-any-return]


@dataclass(frozen=True)
class _PendingStep:
    """The last step: its number, its batch and its losses, which may still be under way from the device."""

    step: int
    plan: BatchPlan
    numbers: Tensor
    arrived: torch.cuda.Event | None

    @classmethod
    def of(cls, step: int, plan: BatchPlan, terms: Losses, norm: Tensor) -> _PendingStep:
        """Copy the terms, the loss and the norm of its gradients to the host without waiting for them."""
        each = [*(getattr(terms, name) for name in _TERMS), terms.total, norm]
        numbers = torch.stack([one.detach().float() for one in each])
        host = numbers.to("cpu", non_blocking=True)
        if not numbers.is_cuda:
            return cls(step, plan, host, None)
        # On the stream of the device that computes.
        return cls(step, plan, host, torch.cuda.current_stream(numbers.device).record_event())

    def read(self) -> tuple[dict[str, float], float, float]:
        """The terms by name, the loss, and the norm of its gradients; waits for this step, not for later ones."""
        if self.arrived is not None:
            self.arrived.synchronize()
        *terms, total, norm = self.numbers.tolist()
        return dict(zip(_TERMS, terms, strict=True)), total, norm


class Run:
    """The steps of one process."""

    def __init__(
        self,
        folder: Path,
        settings: Settings,
        schedule: Schedule,
        store: ShardStore,
        state: State,
        fabric: Any,
        bank: Bank | None = None,
    ) -> None:
        self.folder, self.settings, self.schedule = folder, settings, schedule
        self.store, self.state, self.fabric = store, state, fabric
        self.bank = bank or Bank(store, fabric.device)
        self.sampler = Sampler(store, settings.batch // SOUNDS, settings.seed, fabric.world_size, settings.homes)
        if schedule.compile:
            # In place; the features of the sound stay outside: complex numbers are not compiled.
            state.network.compile()
        model: Any = SoundingModel(state.network)
        self.model, self.optimiser = fabric.setup(model, state.optimiser)
        self.validation: dict[str, float | None] = {}
        self.began, self.before = time.monotonic(), state.seconds
        self.pending: _PendingStep | None = None

    def go(self) -> Result:
        """Take the steps that are left."""
        state, settings, every = self.state, self.settings, self._validate_every()
        saved = reported = time.monotonic()
        since = state.step
        self._note({"event": "start", "step": state.step, "steps": settings.steps, **self._description()})
        last = min(settings.steps, self.schedule.stop_at or settings.steps)
        with Ahead(self._plan, range(state.step, last)) as plans:
            for step, plan in plans:
                self._step(step, plan)
                now = time.monotonic()
                if (step + 1) % REPORT_STEPS == 0 or step + 1 == settings.steps:
                    frames = (state.step - since) * settings.batch * self.fabric.world_size
                    self._report(frames / (now - reported))
                    reported, since = time.monotonic(), state.step
                if every and ((step + 1) % every == 0 or step + 1 == settings.steps):
                    self._validate()
                    reported = time.monotonic()
                stopping = self._out_of_time()
                if stopping or now - saved > 60 * self.schedule.checkpoint_minutes:
                    self._save()
                    saved = time.monotonic()
                if stopping:
                    break
        self._save()
        if every and not self.validation:
            self._validate()
        elif not every and state.step == settings.steps:
            self._settle()
        average = self.state.average.module
        assert isinstance(average, Listener)
        return Result(state.step, state.step == settings.steps, self.validation, average, self.store, state)

    def _plan(self, step: int) -> BatchPlan:
        return self._planner(step)(step, self.fabric.global_rank)

    def _planner(self, step: int) -> Callable[..., BatchPlan]:
        """The function that plans the batches of the stage of a step."""
        return self.sampler.picture_plan if step < self.settings.picture_steps else self.sampler.plan

    def _gather(self, step: int, plan: BatchPlan, rank: int) -> Batch:
        seed = np.random.SeedSequence((self.settings.seed, 2, step, rank)).generate_state(1)[0]
        generator = torch.Generator(self.fabric.device).manual_seed(int(seed))
        return self.bank.gather(plan, generator, self.settings.without)

    def _step(self, step: int, plan: BatchPlan) -> None:
        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.rate_at(step) * group.get("share", 1.0)
        batch = self._gather(step, plan, self.fabric.global_rank)
        terms = losses(self.model(batch.pictures, batch.sounds, batch.cameras), batch)
        self.optimiser.zero_grad(set_to_none=True)
        self.fabric.backward(terms.total)
        # The loss of the step before is read only now, so that the device never waits for this process.
        self._check()
        norm = torch.nn.utils.clip_grad_norm_(self.model.parameters(), GRADIENT_NORM)
        self.pending = _PendingStep.of(step, plan, terms, norm)
        self.optimiser.step()
        self.state.follow(self.settings.average)
        self.state.step = step + 1
        self.state.shares += plan.shares()

    def _check(self) -> None:
        """Stop if the loss of the last step is no number.

        The norm of the gradients is the same on all devices: they stop together, wherever the loss went wrong.

        Raises:
            Avs3dError: naming the step and what was in the batch.
        """
        if self.pending is None:
            return
        terms, total, norm = self.pending.read()
        if math.isfinite(total) and math.isfinite(norm):
            return
        views = self.pending.plan.views
        keys = ", ".join(self.store.table.groups[view] for view in views[:_NAMED])
        parts = ", ".join(f"{name} {value:g}" for name, value in terms.items())
        raise Avs3dError(
            f"step {self.pending.step}: the loss is {total:g} ({parts}), the norm of its gradients "
            f"{norm:g}; the batch has {len(views)} pictures, the first are {keys}; lower the learning rate "
            "or check these frames"
        )

    def _report(self, throughput: float) -> None:
        self._check()
        assert self.pending is not None
        terms, total, _ = self.pending.read()
        shown = {name: round(value, 5) for name, value in terms.items()}
        self._note(
            {"event": "step", "step": self.state.step, "loss": round(total, 5), **shown,
             "rate": round(self.settings.rate_at(self.state.step - 1), 7), "frames_per_second": round(throughput, 1),
             "counterfactual": self.pending.plan.counterfactual, "seconds": round(self._seconds(), 1)}
        )  # fmt: skip

    def _settle(self) -> None:
        """Give the averaged network the means and variances that its own layers have; those of the other differ.

        The batches are the same on all devices.
        """
        plan = self._planner(self.state.step - 1)
        average: Any = self.state.average.module
        training = average.training
        numbers = range(self.settings.steps, self.settings.steps + SETTLING_STEPS)
        with self.fabric.autocast():
            update_bn((self._gather(number, plan(number), rank=0) for number in numbers), _OfBatch(average))
        average.train(training)

    def _validate(self) -> None:
        self._check()
        self._settle()
        (self.validation,) = validate(self.state.average.module, self.store, self.bank, self.fabric)
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
        every = self.schedule.validate_every
        return max(1, self.settings.steps // 10) if every is None else every

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
