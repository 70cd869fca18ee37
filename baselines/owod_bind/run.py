"""OWOD-BIND from a frame to its mask, and from a dataset to a submission or to a folder of masks."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import dump_json, read_json, sha256_file, write_json
from avs3d_bench.formats.media import write_png_mask
from avs3d_bench.method import Method, write_submission
from avs3d_bench.runtime.imports import has_package
from avs3d_bench.runtime.parallel import process_each
from avs3d_bench.runtime.provenance import provenance
from avs3d_bench.submission import SubmissionWriter
from baselines.networks.checkpoints import find_checkpoint, require_packages
from baselines.networks.device import enough_memory, inference, pick_device
from baselines.networks.pixels import Picture
from baselines.networks.sound import check_clip
from baselines.owod_bind import select
from baselines.owod_bind.protocols import AudioVisualSimilarity, BoxProposer, Detections, Mask, MaskPredictor
from baselines.sound_control import SoundControl, mono_of, named, noted

if TYPE_CHECKING:
    import torch

BoxKind = Literal["owlv2", "mavl"]
SimilarityKind = Literal["imagebind", "pe-av"]
Split = Literal["train", "test"]

#: File in a folder of masks that records how they were made.
MASKS_JSON = "masks.json"
#: Pictures that go through the box network at a time.
BATCH = 4


@dataclass(frozen=True)
class OwodBind:
    """The three networks and the settings of the rule; called with a frame, it gives the frame's mask.

    Attributes:
        boxes: finds objects.
        masks: segments them.
        similarity: compares them with the sound.
        device: the `torch.device` they run on.
        threshold: of `select.choose`.
        min_score: of `select.keep_boxes`.
        max_side: of `select.keep_boxes`.
        checkpoints: the names of the weights' folders, for submission.json.
        hearing: what is heard in place of a frame's own sound.

    Examples:
        >>> model = load_owod_bind(
        ...     boxes_checkpoint="weights/owlv2", sam_checkpoint="weights/sam",
        ...     similarity="pe-av", similarity_checkpoint="weights/pe-av", device="cpu",
        ... )
        >>> from avs3d_bench import Dataset
        >>> mask = model(Dataset("data/demo")["part_1/apartment_1/bathroom/1"].test[0])
        >>> mask.shape, mask.dtype.name
        ((64, 64), 'bool')
    """

    boxes: BoxProposer
    masks: MaskPredictor
    similarity: AudioVisualSimilarity
    device: torch.device
    threshold: float = select.THRESHOLD
    min_score: float = select.MIN_SCORE
    max_side: float = select.MAX_SIDE
    checkpoints: tuple[str, ...] = ()
    hearing: SoundControl = "own"

    def __post_init__(self) -> None:
        for name in ("threshold", "min_score", "max_side"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise UsageError(f"{name} {value}: expected a number from 0 to 1")

    def __call__(self, frame: Frame) -> Mask:
        """(H, W) bool: the objects of a frame, train or test, that sound; see `masks_of`."""
        return self.masks_of([frame])[0]

    def masks_of(self, frames: Iterable[Frame]) -> list[Mask]:
        """The masks of several frames, from the picture and the mono clip of each.

        Raises:
            Avs3dError: if a frame has no sound, a file is damaged, or memory runs out.
        """
        frames = tuple(frames)
        masks: list[Mask] = []
        for start in range(0, len(frames), BATCH):
            part = frames[start : start + BATCH]
            pictures = [frame.rgb() for frame in part]
            with inference(self.device, _where(part[0])):
                found = self.boxes.propose(pictures)
            masks += [self._mask(*each) for each in zip(part, pictures, found, strict=True)]
        return masks

    def _mask(self, frame: Frame, picture: Picture, found: Detections) -> Mask:
        where, size = _where(frame), (picture.shape[0], picture.shape[1])
        clip = check_clip(mono_of(frame, self.hearing), where)
        kept = select.keep_boxes(found, size, min_score=self.min_score, max_side=self.max_side)
        if not len(kept) or not clip.any():  # digital silence: nothing sounds, and a network may answer NaN
            return np.zeros(size, dtype=np.bool_)
        blurred = select.blur(picture)
        with inference(self.device, where):
            masks = self.masks.segment(picture, kept.boxes)
            crops = [select.cut_out(picture, blurred, *each) for each in zip(masks, kept.boxes, strict=True)]
            logits = self.similarity.logits(crops, clip, layout.SAMPLE_RATE)
        try:
            scores = select.softmax(logits)
        except Avs3dError as error:
            raise Avs3dError(f"{where}: {error}") from None
        return select.union(masks[select.choose(scores, self.threshold)], size)

    @property
    def method(self) -> str:
        """As tables name it."""
        return named(f"OWOD-BIND ({self.boxes.name}, {self.masks.name}, {self.similarity.name})", self.hearing)

    @property
    def notes(self) -> str:
        """The settings, for submission.json."""
        return noted(
            "2D, every frame on its own, from its picture and its mono clip; the first box, and those with a score > "
            f"{self.min_score:g} and both sides < {self.max_side:g} of the image's height; "
            f"masks whose softmax over the proposals is > {self.threshold:g}"
            + (f"; checkpoints {', '.join(self.checkpoints)}" if self.checkpoints else ""),
            self.hearing,
        )


def _where(frame: Frame) -> str:
    return f"{frame.observation.path}/{frame.name}"


def load_owod_bind(
    *,
    boxes: BoxKind = "owlv2",
    boxes_checkpoint: str | Path | None,
    sam_checkpoint: str | Path | None,
    similarity: SimilarityKind | None = None,
    similarity_checkpoint: str | Path | None,
    device: str | None = None,
    threshold: float = select.THRESHOLD,
) -> OwodBind:
    """Load the networks from local folders; see `baselines.networks.checkpoints.CHECKPOINTS` for the required files.

    Args:
        boxes: which detector.
        boxes_checkpoint: its folder.
        sam_checkpoint: SAM's.
        similarity: which network compares; None: ImageBind where its package is installed, else PE-AV.
        similarity_checkpoint: its folder.
        device: cpu, cuda or cuda:<number>; None: a GPU where there is one.
        threshold: of the softmax.

    Raises:
        UsageError: if a folder is not named, a package or the device is missing.
        Avs3dError: if a checkpoint is missing or broken.

    Examples:
        >>> model = load_owod_bind(
        ...     boxes_checkpoint="weights/owlv2", sam_checkpoint="weights/sam",
        ...     similarity="pe-av", similarity_checkpoint="weights/pe-av", device="cpu",
        ... )
        >>> model.method, model.threshold
        ('OWOD-BIND (OWLv2 objectness, SAM, PE-AV)', 0.2)
    """
    from baselines.owod_bind.boxes import Owlv2Boxes
    from baselines.owod_bind.imagebind import ImageBindSimilarity
    from baselines.owod_bind.masks import SamMasks
    from baselines.owod_bind.mavl import MavlBoxes
    from baselines.owod_bind.pe_av import PeAvSimilarity

    if similarity is None:
        similarity = "imagebind" if has_package("imagebind") else "pe-av"
    proposers: dict[str, Callable[..., BoxProposer]] = {"owlv2": Owlv2Boxes, "mavl": MavlBoxes}
    comparers: dict[str, Callable[..., AudioVisualSimilarity]] = {
        "imagebind": ImageBindSimilarity,
        "pe-av": PeAvSimilarity,
    }
    for network, known in ((boxes, proposers), (similarity, comparers)):
        if network not in known:
            raise UsageError(f"no network {network!r}: expected one of {', '.join(known)}")
    folders = {boxes: boxes_checkpoint, "sam": sam_checkpoint, similarity: similarity_checkpoint}
    # Report missing files before the first network runs for minutes.
    for kind, folder in folders.items():
        require_packages(kind)
        find_checkpoint(kind, folder)
    where = pick_device(device)
    with enough_memory(where, "loading the networks"):
        return OwodBind(
            boxes=proposers[boxes](folders[boxes], where),
            masks=SamMasks(sam_checkpoint or "", where),
            similarity=comparers[similarity](folders[similarity], where),
            device=where,
            threshold=threshold,
            checkpoints=tuple(Path(folder or "").resolve().name for folder in folders.values()),
        )


def write_owod_bind(
    dataset: Dataset,
    path: str | Path,
    model: OwodBind,
    *,
    only: Iterable[str] = (),
    overwrite: bool = False,
    progress: bool = False,
) -> SubmissionWriter:
    """Write the masks of the test frames as a submission.

    Args:
        dataset: what to look at; of test frames only pictures and mono clips are read.
        path: the submission's folder.
        model: from `load_owod_bind`.
        only: shell patterns of observation keys.
        overwrite: replace an existing submission.
        progress: show a bar on stderr.

    Returns:
        The writer; its attributes describe what was written.

    Raises:
        UsageError: if no observation matches, or the target is not free.
        Avs3dError: if a file is missing or damaged, memory runs out, or the system refuses.

    Examples:
        >>> model = load_owod_bind(
        ...     boxes_checkpoint="weights/owlv2", sam_checkpoint="weights/sam",
        ...     similarity="pe-av", similarity_checkpoint="weights/pe-av", device="cpu",
        ... )
        >>> from avs3d_bench import Dataset
        >>> writer = write_owod_bind(Dataset("data/demo"), "owod-bind", model, only=["part_1/*"], overwrite=True)
        >>> writer.record.method
        'OWOD-BIND (OWLv2 objectness, SAM, PE-AV)'
    """
    entry = "baselines.owod_bind.run:write_owod_bind"
    method = Method(model.method, model.masks_of, notes=model.notes, entry=entry, batch=BATCH)
    return write_submission(dataset, path, method, only=only, overwrite=overwrite, progress=progress)


def _batches(frames: list[Frame]) -> list[tuple[Frame, ...]]:
    return [tuple(frames[start : start + BATCH]) for start in range(0, len(frames), BATCH)]


def write_mask_folder(
    dataset: Dataset,
    folder: str | Path,
    model: OwodBind,
    *,
    split: Split = "train",
    only: Iterable[str] = (),
    progress: bool = False,
) -> int:
    """Write masks as ``<key>/<frame>.png``, the folder that ``baseline echosegnet --masks DIR`` reads.

    A second run with the same networks, settings, software and dataset continues where the first one stopped.

    Args:
        dataset: what to look at; only pictures and mono clips are read.
        folder: where to write; empty, missing, or begun with the same networks and settings.
        model: from `load_owod_bind`.
        split: of which frames.
        only: shell patterns of observation keys.
        progress: show a bar on stderr.

    Returns:
        The number of masks written now.

    Raises:
        UsageError: if no observation matches, or the folder holds something else.
        Avs3dError: if a file is missing or damaged, memory runs out, or the system refuses.

    Examples:
        >>> model = load_owod_bind(
        ...     boxes_checkpoint="weights/owlv2", sam_checkpoint="weights/sam",
        ...     similarity="pe-av", similarity_checkpoint="weights/pe-av", device="cpu",
        ... )
        >>> from avs3d_bench import Dataset
        >>> write_mask_folder(Dataset("data/demo"), "train-masks", model, split="train", only=["part_1/*"])
        7
        >>> from pathlib import Path
        >>> len(list(Path("train-masks/part_1/apartment_1/bathroom/1").glob("*.png")))
        7
    """
    folder, only = Path(folder), tuple(only)
    observations = dataset.select(*only)
    if not observations:
        raise UsageError(f"{dataset.root}: no observation matches {' '.join(only)}; expected e.g. {dataset.keys[:1]}")
    record = dataset.root / layout.DATASET_JSON
    made_from = {
        "dataset": dataset.name,
        # It covers every picture and clip. The official release has none: its name must do.
        "dataset_sha256": sha256_file(record) if record.exists() else "",
        "method": model.method,
        "notes": model.notes,
        "software": provenance("baselines.owod_bind").digest,
        "split": split,
    }
    _claim(folder, made_from)
    frames = [f for o in observations for f in _split(o, split) if not _mask_path(folder, f).exists()]
    job = partial(_write_files, folder, model)
    batches = _batches(frames)
    sizes = [len(batch) for batch in batches]
    for _ in process_each(job, batches, workers=1, label="OWOD-BIND", progress=progress, sizes=sizes):
        pass
    return len(frames)


def _split(observation: Observation, split: Split) -> tuple[Frame, ...]:
    return observation.train if split == "train" else observation.test


def _mask_path(folder: Path, frame: Frame) -> Path:
    return folder / frame.observation.key / f"{frame.name}.png"


def _write_files(folder: Path, model: OwodBind, frames: tuple[Frame, ...]) -> None:
    for frame, mask in zip(frames, model.masks_of(frames), strict=True):
        write_png_mask(_mask_path(folder, frame), mask)


def _claim(folder: Path, record: dict[str, str]) -> None:
    """Begin a folder of masks, or make sure that it was begun with the same settings.

    Raises:
        UsageError: if it holds something else.
    """
    path = folder / MASKS_JSON
    if path.is_file():
        if dump_json(read_json(path)) != dump_json(record):
            raise UsageError(
                f"{folder}: holds masks made with other settings, software or data ({path.name}); choose another folder"
            )
        return
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder}: not empty and no folder of masks (no {path.name}); choose another folder")
    write_json(path, record)
