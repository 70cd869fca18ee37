"""Class-agnostic boxes from MAVL (MDef-DETR), the detector of the released pipeline.

"Class-agnostic Object Detection with Multi-modal Transformer", Maaz et al., ECCV 2022. Its code is no package: a clone
of the repository on PYTHONPATH gives the module ``models.model``, with the deformable attention compiled. The network
is used as its `ModulatedDetection` does (shorter side 800, ImageNet normalisation, the caption "all objects", a box's
score = 1 − the probability of "no object"), without the files, and the GPU, that this class insists on.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from baselines.networks.checkpoints import find_checkpoint, loading, require_packages
from baselines.networks.pixels import IMAGENET_MEAN, IMAGENET_STD, Picture, normalise, resize, shorter_side
from baselines.owod_bind.boxes import MAX_BOXES, NMS_IOU, corners_of
from baselines.owod_bind.protocols import Detections
from baselines.owod_bind.select import clip_boxes, suppress

if TYPE_CHECKING:
    import torch

CAPTION = "all objects"
SHORT_SIDE = 800


class MavlBoxes:
    """Boxes from a folder with the MDef-DETR checkpoint.

    Attributes:
        name: which network.
    """

    name = "MAVL"

    def __init__(self, folder: str | Path, device: torch.device) -> None:
        """Load the network.

        Args:
            folder: holds ``MDef_DETR_r101_epoch20_ore.pth`` or ``MDef_DETR_r101_epoch20.pth``.
            device: a `torch.device`.

        Raises:
            UsageError: if the repository's code is not on PYTHONPATH.
            Avs3dError: if the checkpoint is missing or broken, or the text encoder (RoBERTa) is not in the cache.
        """
        require_packages("mavl")
        (path,) = find_checkpoint("mavl", folder).values()
        with loading("mavl", folder):
            package: Any = import_module("models.model")
            # Its wrapper for inference reads files and calls .cuda(); the network inside does not.
            network = package.Model("mdef_detr", str(path)).get_model().model.eval()
        self._network = network.requires_grad_(False).to(device)
        self._device = device

    def propose(self, pictures: Sequence[Picture]) -> list[Detections]:
        """See `protocols.BoxProposer`."""
        return [self._propose(picture) for picture in pictures]

    def _propose(self, picture: Picture) -> Detections:
        import torch

        pixels = torch.from_numpy(prepare(picture))[None].to(self._device)
        memory = self._network(pixels, [CAPTION], encode_and_save=True)
        out = self._network(pixels, [CAPTION], encode_and_save=False, memory_cache=memory)
        scores = 1.0 - out["pred_logits"][0].softmax(-1)[:, -1].cpu().numpy().astype(np.float64)
        size = picture.shape[:2]
        corners = corners_of(out["pred_boxes"][0].cpu().numpy().astype(np.float64)) * [*size[::-1], *size[::-1]]
        return suppress(clip_boxes(Detections(corners, scores), size), iou=NMS_IOU, at_most=MAX_BOXES)


def prepare(picture: Picture) -> NDArray[np.float32]:
    """(3, h, w) float32 with the shorter side 800, normalised, from (H, W, 3) uint8 RGB."""
    height, width = picture.shape[:2]
    return normalise(resize(picture, shorter_side((height, width), SHORT_SIDE)), IMAGENET_MEAN, IMAGENET_STD)
