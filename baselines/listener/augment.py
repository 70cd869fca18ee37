"""From a plan to tensors on a device: gathering, mirroring with swapped ears, parts, and random changes.

The geometry stays valid: pictures are mirrored only together with the ears, and where they are cropped the camera's
intrinsics follow, so that every pixel keeps its direction. All random numbers come from one generator per (seed, step,
rank).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import affine_grid, avg_pool2d, grid_sample

from baselines.listener.batches import BatchPlan, SoundKind
from baselines.listener.model import CLASSES
from baselines.listener.picture_changes import PICTURE_CHANGES, changed_pictures
from baselines.listener.shards import SIDE, ShardStore
from baselines.listener.sound_changes import SOUND_CHANGES, changed_sounds, disguised, level, uniform

#: Level of a second sound over the first, at most (dB).
MIX_DB = 10.0
#: Share of pictures that are enlarged (prediction looks at parts two and three times as large), at most how many times,
#: and how far the centre may lie from an object, as a share of what is shown.
ENLARGED, LARGEST, OFF_CENTRE = 0.6, 3.0, 0.4
#: Side of a part of a picture that is learnt from without sound (pixels), its side as a share of the picture's, and the
#: share of parts that are chosen around an object.
PART_SIDE, PART_SHARES, AROUND_OBJECTS = 128, (0.25, 0.7), 0.85
#: Probability of a mirrored picture, and of a sound in a disguise where it may have one.
MIRRORED, DISGUISED = 0.5, 0.2
#: Names of the changes that a run can leave out.
CHANGES = ("disguise", "codec", *SOUND_CHANGES, *PICTURE_CHANGES)
#: Share of the memory that is free on a GPU which the store may take.
STORE_SHARE = 0.5


@dataclass
class Batch:
    """B pictures with K sounds each, on a device.

    While it is made, pictures, classes and masks have the side that is stored.

    Attributes:
        pictures: (B, 3, SIDE, SIDE) float32, 0 to 1.
        classes: (B, SIDE, SIDE) int64.
        cameras: (B, 4), see `direction.pixel_angles`.
        sounds: (B·K, 2, n) float32.
        masks: (B·K, SIDE, SIDE) bool.
        audible: (B·K, categories + 1) float32; the last one: something is heard that has no name.
        named: (B·K,) bool: whether the names in ``audible`` are known; a disguise hides them.
        kinds: (B·K,) of `SoundKind`.
    """

    pictures: Tensor
    classes: Tensor
    cameras: Tensor
    sounds: Tensor
    masks: Tensor
    audible: Tensor
    named: Tensor
    kinds: Tensor


class Bank:
    """The store as tensors: on the device if it fits there, else in mapped memory, from which batches are copied.

    Args:
        store: what is stored.
        device: where batches go.
    """

    def __init__(self, store: ShardStore, device: torch.device) -> None:
        self.device = torch.device(device)
        arrays = {name: getattr(store, name) for name in ("pictures", "classes", "sounds", "coded", "masks")}
        if store.dry is not None:
            arrays |= {"responses": store.responses, "dry": store.dry.samples}
        self.resident = False
        if self.device.type == "cuda":
            free, _ = torch.cuda.mem_get_info(self.device)
            self.resident = sum(array.nbytes for array in arrays.values()) < STORE_SHARE * free
        self._tensors = {name: torch.from_numpy(np.asarray(array)) for name, array in arrays.items()}
        if self.resident:
            self._tensors = {name: tensor.to(self.device) for name, tensor in self._tensors.items()}
        self._cameras = torch.tensor(store.table.cameras, dtype=torch.float32, device=self.device)

    def rows(self, name: str, index: Tensor) -> Tensor:
        """Rows of an array of the store, or of the dry sounds (``dry``)."""
        source = self._tensors[name]
        return self.sent(source.index_select(0, index.to(source.device, non_blocking=True)))

    def cameras(self, views: Tensor) -> Tensor:
        """(B, 4)."""
        return self._cameras[self.sent(views)]

    def sent(self, values: Tensor | NDArray[Any]) -> Tensor:
        """On the device. What is under way there is not waited for: the driver copies what is not on it at once."""
        return torch.as_tensor(values).to(self.device, non_blocking=True)

    def gather(self, plan: BatchPlan, generator: torch.Generator | None, without: Collection[str] = ()) -> Batch:
        """The batch of a plan; without a generator nothing is changed at random.

        Args:
            plan: what to gather.
            generator: of the device, for augmentation.
            without: names of `CHANGES` that are left out.
        """
        # The network may round to 16 bits, its input not.
        with torch.autocast(self.device.type, enabled=False):
            return self._gathered(plan, generator, without)

    def _gathered(self, plan: BatchPlan, generator: torch.Generator | None, without: Collection[str]) -> Batch:
        views = torch.from_numpy(plan.views)
        pictures = self.rows("pictures", views).permute(0, 3, 1, 2).float() / 255
        batch = Batch(
            pictures=pictures,
            classes=self.rows("classes", views).long(),
            cameras=self.cameras(views),
            sounds=self._mixed(plan, generator, coded=generator is not None and "codec" not in without),
            masks=self._united(plan),
            audible=self.sent(plan.audible).float(),
            named=torch.ones(len(plan.kinds), dtype=torch.bool, device=self.device),
            kinds=self.sent(plan.kinds),
        )
        if generator is None:
            return reduced(batch)
        return augmented(batch, generator, without) if len(batch.sounds) else parts(batch, generator, without)

    def _mixed(self, plan: BatchPlan, generator: torch.Generator | None, coded: bool) -> Tensor:
        filed = plan.coded & coded
        first = self._sounds(plan.sounds[:, 0], plan.dubs[:, 0], filed[:, 0])
        second = np.flatnonzero(plan.sounds[:, 1] >= 0)
        if len(second):
            other = self._sounds(plan.sounds[second, 1], plan.dubs[second, 1], filed[second, 1])
            rows = self.sent(second)
            ratio = level(first[rows]) / level(other)
            change = 0.0 if generator is None else uniform(generator, len(second), -MIX_DB, MIX_DB)
            gain = ratio * 10 ** (change / 20)
            first[rows] += other * gain[:, None, None]
        return first

    def _sounds(self, index: Any, dubs: Any, coded: Any) -> Tensor:
        numbers = torch.from_numpy(index)
        chosen = self.rows("sounds", numbers.clamp(min=0)).float()
        filed = np.flatnonzero(coded)
        if len(filed):
            chosen[self.sent(filed)] = self.rows("coded", torch.from_numpy(index[filed])).float()
        dubbed = np.flatnonzero(dubs >= 0)
        if len(dubbed):
            dry = self.rows("dry", torch.from_numpy(dubs[dubbed])).float()
            responses = self.rows("responses", torch.from_numpy(index[dubbed])).float()
            rows, heard = self.sent(dubbed), heard_through(dry, responses)
            chosen[rows] = heard * (level(chosen[rows]) / level(heard))[:, None, None]
        return chosen * self.sent(numbers >= 0)[:, None, None]

    def _united(self, plan: BatchPlan) -> Tensor:
        side = self._tensors["masks"].shape[1]
        out = torch.zeros(len(plan.truths), side, side, dtype=torch.bool, device=self.device)
        for column in range(plan.truths.shape[1]):
            rows = np.flatnonzero(plan.truths[:, column] >= 0)
            if len(rows):
                packed = self.rows("masks", torch.from_numpy(plan.truths[rows, column]))
                out[self.sent(rows)] |= unpack(packed)
        return out


def heard_through(dry: Tensor, responses: Tensor) -> Tensor:
    """(n, 2, 44100): the second half of dry sounds (n, 88200), after the first, through responses (n, 2, 44100)."""
    count = dry.shape[-1]
    # The convolution's end wraps around to the first half, which is not heard.
    spectrum = torch.fft.rfft(dry)[:, None] * torch.fft.rfft(responses, n=count)
    heard: Tensor = torch.fft.irfft(spectrum, n=count)
    return heard[..., count // 2 :]


def unpack(packed: Tensor) -> Tensor:
    """(B, side, side) bool of masks with eight pixels a byte."""
    shifts = torch.arange(7, -1, -1, device=packed.device, dtype=torch.uint8)
    return ((packed[..., None] >> shifts) & 1).flatten(-2)[..., : packed.shape[-2]].bool()


def reduced(batch: Batch) -> Batch:
    """Whole pictures at the network's size."""
    if batch.pictures.shape[-1] <= SIDE:
        return batch
    return replace(
        batch,
        pictures=avg_pool2d(batch.pictures, 2),
        classes=batch.classes[..., ::2, ::2],
        masks=batch.masks[..., ::2, ::2],
    )


