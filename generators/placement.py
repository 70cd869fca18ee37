"""Objects where they belong: on their support, clear of everything, facing the room, in sight of a walking agent.

`place` collects spots for a model (generators/spots.py), tries them in random order and keeps the first that passes
every test of `Placer.fault`. Twins (identical copies, one of which sounds) stand at least a metre apart where the room
allows; a silent oven joins a sounding microwave (the paper's hard pair).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.boxes import UprightBox, yaw_matrix
from generators.freespace import CELL, SENSOR_HEIGHT, distance_to_polygon
from generators.scenes.scene import Mesh, Part, Scene, Support, SupportKind
from generators.spots import Site, Spot, against_wall, on_top, on_wall, open_floor

if TYPE_CHECKING:
    from generators.assets.catalogue import Model

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

#: Twins stand this far apart (centres, metres); the later ones are tried only if the room has no place for the first.
TWIN_DISTANCES = (1.0, 0.7, 0.5)
#: The silent oven stands this near the sounding microwave (centres, metres).
HARD_PAIR = ("microwave", "oven", 0.5, 1.0)
#: A triangle may reach this far into an object's box: contact is not collision.
SKIN = 0.002
#: Objects keep this distance from one another, metres.
ELBOW_ROOM = 0.03
#: Nothing stands nearer to a doorway, metres.
DOOR_ZONE = 0.6
#: The largest connected free floor that must remain: this share of what was there, or this many m².
KEEP_SHARE, KEEP_AREA = 0.8, 1.2
#: An object counts as visible from a place 0.7–3 m away that sees half of its front; this floor area must, m².
VIEW_NEAR, VIEW_FAR, VIEW_AREA = 0.7, 3.0, 0.30
#: … and these places must spread over this angle as seen from the object, degrees.
VIEW_SPREAD = 35.0
_MOST_SPOTS = 500
_RESTARTS = 12


@dataclass(frozen=True)
class Rule:
    """Where a category belongs.

    Attributes:
        surfaces: kinds of support in the order of preference; those of one tier are mixed.
        gap: metres between the back and the wall, for what stands on the floor against a wall.
        free: stands on open floor instead.
        jitter: largest deviation of the yaw, degrees.
        rear: how strongly the back of a worktop is preferred (0–1).
    """

    surfaces: tuple[tuple[SupportKind, ...], ...] = (("worktop", "side_table", "shelf"),)
    gap: tuple[float, float] = (0.01, 0.03)
    free: bool = False
    jitter: float = 5.0
    rear: float = 0.3


_KITCHEN_TOP: tuple[tuple[SupportKind, ...], ...] = (("worktop",), ("side_table", "shelf"))
RULES = {
    "washing_machine": Rule(),
    "toilet": Rule(gap=(0.0, 0.0)),
    "vacuum_cleaner": Rule(free=True, jitter=30.0),
    "microwave": Rule(_KITCHEN_TOP, jitter=3.0, rear=0.8),
    "oven": Rule(_KITCHEN_TOP, jitter=2.0, rear=0.8),
    "coffee_machine": Rule(_KITCHEN_TOP, jitter=8.0, rear=0.7),
    "clock": Rule((("shelf", "side_table"), ("worktop",)), jitter=12.0, rear=0.4),
    "telephone": Rule((("side_table",), ("shelf", "worktop")), jitter=15.0),
}
#: Middle of a wall clock above the floor, metres.
WALL_HEIGHTS = (1.5, 1.9)


@dataclass(frozen=True, eq=False)
class Placement:
    """A model in the room.

    Attributes:
        model: what stands there.
        support: what it stands on or hangs from.
        position: world coordinates of the model's origin, metres.
        yaw: radians about +Y; the front looks along (sin yaw, 0, cos yaw).
        sounding: whether it is the one that sounds.
        relaxed: what could not be had as asked ("" = nothing).
    """

    model: Model
    support: Support
    position: Vector
    yaw: float
    sounding: bool
    relaxed: str = ""

    @cached_property
    def mesh(self) -> Mesh:
        """The mesh in world coordinates."""
        return self.model.mesh.transformed(yaw_matrix(self.yaw), np.asarray(self.position))

    @property
    def source_position(self) -> Vector:
        """Where its sound comes from, world coordinates."""
        x, y, z = yaw_matrix(self.yaw) @ np.asarray(self.model.source_point) + np.asarray(self.position)
        return float(x), float(y), float(z)

    @property
    def bounds(self) -> NDArray[np.float32]:
        """(2, 3) lowest and highest corner of the mesh in world coordinates."""
        return self.mesh.bounds

    @cached_property
    def box(self) -> UprightBox:
        """The box around it, turned with it."""
        return UprightBox.around(self.model.mesh, self.position, self.yaw)

    @property
    def front(self) -> Array:
        """(3,) the direction it looks."""
        return np.array([math.sin(self.yaw), 0.0, math.cos(self.yaw)])

    def part(self, instance_id: int) -> Part:
        """The part to add to a scene."""
        model = self.model
        name = f"{model.category}_{instance_id}"
        return Part(name, self.mesh, instance_id=instance_id, category=model.category, licence=model.licence)


def place(
    scene: Scene,
    room: str,
    sounding: Model,
    *,
    instances: int = 1,
    silent: Sequence[Model] = (),
    rng: Generator,
) -> tuple[Placement, ...]:
    """Find places for all objects of an observation.

    Args:
        scene: the home, without objects.
        room: name of the room.
        sounding: the sounding model.
        instances: number of identical copies of it; which one sounds is random.
        silent: further models that stand by silently.
        rng: the only source of randomness.

    Returns:
        The copies, then the silent others, in the order given.

    Raises:
        Avs3dError: one line with the category, the room, what failed how often, and what to do.
    """
    if instances < 1:
        raise Avs3dError(f"{scene.name}/{room}: {instances} instances of {sounding.category} asked for; expected ≥ 1")
    placer = Placer(Site.of(scene, room))
    copies = placer.twins(sounding, instances, rng)
    chosen = int(rng.integers(instances))
    copies = [replace(copy, sounding=index == chosen) for index, copy in enumerate(copies)]
    others: list[Placement] = []
    for model in silent:
        others.append(placer.companion(model, copies[chosen], [*copies, *others], rng))
    return (*copies, *others)


@dataclass(eq=False)
class Placer:
    """Tests spots in one room and remembers the answers; ``tried`` counts the reasons of refusal."""

    site: Site
    tried: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._alone: dict[int, str] = {}
        self._area = self.site.space.largest().area

    def twins(self, model: Model, count: int, rng: Generator) -> list[Placement]:
        """``count`` copies of ``model``, far enough from one another.

        Raises:
            Avs3dError: if the room has no room for them.
        """
        self.tried.clear()
        tiers = self.spots(model, rng)
        fronts = _front_points(model)
        for distance in TWIN_DISTANCES[: 1 if count == 1 else None]:
            for depth in range(1, len(tiers) + 1):
                spots = [spot for tier in tiers[:depth] for spot in tier]
                found = self._spread(model, spots, fronts, count, distance)
                if found:
                    if distance < TWIN_DISTANCES[0]:
                        note = f"{count} × {model.category} stand {distance} m apart: no room for {TWIN_DISTANCES[0]} m"
                        found[0] = replace(found[0], relaxed=note)
                    return found
        raise self._error(model, count, sum(len(tier) for tier in tiers))

    def companion(self, model: Model, source: Placement, placed: Sequence[Placement], rng: Generator) -> Placement:
        """A silent model; an oven stands near a sounding microwave.

        Raises:
            Avs3dError: if the room has no room for it.
        """
        self.tried.clear()
        spots = [spot for tier in self.spots(model, rng) for spot in tier]
        fronts = _front_points(model)
        loud, quiet, least, most = HARD_PAIR
        relaxed = ""
        if (source.model.category, model.category) == (loud, quiet):
            pair = [s for s in spots if least <= self._gap(model, s, source) <= most]
            for spot in pair:
                if not self.fault(model, spot, fronts, placed):
                    return _placement(model, spot)
            relaxed = f"the silent {quiet} stands more than {most} m from the sounding {loud}: no room beside it"
        for spot in spots:
            if not self.fault(model, spot, fronts, placed):
                return replace(_placement(model, spot), relaxed=relaxed)
        raise self._error(model, 1, len(spots))

    def spots(self, model: Model, rng: Generator) -> list[list[Spot]]:
        """Candidate spots in tiers of preference, each in the order in which they are tried."""
        rule = RULES.get(model.category, Rule())
        site, mesh, jitter = self.site, model.mesh, math.radians(rule.jitter)
        tiers: list[list[Spot]] = []
        if model.mount == "floor":
            floor = site.supports("floor")[0]
            if rule.free:
                tiers.append(open_floor(site, mesh, floor, rng, jitter=jitter))
            else:
                tiers.append(against_wall(site, mesh, floor, rng, gap=rule.gap))
        if model.mount in ("surface", "wall_or_surface"):
            for kinds in rule.surfaces:
                supports = [support for kind in kinds for support in site.supports(kind)]
                tiers.append([s for p in supports for s in on_top(site, mesh, p, rng, jitter=jitter, rear=rule.rear)])
        if model.mount in ("wall", "wall_or_surface"):
            walls = site.supports("wall")
            hung = [s for wall in walls for s in on_wall(site, mesh, wall, rng, heights=WALL_HEIGHTS)]
            tiers.insert(int(rng.integers(2)) if tiers else 0, hung)
        return [sorted(tier, key=lambda spot: spot.rank)[:_MOST_SPOTS] for tier in tiers if tier]

    def fault(self, model: Model, spot: Spot, fronts: Array, placed: Sequence[Placement]) -> str:
        """Why ``model`` cannot stand at ``spot`` beside what is ``placed``; "" if it can."""
        box = UprightBox.around(model.mesh, spot.position, spot.yaw)
        reason = self._alone.get(id(spot))
        if reason is None:
            reason = self._fault_alone(model, spot, box, fronts)
            self._alone[id(spot)] = reason
            self._kept.append(spot)
        if not reason and placed:
            if any(box.grown(ELBOW_ROOM).hits_box(other.box) for other in placed):
                reason = "touches another object"
            else:
                boxes = [other.box for other in placed]
                reason = self._blocks([box, *boxes])
                for index, other in enumerate(placed):
                    if reason:
                        break
                    others = [box, *boxes[:index], *boxes[index + 1 :]]
                    reason = "hides another object" if self._hidden(other, _front_points(other.model), others) else ""
                if not reason and self._hidden(_placement(model, spot), fronts, boxes):
                    reason = "is hidden by another object"
        if reason:
            self.tried[reason] += 1
        return reason

    @cached_property
    def _kept(self) -> list[Spot]:
        """Spots that have been judged: kept alive, because their id is the key."""
        return []

    def _fault_alone(self, model: Model, spot: Spot, box: UprightBox, fronts: Array) -> str:
        if box.grown(-SKIN).hits_triangles(self.site.triangles).any():
            return "collides with the room"
        on_floor = spot.support.kind == "floor"
        if on_floor and len(self.site.doors) and distance_to_polygon(self.site.doors, box.footprint).min() < DOOR_ZONE:
            return "stands in a doorway"
        return self._blocks([box]) or ("is hidden" if self._hidden(_placement(model, spot), fronts, []) else "")

    def _blocks(self, boxes: Sequence[UprightBox]) -> str:
        left = self.site.space.without([box.footprint for box in boxes]).largest().area
        return "" if left >= KEEP_SHARE * self._area or left >= KEEP_AREA else "blocks the way"

    def _hidden(self, placement: Placement, fronts: Array, others: Sequence[UprightBox]) -> bool:
        """Whether too little free floor has a view of the object's front."""
        points = fronts @ yaw_matrix(placement.yaw).T + np.asarray(placement.position)
        centre = placement.box.centre
        space = self.site.space.without([placement.box.footprint, *(box.footprint for box in others)]).largest()
        offsets = space.points - centre[[0, 2]]
        distance = np.linalg.norm(offsets, axis=1)
        eligible = (distance >= VIEW_NEAR) & (distance <= VIEW_FAR) & (offsets @ placement.front[[0, 2]] > 0)
        cells = space.points[eligible]
        step = max(1, len(cells) // 80)
        eyes = cells[::step]
        if not len(eyes):
            return True
        eye = np.insert(eyes, 1, self.site.space.floor + SENSOR_HEIGHT, axis=1)
        starts, ends = np.repeat(eye, len(points), axis=0), np.tile(points, (len(eye), 1))
        blocked = self.site.caster.occluded(starts, ends - starts, 0.999)
        for box in others:
            blocked |= box.blocks(starts, ends)
        sees = 1 - blocked.reshape(len(eye), -1).mean(axis=1) >= 0.5
        if sees.sum() * step * CELL * CELL < VIEW_AREA:
            return True
        bearings = np.degrees(np.arctan2(*(eyes[sees] - centre[[0, 2]]).T))
        ahead = (bearings - math.degrees(placement.yaw) + 180) % 360 - 180
        return bool(np.ptp(ahead) < VIEW_SPREAD)

    def _spread(
        self, model: Model, spots: Sequence[Spot], fronts: Array, count: int, distance: float
    ) -> list[Placement]:
        """``count`` placements with their centres at least ``distance`` apart, or none."""
        for first in _first(self._valid(model, spots, fronts), _RESTARTS):
            chosen = [_placement(model, first)]
            for spot in spots:
                if len(chosen) == count:
                    break
                if min(self._gap(model, spot, other) for other in chosen) < distance:
                    self.tried["too near a twin"] += 1
                elif not self.fault(model, spot, fronts, chosen):
                    chosen.append(_placement(model, spot))
            if len(chosen) == count:
                return chosen
        return []

    def _valid(self, model: Model, spots: Sequence[Spot], fronts: Array) -> Iterator[Spot]:
        return (spot for spot in spots if not self.fault(model, spot, fronts, []))

    @staticmethod
    def _gap(model: Model, spot: Spot, other: Placement) -> float:
        centre = UprightBox.around(model.mesh, spot.position, spot.yaw).centre
        return float(np.linalg.norm(centre - other.box.centre))

    def _error(self, model: Model, count: int, spots: int) -> Avs3dError:
        what = model.category if count == 1 else f"{count} × {model.category}"
        if not self.site.space.walkable.any():
            why = "it has no free floor"
        elif not spots:
            kinds = {"floor": "level floor, for most things along a wall", "wall": "free wall"}
            why = f"it has no {kinds.get(model.mount, 'worktop, table or shelf')} that takes {_size(model)}"
        else:
            reasons = ", ".join(f"{n} {reason}" for reason, n in sorted(self.tried.items(), key=lambda i: (-i[1], i[0])))
            why = f"of {spots} spots {reasons or 'none passed'}"
        return Avs3dError(
            f"{self.site.name}: no place for {what} ({model.name}): {why}; choose another room, fewer objects or a"
            " smaller model"
        )


def _size(model: Model) -> str:
    return "×".join(f"{v:.2f}" for v in np.diff(model.mesh.bounds, axis=0)[0]) + " m"


def _placement(model: Model, spot: Spot) -> Placement:
    x, y, z = (float(c) for c in spot.position)
    return Placement(model, spot.support, (x, y, z), spot.yaw, sounding=False)


def _first(items: Iterator[Spot], count: int) -> Iterator[Spot]:
    for _, item in zip(range(count), items, strict=False):
        yield item


def _front_points(model: Model, count: int = 24) -> Array:
    """(count, 3) points spread by area over the faces that look forward, in the model's frame, 1 cm in front of them."""
    triangles = model.mesh.positions.astype(np.float64)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    weight = np.maximum(normals[:, 2], 0.0)
    if weight.sum() <= 0:
        low, high = model.mesh.bounds.astype(np.float64)
        return np.tile((low + high) / 2, (count, 1)) + (0, 0, (high[2] - low[2]) / 2 + 0.01)
    edges = np.cumsum(weight) / weight.sum()
    faces = np.minimum(np.searchsorted(edges, (np.arange(count) + 0.5) / count), len(triangles) - 1)
    # Points of the plastic-number sequence, folded into the triangle: even without randomness.
    r, s = ((0.5 + np.arange(1, count + 1) * step) % 1.0 for step in (0.7548776662466927, 0.5698402909980532))
    r, s = np.where(r + s > 1, 1 - r, r), np.where(r + s > 1, 1 - s, s)
    a, b, c = (triangles[faces, k] for k in range(3))
    return np.asarray(a + r[:, None] * (b - a) + s[:, None] * (c - a) + (0.0, 0.0, 0.01))
