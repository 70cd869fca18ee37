"""`python -m benchmarks.listener_classes DATASET … -o FILE.json`: what the network sees, and what it is sure of.

Of the test frames, before any threshold is chosen by them:

- the IoU of the class map of each category, over all pixels of all frames together, where a class is more probable than
  any other (the network's picture alone);
- the expected calibration error of the mask above a probability of .1 (`calibration.OddsHistogram`), with the
  temperature of the weights;
- the average precision of the soft mask, a mean over the frames that show what sounds: no threshold takes part.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.formats.files import write_json
from evaluators.metrics.soft import average_precision


@dataclass
class ClassFigures:
    """Sums over frames.

    Attributes:
        union, overlap: (categories,) pixels.
        precision: average precision of each frame that shows what sounds.
    """

    union: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(CATEGORIES), np.int64))
    overlap: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(CATEGORIES), np.int64))
    precision: list[float] = field(default_factory=list)

    def add(self, classes: NDArray[np.float32], probability: NDArray[np.float32], frame: Frame) -> None:
        """Count a frame.

        Args:
            classes: (8, h, w) probabilities.
            probability: (H, W) of the mask.
            frame: with its truth.
        """
        ids = frame.instance_ids()
        size = ids.shape[::-1]
        seen = np.stack([cv2.resize(each, size, interpolation=cv2.INTER_LINEAR) for each in classes]).argmax(axis=0)
        record = frame.observation.record
        assert record is not None
        for number, category in enumerate(CATEGORIES):
            truth = np.isin(ids, [one.id for one in record.instances if one.category == category])
            self.union[number] += int((truth | (seen == 1 + number)).sum())
            self.overlap[number] += int((truth & (seen == 1 + number)).sum())
        if frame.mask().any():
            self.precision.append(average_precision(frame.mask(), probability))

    def summary(self) -> dict[str, Any]:
        """IoU by category, and the mean average precision; None where there is nothing to see."""
        shares = {
            name: round(float(self.overlap[number] / self.union[number]), 4) if self.union[number] else None
            for number, name in enumerate(CATEGORIES)
        }
        mean = round(float(np.mean(self.precision)), 4) if self.precision else None
        return {"class_iou": shares, "average_precision": mean, "frames_with_sound_in_view": len(self.precision)}


def figures(dataset: Dataset, method: Any, only: Iterable[str] = ()) -> dict[str, Any]:
    """The figures of a dataset with truth.

    Args:
        dataset: folders, not shards.
        method: of `baselines.listener.predict.load_method`.
        only: shell patterns of observation keys.
    """
    import torch
    from scipy.special import expit

    from baselines.listener.calibration import OddsHistogram

    found, odds = ClassFigures(), OddsHistogram.empty("cpu")
    frames = 0
    for observation in dataset.select(*only):
        for frame, answer in zip(observation.test, method.seen(observation.test), strict=True):
            truth = frame.mask()
            large = cv2.resize(answer.mask, truth.shape[::-1], interpolation=cv2.INTER_LINEAR)
            odds.add(torch.from_numpy(large), torch.from_numpy(truth.astype(np.float32)))
            found.add(answer.classes, np.asarray(expit(large), np.float32), frame)
            frames += 1
    return {"frames": frames, "calibration_error": odds.error(), **found.summary()}


@click.command()
@click.argument("datasets", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
@click.option("--weights", type=click.Path(path_type=Path), default=None, help="Of the listener [the package's].")
@click.option("--device", default=None, help="cpu, cuda:0, … [CUDA where there is one].")
@click.option("--only", multiple=True, help="Shell pattern of observation keys; repeatable [all].")
def main(
    datasets: tuple[Path, ...], output: Path, weights: Path | None, device: str | None, only: tuple[str, ...]
) -> None:
    """Write IoU by category, calibration error and average precision of datasets."""
    from baselines.listener.predict import load_method

    method = load_method(weights, device=device)
    found = {path.name: figures(Dataset(path), method, only) for path in datasets}
    write_json(output, {"weights": method.digest, "datasets": found})
    for name, each in found.items():
        click.echo(f"{name}: {each}")


if __name__ == "__main__":
    main()
