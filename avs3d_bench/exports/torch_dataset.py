"""`AVS3DDataset`: a `torch.utils.data.Dataset` over a dataset on disk, ours or the official release.

    dataset = AVS3DDataset("data/open-s34-o7", split="train")
    loader = DataLoader(dataset, batch_size=8, shuffle=True, num_workers=2)

An item is a dictionary of tensors and texts that `default_collate` stacks:

| key                | what                                                                                |
|--------------------|-------------------------------------------------------------------------------------|
| `rgb`              | (3, H, W) uint8                                                                     |
| `binaural`         | (2, 44100) float32, channel 0 left                                                  |
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

Values that the dataset lacks are absent: the official release has neither category, source nor instance ids. With
``stack=k`` an item is k consecutive frames of one observation and every value gains a leading dimension (texts become
lists of k, ``key`` and ``category`` stay single).

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

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout, media
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.needs import need
from avs3d_bench.exports.samples import KINDS, Kind, check_split, file_kinds, frame_facts, frames_of, select
from avs3d_bench.taxonomy import CATEGORIES

if TYPE_CHECKING:
    from torch.utils.data import Dataset as _TorchDataset
else:
    _TorchDataset = need("torch.utils.data").Dataset

Item = dict[str, Any]
#: Facts of a frame that become tensors, with their types; the rest of `frame_facts` is for files.
_NUMBERS = {
    "intrinsics": np.float32,
    "camera_to_world": np.float32,
    "source_position": np.float32,
    "azimuth": np.float32,
    "elevation": np.float32,
    "distance": np.float32,
    "visible_pixels": np.int64,
    "sounding_instance": np.int64,
}
_NO_POSE = [[float("nan")] * 4] * 4
_TEXTS = ("category", "key", "frame", "split")


@dataclass(frozen=True)
class _Place:
    """Where a frame is: its observation's number in `AVS3DDataset.keys`, its name and number."""

    observation: int
    name: str
    index: int


@dataclass(frozen=True, eq=False)
class _Facts:
    """An observation in small arrays: (n, …) per number, by frame name; and the folders of its files."""

    rows: dict[str, int]
    numbers: dict[str, NDArray[Any]]
    texts: dict[str, tuple[str, ...]]
    kinds: dict[str, Kind]


def read_planes(path: str | Path) -> NDArray[np.uint8]:
    """A picture as (3, H, W) uint8 RGB: one pass from OpenCV's BGR, no copy in between.

    Raises:
        Avs3dError: if the file is missing, truncated, damaged or no 8-bit RGB picture.
    """

    def check(header: media.PngHeader) -> None:
        if header.bits != 8 or header.colour_type not in (2, 6):
            raise Avs3dError(f"{path}: {header.mode}, expected RGB, 8 bit")

    pixels = media.decode_png(path, cv2.IMREAD_COLOR, check)
    planes: NDArray[np.uint8] = np.empty((3, *pixels.shape[:2]), dtype=np.uint8)
    cv2.split(pixels, [planes[2], planes[1], planes[0]])
    return planes


def _read_binaural(path: str | Path) -> NDArray[np.float32]:
    clip = media.read_wav(path)
    shape = (2, layout.BINAURAL_SAMPLES)
    if clip.samples.shape != shape or clip.rate != layout.SAMPLE_RATE:
        found = f"{clip.samples.shape} at {clip.rate} Hz"
        raise Avs3dError(f"{path}: sound {found}, expected {shape} at {layout.SAMPLE_RATE} Hz")
    return clip.samples


def _read_ids(path: str | Path) -> NDArray[np.int32]:
    return media.read_png_ids(path).astype(np.int32)


#: Flag of the constructor → (kind of file, key of the item, reader).
_READERS: dict[str, tuple[str, Callable[[Path], NDArray[Any]]]] = {
    "rgb": ("rgb", read_planes),
    "binaural": ("binaural", _read_binaural),
    "mask": ("mask", media.read_png_mask),
    "instances": ("instance_ids", _read_ids),
    "depth": ("depth", media.read_png_depth),
}


class AVS3DDataset(_TorchDataset[Item]):
    """Frames (or stacks of frames) of a dataset on disk; see the module for what an item holds.

    Attributes:
        root: the dataset's folder.
        split: ``train``, ``test`` or ``all``.
        keys: keys of the observations.
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
        stack: int | None = None,
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
            stack: frames per item: windows that do not overlap, of one observation, in the order of time; what is left
                at the end of an observation is dropped.

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
        self._read = tuple(name for name, wanted in asked.items() if wanted)
        self._facts: dict[int, _Facts] = {}
        self._places: list[tuple[_Place, ...]] = []
        self._windows: list[tuple[_Place, ...]] = []
        for number, key in enumerate(self.keys):
            observation = Observation(self.root, key)
            found = file_kinds(observation, self._read)
            for name in self._read:
                if name not in found:
                    folder = KINDS[name].folder if name in KINDS else layout.DEPTH
                    raise Avs3dError(f"{observation.path / folder}: missing; load with {_flag(name)}=False")
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

        facts = self._facts.get(place.observation)
        if facts is None:
            observation = Observation(self.root, self.keys[place.observation])
            facts = self._facts[place.observation] = _facts(observation, self._places[place.observation])
        base, row = self.root / self.keys[place.observation], facts.rows[place.name]
        out: Item = {}
        for name in self._read:
            key, read = _READERS[name]
            out[key] = torch.from_numpy(read(facts.kinds[name].file(base, place.name, place.index)))
        # A copy of a few numbers: transforms may write into what they get.
        out |= {name: torch.from_numpy(np.array(values[row])) for name, values in facts.numbers.items()}
        out |= {name: values[row] for name, values in facts.texts.items()}
        out["frame_index"] = place.index
        return out


def _flag(name: str) -> str:
    return {"rgb": "frames", "binaural": "audio"}.get(name, name)


def _together(name: str, values: list[Any], torch_: Any) -> Any:
    if name in ("key", "category"):
        return values[0]
    if isinstance(values[0], str):
        return values
    return torch_.stack([torch_.as_tensor(value) for value in values])


def _facts(observation: Observation, places: Sequence[_Place]) -> _Facts:
    """Read what is known of some frames, from the observation's record (or its `sparse/0`), into small arrays."""
    # Not the frames that lie there now: a file that has vanished since is named when it is read.
    frames = [Frame(observation, place.name, place.index) for place in places]
    table = [frame_facts(frame) for frame in frames]
    for facts in table:
        # An observation with a frame that COLMAP did not register has the same keys as the others in its batch.
        facts["camera_to_world"] = facts["camera_to_world"] or _NO_POSE
    numbers = {
        name: np.array([facts[name] for facts in table], dtype=kind)
        for name, kind in _NUMBERS.items()
        if all(facts[name] is not None for facts in table)
    }
    if observation.category is not None:
        numbers["category_index"] = np.full(len(frames), CATEGORIES.index(observation.category), dtype=np.int64)
    texts = {
        name: tuple(str(facts[name]) for facts in table)
        for name in _TEXTS
        if all(facts[name] is not None for facts in table)
    }
    rows = {frame.name: row for row, frame in enumerate(frames)}
    return _Facts(rows, numbers, texts, file_kinds(observation, tuple(_READERS)))
