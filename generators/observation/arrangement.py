"""Chooses the visible part of an observation; then, independently of it, the instances that sound.

The pictures must not reveal which object sounds. `arrange` therefore chooses the places of the objects, the instance
ids, the walk and the gaze with the same rules for all objects: it reads only the set of models, in which the sounding
category is not marked. `draw_instances` draws the sounding instances from random streams of their own, which
nothing visible depends on. In part_3 the manifest names the categories that move, whether they sound or not. (With
``source_motion: path``, in part_1 and part_2, the motion itself reveals it: only the sounding object moves.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from numpy.random import Generator

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from generators.assets.meshfile import CategoryDefaults, load_model, usual_of
from generators.assets.model import Model
from generators.core.freespace import Navigable
from generators.core.scene import Licence, Scene
from generators.library import open_asset
from generators.manifest.schema import ObjectSpec, SoundSpec
from generators.objects import build
from generators.observation.parts import rules_of
from generators.paths.motion import Motion, movable, plan_motions
from generators.paths.standing import stay
from generators.paths.trajectory import WalkTask, plan_walk
from generators.placement.placement import RULES, TWIN_SPAN, Placement, Rule, place
from generators.placement.site import Site
from generators.plan import ObservationPlan, resolve_file

#: Number of places that are tried for objects that move.
PLACES_TO_MOVE = 6


@dataclass(frozen=True, eq=False)
class Arrangement:
    """The visible part of an observation, and nothing else.

    Attributes:
        placements: the objects at time 0; instance n is number n − 1.
        poses: of the agent, one per frame.
        notes: constraints that were relaxed; no note tells which object it is about.
        motions: of the objects that move, in the order of their ids.
    """

    placements: tuple[Placement, ...]
    poses: tuple[Pose, ...]
    notes: tuple[str, ...]
    motions: tuple[Motion, ...] = ()


def arrange(
    plan: ObservationPlan, home: Scene, navigable: Navigable | None = None, site: Site | None = None
) -> Arrangement:
    """Choose the places of the objects, their instance ids, and the path of the agent.

    Args:
        plan: of the observation.
        home: without the objects.
        navigable: tells which points on the floor the renderer's own navigation mesh contains, if it has one.
        site: the plan's room of ``home``, if the caller has measured it already.

    Raises:
        Avs3dError: if the room is too small for the objects, their motion or the walk.
    """
    camera = plan.camera
    site = site or Site.of(home, plan.spec.room)
    placements, motions = place_objects(plan, site)
    task = WalkTask(
        site,
        placements,
        frames=camera.frames,
        height=camera.height,
        hfov=camera.hfov,
        motions=motions,
        navigable=navigable,
        alike=copies_of(placements) if plan.spec.twins == "alike" else (),
    )
    walk = plan_walk(task, plan.rng("path"))
    if plan.spec.agent == "walking":
        return Arrangement(placements, walk.poses, walk.notes, motions)
    turns = plan.spec.agent == "turning"
    poses = stay(walk.poses, plan.rng("agent"), turns=turns, motions=motions, name=site.name)
    # What the walk would have seen says nothing of what is seen from one place.
    return Arrangement(placements, poses, tuple(one.relaxed for one in placements if one.relaxed), motions)


def copies_of(placements: Sequence[Placement]) -> tuple[tuple[int, ...], ...]:
    """Indices of the placements of each model that has several."""
    same: dict[int, list[int]] = {}
    for index, placement in enumerate(placements):
        same.setdefault(id(placement.model), []).append(index)
    return tuple(tuple(indices) for indices in same.values() if len(indices) > 1)


def draw_instances(plan: ObservationPlan, categories: Sequence[str]) -> tuple[int | None, ...]:
    """Draw the instance of each source of a plan, from 1; None for one off-screen.

    Args:
        plan: of the observation.
        categories: of the placed objects, in the order of their ids.
    """
    specs, stream = plan.spec.sounding, rules_of(plan.spec.part).instance_stream
    same: dict[str, list[int]] = {}
    for number, category in enumerate(categories, start=1):
        same.setdefault(category, []).append(number)
    taken = {same[s.category][s.instance - 1] for s in specs if s.room is None and s.instance is not None}
    found: list[int | None] = []
    for number, spec in enumerate(specs, start=1):
        if spec.room is not None:
            found.append(None)
        elif spec.instance is not None:
            found.append(same[spec.category][spec.instance - 1])
        else:
            free = [one for one in same[spec.category] if one not in taken]
            drawn = free[int(plan.own_rng(stream.format(number=number)).integers(len(free)))]
            found.append(drawn)
            taken.add(drawn)
    return tuple(found)


def draw_sounding(plan: ObservationPlan, placements: Sequence[Placement]) -> int:
    """The instance, from 1, of the only source of a plan; see `draw_instances`."""
    (instance,) = draw_instances(plan, [placement.model.category for placement in placements])
    assert instance is not None
    return instance


def place_objects(plan: ObservationPlan, site: Site) -> tuple[tuple[Placement, ...], tuple[Motion, ...]]:
    """The objects at time 0 in the order of their ids, and the motions of those that are to move."""
    rng = plan.rng("placement")
    models, rules = choose_models(plan), placement_rules(plan)
    # The ids must reveal neither the order of placement nor that of the manifest.
    order = plan.rng("ids").permutation(len(models)).tolist()
    models = tuple(models[index] for index in order)
    if not plan.moves:
        span = TWIN_SPAN if plan.spec.twins == "alike" else math.inf
        return place(site, models, rng=rng, rules=rules, span=span), ()
    standing = {id(model): movable(model) for model in models}
    models = tuple(standing[id(model)] for model in models)
    for attempt in range(PLACES_TO_MOVE):
        placements = place(site, models, rng=rng, rules=rules)
        moving = choose_moving(plan, placements)
        try:
            motions = plan_motions(site, placements, moving, seconds=plan.camera.frames, rng=plan.rng("motion"))
        except Avs3dError:
            # Another place may leave more room.
            if attempt == PLACES_TO_MOVE - 1:
                raise
            continue
        break
    starts = {motion.index: motion.start for motion in motions}
    return tuple(starts.get(number, placement) for number, placement in enumerate(placements)), motions


def choose_moving(plan: ObservationPlan, placements: Sequence[Placement]) -> tuple[int, ...]:
    """Indices of the objects that move: all of the categories that a part_3 manifest names; else the one that sounds.

    In part_3 this does not depend on the sources: siblings, which have other ones, have the same motions.
    """
    if plan.spec.is_part_3:
        return tuple(index for index, one in enumerate(placements) if one.model.category in plan.spec.moving)
    return (draw_sounding(plan, placements) - 1,)


def choose_models(plan: ObservationPlan) -> tuple[Model, ...]:
    """One model per object, sorted by category; identical copies share one model.

    Of the silent categories of part_1 and part_2, each object is a model of its own; in part_3 all copies of
    one category are identical.

    Each category has its own random stream, so its model is the same whether it sounds or not.
    """
    spec = plan.spec
    models: list[Model] = []
    for category, count in spec.objects.items():
        rng = plan.rng(f"models/{category}")
        if spec.is_part_3 or category == spec.category:
            models += [_choose_model(plan, category, rng, spec.variant)] * count
        else:
            models += [_choose_model(plan, category, rng) for _ in range(count)]
    return tuple(models)


def placement_rules(plan: ObservationPlan) -> dict[str, Rule]:
    """The usual places of the categories, those that the manifest adds included."""
    own = {
        name: Rule(
            stands_on=spec.stands_on,
            gap=spec.wall_gap,
            free=spec.free,
            jitter=spec.turn,
            wall_heights=spec.wall_height,
        )
        for name, spec in plan.categories.items()
    }
    return RULES | own


def _choose_model(plan: ObservationPlan, category: str, rng: Generator, variant: str | None = None) -> Model:
    """A model of a category, from the manifest's files or the procedural catalogue."""
    files = plan.objects.get(category, ())
    if files:
        chosen = files[int(rng.integers(len(files)))]
        own = plan.categories.get(category)
        return load_object(plan, category, chosen, float(rng.uniform(*own.height)) if own else None)
    return build(category, variant, seed=rng, among=plan.models.get(category, ()))


