"""Reading a dataset: `Dataset` → `Observation` → `Frame`, lazily.

    dataset = Dataset("open-s34-o7")
    for observation in dataset:
        for frame in observation.test:
            frame.rgb(), frame.mask(), frame.audio(), frame.pose

Datasets of this toolkit and the official release are read in the same way. The release has no `dataset.json`,
`observation.json`, instance masks or meshes; its poses come from `sparse/0`, and `camera_splits.json` may name files
with their extension, under ``train``/``test`` or ``train_cameras``/``test_cameras``.

A sealed test (`avs3d_bench.sealing.seal`) has neither truth nor `observation.json`, but `poses.json`. Whoever has the
truth reads both together: `Dataset("public", truth="private")`.
"""

from __future__ import annotations

import fnmatch
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path, PurePosixPath
from typing import Literal, SupportsIndex, overload

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import DatasetRecord, FrameRecord, ObservationRecord, PoseRecord, PosesRecord
from avs3d_bench.contract.taxonomy import PARTS
from avs3d_bench.errors import Avs3dError, UsageError, did_you_mean, excerpt
from avs3d_bench.formats import media
from avs3d_bench.formats.colmap import ColmapImage, ColmapModel, read_model
from avs3d_bench.formats.ply import Ply
from avs3d_bench.geometry import Intrinsics, Pose

Split = Literal["train", "test"]
_SPLITS: tuple[Split, Split] = ("train", "test")
_EXTENSIONS = (".png", ".jpg", ".jpeg")
#: Near keys that a message on an unknown key names.
_NAMED_KEYS = 3


class UnknownKeyError(UsageError, KeyError):
    """No observation of the dataset has this key."""


class UnknownPlaceError(UsageError, IndexError):
    """The dataset has fewer observations than that."""


