"""Which units of a sampled manifest do not fit into their rooms; the homes are built without light and pictures.

Nor do twins that are to be alike and are not: what sounds is drawn independently of it, so that it tells nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.parallel import process_each
from generators.apartments.apartment import build_apartment
from generators.core.scene import Scene
from generators.manifest.reading import ManifestFile
from generators.manifest.schema import Manifest
from generators.observation.arrangement import Arrangement, arrange, copies_of
from generators.options import GenerateOptions
from generators.paths.tours import level_difference
from generators.placement.site import Site
from generators.plan import ObservationPlan, make_plans

#: Twins are alike if the course of the level tells them apart by no more (dB, see `level_difference`), ...
MOST_DIFFERENCE = 1.5
#: ... and each of them is this far to the left (degrees), and to the right, in this share of the frames.
SIDE, SIDE_SHARE = 15.0, 0.15
#: Homes that are kept for the next draw: a home takes twice as long as what is placed in it.
KEPT_HOMES = 8


@dataclass(frozen=True)
class SampleFitting:
    """Places the objects of sampled observations, and plans the walks past them.

    Attributes:
        workers: number of processes; the result does not depend on it.
    """

    workers: int = 1

    def __call__(self, manifest: Manifest) -> tuple[int, ...]:
        """The numbers of the observations whose objects or walk find no room, sorted."""
        plans = make_plans(
            ManifestFile(manifest, Path("sampled.yaml").resolve(), "", ""), GenerateOptions(audio="analytic")
        )
        by_home: dict[str, list[int]] = {}
        for number, plan in enumerate(plans):
            by_home.setdefault(plan.spec.scan, []).append(number)
        tasks = [[(number, plans[number]) for number in numbers] for numbers in by_home.values()]
        return tuple(
            sorted(number for _, wrong in process_each(_misfits, tasks, workers=self.workers) for number in wrong)
        )


def _misfits(task: list[tuple[int, ObservationPlan]]) -> list[int]:
    """The numbers of a home's observations that do not fit."""
    return [number for number, plan in task if not fits(plan)]


def fits(plan: ObservationPlan) -> bool:
    """Whether the room has places for the objects of a plan and floor for the walk."""
    assert plan.scan.seed is not None
    home = _home(plan.spec.scan, plan.scan.seed)
    try:
        found = arrange(plan, home, site=_site(home, plan.spec.room))
    except Avs3dError:
        return False
    return plan.spec.twins == "apart" or are_alike(found)


def are_alike(found: Arrangement) -> bool:
    """Whether twins can be told apart only by where they are heard from, and are heard from both sides."""
    eyes = np.array([pose.position for pose in found.poses])
    rightward = np.array([pose.rotation_matrix[:, 0] for pose in found.poses])
    for copies in copies_of(found.placements):
        sources = np.array([found.placements[index].source_position for index in copies])
        if level_difference(eyes, sources) > MOST_DIFFERENCE:
            return False
        offset = sources - eyes[:, None]
        sine = (offset * rightward[:, None]).sum(axis=2) / np.linalg.norm(offset, axis=2)
        sides = [(sign * sine > math.sin(math.radians(SIDE))).mean(axis=0) for sign in (-1, 1)]
        if np.min(sides) < SIDE_SHARE:
            return False
    return True


@lru_cache(maxsize=KEPT_HOMES)
def _home(name: str, seed: int) -> Scene:
    """A home without its materials and light, which placement and walk do not need."""
    return build_apartment(name, seed, plain=True)


@lru_cache(maxsize=3)
def _site(home: Scene, room: str) -> Site:
    return Site.of(home, room)
