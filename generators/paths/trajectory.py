"""The agent's walk: through free space, past both sides of every candidate, looking at each and away from it.

A candidate is any placed object. The sounding one is drawn later and independently, so a walk cannot reveal it. A walk
is drawn as a tour of waypoints around the candidates (generators/paths/tours.py); then a gaze is planned along it
(generators/paths/gaze.py). Several tours with many gazes each are drawn, and the one with the smallest penalty is
kept; the penalty is symmetric in the candidates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from generators.core.freespace import CELL, FreeSpace, Navigable
from generators.core.rays import RayCaster
from generators.paths import gaze
from generators.paths.gaze import Sight, Views
from generators.paths.motion import Motion, categories_of
from generators.paths.tours import (
    LOOKS,
    OBJECT_DISTANCE,
    Tours,
    best_piece,
    distances,
    level_difference,
    track_penalty,
)
from generators.paths.walk_report import WalkReport
from generators.paths.watcher import Watcher, watchers
from generators.placement.placement import Placement
from generators.placement.site import Site

Array = NDArray[np.float64]

#: Maximum step length (m) and turn (degrees) between frames.
MOST_STEP, MOST_TURN = 0.5, 30.0
#: Number of tours that are evaluated, and of gazes that are drawn along each.
_TOURS, _GAZES = 8, 48
#: Number of tracks of which one becomes a tour where twins are to be alike.
_ALIKE_TRACKS = 12
#: Largest number of tours that are drawn if some of them hit a moving object.
_TRIES = 5 * _TOURS
#: Least area of free floor for a walk (m²).
_LEAST_AREA = 0.05


@dataclass(frozen=True, eq=False)
class WalkTask:
    """A room to walk through, and the objects to look at.

    Attributes:
        site: the room, measured without the placed objects.
        placements: the placed objects.
        frames: number of poses.
        height: of the sensor above the floor, metres.
        hfov: field of view of the (square) camera, degrees.
        motions: of the objects that move; they last ``frames`` seconds.
        navigable: tells which points on the floor a renderer's own navigation mesh contains; the walk stays within
            both this mesh and the measured free space.
        watched: indices of the placements for which the walk is planned; None: all of them. Any other value lets the
            walk reveal something about these placements: it is for experiments on such leaks (benchmarks/leaks.py),
            and no generator uses it.
        alike: indices of the copies of each model whose distances the walk keeps alike (see `level_difference`).
    """

    site: Site
    placements: Sequence[Placement]
    frames: int = 120
    height: float = 1.5
    hfov: float = 90.0
    motions: Sequence[Motion] = ()
    navigable: Navigable | None = None
    watched: Sequence[int] | None = None
    alike: Sequence[Sequence[int]] = ()


@dataclass(frozen=True, eq=False)
class Walk:
    """Poses, and measurements of them.

    Attributes:
        poses: of the agent, one per frame.
        report: visibility of each placed object along the poses.
        notes: relaxed constraints of the placements and of the walk.
    """

    poses: tuple[Pose, ...]
    report: WalkReport
    notes: tuple[str, ...]


def plan_walk(task: WalkTask, rng: Generator) -> Walk:
    """Plan a walk through a room past all placed objects, none of which is preferred.

    Args:
        task: the room and the objects.
        rng: the only source of randomness.

    Returns:
        Poses in free space at the sensor's height, pairwise distinct, with steps of at most `MOST_STEP` metres and
        turns of at most `MOST_TURN` degrees.

    Raises:
        Avs3dError: if nothing was placed, ``frames`` is less than 1, or the room is too small to walk in.
    """
    name, placements, frames, motions = task.site.name, task.placements, task.frames, task.motions
    if not placements or frames < 1:
        raise Avs3dError(f"{name}: {len(placements)} objects and {frames} frames; expected at least one of each")
    space, caster = walkable(task)
    extent = math.tan(math.radians(task.hfov) / 2)
    everyone = watchers(caster, placements, motions, frames=frames, eye=space.floor + task.height, extent=extent)
    chosen = everyone if task.watched is None else tuple(everyone[index] for index in task.watched)
    piece = best_piece(space, chosen, _LEAST_AREA)
    if piece is None:
        raise Avs3dError(
            f"{name}: no room to walk: {space.area:.2f} m² of free floor for an agent {2 * space.radius:.1f} m wide;"
            " place fewer objects or choose another room"
        )
    tours = Tours(piece, chosen, frames, motions)
    best = _search(_Alike(tours, task, space.floor) if task.alike else tours, chosen, rng, moving=bool(motions))
    if best is None:
        raise Avs3dError(
            f"{name}: no walk of {frames} frames keeps {OBJECT_DISTANCE} m away from the moving "
            f"{categories_of(motions)}; choose a larger room, fewer objects or a smaller model"
        )
    eyes, yaw, pitch = best
    poses = tuple(Pose.from_yaw(p, float(y), float(t)) for p, y, t in zip(eyes, yaw, pitch, strict=True))
    check_poses(poses, piece, name)
    for motion in motions:
        check_distance(poses, motion, name)
    sights = [watcher.sight(eyes[:, [0, 2]]) for watcher in everyone]
    report = WalkReport.of(sights, yaw, pitch, piece)
    relaxed = tuple(placement.relaxed for placement in placements if placement.relaxed)
    return Walk(poses, report, (*relaxed, *report.notes))


def walkable(task: WalkTask) -> tuple[FreeSpace, RayCaster]:
    """The floor on which the agent may walk, and a ray caster of the room with all objects that do not move."""
    site, moving = task.site, {motion.index for motion in task.motions}
    standing = [p for index, p in enumerate(task.placements) if index not in moving]
    triangles = np.concatenate([site.triangles, *(p.mesh.positions for p in standing)])
    caster = RayCaster(triangles)
    space = FreeSpace.of(site.scene, site.room.name, triangles=triangles, caster=caster, height=task.height)
    # A pose may be anywhere in a cell whose centre is walkable: add half a diagonal.
    space = space.without([p.box.footprint for p in standing], OBJECT_DISTANCE + CELL * math.sqrt(0.5))
    return space if task.navigable is None else space.within(task.navigable), caster


class _Alike:
    """Tours along which twins are about as far away as one another."""

    def __init__(self, tours: Tours, task: WalkTask, floor: float) -> None:
        self._tours, self._eye = tours, floor + task.height
        self._twins = [np.array([task.placements[k].source_position for k in copies]) for copies in task.alike]

    def draw(self, rng: Generator) -> Array | None:
        """The track, of `_ALIKE_TRACKS`, with the smallest difference; see `Tours.draw`."""
        tracks = [track for _ in range(_ALIKE_TRACKS) if (track := self._tours.draw(rng)) is not None]
        return min(tracks, key=self._difference, default=None)

    def _difference(self, track: Array) -> float:
        eyes = np.insert(track, 1, self._eye, axis=1)
        return max(level_difference(eyes, sources) for sources in self._twins)


def _search(
    tours: Tours | _Alike, chosen: Sequence[Watcher], rng: Generator, *, moving: bool
) -> tuple[Array, Array, Array] | None:
    """The eyes (n, 3), yaw and pitch (n,) of the best of many walks; None if all hit a moving object."""
    best: tuple[float, Array, Array, Array] | None = None
    found = 0
    for _ in range(_TRIES if moving else _TOURS):
        track = tours.draw(rng)
        if track is None:
            continue
        found += 1
        sights: list[Sight] = [watcher.sight(track) for watcher in chosen]
        yaw, pitch = gaze.draw_gazes(sights, _GAZES, rng)
        penalties = gaze.penalty([Views.of(sight, yaw, pitch) for sight in sights], yaw) + track_penalty(sights, chosen)
        index = int(np.argmin(penalties))
        if best is None or penalties[index] < best[0]:
            best = (float(penalties[index]), sights[0].eyes, yaw[index], pitch[index])
        if found == _TOURS:
            break
    return None if best is None else best[1:]


def check_poses(poses: Sequence[Pose], space: FreeSpace, name: str) -> None:
    """Check poses against the hard constraints.

    Raises:
        Avs3dError: naming the first pose that is outside free space, too far or turned too much from the one before,
            or a repetition.
    """
    positions = np.array([pose.position for pose in poses])
    for index, inside in enumerate(space.contains(positions[:, [0, 2]])):
        if not inside:
            raise Avs3dError(f"{name}: pose {index} at {poses[index].position} is not in free space; use another seed")
    forward = [pose.rotation_matrix for pose in poses]
    for index in range(1, len(poses)):
        step = float(np.linalg.norm(positions[index] - positions[index - 1]))
        cosine = (np.trace(forward[index - 1].T @ forward[index]) - 1) / 2
        turn = math.degrees(math.acos(min(1.0, max(-1.0, float(cosine)))))
        if step > MOST_STEP or turn > MOST_TURN:
            raise Avs3dError(
                f"{name}: pose {index} is {step:.2f} m and {turn:.1f}° from the one before; expected at most"
                f" {MOST_STEP} m and {MOST_TURN}°; ask for more frames"
            )
    if len({(pose.position, pose.rotation) for pose in poses}) < len(poses):
        raise Avs3dError(
            f"{name}: two of {len(poses)} poses are the same; the free floor is too small, use another room"
        )


def check_distance(poses: Sequence[Pose], motion: Motion, name: str) -> None:
    """Check the distance of poses, one per second, from a moving object at all times.

    Raises:
        Avs3dError: naming the first time at which the distance is too small.
    """
    (distance,) = distances(np.array([pose.position for pose in poses])[:, [0, 2]], [motion])
    near = np.flatnonzero(distance < OBJECT_DISTANCE)
    if len(near):
        raise Avs3dError(
            f"{name}: after {near[0] / LOOKS:g} s the agent is {distance[near[0]]:.2f} m from the moving "
            f"{motion.start.model.category}, expected {OBJECT_DISTANCE} m; use another seed"
        )
