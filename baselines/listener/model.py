"""The network: a picture and one second of binaural sound become a mask of what sounds.

*What* and *where* stay apart until the last step:

    picture ── encoder ──┬── decoder ──────────────── classes: what is at each pixel (the sound is not used)
                         │                                │
    sound ── encoder ────│──┬───────────────────────── audible: what is heard (the picture is not used)
                         │  │                             │
                         │  │        match map: how probable it is that the category of this pixel is heard,
                         │  │        or something that has no name
                         │  │                             │
                         └── attention ── decoder ── mask: what sounds
                                             │
    sound ── steered response ── direction map: how well this pixel's direction explains both ears

The last decoder gets the match map (what) and the direction map (where) at every level. No gradient flows from the
mask into the match map: classes and audible categories learn from their own truths alone.

One picture serves several sounds: the picture's encoder and first decoder run once for all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from avs3d_bench.contract.taxonomy import CATEGORIES
from baselines.listener import direction, features
from baselines.listener.blocks import Block, Listen, Mix, Up, down
from baselines.listener.lite import LITE_CHANNELS, LITE_MEAN, LITE_STD, LiteEncoder

#: Pictures are padded to a multiple of this at the right and at the bottom (pixels).
MULTIPLE = 32
#: Classes of a pixel: 0 nothing of these, then the categories in the taxonomy's order.
CLASSES = 1 + len(CATEGORIES)
#: Mean and standard deviation of a channel of pictures (of 0 to 1), roughly.
PICTURE_MEAN, PICTURE_STD = 0.45, 0.25
#: Encoders of pictures by name, and the mean and standard deviation of their pictures.
ENCODERS = {"convnext": (PICTURE_MEAN, PICTURE_STD), "lite0": (LITE_MEAN, LITE_STD)}
#: Stride of the direction map, and of the finest level that attends to it (pixels).
FINEST = 4
#: Log-odds of the match map are cut here on both sides.
MOST_ODDS = 6.0
#: Log-odds of "nothing" that the class of a pixel begins with.
NOTHING_FIRST = 3.0


#: Most channels of a level, and most blocks or layers, of a network that is read from a file.
MOST_CHANNELS, MOST_LAYERS = 4096, 64


@dataclass(frozen=True)
class Widths:
    """Size of the network.

    Attributes:
        image: channels of the encoder at strides 2, 4, 8, 16, 32.
        blocks: blocks at each of these strides: `Mix` up to stride 8, ConvNeXt beyond.
        decoder: channels of both decoders at strides 16, 8, 4, 2; that of the mask ends at stride 4.
        audio: channels of the sound's encoder; the last is also that of the tokens, and of the attention.
        attention: layers of it.
        unknown: whether it also says how probable it is that something is heard which it cannot name.
        encoder: of pictures: ``convnext``, or ``lite0``, which has channels of its own and no ``blocks`` (see `lite`).

    Examples:
        >>> small = Widths(
        ...     image=(8, 8, 16, 16, 16), blocks=(0, 1, 1, 1, 1), decoder=(16, 16, 8, 8), audio=(8, 8, 16, 16)
        ... )
        >>> Listener(small).settings["decoder"]
        [16, 16, 8, 8]
    """

    image: tuple[int, ...] = (32, 64, 128, 256, 256)
    blocks: tuple[int, ...] = (0, 2, 2, 4, 2)
    decoder: tuple[int, ...] = (128, 96, 64, 32)
    audio: tuple[int, ...] = (32, 64, 128, 256)
    attention: int = 2
    unknown: bool = False
    encoder: str = "convnext"

    def checked(self) -> Widths:
        """The same; for sizes that a file names.

        Raises:
            ValueError: naming the field, if a number is missing or not between 1 (0: of blocks and layers) and the most
                that is built.
        """
        for name, count, least, most in (
            ("image", 5, 1, MOST_CHANNELS), ("blocks", 5, 0, MOST_LAYERS), ("decoder", 4, 1, MOST_CHANNELS),
            ("audio", 4, 1, MOST_CHANNELS), ("attention", None, 0, MOST_LAYERS),
        ):  # fmt: skip
            found = getattr(self, name)
            numbers = (found,) if count is None else found
            if not isinstance(numbers, tuple) or len(numbers) != (count or 1):
                raise ValueError(f"{name}: expected {count or 1} numbers")
            if not all(type(number) is int and least <= number <= most for number in numbers):
                raise ValueError(f"{name}: expected whole numbers between {least} and {most}")
        if not isinstance(self.unknown, bool):
            raise ValueError("unknown: expected true or false")
        if self.encoder not in ENCODERS:
            raise ValueError(f"encoder: expected {' or '.join(ENCODERS)}")
        if self.encoder == "lite0" and self.image != LITE_CHANNELS:
            raise ValueError(f"image: expected {LITE_CHANNELS}, the channels of the encoder lite0")
        return self


#: Sizes by name: of the release, and one that two cores of a CPU train within hours.
SIZES = {
    "lite": Widths(encoder="lite0", image=LITE_CHANNELS, blocks=(0, 0, 0, 0, 0), unknown=True),
    "small": Widths(
        image=(16, 32, 80, 160, 224), blocks=(0, 2, 2, 3, 2), decoder=(96, 64, 32, 16), audio=(32, 64, 96, 128),
        attention=1, unknown=True,
    ),
}  # fmt: skip


class ListenerOutput(NamedTuple):
    """The network's answer for B pictures with K sounds each; all numbers are logits. Without sound K is 0.

    Attributes:
        classes: (B, CLASSES, h, w) at stride 2: what is at each pixel, from the picture alone.
        audible: (B·K, categories [+ 1]): what is heard, from the sound alone; with `Widths.unknown`, the last one:
            something that has no name.
        mask: (B·K, h, w) at stride 2: what sounds.
    """

    classes: Tensor
    audible: Tensor
    mask: Tensor


class SoundFeatures(NamedTuple):
    """Input of `Listener` from B sounds: see `features` and `direction`.

    Attributes:
        bands: (B, features.CHANNELS, features.BANDS, T).
        levels: (B, 4).
        where: (B, direction.CHANNELS, H / FINEST, W / FINEST), the direction map of the sound's picture.
    """

    bands: Tensor
    levels: Tensor
    where: Tensor


class PictureEncoder(nn.Module):
    """Features at strides 2, 4, 8, 16 and 32; dense convolutions where pixels are many, ConvNeXt blocks where few."""

    def __init__(self, widths: Widths) -> None:
        super().__init__()
        first = widths.image[0]
        self.stem = nn.Sequential(
            nn.Conv2d(3, first, 3, stride=2, padding=1),
            nn.BatchNorm2d(first),
            nn.GELU(),
            nn.Conv2d(first, first, 3, padding=1),
        )
        stages: list[nn.Module] = []
        fine = partial(Mix, normed=True)
        kinds: tuple[Callable[[int], nn.Module], ...] = (fine, fine, Block, Block)
        for before, after, count, block in zip(
            widths.image[:-1], widths.image[1:], widths.blocks[1:], kinds, strict=True
        ):
            stages.append(nn.Sequential(down(before, after), *(block(after) for _ in range(count))))
        self.stages = nn.ModuleList(stages)

    def forward(self, picture: Tensor) -> list[Tensor]:
        """Of (B, 3, H, W) normalised."""
        found = [self.stem(picture)]
        for stage in self.stages:
            found.append(stage(found[-1]))
        return found


class SoundEncoder(nn.Module):
    """A small 2D CNN over mel bands and windows: tokens over time, and which categories are audible."""

    def __init__(self, widths: Widths) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        before = features.CHANNELS
        for after in widths.audio:
            layers += [nn.Conv2d(before, after, 3, stride=2, padding=1), nn.BatchNorm2d(after), nn.GELU()]
            before = after
        bands = features.BANDS >> len(widths.audio)
        self.layers = nn.Sequential(*layers)
        self.token = nn.Linear(before * bands, before)
        self.level = nn.Sequential(nn.Linear(4, before), nn.GELU(), nn.Linear(before, before))
        self.norm = nn.LayerNorm(before)
        self.audible = nn.Linear(2 * before, len(CATEGORIES) + widths.unknown)

    def forward(self, bands: Tensor, levels: Tensor) -> tuple[Tensor, Tensor]:
        """Tokens (B, m, C), the first of which holds the broadband levels, and logits (B, categories [+ 1])."""
        moments = self.token(self.layers(bands).permute(0, 3, 1, 2).flatten(2))
        tokens = self.norm(torch.cat([self.level(levels)[:, None].to(moments.dtype), moments], dim=1))
        return tokens, self.audible(torch.cat([tokens.mean(dim=1), tokens.amax(dim=1)], dim=1))


class PictureDecoder(nn.Module):
    """Classes of pixels, from the picture alone."""

    def __init__(self, widths: Widths) -> None:
        super().__init__()
        image, wide = widths.image, widths.decoder
        befores = (image[-1], *wide[:-1])
        self.levels = nn.ModuleList(
            Up(before, skip, 0, after) for before, skip, after in zip(befores, image[-2::-1], wide, strict=True)
        )
        self.head = nn.Conv2d(wide[-1], CLASSES, 1)
        with torch.no_grad():
            assert self.head.bias is not None
            self.head.bias[0] += NOTHING_FIRST

    def forward(self, encoded: list[Tensor]) -> Tensor:
        """(B, CLASSES, h, w) logits at stride 2."""
        x = encoded[-1]
        for level, skip in zip(self.levels, encoded[-2::-1], strict=True):
            x = level(x, skip)
        return self.head(x)  # type: ignore[no-any-return]


class SoundingDecoder(nn.Module):
    """The mask: attention to the sound at stride 32, then a decoder that gets what (match) and where (direction).

    *Where* has no fine edges, but *what* has. So the decoder ends at stride 4 with two numbers, an offset a and a gain
    g, and the log-odds of the mask at stride 2 are a + g · (log-odds of the match map).
    """

    def __init__(self, widths: Widths) -> None:
        super().__init__()
        image, wide, width = widths.image, widths.decoder, widths.audio[-1]
        self.enter = nn.Conv2d(image[-1] + direction.CHANNELS + 1, width, 1)
        self.attention = nn.ModuleList(Listen(width) for _ in range(widths.attention))
        befores = (width, *wide[:-2])
        self.levels = nn.ModuleList(
            Up(before, skip, direction.CHANNELS + 1, after)
            for before, skip, after in zip(befores, image[-2:0:-1], wide[:-1], strict=True)
        )
        self.head = nn.Conv2d(wide[-2], 2, 1)
        # The mask begins as that of the category that is heard.
        with torch.no_grad():
            assert self.head.bias is not None
            self.head.bias.copy_(torch.tensor([0.0, 1.0]))

    def forward(self, encoded: list[Tensor], tokens: Tensor, match: Tensor, where: Tensor) -> Tensor:
        """(B·K, h, w) logits at stride 2.

        Args:
            encoded: of B pictures, strides 4 to 32.
            tokens: (B·K, m, C).
            match: (B·K, 1, h, w) at stride 2.
            where: (B·K, D, h/2, w/2) at stride `FINEST`.
        """
        sounds = tokens.shape[0] // encoded[-1].shape[0]
        cues = {FINEST: torch.cat([functional.avg_pool2d(match, FINEST // 2), where], dim=1)}
        for stride in (8, 16, 32):
            cues[stride] = functional.avg_pool2d(cues[stride // 2], 2)
        x = self.enter(torch.cat([encoded[-1].repeat_interleave(sounds, 0), cues[32]], dim=1))
        cells = x.flatten(2).transpose(1, 2)
        for layer in self.attention:
            cells = layer(cells, tokens)
        x = cells.transpose(1, 2).unflatten(-1, x.shape[-2:])
        for level, skip, stride in zip(self.levels, encoded[-2::-1], (16, 8, FINEST), strict=True):
            x = level(x, skip, cues[stride])
        fine = functional.interpolate(self.head(x), scale_factor=2.0, mode="bilinear", align_corners=False)
        odds = torch.logit(match[:, 0].float(), eps=1e-4).clamp(-MOST_ODDS, MOST_ODDS).to(fine.dtype)
        return fine[:, 0] + fine[:, 1] * odds


class Seen(NamedTuple):
    """What the network takes from B pictures.

    Attributes:
        size: (height, width) of the pictures.
        encoded: strides 4 to 32, of the padded pictures.
        classes: (B, CLASSES, h, w) logits at stride 2.
    """

    size: tuple[int, int]
    encoded: list[Tensor]
    classes: Tensor


class Listener(nn.Module):
    """The whole network.

    Args:
        widths: its size; the default has fewer than 7 million parameters.

    Examples:
        >>> import torch
        >>> small = Widths(
        ...     image=(8, 8, 16, 16, 16), blocks=(0, 1, 1, 1, 1), decoder=(16, 16, 8, 8), audio=(8, 8, 16, 16)
        ... )
        >>> network = Listener(small).eval()
        >>> answer = network(torch.rand(1, 3, 64, 96))  # a picture without sound: classes of its pixels
        >>> answer.classes.shape, answer.mask.shape
        (torch.Size([1, 8, 32, 48]), torch.Size([0, 32, 48]))
    """

    def __init__(self, widths: Widths | None = None) -> None:
        super().__init__()
        widths = widths or Widths()
        self.widths = widths
        self.picture_encoder = LiteEncoder() if widths.encoder == "lite0" else PictureEncoder(widths)
        self.picture_decoder = PictureDecoder(widths)
        self.sound_encoder = SoundEncoder(widths)
        self.sounding_decoder = SoundingDecoder(widths)

    @property
    def settings(self) -> dict[str, Any]:
        """The values of `Widths` as JSON types."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self.widths).items()}

    def see(self, picture: Tensor) -> Seen:
        """What the network takes from B pictures, whatever is heard; arguments as of `forward`."""
        height, width = picture.shape[-2:]
        mean, deviation = ENCODERS[self.widths.encoder]
        normalised = (picture - mean) / deviation
        normalised = functional.pad(normalised, (0, -width % MULTIPLE, 0, -height % MULTIPLE))
        encoded = self.picture_encoder(normalised.contiguous(memory_format=torch.channels_last))
        return Seen((height, width), encoded[1:], self.picture_decoder(encoded))

    def forward(self, picture: Tensor | Seen, sound: SoundFeatures | None = None) -> ListenerOutput:
        """The answers for B pictures with K sounds each.

        Args:
            picture: (B, 3, H, W) float, 0 to 1; padded to a multiple of `MULTIPLE` here; or `see` of it.
            sound: of `hear`, of B·K sounds: the K of the first picture, then those of the second, …; None: the classes
                of pixels alone are answered.
        """
        (height, width), encoded, classes = picture if isinstance(picture, Seen) else self.see(picture)
        if sound is None:
            return ListenerOutput(
                classes,
                classes.new_zeros(0, len(CATEGORIES) + self.widths.unknown),
                classes.new_zeros(0, *classes.shape[-2:]),
            )
        tokens, audible = self.sound_encoder(sound.bands, sound.levels)
        match = match_map(classes, audible)
        where = functional.pad(sound.where, (0, -(-width % MULTIPLE) // -FINEST, 0, -(-height % MULTIPLE) // -FINEST))
        mask = self.sounding_decoder(encoded, tokens, match, where.to(match.dtype))
        return ListenerOutput(classes, audible, mask)


def hear(sound: Tensor, camera: Tensor, size: tuple[int, int]) -> SoundFeatures:
    """Features of sounds and their direction maps; float32, without gradient.

    Args:
        sound: (B, 2, n), channel 0 left.
        camera: (B, 4), see `direction.pixel_angles`.
        size: (height, width) of the pictures; multiples of `FINEST`.
    """
    with torch.no_grad(), torch.autocast(sound.device.type, enabled=False):
        both = features.spectra(sound)
        angles = direction.pixel_angles(camera, (size[0] // FINEST, size[1] // FINEST))
        where = direction.direction_map(direction.steered_response(both), angles)
        return SoundFeatures(features.band_features(both), features.broadband_levels(sound), where)


def match_map(classes: Tensor, audible: Tensor) -> Tensor:
    """(B·K, 1, h, w): the probability that a pixel's category is heard; no gradient flows through it.

    What has no name may be of any category: where u is its probability, a category is heard with 1 − (1 − p)(1 − u).

    Args:
        classes: (B, CLASSES, h, w) logits.
        audible: (B·K, categories [+ 1]) logits.
    """
    count = audible.shape[0] // classes.shape[0]
    what = classes.detach().softmax(dim=1)[:, 1:]
    heard = audible.detach().sigmoid()
    named = heard[:, : len(CATEGORIES)]
    if heard.shape[1] > len(CATEGORIES):
        named = 1 - (1 - named) * (1 - heard[:, len(CATEGORIES) :])
    named = named.reshape(-1, count, len(CATEGORIES))
    return torch.einsum("bchw,bkc->bkhw", what, named).flatten(0, 1)[:, None]


def parameter_count(network: nn.Module) -> int:
    """Trainable parameters."""
    return sum(parameter.numel() for parameter in network.parameters())
