"""`python -m benchmarks.sibling_clips MANIFEST`: how alike are the clips of siblings of part_3?

The observations are heard, not rendered, and their homes are not lit: neither changes what sounds. Of every two
siblings with a common category, the share of frames with equal clips and the largest correlation are measured, and the
attacks of `benchmarks.sealed_takes` answer their question.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations
from pathlib import Path
from typing import cast

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from scipy.fft import irfft, rfft

from avs3d_bench.contract import layout
from avs3d_bench.formats import media
from benchmarks.sealed_attacks import judge, table
from benchmarks.sealed_takes import Clips, Sibling, clips_of, take_cases
from generators.apartments.apartment import build_apartment
from generators.backends import vision_backend
from generators.core.scene import Scene
from generators.homes.store import open_home
from generators.observation.arrangement import Arrangement, arrange
from generators.observation.hearing import hear_sources
from generators.observation.mixing import make_background, mix, stems_of
from generators.observation.prepare import prepare_sources
from generators.observation.stems import Stem
from generators.options import Audio, GenerateOptions
from generators.plan import ObservationPlan, make_plans, read_manifest

#: Largest lag of the correlation (s).
LAG = 0.1


@dataclass(frozen=True)
class Pair:
    """How alike two siblings are.

    Attributes:
        same: whether an object sounds in both.
        equal: share of the frames, among those in which either can be heard, whose clips are the same to the bit.
        correlation: the largest of a frame, mean over the frames in which both can be heard.
    """

    same: bool
    equal: float
    correlation: float


def hear_siblings(plans: Sequence[ObservationPlan], root: Path) -> list[Sibling]:
    """Write the binaural clips of observations of part_3 below ``root``, and nothing else."""
    found = []
    for plan in plans:
        prepared = prepare_sources(plan, *arranged_unlit(plan), vision_backend(plan.options.renderer))
        heard = hear_sources(prepared.acoustic_jobs, plan.camera.frames)
        seconds = [[Stem(one.head.clip) for one in second] for second in heard]
        _, noise = make_background(plan, seconds)
        for index, second in enumerate(seconds):
            clip = mix(prepared, list(stems_of(prepared, second, noise, index).values()), index)
            media.write_wav(root / plan.key / layout.audio_path(layout.BINAURAL, index), clip)
        sources = tuple((source.category, source.instance) for source in prepared.sources)
        found.append(Sibling(plan.key, plan.spec.like or plan.key, sources))
    return found


_arrangement_cache: dict[str, tuple[Scene, Arrangement]] = {}


def arranged_unlit(plan: ObservationPlan) -> tuple[Scene, Arrangement]:
    """The unlit home of a plan and what is visible in it; the last one is kept for the siblings."""
    if plan.pictures_digest not in _arrangement_cache:
        _arrangement_cache.clear()
        home = (_apartment(plan) if plan.scan.source == "apartment" else open_home(plan, Path())).for_room(
            plan.spec.room
        )
        _arrangement_cache[plan.pictures_digest] = home, arrange(plan, home)
    return _arrangement_cache[plan.pictures_digest]


def _apartment(plan: ObservationPlan) -> Scene:
    assert plan.scan.seed is not None
    return _built(plan.spec.scan, plan.scan.seed)


@lru_cache(maxsize=1)
def _built(name: str, seed: int) -> Scene:
    return build_apartment(name, seed)


def compare(root: Path, siblings: Sequence[Sibling]) -> Iterator[Pair]:
    """The pairs of siblings in which the same category sounds."""
    for one, other in combinations(siblings, 2):
        categories = {name for name, _ in one.sources} & {name for name, _ in other.sources}
        if one.group != other.group or not categories:
            continue
        same = any(instance is not None for _, instance in set(one.sources) & set(other.sources))
        a, b = clips_of(root / one.key), clips_of(root / other.key)
        either = [x.any() or y.any() for x, y in zip(a, b, strict=True)]
        equal = [x.any() and np.array_equal(x, y) for x, y in zip(a, b, strict=True)]
        found = [_correlation(x, y) for x, y in zip(a, b, strict=True) if x.any() and y.any()]
        yield Pair(same, sum(equal) / max(sum(either), 1), float(np.mean(found)) if found else 0.0)


def _correlation(one: Clips, other: Clips) -> float:
    """The largest normalised correlation of two clips (2, n) at lags up to `LAG`, of the ear in which it is larger."""
    length, lags = 2 * one.shape[1], round(LAG * layout.SAMPLE_RATE)
    crossed = irfft(rfft(one.astype(np.float64), length) * rfft(other.astype(np.float64), length).conj(), length)
    near = np.abs(np.concatenate([crossed[:, : lags + 1], crossed[:, -lags:]], axis=1)).max(axis=1)
    energy = np.sqrt((one.astype(np.float64) ** 2).sum(axis=1) * (other.astype(np.float64) ** 2).sum(axis=1))
    return float((near / np.maximum(energy, 1e-20)).max())


def report(pairs: Sequence[Pair]) -> Iterator[str]:
    """Lines about pairs with and without a common object."""
    for same, what in ((True, "with a common object"), (False, "with a common category only")):
        mine = [pair for pair in pairs if pair.same == same]
        if mine:
            equal = np.mean([pair.equal for pair in mine])
            any_ = np.mean([pair.equal > 0 for pair in mine])
            heard = np.array([pair.correlation for pair in mine])
            yield (
                f"{len(mine)} pairs {what}: {equal:.1%} of the clips are equal ({any_:.0%} of the pairs have some), "
                f"largest correlation {np.median(heard):.2f} (median), {heard.max():.2f} (most)"
            )


@click.command()
@click.argument("manifest", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--audio", default=None, help="Acoustic engine; default: the manifest's.")
@click.option("--frames", default=24, show_default=True, type=click.IntRange(1), help="Frames of each observation.")
@click.option("--only", multiple=True, metavar="KEY_GLOB", help="Only these observations; repeatable.")
@click.option("--workers", default=1, show_default=True, type=click.IntRange(1), help="Processes; each hears a group.")
@click.option("-o", "--out", default=None, type=click.Path(path_type=Path), help="Keep the clips in this folder.")
def main(manifest: Path, audio: str | None, frames: int, only: tuple[str, ...], workers: int, out: Path | None) -> None:
    """Hear the siblings of part_3 of MANIFEST, compare their clips, and attack them."""
    groups: dict[str, list[ObservationPlan]] = {}
    options = GenerateOptions(only=only, audio=cast(Audio | None, audio), frames=frames, size=64)
    for plan in make_plans(read_manifest(manifest), options):
        if plan.spec.is_part_3:
            groups.setdefault(plan.spec.like or plan.key, []).append(plan)
    with tempfile.TemporaryDirectory(prefix="avs3d-siblings-") as folder, ProcessPoolExecutor(workers) as pool:
        root = out or Path(folder)
        found = pool.map(partial(_hear_group, root), groups.values())
        siblings, pairs = zip(*track(found, "hearing", len(groups), console=Console(stderr=True)), strict=True)
        for line in report([pair for some in pairs for pair in some]):
            print(line)
        verdicts = judge(take_cases(root, [one for some in siblings for one in some]))
        Console(width=130).print(table(verdicts))


def _hear_group(root: Path, plans: Sequence[ObservationPlan]) -> tuple[list[Sibling], list[Pair]]:
    siblings = hear_siblings(plans, root)
    return siblings, list(compare(root, siblings))


if __name__ == "__main__":
    main()
