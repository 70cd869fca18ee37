"""DenseAV: where the picture is similar to the sound. A 2D baseline, self-supervised, through its own package.

"Separating the Chirp from the Chat: Self-supervised Visual Grounding of Sound and Language", Hamilton et al., CVPR
2024. For a test frame and its two-second mono clip the network gives a similarity for every head, patch and moment. The
rule that makes a mask of it:

1. One map for the clip: the mean over frequency (as the package's own renderings), the maximum over heads (likewise),
   the mean over time: the clip belongs to one still picture, so no moment of it is special.
2. Negative similarities become 0, as in the package's renderings: they mean "does not sound".
3. Min-max normalised over all test frames of the observation, as the package normalises over a video: a frame in which
   nothing sounds must not be stretched to full contrast. (`normalise="frame"` does it for every frame on its own.)
4. Resized to the frame, bilinear, so that no value lies outside of those of the patches.
5. Marked where the value is > 0.5: more than half as similar as the most similar patch.

The network is a LightningModule with the methods of `Network`; its weights are a local file (see
`baselines.networks.checkpoints`). Its constructor also wants HuBERT and DINO, from the caches of huggingface_hub and
torch.hub.

Examples:
    >>> similarity = np.array([[-0.2, 0.1], [0.3, 0.9]])  # of four patches with the clip
    >>> (scaled,) = denseav.min_max([similarity])
    >>> denseav.mark(scaled, (4, 4), threshold=0.5).astype(int)
    array([[0, 0, 0, 0],
           [0, 0, 0, 0],
           [0, 0, 1, 1],
           [0, 0, 1, 1]])
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.method import Method, write_submission
from avs3d_bench.runtime.imports import has_package
from avs3d_bench.submission import SubmissionWriter, frame_size
from baselines.networks.checkpoints import find_checkpoint, loading, require_packages
from baselines.networks.device import enough_memory, inference, pick_device
from baselines.networks.pixels import IMAGENET_MEAN, IMAGENET_STD, normalise, resize
from baselines.networks.sound import check_clip, resample
from baselines.sound_control import SoundControl, mono_of, named, noted

if TYPE_CHECKING:
    import torch

Mask = NDArray[np.bool_]
Similarity = NDArray[np.float64]
Normalise = Literal["observation", "frame"]

#: Of the package's demonstrations: the shorter side of the picture, the patch, the sampling rate.
SIDE = 224
PATCH = 8
RATE = 16_000
THRESHOLD = 0.5
#: Frames that go through the network at a time.
BATCH = 8
#: Where the package keeps its network: now, and in its first version.
_MODULES = ("denseav.train", "denseav.train_av_alignment")


class Aggregator(Protocol):
    """The part of the network that compares features."""

    def get_pairwise_sims(self, preds: dict[str, Any], *, raw: bool, agg_sim: bool, agg_heads: bool) -> Any:
        """(B, heads, h, w, frequencies, moments), the B pictures with their B clips."""


class Network(Protocol):
    """The part of `denseav.train.LitAVAligner` that is used."""

    sim_agg: Aggregator

    def forward_audio(self, batch: dict[str, Any]) -> dict[str, Any]:
        """Features of ``batch["audio"]`` (B, n) at 16 kHz."""

    def forward_image(self, batch: dict[str, Any], max_batch_size: int | None = None) -> dict[str, Any]:
        """Features of ``batch["frames"]`` (B, 1, 3, h, w), normalised; h and w are multiples of 8."""


@dataclass(frozen=True)
class DenseAv:
    """The network and the settings of the rule.

    Attributes:
        network: gives features and similarities.
        device: the `torch.device` it runs on.
        threshold: of the normalised map.
        normalise: over all test frames of an observation, or over every frame on its own.
        checkpoint: the weights' name, for submission.json.
        hearing: what is heard in place of a frame's own sound.
    """

    network: Network
    device: torch.device
    threshold: float = THRESHOLD
    normalise: Normalise = "observation"
    checkpoint: str = ""
    hearing: SoundControl = "own"

    def __post_init__(self) -> None:
        if not 0.0 <= self.threshold < 1.0:
            raise UsageError(f"threshold {self.threshold}: expected a number from 0 to below 1")
        if self.normalise not in ("observation", "frame"):
            raise UsageError(f"normalise {self.normalise!r}: expected observation or frame")

    def similarity(self, frames: Sequence[Frame]) -> list[Similarity]:
        """The map (h, w) of each of the frames, one value per patch; rule 1.

        Raises:
            Avs3dError: if a frame has no sound, a file is damaged, the network gives NaN, or memory runs out.
        """
        maps: list[Similarity] = []
        for start in range(0, len(frames), BATCH):
            part = frames[start : start + BATCH]
            clips = [check_clip(mono_of(frame, self.hearing), _where(frame)) for frame in part]
            pixels = [prepare(frame.rgb()) for frame in part]
            sounds = [resample(clip, layout.SAMPLE_RATE, RATE) for clip in clips]
            with inference(self.device, _where(part[0])):
                found = self._compare(pixels, sounds)
            for frame, values in zip(part, found, strict=True):
                if not np.isfinite(values).all():
                    raise Avs3dError(f"{_where(frame)}: DenseAV gave numbers that are not finite; check its checkpoint")
                maps.append(values)
        return maps

    def _compare(self, pixels: list[NDArray[np.float32]], sounds: list[NDArray[np.float32]]) -> list[Similarity]:
        import torch

        if len({p.shape for p in pixels}) > 1 or len({s.shape for s in sounds}) > 1:
            return [self._compare([p], [s])[0] for p, s in zip(pixels, sounds, strict=True)]
        picture = torch.from_numpy(np.stack(pixels))[:, None].to(self.device)
        sound = torch.from_numpy(np.stack(sounds)).to(self.device)
        features = {**self.network.forward_image({"frames": picture}), **self.network.forward_audio({"audio": sound})}
        similarity = self.network.sim_agg.get_pairwise_sims(features, raw=False, agg_sim=False, agg_heads=False)
        return list(clip_map(similarity.float().cpu().numpy().astype(np.float64)))

    def masks(self, frames: Sequence[Frame]) -> list[Mask]:
        """The mask (H, W) of each of the frames of one observation; empty where the clip is digital silence."""
        heard = [check_clip(mono_of(frame, self.hearing), _where(frame)).any() for frame in frames]
        if not all(heard):
            found = iter(self.masks([frame for frame, sounds in zip(frames, heard, strict=True) if sounds]))
            empty = [np.zeros(frame_size(frame), np.bool_) for frame in frames]
            return [next(found) if sounds else nothing for nothing, sounds in zip(empty, heard, strict=True)]
        maps = self.similarity(frames)
        groups = [maps] if self.normalise == "observation" else [[values] for values in maps]
        sizes = [frame_size(frame) for frame in frames]
        normalised = [values for group in groups for values in min_max(group)]
        return [mark(values, size, self.threshold) for values, size in zip(normalised, sizes, strict=True)]

    @property
    def notes(self) -> str:
        """The settings, for submission.json."""
        return noted(
            "2D, from the picture and the mono clip of test frames; similarity: mean over frequency and time, maximum "
            f"over heads; negative values 0, min-max over each {self.normalise}; marked where > {self.threshold:g}"
            + (f"; checkpoint {self.checkpoint}" if self.checkpoint else ""),
            self.hearing,
        )


def _where(frame: Frame) -> str:
    return f"{frame.observation.path}/{frame.name}"


def prepare(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(3, h, w) float32 from (H, W, 3) uint8 RGB: shorter side 224, ImageNet normalisation.

    The longer side becomes the nearest multiple of the patch. (The package cuts off what is over; then the map would
    not cover the picture.)
    """
    height, width = picture.shape[:2]
    scale = SIDE / min(height, width)
    size = (round(height * scale / PATCH) * PATCH, round(width * scale / PATCH) * PATCH)
    return normalise(resize(picture, size), IMAGENET_MEAN, IMAGENET_STD)


