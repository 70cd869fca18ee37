"""Where the 2D masks of train frames come from: the oracle, or a folder of pictures (OWOD-BIND writes one)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.dataset import Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.media import read_png_mask
from baselines.oracle import PERFECT, Instance, oracle_mask, oracle_prediction
from baselines.oracle_errors import ErrorModel

Mask = NDArray[np.bool_]


class MaskSource(Protocol):
    """Gives a mask for a train frame."""

    @property
    def name(self) -> str:
        """Its name in submission.json."""

    def mask(self, frame: Frame) -> Mask:
        """(H, W) bool, of the frame's size."""

    def categories(self, frame: Frame) -> NDArray[np.uint8] | None:
        """(H, W) class ids of what the mask of a frame of part_3 marks; None if the source does not know them."""


@dataclass(frozen=True)
class OracleMasks:
    """The truth of train frames, perfect or with errors.

    Attributes:
        instance: ``category``, the ambiguous masks of a perfect detector without sound, or ``sounding``.
        errors: what goes wrong.

    Examples:
        >>> from avs3d_bench import Dataset
        >>> frame = Dataset("data/demo")["part_2/apartment_1/kitchen/1"].train[3]
        >>> source = OracleMasks("sounding")
        >>> source.name, source.mask(frame).shape
        ('oracle (sounding)', (64, 64))
    """

    instance: Instance = "category"
    errors: ErrorModel = PERFECT

    @property
    def name(self) -> str:
        """E.g. ``oracle (category)``."""
        faults = ", ".join(f"{k} {v:g}" for k, v in self.errors.settings.items())
        return f"oracle ({self.instance}{', ' + faults if faults else ''})"

    def mask(self, frame: Frame) -> Mask:
        """(H, W) bool: the oracle's mask of a train frame.

        Raises:
            UsageError: for a test frame, or if the dataset has no truth.
        """
        if frame.split != "train":
            raise UsageError(f"{frame.observation.key}/{frame.name}: the truth of test frames is not for this baseline")
        return oracle_mask(frame, instance=self.instance, errors=self.errors)

    def categories(self, frame: Frame) -> NDArray[np.uint8] | None:
        """(H, W) uint8: the oracle's class ids of a train frame of part_3; None elsewhere.

        Raises:
            UsageError: for a test frame.
        """
        if frame.split != "train":
            raise UsageError(f"{frame.observation.key}/{frame.name}: the truth of test frames is not for this baseline")
        ids = oracle_prediction(frame, instance=self.instance, errors=self.errors).categories
        return None if ids is None else np.asarray(ids, np.uint8)


@dataclass(frozen=True)
class FolderMasks:
    """Masks on disk: ``<folder>/<key>/<frame>.png``, 0 and 255, at the size of the frame.

    A frame without a file has an empty mask; an observation without any is an error.

    Examples:
        >>> from pathlib import Path
        >>> from avs3d_bench import Dataset, media
        >>> frame = Dataset("data/demo")["part_1/apartment_1/bathroom/1"].train[3]
        >>> media.write_png_mask(f"masks/{frame.observation.key}/{frame.name}.png", frame.mask())
        >>> source = FolderMasks(Path("masks"))
        >>> source.name, bool((source.mask(frame) == frame.mask()).all())
        ('masks', True)
    """

    folder: Path

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.folder.resolve().name

    def mask(self, frame: Frame) -> Mask:
        """(H, W) bool: the picture of a frame; nothing is marked where there is no file.

        Raises:
            Avs3dError: if the observation has no mask at all, or a file is damaged.
        """
        path = self._path(frame)
        if not path.exists():
            if not path.parent.is_dir() or not any(path.parent.glob("*.png")):
                raise Avs3dError(f"{path.parent}: no mask; expected {path.name} and on for the train frames")
            return np.zeros((frame.observation.intrinsics.height, frame.observation.intrinsics.width), np.bool_)
        return read_png_mask(path)

    def categories(self, frame: Frame) -> None:
        """Masks in a folder have no classes."""

    def _path(self, frame: Frame) -> Path:
        return self.folder / frame.observation.key / f"{frame.name}.png"


def mask_source(text: str, *, instance: Instance, errors: ErrorModel) -> MaskSource:
    """The source that ``--masks`` names: ``oracle``, or a folder.

    Raises:
        UsageError: if it is neither.
    """
    if text == "oracle":
        return OracleMasks(instance, errors)
    folder = Path(text)
    if not folder.is_dir():
        raise UsageError(
            f"--masks {text}: expected 'oracle', 'owod-bind', 'listener' or a folder <key>/<frame>.png of masks"
        )
    return FolderMasks(folder)
