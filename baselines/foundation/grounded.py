"""Every instance of a text in a picture: Grounding DINO finds boxes, SAM 2 segments what is in them.

Both have open weights. Pictures for SAM 2 are prepared here: the library's own processor needs torchvision.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from baselines.foundation.protocols import TextMasks
from baselines.foundation.still import masks_at, ordered, read_size
from baselines.networks.checkpoints import find_checkpoint, load_pretrained, loading, require_packages
from baselines.networks.pixels import IMAGENET_MEAN, IMAGENET_STD, Picture, normalise, resize
from baselines.owod_bind.boxes import corners_of
from baselines.owod_bind.protocols import Detections
from baselines.owod_bind.select import clip_boxes, suppress

if TYPE_CHECKING:
    import torch

#: Score of a box above which it counts, as in the authors' demonstration.
SCORE = 0.35
#: Boxes that overlap more are one object.
_NMS_IOU = 0.7
#: Boxes of a text in a picture at most.
_MOST = 16


class GroundedSam2:
    """Masks from folders with `transformers.GroundingDinoForObjectDetection` and `transformers.Sam2Model`.

    Attributes:
        name: which networks.
    """

    name = "Grounding DINO + SAM 2"

    def __init__(self, boxes: str | Path, masks: str | Path, device: torch.device) -> None:
        """Load both networks; errors as `clap.ClapTagger`."""
        for kind, folder in (("grounding-dino", boxes), ("sam2", masks)):
            require_packages(kind)
            find_checkpoint(kind, folder)
        with loading("grounding-dino", boxes):
            from transformers import AutoTokenizer, GroundingDinoForObjectDetection, GroundingDinoImageProcessorPil

            self._tokenizer = AutoTokenizer.from_pretrained(str(boxes), local_files_only=True)
            self._pictures = GroundingDinoImageProcessorPil.from_pretrained(str(boxes), local_files_only=True)
        with loading("sam2", masks):
            from transformers import Sam2Model
        self._finder = load_pretrained("grounding-dino", GroundingDinoForObjectDetection, boxes).to(device)
        self._model = load_pretrained("sam2", Sam2Model, masks).to(device)
        self._size = read_size(self._model.config.prompt_encoder_config.image_size)
        self._device = device

    def segment(self, picture: Picture, texts: Sequence[str]) -> list[TextMasks]:
        """See `protocols.TextSegmenter`. Each text is a caption of its own; SAM 2 encodes the picture once."""
        found = [self._boxes(picture, text) for text in texts]
        embeddings = self._embeddings(picture) if any(len(boxes) for boxes in found) else None
        return [ordered(self._masks(picture, embeddings, each.boxes), each.scores) for each in found]

    def _boxes(self, picture: Picture, text: str) -> Detections:
        """Boxes in pixels: the score of a query is that of its likeliest word."""
        seen = self._pictures(images=picture, return_tensors="pt").to(self._device)
        # A caption ends with a full stop, in lower case, as in training.
        words = self._tokenizer([f"{text.lower()}."], return_tensors="pt").to(self._device)
        out = self._finder(**seen, **words)
        scores = out.logits[0].sigmoid().max(dim=1).values.double().cpu().numpy()
        kept = scores > SCORE
        height, width = picture.shape[:2]
        corners = corners_of(out.pred_boxes[0].double().cpu().numpy()[kept]) * (width, height, width, height)
        return suppress(clip_boxes(Detections(corners, scores[kept]), (height, width)), iou=_NMS_IOU, at_most=_MOST)

    def _embeddings(self, picture: Picture) -> list[torch.Tensor]:
        import torch

        pixels = torch.from_numpy(normalise(resize(picture, self._size), IMAGENET_MEAN, IMAGENET_STD))[None]
        found: list[torch.Tensor] = self._model.get_image_embeddings(pixels.to(self._device))
        return found

    def _masks(
        self, picture: Picture, embeddings: list[torch.Tensor] | None, boxes: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """(N, H, W): the single-mask output for each box."""
        import torch

        size = (picture.shape[0], picture.shape[1])
        if embeddings is None or not len(boxes):
            return np.zeros((0, *size), np.bool_)
        scale = np.array([self._size[1] / size[1], self._size[0] / size[0]] * 2)
        prompts = torch.from_numpy(boxes * scale).float()[None].to(self._device)
        out = self._model(image_embeddings=embeddings, input_boxes=prompts, multimask_output=False)
        return masks_at(out.pred_masks[0][:, 0], size)
