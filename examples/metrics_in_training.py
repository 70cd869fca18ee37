"""Figures of masks in a training loop: one accumulator an epoch, the same figures for any batch size and order.

    python examples/metrics_in_training.py --epochs 5

The data are made up on the spot: a bright square that moves over a noisy picture, in clips of five frames, of which
some show no square. The metrics need numpy and OpenCV alone; torch is the training's.
"""

import argparse

import torch
from torch import nn
from torch.nn import functional

from evaluators import metrics

SIDE, FRAMES = 32, 5


def clips(count: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Pictures (B, T, 1, H, W) in [0, 1] and their true masks (B, T, H, W)."""
    random = torch.Generator().manual_seed(seed)
    masks = torch.zeros(count, FRAMES, SIDE, SIDE, dtype=torch.bool)
    for clip in masks[::2]:
        row, column = torch.randint(0, SIDE - 8 - FRAMES, (2,), generator=random).tolist()
        for time, frame in enumerate(clip):
            frame[row : row + 8, column + time : column + time + 8] = True
    noise = torch.rand(masks.shape, generator=random)
    return (0.4 * masks + 0.6 * noise)[:, :, None], masks


def validate(network: nn.Module, pictures: torch.Tensor, masks: torch.Tensor) -> dict[str, float | None]:
    """This toolkit's figures, two clips at a time."""
    figures = metrics.Accumulator()
    with torch.inference_mode():
        for some, truth in zip(pictures.split(2), masks.split(2), strict=True):
            logits = network(some.flatten(0, 1)).view(truth.shape)
            figures.update(truth, logits.sigmoid())  # clips: (B, T, H, W); tensors of any device
    return figures.compute()


def main() -> None:
    """Train, print the figures of each epoch, and those of AVSBench's code at the end."""
    parser = argparse.ArgumentParser(description="Metrics in a training loop.")
    parser.add_argument("--epochs", type=int, default=5)
    options = parser.parse_args()
    torch.manual_seed(0)
    network = nn.Sequential(nn.Conv2d(1, 8, 7, padding=3), nn.ReLU(), nn.Conv2d(8, 1, 7, padding=3))
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
    pictures, masks = clips(32, seed=1)
    held_out = clips(8, seed=2)
    for epoch in range(1, options.epochs + 1):
        for some, truth in zip(pictures.split(2), masks.split(2), strict=True):
            logits = network(some.flatten(0, 1)).view(truth.shape)
            # The square covers a small share of the picture, so its pixels have a larger weight.
            weight = torch.tensor(5.0)
            loss = functional.binary_cross_entropy_with_logits(logits, truth.float(), pos_weight=weight)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
        found = validate(network, *held_out)
        names = ("IoU", "AP", "FP_rate", "temporal_consistency")
        print(f"epoch {epoch}: " + ", ".join(f"{name} {found[name]:.3f}" for name in names))
    with torch.inference_mode():
        logits = network(held_out[0].flatten(0, 1))[:, 0]
    truth = held_out[1].flatten(0, 1)
    for clips_per_batch in (1, 4):
        released = metrics.avsbench.evaluate(truth, logits, clips_per_batch=clips_per_batch)
        print(f"AVSBench's F with batches of {clips_per_batch}: {released['F']:.4f}")
    print(f"the same without batches: {metrics.avsbench.order_free(truth, logits)['F']:.4f}")


if __name__ == "__main__":
    main()
