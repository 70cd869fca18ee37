"""Places the objects: on a suitable support, without collision, facing the room, visible to a walking agent.

`place` collects spots for a model (generators/placement/spots.py), tries them in random order and keeps the first
that passes every test of generators/placement/fitting.py. Twins (identical copies) are at least a metre apart if the
room allows; an oven and a microwave are side by side (the paper's hard pair).

The sounding object is drawn later (generators.observation.arrangement), so that no place can reveal it.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from avs3d_bench.errors import Avs3dError
from generators.core.boxes import UprightBox, yaw_matrix
from generators.core.scene import Mesh, Part, Support, SupportKind
from generators.placement.contact import Sole, settle
from generators.placement.fitting import Body, RoomFitting, front_points, turned_about
from generators.placement.site import Site
from generators.placement.spots import Spot, against_wall, on_top, on_wall, open_floor

if TYPE_CHECKING:
    from generators.assets.model import Model
    from generators.assets.objects.design import Mount

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Fit = tuple[Spot, Body]

#: Least distances between the centres of twins (m); each is tried only if the room has no places for those before it.
TWIN_DISTANCES = (1.0, 0.7, 0.5)
#: Largest distance between the centres of twins that are to be alike in distance from most of the floor (m).
TWIN_SPAN = 1.5
#: Two categories that are easily confused, and the range of the distance between their centres (m).
HARD_PAIR, PAIR_DISTANCE = ("microwave", "oven"), (0.5, 1.0)
#: Number of spots of a model that are tested, at first and at most; least distance between two of them (m).
_POOLS, _THINNING = (40, 160), 0.08
#: Limits of the search for twins: number of branches followed, and of complete sets tested.
_BRANCHES, _SETS = 20_000, 24
#: Number of attempts to move the objects that were placed first, to make room for later ones.
_ATTEMPTS = 6


#: Middle of a wall clock above the floor, metres.
WALL_HEIGHTS = (1.5, 1.9)


#: Kinds of support on which a model of each mount can stand or hang. Models for the floor and for surfaces have the
#: same frame; "surface" means "any level one" here, because an object may prefer a table and make do with the floor.
_KINDS: dict[Mount, tuple[SupportKind, ...]] = {
    "floor": ("floor",),
    "surface": ("floor", "worktop", "shelf", "side_table"),
    "wall": ("wall",),
    "wall_or_surface": ("floor", "worktop", "shelf", "side_table", "wall"),
}


@dataclass(frozen=True)
class Rule:
    """The usual places of a category.

    Attributes:
        surfaces: kinds of support in the order of preference; kinds of one tier are equally good.
        gap: range of the distance between the back and the wall, metres, for objects on the floor against a wall.
        free: whether the object stands on open floor instead.
        jitter: largest deviation of the yaw, degrees.
        rear: how strongly the back of a worktop is preferred (0–1).
        stands_on: kinds of support, floor and wall included, in the order of preference; they take the place of what
            the model's mount and ``surfaces`` say. Kinds on which its mount does not let it stand are left out.
        wall_heights: range of the middle of an object on a wall above the floor, metres.
    """

    surfaces: tuple[tuple[SupportKind, ...], ...] = (("worktop", "side_table", "shelf"),)
    gap: tuple[float, float] = (0.01, 0.03)
    free: bool = False
    jitter: float = 5.0
    rear: float = 0.3
    stands_on: tuple[SupportKind, ...] = ()
    wall_heights: tuple[float, float] = WALL_HEIGHTS

    def kinds(self, mount: Mount) -> tuple[SupportKind, ...]:
        """The kinds of ``stands_on`` that suit the mount of a model."""
        return tuple(kind for kind in self.stands_on if kind in _KINDS[mount])


_KITCHEN_TOP: tuple[tuple[SupportKind, ...], ...] = (("worktop",), ("side_table", "shelf"))
RULES = {
    "washing_machine": Rule(),
    "toilet": Rule(gap=(0.0, 0.0)),
    "vacuum_cleaner": Rule(free=True, jitter=30.0),
    "microwave": Rule(_KITCHEN_TOP, jitter=3.0, rear=0.8),
    "oven": Rule(_KITCHEN_TOP, jitter=2.0, rear=0.8),
    "dishwasher": Rule(),
    "kettle": Rule(_KITCHEN_TOP, jitter=60.0, rear=0.6),
    "fan": Rule(gap=(0.03, 0.12), jitter=30.0, stands_on=("side_table", "shelf", "worktop", "floor")),
    "radio": Rule((("shelf", "side_table"), ("worktop",)), jitter=12.0, rear=0.5),
    "coffee_machine": Rule(_KITCHEN_TOP, jitter=8.0, rear=0.7),
    "clock": Rule((("shelf", "side_table"), ("worktop",)), jitter=12.0, rear=0.4),
    "telephone": Rule((("side_table",), ("shelf", "worktop")), jitter=15.0),
}


@dataclass(frozen=True, eq=False)
class Placement:
    """A model placed in the room.

    Attributes:
        model: the model.
        support: the surface on which it stands or hangs.
        position: world coordinates of the model's origin, metres.
        yaw: radians about +Y; the front looks along (sin yaw, 0, cos yaw).
        tilt: rotation vector (radians, world axes) applied after the yaw; zero but on scans, where it is at most 2°.
        relaxed: which constraint was relaxed ("" = none).
    """

    model: Model
    support: Support
    position: Vector
    yaw: float
    relaxed: str = ""
    tilt: Vector = (0.0, 0.0, 0.0)

    @property
    def rotation(self) -> Array:
        """(3, 3) rotation from the model's axes to the world's."""
        turn = tilt_matrix(self.tilt)
        return yaw_matrix(self.yaw) if turn is None else np.asarray(turn @ yaw_matrix(self.yaw))

    @cached_property
    def mesh(self) -> Mesh:
        """The mesh in world coordinates."""
        return self.model.mesh.transformed(self.rotation, np.asarray(self.position))

    @property
    def source_position(self) -> Vector:
        """(3,) position of its sound source, world coordinates, metres."""
        x, y, z = self.rotation @ np.asarray(self.model.source_point) + np.asarray(self.position)
        return float(x), float(y), float(z)

    @property
    def bounds(self) -> NDArray[np.float32]:
        """(2, 3) lowest and highest corner of the mesh in world coordinates."""
        return self.mesh.bounds

    @cached_property
    def box(self) -> UprightBox:
        """The upright bounding box, turned by its yaw; of a tilted object that of its upright pose, at its centre."""
        upright = UprightBox.around(self.model.mesh, self.position, self.yaw)
        return turned_about(upright, self.position, tilt_matrix(self.tilt))

    @property
    def front(self) -> Array:
        """(3,) unit vector in the direction of its front."""
        return np.array([math.sin(self.yaw), 0.0, math.cos(self.yaw)])

    def part(self, instance_id: int) -> Part:
        """The part to add to a scene."""
        model = self.model
        name = f"{model.category}_{instance_id}"
        return Part(name, self.mesh, instance_id=instance_id, category=model.category, licence=model.licence)


def place(
    site: Site,
    models: Sequence[Model],
    *,
    rng: Generator,
    rules: Mapping[str, Rule] = RULES,
    span: float = math.inf,
    there: Sequence[Placement] = (),
) -> tuple[Placement, ...]:
    """Find places for several objects in a room.

    The order of ``models`` does not influence the places: copies of one model are placed first, the others in a random
    order, so that no model is preferred.

    Args:
        site: the room, measured without the objects.
        models: one per object; a model that is listed several times is placed in as many identical copies.
        rng: the only source of randomness.
        rules: category → its usual places; categories without an entry have those of `Rule`.
        span: largest distance between the centres of any two copies of a model, metres.
        there: objects that stand in the room already, and stay.

    Returns:
        The places, in the order of ``models``.

    Raises:
        Avs3dError: one line with the category, the room, how often each test failed, and what to do.
    """
    if not models:
        raise Avs3dError(f"{site.name}: no objects to place; expected at least one")
    groups = _groups(models)
    placer = Placer(site, rules, span)
    found: dict[int, list[Placement]] = {}
    for attempt in range(_ATTEMPTS):
        last = attempt == _ATTEMPTS - 1
        order = sorted(rng.permutation(len(groups)).tolist(), key=lambda number: -len(groups[number]))
        found = {}
        placed = list(there)
        try:
            for number in order:
                found[number] = placer.copies(models[groups[number][0]], len(groups[number]), placed, rng)
                placed += found[number]
        except Avs3dError:
            # A model that finds no place in the empty room will not find one later.
            if last or not found:
                raise
            continue
        # Earlier objects may occupy the only places of later ones: they are moved before a constraint is relaxed.
        if last or not any(placement.relaxed for placement in placed[len(there) + len(found[order[0]]) :]):
            break
    where = {index: place for n, group in enumerate(groups) for index, place in zip(group, found[n], strict=True)}
    return tuple(where[index] for index in range(len(models)))


def _groups(models: Sequence[Model]) -> list[list[int]]:
    """Indices of the copies of each model; the groups are in an order that does not depend on that of ``models``."""
    groups: dict[int, list[int]] = {}
    for index, model in enumerate(models):
        groups.setdefault(id(model), []).append(index)
    return sorted(groups.values(), key=lambda group: (models[group[0]].category, models[group[0]].name))


class Placer:
    """The search for places in one room."""

    def __init__(self, site: Site, rules: Mapping[str, Rule] = RULES, span: float = math.inf) -> None:
        self.site = site
        self.rules = rules
        self.span = span
        self.fitting = RoomFitting(site)
        self.refused: Counter[str] = Counter()

    def copies(self, model: Model, count: int, placed: Sequence[Placement], rng: Generator) -> list[Placement]:
        """Place ``count`` copies of ``model`` in addition to the objects already ``placed``.

        Raises:
            Avs3dError: if the room has no places for them.
        """
        self.refused.clear()
        bodies = [_body(other.model, other.position, other.yaw, other.tilt) for other in placed]
        if count == 1:
            return [self._single(model, placed, bodies, rng)]
        tiers = [_Pool(self, model, spots) for spots in self.spots(model, rng)]
        for distance in TWIN_DISTANCES:
            for depth, most in itertools.product(range(1, len(tiers) + 1), _POOLS):
                fits = [fit for tier in tiers[:depth] for fit in tier.first(most)]
                chosen = self._apart(fits, count, distance, bodies)
                if chosen:
                    found = [_placement(model, spot) for spot, _ in chosen]
                    if distance < TWIN_DISTANCES[0]:
                        note = f"{count} × {model.category} stand {distance} m apart: no room for {TWIN_DISTANCES[0]} m"
                        found[0] = replace(found[0], relaxed=note)
                    return found
        places = sum(len(tier.first(_POOLS[-1])) for tier in tiers)
        if places:
            within = "" if math.isinf(self.span) else f" to {self.span:g}"
            why = f"suit one object, but no {count} of them fit together, {TWIN_DISTANCES[-1]}{within} m apart"
            self.refused[why] = places
        raise self._error(model, count, sum(len(tier.spots) for tier in tiers))

    def _single(self, model: Model, placed: Sequence[Placement], bodies: Sequence[Body], rng: Generator) -> Placement:
        """Place one object; one half of a hard pair is placed near the other half if that is placed already."""
        pool = _Pool(self, model, [spot for tier in self.spots(model, rng) for spot in tier])
        partners = _partners(model, placed)
        rounds = [(np.zeros(3), 0.0, math.inf, "")]
        if partners:
            partner = partners[int(rng.integers(len(partners)))]
            one, other = HARD_PAIR
            note = f"no {one} and {other} stand {PAIR_DISTANCE[0]}–{PAIR_DISTANCE[1]} m from one another: no room"
            rounds = [(partner.box.centre, *PAIR_DISTANCE, ""), (np.zeros(3), 0.0, math.inf, note)]
        for centre, near, far, relaxed in rounds:
            for spot, body in pool.between(centre, near, far):
                reason = self.fitting.fault_together([body, *bodies]) if bodies else ""
                if not reason:
                    return replace(_placement(model, spot), relaxed=relaxed)
                self.refused[reason] += 1
        raise self._error(model, 1, len(pool.spots))

    def spots(self, model: Model, rng: Generator) -> list[list[Spot]]:
        """Candidate spots in tiers of preference; each tier is in the order of the attempts."""
        rule = self.rules.get(model.category, Rule())
        tiers: list[list[Spot]] = []
        if rule.stands_on:
            tiers += [self._on(kind, model, rule, rng) for kind in rule.kinds(model.mount)]
            return _sorted(tiers)
        if model.mount == "floor":
            tiers.append(self._on("floor", model, rule, rng))
        if model.mount in ("surface", "wall_or_surface"):
            for kinds in rule.surfaces:
                tiers.append([spot for kind in kinds for spot in self._on(kind, model, rule, rng)])
        if model.mount in ("wall", "wall_or_surface"):
            hung = self._on("wall", model, rule, rng)
            tiers.insert(int(rng.integers(2)) if tiers else 0, hung)
        return _sorted(tiers)

    def _on(self, kind: SupportKind, model: Model, rule: Rule, rng: Generator) -> list[Spot]:
        """Candidate spots on the supports of one kind, not sorted."""
        site, mesh, jitter = self.site, model.mesh, math.radians(rule.jitter)
        supports = site.supports(kind)
        if kind == "wall":
            return [s for wall in supports for s in on_wall(site, mesh, wall, rng, heights=rule.wall_heights)]
        if kind != "floor":
            return [s for top in supports for s in on_top(site, mesh, top, rng, jitter=jitter, rear=rule.rear)]
        if rule.free:
            return [s for floor in supports[:1] for s in open_floor(site, mesh, floor, rng, jitter=jitter)]
        return [s for floor in supports[:1] for s in against_wall(site, mesh, floor, rng, gap=rule.gap)]

    def _apart(self, fits: Sequence[Fit], count: int, distance: float, bodies: Sequence[Body]) -> list[Fit]:
        """The first ``count`` of ``fits`` that are ``distance`` metres apart and fit together with ``bodies``, or none.

        No two are more than the span apart. The search is depth-first.
        """
        if len(fits) < count:
            return []
        centres = np.array([body.centre for _, body in fits])
        between = np.linalg.norm(centres[:, None] - centres, axis=2)
        apart = (between >= distance) & (between <= self.span)
        branches, sets = 0, 0
        for first in range(len(fits)):
            stack = [([first], apart[first].copy())]
            while stack:
                chosen, free = stack.pop()
                branches += 1
                if len(chosen) == count:
                    sets += 1
                    if not self.fitting.fault_together([*(fits[k][1] for k in chosen), *bodies]):
                        return [fits[k] for k in chosen]
                    break
                if branches > _BRANCHES or sets > _SETS:
                    return []
                later = np.flatnonzero(free)
                later = later[later > (chosen[-1] if len(chosen) > 1 else -1)]
                for k in later[::-1]:
                    stack.append(([*chosen, int(k)], free & apart[k]))
        return []

    def _error(self, model: Model, count: int, spots: int) -> Avs3dError:
        what = model.category if count == 1 else f"{count} × {model.category}"
        if not self.site.space.walkable.any():
            why = "it has no free floor"
        elif not spots:
            kinds = {"floor": "level floor (most categories need it along a wall)", "wall": "free wall"}
            rule = self.rules.get(model.category, Rule())
            usual = kinds.get(model.mount, "worktop, table or shelf")
            low, high = rule.wall_heights
            named = {"side_table": "table", "wall": f"wall from {low:g} to {high:g} m above the floor"}
            wanted = " or ".join(named.get(kind, kind) for kind in rule.kinds(model.mount)) or usual
            why = f"it has no {wanted} large enough for {_size(model)}"
            if rule.stands_on and not rule.kinds(model.mount):
                why = f"its mount is {model.mount}, but its category stands on {' or '.join(rule.stands_on)}"
        else:
            counts = sorted(self.refused.items(), key=lambda item: (-item[1], item[0]))
            why = f"of {spots} spots " + ", ".join(f"{number} {reason}" for reason, number in counts)
        return Avs3dError(
            f"{self.site.name}: no place for {what} ({model.name}): {why}; choose another room, fewer objects or a"
            " smaller model"
        )


class _Pool:
    """The fitting spots of one tier, tested on demand and thinned out."""

    def __init__(self, placer: Placer, model: Model, spots: Sequence[Spot]) -> None:
        self.spots = list(spots)
        self._placer, self._model = placer, model
        self._fronts = front_points(model.mesh)
        self._known: list[str | Body | None] = [None] * len(spots)
        self._soles: dict[bool, Sole] = {}
        self._positions = np.array([spot.position for spot in spots], dtype=np.float64).reshape(-1, 3)

    def _judge(self, index: int) -> Body | None:
        known = self._known[index]
        if known is None:
            known = self._known[index] = self._tested(index)
            if isinstance(known, str):
                self._placer.refused[known] += 1
        return None if isinstance(known, str) else known

    def _tested(self, index: int) -> str | Body:
        """The model at a spot, which is settled first if the room is a scan; or the reason why it does not fit."""
        spot, site = self.spots[index], self._placer.site
        if site.scanned:
            wall = spot.support.kind == "wall"
            if wall not in self._soles:
                self._soles[wall] = Sole.of(self._model.mesh, wall=wall)
            settled = settle(site, self._soles[wall], spot)
            if isinstance(settled, str):
                return settled
            spot = self.spots[index] = settled
        body = Body.of(self._model.mesh, self._fronts, spot.position, spot.yaw, tilt_matrix(spot.tilt))
        return self._placer.fitting.fault_alone(body, spot.support.kind) or body

    def first(self, most: int) -> list[Fit]:
        """The first ``most`` spots that fit and are not next to an earlier one."""
        out: list[Fit] = []
        kept: list[int] = []
        for index in range(len(self.spots)):
            if len(out) == most:
                break
            if _is_apart(self._positions[index], self._positions[kept]):
                body = self._judge(index)
                if body is not None:
                    out.append((self.spots[index], body))
                    kept.append(index)
        return out

    def between(self, centre: Array, near: float, far: float) -> Iterator[Fit]:
        """The spots that fit and whose middle is ``near`` to ``far`` metres from ``centre``."""
        for index, spot in enumerate(self.spots):
            box = UprightBox.around(self._model.mesh, spot.position, spot.yaw)
            if near <= float(np.linalg.norm(box.centre - centre)) <= far:
                body = self._judge(index)
                if body is not None:
                    yield self.spots[index], body


def _sorted(tiers: Sequence[Sequence[Spot]]) -> list[list[Spot]]:
    """Tiers that have spots, each in the order of the attempts."""
    return [sorted(tier, key=lambda spot: spot.rank) for tier in tiers if tier]


def _is_apart(position: Array, others: Array) -> bool:
    """Whether ``position`` (3,) is at least `_THINNING` from each of ``others`` (N, 3)."""
    near = ((others - position) ** 2).sum(axis=1) < _THINNING**2 + 1e-9
    # The sum above may round in another way than a norm does: what is close to the limit is measured by its norm.
    return all(np.linalg.norm(position - other) >= _THINNING for other in others[near])


def _partners(model: Model, placed: Sequence[Placement]) -> list[Placement]:
    """The placed objects that form a hard pair with ``model``."""
    if model.category not in HARD_PAIR:
        return []
    wanted = HARD_PAIR[1 - HARD_PAIR.index(model.category)]
    return [placement for placement in placed if placement.model.category == wanted]


def _body(model: Model, position: ArrayLike, yaw: float, tilt: Vector) -> Body:
    return Body.of(model.mesh, front_points(model.mesh), position, yaw, tilt_matrix(tilt))


def tilt_matrix(tilt: Vector) -> Array | None:
    """(3, 3) rotation of a rotation vector (radians); None for no rotation."""
    return np.asarray(Rotation.from_rotvec(tilt).as_matrix()) if any(tilt) else None


def _size(model: Model) -> str:
    return "×".join(f"{v:.2f}" for v in np.diff(model.mesh.bounds, axis=0)[0]) + " m"


def _placement(model: Model, spot: Spot) -> Placement:
    x, y, z = (float(c) for c in spot.position)
    return Placement(model, spot.support, (x, y, z), spot.yaw, tilt=spot.tilt)
