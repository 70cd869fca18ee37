"""The listener as a method: masks of frames of any size, and class ids in part_3.

1. The picture is reduced to 252² by area, the field of view stays; the sound goes in as it is.
2. The network gives logits at 126²; they are resized to the frame bilinearly and follow the picture's edges after a
   guided filter (He, Sun, Tang, "Guided image filtering", ECCV 2010).
3. Marked is what is above `THRESHOLD`. Components smaller than `LEAST_AREA` of the picture are dropped.
4. The class of a component is the category that the picture shows there, weighted by how audible it is.

Nothing of the truth is read: pictures, binaural sound and the camera's intrinsics alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.method import Method, write_submission
from avs3d_bench.submission import Prediction, SubmissionWriter
from baselines.listener.shards import SIDE, fit
from baselines.networks.device import inference, pick_device

#: Probability above which a pixel is marked; chosen on validation homes.
THRESHOLD = 0.5
#: Smallest component that stays marked, as a share of the picture.
LEAST_AREA = 2e-4
#: What the network hears: the frame's own sound, or nothing, or that of another observation, to see whether it listens.
Hearing = Literal["own", "none", "other"]
#: Frames that go through the network at a time.
BATCH = 8
#: Radius of the guided filter as a share of the picture's width, and its smoothness (of pictures of 0 to 1).
RADIUS, SMOOTHNESS = 0.006, 1e-3
#: Logits are cut here before the filter: beyond, they are certain.
_MOST_LOGIT = 6.0
#: Cells of the network's output: stride 2.
_CELLS = SIDE // 2


@dataclass(frozen=True)
class Answer:
    """What the network says of a frame, at its own size.

    Attributes:
        mask: (126, 126) float32 logits: what sounds.
        classes: (8, 126, 126) float32: probability of each class at each pixel, from the picture alone.
        audible: (7,) float32: probability of each category, from the sound alone.
    """

    mask: NDArray[np.float32]
    classes: NDArray[np.float32]
    audible: NDArray[np.float32]


@dataclass(frozen=True)
class ListenerMethod:
    """The network and the settings of the rule.

    Attributes:
        network: of `weights.load_listener`.
        device: where it runs.
        digest: sha256 of its weights.
        threshold: see `THRESHOLD`.
        refine: whether masks follow the picture's edges.
        hearing: what it hears.
    """

    network: Any
    device: Any
    digest: str
    threshold: float = THRESHOLD
    refine: bool = True
    hearing: Hearing = "own"

    def answers(self, pictures: Sequence[NDArray[np.uint8]], sounds: Any, cameras: Any) -> list[Answer]:
        """Of pictures (SIDE, SIDE, 3), sounds (B, 2, n) and cameras (B, 4) (see `direction.pixel_angles`)."""
        import torch

        from baselines.listener.model import hear

        stack = torch.from_numpy(np.stack(pictures)).to(self.device).permute(0, 3, 1, 2).float() / 255
        heard = hear(torch.as_tensor(sounds).to(self.device), torch.as_tensor(cameras).to(self.device), (SIDE, SIDE))
        found = self.network(stack, heard)
        classes = found.classes.softmax(dim=1)[..., :_CELLS, :_CELLS].float().cpu().numpy()
        masks = found.mask[..., :_CELLS, :_CELLS].float().cpu().numpy()
        audible = found.audible.sigmoid().float().cpu().numpy()
        return [Answer(*each) for each in zip(masks, classes, audible, strict=True)]

    def predictions(self, frames: Sequence[Frame]) -> list[Prediction]:
        """Masks of frames, with class ids in part_3.

        Raises:
            Avs3dError: if a frame has no sound, a file is damaged, or memory runs out.
        """
        out: list[Prediction] = []
        for start in range(0, len(frames), BATCH):
            part = frames[start : start + BATCH]
            pictures = [frame.rgb() for frame in part]
            sounds = np.stack([self._heard(frame) for frame in part])
            cameras = np.asarray([camera_of(frame) for frame in part], np.float32)
            with inference(self.device, _where(part[0])):
                answers = self.answers([fit(picture, cv2.INTER_AREA) for picture in pictures], sounds, cameras)
            for frame, picture, answer in zip(part, pictures, answers, strict=True):
                mask = self.mask(answer, picture)
                classes = class_map(mask, answer) if frame.observation.is_sound_scene else None
                out.append(Prediction(mask, classes))
        return out

    def _heard(self, frame: Frame) -> NDArray[np.float32]:
        if self.hearing == "none":
            return np.zeros((2, layout.SAMPLE_RATE), np.float32)
        return clip_of(frame if self.hearing == "own" else foreign_frame(frame))

    def mask(self, answer: Answer, picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """(H, W) bool of a picture (H, W, 3), rules 2 and 3."""
        if answer.mask.max() <= _logit(self.threshold) - 1:
            return np.zeros(picture.shape[:2], np.bool_)
        large = cv2.resize(answer.mask, picture.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        if self.refine:
            large = guided(np.clip(large, -_MOST_LOGIT, _MOST_LOGIT), picture)
        return without_specks(large > _logit(self.threshold), LEAST_AREA)

    @property
    def notes(self) -> str:
        """The settings, for submission.json."""
        sound = {"own": "", "none": "; heard nothing", "other": "; heard the sound of another observation"}
        edges = "guided filter at edges" if self.refine else "no refinement of edges"
        return (
            f"2D, from the picture and the binaural second of test frames; weights {self.digest[:12]}; "
            f"marked where > {self.threshold:g}; {edges}; components below {LEAST_AREA:g} of the picture dropped"
            + sound[self.hearing]
        )


def _where(frame: Frame) -> str:
    return f"{frame.observation.path}/{frame.name}"


def _logit(share: float) -> float:
    return float(np.log(share / (1 - share)))


def clip_of(frame: Frame) -> NDArray[np.float32]:
    """(2, 44100) float32: the frame's sound; shorter or longer files of other releases are cut or filled with zeros.

    Raises:
        Avs3dError: if it is missing, has another number of channels, or holds no numbers.
    """
    sound = np.asarray(frame.audio(), np.float32)
    if sound.ndim != 2 or sound.shape[0] != 2:
        raise Avs3dError(f"{_where(frame)}: sound of shape {sound.shape}, expected two ears (2, n)")
    if not np.isfinite(sound).all():
        raise Avs3dError(f"{_where(frame)}: the sound holds NaN or infinite samples; regenerate the dataset")
    out = np.zeros((2, layout.SAMPLE_RATE), np.float32)
    length = min(sound.shape[1], layout.SAMPLE_RATE)
    out[:, :length] = sound[:, :length]
    return out


def foreign_frame(frame: Frame) -> Frame:
    """The frame of the same place in time of the next observation that is of another room and category.

    Raises:
        UsageError: if the dataset has no such observation.
    """
    mine, dataset = frame.observation, _dataset(frame.observation.root)
    start = dataset.keys.index(mine.key)
    for step in range(1, len(dataset)):
        other = dataset[(start + step) % len(dataset)]
        # Siblings and twins of the room would be right by chance.
        if (
            other.category not in (None, mine.category)
            and (other.group or other.key) != (mine.group or mine.key)
            and len(other)
        ):
            return other.frames[min(frame.index, len(other) - 1)]
    raise UsageError(f"{dataset.root}: no observation of another category than {mine.key}; --sound other needs one")


@lru_cache(maxsize=4)
def _dataset(root: Path) -> Dataset:
    return Dataset(root)


def camera_of(frame: Frame) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy as shares of the picture's width and height."""
    camera = frame.observation.intrinsics
    return (
        camera.fx / camera.width,
        camera.fy / camera.height,
        camera.cx / camera.width,
        camera.cy / camera.height,
    )


