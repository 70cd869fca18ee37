"""`validate --regenerate N`: chooses frames and has the generator regenerate them, where it is installed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path

import numpy as np

from avs3d_bench.commands.report import Problem, ordered
from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import UsageError
from avs3d_bench.runtime.imports import needing

#: Entry points that regenerate frames: called with (root, key → indices, manifest or None, say, SOFA file or None),
#: they give problems.
GROUP = "avs3d.regenerate"
Maker = Callable[
    [Path, Mapping[str, Sequence[int]], Path | None, Callable[[str], None], Path | None], Iterable[Problem]
]
_INSTALL = "pip install 'avs3d-bench[generate]'"


def choose_frames(root: str | Path, count: int, seed: int) -> dict[str, tuple[int, ...]]:
    """``count`` frames of a dataset at random, all if it has fewer: key → indices, ascending.

    Raises:
        UsageError: if there is no observation whose frames could be regenerated.
    """
    frames = [
        (observation.key, index)
        for observation in Dataset(root)
        if (observation.path / layout.OBSERVATION_JSON).exists()
        for index in range(len(observation.frame_names))
    ]
    if not frames:
        raise UsageError(f"{root}: no {layout.OBSERVATION_JSON}: frames of the official release cannot be regenerated")
    chosen = np.random.default_rng(seed).choice(len(frames), min(count, len(frames)), replace=False)
    out: dict[str, list[int]] = {}
    for number in sorted(chosen.tolist()):
        key, index = frames[number]
        out.setdefault(key, []).append(index)
    return {key: tuple(indices) for key, indices in out.items()}


def entry_points() -> tuple[metadata.EntryPoint, ...]:
    """The installed functions that regenerate frames."""
    return tuple(metadata.entry_points(group=GROUP))


def find_maker() -> Maker:
    """The generator's function behind the entry point.

    Raises:
        UsageError: if it is not installed.
    """
    for point in entry_points():
        with needing("--regenerate", _INSTALL, kind=UsageError):
            maker: Maker = point.load()
        return maker
    raise UsageError(f"--regenerate needs the generator: {_INSTALL}")


def regenerate(
    root: str | Path,
    count: int,
    *,
    seed: int,
    manifest: Path | None = None,
    say: Callable[[str], None] = lambda _: None,
    hrtf: Path | None = None,
) -> tuple[Problem, ...]:
    """Regenerate ``count`` random frames and compare their bytes.

    Args:
        root: the dataset.
        count: how many frames.
        seed: decides which.
        manifest: the manifest's file, if it names files beside it.
        say: called with a line about what is being made.
        hrtf: the SOFA file of the head with which the dataset was made, if it was made with one.

    Raises:
        UsageError: if the generator is not installed, or its versions are not those that made the dataset.
    """
    maker = find_maker()
    return ordered(list(maker(Path(root), choose_frames(root, count, seed), manifest, say, hrtf)))
