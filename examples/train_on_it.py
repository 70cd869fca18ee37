"""Train a small network on the train frames of a dataset and write its masks of the test frames as a submission.

    python examples/train_on_it.py data/demo trained --steps 20

It shows how to use the data, not a good method: pictures of 64 × 64 pixels, one number for the sound, a few steps on
the CPU.
"""

import argparse

import torch
from torch import nn
from torch.nn import functional
from torch.utils.data import DataLoader

from avs3d_bench.dataset import Dataset
from avs3d_bench.exports import AVS3DDataset
from avs3d_bench.submission import SubmissionWriter

SIDE = 64


class Network(nn.Module):
    """Picture (B, 3, 64, 64) and level difference (B,) in dB to logits (B, 64, 64)."""

    def __init__(self) -> None:
        super().__init__()
        # Three colours, the level difference, and the column, so that the network can relate sound and direction.
        self.layers = nn.Sequential(
            nn.Conv2d(5, 16, 5, padding=2), nn.ReLU(), nn.Conv2d(16, 16, 5, padding=2), nn.ReLU(), nn.Conv2d(16, 1, 1)
        )

    def forward(self, rgb: torch.Tensor, difference: torch.Tensor) -> torch.Tensor:
        """Logits (B, 64, 64); see the class."""
        heard = (difference / 10)[:, None, None, None].expand(-1, 1, SIDE, SIDE)
        column = torch.linspace(-1, 1, SIDE).expand(len(rgb), 1, SIDE, SIDE)
        return self.layers(torch.cat([rgb, heard, column], dim=1))[:, 0]


def small(item: dict) -> dict:
    """The network's inputs from one frame; runs in the loader's workers."""
    rgb = functional.interpolate(item["rgb"][None].float() / 255, (SIDE, SIDE), mode="area")[0]
    mask = functional.interpolate(item["mask"][None, None].float(), (SIDE, SIDE), mode="area")[0, 0]
    left, right = item["binaural"].square().mean(dim=1) + 1e-12
    return {"rgb": rgb, "mask": mask, "difference": 10 * torch.log10(right / left), "size": item["mask"].shape}


def train(root: str, steps: int) -> tuple[Network, list[float]]:
    """The network after training with Adam, and the loss of each step."""
    torch.manual_seed(0)
    network, losses = Network(), []
    optimiser = torch.optim.Adam(network.parameters(), lr=3e-3)
    frames = AVS3DDataset(root, split="train", transform=small)
    loader = DataLoader(frames, batch_size=8, shuffle=True, generator=torch.Generator().manual_seed(0))
    while len(losses) < steps:
        for batch in loader:
            logits = network(batch["rgb"], batch["difference"])
            # The object covers a small share of the picture, so its pixels have a larger weight.
            weight = torch.tensor(10.0)
            loss = functional.binary_cross_entropy_with_logits(logits, batch["mask"], pos_weight=weight)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            losses.append(loss.item())
            if len(losses) == steps:
                break
    return network, losses


@torch.inference_mode()
def predict(network: Network, root: str, path: str) -> None:
    """Write the masks of the test frames."""
    frames = AVS3DDataset(root, split="test", transform=small)
    dataset = Dataset(root)
    with SubmissionWriter(path, dataset, method="small network", overwrite=True) as submission:
        for number in range(len(frames)):
            ((key, name, _),) = frames.locate(number)
            item = frames[number]
            logits = network(item["rgb"][None], item["difference"][None])
            large = functional.interpolate(logits[None], tuple(item["size"]), mode="bilinear")[0, 0]
            frame = next(frame for frame in dataset[key].test if frame.name == name)
            submission.write_mask(frame, (large > 0).numpy())


def main() -> None:
    """Train, print the loss, write the submission."""
    parser = argparse.ArgumentParser(description="Train a small network.")
    parser.add_argument("dataset", help="root of the dataset")
    parser.add_argument("submission", help="folder to write")
    parser.add_argument("--steps", type=int, default=100)
    options = parser.parse_args()
    network, losses = train(options.dataset, options.steps)
    print(f"loss {losses[0]:.3f} → {losses[-1]:.3f} in {len(losses)} steps")
    predict(network, options.dataset, options.submission)
    print(f"{options.submission}: score it with avs3d-eval {options.submission} --dataset {options.dataset}")


if __name__ == "__main__":
    main()
