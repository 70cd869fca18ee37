"""Masks from SAM: one for each box ("Segment Anything", Kirillov et al., 2023; the released pipeline uses ViT-H)."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from baselines.networks.checkpoints import find_checkpoint, load_pretrained, loading, require_packages
from baselines.networks.pixels import Picture

if TYPE_CHECKING:
    import torch

#: Boxes decoded at a time: 8 masks of 1008² in float32 are 33 MB.
BATCH = 8


class SamMasks:
    """Masks from a folder with a checkpoint of `transformers.SamModel`.

    Attributes:
        name: which network.
    """

    name = "SAM"

    def __init__(self, folder: str | Path, device: torch.device) -> None:
        """Load the network.

        Args:
            folder: the checkpoint, as `save_pretrained` writes it.
            device: a `torch.device`.

        Raises:
            UsageError: if a package is missing.
            Avs3dError: if the checkpoint is missing or broken.
        """
        require_packages("sam")
        find_checkpoint("sam", folder)
        with loading("sam", folder):
            transformers: Any = import_module("transformers")
            pictures = transformers.SamImageProcessorPil.from_pretrained(str(folder), local_files_only=True)
        self._processor = transformers.SamProcessor(pictures)
        self._model = load_pretrained("sam", transformers.SamModel, folder).to(device)
        self._device = device

    def segment(self, picture: Picture, boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
        """See `protocols.MaskPredictor`: SAM's single-mask output, its logits at the picture's size > 0."""
        masks = np.zeros((len(boxes), *picture.shape[:2]), dtype=np.bool_)
        if not len(boxes):
            return masks
        inputs = self._processor(images=picture, input_boxes=[boxes.tolist()], return_tensors="pt")
        # The picture is encoded once, however many boxes there are: that is where SAM's time goes.
        embedding = self._model.get_image_embeddings(inputs["pixel_values"].to(self._device))
        prompts = inputs["input_boxes"].float().to(self._device)
        for start in range(0, len(boxes), BATCH):
            part = prompts[:, start : start + BATCH]
            low = self._model(image_embeddings=embedding, input_boxes=part, multimask_output=False).pred_masks
            (full,) = self._processor.post_process_masks(
                low, inputs["original_sizes"], inputs["reshaped_input_sizes"], binarize=True
            )
            masks[start : start + BATCH] = full[:, 0].cpu().numpy()
        return masks
