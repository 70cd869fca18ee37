"""Pictures and sound in the space of PE-AV, the audio-visual Perception Encoder; through transformers.

"Pushing the Frontier of Audiovisual Perception with Large-Scale Multimodal Correspondence Learning", Vyas et al., 2025.
It was trained with a sigmoid loss on the logit s·⟨audio, video⟩ + b that a pair belongs together, with a learned scale
s that takes the place of ImageBind's fixed 20; in a softmax over proposals b cancels.

PE-AV embeds videos. A cut-out is a video of `STILL_FRAMES` equal frames, of which only one goes through the vision
tower.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from baselines.networks.checkpoints import find_checkpoint, load_pretrained, loading, require_packages
from baselines.networks.pixels import BILINEAR, Picture, normalise, resize
from baselines.networks.sound import resample

if TYPE_CHECKING:
    import torch

#: Crops that are embedded at a time.
BATCH = 16
#: Number of frames for the ``-16-frame`` checkpoints; the others take any number.
STILL_FRAMES = 16


class PeAvSimilarity:
    """Logits from a folder with a checkpoint of `transformers.PeAudioVideoModel`.

    Attributes:
        name: which network.
    """

    name = "PE-AV"

    def __init__(self, folder: str | Path, device: torch.device) -> None:
        """Load the network.

        Args:
            folder: the checkpoint, as `save_pretrained` of model and processor write it.
            device: a `torch.device`.

        Raises:
            UsageError: if a package is missing.
            Avs3dError: if the checkpoint is missing or broken.
        """
        require_packages("pe-av")
        find_checkpoint("pe-av", folder)
        with loading("pe-av", folder):
            from transformers import PeAudioFeatureExtractor, PeAudioVideoModel

            self._extractor = PeAudioFeatureExtractor.from_pretrained(str(folder), local_files_only=True)
            self._still = read_still(Path(folder))
        model = load_pretrained("pe-av", _untied_rotations(PeAudioVideoModel), folder).to(device)
        self._audio = model.audio_model
        self._encoder, self._head = model.video_model.video_encoder, model.video_model.video_head
        self._encoder.embedder = still_embedder(self._encoder.embedder, STILL_FRAMES)
        self._scale = float(model.audio_video_logit_scale.item())
        self._device = device

    def logits(self, crops: Sequence[Picture], clip: NDArray[np.float32], rate: int) -> NDArray[np.float64]:
        """See `protocols.AudioVisualSimilarity`."""
        sound = self._hear(clip, rate)
        seen = [self._see(crops[start : start + BATCH]) for start in range(0, len(crops), BATCH)]
        return np.asarray(self._scale * (np.concatenate(seen) @ sound))

    def _hear(self, clip: NDArray[np.float32], rate: int) -> NDArray[np.float64]:
        """(C,) the clip's embedding."""
        target = self._extractor.sampling_rate
        inputs = self._extractor(resample(clip, rate, target), sampling_rate=target, return_tensors="pt")
        found = self._audio.get_audio_embeds(**inputs.to(self._device))
        return np.asarray(found[0].cpu().numpy().astype(np.float64))

    def _see(self, crops: Sequence[Picture]) -> NDArray[np.float64]:
        """(N, C) the crops' embeddings."""
        import torch

        pixels = torch.from_numpy(np.stack([self._still.pixels(crop) for crop in crops]))[:, None]
        found = self._head(self._encoder(pixel_values_videos=pixels.to(self._device)).pooler_output)
        return np.asarray(found.cpu().numpy().astype(np.float64))


def _untied_rotations(cls: Any) -> Any:
    """The model class, which shares its weights between the towers, without the buffers of the rotary embedding.

    transformers 5.23 leaves ``rope.pos_embed`` out, newer timm also has ``rope.bands``; sharing it fails, since it is
    no parameter. Both are computed, not stored.
    """
    shared = {
        key.replace(r"\.rope\.pos_embed", r"\.rope\."): value.replace(r"\.rope\.pos_embed", r"\.rope\.")
        for key, value in cls._tied_weights_keys.items()
    }
    return type(cls.__name__, (cls,), {"_tied_weights_keys": shared, "__module__": cls.__module__})


def still_embedder(embedder: Any, frames: int) -> Any:
    """The embedder of a video encoder for stills: embeds one frame (B, 1, 3, h, w) and repeats it in time.

    Exact, because the embedder treats every frame on its own; only what follows it looks along the time.
    """
    import torch

    class StillEmbedder(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.embedder = embedder

        def forward(self, pixel_values_videos: Any, padding_mask: Any = None) -> Any:
            embeds, padding_mask = self.embedder(pixel_values_videos, padding_mask=padding_mask)
            return embeds.expand(-1, frames, -1), padding_mask

    return StillEmbedder()


@dataclass(frozen=True)
class Still:
    """How the checkpoint's video processor prepares a frame.

    Attributes:
        size: (height, width).
        mean: of the three channels.
        std: of the three channels.
        resample: Pillow's number of the filter.
    """

    size: tuple[int, int]
    mean: tuple[float, ...]
    std: tuple[float, ...]
    resample: int = BILINEAR

    def pixels(self, picture: Picture) -> NDArray[np.float32]:
        """(3, h, w) float32 from (H, W, 3) uint8 RGB."""
        return normalise(resize(picture, self.size, self.resample), self.mean, self.std)


def read_still(folder: Path) -> Still:
    """The settings of the video processor in a checkpoint's folder.

    `save_pretrained` puts them into a file of their own or, with those of the audio, into one of the processor.

    Raises:
        ValueError: if no file there describes the preparation of a frame.
    """
    found: dict[str, Any] = {}
    for name, part in (("video_preprocessor_config.json", None), ("processor_config.json", "video_processor")):
        if (folder / name).is_file():
            data = json.loads((folder / name).read_text())
            found = data if part is None else data.get(part, {})
        if found:
            break
    try:
        return Still(
            size=(int(found["size"]["height"]), int(found["size"]["width"])),
            mean=tuple(map(float, found["image_mean"])),
            std=tuple(map(float, found["image_std"])),
            resample=int(found.get("resample", BILINEAR)),
        )
    except KeyError as error:
        raise ValueError(f"no {error} in video_preprocessor_config.json or processor_config.json") from None
