"""`AVS3DDataset`: a `torch.utils.data.Dataset` over a dataset on disk, ours or the official release.

    dataset = AVS3DDataset("data/open-s34-o7", split="train")
    loader = DataLoader(dataset, batch_size=8, shuffle=True, num_workers=2)

An item is a dictionary of tensors and texts that `default_collate` stacks:

| key                | what                                                                                |
|--------------------|-------------------------------------------------------------------------------------|
| `rgb`              | (3, H, W) uint8                                                                     |
| `binaural`         | (2, 44100) float32, channel 0 left                                                  |
| `ambisonics`       | ((order + 1)², 44100) float32, ACN, SN3D; with ``ambisonics=True``                  |
| `array`            | (microphones, 44100) float32; with ``array=True``                                   |
| `mask`             | (H, W) bool: visible pixels of the sounding instance                                |
| `instance_ids`     | (H, W) int32, 0 = the home; asked for with ``instances=True``                       |
| `depth`            | (H, W) float32 metres along the optical axis, 0 = nothing; with ``depth=True``      |
| `intrinsics`       | (3, 3) float32, pixels                                                              |
| `camera_to_world`  | (4, 4) float32, metres; the camera looks down −Z, Y up; NaN if not registered       |
| `source_position`  | (3,) float32, world, metres, at the frame's time                                    |
| `azimuth`, `elevation`, `distance` | () float32, of the source: degrees (azimuth positive right), metres |
| `visible_pixels`, `sounding_instance`, `category_index` | () int64; the category is one of `CATEGORIES`  |
| `category`, `key`, `frame`, `split` | text                                                               |
| `frame_index`, `item` | int, collated int64: the frame's number; the item's place in this dataset        |

Values that the dataset lacks are absent: the official release has neither category, source nor instance ids.

Where part_3 is among the observations, every item has these keys as well, so that items of all parts can
be in one batch. A class id c is that of `category_mask`; K is the number of classes, S the most sources of one
observation.

| key                | what                                                                                |
|--------------------|-------------------------------------------------------------------------------------|
| `category_mask`    | (H, W) uint8: 0, or the class id of the instance that is audible                    |
| `audible`          | (K,) bool: whether a source of class c is audible, in place c − 1; off-screen ones, too |
| `group`            | text: key of the observation whose pictures this one has; its own in the other parts |
| `stems`            | (S, 2, 44100) float32: the clip of each source, zeros beyond; with ``stems=True``    |
| `stem_classes`     | (S,) int64: class id of each stem, 0 beyond and for sounds of no class; with ``stems=True`` |
| `background`       | (2, 44100) float32: zeros where there is none; with ``stems=True``                   |

In part_3 the direction, ``sounding_instance`` and ``category`` are those of the first source: where there is none, they
are NaN, −1 (also for an off-screen source) and an empty text, and ``category_index`` is −1, as for a sound of no class
(`OFF_SCREEN_CATEGORIES`). ``stems`` of the other parts hold the clip.

With ``stack=k`` an item is k consecutive frames of one observation and every value gains a leading dimension (texts
become lists of k, ``key``, ``category`` and ``group`` stay single).

Workers: the object holds paths and small arrays, no open file, and may be pickled, forked or spawned. It draws no
random numbers. PyTorch seeds `torch`, `random` and `numpy` of each worker from the loader's ``generator``; a
transform that shall give the same result for any number of workers takes its own generator from (seed, epoch,
``item["item"]``). With ``split="train"`` consecutive frames of a stack pass over the test frames between them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.samples import ALL_KINDS, check_split, file_kinds, frames_of, has_part_3, select
from avs3d_bench.exports.torch_items import ClassKeys, ItemFacts
from avs3d_bench.runtime.imports import import_by_name, needing

if TYPE_CHECKING:
    from torch.utils.data import Dataset as _TorchDataset
else:
    with needing("this export"):
        _TorchDataset = import_by_name("torch.utils.data:Dataset")

Item = dict[str, Any]


@dataclass(frozen=True)
class _Place:
    """Where a frame is: its observation's number in `AVS3DDataset.keys`, its name and number."""

    observation: int
    name: str
    index: int