def clip_map(similarity: NDArray[np.float64]) -> NDArray[np.float64]:
    """One map per picture (B, h, w) from (B, heads, h, w, frequencies, moments)."""
    return np.asarray(similarity.mean(axis=-2).max(axis=1).mean(axis=-1))


def min_max(maps: Sequence[Similarity]) -> list[Similarity]:
    """Maps scaled together to [0, 1], negative values first raised to 0; all 0 where nothing stands out."""
    raised = [np.maximum(values, 0.0) for values in maps]
    low = min((float(values.min()) for values in raised), default=0.0)
    high = max((float(values.max()) for values in raised), default=0.0)
    if not high > low:
        return [np.zeros_like(values) for values in raised]
    return [(values - low) / (high - low) for values in raised]


def mark(values: Similarity, size: tuple[int, ...], threshold: float) -> Mask:
    """(H, W) bool: where a map (h, w), resized to ``size`` (height, width), is above the threshold."""
    large = cv2.resize(values.astype(np.float32), (size[1], size[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(large > threshold)


def load_denseav(
    checkpoint: str | Path | None,
    *,
    device: str | None = None,
    threshold: float = THRESHOLD,
    normalise: Normalise = "observation",
) -> DenseAv:
    """Load the network from a local folder.

    Args:
        checkpoint: holds ``denseav_sound.ckpt`` (trained on sounds) or ``denseav_2head.ckpt`` (sounds and speech).
        device: cpu, cuda or cuda:<number>; None: a GPU where there is one.
        threshold: see `DenseAv`.
        normalise: see `DenseAv`.

    Raises:
        UsageError: if no folder is named, the package or the device is missing.
        Avs3dError: if the checkpoint is missing or broken.
    """
    require_packages("denseav")
    (path,) = find_checkpoint("denseav", checkpoint).values()
    where = pick_device(device)
    with enough_memory(where, "loading DenseAV"), loading("denseav", path.parent):
        module = next((name for name in _MODULES if has_package(name)), _MODULES[0])
        network: Any = import_module(module).LitAVAligner.load_from_checkpoint(
            str(path), map_location="cpu", strict=True, loss_leak=0.0, use_cached_embs=False
        )
        network.set_full_train(True)
        network = network.eval().requires_grad_(False).to(where)
    return DenseAv(network=network, device=where, threshold=threshold, normalise=normalise, checkpoint=path.stem)


def write_denseav(
    dataset: Dataset,
    path: str | Path,
    model: DenseAv,
    *,
    only: Iterable[str] = (),
    overwrite: bool = False,
    progress: bool = False,
) -> SubmissionWriter:
    """Write the masks of the test frames as a submission.

    Args:
        dataset: what to look at; of test frames only pictures and mono clips are read.
        path: the submission's folder.
        model: from `load_denseav`.
        only: shell patterns of observation keys.
        overwrite: replace an existing submission.
        progress: show a bar on stderr.

    Returns:
        The writer; its attributes describe what was written.

    Raises:
        UsageError: if no observation matches, or the target is not free.
        Avs3dError: if a file is missing or damaged, memory runs out, or the system refuses.
    """
    name = named("DenseAV", model.hearing)
    method = Method(name, model.masks, notes=model.notes, entry="baselines.denseav:write_denseav")
    return write_submission(dataset, path, method, only=only, overwrite=overwrite, progress=progress)
