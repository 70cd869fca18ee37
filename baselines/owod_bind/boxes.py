"""Class-agnostic boxes from OWLv2: its objectness head, which scores every patch by how much it looks like an object.

OWLv2 ("Scaling Open-Vocabulary Object Detection", Minderer et al., 2023) was trained to score objects without a text,
so no query is needed. The picture is padded to a square at its right and bottom, therefore boxes are relative to the
longer side.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from baselines.networks.checkpoints import find_checkpoint, load_pretrained, loading, require_packages
from baselines.networks.pixels import Picture
from baselines.owod_bind.protocols import Detections
from baselines.owod_bind.select import clip_boxes, suppress

if TYPE_CHECKING:
    import torch

#: One object is found by many patches.
NMS_IOU = 0.5
#: Proposals per picture that are segmented and compared at most. A softmax over more could hardly pass 0.2.
MAX_BOXES = 32


class Owlv2Boxes:
    """Boxes from a folder with a checkpoint of `transformers.Owlv2ForObjectDetection`.

    Attributes:
        name: which network.
    """

    name = "OWLv2 objectness"

    def __init__(self, folder: str | Path, device: torch.device) -> None:
        """Load the network.

        Args:
            folder: the checkpoint, as `save_pretrained` writes it.
            device: a `torch.device`.

        Raises:
            UsageError: if a package is missing.
            Avs3dError: if the checkpoint is missing or broken.
        """
        require_packages("owlv2")
        find_checkpoint("owlv2", folder)
        with loading("owlv2", folder):
            # The one backend that resizes as the network was trained, and needs no torchvision.
            from transformers import Owlv2ForObjectDetection, Owlv2ImageProcessorPil

            self._processor = Owlv2ImageProcessorPil.from_pretrained(str(folder), local_files_only=True)
        self._model = load_pretrained("owlv2", Owlv2ForObjectDetection, folder).to(device)
        self._device = device

    def propose(self, pictures: Sequence[Picture]) -> list[Detections]:
        """See `protocols.BoxProposer`."""
        pixels = self._processor(images=list(pictures), return_tensors="pt")["pixel_values"].to(self._device)
        features = self._model.image_embedder(pixel_values=pixels)[0]
        flat = features.flatten(1, 2)
        scores = self._model.objectness_predictor(flat).sigmoid().cpu().numpy().astype(np.float64)
        boxes = self._model.box_predictor(flat, features).cpu().numpy().astype(np.float64)
        return [detections(*found) for found in zip(boxes, scores, (p.shape[:2] for p in pictures), strict=True)]


def detections(boxes: NDArray[np.float64], scores: NDArray[np.float64], size: tuple[int, int]) -> Detections:
    """Proposals in pixels from OWLv2's output.

    Args:
        boxes: (N, 4) centre x, centre y, width, height, as shares of the padded square's side.
        scores: (N,) objectness in [0, 1].
        size: (height, width) of the picture.

    Returns:
        At most `MAX_BOXES`, the likeliest first, inside of the picture, without copies.
    """
    corners = corners_of(boxes) * float(max(size))
    return suppress(clip_boxes(Detections(corners, scores), size), iou=NMS_IOU, at_most=MAX_BOXES)


def corners_of(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 4) centre x, centre y, width, height → (N, 4) x0 y0 x1 y1."""
    half = boxes[:, 2:] / 2
    return np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half], axis=1)
