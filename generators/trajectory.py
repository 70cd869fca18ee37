"""The agent's walk: through free space, past both sides of the source, looking at it and away from it.

A walk is drawn as a tour of waypoints at varying distances round the sounding object, joined by shortest paths,
smoothed within free space and resampled in time; then a gaze is planned along it (generators/gaze.py). Several tours
with many gazes each are drawn, and the best by the same penalty is kept.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from generators import gaze
from generators.curves import arc_length, resample, smooth
from generators.freespace import CELL, FreeSpace, distance_to_polygon, triangles_near
from generators.gaze import Sight, Views
from generators.motion import Motion
from generators.pacing import pace
from generators.placement import Placement
from generators.scenes.scene import Scene
from generators.vision.base import Navigable
from generators.vision.rays import RayCaster
from generators.watcher import MovingWatcher, StillWatcher, Watcher

Array = NDArray[np.float64]

#: The contract's limits of one step: metres and degrees.
MOST_STEP, MOST_TURN = 0.5, 30.0
#: The sensor keeps this distance from placed objects, horizontally, metres.
OBJECT_DISTANCE = 0.35
#: The source is mostly seen from within this range, metres (horizontal); small objects from nearer (see `_far`).
NEAR = 0.8
#: Steps shorter than this are avoided: the views would hardly differ, metres.
_LEAST_STEP = 0.02
_TOURS, _GAZES = 8, 48
#: Tours drawn at most where some of them run into a source that moves.
_TRIES = 5 * _TOURS
#: Spacing of the places between which a walk past a moving source chooses, and its longest step backwards, metres.
_PACE, _BACK = 0.01, 0.15
#: Added to the distance from a moving source, for what both do between two looks, metres.
_SLACK = 0.05
#: Moments per second at which the distance from a moving source is looked at.
_LOOKS = 8
#: Free floor below which nobody can walk, m².
_LEAST_AREA = 0.05


@dataclass(frozen=True)
class WalkReport:
    """What a walk turned out to be.

    Attributes:
        look_share: share of frames that look at the source (in line of sight, its middle inside the image).
        left_share, right_share: shares of frames with the source at least 20° to the left, to the right.
        filled_tests, empty_tests: test frames (index % 8 == 0) with and without the source in the image.
        clearance: least horizontal distance to anything within the agent's height, metres (a lower bound).
        distance: mean horizontal distance to the source, metres.
        spread: angle over which the viewing positions spread, seen from the source, degrees.
        length: metres walked.
    """

    look_share: float
    left_share: float
    right_share: float
    filled_tests: int
    empty_tests: int
    clearance: float
    distance: float
    spread: float
    length: float

    @property
    def notes(self) -> tuple[str, ...]:
        """The soft rules that are not met, one line each."""
        low, high = gaze.LOOK_ALLOWED
        out = []
        if not low <= self.look_share <= high:
            out.append(f"{self.look_share:.0%} of the frames look at the source; wanted {low:.0%}–{high:.0%}")
        for side, share in (("left", self.left_share), ("right", self.right_share)):
            if share < gaze.SIDE_SHARE:
                out.append(
                    f"the source is clearly on the {side} in {share:.0%} of the frames; wanted ≥ {gaze.SIDE_SHARE:.0%}"
                )
        return tuple(out)


@dataclass(frozen=True, eq=False)
class Walk:
    """Poses and what they amount to."""

    poses: tuple[Pose, ...]
    report: WalkReport


def walk(
    scene: Scene,
    room: str,
    placements: Sequence[Placement],
    *,
    frames: int = 120,
    height: float = 1.5,
    hfov: float = 90.0,
    rng: Generator,
    motion: Motion | None = None,
    navigable: Navigable | None = None,
) -> tuple[tuple[Pose, ...], tuple[str, ...]]:
    """Poses of the agent and notes on what could not be had as asked; see `plan_walk`."""
    result = plan_walk(
        scene, room, placements, frames=frames, height=height, hfov=hfov, rng=rng, motion=motion, navigable=navigable
    )
    relaxed = tuple(placement.relaxed for placement in placements if placement.relaxed)
    return result.poses, (*relaxed, *result.report.notes)


def plan_walk(
    scene: Scene,
    room: str,
    placements: Sequence[Placement],
    *,
    frames: int = 120,
    height: float = 1.5,
    hfov: float = 90.0,
    rng: Generator,
    motion: Motion | None = None,
    navigable: Navigable | None = None,
) -> Walk:
    """Walk through ``room`` round the sounding object.

    Args:
        scene: the home without the placed objects.
        room: name of the room.
        placements: what was placed in it; exactly one sounds.
        frames: number of poses.
        height: of the sensor above the floor, metres.
        hfov: field of view of the (square) camera, degrees.
        rng: the only source of randomness.
        motion: of the sounding object, if it moves; it lasts ``frames`` seconds.
        navigable: what a renderer's own navigation mesh says of points on the floor; the walk keeps to both.

    Returns:
        Poses in free space at ``height``, pairwise distinct, with steps of at most 0.5 m and turns of at most 30°.

    Raises:
        Avs3dError: if nothing sounds, ``frames`` is less than 1, or the room is too small to walk in.
    """
    sources = [placement for placement in placements if placement.sounding]
    if len(sources) != 1 or frames < 1:
        raise Avs3dError(
            f"{scene.name}/{room}: {len(sources)} sounding objects and {frames} frames; expected exactly one and ≥ 1"
        )
    source = sources[0]
    box = scene.room(room)
    standing = [placement for placement in placements if motion is None or not placement.sounding]
    triangles = np.concatenate([triangles_near(scene, [(box.low, box.high)]), *(p.mesh.positions for p in standing)])
    caster = RayCaster(triangles)
    space = FreeSpace.of(scene, room, triangles=triangles, caster=caster, height=height)
    # A pose may be anywhere in a cell whose centre is walkable: half a diagonal more.
    space = space.without([p.box.footprint for p in standing], OBJECT_DISTANCE + CELL * math.sqrt(0.5))
    if navigable is not None:
        space = space.within(navigable)
    eye, extent = space.floor + height, math.tan(math.radians(hfov) / 2)
    watcher: Watcher = (
        StillWatcher(caster, source, eye, extent)
        if motion is None
        else MovingWatcher(caster, motion, frames, eye, extent)
    )
    space = _best_component(space, watcher, f"{scene.name}/{room}")

    # Places to walk to, and how they suit the walk while the source is where it is.
    pool = space.points[:: max(1, len(space.points) // 400)]
    views = [_View.of(pool, watcher, phase) for phase in range(watcher.phases)]
    best: tuple[float, Sight, Array, Array] | None = None
    found = 0
    for _ in range(_TOURS if motion is None else _TRIES):
        track = _tour(space, pool, views, frames, rng, motion)
        if track is None:
            continue
        found += 1
        sight = watcher.sight(track)
        yaw, pitch = gaze.draw_gazes(sight, _GAZES, rng)
        penalties = Views.of(sight, yaw, pitch).penalty(yaw) + _track_penalty(sight, watcher.far)
        chosen = int(np.argmin(penalties))
        if best is None or penalties[chosen] < best[0]:
            best = (float(penalties[chosen]), sight, yaw[chosen], pitch[chosen])
        if found == _TOURS:
            break
    if best is None:
        raise Avs3dError(
            f"{scene.name}/{room}: no walk of {frames} frames keeps {OBJECT_DISTANCE} m away from the moving "
            f"{source.model.category}; choose a larger room, fewer objects or a smaller model"
        )
    _, sight, yaw, pitch = best
    poses = tuple(Pose.from_yaw(p, float(y), float(t)) for p, y, t in zip(sight.eyes, yaw, pitch, strict=True))
    check_poses(poses, space, f"{scene.name}/{room}")
    if motion is not None:
        check_distance(poses, motion, f"{scene.name}/{room}")
    return Walk(poses, _report(sight, yaw, pitch, space))


def check_poses(poses: Sequence[Pose], space: FreeSpace, name: str) -> None:
    """Hold poses to the hard rules.

    Raises:
        Avs3dError: naming the first pose outside free space, too far or too much turned from the one before, or twice.
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
    """Hold poses, one per second, to their distance from an object that moves, at every time.

    Raises:
        Avs3dError: naming the first moment at which it is not kept.
    """
    distance = distances(np.array([pose.position for pose in poses])[:, [0, 2]], motion)
    near = np.flatnonzero(distance < OBJECT_DISTANCE)
    if len(near):
        raise Avs3dError(
            f"{name}: after {near[0] / _LOOKS:g} s the agent is {distance[near[0]]:.2f} m from the moving "
            f"{motion.start.model.category}, expected {OBJECT_DISTANCE} m; use another seed"
        )


