"""The rooms of a manifest, where listeners and sources stand in them, and what is held out for testing."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.acoustics import AcousticsSettings, ResponseSplit
from generators.core.freespace import SENSOR_HEIGHT, FreeSpace
from generators.manifest.reading import ManifestFile, read_manifest
from generators.observation.regenerate import stored_manifest
from generators.options import GenerateOptions
from generators.plan import ObservationPlan, check_scans, make_plans

Points = NDArray[np.float64]

#: Share of listeners and of homes that are held out.
_TEST_SHARE = 0.2
#: Heights of sources above the floor (m): from a low shelf to a standing mouth.
_SOURCE_HEIGHTS = (0.4, 1.6)
#: Least distance of a source from every listener, so that none is inside of the other (m).
_APART = 0.3
#: Headings of two ears: those of SoundSpaces (degrees).
_HEADINGS = (0.0, 90.0, 180.0, 270.0)


@dataclass(frozen=True)
class SourceManifest:
    """What is exported: a manifest, and the plans of the observations whose rooms are taken."""

    file: ManifestFile
    plans: tuple[ObservationPlan, ...]

    @property
    def homes(self) -> dict[str, dict[str, ObservationPlan]]:
        """Home → room → a plan of an observation there, both sorted by name."""
        found: dict[str, dict[str, ObservationPlan]] = {}
        for plan in self.plans:
            found.setdefault(plan.spec.scan, {}).setdefault(plan.spec.room, plan)
        return {home: dict(sorted(found[home].items())) for home in sorted(found)}


@contextmanager
def opened_manifest(source: Path, settings: AcousticsSettings) -> Iterator[SourceManifest]:
    """The manifest at ``source``, a file, or the one from which the dataset at ``source`` was made.

    Raises:
        UsageError: if there is neither, the manifest is not published (a sealed test), or there are two.
        Avs3dError: if the manifest is wrong, or names files that are missing.
    """
    options = GenerateOptions(only=settings.only, audio="tracer", device=settings.device)
    if not source.is_dir():
        if settings.manifest is not None:
            raise UsageError(f"--manifest belongs to a dataset; {source} is a manifest itself: leave it out")
        yield _planned(read_manifest(source), options)
        return
    record = Dataset(source).record
    if record is None or not record.manifest:
        why = f"no {layout.DATASET_JSON}" if record is None else "a sealed test, whose manifest is secret"
        raise UsageError(f"{source}: {why}; expected a dataset of `avs3d generate`, or a manifest")
    with tempfile.TemporaryDirectory(prefix="avs3d-acoustics-") as folder:
        file = stored_manifest(record, settings.manifest, Path(folder))
        try:
            found = _planned(file, options)
        except Avs3dError as error:
            if folder not in str(error):
                raise
            raise UsageError(f"{source}: its manifest names files beside it; name its file with --manifest") from error
        yield found


def _planned(file: ManifestFile, options: GenerateOptions) -> SourceManifest:
    plans = make_plans(file, options)
    check_scans(plans)
    return SourceManifest(file, plans)


@dataclass(frozen=True)
class Positions:
    """Where sound is made and heard in a room.

    Attributes:
        sources: (S, 3) metres.
        listeners: (L, 3) metres.
        headings: (L,) degrees to the left of −Z.
        test: (L,) bool, listeners that are held out.
    """

    sources: Points
    listeners: Points
    headings: Points
    test: NDArray[np.bool_]


def draw_positions(space: FreeSpace, where: str, settings: AcousticsSettings, rng: Generator) -> Positions:
    """Listeners on a grid of the walkable floor, as high as the agent's sensor, and sources far from one another.

    Args:
        space: the floor of the room.
        where: for messages.
        settings: spacing, number of sources, receiver.
        rng: random numbers.

    Raises:
        UsageError: if the floor is too small for a listener and the sources.
    """
    listeners = np.insert(grid(space, settings.spacing), 1, space.floor + SENSOR_HEIGHT, axis=1)
    if not len(listeners):
        raise UsageError(f"{where}: no listener fits on a grid of {settings.spacing:g} m; choose a smaller --spacing")
    sources = draw_sources(space, listeners, settings.sources, rng)
    if len(sources) < settings.sources:
        raise UsageError(
            f"{where}: {len(sources)} sources fit between the listeners, {settings.sources} are asked for; choose "
            "fewer --sources or a larger --spacing"
        )
    count = len(listeners)
    headings = rng.choice(_HEADINGS, count) if settings.receiver == "binaural" else np.zeros(count)
    return Positions(sources, listeners, headings, held_out(count, rng))


def grid(space: FreeSpace, spacing: float) -> Points:
    """(N, 2) x and z of the walkable points of a square grid, sorted."""
    points = space.points
    if not len(points):
        return np.zeros((0, 2))
    low, high = points.min(axis=0), points.max(axis=0)
    # The grid's margins are equal on both sides.
    axes = [
        a + (b - a - spacing * int((b - a) / spacing)) / 2 + spacing * np.arange(int((b - a) / spacing) + 1)
        for a, b in zip(low, high, strict=True)
    ]
    found = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.asarray(np.round(found[space.contains(found)], 6))


def draw_sources(space: FreeSpace, listeners: Points, count: int, rng: Generator) -> Points:
    """(at most ``count``, 3) places above the walkable floor, each as far from those before as possible.

    Heights are drawn; places nearer than 0.3 m to a listener are left out.
    """
    heights = rng.uniform(*_SOURCE_HEIGHTS, len(space.points))
    places = np.insert(space.points, 1, space.floor + heights, axis=1)
    apart = np.linalg.norm(places[:, None, :] - listeners[None], axis=2).min(axis=1) >= _APART
    places = places[apart]
    if not len(places):
        return np.zeros((0, 3))
    chosen = [int(rng.integers(len(places)))]
    nearest = np.linalg.norm(places - places[chosen[0]], axis=1)
    while len(chosen) < count and nearest.max() > 0:
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return np.asarray(np.round(places[chosen], 6))


def held_out(count: int, rng: Generator) -> NDArray[np.bool_]:
    """(count,) a fifth at random, at least one of two or more; of one, none."""
    test = np.zeros(count, dtype=bool)
    if count > 1:
        test[rng.permutation(count)[: max(1, round(_TEST_SHARE * count))]] = True
    return test


def split_names(names: Sequence[str], rng: Generator) -> dict[str, ResponseSplit]:
    """Name → its split; see `held_out`."""
    return {name: "test" if test else "train" for name, test in zip(names, held_out(len(names), rng), strict=True)}
