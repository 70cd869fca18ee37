"""What several looks at a picture bring the listener: IoU and false marks for combinations of looks.

    python -m benchmarks.listener_looks ROOT [ROOT …] [--every N] [--threshold P]

Every N-th frame of each observation is looked at. IoU is the mean over frames in which the truth is visible, ``right``
the share of them with IoU > .5, ``false`` the share of the other frames in which something is marked; all are means
over observations. `baselines.listener.predict.LOOKS` was chosen by such figures, in homes of no test set.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from avs3d_bench.dataset import Dataset, Frame
from baselines.listener.losses import RIGHT_IOU
from baselines.listener.masks import Answer, agreed
from baselines.listener.predict import THRESHOLD, ListenerMethod, Look, camera_of, clip_of, load_method
from baselines.listener.shards import SIDE
from baselines.networks.device import inference

SINGLE = {
    f"{side}²{', mirrored' if mirrored else ''}": Look(side, mirrored)
    for side in (SIDE, 2 * SIDE)
    for mirrored in (False, True)
}
_FIRST, _FIRST_MIRRORED, _SECOND, _SECOND_MIRRORED = SINGLE
COMBINATIONS = (
    (_FIRST,), (_FIRST, _FIRST_MIRRORED), (_SECOND,), (_SECOND, _SECOND_MIRRORED), (_FIRST, _SECOND), tuple(SINGLE),
)  # fmt: skip


def answers(model: ListenerMethod, frame: Frame) -> dict[str, Answer]:
    """The answer of each single look."""
    picture, sound, camera = frame.rgb(), clip_of(frame)[None], np.asarray([camera_of(frame)], np.float32)
    with inference(model.device, frame.name):
        return {name: model.look(look, [picture], sound, camera)[0] for name, look in SINGLE.items()}


def figures(model: ListenerMethod, frames: Sequence[Frame]) -> Iterator[tuple[tuple[str, ...], str, float]]:
    """Combination, name and value of the figures of one observation."""
    found: dict[tuple[tuple[str, ...], str], list[float]] = defaultdict(list)
    for frame in frames:
        picture, truth, single = frame.rgb(), frame.mask(), answers(model, frame)
        for names in COMBINATIONS:
            mask = model.mask(agreed([single[name] for name in names]), picture)
            if truth.any():
                iou = float((mask & truth).sum() / (mask | truth).sum())
                found[names, "IoU"].append(iou)
                found[names, "right"].append(iou > RIGHT_IOU)
            else:
                found[names, "false"].append(bool(mask.any()))
    for (names, figure), values in found.items():
        yield names, figure, float(np.mean(values))


def table(model: ListenerMethod, dataset: Dataset, every: int) -> dict[tuple[str, ...], dict[str, float]]:
    """Combination → figures, means over observations."""
    found: dict[tuple[str, ...], dict[str, list[float]]] = {names: defaultdict(list) for names in COMBINATIONS}
    for observation in dataset:
        for names, figure, value in figures(model, observation.frames[every // 2 :: every]):
            found[names][figure].append(value)
    return {names: {name: float(np.mean(values)) for name, values in each.items()} for names, each in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("roots", type=Path, nargs="+", metavar="ROOT")
    parser.add_argument("--every", type=int, default=4, help="look at every N-th frame [4]")
    parser.add_argument("--threshold", type=float, default=THRESHOLD)
    parser.add_argument("--weights", type=Path, help="[those of the package]")
    parser.add_argument("--device", help="[a GPU where there is one]")
    chosen: Any = parser.parse_args()
    model = replace(load_method(chosen.weights, device=chosen.device), threshold=chosen.threshold)
    for root in chosen.roots:
        print(f"{root}\n{'looks':44} {'IoU':>6} {'right':>6} {'false':>6}")
        for names, found in table(model, Dataset(root), chosen.every).items():
            values = " ".join(
                f"{found[name]:6.3f}" if name in found else f"{'-':>6}" for name in ("IoU", "right", "false")
            )
            print(f"{' + '.join(names):44} {values}", flush=True)


if __name__ == "__main__":
    main()