def augmented(batch: Batch, generator: torch.Generator, without: Collection[str] = ()) -> Batch:
    """The batch with random changes that keep its truth; those named in ``without`` are left out."""
    count = len(batch.pictures)
    turned = mirrored(batch, uniform(generator, count) < MIRRORED)
    if "disguise" not in without:
        turned = hidden(turned, generator)
    turned = replace(turned, sounds=changed_sounds(turned.sounds, generator, without))
    shown = enlarged(turned, generator)
    return replace(shown, pictures=changed_pictures(shown.pictures, shown.classes > 0, generator, without))


def hidden(batch: Batch, generator: torch.Generator) -> Batch:
    """Some sounds in a disguise, each in that of the one before: what sounds has no name, and is where it was.

    A sound that was made for a picture stays as it is: its place says nothing, or would say something else.
    """
    count = len(batch.sounds)
    rows = torch.randperm(count, generator=generator, device=batch.sounds.device)[: max(1, round(DISGUISED * count))]
    kinds = batch.kinds[rows]
    real = (kinds == SoundKind.OWN) | (kinds == SoundKind.SWAPPED) | (kinds == SoundKind.OFF_SCREEN)
    others = batch.sounds.roll(1, 0)[rows]
    chosen = real & (level(others) > 1e-5)
    sounds, audible, named = batch.sounds.clone(), batch.audible.clone(), batch.named.clone()
    sounds[rows] = _where(chosen, disguised(sounds[rows], others), sounds[rows])
    audible[rows, -1] = torch.where(chosen, 1.0, audible[rows, -1])
    named[rows] &= ~chosen
    return replace(batch, sounds=sounds, audible=audible, named=named)


