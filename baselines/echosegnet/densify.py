"""Adaptive density control of 3D-GS (Kerbl et al. 2023, section 5), with its state handed in and out.

Where the picture pulls a Gaussian's centre about, the scene lacks detail: small Gaussians are cloned, large ones are
split into two. Those that have become transparent are removed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from baselines.echosegnet.rendering import Splat

#: Names of the parameters, in the order of the optimiser's groups.
PARAMETERS = ("means", "log_scales", "rotations", "opacities", "sh0", "sh_rest")
#: A split Gaussian's two parts are smaller by this factor.
_SHRINK = 1.6


@dataclass(frozen=True)
class DensityControl:
    """Thresholds.

    Attributes:
        gradient: mean length of the loss's gradient by the centre in the image, in half widths of it (as the reference
            measures it), from which on a Gaussian is cloned or split.
        size: share of the camera extent up to which it is cloned, beyond which it is split.
        min_opacity: below this it is removed.
        reset_opacity: what a reset lowers opacities to.
        max_gaussians: growth ends here; the strongest gradients go first.
        pixels_per_gaussian: nor are there ever more Gaussians than train pixels divided by this: in small pictures
            every gradient is large, and more Gaussians than data would learn the pictures by heart.
    """

    gradient: float = 0.0002
    size: float = 0.01
    min_opacity: float = 0.005
    reset_opacity: float = 0.01
    max_gaussians: int = 600_000
    pixels_per_gaussian: int = 20

    def limited(self, pixels: int) -> DensityControl:
        """With the limit that so many train pixels set."""
        return replace(self, max_gaussians=min(self.max_gaussians, pixels // self.pixels_per_gaussian))


@dataclass(eq=False)
class Pull:
    """Running sums since the last densification: (N,) gradient lengths, and (N,) in how many views it was visible."""

    total: Tensor
    count: Tensor

    @classmethod
    def zeros(cls, like: Tensor) -> Pull:
        """For as many Gaussians as ``like`` has."""
        return cls(like.new_zeros(len(like)), like.new_zeros(len(like)))

    def add(self, splat: Splat) -> None:
        """Take in the gradient that the backward pass left at ``splat.means2d``."""
        gradient = splat.means2d.grad
        if gradient is None:
            return
        height, width = splat.alpha.shape
        g = gradient.reshape(-1, 2)
        self.total += torch.hypot(g[:, 0] * (width / 2), g[:, 1] * (height / 2))
        self.count += splat.visible


def densify(
    optimiser: torch.optim.Adam, pull: Pull, control: DensityControl, extent: float, generator: torch.Generator
) -> Pull:
    """Clone, split and prune in place of the optimiser's parameters.

    Args:
        optimiser: one group per name in `PARAMETERS`, with its ``name``; parameters and moments are replaced.
        pull: since the last time.
        control: thresholds.
        extent: of the cameras, metres.
        generator: for the places of split Gaussians; on the CPU.

    Returns:
        Sums at zero for the new set.
    """
    with torch.no_grad():
        old = parameters(optimiser)
        mean = pull.total / pull.count.clamp(min=1.0)
        size = old["log_scales"].exp().amax(dim=1)
        wanted = (mean >= control.gradient).nonzero()[:, 0]
        room = max(0, control.max_gaussians - len(mean))
        if len(wanted) > room:
            strongest = torch.sort(mean[wanted], descending=True, stable=True).indices[:room]
            wanted = wanted[strongest].sort().values
        large = size[wanted] > control.size * extent
        cloned, split = wanted[~large], wanted[large]
        kept = torch.ones(len(mean), dtype=torch.bool, device=mean.device)
        kept[split] = False
        kept &= old["opacities"].sigmoid() >= control.min_opacity
        cloned = cloned[kept[cloned]]
        split = split[old["opacities"][split].sigmoid() >= control.min_opacity]
        parts = {name: value[torch.cat([cloned, split, split])] for name, value in old.items()}
        if len(split):
            first = len(cloned)
            noise = torch.randn((2 * len(split), 3), generator=generator, dtype=torch.float32).to(mean)
            parts["means"][first:] += _turn(parts["rotations"][first:], noise * parts["log_scales"][first:].exp())
            parts["log_scales"][first:] -= math.log(_SHRINK)
        _rebuild(optimiser, kept.nonzero()[:, 0], parts)
        return Pull.zeros(parameters(optimiser)["means"])


def reset_opacities(optimiser: torch.optim.Adam, ceiling: float) -> None:
    """Lower all opacities to at most ``ceiling`` and forget their moments: what is not needed does not come back."""
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