class AVS3DDataset(_TorchDataset[Item]):
    """Frames (or stacks of frames) of a dataset on disk; see the module for what an item holds.

    Attributes:
        root: the dataset's folder.
        split: ``train``, ``test`` or ``all``.
        keys: keys of the observations.

    Examples:
        >>> from torch.utils.data import DataLoader
        >>> dataset = AVS3DDataset("data/demo", split="train", only=["part_1/*"])
        >>> batch = next(iter(DataLoader(dataset, batch_size=4)))
        >>> batch["rgb"].shape, batch["rgb"].dtype, batch["binaural"].shape, batch["mask"].shape
        (torch.Size([4, 3, 64, 64]), torch.uint8, torch.Size([4, 2, 44100]), torch.Size([4, 64, 64]))
        >>> batch["category"], batch["azimuth"].round().tolist()  # degrees, positive to the right
        (['microwave', 'microwave', 'microwave', 'microwave'], [37.0, 28.0, 17.0, 6.0])
    """

    def __init__(
        self,
        root: str | Path,
        split: str = "train",
        *,
        only: Sequence[str] = (),
        transform: Callable[[Item], Any] | None = None,
        frames: bool = True,
        audio: bool = True,
        mask: bool = True,
        instances: bool = False,
        depth: bool = False,
        categories: bool = True,
        stems: bool = False,
        stack: int | None = None,
        ambisonics: bool = False,
        array: bool = False,
    ) -> None:
        """List the frames; pictures and sound are read item by item, poses observation by observation.

        Args:
            root: the dataset.
            split: ``train``, ``test`` or ``all``.
            only: shell patterns of observation keys.
            transform: called with the item; what it returns is the item (a joint transform of all modalities).
            frames: read the pictures.
            audio: read the binaural clips.
            mask: read the masks.
            instances: read the instance ids.
            depth: read the depth.
            categories: read the category masks, if part_3 is among the observations.
            stems: read the clip of each source, if part_3 is among the observations.
            stack: frames per item: windows that do not overlap, of one observation, in the order of time; what is left
                at the end of an observation is dropped.
            ambisonics: read the ambisonic clips.
            array: read the clips of the microphone array.

        Raises:
            UsageError: if an argument asks for something that does not exist, or no item is left.
            Avs3dError: if the dataset lacks what was asked for.
        """
        self.split, self.transform, self.stack = check_split(split), transform, stack
        dataset, self.keys = select(root, only)
        self.root = dataset.root
        if stack is not None and (not isinstance(stack, int) or stack < 1):
            raise UsageError(f"stack={stack!r}: expected a number of frames from 1 on, or None")
        asked = {"rgb": frames, "binaural": audio, "mask": mask, "instances": instances, "depth": depth}
        asked |= {"ambisonics": ambisonics, "array": array}
        self._read = tuple(name for name, wanted in asked.items() if wanted)
        self._class_keys: ClassKeys | None = None
        if has_part_3(self.keys):
            self._class_keys = ClassKeys.among(dataset, self.keys, categories=categories, stems=stems)
        self._facts: dict[int, ItemFacts] = {}
        self._places: list[tuple[_Place, ...]] = []
        self._windows: list[tuple[_Place, ...]] = []
        for number, key in enumerate(self.keys):
            observation = Observation(self.root, key)
            names = (*self._read, *(self._class_keys.kinds(observation) if self._class_keys else ()))
            found = file_kinds(observation, names)
            for name in names:
                if name not in found:
                    path = observation.path / ALL_KINDS[name].folder
                    raise Avs3dError(f"{path}: missing; load with {_flag(name)}=False")
            places = tuple(_Place(number, frame.name, frame.index) for frame in frames_of(observation, self.split))
            self._places.append(places)
            size = stack or 1
            self._windows += [places[at : at + size] for at in range(0, len(places) - size + 1, size)]
        if not self._windows:
            what = "frame" if stack is None else f"stack of {stack} frames"
            raise UsageError(f"{root}: no {what} in split {split}; expected at least one")

    def __len__(self) -> int:
        """Number of items."""
        return len(self._windows)

    def locate(self, item: int) -> tuple[tuple[str, str, int], ...]:
        """(observation key, frame name, frame number) of each frame of an item, without reading anything."""
        return tuple((self.keys[place.observation], place.name, place.index) for place in self._windows[item])

    def __repr__(self) -> str:
        what = "frames" if self.stack is None else f"stacks of {self.stack} frames"
        return f"AVS3DDataset({str(self.root)!r}, {self.split}: {len(self)} {what}, {len(self.keys)} observations)"

    def __getitem__(self, item: int) -> Any:
        """Item ``item``, transformed.

        Raises:
            IndexError: if there is no such item.
            Avs3dError: if a file is missing or damaged; it is named.
        """
        window = self._windows[item]
        if self.stack is None:
            out = self._frame(window[0])
        else:
            import torch

            singles = [self._frame(place) for place in window]
            out = {name: _together(name, [single[name] for single in singles], torch) for name in singles[0]}
        out["item"] = item % len(self)
        return out if self.transform is None else self.transform(out)

    def _frame(self, place: _Place) -> Item:
        import torch

        base = self.root / self.keys[place.observation]
        facts = self._facts.get(place.observation)
        if facts is None:
            observation = Observation(self.root, self.keys[place.observation])
            frames = [(each.name, each.index) for each in self._places[place.observation]]
            facts = self._facts[place.observation] = ItemFacts.of(observation, frames, self._class_keys)
        row = facts.rows[place.name]
        arrays = facts.read(self._read, self._class_keys, base, (place.name, place.index))
        out: Item = {name: torch.from_numpy(value) for name, value in arrays.items()}
        # A copy of a few numbers: transforms may write into what they get.
        out |= {name: torch.from_numpy(np.array(values[row])) for name, values in facts.numbers.items()}
        out |= {name: values[row] for name, values in facts.texts.items()}
        out["frame_index"] = place.index
        return out


def _flag(name: str) -> str:
    return {"rgb": "frames", "binaural": "audio"}.get(name, name)


def _together(name: str, values: list[Any], torch_: Any) -> Any:
    if name in ("key", "category", "group"):
        return values[0]
    if isinstance(values[0], str):
        return values
    return torch_.stack([torch_.as_tensor(value) for value in values])
