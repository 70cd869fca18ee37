"""Which homes of a drawn manifest have no room for their observations; they are built without light and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from avs3d_bench.runtime.parallel import process_each
from generators.manifest.reading import ManifestFile
from generators.manifest.schema import Manifest
from generators.options import GenerateOptions
from generators.plan import ObservationPlan, make_plans
from generators.sampling.fitting import fits


@dataclass(frozen=True)
class HomeFitting:
    """Places the objects of observations, and plans the walks past them.

    Attributes:
        path: the template's, whose folder has the files that it names.
        workers: number of processes; the result does not depend on it.
    """

    path: Path
    workers: int | None = 1

    def __call__(self, manifest: Manifest, homes: set[str]) -> set[str]:
        """Those of ``homes`` in which an observation finds no place for its objects or no floor for its walk.

        A scan cannot be drawn again: what does not fit into it fails when it is generated.
        """
        plans = make_plans(ManifestFile(manifest, self.path, "", ""), GenerateOptions(audio="analytic"))
        # Variants and siblings have the objects and the walk of their original.
        own = [plan for plan in plans if plan.spec.like is None and plan.scan.seed is not None]
        tasks = [[plan for plan in own if plan.spec.scan == home] for home in sorted(homes)]
        found = process_each(_has_misfit, [task for task in tasks if task], workers=self.workers)
        return {task[0].spec.scan for task, wrong in found if wrong}


def _has_misfit(plans: list[ObservationPlan]) -> bool:
    return not all(fits(plan) for plan in plans)
