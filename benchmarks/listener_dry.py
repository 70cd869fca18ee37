"""Excerpts of the voices for training, by which training frames are dubbed (`avs3d train listener --dry FILE`).

    python -m benchmarks.listener_dry -o FILE [--units N]

Of each unit of each voice there are excerpts of two seconds, in whose second half it sounds. A frame of the training
data has one of some hundred units of a category; here there are as many as are asked for.
"""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.runtime.parallel import process_each
from baselines.listener.dry import EXCERPT, write_dry
from generators.assets.sounds import synthesise, voices

#: Seconds of a unit, and of the root mean square of its loudest second that a second must have to count as sounding.
SECONDS, SOUNDING = 8, 0.05


def excerpts(task: tuple[int, str, int]) -> NDArray[np.float16]:
    """(n, EXCERPT) of a unit of a voice: (number of the category, name of the voice, number of the unit)."""
    category, voice, unit = task
    # Entropy of its own: training, validation and tests draw other units.
    rng = np.random.default_rng([36, category, unit, *voice.encode()])
    signal = np.asarray(synthesise(CATEGORIES[category], SECONDS, rng, voice))
    pairs = signal.reshape(-1, EXCERPT)
    levels = np.sqrt(np.mean(np.square(pairs[:, SAMPLE_RATE:]), axis=1))
    return np.asarray(pairs[levels > SOUNDING * levels.max()], np.float16)


@click.command(help=(__doc__ or "").splitlines()[0])
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), required=True, help="NPZ")
@click.option("--units", type=click.IntRange(1), default=40, show_default=True, help="Of each voice for training.")
@click.option("--workers", type=click.IntRange(1), default=None, help="Processes [one per core].")
def main(output: Path, units: int, workers: int | None) -> None:
    """The command."""
    tasks = [
        (number, voice.name, unit)
        for number, category in enumerate(CATEGORIES)
        for voice in voices(category)
        if voice.split == "train"
        for unit in range(units)
    ]
    found = dict(process_each(excerpts, tasks, workers=workers, label="units of voices"))
    samples = np.concatenate([found[task] for task in tasks])
    write_dry(output, samples, [task[0] for task in tasks for _ in found[task]])
    click.echo(f"{output}: {len(samples)} excerpts of {len(tasks)} units")


if __name__ == "__main__":
    main()
