"""Training Gaussians on the train views of an observation: 3D-GS (Kerbl et al. 2023).

All pictures stay on the device as bytes; between two reports nothing is copied to or from it but a view's number, and
nothing waits for it (save for what the rasteriser itself counts). What is random depends on the seed and the iteration
alone, so an interrupted run continues from its checkpoint with the same result.

Schedule, densification and pruning are the reference's (`schedule`, `densify`). The number of Gaussians has no cap;
when the device's memory is nearly used up, growth ends; the report names the iteration.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from avs3d_bench.errors import Avs3dError
from baselines.echosegnet import checkpoint as saving
from baselines.echosegnet.densify import DensityControl, GradientStats, densify, parameters, reset_opacities
from baselines.echosegnet.gaussians import Gaussians, from_points
from baselines.echosegnet.memory import begin, release, room_for
from baselines.echosegnet.pictures import load_pictures, out_of_memory, view_psnr
from baselines.echosegnet.rasteriser.rendering import Rasteriser
from baselines.echosegnet.schedule import TrainingSettings
from baselines.echosegnet.similarity import psnr, ssim
from baselines.echosegnet.views import RegisteredView, camera_extent, train_views

__all__ = [
    "Checkpoint",
    "DensityControl",
    "Pace",
    "Progress",
    "TrainingSettings",
    "TrainingState",
    "load_pictures",
    "psnr",
    "train",
    "view_psnr",
]


@dataclass(frozen=True)
class TrainingState:
    """The state of a training.

    Attributes:
        iteration: of ``iterations``.
        iterations: in all.
        loss: mean over the train views drawn since the last report; also PSNR (dB).
        psnr: see there.
        gaussians: how many there are.
        full_at: iteration at which Gaussians were first refused because memory was nearly used; None: never.
    """

    iteration: int
    iterations: int
    loss: float
    psnr: float
    gaussians: int
    full_at: int | None = None


@dataclass(frozen=True)
class Checkpoint:
    """A file that a training saves its state to; one more save is made at the end.

    Attributes:
        path: of the file.
        every: iterations between two saves.
    """

    path: Path
    every: int = 5_000


@dataclass(frozen=True)
class Pace:
    """How often a training reports: every so many iterations, or where no report came for so many seconds."""

    every: int = 100
    seconds: float = math.inf


#: What `train` calls with a report.
Progress = Callable[[TrainingState], None]


def train(
    views: Sequence[RegisteredView],
    points: ArrayLike,
    colours: ArrayLike,
    rasteriser: Rasteriser,
    settings: TrainingSettings | None = None,
    *,
    checkpoint: Checkpoint | None = None,
    progress: Progress | None = None,
    pace: Pace = Pace(),  # frozen
) -> Gaussians:
    """Train Gaussians on the train views.

    Args:
        views: of one observation; those of the test split are ignored.
        points: (N, 3) where Gaussians start, metres, Y-down world (`views.load_points`).
        colours: (N, 3) uint8, or floats in [0, 1].
        rasteriser: also determines the device.
        settings: None: the reference's.
        checkpoint: file to save to, and to continue from if it exists.
        progress: called as often as ``pace`` says, and at the end.
        pace: of the reports.

    Returns:
        The Gaussians, on the rasteriser's device, without gradients.

    Raises:
        Avs3dError: if there is no train view or point, numbers are not finite, the checkpoint belongs to another run,
            or memory runs out; in one line each.
    """
    settings = settings or TrainingSettings()
    chosen = train_views(views)
    start = from_points(points, colours, sh_degree=settings.sh_degree)
    begin(rasteriser.device)
    pictures = load_pictures(chosen, rasteriser.device)
    job = _Job(chosen, pictures, rasteriser, settings, start)
    digest = saving.digest(settings, start, pictures)
    if checkpoint is not None and checkpoint.path.exists():
        job.iteration, job.pull, job.full_at = saving.load(checkpoint.path, job.optimiser, digest, rasteriser.device)
    reported = time.monotonic()
    while job.iteration < settings.iterations:
        with out_of_memory(f"{len(job.pull.total)} Gaussians at {chosen[0].camera.width} × {chosen[0].camera.height}"):
            job.step()
        done = job.iteration == settings.iterations
        if done or job.iteration % pace.every == 0 or time.monotonic() - reported > pace.seconds:
            report, reported = job.report(), time.monotonic()
            if progress is not None:
                progress(report)
        if checkpoint is not None and (done or job.iteration % checkpoint.every == 0):
            saving.save(checkpoint.path, job.optimiser, job.pull, job.iteration, job.full_at, digest)
    return job.gaussians(detached=True)


class _Job:
    """A training under way."""

    def __init__(
        self,
        views: Sequence[RegisteredView],
        pictures: Tensor,
        rasteriser: Rasteriser,
        settings: TrainingSettings,
        start: Gaussians,
    ) -> None:
        self.views, self.pictures, self.rasteriser, self.settings = views, pictures, rasteriser, settings
        self.extent = camera_extent(views)
        self.density = settings.density.limited(pictures.numel() // 3)
        self.iteration = 0
        self.full_at: int | None = None
        start = start.to(rasteriser.device)
        values = (start.means, start.log_scales, start.rotations, start.opacities, start.sh[:, :1], start.sh[:, 1:])
        self.optimiser = _optimiser(values, settings, self.extent)
        self.pull = GradientStats.zeros(start.means)
        self._sums = start.means.new_zeros(2)
        self._seen = 0

    def gaussians(self, *, detached: bool = False) -> Gaussians:
        """As they are now."""
        values = parameters(self.optimiser)
        if detached:
            values = {name: value.detach() for name, value in values.items()}
        sh = torch.cat([values["sh0"], values["sh_rest"]], dim=1)
        return Gaussians(values["means"], values["log_scales"], values["rotations"], values["opacities"], sh)

    def step(self) -> None:
        """One view: draw, compare, improve; at its times densify and reset."""
        self.iteration += 1
        settings, index = self.settings, self._next_view()
        growing = settings.grows(self.iteration)
        degree = min(settings.sh_degree, self.iteration // settings.scaled(settings.sh_every))
        splat = self.rasteriser.splat(self.gaussians(), self.views[index], sh_degree=degree)
        if growing:
            splat.means2d.retain_grad()
        target = self.pictures[index].to(splat.image.dtype) / 255.0
        error = splat.image - target
        loss = (1.0 - settings.ssim_weight) * error.abs().mean()
        loss = loss + settings.ssim_weight * (1.0 - ssim(splat.image, target))
        torch.autograd.backward(loss)
        with torch.no_grad():
            self._sums += torch.stack([loss.detach(), error.detach().square().mean()])
            self._seen += 1
            if growing:
                self.pull.add(splat)
        self.optimiser.param_groups[0]["lr"] = settings.means_rate(self.iteration, self.extent)
        if settings.densifies(self.iteration):
            # In place of the step: in the reference too, new parameters have no gradient when it is taken.
            self._densify()
        else:
            self.optimiser.step()
        self.optimiser.zero_grad(set_to_none=True)
        if settings.resets(self.iteration):
            reset_opacities(self.optimiser, settings.density.reset_opacity)

    def _densify(self) -> None:
        # A CPU generator of its own: its numbers depend on seed and iteration only.
        generator = torch.Generator().manual_seed(self.settings.seed * 1_000_003 + self.iteration)
        count, cap = len(self.pull.total), self.density.max_gaussians
        room = room_for(count, self.rasteriser.device)
        done = densify(
            self.optimiser, self.pull, self.density, self.extent, generator,
            prune_large=self.settings.prunes_large(self.iteration), room=room,
        )  # fmt: skip
        self.pull = done.pull
        by_memory = room is not None and (cap is None or room < cap - count)
        if done.refused and by_memory and self.full_at is None:
            self.full_at = self.iteration
        release(self.rasteriser.device)

    def _next_view(self) -> int:
        """Every view once per round, in an order of the round's own."""
        turn, place = divmod(self.iteration - 1, len(self.views))
        return _order(self.settings.seed, turn, len(self.views))[place]

    def report(self) -> TrainingState:
        """Means since the last report.

        Raises:
            Avs3dError: if the loss is not finite.
        """
        loss, error = (self._sums / max(1, self._seen)).tolist()
        self._sums.zero_()
        self._seen = 0
        if not math.isfinite(loss):
            where = self.views[0].frame.observation.key
            raise Avs3dError(f"{where}: the loss is {loss} at iteration {self.iteration}; lower the learning rates")
        ratio = math.inf if error <= 0 else -10.0 * math.log10(error)
        return TrainingState(self.iteration, self.settings.iterations, loss, ratio, len(self.pull.total), self.full_at)


@lru_cache(maxsize=2)
def _order(seed: int, turn: int, count: int) -> tuple[int, ...]:
    return tuple(np.random.default_rng([seed, turn]).permutation(count).tolist())


def _optimiser(values: Sequence[Tensor], settings: TrainingSettings, extent: float) -> torch.optim.Adam:
    rates = {
        "means": settings.means_rate(0, extent),
        "log_scales": settings.rate_scale,
        "rotations": settings.rate_rotation,
        "opacities": settings.rate_opacity,
        "sh0": settings.rate_sh0,
        "sh_rest": settings.rate_sh0 / 20.0,
    }
    groups = [
        {"params": [torch.nn.Parameter(value.clone())], "lr": rate, "name": name}
        for value, (name, rate) in zip(values, rates.items(), strict=True)
    ]
    return torch.optim.Adam(groups, eps=1e-15, fused=values[0].device.type == "cuda")
