"""A listener small enough for tests, untrained."""

from __future__ import annotations

from pathlib import Path

import torch

from baselines.listener import weights
from baselines.listener.model import Listener, Widths

SMALL = Widths(
    image=(8, 8, 16, 16, 16), blocks=(0, 1, 1, 1, 1), decoder=(16, 16, 8, 8), audio=(8, 8, 16, 16), attention=1
)


def write_weights(folder: Path) -> Path:
    """The file of weights of an untrained network, always the same ones."""
    path = folder / "listener.safetensors"
    torch.manual_seed(0)
    weights.save_weights(Listener(SMALL), path)
    return path