def parse_splits(data: object, where: str | Path) -> dict[str, Split]:
    """Frame stem → split, from any of the forms of `camera_splits.json`.

    Raises:
        Avs3dError: if keys are missing, a name is no text, or a frame is in both splits.
    """
    lists: dict[Split, list[str]] = {}
    for split in _SPLITS:
        value = data.get(split, data.get(f"{split}_cameras")) if isinstance(data, Mapping) else None
        if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
            raise Avs3dError(f"{where}: no list of frame names under {split!r} (or '{split}_cameras')")
        lists[split] = value
    out: dict[str, Split] = {}
    for split, names in lists.items():
        for name in names:
            stem = PurePosixPath(name).name
            for suffix in _EXTENSIONS:
                stem = stem.removesuffix(suffix)
            if stem in out:
                raise Avs3dError(f"{where}: {stem} is listed twice; expected every frame in one split")
            out[stem] = split
    return out


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of an observation; pictures and sound are read when asked for.

    Attributes:
        observation: where it belongs.
        name: e.g. ``frame_007``.
        index: e.g. 7; also the second of its clip.

    Examples:
        >>> frame = Dataset("data/demo")["part_1/apartment_1/bathroom/1"].frames[4]
        >>> frame, frame.split
        (Frame(part_1/apartment_1/bathroom/1, frame_004), 'train')
        >>> frame.rgb().shape, frame.mask().dtype.name, frame.audio().shape, frame.mono().shape
        ((64, 64, 3), 'bool', (2, 44100), (88200,))
        >>> frame.pose.position  # metres, Y up
        (0.0, 1.5, 0.08)
        >>> round(frame.record.azimuth), round(frame.record.distance, 1)  # of the source: degrees, metres
        (6, 2.3)
    """

    observation: Observation
    name: str
    index: int

    def __repr__(self) -> str:
        return f"Frame({self.observation.key}, {self.name})"

    @property
    def split(self) -> Split | None:
        """``train`` or ``test``; None where the official release leaves a frame out of both."""
        return self.observation.splits.get(self.name)

    @property
    def record(self) -> FrameRecord | None:
        """The frame's entry in observation.json; None in the official release and where the truth is sealed."""
        return self.observation._frame_records.get(self.name)

    @property
    def pose(self) -> Pose:
        """Camera-to-world, from observation.json, else from poses.json, else from `sparse/0`.

        Raises:
            Avs3dError: if the frame has no pose (COLMAP did not register it).
        """
        published = self.record or self.observation._poses.get(self.name)
        if published is not None:
            return published.pose
        image = self.observation._colmap_images.get(self.name)
        if image is None:
            raise Avs3dError(f"{self.observation.path / layout.COLMAP}: {self.name} is not registered, it has no pose")
        return image.pose

    @property
    def has_pose(self) -> bool:
        """Whether `pose` is known."""
        known = self.record is not None or self.name in self.observation._poses
        return known or self.name in self.observation._colmap_images

    def path(self, folder: str) -> Path:
        """The frame's picture in an image folder (`layout.INPUT`, `layout.SEMANTIC_MASKS`, …).

        Raises:
            Avs3dError: if the observation has no such folder.
        """
        base = self.observation.where(folder)
        if not base.is_dir():
            sealed = "; the truth of this test is sealed" if self.observation._is_sealed else ""
            raise Avs3dError(f"{base}: missing; this observation has no such folder{sealed}")
        return base / f"{self.name}.png"

    def rgb(self) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB, from `input/` (or `images/` where there is no input): `Observation.intrinsics`."""
        return media.read_png_rgb(self.path(layout.INPUT if self.observation._has_input else layout.IMAGES))

    def undistorted_rgb(self) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB, from `images/`: the picture of `Observation.undistorted_intrinsics`.

        In our trees it holds the same pixels as `rgb`; in the official release its size may differ from that.
        """
        return media.read_png_rgb(self.path(layout.IMAGES))

    def mask(self) -> NDArray[np.bool_]:
        """(H, W) bool: where the sounding instance is visible; in part_3 every audible instance."""
        return media.read_png_mask(self.path(layout.SEMANTIC_MASKS))

    def category_mask(self) -> NDArray[np.uint8]:
        """(H, W) uint8: 0 nothing, else the class id of the audible instance (`ObservationRecord.class_ids`).

        The same pixels as `mask`. In part_1 and part_2 it follows from the mask and the category, which the official
        release does not have.
        """
        record = self.observation.record
        if record is not None and record.sources is None and record.category is not None:
            return self.mask() * np.uint8(record.class_ids[record.category])
        return media.read_png_categories(self.path(layout.CATEGORY_MASKS))

    def instance_ids(self) -> NDArray[np.uint16]:
        """(H, W) instance ids, 0 = scan; not in the official release."""
        return media.read_png_ids(self.path(layout.INSTANCE_MASKS))

    def depth(self) -> NDArray[np.float32]:
        """(H, W) metres along the optical axis, 0 = nothing met; only in trees made `--with depth`."""
        return media.read_png_depth(self.path(layout.DEPTH))

    def audio(self) -> NDArray[np.float32]:
        """(2, 44100) the binaural clip, channel 0 left."""
        return self._clip(layout.BINAURAL)

    def ambisonics(self) -> NDArray[np.float32]:
        """((order + 1)², 44100) the ambisonic clip: channels in ACN order, SN3D; x forward, y left, z up of the head.

        Only in trees made `--with ambisonics`; ``observation.record.acoustics.ambisonics`` has the order.
        """
        return self._clip(layout.clips_folder(layout.AMBISONICS))

    def array(self) -> NDArray[np.float32]:
        """(microphones, 44100) the clip of the microphone array; only in trees made `--with array`.

        ``observation.record.acoustics.array`` has the names and places of the microphones.
        """
        return self._clip(layout.clips_folder(layout.ARRAY))

    def mono(self) -> NDArray[np.float32]:
        """(88200,) the two-second mono clip."""
        return np.asarray(self._clip(layout.MONO).mean(axis=0), dtype=np.float32)

    def mesh(self) -> Ply:
        """The sounding instance's mesh in the world at this frame's time; not in the official release."""
        mesh, record = self.observation.mesh(), self.observation.record
        if record is None or self.record is None or not record.moves:
            return mesh
        return replace(mesh, vertices=record.to_frame(self.record, mesh.vertices, mesh.instances).astype(np.float32))

    def impulse_response(self, source: str | None = None, receiver: str | None = None) -> NDArray[np.float32]:
        """(channels, n) room impulse response; only in trees made `--with rirs`.

        Args:
            source: id of the source, e.g. ``source_1``; in part_3 only.
            receiver: ``ambisonics`` or ``array``; None: the two ears.
        """
        path = self.observation.where(layout.rir_path(self.index, source, receiver))
        return media.read_rir(path, self.observation.channels(receiver)).samples

    def stem(self, name: str, receiver: str | None = None) -> NDArray[np.float32]:
        """(channels, 44100) the clip of one source or of the background; part_3 made `--with stems` only.

        Args:
            name: ``source_1``, … or ``background``.
            receiver: ``ambisonics`` or ``array``; None: the two ears.
        """
        return self._read_clip(self.observation.where(layout.stem_path(name, self.index, receiver)))

    def _clip(self, folder: str) -> NDArray[np.float32]:
        return self._read_clip(self.observation.path / layout.audio_path(folder, self.index))

    def _read_clip(self, path: Path) -> NDArray[np.float32]:
        clip = media.read_wav(path)
        if clip.rate != layout.SAMPLE_RATE:
            raise Avs3dError(f"{path}: {clip.rate} Hz, expected {layout.SAMPLE_RATE} Hz")
        return clip.samples


