"""Settings and state of a training run, and its checkpoint: written atomically, taken over only by the same run."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import atomic_path
from baselines.listener.batches import SOUNDS
from baselines.listener.lite import LiteEncoder, load_imagenet
from baselines.listener.model import Listener, Widths
from baselines.listener.picture_changes import PICTURE_CHANGES

CHECKPOINT = "checkpoint.pt"
#: Most steps in which the learning rate rises.
MOST_WARM_UP = 500
#: Of the learning rate, for layers that begin with what others trained.
LEARNT_SHARE = 0.2


@dataclass(frozen=True)
class Settings:
    """Settings of a run; those that change what is learnt must be the same when it goes on.

    Attributes:
        steps: of the whole schedule.
        picture_steps: how many of them, the first ones, learn what is seen, from parts of pictures and without sound.
        batch: sounds of a batch on each device; a picture has `SOUNDS` of them.
        rate: highest learning rate.
        decay: weight decay.
        warm_up: share of the steps in which the rate rises; at most `MOST_WARM_UP` steps.
        average: decay of the exponential moving average of the weights.
        homes: number of training homes, for learning curves; None: all.
        seed: of weights, batches and augmentation.
        widths: size of the network.
        without: names of `augment.CHANGES` that are left out, in alphabetical order.
        weights: sha256 of the weights that the run begins with; None: random ones, and of `lite` those of ImageNet.
        dry: sha256 of the dry sounds (`dry.DrySounds`); None: none.

    Examples:
        >>> settings = Settings(steps=10_000, batch=64, seed=1)
        >>> [round(settings.rate_at(step), 5) for step in (0, 400, 9_999)]  # rises, then falls
        [0.0, 0.0015, 2e-05]
    """

    steps: int
    picture_steps: int = 0
    batch: int = 256
    rate: float = 1.5e-3
    decay: float = 0.05
    warm_up: float = 0.04
    average: float = 0.998
    homes: int | None = None
    seed: int = 0
    widths: Widths = field(default_factory=Widths)
    without: tuple[str, ...] = ()
    weights: str | None = None
    dry: str | None = None

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise UsageError(f"--steps {self.steps}: expected at least 1")
        if not 0 <= self.picture_steps < self.steps:
            raise UsageError(f"--picture-steps {self.picture_steps}: expected fewer than the {self.steps} steps of all")
        if self.batch < SOUNDS or self.batch % SOUNDS:
            raise UsageError(f"--batch-size {self.batch}: expected a multiple of {SOUNDS}, the sounds of a picture")

    def rate_at(self, step: int) -> float:
        """Learning rate of a step: rises linearly, stays, then falls as half a cosine, to 1 % of the highest.

        It stays while pictures alone are learnt.
        """
        warm = min(max(1, round(self.warm_up * self.steps)), MOST_WARM_UP)
        if step < warm:
            return self.rate * (step + 1) / warm
        begin = max(warm, self.picture_steps)
        share = max(0, step - begin) / max(1, self.steps - begin)
        return self.rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(1.0, share))))


@dataclass
class State:
    """Content of a checkpoint beside the settings.

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

    @torch.no_grad()
    def follow(self, decay: float) -> None:
        """Move the average towards the network; the first time it is the network, later it forgets by ``decay``.

        Over the first steps it forgets faster. `AveragedModel.update_parameters` makes the host wait for the device.
        """
        number, module = int(self.average.n_averaged), self.average.module
        averaged: list[Tensor] = list(module.parameters())
        current: list[Tensor] = list(self.network.parameters())
        if number:
            change = torch._foreach_sub(current, averaged)
            torch._foreach_mul_(change, 1 - min((1 + number) / (10 + number), decay))
            torch._foreach_add_(averaged, change)
        else:
            torch._foreach_copy_(averaged, current)
        torch._foreach_copy_(list(module.buffers()), list(self.network.buffers()))
        self.average.n_averaged += 1


def new_state(settings: Settings, device: torch.device | str = "cpu", begin: Listener | None = None) -> State:
    """Before the first step; the same for the same seed.

    Args:
        settings: of the run.
        device: where the network goes.
        begin: whose weights it takes, of the settings' widths; None: see `Settings.weights`.
    """
    torch.manual_seed(settings.seed)
    network: Any = Listener(settings.widths)
    if begin is not None:
        network.load_state_dict(begin.state_dict())
    elif isinstance(network.picture_encoder, LiteEncoder):
        load_imagenet(network.picture_encoder)
    network = network.to(device)
    network = network.to(memory_format=torch.channels_last)
    learnt = "picture_encoder." if isinstance(network.picture_encoder, LiteEncoder) else ()
    alike: dict[tuple[float, float], list[Tensor]] = {}
    for name, each in network.named_parameters():
        share = LEARNT_SHARE if name.startswith(learnt) else 1.0
        alike.setdefault((settings.decay if each.ndim > 1 else 0.0, share), []).append(each)
    groups = [{"params": each, "weight_decay": decay, "share": share} for (decay, share), each in alike.items()]
    optimiser = torch.optim.AdamW(
        groups, lr=settings.rate, betas=(0.9, 0.99), fused=torch.device(device).type == "cuda"
    )
    return State(network, AveragedModel(network), optimiser)


def resume(state: State, folder: Path, settings: Settings, digest: str) -> None:
    """Take over the folder's checkpoint, if there is one.

    As long as pictures alone are learnt, the rate stays and no sound is changed: the numbers of steps that are still to
    come may change, and which changes of sounds are left out. So runs that differ in these may share their beginning.

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
        early = saved["step"] <= min(settled["picture_steps"], settings.picture_steps)
        for name, value in json.loads(_as_json(settings)).items():
            if settled.get(name) != value and not (early and _comes_later(name, settled[name], value)):
                raise UsageError(
                    f"{path}: a run with {name} {settled.get(name)}, asked for {value}; use the same, or another folder"
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


def _comes_later(name: str, before: Any, now: Any) -> bool:
    """Whether a setting that differs takes no part while pictures alone are learnt."""
    if name == "without":
        return not set(before).symmetric_difference(now) & set(PICTURE_CHANGES)
    return name in ("steps", "picture_steps")


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
