"""Attacks on the seeds of a sealed test: try seeds of the manifest one by one, and recognise homes.

The sparse points of an observation are random pixels of its frames. So a guess of the manifest's seed can be checked
without rendering anything: does it draw the pixels of the first frame?
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.formats.colmap import ColmapModel, read_model
from benchmarks.sealed_cases import Array, Case
from benchmarks.unseen_homes import used_seeds
from generators.apartments.apartment import build_apartment
from generators.core.rays import RayCaster
from generators.plan import derive_rng
from generators.sampling.sample import SEEDS

#: Seeds of a manifest that are tried by default, from 0 on.
SEEDS_TRIED = 20_000
#: Pixels of the first frame that `SurfaceSampler` draws for it.
_PER_FRAME = 200
#: Share of the drawn pixels that are points of the first frame, from which a seed is the right one. The share of a
#: wrong one is that of the pixels that are points, a few per cent.
_AGREEMENT = 0.35
#: A point lies on a surface if a ray to it meets something this near to it (m).
_TOLERANCE = 0.01
#: Share of the points on the surfaces of a home from which it is recognised. Of its own home it was 0.89 and 0.91 (the
#: placed objects are none of it), of others up to 0.57: floors and walls of different homes can lie in one plane.
_RECOGNISED = 0.75


def find_seed(model: ColmapModel, key: str, seeds: Iterable[int]) -> int | None:
    """The seed of the manifest, if it is among ``seeds``."""
    camera = next(iter(model.cameras.values()))
    marked = np.zeros((camera.height, camera.width), dtype=bool)
    column, row = np.floor(model.images[0].pixels.T).astype(int)
    marked[row, column] = True
    for seed in seeds:
        rng = derive_rng(seed, key, "points")
        rows = rng.integers(0, camera.height, _PER_FRAME)
        columns = rng.integers(0, camera.width, _PER_FRAME)
        if marked[rows, columns].mean() > _AGREEMENT:
            return seed
    return None


def guess_seeds(cases: Sequence[Case], count: int) -> list[Array | None]:
    """Try ``count`` seeds on the first observation; a seed that is found tells the draw of the sounding object."""
    drawn = [case for case in cases if case.instances]
    found = find_seed(drawn[0].model, drawn[0].keys[0], range(count)) if drawn else None
    return [_draw(case, found) if case.instances else None for case in cases]


def _draw(case: Case, seed: int | None) -> Array:
    """1 for the object that the generator draws with a seed; without a seed, all are equal."""
    scores = np.zeros(case.count)
    if seed is not None and case.question == "twin":
        scores[int(derive_rng(seed, case.keys[0], "sounding").integers(case.count))] = 1.0
    return scores


def agreement(model: ColmapModel, home: RayCaster) -> float:
    """Share of the sightings of sparse points that lie on the surfaces of a home."""
    near: list[NDArray[np.bool_]] = []
    by_id = dict(zip(model.points.ids.tolist(), model.points.positions, strict=True))
    for image in model.images:
        if not len(image.point_ids):
            continue
        eye = np.asarray(image.pose.position)
        ways = np.array([by_id[one] for one in image.point_ids.tolist()]) - eye
        distance = np.linalg.norm(ways, axis=1)
        met, face = home.closest(np.broadcast_to(eye, ways.shape), ways / distance[:, None])
        near.append((face >= 0) & (np.abs(met - distance) < _TOLERANCE))
    return float(np.concatenate(near).mean()) if near else 0.0


def home_of(seed: int) -> RayCaster:
    """The surfaces of the procedural home with a seed."""
    return RayCaster(build_apartment("home", seed, plain=True))


def public_homes() -> list[int]:
    """Seeds of the homes of the committed benchmarks; the sampled homes for training have larger ones."""
    return sorted(seed for seed in used_seeds() if seed < SEEDS[0])


def recognise(public: Path, seeds: Iterable[int]) -> dict[str, list[int]]:
    """Home of the public folder → those of ``seeds`` that are its own, by the sparse points of one observation."""
    homes = sorted({path.name for path in public.glob("part_*/*") if path.is_dir()})
    models = {home: read_model(sorted(public.glob(f"part_*/{home}/*/*"))[0] / layout.COLMAP) for home in homes}
    out: dict[str, list[int]] = {home: [] for home in homes}
    for seed in seeds:
        caster = home_of(seed)
        for home, model in models.items():
            if agreement(model, caster) > _RECOGNISED:
                out[home].append(seed)
    return out
