"""Masks of train frames for a method that lifts them into 3D and then chooses by sound (`--masks listener`).

Such a method asks for different things, which the network knows:

    sounding   the network's mask: what sounds, as far as one frame and one second tell
    category   every object of a category that is heard: which of them sounds is left to the sound of all frames
    direction  the object from whose place the sound of all frames comes, whatever it is called (`direction_alone`)

``category`` is the answer of a detector that does not compare both ears: its masks of twins agree from frame to frame,
whereas ``sounding`` may take one twin in one frame and the other in the next. In part_1 and part_2 one object sounds
all the time, so that the train frames together say which category is heard; in part_3 each frame says it for itself.

Nothing of the truth is read. Answers are class ids, 0 where nothing is marked.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.dataset import Frame
from avs3d_bench.errors import Avs3dError
from baselines.listener.masks import Answer, class_map, log_odds, marked_where
from baselines.listener.predict import BATCH, THRESHOLD, ListenerMethod, Looks, load_method

if TYPE_CHECKING:
    import torch

    from baselines.listener.weights import Calibration
    from baselines.sound_control import SoundControl

#: Which of the network's answers is the mask.
Which = Literal["sounding", "category", "direction"]
#: How often the network looks at a train frame.
MARKING_LOOKS: Looks = "several"
#: Probability above which a pixel is marked as the category; chosen on validation homes, as `THRESHOLD`.
CATEGORY_THRESHOLD = 0.2
#: In place of a category: what is heard may be any.
EVERY = -1


@dataclass(frozen=True)
class ListenerMarker:
    """Marks train frames; it can be pickled, and loads the network on the device where it is used.

    Attributes:
        weights: file of weights; None: those of the package.
        digest: sha256 of the weights.
        which: see the module.
        calibration: of the weights, if they name one; it has the thresholds.
        hearing: what the network hears in place of a frame's own sound.
        loaded: the network, where it is loaded already; None: where it is used, a process loads and keeps it.
    """

    weights: Path | None
    digest: str
    which: Which = "category"
    calibration: Calibration | None = None
    hearing: SoundControl = "own"
    loaded: ListenerMethod | None = None

    @property
    def threshold(self) -> float:
        """Probability above which a pixel is marked; with a `share`, above which a frame's peak must be."""
        if self.calibration is not None:
            return self.calibration.threshold if self.which == "sounding" else self.calibration.category
        return THRESHOLD if self.which == "sounding" else CATEGORY_THRESHOLD

    @property
    def share(self) -> float | None:
        """Share of the peak above which a pixel is marked as sounding, see `masks.marked`."""
        return self.calibration.share if self.calibration is not None and self.which != "category" else None

    @property
    def entry(self) -> str:
        """The module that computes the masks (see `avs3d_bench.runtime.provenance`)."""
        return "baselines.listener.marks:ListenerMarker"

    @property
    def name(self) -> str:
        """E.g. ``listener (category)``."""
        return f"listener ({self.which})"

    @property
    def settings(self) -> dict[str, str | float]:
        """Everything besides the software and the frames that decides the masks."""
        found: dict[str, str | float] = {"weights": self.digest, "answer": self.which, "threshold": self.threshold}
        found |= {} if self.hearing == "own" else {"sound": self.hearing}
        return found | ({} if self.share is None else {"share": self.share}) | {"looks": MARKING_LOOKS}

    @property
    def notes(self) -> str:
        """The settings, for submission.json."""
        return f"answer {self.which}, {marked_where(self.threshold, self.share)}, weights {self.digest[:12]}"

    def method(self, device: torch.device) -> ListenerMethod:
        """The network with these settings; a process keeps it for its next observation.

        Raises:
            Avs3dError: if the weights are others than those of ``digest``.
        """
        kept = self.loaded or _method(self.weights, str(device))
        method = replace(kept, threshold=self.threshold, share=self.share, hearing=self.hearing)
        if method.digest != self.digest:
            raise Avs3dError(
                f"{self.weights or 'weights of the package'}: sha256 {method.digest[:12]}…, expected "
                f"{self.digest[:12]}…; the file was changed, or another machine has another one"
            )
        return method

    def mark(self, frames: Sequence[Frame], device: torch.device) -> Iterator[NDArray[np.uint8]]:
        """(H, W) class ids of each of the train frames of one observation, in their order.

        Raises:
            Avs3dError: if the weights are others than those of ``digest``, or a frame's files are missing or damaged.
        """
        method = self.method(device)
        if self.which == "sounding":
            for start in range(0, len(frames), BATCH):
                for found in method.predictions(frames[start : start + BATCH]):
                    yield np.asarray(found.mask if found.categories is None else found.categories, np.uint8)
            return
        answers = method.seen(frames)
        together = not any(frame.observation.is_part_3 for frame in frames)
        shared = shared_category(answers) if together else None
        for frame, answer in zip(frames, answers, strict=True):
            changed = of_category(answer, shared)
            yield class_map(method.mask(changed.mask, frame.rgb()), changed)


def shared_category(answers: Sequence[Answer]) -> int:
    """The category (0-based) that is most probably heard in all of these answers: the largest sum of log-odds.

    `EVERY` if it is more probable that what is heard has no name: then its place decides among all objects.
    """
    odds = np.sum([log_odds(answer.audible) for answer in answers], axis=0)
    best = int(np.argmax(odds))
    unknown, named = (np.mean(each) for each in ([a.unknown for a in answers], [a.audible[best] for a in answers]))
    return EVERY if unknown > named else best


def of_category(answer: Answer, category: int | None) -> Answer:
    """The answer whose mask is every object of what is heard.

    Args:
        answer: of the network.
        category: 0-based, the only one that is heard; `EVERY`: it may be any; None: as the answer says,
            P(heard) = Σ P(class) · P(heard by name, or as what has no name).
    """
    if category is None:
        return replace(answer, mask=log_odds(np.einsum("chw,c->hw", answer.classes[1:], answer.heard)))
    if category == EVERY:
        objects = np.asarray(1 - answer.classes[0], np.float32)
        return replace(answer, mask=log_odds(objects), audible=np.ones_like(answer.audible))
    audible = np.zeros_like(answer.audible)
    audible[category] = 1
    return replace(answer, mask=log_odds(answer.classes[1 + category]), audible=audible)


@lru_cache(maxsize=1)
def _method(weights: Path | None, device: str) -> ListenerMethod:
    return load_method(weights, device=device, looks=MARKING_LOOKS)


def load_marker(
    weights: Path | None = None, *, which: Which = "category", hearing: SoundControl = "own"
) -> ListenerMarker:
    """A marker with the digest of its weights.

    Raises:
        Avs3dError: if the weights are missing, damaged, or of another version.
    """
    from baselines.listener.weights import read_weights

    path = None if weights is None else weights.absolute()
    found = read_weights(path)
    return ListenerMarker(path, found.digest, which, found.calibration, hearing)