def mirrored(batch: Batch, chosen: Tensor) -> Batch:
    """The batch with some pictures (B,) mirrored and the ears of their sounds, if there are any, swapped."""
    heard = chosen.repeat_interleave(len(batch.sounds) // len(batch.pictures))
    cameras = batch.cameras.clone()
    cameras[:, 2] = torch.where(chosen, 1 - cameras[:, 2], cameras[:, 2])
    return replace(
        batch,
        pictures=_where(chosen, batch.pictures.flip(-1), batch.pictures),
        classes=_where(chosen, batch.classes.flip(-1), batch.classes),
        cameras=cameras,
        sounds=_where(heard, batch.sounds.flip(1), batch.sounds),
        masks=_where(heard, batch.masks.flip(-1), batch.masks),
    )


def parts(batch: Batch, generator: torch.Generator, without: Collection[str] = ()) -> Batch:
    """Small parts of pictures, mostly around objects, with random changes; for batches without sound.

    Objects are in view more often, and a step takes a quarter of the time: what is seen is learnt sooner.
    """
    turned = mirrored(batch, uniform(generator, len(batch.pictures)) < MIRRORED)
    count, classes = len(batch.pictures), turned.classes.flatten(1)
    smallest, largest = PART_SHARES
    part = smallest * (largest / smallest) ** uniform(generator, count)
    around = uniform(generator, count) < AROUND_OBJECTS
    # Each category in view is as probable as any other, whatever its size.
    ones = torch.ones_like(classes, dtype=torch.float32)
    sizes = torch.zeros(count, CLASSES, device=classes.device).scatter_add_(1, classes, ones)
    weights = (around[:, None] & (classes > 0)) / sizes.clamp(min=1).gather(1, classes)
    shown = _shown(turned, part, weights, PART_SIDE, generator)
    return replace(shown, pictures=changed_pictures(shown.pictures, shown.classes > 0, generator, without))


def enlarged(batch: Batch, generator: torch.Generator) -> Batch:
    """Pictures at the network's size, of which some show a part of themselves, mostly around an object.

    What is outside is no longer marked.
    """
    count = len(batch.pictures)
    chosen = uniform(generator, count) < ENLARGED
    times = torch.where(chosen, LARGEST ** uniform(generator, count), 1.0)
    return _shown(
        batch, 1 / times, (batch.classes > 0).flatten(1).float(), min(SIDE, batch.pictures.shape[-1]), generator
    )


def _shown(batch: Batch, part: Tensor, weights: Tensor, side: int, generator: torch.Generator) -> Batch:
    """Parts of pictures around random pixels.

    Args:
        batch: whole pictures.
        part: (B,) side of the part, as a share of the picture's.
        weights: (B, H·W) how probable each pixel is; where all are 0, any pixel is.
        side: of the result (pixels).
        generator: of random numbers.
    """
    count, (height, width) = len(batch.pictures), batch.classes.shape[1:]
    # As `torch.multinomial`, which makes the host wait for the device.
    luck = torch.empty_like(weights).exponential_(generator=generator)
    pixel = ((weights + 1e-6 / (height * width)) / luck).argmax(dim=1)
    middle = torch.stack([(pixel % width + 0.5) / width, (pixel // width + 0.5) / height], dim=1)
    part = part[:, None]
    jitter = uniform(generator, 2 * count, -OFF_CENTRE, OFF_CENTRE).view(count, 2)
    middle = torch.minimum(torch.maximum(middle + part * jitter, part / 2), 1 - part / 2)
    theta = torch.zeros(count, 2, 3, device=batch.pictures.device)
    theta[:, 0, 0] = theta[:, 1, 1] = part[:, 0]
    theta[:, :, 2] = 2 * middle - 1
    grid = affine_grid(theta, [count, 1, side, side], align_corners=False)
    cameras = batch.cameras / part
    cameras[:, 2:] = (batch.cameras[:, 2:] - (middle - part / 2)) / part

    def look(values: Tensor, where: Tensor, how: str) -> Tensor:
        return grid_sample(values.float(), where, mode=how, padding_mode="border", align_corners=False)

    per = len(batch.masks) // count
    pictures = look(batch.pictures, grid, "bilinear")
    if width > SIDE:
        # Where pixels are left out, those of a picture half as large: means of four.
        small = look(avg_pool2d(batch.pictures, 2), grid, "bilinear")
        pictures = torch.where((part * width > 1.5 * side)[..., None, None], small, pictures)
    return replace(
        batch,
        pictures=pictures,
        classes=look(batch.classes[:, None], grid, "nearest")[:, 0].long(),
        cameras=cameras,
        masks=look(batch.masks[:, None], grid.repeat_interleave(per, 0), "nearest")[:, 0] > 0.5 if per else batch.masks,
    )


def _where(rows: Tensor, yes: Tensor, no: Tensor) -> Tensor:
    return torch.where(rows.view(-1, *[1] * (yes.ndim - 1)), yes, no)