def distances(track: Array, motion: Motion) -> Array:
    """(8·(n − 1) + 1,) metres between a walk (n, 2), one place per second, and a moving object, 8 times a second.

    Both go straight between the places they are known at; the distance is horizontal, to the footprint.
    """
    seconds = np.arange(_LOOKS * (len(track) - 1) + 1) / _LOOKS
    walked = np.stack([np.interp(seconds, np.arange(len(track)), track[:, k]) for k in range(2)], axis=1)
    return np.array(
        [
            distance_to_polygon(point[None], motion.outline(float(second)))[0]
            for second, point in zip(seconds, walked, strict=True)
        ]
    )


def line_of_sight(caster: RayCaster, pose: Pose, source: Placement) -> bool:
    """Whether nothing but the sounding object itself stands between the sensor and where the sound comes from.

    Args:
        caster: rays against the scene with the placed objects.
        pose: the sensor.
        source: the sounding instance; hits within 5 cm of its source, or on its own body, do not count.
    """
    start, end = np.asarray(pose.position), np.asarray(source.source_position)
    length = float(np.linalg.norm(end - start))
    if length < 0.05:
        return True
    direction = (end - start) / length
    distance = float(caster.closest(start[None], direction[None])[0][0])
    if distance >= length - 0.05:
        return True
    return bool(source.box.distance(start + direction * distance) < 0.01)