def _pictures(published: PosesRecord) -> dict[str, str]:
    return {name: digest for name, digest in published.files.items() if name.startswith(f"{layout.INPUT}/")}


class Observation:
    """One observation: the frames that an agent saw and heard on its path past one sounding object.

    Examples:
        >>> observation = Observation("data/demo", "part_2/apartment_1/kitchen/1")  # as Dataset("data/demo")[key]
        >>> observation
        Observation(part_2/apartment_1/kitchen/1, 9 frames)
        >>> observation.category, [frame.name for frame in observation.test]
        ('microwave', ['frame_000', 'frame_008'])
        >>> observation.intrinsics.width, observation.intrinsics.fx  # pixels
        (64, 32.0)
    """

    def __init__(self, root: str | Path, key: str, *, use_record: bool = True, truth: str | Path | None = None) -> None:
        """Open the observation ``key`` below ``root``; nothing is read yet.

        Args:
            root: the dataset's folder.
            key: ``part_1/<scan>/<room>/<index>``.
            use_record: if False, observation.json is ignored, as if this were the official release.
            truth: the folder with the truth of a sealed test.

        Raises:
            UsageError: if ``key`` is no observation key.
            Avs3dError: if there is no such folder.
        """
        self.place = layout.parse_key(key)
        self.key = key
        self._use_record = use_record
        self.root = Path(root)
        self.path = self.root / key
        self._truth = None if truth is None else Path(truth) / key
        for path in (self.path, self._truth):
            if path is not None and not path.is_dir():
                raise Avs3dError(f"{path}: missing; expected the folder of an observation")

    def where(self, name: str) -> Path:
        """Path of a file or folder of the observation; truth lies apart in a sealed test.

        Args:
            name: relative to the observation's folder, e.g. ``semantic_masks`` or ``gt_3d/sounding_object.ply``.
        """
        if self._truth is not None:
            path = self._truth / name
            if path.exists():
                return path
        return self.path / name

    def __repr__(self) -> str:
        what = "" if self._has_record else ", sealed" if self._is_sealed else ", official release"
        return f"Observation({self.key}, {len(self.frame_names)} frames{what})"

    def __len__(self) -> int:
        return len(self.frame_names)

    @property
    def _has_record(self) -> bool:
        return self._use_record and self.where(layout.OBSERVATION_JSON).exists()

    @cached_property
    def _is_sealed(self) -> bool:
        """Whether this is an observation of a sealed test, opened without its truth."""
        return not self._has_record and (self.path / layout.POSES_JSON).exists()

    @cached_property
    def record(self) -> ObservationRecord | None:
        """observation.json; None in the official release and where the truth is sealed.

        Raises:
            Avs3dError: if it does not fit the schema.
        """
        path = self.where(layout.OBSERVATION_JSON)
        return media.read_record(path, ObservationRecord) if self._has_record else None

    @cached_property
    def _frame_records(self) -> dict[str, FrameRecord]:
        return {frame.name: frame for frame in self.record.frames} if self.record else {}

    @cached_property
    def published(self) -> PosesRecord | None:
        """poses.json of a sealed test; None elsewhere, and where the truth is read as well.

        Raises:
            Avs3dError: if it does not fit the schema.
        """
        return media.read_record(self.path / layout.POSES_JSON, PosesRecord) if self._is_sealed else None

    @cached_property
    def _poses(self) -> dict[str, PoseRecord]:
        return {frame.name: frame for frame in self.published.frames} if self.published else {}

    @cached_property
    def colmap(self) -> ColmapModel:
        """The sparse model, in our conventions."""
        return read_model(self.path / layout.COLMAP)

    @cached_property
    def _colmap_images(self) -> dict[str, ColmapImage]:
        return {PurePosixPath(image.name).stem: image for image in self.colmap.images}

    @cached_property
    def frame_names(self) -> tuple[str, ...]:
        """Stems of the pictures in `input/` (else `images/`), sorted: the order in time."""
        for folder in (layout.INPUT, layout.IMAGES):
            base = self.path / folder
            if base.is_dir():
                return tuple(sorted(p.stem for p in base.glob("*.png") if not p.name.startswith(".")))
        return ()

    @cached_property
    def frames(self) -> tuple[Frame, ...]:
        """All frames in the order of time.

        Raises:
            Avs3dError: if there are none, or a picture's name is no frame name.
        """
        if not self.frame_names:
            raise Avs3dError(f"{self.path / layout.INPUT}: no pictures; expected frame_000.png and on")
        try:
            return tuple(Frame(self, name, layout.frame_index(name)) for name in self.frame_names)
        except Avs3dError as error:
            raise Avs3dError(f"{self.path / layout.INPUT}: {error}") from None

    @cached_property
    def splits(self) -> dict[str, Split]:
        """Frame name → split, from camera_splits.json; every eighth sorted name is test where that is missing."""
        path = self.path / layout.SPLITS_JSON
        if path.exists():
            return parse_splits(media.read_json(path), path)
        train, test = layout.split_names(self.frame_names)
        return {name: "test" if name in test else "train" for name in (*train, *test)}

    @cached_property
    def train(self) -> tuple[Frame, ...]:
        """The train frames."""
        return self._frames_of("train")

    @cached_property
    def test(self) -> tuple[Frame, ...]:
        """The test frames."""
        return self._frames_of("test")

    def _frames_of(self, split: Split) -> tuple[Frame, ...]:
        splits = self.splits
        return tuple(frame for frame in self.frames if splits.get(frame.name) == split)

    @cached_property
    def intrinsics(self) -> Intrinsics:
        """The camera of the pictures that `Frame.rgb` returns, of the masks and of the depth.

        From observation.json or poses.json. The official release has only the camera of the undistorted pictures, in
        `sparse/0`. COLMAP's undistortion keeps the focal lengths and scales the principal point with the size of the
        picture, so that the pinhole part of the camera of `input/` follows from it (lens distortion is not modelled).

        Raises:
            Avs3dError: if the record, the sparse model or the first picture is missing or damaged.
        """
        camera = self.undistorted_intrinsics
        known = self.record is not None or self.published is not None
        if known or not self._has_input or not self.frame_names:
            return camera
        picture = media.png_header(self.path / layout.INPUT / f"{self.frame_names[0]}.png")
        x, y = picture.width / camera.width, picture.height / camera.height
        return replace(camera, width=picture.width, height=picture.height, cx=camera.cx * x, cy=camera.cy * y)

    @cached_property
    def undistorted_intrinsics(self) -> Intrinsics:
        """The camera of the pictures that `Frame.undistorted_rgb` returns: that of `sparse/0`.

        In our trees there is no distortion: it is the same as `intrinsics`.

        Raises:
            Avs3dError: if the record or the sparse model is missing or damaged.
        """
        described = self.record or self.published
        if described is not None:
            return described.intrinsics.camera
        cameras = self.colmap.cameras
        if not cameras:
            raise Avs3dError(f"{self.path / layout.COLMAP / 'cameras.bin'}: no camera; expected one")
        return cameras[min(cameras)]

    @property
    def _has_input(self) -> bool:
        return (self.path / layout.INPUT).is_dir()

    @property
    def category(self) -> str | None:
        """Category of the sounding object; None in the official release, where nothing sounds or truth is sealed."""
        return self.record.category if self.record else None

    @property
    def is_part_3(self) -> bool:
        """Whether it belongs to part_3."""
        return self.place.is_part_3

    @cached_property
    def group(self) -> str | None:
        """Key of the observation of part_3 whose pictures this one has; None in the other parts.

        A sealed test does not tell which of the siblings was first: there, the first by key with these pictures.
        """
        if not self.is_part_3:
            return None
        if self.published is None:
            return self.record.group if self.record else None
        pictures = _pictures(self.published)
        for path in sorted(
            self.path.parent.glob(f"*/{layout.POSES_JSON}"), key=lambda path: (len(path.parent.name), path)
        ):
            other = media.read_record(path, PosesRecord)
            if _pictures(other) == pictures:
                return other.key
        return self.key

    @property
    def group_key(self) -> str:
        """Key of the observation whose pictures this one has: `group`; its own where it has none."""
        return self.group or self.key

    def channels(self, receiver: str | None = None) -> int:
        """Number of channels of the clips of a receiver: ``ambisonics`` or ``array``; None: 2, the two ears.

        Raises:
            UsageError: if the observation was not made with that receiver.
        """
        if receiver is None:
            return 2
        there = self.record.acoustics.receivers if self.record else self.published.receivers if self.published else {}
        if receiver not in there:
            known = ", ".join(there) or "the two ears alone"
            raise UsageError(f"{self.path}: not made with the receiver {receiver!r}; it has {known}")
        return there[receiver].channels

    def mesh(self) -> Ply:
        """The sounding instance's mesh in the world, at the first frame if it moves; not in the official release.

        In part_3 the meshes of all sounding instances of the room together, where something moves with the instance of
        each vertex; not where there is none.
        """
        return media.read_ply(self.where(layout.SOUNDING_OBJECT))


