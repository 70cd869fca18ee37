"""Checkpoints of tiny networks of the real classes, with random weights, as `save_pretrained` writes them.

`write_owlv2`, `write_sam` and `write_pe_av` make folders that the real loading code reads. Weights come from a seed, so
that every run sees the same networks. DenseAV, ImageBind and MAVL are not on PyPI: `install_denseav`,
`install_imagebind` and `install_mavl` put modules with the interface of their packages in place, with small networks
whose weights are read from real files.
"""

from __future__ import annotations

import json
import sys
import types
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn

VISION = 64
SIDE = 28


def _seeded(build: Any) -> Any:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return build()


def write_owlv2(folder: Path) -> Path:
    """A tiny OWLv2: 8 × 8 patches of 64² pixels; about half of the patches have an objectness above 0.15."""
    from transformers import Owlv2Config, Owlv2ForObjectDetection, Owlv2ImageProcessorPil

    tower = {"hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 2, "num_attention_heads": 2}
    config = Owlv2Config(
        text_config={**tower, "vocab_size": 64, "max_position_embeddings": 8},
        vision_config={**tower, "image_size": VISION, "patch_size": 8},
        projection_dim=16,
    )
    model = _seeded(lambda: Owlv2ForObjectDetection(config))
    with torch.no_grad():
        # Boxes of three patches rather than of one, and objectness that differs.
        model.box_head.dense2.bias[2:] += 1.3
        model.objectness_head.dense2.weight *= 40
        model.objectness_head.dense2.bias.fill_(-2.0)
    model.save_pretrained(folder)
    Owlv2ImageProcessorPil(size={"height": VISION, "width": VISION}).save_pretrained(folder)
    return folder


def write_sam(folder: Path) -> Path:
    """A tiny SAM for pictures of 64² pixels."""
    from transformers import SamConfig, SamImageProcessorPil, SamModel

    config = SamConfig(
        vision_config={
            "hidden_size": 32, "output_channels": 16, "num_hidden_layers": 2, "num_attention_heads": 2,
            "image_size": VISION, "patch_size": 8, "window_size": 4, "global_attn_indexes": [1], "num_pos_feats": 8,
            "mlp_dim": 64,
        },
        prompt_encoder_config={"hidden_size": 16, "image_size": VISION, "patch_size": 8, "mask_input_channels": 4},
        mask_decoder_config={"hidden_size": 16, "mlp_dim": 32, "num_attention_heads": 2, "iou_head_hidden_dim": 16},
    )  # fmt: skip
    model = _seeded(lambda: SamModel(config))
    model.save_pretrained(folder)
    size = {"height": VISION, "width": VISION}
    SamImageProcessorPil(size={"longest_edge": VISION}, pad_size=size).save_pretrained(folder)
    return folder


def use_vit_tower(patch: pytest.MonkeyPatch) -> None:
    """Let PE-AV's vision tower be any class that transformers knows: timm's, the only one by default, needs timm."""
    from transformers import AutoConfig, PeVideoEncoderConfig
    from transformers.configuration_utils import SubConfigSpec

    spec = SubConfigSpec(config_class=AutoConfig, model_type="vit")
    patch.setattr(PeVideoEncoderConfig, "sub_configs_defaults", {"vision_config": spec})


def write_pe_av(folder: Path, tower: dict[str, Any] | None = None) -> Path:
    """A tiny PE-AV for pictures of 28² pixels; its vision tower is a ViT (`use_vit_tower`) unless another is given."""
    from transformers import PeAudioFeatureExtractor, PeAudioVideoConfig, PeAudioVideoModel

    width = {
        "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 2, "head_dim": 16,
    }  # fmt: skip
    vit = {
        "model_type": "vit", "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1,
        "num_attention_heads": 2, "image_size": SIDE, "patch_size": 14, "num_labels": 8,
    }  # fmt: skip
    dac = {"model_type": "dac", "encoder_hidden_size": 4, "downsampling_ratios": [2, 8, 10, 12], "codebook_dim": 8}
    config = PeAudioVideoConfig(
        text_config={
            "model_type": "modernbert", "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1,
            "num_attention_heads": 2, "vocab_size": 64, "pad_token_id": 0, "bos_token_id": 1, "eos_token_id": 2,
            "cls_token_id": 1, "sep_token_id": 2,
        },
        audio_video_config={
            **width,
            "model_type": "pe_audio_video_encoder",
            "audio_config": {**width, "model_type": "pe_audio_encoder", "dac_config": dac},
            "video_config": {**width, "model_type": "pe_video_encoder", "vision_config": tower or vit},
        },
    )  # fmt: skip
    model = _seeded(lambda: PeAudioVideoModel(config))
    with torch.no_grad():
        model.audio_video_logit_scale.fill_(1.0)
    model.save_pretrained(folder)
    PeAudioFeatureExtractor().save_pretrained(folder)
    still = {"size": {"height": SIDE, "width": SIDE}, "image_mean": [0.5] * 3, "image_std": [0.5] * 3, "resample": 2}
    (folder / "video_preprocessor_config.json").write_text(json.dumps(still))
    return folder


def _module(patch: pytest.MonkeyPatch, name: str, **members: Any) -> None:
    module = types.ModuleType(name)
    module.__dict__.update(members)
    patch.setitem(sys.modules, name, module)


def _packages(patch: pytest.MonkeyPatch, *names: str) -> None:
    for name in names:
        _module(patch, name, __path__=[])


class _Pairs:
    """`denseav.aggregators.BaseAggregator`: similarities of B pictures with their B clips, head by head."""

    def __init__(self, heads: int) -> None:
        self.heads = heads

    def get_pairwise_sims(self, preds: dict[str, Any], raw: bool, agg_sim: bool, agg_heads: bool) -> Any:
        assert not raw
        assert not agg_sim
        assert not agg_heads
        sound = preds["audio_feats"].unflatten(1, (self.heads, -1))
        picture = preds["image_feats"].unflatten(1, (self.heads, -1))
        return torch.einsum("bkcft,bkchw,bt->bkhwft", sound, picture, preds["audio_mask"].float())


class TinyAligner(nn.Module):
    """`denseav.train.LitAVAligner` with two convolutions: its methods, its shapes, its checkpoint file."""

    def __init__(self, code_dim: int, sim_agg_heads: int, loss_leak: float, use_cached_embs: bool) -> None:
        super().__init__()
        assert not use_cached_embs
        self.image_model = nn.Conv2d(3, code_dim, 8, stride=8)
        self.audio_model = nn.Conv1d(1, code_dim, 400, stride=320)
        self.sim_agg = _Pairs(sim_agg_heads)

    @classmethod
    def load_from_checkpoint(cls, path: str, map_location: str, strict: bool, **changes: Any) -> TinyAligner:
        data = torch.load(path, map_location=map_location, weights_only=True)
        model = cls(**{**data["hyper_parameters"], **changes})
        model.load_state_dict(data["state_dict"], strict=strict)
        return model

    def set_full_train(self, full_train: bool) -> None:
        self.full_train = full_train

    def forward_audio(self, batch: dict[str, Any]) -> dict[str, Any]:
        assert self.full_train
        features = self.audio_model(batch["audio"][:, None])[:, :, None]
        return {"audio_feats": features, "audio_mask": torch.ones(len(features), features.shape[-1], dtype=torch.bool)}

    def forward_image(self, batch: dict[str, Any], max_batch_size: int | None = None) -> dict[str, Any]:
        return {"image_feats": self.image_model(batch["frames"].flatten(0, 1))}


def install_denseav(patch: pytest.MonkeyPatch) -> None:
    """A package `denseav` whose network is `TinyAligner`."""
    _packages(patch, "denseav")
    _module(patch, "denseav.train", LitAVAligner=TinyAligner)


def write_denseav(folder: Path, *, redness: bool = True) -> Path:
    """A Lightning checkpoint of `TinyAligner` with two heads.

    With ``redness`` the similarity of a patch is how much redder than blue it is, whatever the clip; the second head
    gives nothing. Otherwise weights are random.
    """
    hyper = {"code_dim": 4, "sim_agg_heads": 2, "loss_leak": 0.1, "use_cached_embs": False}
    model = _seeded(lambda: TinyAligner(**hyper))
    if redness:
        with torch.no_grad():
            for weights in model.parameters():
                weights.zero_()
            model.image_model.weight[0, 0] = 1 / 64
            model.image_model.weight[0, 2] = -1 / 64
            model.audio_model.bias[0] = 1.0
    folder.mkdir(parents=True, exist_ok=True)
    torch.save({"hyper_parameters": hyper, "state_dict": model.state_dict()}, folder / "denseav_sound.ckpt")
    return folder


class TinyImageBind(nn.Module):
    """`imagebind.models.imagebind_model.ImageBindModel`: a linear layer for each sense, lengths and scale as there."""

    def __init__(self) -> None:
        super().__init__()
        self.vision = nn.Linear(3 * 224 * 224, 8, bias=False)
        self.audio = nn.Linear(128 * 204, 8, bias=False)

    def forward(self, inputs: dict[str, Any]) -> dict[str, Any]:
        out = {}
        for sense, values in inputs.items():
            clips = values.flatten(0, 1) if values.ndim >= 5 else values
            scale = 20.0 if sense == "audio" else 1.0
            found = scale * nn.functional.normalize(getattr(self, sense)(clips.flatten(1)), dim=-1)
            out[sense] = found.unflatten(0, values.shape[:2]).mean(1) if values.ndim >= 5 else found
        return out


def _mel(waveform: Any, sample_rate: int, num_mel_bins: int, target_length: int) -> Any:
    """`imagebind.data.waveform2melspec` in shape, and like it in that it changes what it is given."""
    waveform -= waveform.mean()
    assert waveform.shape == (1, 2 * sample_rate)
    frames = waveform[0].unfold(0, num_mel_bins * 2, sample_rate // 102)[:target_length]
    power = torch.fft.rfft(frames)[:, :num_mel_bins].abs().add(1e-6).log().T
    return nn.functional.pad(power, (0, target_length - power.shape[1]))[None]


def install_imagebind(patch: pytest.MonkeyPatch) -> None:
    """A package `imagebind` whose network is `TinyImageBind`."""

    def imagebind_huge(pretrained: bool) -> TinyImageBind:
        assert not pretrained, "the package would download its weights"
        return TinyImageBind()

    senses = types.SimpleNamespace(VISION="vision", AUDIO="audio")
    _packages(patch, "imagebind", "imagebind.models")
    _module(patch, "imagebind.data", waveform2melspec=_mel)
    _module(patch, "imagebind.models.imagebind_model", imagebind_huge=imagebind_huge, ModalityType=senses)


def write_imagebind(folder: Path) -> Path:
    """The weights of a `TinyImageBind`."""
    folder.mkdir(parents=True, exist_ok=True)
    torch.save(_seeded(TinyImageBind).state_dict(), folder / "imagebind_huge.pth")
    return folder


class TinyDetector(nn.Module):
    """MDef-DETR's two calls: pictures and captions to a cache, the cache to boxes; here boxes are weights."""

    def __init__(self) -> None:
        super().__init__()
        self.boxes = nn.Parameter(torch.zeros(3, 4))
        self.logits = nn.Parameter(torch.zeros(3, 256))

    def forward(self, pixels: Any, captions: list[str], encode_and_save: bool, memory_cache: Any = None) -> Any:
        assert pixels.shape[1] == 3
        assert min(pixels.shape[2:]) == 800
        assert captions == ["all objects"]
        if encode_and_save:
            return {"memory": True}
        assert memory_cache == {"memory": True}
        return {"pred_boxes": self.boxes[None], "pred_logits": self.logits[None]}


def install_mavl(patch: pytest.MonkeyPatch) -> None:
    """The module `models.model` of the MAVL repository with a `TinyDetector`."""

    class Model:
        def __init__(self, name: str, checkpoints_path: str) -> None:
            assert name == "mdef_detr"
            self.network = TinyDetector()
            self.network.load_state_dict(torch.load(checkpoints_path, map_location="cpu", weights_only=True)["model"])

        def get_model(self) -> Any:
            return types.SimpleNamespace(model=self.network)

    _packages(patch, "models")
    _module(patch, "models.model", Model=Model)


def write_mavl(folder: Path) -> Path:
    """Weights of a `TinyDetector`: a copy of its first box, and a box around everything, come second and third."""
    model = TinyDetector()
    with torch.no_grad():
        model.boxes.copy_(torch.tensor([[0.5, 0.25, 0.2, 0.1], [0.5, 0.26, 0.2, 0.1], [0.5, 0.5, 1.0, 1.0]]))
        # The last class is "no object": a score of 0.9, 0.8 and 0.7.
        model.logits[:, :-1] = -100.0
        model.logits[:, 0] = torch.tensor([0.9, 0.8, 0.7]).log()
        model.logits[:, -1] = torch.tensor([0.1, 0.2, 0.3]).log()
    folder.mkdir(parents=True, exist_ok=True)
    torch.save({"model": model.state_dict()}, folder / "MDef_DETR_r101_epoch20_ore.pth")
    return folder
