"""Which units of a sampled manifest do not fit into their rooms; the homes are built without light and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.parallel import process_each
from generators.apartments.apartment import build_apartment
from generators.core.scene import Scene
from generators.manifest.reading import ManifestFile
from generators.manifest.schema import Manifest
from generators.observation.arrangement import arrange
from generators.options import GenerateOptions
from generators.placement.site import Site
from generators.plan import ObservationPlan, make_plans


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
        arrange(plan, home, site=_site(home, plan.spec.room))
    except Avs3dError:
        return False
    return True


@lru_cache(maxsize=1)
def _home(name: str, seed: int) -> Scene:
    """A home without its light, which placement and walk do not need."""
    return build_apartment(name, seed)


@lru_cache(maxsize=3)
def _site(home: Scene, room: str) -> Site:
    return Site.of(home, room)
