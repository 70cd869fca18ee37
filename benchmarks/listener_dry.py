"""Excerpts of what may be learnt from, by which training frames are dubbed (`avs3d train listener --dry FILE`).

    python -m benchmarks.listener_dry -o FILE [--units N] [--recorded N]

Of each unit of each voice for training there are excerpts of two seconds, in whose second half it sounds. A frame of
the training data has one of some hundred units of a category; here there are as many as are asked for. Of the
recordings for training that are in the store there are excerpts from random places, a little faster or slower.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.parallel import process_each
from baselines.listener.dry import EXCERPT, write_dry
from benchmarks.recorded_manifests import MANIFESTS
from generators.assets.sounds import synthesise, voices
from generators.assets.sounds.recordings import load_sound, recorded_seconds, resampled
from generators.library.lock import LOCK_NAME, AssetEntry, read_lock
from generators.library.store import Store

#: Seconds of a unit, and of the root mean square of its loudest second that a second must have to count as sounding.
SECONDS, SOUNDING = 8, 0.05
#: How much faster a recording may be, or slower (its pitch changes with it).
FASTER = 1.12
#: Places of a recording that are tried for one in which it sounds.
_DRAWS = 20


def excerpts(task: tuple[int, str, int]) -> NDArray[np.float16]:
    """(n, EXCERPT) of a unit of a voice: (number of the category, name of the voice, number of the unit)."""
    category, voice, unit = task
    # Entropy of its own: training, validation and tests draw other units.
    rng = np.random.default_rng([36, category, unit, *voice.encode()])
    return _sounding(np.asarray(synthesise(CATEGORIES[category], SECONDS, rng, voice)))


def recorded_excerpts(task: tuple[AssetEntry, int]) -> NDArray[np.float16]:
    """(count, EXCERPT) of a recording: (its entry, count); fewer where it hardly sounds."""
    entry, count = task
    path = Store.default().path(entry)
    rng = np.random.default_rng([37, *entry.id.encode()])
    longest = int(1.01 * FASTER * EXCERPT)
    seconds = max(longest / SAMPLE_RATE, recorded_seconds(path, entry.trim))
    whole = np.asarray(load_sound(path, seconds, trim=entry.trim), np.float64)
    loudest = _levels(whole[: len(whole) // SAMPLE_RATE * SAMPLE_RATE].reshape(-1, SAMPLE_RATE)).max()
    out: list[NDArray[np.float16]] = []
    for _ in range(_DRAWS * count):
        # A multiple of 100 Hz, so that the filter is short.
        speed = 100 * round(SAMPLE_RATE * FASTER ** rng.uniform(-1, 1) / 100)
        first = int(rng.integers(max(1, len(whole) - longest)))
        piece = resampled(whole[first : first + longest], speed)[:EXCERPT]
        out += list(_sounding(piece, loudest))
        if len(out) == count:
            break
    return np.stack(out) if out else np.zeros((0, EXCERPT), np.float16)


def _sounding(signal: NDArray[np.float64], loudest: float | None = None) -> NDArray[np.float16]:
    """The pairs of seconds of a signal whose second one sounds, compared with the loudest (RMS; None: of these)."""
    pairs = signal.reshape(-1, EXCERPT)
    levels = _levels(pairs[:, SAMPLE_RATE:])
    return np.asarray(pairs[levels > SOUNDING * (loudest or levels.max())], np.float16)


def _levels(seconds: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.sqrt(np.mean(np.square(seconds), axis=1)))


@click.command(help=(__doc__ or "").splitlines()[0])
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), required=True, help="NPZ")
@click.option("--units", type=click.IntRange(1), default=40, show_default=True, help="Of each voice for training.")
@click.option(
    "--recorded",
    type=click.IntRange(0),
    default=500,
    show_default=True,
    help="Of the recordings of each category together; without any in the store, none.",
)
@click.option("--workers", type=click.IntRange(1), default=None, help="Processes [one per core].")
def main(output: Path, units: int, recorded: int, workers: int | None) -> None:
    """The command."""
    tasks = [
        (number, voice.name, unit)
        for number, category in enumerate(CATEGORIES)
        for voice in voices(category)
        if voice.split == "train"
        for unit in range(units)
    ]
    entries = Store.default().recordings(read_lock(MANIFESTS / LOCK_NAME), "train")
    of_category = Counter(entry.category for entry in entries)
    recordings = [(entry, recorded // of_category[entry.category]) for entry in entries]
    try:
        found = dict(process_each(excerpts, tasks, workers=workers, label="units of voices"))
        others = {entry.id: some for (entry, _), some in process_each(recorded_excerpts, recordings, workers=workers)}
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    heard = [entry for entry in entries if len(others[entry.id])]
    pieces = [(task[0], found[task]) for task in tasks]
    pieces += [(CATEGORIES.index(str(entry.category)), others[entry.id]) for entry in heard]
    categories = [number for number, some in pieces for _ in some]
    credits = [entry.attribution_record for entry in heard]
    write_dry(output, np.concatenate([some for _, some in pieces]), categories, credits)
    click.echo(f"{output}: {len(categories)} excerpts of {len(tasks)} units and {len(heard)} recordings")


if __name__ == "__main__":
    main()
