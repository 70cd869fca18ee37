"""Pictures and sound in ImageBind's common space, as in the released pipeline.

"ImageBind: One Embedding Space To Bind Them All", Girdhar et al., CVPR 2023, through its own package. Both embeddings
have length 1, the audio one times ImageBind's fixed logit scale of 20; their product is the logit.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from baselines.networks.checkpoints import find_checkpoint, load_weights, loading, require_packages
from baselines.networks.pixels import (
    BICUBIC,
    CLIP_MEAN,
    CLIP_STD,
    Picture,
    centre_crop,
    normalise,
    resize,
    shorter_side,
)
from baselines.networks.sound import resample
from baselines.owod_bind.select import AUDIO_LOGIT_SCALE

if TYPE_CHECKING:
    import torch

#: Crops that are embedded at a time.
BATCH = 32
SIDE = 224
RATE = 16_000
MEL_BINS, MEL_FRAMES = 128, 204
MEL_MEAN, MEL_STD = -4.268, 9.138


class ImageBindSimilarity:
    """Logits from a folder with ``imagebind_huge.pth``.

    Attributes:
        name: which network.
    """

    name = "ImageBind"

    def __init__(self, folder: str | Path, device: torch.device) -> None:
        """Load the network.

        Args:
            folder: holds the weights.
            device: a `torch.device`.

        Raises:
            UsageError: if the package is missing.
            Avs3dError: if the weights are missing or broken.
        """
        require_packages("imagebind")
        (path,) = find_checkpoint("imagebind", folder).values()
        weights = load_weights("imagebind", path)
        with loading("imagebind", folder):
            data: Any = import_module("imagebind.data")
            imagebind_model: Any = import_module("imagebind.models.imagebind_model")
            model = imagebind_model.imagebind_huge(pretrained=False)
            model.load_state_dict(weights)
        self._model = model.eval().requires_grad_(False).to(device)
        self._spectrogram = data.waveform2melspec
        self._vision = imagebind_model.ModalityType.VISION
        self._audio = imagebind_model.ModalityType.AUDIO
        self._device = device

    def logits(self, crops: Sequence[Picture], clip: NDArray[np.float32], rate: int) -> NDArray[np.float64]:
        """See `protocols.AudioVisualSimilarity`."""
        import torch

        sound = self._embed(self._audio, self._hear(clip, rate))
        seen = [
            self._embed(self._vision, torch.from_numpy(np.stack([prepare(c) for c in crops[i : i + BATCH]])))
            for i in range(0, len(crops), BATCH)
        ]
        return np.asarray(AUDIO_LOGIT_SCALE * (np.concatenate(seen) @ sound[0]))

    def _hear(self, clip: NDArray[np.float32], rate: int) -> Any:
        """(1, 1, 1, mel bins, frames): one clip of two seconds.

        The package takes three clips of a recording; of two seconds all three are the same.
        """
        import torch

        waveform = torch.from_numpy(resample(clip, rate, RATE).copy())[None]
        mel = self._spectrogram(waveform, RATE, MEL_BINS, MEL_FRAMES)
        return ((mel - MEL_MEAN) / MEL_STD)[None, None]

    def _embed(self, modality: str, inputs: Any) -> NDArray[np.float64]:
        """(N, C) of length 1."""
        found = self._model({modality: inputs.to(self._device)})[modality].cpu().numpy().astype(np.float64)
        return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def prepare(crop: Picture) -> NDArray[np.float32]:
    """(3, 224, 224) float32 from (h, w, 3) uint8 RGB: shorter side 224 (bicubic), the middle of it, normalised."""
    height, width = crop.shape[:2]
    resized = resize(crop, shorter_side((height, width), SIDE), BICUBIC)
    return normalise(centre_crop(resized, SIDE), CLIP_MEAN, CLIP_STD)
