"""The threshold of the listener's masks: figures over the validation homes of a training run for several of them.

    python -m benchmarks.listener_thresholds runs/listener

The constants `baselines.listener.predict.THRESHOLD` (of what sounds: iou, fp_rate, pair_accuracy) and
`baselines.listener.marks.CATEGORY_THRESHOLD` (category_iou) are chosen from this table.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from baselines.listener.augment import Bank
from baselines.listener.card import WEIGHTS
from baselines.listener.job import TrainingOptions, make_fabric
from baselines.listener.shards import open_store
from baselines.listener.training import CACHE
from baselines.listener.validation import validate
from baselines.listener.weights import load_listener

THRESHOLDS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
COLUMNS = ("iou", "fp_rate", "pair_accuracy", "category_iou")


def table(folder: Path, weights: Path | None = None) -> list[dict[str, Any]]:
    """One row for each threshold."""
    store = open_store(folder / CACHE)
    if store is None:
        raise SystemExit(f"{folder / CACHE}: no frames; expected the folder of a run of `avs3d train listener`")
    fabric = make_fabric(TrainingOptions(data=folder, folder=folder, epochs=1), "32-true")
    network, _ = load_listener(weights or folder / WEIGHTS, device=fabric.device)
    found = validate(network, store, Bank(store, fabric.device), fabric, THRESHOLDS)
    return [{"threshold": threshold, **row} for threshold, row in zip(THRESHOLDS, found, strict=True)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of the run")
    parser.add_argument("--weights", type=Path, help="[those of the run]")
    chosen = parser.parse_args()
    print("threshold  " + "  ".join(f"{name:>13}" for name in COLUMNS))
    for row in table(chosen.folder, chosen.weights):
        values = ("-" if row[name] is None else f"{row[name]:.3f}" for name in COLUMNS)
        print(f"{row['threshold']:9.2f}  " + "  ".join(f"{value:>13}" for value in values), flush=True)


if __name__ == "__main__":
    main()
