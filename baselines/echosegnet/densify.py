"""Adaptive density control of 3D-GS (Kerbl et al. 2023, section 5), with its state handed in and out.

Where the picture pulls a Gaussian's centre about, the scene lacks detail: small Gaussians are cloned, large ones are
split into two. Those that have become transparent are removed, and, once opacities have been reset for the first time,
those that are large in the scene.

The rules and their constants are those of the reference implementation, as it runs, and there is no cap on the number
of Gaussians unless one is asked for. The reference also names a limit of 20 pixels on screen, but clears the radii just
before it compares them (its issue 123), so that this limit never removes anything. ``max_screen=20`` applies it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from baselines.echosegnet.rasteriser.rendering import Splat

#: Names of the parameters, in the order of the optimiser's groups.
PARAMETERS = ("means", "log_scales", "rotations", "opacities", "sh0", "sh_rest")
#: A split Gaussian's two parts are smaller by this factor.
_SHRINK = 1.6


@dataclass(frozen=True)
class DensityControl:
    """Thresholds; the defaults are the reference's.

    Attributes:
        gradient: mean length of the loss's gradient by the centre in the image, in half widths of it (as the reference
            measures it), from which on a Gaussian is cloned or split.
        size: share of the camera extent up to which it is cloned, beyond which it is split.
        min_opacity: below this it is removed.
        reset_opacity: largest opacity after a reset.
        max_screen: after the first reset, a Gaussian is removed if its radius on screen (3σ, pixels) was above this in
            a view since the last densification; None: whatever its radius, which is what the reference does in effect.
        max_size: after the first reset, it is removed if its largest scale is above this share of the camera extent.
        max_gaussians: growth ends here, and the strongest gradients go first; None: no cap, as in the reference.
        pixels_per_gaussian: nor are there ever more Gaussians than train pixels divided by this; None: no such cap. In
            small pictures every gradient is large, and more Gaussians than data learn the pictures by heart.
    """

    gradient: float = 0.0002
    size: float = 0.01
    min_opacity: float = 0.005
    reset_opacity: float = 0.01
    max_screen: float | None = None
    max_size: float = 0.1
    max_gaussians: int | None = None
    pixels_per_gaussian: int | None = None

    def limited(self, pixels: int) -> DensityControl:
        """With the limit that so many train pixels set."""
        limits = [self.max_gaussians, pixels // self.pixels_per_gaussian if self.pixels_per_gaussian else None]
        return replace(self, max_gaussians=min((limit for limit in limits if limit is not None), default=None))


@dataclass(eq=False)
class GradientStats:
    """Statistics of N Gaussians since the last densification.

    Attributes:
        total: (N,) sum of gradient lengths.
        count: (N,) in how many views it was visible.
        radius: (N,) largest radius on screen (3σ), pixels.
    """

    total: Tensor
    count: Tensor
    radius: Tensor

    @classmethod
    def zeros(cls, like: Tensor) -> GradientStats:
        """For as many Gaussians as ``like`` has."""
        return cls(*(like.new_zeros(len(like)) for _ in range(3)))

    def add(self, splat: Splat) -> None:
        """Take in the gradient that the backward pass left at ``splat.means2d``, and the radii."""
        gradient = splat.means2d.grad
        if gradient is None:
            return
        height, width = splat.alpha.shape
        g = gradient.reshape(-1, 2)
        self.total += torch.hypot(g[:, 0] * (width / 2), g[:, 1] * (height / 2))
        self.count += splat.visible
        torch.maximum(self.radius, splat.radii(), out=self.radius)


@dataclass(frozen=True, eq=False)
class Densified:
    """The outcome of `densify`: sums at zero for the new set, and how many clones and splits found no room."""

    pull: GradientStats
    refused: int


def densify(
    optimiser: torch.optim.Adam,
    pull: GradientStats,
    control: DensityControl,
    extent: float,
    generator: torch.Generator,
    *,
    prune_large: bool = False,
    room: int | None = None,
) -> Densified:
    """Clone, split and prune in place of the optimiser's parameters.

    Args:
        optimiser: one group per name in `PARAMETERS`, with its ``name``; parameters and moments are replaced.
        pull: since the last time.
        control: thresholds.
        extent: of the cameras, metres.
        generator: for the places of split Gaussians; on the CPU.
        prune_large: remove large ones too: opacities have been reset before.
        room: how many Gaussians more memory holds; None: as many as there may be.
    """
    with torch.no_grad():
        old = parameters(optimiser)
        mean = pull.total / pull.count.clamp(min=1.0)
        size = old["log_scales"].exp().amax(dim=1)
        wanted = (mean >= control.gradient).nonzero()[:, 0]
        limits = [room, None if control.max_gaussians is None else control.max_gaussians - len(mean)]
        most = max(0, min((limit for limit in limits if limit is not None), default=len(wanted)))
        refused = max(0, len(wanted) - most)
        if refused:
            strongest = torch.sort(mean[wanted], descending=True, stable=True).indices[:most]
            wanted = wanted[strongest].sort().values
        large = size[wanted] > control.size * extent
        cloned, split = wanted[~large], wanted[large]
        opaque = old["opacities"].sigmoid() >= control.min_opacity
        kept = opaque.clone()
        kept[split] = False
        if prune_large:
            kept &= size <= control.max_size * extent
            if control.max_screen is not None:
                kept &= pull.radius <= control.max_screen
            # Clones are small; a Gaussian that is split is represented by its halves.
            split = split[size[split] / _SHRINK <= control.max_size * extent]
        cloned, split = cloned[opaque[cloned]], split[opaque[split]]
        parts = {name: value[torch.cat([cloned, split, split])] for name, value in old.items()}
        if len(split):
            first = len(cloned)
            noise = torch.randn((2 * len(split), 3), generator=generator, dtype=torch.float32).to(mean)
            parts["means"][first:] += _turn(parts["rotations"][first:], noise * parts["log_scales"][first:].exp())
            parts["log_scales"][first:] -= math.log(_SHRINK)
        _rebuild(optimiser, kept.nonzero()[:, 0], parts)
        return Densified(GradientStats.zeros(parameters(optimiser)["means"]), refused)


def reset_opacities(optimiser: torch.optim.Adam, ceiling: float) -> None:
    """Lower all opacities to at most ``ceiling`` and forget their moments; unneeded Gaussians stay transparent."""
    with torch.no_grad():
        for group in optimiser.param_groups:
            if group["name"] == "opacities":
                (value,) = group["params"]
                value.clamp_(max=math.log(ceiling / (1.0 - ceiling)))
                for key in ("exp_avg", "exp_avg_sq"):
                    if key in optimiser.state[value]:
                        optimiser.state[value][key].zero_()


def parameters(optimiser: torch.optim.Adam) -> dict[str, Tensor]:
    """The parameters by name."""
    return {group["name"]: group["params"][0] for group in optimiser.param_groups}


def _turn(quaternions: Tensor, vectors: Tensor) -> Tensor:
    """Vectors (N, 3) rotated by quaternions (N, 4) wxyz: v + 2w (q × v) + 2 q × (q × v)."""
    unit = torch.nn.functional.normalize(quaternions, dim=-1)
    w, axis = unit[:, :1], unit[:, 1:]
    once = torch.linalg.cross(axis, vectors)
    out: Tensor = vectors + 2.0 * (w * once + torch.linalg.cross(axis, once))
    return out


def _rebuild(optimiser: torch.optim.Adam, kept: Tensor, parts: Mapping[str, Tensor]) -> None:
    """Keep some parameters and append others, whose moments start at zero."""
    for group in optimiser.param_groups:
        (old,) = group["params"]
        fresh = parts[group["name"]]
        state = optimiser.state.pop(old, {})
        new = torch.nn.Parameter(torch.cat([old.detach()[kept], fresh]))
        for key in ("exp_avg", "exp_avg_sq"):
            if key in state:
                state[key] = torch.cat([state[key][kept], torch.zeros_like(fresh)])
        if state:
            optimiser.state[new] = state
        group["params"] = [new]
