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
from scipy import ndimage

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from generators import gaze
from generators.fitting import spread_points
from generators.freespace import CELL, FreeSpace, triangles_near
from generators.gaze import Sight, Views
from generators.placement import Placement
from generators.scenes.scene import Mesh, Scene
from generators.vision.rays import RayCaster

Array = NDArray[np.float64]

#: The contract's limits of one step: metres and degrees.
MOST_STEP, MOST_TURN = 0.5, 30.0
#: The sensor keeps this distance from placed objects, horizontally, metres.
OBJECT_DISTANCE = 0.35
#: The source is mostly seen from within this range, metres (horizontal); small objects from nearer (see `_far`).
NEAR, FAR = 0.8, 3.0
#: Steps shorter than this are avoided: the views would hardly differ, metres.
_LEAST_STEP = 0.02
_TOURS, _GAZES = 8, 48
_SPACING = 0.02
_SAMPLES = 64
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
) -> tuple[tuple[Pose, ...], tuple[str, ...]]:
    """Poses of the agent and notes on what could not be had as asked; see `plan_walk`."""
    result = plan_walk(scene, room, placements, frames=frames, height=height, hfov=hfov, rng=rng)
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
    triangles = np.concatenate([triangles_near(scene, [(box.low, box.high)]), *(p.mesh.positions for p in placements)])
    caster = RayCaster(triangles)
    space = FreeSpace.of(scene, room, triangles=triangles, caster=caster, height=height)
    # A pose may be anywhere in a cell whose centre is walkable: half a diagonal more.
    space = space.without([p.box.footprint for p in placements], OBJECT_DISTANCE + CELL * math.sqrt(0.5))
    eye = space.floor + height
    watcher = _Watcher(caster, source, eye, math.tan(math.radians(hfov) / 2))
    space = _best_component(space, watcher, f"{scene.name}/{room}")

    best: tuple[float, Sight, Array, Array] | None = None
    for _ in range(_TOURS):
        track = _tour(space, watcher, frames, rng)
        sight = watcher.sight(track)
        yaw, pitch = gaze.draw_gazes(sight, _GAZES, rng)
        penalties = Views.of(sight, yaw, pitch).penalty(yaw) + _track_penalty(sight, watcher.far)
        chosen = int(np.argmin(penalties))
        if best is None or penalties[chosen] < best[0]:
            best = (float(penalties[chosen]), sight, yaw[chosen], pitch[chosen])
    assert best is not None
    _, sight, yaw, pitch = best
    poses = tuple(Pose.from_yaw(p, float(y), float(t)) for p, y, t in zip(sight.eyes, yaw, pitch, strict=True))
    check_poses(poses, space, f"{scene.name}/{room}")
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


def outer_samples(mesh: Mesh, count: int, off: float = 0.01) -> Array:
    """(≤ count, 3) points spread over what can be seen of ``mesh`` from outside, ``off`` metres off the surface.

    Inner surfaces (a drum behind its glass, the back of a panel) are those where a ray along the normal is caught.
    """
    triangles = mesh.positions.astype(np.float64)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(normals, axis=1)
    points, faces = spread_points(triangles, area, 4 * count)
    unit = normals[faces] / np.maximum(area[faces], 1e-18)[:, None]
    solid = area[faces] > 0
    points, unit = points[solid] + off * unit[solid], unit[solid]
    free = ~RayCaster(mesh.positions).occluded(points, unit)
    outer = points[free] if free.any() else points
    return np.asarray(outer[np.linspace(0, len(outer) - 1, min(count, len(outer))).round().astype(int)])


class _Watcher:
    """Lines of sight from floor positions to the sounding object."""

    def __init__(self, caster: RayCaster, source: Placement, eye: float, extent: float) -> None:
        self.caster, self.eye, self.extent = caster, eye, extent
        self.points = outer_samples(source.mesh, _SAMPLES)
        self.centre = source.box.centre
        self.source = np.asarray(source.source_position)
        self.far = _far(float(2 * np.linalg.norm(source.box.half)))

    def clear(self, track: Array) -> NDArray[np.bool_]:
        """(n, S) free lines from positions (n, 2) to the samples."""
        starts = np.repeat(np.insert(track, 1, self.eye, axis=1), len(self.points), axis=0)
        ends = np.tile(self.points, (len(track), 1))
        return ~self.caster.occluded(starts, ends - starts, 0.999).reshape(len(track), -1)

    def sees(self, track: Array) -> NDArray[np.bool_]:
        """(n,) whether enough of the object is in sight."""
        return np.asarray(self.clear(track).mean(axis=1) >= gaze.SEEN_SHARE)

    def sight(self, track: Array) -> Sight:
        """What can be seen along a track (n, 2)."""
        eyes = np.insert(track, 1, self.eye, axis=1)
        return Sight(eyes, self.centre, self.source, self.points, self.clear(track), self.extent)


