"""Sounds named by CLAP, through transformers: zero-shot, a sentence for each kind of sound."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from baselines.networks.checkpoints import find_checkpoint, load_pretrained, loading, require_packages
from baselines.networks.sound import resample

if TYPE_CHECKING:
    import torch

#: Clips that are embedded at a time.
BATCH = 16


class ClapTagger:
    """Posteriors from a folder with a checkpoint of `transformers.ClapModel`.

    Attributes:
        name: which network.
    """

    name = "CLAP"

    def __init__(self, folder: str | Path, device: torch.device) -> None:
        """Load the network.

        Args:
            folder: the checkpoint, as `save_pretrained` of model and processor write it.
            device: a `torch.device`.

        Raises:
            UsageError: if a package is missing.
            Avs3dError: if the checkpoint is missing or broken.
        """
        require_packages("clap")
        find_checkpoint("clap", folder)
        with loading("clap", folder):
            from transformers import AutoTokenizer, ClapFeatureExtractor, ClapModel

            self._tokenizer = AutoTokenizer.from_pretrained(str(folder), local_files_only=True)
            self._extractor = ClapFeatureExtractor.from_pretrained(str(folder), local_files_only=True)
        self._model = load_pretrained("clap", ClapModel, folder).to(device)
        self._device = device

    def posterior(self, clips: Sequence[NDArray[np.float32]], rate: int, texts: Sequence[str]) -> NDArray[np.float64]:
        """See `protocols.SoundTagger`: softmax of CLAP's logit scale times the cosine of sound and text."""
        import torch

        target = self._extractor.sampling_rate
        words = self._tokenizer(list(texts), padding=True, return_tensors="pt").to(self._device)
        parts = []
        for start in range(0, len(clips), BATCH):
            sounds = [resample(clip, rate, target) for clip in clips[start : start + BATCH]]
            # A clip shorter than the network's ten seconds is repeated, which is what it was trained on; a longer one,
            # of which the extractor would take a random part, cannot come from a frame.
            inputs = self._extractor(sounds, sampling_rate=target, return_tensors="pt").to(self._device)
            parts.append(self._model(**words, **inputs).logits_per_audio)
        return np.asarray(torch.cat(parts).double().softmax(dim=1).cpu().numpy())
