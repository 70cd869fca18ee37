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
PICTURE_CHANGES = ("clutter", "colour", "blur", "grain", "jpeg")
#: Shares of pictures: grey, blurred, through a file of few bytes.
GREY, BLURRED, PACKED = 0.1, 0.25, 0.3
#: Standard deviations of a blur (pixels), largest standard deviation of grain, steps of a file's coefficients.
BLUR, GRAIN, JPEG_STEP = (0.4, 1.6), 0.04, (0.02, 0.08)
#: Share of pictures with other surroundings. Times the details that they have, and those of another picture's
#: surroundings; largest standard deviation of a texture (share of the brightness), slopes of its power spectrum;
#: details are smaller than this side (pixels).
CLUTTERED, OWN, OTHERS = 0.4, (0.5, 2.5), (0.0, 1.2)
TEXTURE, SLOPES, DETAIL = 0.15, (1.5, 3.0), 15
#: Side of the blocks of a file (pixels).
_BLOCK = 8


def changed_pictures(
    pictures: Tensor, objects: Tensor, generator: torch.Generator, without: Collection[str] = ()
) -> Tensor:
    """Pictures (B, 3, H, W), 0 to 1, with other surroundings and colours, blurred, as a file of few bytes, with grain.

    Args:
        pictures: float32.
        objects: (B, H, W) bool, where something of the categories is.
        generator: of random numbers, on the pictures' device.
        without: names of `PICTURE_CHANGES` that are left out.
    """
    out = pictures
    if "clutter" not in without:
        out = cluttered(out, objects, generator)
    if "colour" not in without:
        out = coloured(out, generator)
    if "blur" not in without:
        out = blurred(out, generator)
    if "grain" not in without:
        noise = torch.randn(out.shape, generator=generator, device=out.device)
        coarse = uniform(generator, len(out))[:, None, None, None] < 0.3
        amount = GRAIN * uniform(generator, len(out))[:, None, None, None].square()
        out = out + amount * torch.where(coarse, 3 * _smooth(noise, 3), noise)
    if "jpeg" not in without:
        out = packed(out, generator)
    return out.clamp(0, 1)


def cluttered(pictures: Tensor, objects: Tensor, generator: torch.Generator) -> Tensor:
    """Some pictures with more detail around their objects, as photographs of rooms have it.

    Random surroundings help a network that learns from renderings to see in photographs (Tobin et al., *Domain
    randomization for transferring deep neural networks from simulation to the real world*, IROS 2017). Here the
    picture's own details are weakened or strengthened, those of another picture's surroundings are added, and the
    result is multiplied by a texture whose power falls with the frequency as that of natural images does (Field 1987).
    Objects change by a random share of it, up to a half: not only what is smooth is an object.
    """
    count, channels, height, width = pictures.shape

    def each(low: float, high: float) -> Tensor:
        return uniform(generator, count, low, high).view(count, 1, 1, 1)

    inside = _smooth(objects[:, None].float(), 3)
    around = 1 - inside
    detail = (pictures - _smooth(pictures, DETAIL)) * around
    others = detail[torch.randperm(count, generator=generator, device=pictures.device)].flip(-1)
    down = torch.fft.fftfreq(height, device=pictures.device)[:, None]
    frequency = torch.hypot(down, torch.fft.rfftfreq(width, device=pictures.device)).clamp(min=1 / max(height, width))
    noise = torch.randn(count, 1 + channels, height, width, generator=generator, device=pictures.device)
    texture = torch.fft.irfft2(torch.fft.rfft2(noise) * frequency ** (-0.5 * each(*SLOPES)), s=(height, width))
    texture = texture / texture.std(dim=(2, 3), keepdim=True).clamp(min=1e-6)
    texture = texture[:, :1] + each(0, 0.4) * texture[:, 1:]
    changed = pictures + (each(*OWN) - 1) * detail + each(*OTHERS) * others
    changed = changed * (1 + each(0, 1).square() * TEXTURE * texture).clamp(min=0)
    chosen = (uniform(generator, count) < CLUTTERED).view(count, 1, 1, 1)
    return torch.lerp(pictures, changed, (1 - each(0.5, 1) * inside) * chosen).clamp(0, 1)


def _smooth(values: Tensor, side: int) -> Tensor:
    """Means over squares of an odd number of pixels."""
    return avg_pool2d(pad(values, (side // 2,) * 4, mode="replicate"), side, 1)


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
