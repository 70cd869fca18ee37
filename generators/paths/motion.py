"""The paths of moving objects: over the free floor, or to and fro on a worktop.

An object on the floor moves forwards, with a limited speed and a limited rate of turn, wherever a disc around its
footprint fits, so that it can turn anywhere. An object on a worktop, table or shelf slides along it without turning, as
far as the surface is level and free, and slows down at the turning points. An object on a wall does not move.

Paths are drawn one after another. Each keeps clear of those before it at every time: on a worktop it has a stretch of
its own, and over the floor it waits for others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from avs3d_bench.errors import Avs3dError
from generators.assets.model import Model
from generators.core.boxes import UprightBox, yaw_matrix
from generators.core.curves import smooth
from generators.core.freespace import SENSOR_HEIGHT, FreeSpace, distance_to_polygon
from generators.core.rays import RayCaster
from generators.core.scene import Mesh
from generators.paths.pacing import pace
from generators.placement.fitting import ELBOW_ROOM, SKIN
from generators.placement.placement import Placement
from generators.placement.site import Site
from generators.placement.spots import CONTACT, Contact, standing

Array = NDArray[np.float64]

#: Samples of a motion per second; the motion is linear between them.
RATE = 4
#: Limits of a motion over the floor: speed (m/s) and rate of turn (degrees/s).
FLOOR_SPEED, TURN_RATE = (0.12, 0.25), 60.0
#: Limits of a motion on a worktop: largest speed (m/s) and least distance (m).
TOP_SPEED, LEAST_SLIDE = (0.03, 0.06), 0.12
#: Height (m) up to which the object moves over things, such as the edge of a rug.
OVER = 0.02
#: Least area (m²) for the object's middle that a floor path needs.
LEAST_AREA = 0.10
#: Number of paths that are drawn before the room counts as too small.
_ATTEMPTS = 8
#: Least share of its tour that an object covers while it lets others pass.
LEAST_PROGRESS = 0.3
#: Added to the distance between two moving objects (m), because both move between two checks.
_SLACK = 0.05
#: Spacing of the samples along a worktop, and their largest difference in height (m).
_STEP, _LEVEL = 0.01, 0.002


@dataclass(frozen=True, eq=False)
class Motion:
    """The path of a moving object.

    Attributes:
        index: of the object among the placements.
        start: its placement at time 0.
        positions: (RATE·n + 1, 3) the model's origin, `RATE` times a second.
        yaws: (RATE·n + 1,) radians, unwrapped.
    """

    index: int
    start: Placement
    positions: Array
    yaws: Array

    def at(self, seconds: float) -> Placement:
        """Its placement after ``seconds``, at most n."""
        time = np.arange(len(self.yaws)) / RATE
        if not 0.0 <= seconds <= time[-1]:
            raise Avs3dError(f"motion of {self.start.model.category}: no time {seconds} s in 0 to {time[-1]:g} s")
        x, y, z = (float(np.interp(seconds, time, self.positions[:, k])) for k in range(3))
        return replace(self.start, position=(x, y, z), yaw=float(np.interp(seconds, time, self.yaws)))

    def occluded(self, where: Placement, origins: Array, ways: Array, distance: ArrayLike) -> NDArray[np.bool_]:
        """(N,) whether the object, placed at ``where``, blocks each ray.

        A ray with direction ``ways`` (N, 3) is blocked by a hit nearer than ``distance`` direction lengths.
        """
        # The rays are moved to the object's own frame, so that its ray caster is built only once.
        turn = where.rotation
        return self._caster.occluded((origins - np.asarray(where.position)) @ turn, ways @ turn, distance)

    @cached_property
    def _caster(self) -> RayCaster:
        return RayCaster(self.start.model.mesh.positions)

    def outline(self, seconds: float) -> Array:
        """(4, 2) x and z of the corners of its footprint after ``seconds``, in order."""
        time = np.arange(len(self.yaws)) / RATE
        x, z, yaw = (np.interp(seconds, time, c) for c in (self.positions[:, 0], self.positions[:, 2], self.yaws))
        corners = self._corners @ yaw_matrix(float(yaw))[np.ix_([0, 2], [0, 2])].T
        return np.asarray(corners + np.array([x, z]))

    @cached_property
    def _corners(self) -> Array:
        low, high = self.start.model.mesh.bounds.astype(np.float64)[:, [0, 2]]
        return np.array([low, (high[0], low[1]), high, (low[0], high[1])])

    @cached_property
    def seconds(self) -> tuple[Placement, ...]:
        """(n + 1) its placements at every full second, with the end of the last one."""
        return tuple(self.at(float(second)) for second in range((len(self.yaws) - 1) // RATE + 1))

    @property
    def length(self) -> float:
        """Metres travelled."""
        return float(np.linalg.norm(np.diff(self.positions, axis=0), axis=1).sum())


def movable(model: Model) -> Model:
    """``model`` with a mount on which it can move: one that could also hang on a wall stands instead."""
    return replace(model, mount="surface") if model.mount == "wall_or_surface" else model


def categories_of(motions: Sequence[Motion]) -> str:
    """The categories of moving objects, for messages."""
    return " or ".join(dict.fromkeys(motion.start.model.category for motion in motions))


def plan_motions(
    site: Site, placements: Sequence[Placement], indices: Sequence[int], *, seconds: int, rng: Generator
) -> tuple[Motion, ...]:
    """Draw the paths of some of ``placements`` for ``seconds`` seconds; they touch nothing and not one another.

    Args:
        site: the room without the placed objects.
        placements: the placed objects. A floor path begins near the object's place.
        indices: of the objects that move.
        seconds: duration.
        rng: the only source of randomness.

    Returns:
        One motion per index, in the order of the indices.

    Raises:
        Avs3dError: one line, if an object hangs on a wall or has no room to move.
    """
    moving = {index: _upright(site, placements[index]) for index in indices}
    for source in moving.values():
        if source.support.kind == "wall":
            raise Avs3dError(
                f"{site.name}: what moves must not hang; this {source.model.category} ({source.model.name}) "
                "hangs on the wall: choose another category or variant, or let it stand still"
            )
    still = [placement.box.grown(ELBOW_ROOM) for number, placement in enumerate(placements) if number not in moving]
    # On worktops first: they begin at their places, which those on the floor can keep clear of.
    tops = {index: source for index, source in moving.items() if source.support.kind != "floor"}
    found: dict[int, Motion] = {}
    for index, source in tops.items():
        beside = [other.box.grown(ELBOW_ROOM) for number, other in tops.items() if number not in (index, *found)]
        swept = [place.box.grown(ELBOW_ROOM) for motion in found.values() for place in motion.seconds]
        found[index] = _motion(index, source, *_along_top(site, source, [*still, *beside, *swept], seconds, rng))
    for index, source in moving.items():
        if index not in tops:
            earlier = tuple(found.values())
            found[index] = _motion(index, source, *_over_floor(site, source, still, earlier, seconds, rng))
    return tuple(found[index] for index in indices)


def _motion(index: int, source: Placement, positions: Array, yaws: Array) -> Motion:
    x, y, z = (float(c) for c in positions[0])
    return Motion(index, replace(source, position=(x, y, z), yaw=float(yaws[0])), positions, yaws)


def _upright(site: Site, source: Placement) -> Placement:
    """``source`` without its tilt: an object that moves over a scan stays upright, on the highest point below it."""
    if not any(source.tilt):
        return source
    origin = np.asarray(source.position)[None]
    _, settled = standing(site, source.model.mesh, origin, np.array([source.yaw]))
    x, y, z = (float(c) for c in (settled[0] if len(settled) else origin[0]))
    return replace(source, position=(x, y, z), tilt=(0.0, 0.0, 0.0))


def _over_floor(
    site: Site,
    source: Placement,
    others: list[UprightBox],
    earlier: Sequence[Motion],
    seconds: int,
    rng: Generator,
) -> tuple[Array, Array]:
    mesh = source.model.mesh
    low, high = mesh.bounds.astype(np.float64)
    # The model turns about its origin.
    radius = float(np.hypot(*np.maximum(np.abs(low), np.abs(high))[[0, 2]])) + ELBOW_ROOM
    height = max(float(high[1]) + ELBOW_ROOM - radius, 0.2)
    space = FreeSpace.of(
        site.scene, site.room.name, triangles=site.triangles, caster=site.caster, radius=radius, height=height
    )
    space = space.without([box.footprint for box in others]).largest()
    failed = Avs3dError(
        f"{site.name}: no room for the {source.model.category} ({source.model.name}) to move: a disc of "
        f"{2 * radius:.2f} m fits on {space.area:.2f} m² of floor, expected {LEAST_AREA:g} m² in one piece; choose "
        "a larger room, fewer objects or a smaller model"
    )
    if space.area < LEAST_AREA:
        raise failed
    views = _views(site, space, float(high[1]) / 2)
    for _ in range(_ATTEMPTS):
        plan, yaws = _tour(space, views, source, seconds, rng)
        if earlier:
            progress = _waiting(plan, earlier, radius + _SLACK)
            if progress is None:
                continue
            samples = np.arange(len(plan))
            plan = np.stack([np.interp(progress, samples, plan[:, k]) for k in range(2)], axis=1)
            yaws = np.interp(progress, samples, yaws)
        heights = _heights(site, source, plan, yaws)
        if heights is None:
            continue
        positions = np.stack([plan[:, 0], heights, plan[:, 1]], axis=1)
        if _is_clear(site, mesh, positions, yaws, others, earlier):
            return positions, yaws
    raise failed


def _waiting(plan: Array, earlier: Sequence[Motion], radius: float) -> Array | None:
    """The progress of an object along its tour that lets others pass.

    Args:
        plan: (RATE·seconds + 1, 2) x and z along the tour, `RATE` a second where nothing is in the way.
        earlier: the motions of the others.
        radius: of the disc about the object that must stay free of them, metres.

    Returns:
        (RATE·seconds + 1,) the place on the tour at each sample, as an index; None if it would meet one of them or
        only wait.
    """
    seconds = (len(plan) - 1) // RATE
    free = np.array(
        [
            np.all([distance_to_polygon(plan, motion.outline(half / 2)) >= radius for motion in earlier], axis=0)
            for half in range(2 * seconds + 1)
        ]
    )
    # Never faster than where nothing is in the way, so that the limits of speed and turn hold.
    steps = pace(free, np.ones(seconds), 1 / RATE, most=1.0, back=0.0)
    if steps is None or steps[-1] - steps[0] < LEAST_PROGRESS * len(plan):
        return None
    return np.asarray(np.interp(np.arange(len(plan)) / RATE, np.arange(seconds + 1), steps))


def _views(site: Site, space: FreeSpace, height: float) -> Array:
    """(N,) share of the room's free floor that has a free line to ``height`` metres above each point of the space."""
    eyes = site.space.largest().points
    eyes = np.insert(eyes[:: max(1, len(eyes) // 40)], 1, site.space.floor + SENSOR_HEIGHT, axis=1)
    targets = np.insert(space.points, 1, site.space.floor + height, axis=1)
    if not len(eyes):
        return np.ones(len(targets))
    starts, ends = np.tile(eyes, (len(targets), 1)), np.repeat(targets, len(eyes), axis=0)
    return np.asarray(1.0 - site.caster.occluded(starts, ends - starts, 0.98).reshape(len(targets), -1).mean(axis=1))


def _tour(space: FreeSpace, views: Array, source: Placement, seconds: int, rng: Generator) -> tuple[Array, Array]:
    """Positions (RATE·seconds + 1, 2) and yaws of a round trip over the free floor, mostly in sight."""
    pool = space.points
    speed = rng.uniform(*FLOOR_SPEED)
    start = space.nearest(np.asarray(source.position)[[0, 2]])
    stops, heading = [start], None
    line, time = start[None], np.zeros(1)
    while time[-1] < seconds:
        for _ in range(12):
            picked = rng.integers(len(pool), size=12)
            options = pool[picked]
            hop = options - stops[-1]
            far = np.linalg.norm(hop, axis=1)
            score = np.minimum(far, 1.5) + 1.5 * views[picked]
            if heading is not None:
                score += 0.5 * (hop @ heading) / np.maximum(far, 1e-6)
            best = int(np.argmax(score))
            heading = hop[best] / max(float(far[best]), 1e-6)
            stops.append(options[best])
        line = smooth(space, np.concatenate(space.paths(np.array(stops))))
        angles, time = _timed(line, speed)
    at = np.arange(RATE * seconds + 1) / RATE
    plan = np.stack([np.interp(at, time, line[:, k]) for k in range(2)], axis=1)
    return plan, np.interp(at, time, angles)


def _timed(line: Array, speed: float) -> tuple[Array, Array]:
    """Yaw (M,) of a forward motion along a polyline, and the time (M,) at which each of its points is reached."""
    middle = np.diff(line, axis=0)
    angles = np.unwrap(np.arctan2(middle[:, 0], middle[:, 1]))
    # The turn at a corner of the polyline is spread over ten centimetres.
    angles = ndimage.gaussian_filter1d(np.concatenate([angles[:1], (angles[1:] + angles[:-1]) / 2, angles[-1:]]), 3.0)
    length, turn = np.linalg.norm(middle, axis=1), np.abs(np.diff(angles))
    return angles, np.concatenate([[0.0], np.cumsum(np.maximum(length / speed, turn / math.radians(TURN_RATE)))])


def _heights(site: Site, source: Placement, plan: Array, yaws: Array) -> Array | None:
    """(K,) height of the model's origin above the highest point under its footprint; None if not on the floor."""
    mesh = source.model.mesh
    grid = Contact.below(mesh).grid(9)
    sin, cos = np.sin(yaws)[:, None], np.cos(yaws)[:, None]
    x = plan[:, :1] + cos * grid[:, 0] + sin * grid[:, 1]
    z = plan[:, 1:] - sin * grid[:, 0] + cos * grid[:, 1]
    start = 0.10
    rays = np.stack([x, np.full(x.shape, site.space.floor + start), z], axis=-1).reshape(-1, 3)
    distance, _ = site.caster.closest(rays, np.broadcast_to([0.0, -1.0, 0.0], rays.shape))
    above = (start - np.minimum(distance.astype(np.float64), 1e3)).reshape(x.shape).max(axis=1)
    if np.abs(above).max() > start / 2:
        return None
    # The object rises before the edge of a rug and sinks after it, so that it never enters the rug.
    above = ndimage.uniform_filter1d(ndimage.maximum_filter1d(above, 3), 3)
    return np.asarray(site.space.floor + above + CONTACT - float(mesh.bounds[0, 1]))


def _along_top(
    site: Site, source: Placement, others: list[UprightBox], seconds: int, rng: Generator
) -> tuple[Array, Array]:
    support = source.support
    u, v = (np.asarray(side, dtype=np.float64) * (1, 0, 1) for side in (support.u, support.v))
    along = max(u, v, key=lambda side: float(np.linalg.norm(side)))
    length = float(np.linalg.norm(along))
    along = along / length
    mesh, start, yaw = source.model.mesh, np.asarray(source.position), source.yaw
    ends = []
    for sign in (-1.0, 1.0):
        steps = np.arange(1, math.floor(length / _STEP) + 1)
        origins = start + (sign * _STEP * steps)[:, None] * along
        kept, settled = standing(site, mesh, origins, np.full(len(origins), yaw))
        reach = 0
        # The largest range without a gap in which each sample is level, at the same height, and free.
        for step, origin in zip(kept, settled, strict=True):
            box = UprightBox.around(mesh, origin, yaw)
            if step != reach or abs(origin[1] - start[1]) > _LEVEL:
                break
            if site.collides(box.grown(-SKIN)) or any(box.hits_box(other) for other in others):
                break
            reach += 1
        ends.append(sign * _STEP * reach)
    low, high = ends
    if high - low < LEAST_SLIDE:
        raise Avs3dError(
            f"{site.name}: no room for the {source.model.category} ({source.model.name}) to move: its {support.kind} "
            f"lets it slide {high - low:.2f} m, expected {LEAST_SLIDE:g} m; choose another room, fewer objects or a "
            "smaller model"
        )
    time = np.arange(RATE * seconds + 1) / RATE
    # A harmonic oscillation, which is smooth at its turning points; it begins at the object's place.
    half, middle = (high - low) / 2, (high + low) / 2
    omega = rng.uniform(*TOP_SPEED) / half
    phase = math.asin(min(1.0, max(-1.0, -middle / half)))
    phase = phase if rng.uniform() < 0.5 else math.pi - phase
    offset = middle + half * np.sin(omega * time + phase)
    positions = start + offset[:, None] * along
    return positions, np.full(len(time), yaw)


def _is_clear(
    site: Site,
    mesh: Mesh,
    positions: Array,
    yaws: Array,
    others: Sequence[UprightBox],
    earlier: Sequence[Motion],
) -> bool:
    """Whether the object touches nothing at any sample, except things low enough to move over."""
    for sample, (position, yaw) in enumerate(zip(positions, yaws, strict=True)):
        box = UprightBox.around(mesh, position, float(yaw))
        above = UprightBox(box.centre + (0, OVER / 2, 0), box.half - (0, OVER / 2, 0), box.yaw)
        if site.collides(above.grown(-SKIN)) or any(box.hits_box(other) for other in others):
            return False
        if any(box.hits_box(motion.at(sample / RATE).box.grown(ELBOW_ROOM)) for motion in earlier):
            return False
    return True
