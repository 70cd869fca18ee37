"""Similarity of two pictures: PSNR and SSIM (Wang et al. 2004), the second as a training loss with its own gradient."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import torch
from torch import Tensor

_WINDOW, _SIGMA = 11, 1.5
_C1, _C2 = 0.01**2, 0.03**2


def psnr(first: Tensor, second: Tensor) -> float:
    """Peak signal-to-noise ratio in dB of two pictures of the same shape with values in [0, 1]; infinite if equal."""
    error = float((first.detach().double() - second.detach().to(first.device).double()).square().mean())
    return math.inf if error == 0.0 else -10.0 * math.log10(error)


def ssim(picture: Tensor, target: Tensor) -> Tensor:
    """Mean structural similarity of (H, W, C) pictures in [0, 1], as 3D-GS measures it.

    Gaussian window of 11 × 11 pixels, σ = 1.5; beyond the border pictures are black.

    Args:
        picture: (H, W, C), differentiable.
        target: (H, W, C), taken as constant.
    """
    return _Ssim.apply(picture, target)  # type: ignore[no-untyped-call,no-any-return]


@lru_cache(maxsize=8)
def _window(channels: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """(channels, 1, 1, 11) weights of one axis; made once, so that training never waits for a copy."""
    offset = torch.arange(_WINDOW, dtype=torch.float64) - _WINDOW // 2
    weight = torch.exp(-0.5 * (offset / _SIGMA) ** 2)
    return (weight / weight.sum()).to(device, dtype).expand(channels, 1, 1, _WINDOW).contiguous()


def _blur(maps: Tensor) -> Tensor:
    """(C, H, W) convolved with the window along both axes, zeros outside; it is its own transpose."""
    weight, half = _window(len(maps), maps.dtype, maps.device), _WINDOW // 2
    across = torch.nn.functional.conv2d(maps[None], weight, padding=(0, half), groups=len(maps))
    down = torch.nn.functional.conv2d(across, weight.transpose(2, 3), padding=(half, 0), groups=len(maps))
    return down[0]


class _Ssim(torch.autograd.Function):
    """One blur of 15 maps forward and one of 9 backward: half the work of differentiating every step."""

    @staticmethod
    def forward(ctx: Any, picture: Tensor, target: Tensor) -> Tensor:
        x, y = picture.permute(2, 0, 1), target.permute(2, 0, 1)
        mean_x, mean_y, xx, yy, xy = _blur(torch.cat([x, y, x * x, y * y, x * y])).chunk(5)
        product = mean_x * mean_y
        squares = mean_x * mean_x + mean_y * mean_y
        luminance, structure = 2 * product + _C1, 2 * (xy - product) + _C2
        energy, variance = squares + _C1, xx + yy - squares + _C2
        value = luminance * structure / (energy * variance)
        if ctx.needs_input_grad[0]:
            scale = 1.0 / (energy * variance)
            by_mean = 2 * (mean_y * (structure - luminance) * scale + mean_x * value * (1 / variance - 1 / energy))
            ctx.save_for_backward(x, y, by_mean, -value / variance, 2 * luminance * scale)
        return value.mean()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        x, y, by_mean, by_xx, by_xy = ctx.saved_tensors
        mean, square, cross = _blur(torch.cat([by_mean, by_xx, by_xy])).chunk(3)
        gradient = (mean + 2 * x * square + y * cross) * (gradients[0] / x.numel())
        return gradient.permute(1, 2, 0), None
