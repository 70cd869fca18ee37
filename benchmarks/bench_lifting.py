"""Lifting, decomposition and AISRM for 300,000 Gaussians and 105 views of 1008²."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch

from avs3d_bench.geometry import Intrinsics
from baselines.echosegnet import aisrm, lift
from baselines.echosegnet.decompose import decompose
from baselines.echosegnet.gaussians import Gaussians

COUNT, VIEWS, SIZE = 300_000, 105, 1008
#: Share of the Gaussians that belong to objects of the category.
_OBJECTS = 0.1


def example(seed: int = 0) -> tuple[Gaussians, list[Any], list[np.ndarray], np.ndarray]:
    """A room of Gaussians with three objects, a path past them, true masks, and clips."""
    rng = np.random.default_rng(seed)
    room = rng.uniform((-3, -2.5, -3), (3, 0, 3), (COUNT, 3))
    centres = np.array([[-1.2, -1.0, 2.5], [0.0, -1.0, 2.6], [1.3, -1.0, 2.5]])
    inside = rng.random(COUNT) < _OBJECTS
    room[inside] = centres[rng.integers(0, 3, inside.sum())] + rng.uniform(-0.2, 0.2, (inside.sum(), 3))
    gaussians = Gaussians(
        torch.as_tensor(room, dtype=torch.float32),
        torch.as_tensor(np.log(rng.uniform(0.003, 0.03, (COUNT, 3))), dtype=torch.float32),
        torch.as_tensor(rng.normal(size=(COUNT, 4)), dtype=torch.float32),
        torch.zeros(COUNT),
        torch.zeros(COUNT, 1, 3),
    )
    views, masks, clips = [], [], []
    for x in np.linspace(-1.5, 1.5, VIEWS):
        view = SimpleNamespace(
            name=f"{x:.2f}", camera=Intrinsics.from_fov(SIZE), rotation=np.eye(3), position=np.array([x, -1.5, 0.0])
        )
        mask = np.zeros((SIZE, SIZE), np.bool_)
        for centre in centres:
            column, row, _ = lift.pixels_of(centre[None], view)
            mask[max(0, row[0] - 40) : row[0] + 40, max(0, column[0] - 40) : column[0] + 40] = True
        views.append(view)
        masks.append(mask)
        side = np.array([[1.0 - 0.1 * x], [1.0 + 0.1 * x]])
        clips.append((side * rng.normal(0, 0.1, (1, 44_100))).astype(np.float32))
    return gaussians, views, masks, np.stack(clips)


def seconds(parts: tuple[Gaussians, list[Any], list[np.ndarray], np.ndarray]) -> float:
    """Seconds of the three stages together."""
    gaussians, views, masks, clips = parts
    start = time.perf_counter()
    means = gaussians.means.numpy().astype(np.float64)
    inside, total = lift.vote_counts(means, zip(views, masks, strict=True))
    labelled = inside > 0.3 * np.maximum(total, 1)
    part = gaussians.select(torch.as_tensor(labelled))
    intensity = aisrm.audio_intensity_map(views, clips, means)
    centre = aisrm.audio_centre(means, intensity)
    if centre is not None:
        part = part.select(torch.as_tensor(aisrm.refine(part.means.numpy(), centre).staying))
    decompose(part, views, masks)
    return time.perf_counter() - start


def run_all(repeats: int = 5) -> dict[str, float]:
    """Figures for `make bench`."""
    parts = example()
    return {
        "lifting + decomposition + AISRM, 300k × 105 (s)": float(np.median([seconds(parts) for _ in range(repeats)]))
    }