def load_object(plan: ObservationPlan, category: str, chosen: ObjectSpec, height: float | None = None) -> Model:
    """The model of a file or asset of the manifest.

    Args:
        plan: of the observation.
        category: of the object.
        chosen: an entry of the manifest's ``objects``.
        height: of a category of the manifest's own: what is drawn for a file or asset that has no height (m).

    Raises:
        Avs3dError: if the file is missing or broken.
    """
    own = plan.categories.get(category)
    usual = (
        usual_of(category) if own is None else CategoryDefaults(height or own.height[0], own.mount, own.source_height)
    )
    if chosen.asset is not None:
        path, entry = open_asset(plan.lock, chosen.asset)
        usual = usual._replace(mount=entry.mount or usual.mount)
        model = load_model(path, category, licence=entry.terms, height=entry.height or height, usual=usual)
        return replace(model, name=entry.id)
    path = resolve_file(plan.base, str(chosen.file), f"mesh for {category}")
    licence = file_licence(chosen)
    return load_model(path, category, licence=licence, height=chosen.height or height, usual=usual)


def file_licence(spec: ObjectSpec | SoundSpec) -> Licence:
    """The licence that the manifest gives for a file."""
    assert spec.file is not None
    assert spec.licence is not None
    return Licence(spec.licence.name, spec.licence.author, spec.licence.source or spec.file)
