"""Schedule and learning rates of a training of 3D Gaussians."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from avs3d_bench.errors import UsageError
from baselines.echosegnet.densify import DensityControl

_REFERENCE = 30_000


@dataclass(frozen=True)
class TrainingSettings:
    """How long, how fast, and when what happens; the defaults are the reference's.

    The times below are those of 30,000 iterations; with fewer or more everything happens in proportion, but nothing
    more often than is said.

    Attributes:
        iterations: number of steps, one view each.
        sh_degree: of the colours; one band is opened every ``sh_every``.
        ssim_weight: λ of (1 − λ)·L1 + λ·(1 − SSIM).
        rate_means: learning rate of centres in camera extents, falling exponentially to ``rate_means_final``.
        rate_means_final: at the end.
        rate_sh0: of the constant colour; that of the other bands is a twentieth.
        rate_opacity: of opacity logits.
        rate_scale: of logarithms of scales.
        rate_rotation: of quaternions.
        densify_from: densification begins after this iteration.
        densify_until: from this iteration on nothing is added, removed or reset.
        densify_every: iterations between two densifications, never below 10.
        reset_every: iterations between two resets of opacity, never below 1,000.
        sh_every: iterations per band.
        density: thresholds of densification.
        seed: of the order of views and the places of split Gaussians.
    """

    iterations: int = _REFERENCE
    sh_degree: int = 3
    ssim_weight: float = 0.2
    rate_means: float = 1.6e-4
    rate_means_final: float = 1.6e-6
    rate_sh0: float = 2.5e-3
    rate_opacity: float = 0.05
    rate_scale: float = 5e-3
    rate_rotation: float = 1e-3
    densify_from: int = 500
    densify_until: int = 15_000
    densify_every: int = 100
    reset_every: int = 3_000
    sh_every: int = 1_000
    density: DensityControl = field(default_factory=DensityControl)
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse settings that mean nothing.

        Raises:
            UsageError: naming the setting.
        """
        for name in ("iterations", "densify_from", "densify_until", "densify_every", "reset_every", "sh_every"):
            if getattr(self, name) < 1:
                raise UsageError(f"{name} {getattr(self, name)}: expected at least 1")
        for name in ("means", "means_final", "sh0", "opacity", "scale", "rotation"):
            rate = getattr(self, f"rate_{name}")
            if not 0.0 < rate < math.inf:
                raise UsageError(f"rate_{name} {rate}: expected a finite number above 0")
        if not 0.0 <= self.ssim_weight <= 1.0:
            raise UsageError(f"ssim_weight {self.ssim_weight}: expected a share from 0 to 1")
        if self.sh_degree not in (0, 1, 2, 3):
            raise UsageError(f"sh_degree {self.sh_degree}: expected 0, 1, 2 or 3")
        cap = self.density.max_gaussians
        if cap is not None and cap < 2:
            raise UsageError(f"max_gaussians {cap}: expected at least 2, or none for no cap")

    def scaled(self, time: int, least: int = 1) -> int:
        """A time of the reference's 30,000 iterations in this run."""
        return max(least, round(time * self.iterations / _REFERENCE))

    def means_rate(self, iteration: int, extent: float) -> float:
        """Learning rate of the centres in metres."""
        done = min(1.0, iteration / self.iterations)
        return extent * math.exp((1 - done) * math.log(self.rate_means) + done * math.log(self.rate_means_final))

    def densifies(self, iteration: int) -> bool:
        """Whether Gaussians are added and removed after this iteration."""
        first, last = self.scaled(self.densify_from), self.scaled(self.densify_until)
        return first < iteration < last and iteration % self.scaled(self.densify_every, 10) == 0

    def grows(self, iteration: int) -> bool:
        """Whether what densification needs is gathered in this iteration."""
        return iteration < self.scaled(self.densify_until)

    def prunes_large(self, iteration: int) -> bool:
        """Whether a densification after this iteration also removes large Gaussians: after the first reset."""
        return iteration > self.scaled(self.reset_every, 1_000)

    def resets(self, iteration: int) -> bool:
        """Whether opacities are lowered after this iteration."""
        return self.grows(iteration) and iteration % self.scaled(self.reset_every, 1_000) == 0
