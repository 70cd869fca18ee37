"""Poses of a camera on the free floor: one that sees an object well, and one that shows a room."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from generators.core.freespace import SENSOR_HEIGHT
from generators.core.scene import Room
from generators.paths.gaze import MOST_PITCH, SEEN_SHARE, Sight
from generators.paths.tours import OBJECT_DISTANCE
from generators.paths.trajectory import WalkTask, walkable
from generators.paths.watcher import StillWatcher
from generators.placement.placement import Placement
from generators.placement.site import Site

Array = NDArray[np.float64]

#: Number of places on the floor that are looked at.
_PLACES = 300
#: Share of these, the best ones, of which one is drawn.
_BEST = 0.1
#: What counts as in the picture: this share of its half width.
_INSIDE = 0.9
#: Yaws (degrees) among which the longest view into a room is looked for.
_HEADINGS = 24


def view_of_object(task: WalkTask, placed: Placement, rng: Generator) -> Pose:
    """A pose on the free floor from which an object is seen well.

    It is one of a walk past the object: on the floor that the agent may walk on, at the sensor's height, no farther
    than a walk goes (`StillWatcher.far`), tilted by at most 25°. Of random places the best tenth is kept, by the share
    of the object's surface that is in the picture, by how far in front of it they are, and how near; one is drawn.

    Args:
        task: the room and all objects in it.
        placed: one of these.
        rng: the only source of randomness.

    Raises:
        Avs3dError: if no free floor is in sight of the object.
    """
    space, caster = walkable(task)
    eye = space.floor + task.height
    watcher = StillWatcher(caster, placed, eye, math.tan(math.radians(task.hfov) / 2))
    ground = watcher.centre[[0, 2]]
    away = np.linalg.norm(space.points - ground, axis=1)
    near = space.points[(away >= OBJECT_DISTANCE) & (away <= watcher.far)]
    points = near[rng.permutation(len(near))[:_PLACES]]
    share = _shown(watcher.sight(points)) if len(points) else np.zeros(0)
    seen = np.flatnonzero(share >= SEEN_SHARE)
    if not len(seen):
        raise Avs3dError(
            f"{task.site.name}: no free floor within {watcher.far:.1f} m from which the {placed.model.category} is "
            "in sight; place it elsewhere (another rng)"
        )
    distance = np.linalg.norm(points - ground, axis=1)
    ahead = (points - ground) @ placed.front[[0, 2]] / distance
    score = share * (1.0 + ahead) / distance
    best = seen[np.argsort(-score[seen], kind="stable")][: max(1, round(_BEST * len(seen)))]
    x, z = points[int(best[int(rng.integers(len(best)))])].tolist()
    return facing((x, eye, z), watcher.centre)


def _shown(sight: Sight) -> Array:
    """(n,) share of an object's samples that are in sight and in the picture of a camera that faces it."""
    delta = sight.centre - sight.eyes
    yaw = np.arctan2(-delta[:, 0], -delta[:, 2])
    most = math.radians(MOST_PITCH)
    pitch = np.clip(sight.elevation, -most, most)
    inside = sight.in_image(sight.points, yaw[None], pitch[None], _INSIDE)[0]
    return np.asarray((inside & sight.clear).mean(axis=1))


def facing(position: Sequence[float], target: Array) -> Pose:
    """The pose at ``position`` (x, y, z) that looks at ``target`` (3,), tilted by at most a walk's largest tilt."""
    delta = np.asarray(target, dtype=np.float64) - np.asarray(position, dtype=np.float64)
    pitch = math.degrees(math.atan2(delta[1], math.hypot(delta[0], delta[2])))
    limited = math.radians(min(max(pitch, -MOST_PITCH), MOST_PITCH))
    return Pose.from_yaw(position, math.atan2(-delta[0], -delta[2]), limited)


def view_of_room(site: Site, height: float = SENSOR_HEIGHT) -> Pose:
    """A pose on the free floor that shows much of a room: where the free view straight ahead is longest.

    Raises:
        Avs3dError: if the room has no free floor.
    """
    points = site.space.points
    if not len(points):
        raise Avs3dError(f"{site.name}: no free floor to stand on; look at another room")
    points = points[:: max(1, len(points) // _PLACES)]
    yaws = np.linspace(0.0, 2 * np.pi, _HEADINGS, endpoint=False)
    ahead = np.stack([-np.sin(yaws), np.zeros(len(yaws)), -np.cos(yaws)], axis=1)
    eyes = np.insert(points, 1, site.space.floor + height, axis=1)
    distance, _ = site.caster.closest(np.repeat(eyes, len(yaws), axis=0), np.tile(ahead, (len(eyes), 1)))
    free = np.minimum(distance.astype(np.float64), 10.0).reshape(len(eyes), len(yaws))
    # The middle of the picture and what is to both sides of it: 45° are three steps.
    wide = free + np.roll(free, 2, axis=1) + np.roll(free, -2, axis=1)
    place, heading = np.unravel_index(int(np.argmax(wide)), wide.shape)
    return Pose.from_yaw(eyes[place], float(yaws[heading]), math.radians(-8.0))


def largest(rooms: Sequence[Room]) -> str:
    """Name of the room with the largest floor."""

    def area(room: Room) -> float:
        return (room.high[0] - room.low[0]) * (room.high[2] - room.low[2])

    return max(rooms, key=area).name