def _best_component(space: FreeSpace, watcher: _Watcher, name: str) -> FreeSpace:
    """The connected piece of floor with the most views of the source (by area; the largest if none has any)."""
    count = int(space.labels.max())
    best, best_score = None, -1.0
    for label in range(1, min(count, 6) + 1):
        piece = space.component(label)
        if piece.area < _LEAST_AREA:
            continue
        cells = piece.points[:: max(1, len(piece.points) // 150)]
        score = float(watcher.sees(cells).mean()) * piece.area + 1e-3 * piece.area
        if score > best_score:
            best, best_score = piece, score
    if best is None:
        raise Avs3dError(
            f"{name}: no room to walk: {space.area:.2f} m² of free floor for an agent {2 * space.radius:.1f} m wide;"
            " place fewer objects or choose another room"
        )
    return best


def _tour(space: FreeSpace, watcher: _Watcher, frames: int, rng: Generator) -> Array:
    """(frames, 2) positions along a smooth walk past waypoints round the source."""
    cells = space.points
    sees = watcher.sees(cells[:: max(1, len(cells) // 400)])
    pool = cells[:: max(1, len(cells) // 400)]
    offset = pool - watcher.source[[0, 2]]
    distance = np.linalg.norm(offset, axis=1)
    bearing = np.arctan2(offset[:, 0], offset[:, 1])
    # Small rooms are walked slowly, few frames in longer steps.
    pace = float(np.clip(0.05 + 0.03 * space.area, 0.06, 0.18)) * (1.0 if frames >= 40 else 1.6)
    length = min(pace, 0.3) * (frames - 1)
    comfort = -0.6 * np.maximum(distance - watcher.far, 0) - 1.0 * np.maximum(NEAR - distance, 0) + 0.8 * sees
    current = int(rng.choice(np.flatnonzero(sees))) if sees.any() else int(rng.integers(len(pool)))
    chosen, walked = [current], 0.0
    while walked < 1.15 * length + 0.5 and len(chosen) < 200:
        options = rng.integers(len(pool), size=16)
        hop = np.linalg.norm(pool[options] - pool[current], axis=1)
        recent = pool[chosen[-6:]]
        novelty = np.linalg.norm(pool[options][:, None] - recent, axis=2).min(axis=1)
        turn = np.abs((bearing[options] - bearing[current] + np.pi) % (2 * np.pi) - np.pi)
        score = comfort[options] + np.minimum(novelty, 1.0) + 0.3 * turn - 0.4 * np.maximum(hop - 2.0, 0)
        current = int(options[int(np.argmax(score))])
        walked += float(np.linalg.norm(pool[current] - pool[chosen[-1]])) + 1e-3
        chosen.append(current)
    line = np.concatenate([cells[:0], *space.paths(pool[chosen])]) if len(chosen) > 1 else pool[chosen]
    return _in_time(space, _smooth(space, line), length, frames, rng)


def _smooth(space: FreeSpace, line: Array) -> Array:
    """``line`` (M, 2) resampled every 2 cm and rounded off wherever that stays in free space."""
    path = _resample(line, _SPACING)
    for _ in range(14):
        if len(path) < 3:
            break
        target = ndimage.gaussian_filter1d(path, 6.0, axis=0, mode="nearest")
        for share in (1.0, 0.5, 0.25):
            moved = path + share * (target - path)
            fits = space.contains(moved)
            path = np.where(fits[:, None], moved, path)
            target = np.where(fits[:, None], path, target)
    return path


def _in_time(space: FreeSpace, path: Array, length: float, frames: int, rng: Generator) -> Array:
    """(frames, 2) positions along the first ``length`` metres of ``path``, at a slowly varying speed."""
    phase, waves = rng.uniform(0, 2 * np.pi), rng.uniform(1, 4)
    t = np.linspace(0.0, 1.0, frames)
    speed = 1.0 + 0.3 * np.sin(2 * np.pi * waves * (t[1:] + t[:-1]) / 2 + phase)
    arc = np.concatenate([[0.0], np.cumsum(speed)])
    walked = _arc(path)
    arc *= min(length, float(walked[-1])) / max(float(arc[-1]), 1e-12)
    out = np.stack([np.interp(arc, walked, path[:, k]) for k in range(2)], axis=1)
    for index in np.flatnonzero(~space.contains(out)):
        # A chord of the polyline may graze an obstacle; its ends do not.
        near = path[space.contains(path)]
        out[index] = near[int(np.argmin(((near - out[index]) ** 2).sum(axis=1)))]
    return out


def _arc(path: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def _resample(line: Array, spacing: float) -> Array:
    arc = _arc(line)
    count = max(2, int(arc[-1] / spacing) + 1)
    at = np.linspace(0.0, float(arc[-1]), count)
    return np.stack([np.interp(at, arc, line[:, k]) for k in range(2)], axis=1)


def _spread_degrees(sight: Sight) -> float:
    """Width of the smallest arc round the source that holds all positions from which it is in sight, degrees."""
    seen = sight.clear.mean(axis=1) >= gaze.SEEN_SHARE
    if seen.sum() < 2:
        return 0.0
    angles = np.sort(np.degrees(sight.bearing[seen]) % 360.0)
    return float(360.0 - np.max(np.diff(np.append(angles, angles[0] + 360.0))))


def _far(diagonal: float) -> float:
    """How far the walk goes from an object: a telephone fills as much of the image as the contract's 3 m allow."""
    return float(np.clip(1.0 + 1.8 * diagonal, 1.4, FAR))


def _track_penalty(sight: Sight, far: float) -> float:
    """Penalty of a track, whatever the gaze: few or one-sided views, too near or too far, hardly any movement."""
    ground = sight.eyes[:, [0, 2]]
    distance = np.linalg.norm(ground - sight.source[[0, 2]], axis=1)
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
        distance=float(np.linalg.norm(ground - sight.source[[0, 2]], axis=1).mean()),
        spread=_spread_degrees(sight),
        length=float(_arc(ground)[-1]),
    )
