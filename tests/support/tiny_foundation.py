"""Checkpoints of tiny foundation models of the real classes, with random weights, as `save_pretrained` writes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from tests.support.tiny_models import _seeded

#: Words of the tiny tokenizers; others are unknown.
WORDS = (
    "this", "is", "a", "sound", "of", "washing", "machine", "toilet", "vacuum", "cleaner", "microwave", "coffee",
    "clock", "telephone", "silence", "speech", "music",
)  # fmt: skip


def _write_tokenizer(folder: Path, kind: Any, special: tuple[str, ...], **tokens: Any) -> None:
    """A tokenizer of whole words, of a class of transformers, with special tokens first."""
    from tokenizers import Tokenizer, models, pre_tokenizers, processors

    known = {word: number for number, word in enumerate([*special, ".", *WORDS])}
    made = Tokenizer(models.WordLevel(known, unk_token=tokens["unk_token"]))
    made.pre_tokenizer = pre_tokenizers.Whitespace()
    first, last = tokens["first"], tokens["last"]
    made.post_processor = processors.TemplateProcessing(
        single=f"{first} $A {last}", special_tokens=[(one, known[one]) for one in (first, last)]
    )
    rest = {name: value for name, value in tokens.items() if name not in ("first", "last")}
    kind(tokenizer_object=made, **rest).save_pretrained(folder)


def write_clap(folder: Path) -> Path:
    """A tiny CLAP."""
    from transformers import ClapConfig, ClapFeatureExtractor, ClapModel, PreTrainedTokenizerFast

    config = ClapConfig(
        text_config={
            "vocab_size": 32, "hidden_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2,
            "intermediate_size": 32, "max_position_embeddings": 40, "projection_dim": 16,
        },
        audio_config={
            "hidden_size": 32, "patch_embeds_hidden_size": 16, "depths": [1, 1], "num_attention_heads": [2, 2],
            "num_hidden_layers": 2, "projection_dim": 16, "num_classes": 4,
        },
        projection_dim=16,
    )  # fmt: skip
    _seeded(lambda: ClapModel(config)).save_pretrained(folder)
    ClapFeatureExtractor(truncation="rand_trunc").save_pretrained(folder)
    special = ("<s>", "<pad>", "</s>", "<unk>")
    _write_tokenizer(
        folder, PreTrainedTokenizerFast, special, unk_token="<unk>", pad_token="<pad>", first="<s>", last="</s>"
    )
    return folder


def write_sam3(folder: Path) -> Path:
    """A tiny SAM 3 for pictures of 56² pixels."""
    from transformers import PreTrainedTokenizerFast, Sam3Config, Sam3Model

    parts = {"hidden_size": 16, "num_layers": 1, "num_attention_heads": 2, "intermediate_size": 32}
    config = Sam3Config(
        vision_config={
            "fpn_hidden_size": 16, "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
            "backbone_config": {
                "model_type": "sam3_vit_model", "hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2,
                "num_attention_heads": 2, "image_size": 56, "pretrain_image_size": 28, "patch_size": 14,
                "window_size": 2, "global_attn_indexes": [1],
            },
        },
        text_config={
            "model_type": "clip_text_model", "vocab_size": 32, "hidden_size": 16, "intermediate_size": 32,
            "projection_dim": 16, "num_hidden_layers": 1, "num_attention_heads": 2, "max_position_embeddings": 8,
            "bos_token_id": 0, "eos_token_id": 1, "pad_token_id": 1,
        },
        geometry_encoder_config=parts,
        detr_encoder_config=parts,
        detr_decoder_config={**parts, "num_queries": 6},
        mask_decoder_config={"hidden_size": 16, "num_attention_heads": 2},
    )  # fmt: skip
    model = _seeded(lambda: Sam3Model(config))
    with torch.no_grad():
        # Texts are there, and some of the queries are instances of them, of different masks.
        model.detr_decoder.presence_head.layer3.bias.fill_(6.0)
        model.dot_product_scoring.query_proj.weight *= 40
        for part in model.mask_decoder.parameters():
            part *= 4
    model.save_pretrained(folder)
    special = ("<s>", "</s>", "<unk>")
    _write_tokenizer(
        folder, PreTrainedTokenizerFast, special, unk_token="<unk>", pad_token="</s>", first="<s>", last="</s>"
    )
    return folder


def write_grounding_dino(folder: Path) -> Path:
    """A tiny Grounding DINO."""
    from transformers import (
        GroundingDinoConfig,
        GroundingDinoForObjectDetection,
        GroundingDinoImageProcessorPil,
        PreTrainedTokenizerFast,
    )

    config = GroundingDinoConfig(
        backbone_config={
            "model_type": "swin", "image_size": 64, "patch_size": 4, "embed_dim": 8, "depths": [1, 1, 1, 1],
            "num_heads": [1, 1, 2, 2], "window_size": 2, "out_indices": [2, 3, 4],
        },
        text_config={
            "model_type": "bert", "vocab_size": 32, "hidden_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2,
            "intermediate_size": 32,
        },
        num_queries=6, encoder_layers=1, decoder_layers=2, encoder_ffn_dim=32, decoder_ffn_dim=32, d_model=64,
        encoder_attention_heads=2, decoder_attention_heads=2, encoder_n_points=2, decoder_n_points=2,
    )  # fmt: skip
    _seeded(lambda: GroundingDinoForObjectDetection(config)).save_pretrained(folder)
    GroundingDinoImageProcessorPil(size={"shortest_edge": 64, "longest_edge": 64}).save_pretrained(folder)
    special = ("[PAD]", "[CLS]", "[SEP]", "[UNK]")
    _write_tokenizer(
        folder, PreTrainedTokenizerFast, special, unk_token="[UNK]", pad_token="[PAD]", first="[CLS]", last="[SEP]"
    )
    return folder


def write_sam2(folder: Path) -> Path:
    """A tiny SAM 2 for pictures of 64² pixels."""
    from transformers import Sam2Config, Sam2Model

    config = Sam2Config(
        vision_config={
            "backbone_config": {
                "model_type": "sam2_hiera_det_model", "hidden_size": 8, "image_size": [64, 64],
                "blocks_per_stage": [1, 1, 2, 1], "embed_dim_per_stage": [8, 16, 32, 64],
                "num_attention_heads_per_stage": [1, 2, 2, 2], "window_size_per_stage": [4, 4, 4, 4],
                "global_attention_blocks": [3], "window_positional_embedding_background_size": [4, 4],
            },
            "backbone_channel_list": [64, 32, 16, 8], "fpn_hidden_size": 16,
            "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
        },
        prompt_encoder_config={"hidden_size": 16, "image_size": 64, "mask_input_channels": 4},
        mask_decoder_config={"hidden_size": 16, "mlp_dim": 32, "num_attention_heads": 2, "iou_head_hidden_dim": 16},
    )  # fmt: skip
    _seeded(lambda: Sam2Model(config)).save_pretrained(folder)
    return folder
