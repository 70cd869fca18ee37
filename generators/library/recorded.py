"""The recordings of a lock file as voices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import check_category_name
from generators.assets.sounds import Voice, load_sound
from generators.core.limits import SoundSplit
from generators.library.lock import read_lock
from generators.library.store import Store, open_asset


def recorded_voices(lock: Path, category: str, store: Store | None = None) -> tuple[Voice, ...]:
    """The recordings of a category that have a split, in the order of the lock file.

    A voice has the name of its asset. It plays from a moment of the recording that its Generator draws, looped if that
    is short; its file is looked for when it plays.

    Args:
        lock: the lock file.
        category: one of the benchmark's, or one that manifests declare.
        store: the store with the files; default: the user's.

    Raises:
        UsageError: for a category that no manifest can have.
        Avs3dError: if the lock file cannot be read; on playing, if the recording is missing or broken.
    """
    check_category_name(category)

    def voice(asset: str, split: SoundSplit, credit: str) -> Voice:
        def play(count: int, rng: Generator) -> NDArray[np.float64]:
            path, entry = open_asset(lock, asset, store)
            seconds = max(count / SAMPLE_RATE, 1.0)
            source = load_sound(path, seconds, start=float(rng.random()), trim=entry.trim)
            return source[:count].astype(np.float64)

        return Voice(category, asset, split, "recording", credit, play, "recorded")

    return tuple(
        voice(entry.id, entry.split, entry.attribution)
        for entry in read_lock(lock).assets
        if entry.kind == "sound" and entry.category == category and entry.split is not None
    )