def visible_fraction(caster: RayCaster, pose: Pose, points: ArrayLike) -> float:
    """Share of ``points`` (N, 3) with a free line to the sensor; points should lie a little off their surface."""
    ends = np.asarray(points, dtype=np.float64)
    start = np.asarray(pose.position)
    return float(1.0 - caster.occluded(np.broadcast_to(start, ends.shape), ends - start, 0.999).mean())


def _best_component(space: FreeSpace, watcher: Watcher, name: str) -> FreeSpace:
    """The connected piece of floor with the most views of the source (by area; the largest if none has any)."""
    count = int(space.labels.max())
    best, best_score = None, -1.0
    for label in range(1, min(count, 6) + 1):
        piece = space.component(label)
        if piece.area < _LEAST_AREA:
            continue
        cells = piece.points[:: max(1, len(piece.points) // 150)]
        seen = np.mean([watcher.sees(cells, phase).mean() for phase in range(watcher.phases)])
        score = float(seen) * piece.area + 1e-3 * piece.area
        if score > best_score:
            best, best_score = piece, score
    if best is None:
        raise Avs3dError(
            f"{name}: no room to walk: {space.area:.2f} m² of free floor for an agent {2 * space.radius:.1f} m wide;"
            " place fewer objects or choose another room"
        )
    return best


def _tour(
    space: FreeSpace, pool: Array, views: Sequence[_View], frames: int, rng: Generator, motion: Motion | None
) -> Array | None:
    """(frames, 2) positions along a smooth walk past waypoints round the source; None if it runs into it."""
    # Small rooms are walked slowly, few frames in longer steps.
    pace_ = float(np.clip(0.05 + 0.03 * space.area, 0.06, 0.18)) * (1.0 if frames >= 40 else 1.6)
    length = min(pace_, 0.3) * (frames - 1)
    sees = views[0].sees
    current = int(rng.choice(np.flatnonzero(sees))) if sees.any() else int(rng.integers(len(pool)))
    chosen, walked = [current], 0.0
    while walked < 1.15 * length + 0.5 and len(chosen) < 200:
        view = views[min(int(walked / max(length, 1e-9) * len(views)), len(views) - 1)]
        options = rng.integers(len(pool), size=16)
        hop = np.linalg.norm(pool[options] - pool[current], axis=1)
        recent = pool[chosen[-6:]]
        novelty = np.linalg.norm(pool[options][:, None] - recent, axis=2).min(axis=1)
        turn = np.abs((view.bearing[options] - view.bearing[current] + np.pi) % (2 * np.pi) - np.pi)
        score = view.comfort[options] + np.minimum(novelty, 1.0) + 0.3 * turn - 0.4 * np.maximum(hop - 2.0, 0)
        current = int(options[int(np.argmax(score))])
        walked += float(np.linalg.norm(pool[current] - pool[chosen[-1]])) + 1e-3
        chosen.append(current)
    line = np.concatenate([pool[:0], *space.paths(pool[chosen])]) if len(chosen) > 1 else pool[chosen]
    path = smooth(space, line)
    if motion is None:
        return _in_time(space, path, length, frames, rng)
    return _past(space, path, length, frames, motion, rng)


@dataclass(frozen=True, eq=False)
class _View:
    """How well places (N,) suit a walk while the source is where it is: whether they see it, its bearing, and both."""

    sees: NDArray[np.bool_]
    bearing: Array
    comfort: Array

    @classmethod
    def of(cls, pool: Array, watcher: Watcher, phase: int) -> _View:
        sees = watcher.sees(pool, phase)
        offset = pool - watcher.ground(phase)
        distance = np.linalg.norm(offset, axis=1)
        comfort = -0.6 * np.maximum(distance - watcher.far, 0) - 1.0 * np.maximum(NEAR - distance, 0) + 0.8 * sees
        return cls(sees, np.arctan2(offset[:, 0], offset[:, 1]), comfort)


def _speeds(frames: int, rng: Generator) -> Array:
    """(frames − 1,) a slowly varying speed with a mean near 1."""
    phase, waves = rng.uniform(0, 2 * np.pi), rng.uniform(1, 4)
    t = np.linspace(0.0, 1.0, frames)
    return np.asarray(1.0 + 0.3 * np.sin(2 * np.pi * waves * (t[1:] + t[:-1]) / 2 + phase))


def _in_time(space: FreeSpace, path: Array, length: float, frames: int, rng: Generator) -> Array:
    """(frames, 2) positions along the first ``length`` metres of ``path``, at a slowly varying speed."""
    arc = np.concatenate([[0.0], np.cumsum(_speeds(frames, rng))])
    walked = arc_length(path)
    arc *= min(length, float(walked[-1])) / max(float(arc[-1]), 1e-12)
    out = np.stack([np.interp(arc, walked, path[:, k]) for k in range(2)], axis=1)
    return _into(space, path, out)


def _into(space: FreeSpace, path: Array, out: Array) -> Array:
    """``out`` (n, 2) with what a chord of the polyline takes into an obstacle moved back onto ``path``."""
    for index in np.flatnonzero(~space.contains(out)):
        near = path[space.contains(path)]
        out[index] = near[int(np.argmin(((near - out[index]) ** 2).sum(axis=1)))]
    return out


def _past(space: FreeSpace, path: Array, length: float, frames: int, motion: Motion, rng: Generator) -> Array | None:
    """(frames, 2) positions along ``path``, waiting for a source that moves; None where it cannot be let past."""
    places = _into(space, path, resample(path, _PACE))
    spacing = float(arc_length(places)[-1]) / max(len(places) - 1, 1)
    wanted = _speeds(frames, rng) * length / max(frames - 1, 1)
    free = np.stack(
        [
            distance_to_polygon(places, motion.outline(half / 2)) >= OBJECT_DISTANCE + _SLACK
            for half in range(2 * frames - 1)
        ]
    )
    steps = pace(free, wanted, max(spacing, 1e-6), most=0.3, back=_BACK)
    if steps is None:
        return None
    track = places[steps]
    return track if distances(track, motion).min() >= OBJECT_DISTANCE else None


def _spread_degrees(sight: Sight) -> float:
    """Width of the smallest arc round the source that holds all positions from which it is in sight, degrees."""
    seen = sight.clear.mean(axis=1) >= gaze.SEEN_SHARE
    if seen.sum() < 2:
        return 0.0
    angles = np.sort(np.degrees(sight.bearing[seen]) % 360.0)
    return float(360.0 - np.max(np.diff(np.append(angles, angles[0] + 360.0))))


def _track_penalty(sight: Sight, far: float) -> float:
    """Penalty of a track, whatever the gaze: few or one-sided views, too near or too far, hardly any movement."""
    ground = sight.eyes[:, [0, 2]]
    distance = np.linalg.norm(ground - sight.source[..., [0, 2]], axis=1)
    seen = (sight.clear.mean(axis=1) >= gaze.SEEN_SHARE).mean()
    outside = float(((distance < NEAR) | (distance > far)).mean())
    patches = np.unique(np.round(ground / 0.3).astype(int), axis=0)
    stuck = max(0.0, 1.0 - len(patches) / min(len(ground) / 3, 20))
    short = float((np.linalg.norm(np.diff(ground, axis=0), axis=1) < _LEAST_STEP).mean()) if len(ground) > 1 else 0.0
    one_sided = max(0.0, 1.0 - _spread_degrees(sight) / 100)
    return float(3 * max(0.0, 0.7 - seen) + 1.5 * outside + 1.5 * one_sided + stuck + 20 * short)


def _report(sight: Sight, yaw: Array, pitch: Array, space: FreeSpace) -> WalkReport:
    views = Views.of(sight, yaw[None], pitch[None])
    filled, empty = views.tests
    ground = sight.eyes[:, [0, 2]]
    return WalkReport(
        look_share=float(views.look_share[0]),
        left_share=float(views.left_share[0]),
        right_share=float(views.right_share[0]),
        filled_tests=int(filled[0]),
        empty_tests=int(empty[0]),
        clearance=float(space.clearance(ground).min()),
        distance=float(np.linalg.norm(ground - sight.source[..., [0, 2]], axis=1).mean()),
        spread=_spread_degrees(sight),
        length=float(arc_length(ground)[-1]),
    )
