"""The parts that the network is built of: convolutional blocks for pictures, attention from pixels to moments of sound.

Layers of many pixels are normalised over the batch (Ioffe & Szegedy, ICML 2015): with few steps and few channels the
network learns sooner than with a normalisation of each pixel.

Sources: ConvNeXt blocks (Liu et al., "A ConvNet for the 2020s", CVPR 2022), U-Net (Ronneberger et al., MICCAI 2015),
attention (Vaswani et al., "Attention is all you need", NeurIPS 2017).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

#: Initial scale of a residual branch (ConvNeXt has 1e-6, for networks of many more blocks).
LAYER_SCALE = 0.5


class Block(nn.Module):
    """ConvNeXt block: depthwise 7 × 7, normalisation, a hidden layer at every pixel; added to its input.

    Args:
        channels: of input and output.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.depthwise = nn.Conv2d(channels, channels, 7, padding=3, groups=channels)
        self.norm = nn.LayerNorm(channels)
        self.up = nn.Linear(channels, 4 * channels)
        self.down = nn.Linear(4 * channels, channels)
        self.scale = nn.Parameter(torch.full((channels,), LAYER_SCALE))

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, h, w) to the same."""
        inner = self.norm(self.depthwise(x).permute(0, 2, 3, 1))
        inner = self.scale * self.down(functional.gelu(self.up(inner)))
        out: Tensor = x + inner.permute(0, 3, 1, 2)
        return out


class Mix(nn.Module):
    """Residual block of fine strides: a 3 × 3 convolution of all channels with all, then one at every pixel.

    Where channels are few, a depthwise convolution takes a CPU about as long as this one, which does far more.

    Args:
        channels: of input and output.
        normed: whether the input is normalised first.
    """

    def __init__(self, channels: int, *, normed: bool = False) -> None:
        super().__init__()
        self.norm = nn.BatchNorm2d(channels) if normed else nn.Identity()
        self.around = nn.Conv2d(channels, channels, 3, padding=1)
        self.here = nn.Conv2d(channels, channels, 1)
        self.scale = nn.Parameter(torch.full((channels, 1, 1), LAYER_SCALE))

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, h, w) to the same."""
        out: Tensor = x + self.scale * self.here(functional.gelu(self.around(self.norm(x))))
        return out


def down(before: int, after: int) -> nn.Sequential:
    """Half the size."""
    return nn.Sequential(nn.BatchNorm2d(before), nn.Conv2d(before, after, 2, stride=2))


class Up(nn.Module):
    """One level of a decoder: twice the size, joined with the encoder's level and with more channels, then a `Mix`.

    Args:
        before: channels from below.
        skip: channels of the encoder's level.
        more: further channels at this level, 0 for none.
        after: channels of the result.
    """

    def __init__(self, before: int, skip: int, more: int, after: int) -> None:
        super().__init__()
        self.below = nn.Conv2d(before, after, 1)
        self.beside = nn.Conv2d(skip, after, 1)
        self.more = nn.Conv2d(more, after, 1) if more else None
        self.norm = nn.BatchNorm2d(after)
        self.mix = Mix(after)

    def forward(self, x: Tensor, skip: Tensor, more: Tensor | None = None) -> Tensor:
        """(B, after, 2h, 2w); ``skip`` of fewer pictures is repeated, one after another, for the sounds of each."""
        large = functional.interpolate(self.below(x), scale_factor=2.0, mode="bilinear", align_corners=False)
        beside = self.beside(skip)
        repeats = large.shape[0] // beside.shape[0]
        joined = large + (beside.repeat_interleave(repeats, 0) if repeats > 1 else beside)
        if self.more is not None:
            assert more is not None
            joined = joined + self.more(more)
        out: Tensor = self.mix(self.norm(joined))
        return out


class Listen(nn.Module):
    """Attention from the cells of a picture to the moments of a sound, then a hidden layer; both are added.

    Args:
        channels: of cells and moments.
        heads: of the attention.
    """

    def __init__(self, channels: int, heads: int = 8) -> None:
        super().__init__()
        self.heads = heads
        self.norm_cells = nn.LayerNorm(channels)
        self.norm_moments = nn.LayerNorm(channels)
        self.query = nn.Linear(channels, channels)
        self.key_value = nn.Linear(channels, 2 * channels)
        self.out = nn.Linear(channels, channels)
        self.norm = nn.LayerNorm(channels)
        self.hidden = nn.Sequential(nn.Linear(channels, 2 * channels), nn.GELU(), nn.Linear(2 * channels, channels))

    def forward(self, cells: Tensor, moments: Tensor) -> Tensor:
        """(B, n, C) from cells (B, n, C) and moments (B, m, C)."""

        def split(x: Tensor) -> Tensor:
            return x.reshape(*x.shape[:-1], self.heads, -1).transpose(1, 2)

        query = split(self.query(self.norm_cells(cells)))
        key, value = (split(x) for x in self.key_value(self.norm_moments(moments)).chunk(2, dim=-1))
        heard = functional.scaled_dot_product_attention(query, key, value)
        cells = cells + self.out(heard.transpose(1, 2).flatten(2))
        return cells + self.hidden(self.norm(cells))  # type: ignore[no-any-return]
