"""The part of an observation that is fixed before its first frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.geometry import Intrinsics
from generators.acoustics.base import AcousticBackend
from generators.backends import acoustic_backend, vision_backend
from generators.core.scene import Scene
from generators.homes.store import open_home
from generators.observation.arrangement import Arrangement, arrange
from generators.observation.hearing import AcousticJob
from generators.observation.parts import PartRules, rules_of
from generators.observation.sources import SoundSource, choose_sources
from generators.placement.placement import Placement
from generators.plan import ObservationPlan
from generators.scenes.placed import PlacedScene
from generators.vision.base import VisionBackend
from generators.vision.camera import CameraBackend


@dataclass(frozen=True, eq=False)
class PreparedObservation:
    """The part of an observation that is fixed before its first frame.

    Attributes:
        plan: all that its bytes depend on.
        rules: of its part.
        arrangement: the placed objects and the walk.
        sources: what sounds.
        stage: the scene at every second.
        intrinsics: of the camera.
        renderer: makes the pictures.
        engine: the acoustic engine.
        lowered_db: by how much all sources are lowered, so that several at a time do not reach full scale (dB).
    """

    plan: ObservationPlan
    rules: PartRules
    arrangement: Arrangement
    sources: tuple[SoundSource, ...]
    stage: PlacedScene
    intrinsics: Intrinsics
    renderer: VisionBackend
    engine: AcousticBackend
    lowered_db: int = 0

    @property
    def lowered(self) -> float:
        """The factor of `lowered_db`."""
        return float(10 ** (-self.lowered_db / 20))

    @property
    def sounding(self) -> dict[int, Placement]:
        """Id of an instance that sounds → its placement at time 0, sorted."""
        ids = sorted({source.instance for source in self.sources if source.instance is not None})
        return {number: self.arrangement.placements[number - 1] for number in ids}

    @property
    def contents(self) -> layout.Part3Contents | None:
        """The facts that decide which files a part_3 observation has; None in the other parts."""
        if not self.rules.named_sources:
            return None
        return layout.Part3Contents(
            sources=tuple(source.id for source in self.sources),
            in_room=bool(self.sounding),
            stems=self.plan.keeps_stems,
            background=self.plan.spec.background is not None,
        )

    @property
    def acoustic_jobs(self) -> tuple[AcousticJob, ...]:
        """The inputs of the acoustic simulation, one per source."""
        return tuple(
            AcousticJob(
                options=self.plan.options,
                absorption_scale=self.plan.spec.acoustics.absorption_scale,
                seed=self.plan.acoustic_seed,
                scene=self.stage.acoustic_scene_of(source.instance),
                room=source.room,
                samples=source.samples * np.float32(self.lowered),
                poses=self.arrangement.poses,
                path=source.poses,
                directivity=source.directivity,
                measures_direct=self.rules.marked_while_audible,
            )
            for source in self.sources
        )


def prepare_observation(plan: ObservationPlan, cache: Path) -> PreparedObservation:
    """Choose all that is visible, with the same rules for all objects; then, independently, what sounds.

    Args:
        plan: of the observation.
        cache: folder of baked homes.

    Raises:
        Avs3dError: if a room does not exist, is too small for the objects or the walk, or a file is missing or broken.
    """
    renderer = vision_backend(plan.options.renderer, plan.options.device)
    if plan.options.camera != "ideal":
        renderer = CameraBackend(renderer, plan.rng("camera"), plan.options.camera)
    return prepare_sources(plan, *arranged(plan, cache, renderer), renderer)


def prepare_sources(
    plan: ObservationPlan, home: Scene, arrangement: Arrangement, renderer: VisionBackend
) -> PreparedObservation:
    """Choose what sounds among objects that are placed already.

    Raises:
        Avs3dError: if a room does not exist, or a file is missing or broken.
    """
    engine = acoustic_backend(
        plan.options, absorption_scale=plan.spec.acoustics.absorption_scale, seed=plan.acoustic_seed
    )
    return PreparedObservation(
        plan=plan,
        rules=rules_of(plan.spec.part),
        arrangement=arrangement,
        sources=choose_sources(plan, home, arrangement),
        stage=staged(home, arrangement),
        intrinsics=Intrinsics.from_fov(plan.camera.size, plan.camera.hfov),
        renderer=renderer,
        engine=engine,
    )


#: How many arrangements a process keeps: siblings and variants often follow one another.
KEPT = 1
#: The last homes with their arrangements, by the digest of the pictures.
_arrangement_cache: dict[str, tuple[Scene, Arrangement]] = {}
#: The lit homes of these arrangements: an observation that is too loud at first is made again, and so are siblings.
_stages: WeakKeyDictionary[Arrangement, PlacedScene] = WeakKeyDictionary()


def arranged(plan: ObservationPlan, cache: Path, renderer: VisionBackend) -> tuple[Scene, Arrangement]:
    """The lit home of a plan, and what is visible in it."""
    if plan.pictures_digest not in _arrangement_cache:
        while len(_arrangement_cache) >= KEPT:
            del _arrangement_cache[next(iter(_arrangement_cache))]
        home = open_home(plan, cache).for_room(plan.spec.room)
        _arrangement_cache[plan.pictures_digest] = home, arrange(plan, home, renderer.navigable(home))
    return _arrangement_cache[plan.pictures_digest]


def staged(home: Scene, arrangement: Arrangement) -> PlacedScene:
    """The objects of an arrangement in its home, which are lit once as long as the arrangement is in use."""
    if arrangement not in _stages:
        _stages[arrangement] = PlacedScene(home, arrangement.placements, arrangement.motions)
    return _stages[arrangement]
