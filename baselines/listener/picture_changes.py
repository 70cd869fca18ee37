"""Random changes of pictures that keep what is seen and where: another camera, another light, a smaller file.

Each change has a name (`PICTURE_CHANGES`) with which a run leaves it out.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, conv2d, pad

from baselines.listener.sound_changes import uniform

#: Names of the changes; see `changed_pictures`.
PICTURE_CHANGES = ("colour", "blur", "grain", "jpeg")
#: Shares of pictures: grey, blurred, through a file of few bytes.
GREY, BLURRED, PACKED = 0.1, 0.25, 0.3
#: Standard deviations of a blur (pixels), largest standard deviation of grain, steps of a file's coefficients.
BLUR, GRAIN, JPEG_STEP = (0.4, 1.6), 0.04, (0.02, 0.08)
#: Side of the blocks of a file (pixels).
_BLOCK = 8


def changed_pictures(pictures: Tensor, generator: torch.Generator, without: Collection[str] = ()) -> Tensor:
    """Pictures (B, 3, H, W), 0 to 1, with other colours, blurred, as a file of few bytes, with grain.

    Args:
        pictures: float32.
        generator: of random numbers, on the pictures' device.
        without: names of `PICTURE_CHANGES` that are left out.
    """
    out = pictures
    if "colour" not in without:
        out = coloured(out, generator)
    if "blur" not in without:
        out = blurred(out, generator)
    if "grain" not in without:
        noise = torch.randn(out.shape, generator=generator, device=out.device)
        coarse = uniform(generator, len(out))[:, None, None, None] < 0.3
        smooth = 3 * avg_pool2d(pad(noise, (1, 1, 1, 1), mode="replicate"), 3, 1)
        amount = GRAIN * uniform(generator, len(out))[:, None, None, None].square()
        out = out + amount * torch.where(coarse, smooth, noise)
    if "jpeg" not in without:
        out = packed(out, generator)
    return out.clamp(0, 1)


def coloured(pictures: Tensor, generator: torch.Generator) -> Tensor:
    """Other brightness, contrast, gamma, saturation and tint; some grey."""
    count = len(pictures)

    def each(low: float, high: float, channels: int = 1) -> Tensor:
        return uniform(generator, count * channels, low, high).view(count, channels, 1, 1)

    out = pictures.clamp(min=1e-4) ** torch.exp(each(-0.45, 0.45))
    out = out * each(0.7, 1.3) * each(0.85, 1.15, 3)
    mean = out.mean(dim=(1, 2, 3), keepdim=True)
    out = mean + (out - mean) * each(0.7, 1.3)
    grey = out.mean(dim=1, keepdim=True)
    saturation = each(0.5, 1.4) * (each(0, 1) >= GREY)
    return (grey + (out - grey) * saturation).clamp(0, 1)


def blurred(pictures: Tensor, generator: torch.Generator) -> Tensor:
    """Some pictures out of focus: a Gaussian over 5 × 5 pixels, of a width of its own for each."""
    count, channels, height, width = pictures.shape
    spread = uniform(generator, count, *BLUR)
    at = torch.arange(-2, 3, device=pictures.device)
    line = torch.exp(-0.5 * (at / spread[:, None]).square())
    line = line / line.sum(dim=1, keepdim=True)
    point = (at == 0).float().expand_as(line)
    line = torch.where((uniform(generator, count) < BLURRED)[:, None], line, point).repeat_interleave(channels, 0)
    flat = pad(pictures, (2, 2, 2, 2), mode="replicate").reshape(1, count * channels, height + 4, width + 4)
    flat = conv2d(flat, line[:, None, :, None], groups=count * channels)
    flat = conv2d(flat, line[:, None, None, :], groups=count * channels)
    return flat.view(count, channels, height, width)


def packed(pictures: Tensor, generator: torch.Generator) -> Tensor:
    """Some pictures as JPEG leaves them: the cosine transform of blocks of 8 × 8 pixels, rounded, high ones coarser."""
    count, _, height, width = pictures.shape
    up, left = -height % _BLOCK, -width % _BLOCK
    whole = pad(pictures, (0, left, 0, up), mode="replicate")
    blocks = whole.unfold(2, _BLOCK, _BLOCK).unfold(3, _BLOCK, _BLOCK)
    number = torch.arange(_BLOCK, device=pictures.device)
    cosine = torch.cos(math.pi / _BLOCK * (number + 0.5) * number[:, None]) * math.sqrt(2 / _BLOCK)
    cosine[0] /= math.sqrt(2)
    found = cosine @ blocks @ cosine.T
    step = uniform(generator, count, *JPEG_STEP).view(count, 1, 1, 1, 1, 1) * (1 + number[:, None] + number)
    found = (found / step).round() * step
    back = (cosine.T @ found @ cosine).permute(0, 1, 2, 4, 3, 5).reshape(whole.shape)[..., :height, :width]
    return torch.where((uniform(generator, count) < PACKED)[:, None, None, None], back, pictures)
