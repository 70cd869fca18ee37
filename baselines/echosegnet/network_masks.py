"""Masks of train frames by a network, made on the worker's device and kept beside the other stages.

They lie under a name made of what decides them: the network's weights and settings, the software, and the pictures and
clips of the train frames. An observation in which the network marks nothing has empty masks in the submission.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.errors import UsageError
from avs3d_bench.formats.files import sha256_file
from avs3d_bench.runtime.provenance import provenance
from baselines.echosegnet.cache import Stages, digest
from baselines.echosegnet.sources import Mask, MaskSource

if TYPE_CHECKING:
    import torch

#: Name of the stage.
STAGE = "network"


class Marker(Protocol):
    """A network that marks frames by what it sees and hears; it can be pickled."""

    @property
    def name(self) -> str:
        """Its name in submission.json."""

    @property
    def notes(self) -> str:
        """Its settings, for readers."""

    @property
    def settings(self) -> Mapping[str, str | float]:
        """Everything besides the software and the frames that decides the masks."""

    @property
    def entry(self) -> str:
        """``baselines.module:name`` of what makes the masks (see `avs3d_bench.runtime.provenance`)."""

    def mark(self, frames: Sequence[Frame], device: torch.device) -> Iterable[NDArray[np.uint8]]:
        """(H, W) class ids of each of the train frames of one observation, in their order."""


@dataclass(frozen=True)
class NetworkMasks:
    """The masks that a network will make; `found` has those of an observation."""

    marker: Marker

    @property
    def name(self) -> str:
        """The marker's."""
        return self.marker.name

    def found(self, observation: Observation, device: torch.device, stages: Stages) -> KeptMasks:
        """The masks of an observation's train frames, made on ``device`` or found on disk."""
        frames = observation.train
        key = digest(
            {
                "observation": observation.key,
                "marker": dict(self.marker.settings),
                "software": provenance(self.marker.entry).digest,
                "inputs": [_inputs(frame) for frame in frames],
            }
        )
        kept = stages.load_arrays(STAGE, key)
        if kept is None or kept.keys() != {frame.name for frame in frames}:
            made = zip(frames, self.marker.mark(frames, device), strict=True)
            kept = {frame.name: _packed(ids) for frame, ids in made}
            stages.save_arrays(STAGE, key, kept)
        return KeptMasks(self.name, observation.key, kept)


#: Sources of the masks of a run.
AnySource = MaskSource | NetworkMasks


@dataclass(frozen=True, eq=False)
class KeptMasks:
    """The masks of one observation's train frames: a `MaskSource`.

    Attributes:
        name: of the network.
        key: of the observation.
        files: name of a train frame → its class ids as the bytes of a PNG.
    """

    name: str
    key: str
    files: Mapping[str, NDArray[np.uint8]]

    def mask(self, frame: Frame) -> Mask:
        """Where the network marks anything in a train frame."""
        return np.asarray(self._ids(frame) > 0)

    def categories(self, frame: Frame) -> NDArray[np.uint8]:
        """The class ids of what is marked."""
        return self._ids(frame)

    def category(self, frames: Iterable[Frame]) -> int:
        """The class id that most of what is marked in these frames has; 0 if nothing is marked."""
        count = np.sum([np.bincount(self._ids(frame).reshape(-1), minlength=256) for frame in frames], axis=0)
        count[0] = 0
        return int(count.argmax())

    def _ids(self, frame: Frame) -> NDArray[np.uint8]:
        if frame.observation.key != self.key or frame.name not in self.files:
            raise UsageError(f"{frame.observation.key}/{frame.name}: only train frames of {self.key} were marked")
        return np.asarray(cv2.imdecode(self.files[frame.name], cv2.IMREAD_UNCHANGED), np.uint8)


def _inputs(frame: Frame) -> list[str]:
    """sha256 of the files that a network reads; what is missing is for the network to say."""
    here = frame.observation.path
    picture = frame.path(layout.INPUT if (here / layout.INPUT).is_dir() else layout.IMAGES)
    clip = here / layout.audio_path(layout.BINAURAL, frame.index)
    return [sha256_file(path) if path.is_file() else "" for path in (picture, clip)]


def _packed(ids: NDArray[np.uint8]) -> NDArray[np.uint8]:
    done, data = cv2.imencode(".png", ids)
    assert done
    return np.asarray(data, np.uint8)