class Dataset:
    """A dataset on disk: iterating yields its observations, sorted by key.

    ``dataset[0]`` is the first observation, ``dataset[-3:]`` a list of the last three, ``dataset[key]`` the one with
    that key.

    Observations are found by walking the folders, so a part of a dataset, or the official release, is one too.

    Attributes:
        root: the dataset's folder.
        truth: the folder with the truth of a sealed test; None: there is none, or it is not known.
        open: opens the observation of a key, without a look at ``keys``; it may be sent to another process.
        keys: the keys of its observations, sorted.

    Examples:
        >>> dataset = Dataset("data/demo")
        >>> dataset
        Dataset('data/demo', 2 observations)
        >>> dataset.keys
        ('part_1/apartment_1/bathroom/1', 'part_2/apartment_1/kitchen/1')
        >>> for observation in dataset.select("part_2/*"):
        ...     print(observation.category, len(observation.train), len(observation.test))
        microwave 7 2
    """

    def __init__(self, root: str | Path, truth: str | Path | None = None) -> None:
        """Open the dataset at ``root``.

        Args:
            root: its folder.
            truth: the folder with the truth, of a sealed test. Whether both belong together is not checked here: see
                `avs3d_bench.sealing.seal.check_truth`.

        Raises:
            UsageError: if it is no folder, holds neither observations nor a dataset.json, or is a submission.
        """
        self.root = Path(root)
        self.truth = None if truth is None else Path(truth)
        self.open: Callable[[str], Observation] = partial(Observation, self.root, truth=self.truth)
        if not self.root.is_dir():
            raise UsageError(f"{self.root}: no such folder; expected the root of a dataset")
        self.keys = find_keys(self.root)
        if _is_submission(self.root, self.keys):
            raise UsageError(
                f"{self.root}: a submission, no dataset; expected a dataset's root: evaluate(submission, dataset), "
                "avs3d-eval SUBMISSION --dataset ROOT"
            )
        if not self.keys and (self.root / layout.SHARDS_JSON).exists():
            raise UsageError(
                f"{self.root}: holds tar shards ({layout.SHARDS_JSON}), no folders of observations; read them with the "
                "webdataset package and avs3d_bench.exports.decode_sample"
            )
        if not self.keys and not (self.root / layout.DATASET_JSON).exists():
            raise UsageError(
                f"{self.root}: no dataset; expected {layout.DATASET_JSON} or part_1/<scan>/<room>/<index>/"
            )

    @cached_property
    def record(self) -> DatasetRecord | None:
        """dataset.json; None in the official release.

        Raises:
            Avs3dError: if it does not fit the schema.
        """
        path = self.root / layout.DATASET_JSON
        return media.read_record(path, DatasetRecord) if path.exists() else None

    @property
    def is_sealed(self) -> bool:
        """Whether this is the public part of a sealed test; the private one has a seal.json, too, but no poses.json."""
        poses = self.root / (self.keys[0] if self.keys else "") / layout.POSES_JSON
        return poses.exists() and (self.root / layout.SEAL_JSON).exists()

    @property
    def name(self) -> str:
        """The dataset's name; the folder's where there is no dataset.json."""
        return self.record.name if self.record else self.root.resolve().name

    @property
    def version(self) -> str | None:
        """The dataset's version; None where there is no dataset.json, as in the official release."""
        return self.record.version if self.record else None

    def __repr__(self) -> str:
        kind = "" if (self.root / layout.DATASET_JSON).exists() else ", no dataset.json"
        return f"Dataset({str(self.root)!r}, {len(self)} observations{kind})"

    @overload
    def __getitem__(self, key: str | SupportsIndex) -> Observation: ...

    @overload
    def __getitem__(self, key: slice) -> list[Observation]: ...

    def __getitem__(self, key: str | SupportsIndex | slice) -> Observation | list[Observation]:
        """The observation with a key or at a place in the order of keys; a list of them for a slice.

        Raises:
            UnknownKeyError: if no observation has the key, with the nearest keys and how many there are.
            UnknownPlaceError: if there is no such place, with how many observations there are.
            TypeError: if ``key`` is no text, whole number or slice.
        """
        if isinstance(key, str):
            if key not in self.keys:
                first = f"; keys look like {self.keys[0]!r}" if self.keys else ""
                hint = did_you_mean(key, self.keys, otherwise=first, count=_NAMED_KEYS)
                raise UnknownKeyError(f"{self.root}: no observation {excerpt(key)} among {len(self)}{hint}")
            return self.open(key)
        if isinstance(key, slice):
            return [self.open(each) for each in self.keys[key]]
        place = operator.index(key)
        if not -len(self) <= place < len(self):
            expected = f"expected {-len(self)} to {len(self) - 1}, or a key" if self.keys else "it is empty"
            raise UnknownPlaceError(f"{self.root}: no observation at {place} among {len(self)}; {expected}")
        return self.open(self.keys[place])

    def _ipython_key_completions_(self) -> list[str]:
        """Completions that IPython and Jupyter offer after ``dataset["``."""
        return list(self.keys)

    def __iter__(self) -> Iterator[Observation]:
        return (self.open(key) for key in self.keys)

    def __len__(self) -> int:
        return len(self.keys)

    def __contains__(self, key: object) -> bool:
        return key in self.keys

    def select(self, *patterns: str) -> tuple[Observation, ...]:
        """Observations whose key matches one of the shell patterns (all where none is given), sorted by key."""
        chosen = (k for k in self.keys if not patterns or any(fnmatch.fnmatchcase(k, p) for p in patterns))
        return tuple(self[key] for key in chosen)