def guided(values: NDArray[np.float32], picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Values (H, W) whose edges follow those of the picture's brightness: the guided filter, equations 5 and 6.

    Args:
        values: float32.
        picture: (H, W, 3) uint8 RGB.
    """
    guide = cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2GRAY).astype(np.float32) / 255
    radius = max(1, round(RADIUS * picture.shape[1]))

    def mean(x: Any) -> Any:
        return cv2.blur(x, (2 * radius + 1,) * 2, borderType=cv2.BORDER_REFLECT)

    average, middle = mean(guide), mean(values)
    slope = (mean(guide * values) - average * middle) / (mean(guide * guide) - average * average + SMOOTHNESS)
    offset = middle - slope * average
    return np.asarray(mean(slope) * guide + mean(offset), np.float32)


def without_specks(mask: NDArray[np.bool_], share: float) -> NDArray[np.bool_]:
    """The mask without components (8-connected) that are smaller than a share of the picture."""
    if not mask.any():
        return mask
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] >= share * mask.size
    large[0] = False
    return np.asarray(large[labels])


def class_map(mask: NDArray[np.bool_], answer: Answer) -> NDArray[np.uint8]:
    """(H, W) class ids of what is marked, rule 4: one per component."""
    out = np.zeros(mask.shape, np.uint8)
    if not mask.any():
        return out
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    likely = answer.classes[1:] * answer.audible[:, None, None]
    ids = np.zeros(count, np.uint8)
    for label in range(1, count):
        rows, columns = np.nonzero(labels == label)
        cells = rows * _CELLS // mask.shape[0], columns * _CELLS // mask.shape[1]
        ids[label] = 1 + int(likely[:, cells[0], cells[1]].sum(axis=-1).argmax())
    return np.asarray(ids[labels])


def load_method(
    weights: str | Path | None = None,
    *,
    device: str | None = None,
    threshold: float = THRESHOLD,
    refine: bool = True,
    hearing: Hearing = "own",
) -> ListenerMethod:
    """The listener, ready to predict.

    Args:
        weights: file; None: those of the package.
        device: cpu, cuda or cuda:<number>; None: a GPU where there is one.
        threshold: see `THRESHOLD`.
        refine: whether masks follow the picture's edges.
        hearing: what it hears.

    Raises:
        UsageError: if there is no such device.
        Avs3dError: if the weights are missing, damaged, or of another version.
    """
    from baselines.listener.weights import load_listener

    where = pick_device(device)
    network, digest = load_listener(weights, device=where)
    return ListenerMethod(network, where, digest, threshold=threshold, refine=refine, hearing=hearing)


def write_listener(
    dataset: Dataset,
    path: str | Path,
    model: ListenerMethod,
    *,
    only: Iterable[str] = (),
    overwrite: bool = False,
    progress: bool = False,
) -> SubmissionWriter:
    """Write the masks of the test frames as a submission, and in part_3 the class ids.

    Args:
        dataset: what to look at; of test frames only pictures, sound and intrinsics are read.
        path: the submission's folder.
        model: of `load_method`.
        only: shell patterns of observation keys.
        overwrite: replace an existing submission.
        progress: show a bar on stderr.

    Returns:
        The writer; its attributes describe what was written.

    Raises:
        UsageError: if no observation matches, or the target is not free.
        Avs3dError: if a file is missing or damaged, memory runs out, or the system refuses.
    """
    name = {"own": "Listener", "none": "Listener, no sound", "other": "Listener, wrong sound"}[model.hearing]
    method = Method(name, model.predictions, notes=model.notes, entry="baselines.listener.predict:write_listener")
    return write_submission(dataset, path, method, only=only, overwrite=overwrite, progress=progress)
