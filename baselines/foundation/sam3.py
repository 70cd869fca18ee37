"""Every instance of a text in a picture by SAM 3, through transformers ("promptable concept segmentation")."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from baselines.foundation.protocols import TextMasks
from baselines.foundation.still import masks_at, ordered, read_size
from baselines.networks.checkpoints import find_checkpoint, load_pretrained, loading, require_packages
from baselines.networks.pixels import Picture, normalise, resize

if TYPE_CHECKING:
    import torch

#: An instance's score (of the query, times that of the text being there at all) above which it counts, as in
#: `post_process_instance_segmentation`'s documentation.
SCORE = 0.5
#: Of the three channels; SAM 3 was trained with these, not with ImageNet's.
_MEAN = _STD = (0.5, 0.5, 0.5)


class Sam3Segmenter:
    """Masks from a folder with a checkpoint of `transformers.Sam3Model`.

    The picture is prepared here: the library's own processor needs torchvision.

    Attributes:
        name: which network.
    """

    name = "SAM 3"

    def __init__(self, folder: str | Path, device: torch.device) -> None:
        """Load the network; arguments and errors as `clap.ClapTagger`."""
        require_packages("sam3")
        find_checkpoint("sam3", folder)
        with loading("sam3", folder):
            from transformers import AutoTokenizer, Sam3Model

            self._tokenizer = AutoTokenizer.from_pretrained(str(folder), local_files_only=True)
            self._words = int(_text_config(Path(folder))["max_position_embeddings"])
        self._model = load_pretrained("sam3", Sam3Model, folder).to(device)
        self._size = read_size(self._model.config.image_size)
        self._device = device

    def segment(self, picture: Picture, texts: Sequence[str]) -> list[TextMasks]:
        """See `protocols.TextSegmenter`. The picture is encoded once for all texts."""
        import torch

        pixels = torch.from_numpy(normalise(resize(picture, self._size), _MEAN, _STD))[None]
        seen = self._model.get_vision_features(pixel_values=pixels.to(self._device))
        found = []
        for text in texts:
            words = self._tokenizer(
                [text], padding="max_length", max_length=self._words, truncation=True, return_tensors="pt"
            ).to(self._device)
            out = self._model(vision_embeds=seen, input_ids=words["input_ids"], attention_mask=words["attention_mask"])
            scores = (out.pred_logits.sigmoid() * out.presence_logits.sigmoid())[0].flatten()
            kept = scores > SCORE
            masks = masks_at(out.pred_masks[0][kept], (picture.shape[0], picture.shape[1]))
            found.append(ordered(masks, np.asarray(scores[kept].double().cpu().numpy())))
        return found


def _text_config(folder: Path) -> dict[str, Any]:
    """The settings of the text encoder; a checkpoint of SAM 3's video model holds them inside of the detector's."""
    config = json.loads((folder / "config.json").read_bytes())
    found: dict[str, Any] = config.get("detector_config", config)["text_config"]
    return found