def _is_submission(root: Path, keys: Sequence[str]) -> bool:
    """Whether a folder holds predictions: it says so, or has masks without pictures."""
    if (root / layout.DATASET_JSON).exists():
        return False
    first = root / keys[0] if keys else root
    pictures = any((first / folder).is_dir() for folder in (layout.INPUT, layout.IMAGES))
    return (root / layout.SUBMISSION_JSON).exists() or ((first / layout.SUBMISSION_MASKS).is_dir() and not pictures)


def find_keys(root: str | Path) -> tuple[str, ...]:
    """Keys of the observation folders below ``root``, sorted; folders with other names are ignored."""
    found = []
    for part in PARTS:
        for path in sorted((Path(root) / part).glob("*/*/*")):
            key = path.relative_to(root).as_posix()
            try:
                layout.parse_key(key)
            except UsageError:
                continue
            if path.is_dir():
                found.append(key)
    return tuple(sorted(found))


def by_pictures(observations: Iterable[Observation]) -> dict[str, tuple[Observation, ...]]:
    """Observations with the same pictures together: `Observation.group_key` → siblings, both in the order given.

    Observations of part_1 and part_2 are alone.
    """
    found: dict[str, list[Observation]] = {}
    for each in observations:
        found.setdefault(each.group_key, []).append(each)
    return {key: tuple(some) for key, some in found.items()}


def sibling_frames(siblings: Sequence[Observation]) -> list[tuple[Frame, ...]]:
    """The test frames of observations that share their pictures: for each frame, that of every sibling.

    Args:
        siblings: of one group of part_3, at least one.

    Raises:
        Avs3dError: if there is no test frame, or siblings have other test frames than the first.
    """
    first, *others = siblings
    names = [frame.name for frame in first.test]
    if not names:
        raise Avs3dError(f"{first.path}: no test frame; expected some in {layout.SPLITS_JSON}")
    for other in others:
        if [frame.name for frame in other.test] != names:
            raise Avs3dError(
                f"{other.path / layout.SPLITS_JSON}: other test frames than {first.key}, whose pictures it shares; "
                "regenerate the dataset"
            )
    return list(zip(*(sibling.test for sibling in siblings), strict=True))
