"""Tracks over the floor: tours of waypoints past all candidates, smoothed within free space and resampled in time.

Candidates are the placed objects, any of which may be the one that sounds: a tour treats all of them alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.core.curves import arc_length, resample, smooth
from generators.core.freespace import FreeSpace, distance_to_polygon
from generators.paths.gaze import Sight
from generators.paths.motion import Motion
from generators.paths.pacing import pace
from generators.paths.watcher import Watcher

Array = NDArray[np.float64]

#: Least horizontal distance of the sensor from placed objects (m).
OBJECT_DISTANCE = 0.35
#: Least horizontal distance (m) of a good view of an object; the largest is its watcher's `far`.
NEAR = 0.8
#: Least wanted length of a step (m): with shorter steps the views hardly differ.
_LEAST_STEP = 0.02
#: Number of places from which waypoints are chosen, and of options for each waypoint.
_PLACES, _OPTIONS = 400, 16
#: For a walk past a moving object: spacing of the points at which it may be, and its longest step backwards (m).
_PACE, _BACK = 0.01, 0.15
#: Added to the distance from a moving object (m), because both move between two checks.
_SLACK = 0.05
#: Checks per second of the distance from a moving object.
LOOKS = 8


@dataclass(frozen=True, eq=False)
class _PhaseScores:
    """Suitability of places (N,) for a walk past a candidate, in one phase: visibility, bearing, and both combined."""

    sees: NDArray[np.bool_]
    bearing: Array
    comfort: Array

    @classmethod
    def of(cls, pool: Array, watcher: Watcher, phase: int) -> _PhaseScores:
        sees = watcher.sees(pool, phase)
        offset = pool - watcher.ground(phase)
        distance = np.linalg.norm(offset, axis=1)
        comfort = -0.6 * np.maximum(distance - watcher.far, 0) - 1.0 * np.maximum(NEAR - distance, 0) + 0.8 * sees
        return cls(sees, np.arctan2(offset[:, 0], offset[:, 1]), comfort)


class Tours:
    """Draws tracks through one room.

    Args:
        space: the floor to walk on, in one piece.
        watchers: one per candidate.
        frames: number of positions of a track.
        motions: of the objects that move.
    """

    def __init__(self, space: FreeSpace, watchers: Sequence[Watcher], frames: int, motions: Sequence[Motion]) -> None:
        self._space, self._frames, self._motions = space, frames, motions
        self._pool = space.points[:: max(1, len(space.points) // _PLACES)]
        self._views = [[_PhaseScores.of(self._pool, w, phase) for phase in range(w.phases)] for w in watchers]
        # Walks in small rooms are slow; walks of few frames have longer steps.
        pace_ = float(np.clip(0.05 + 0.03 * space.area, 0.06, 0.18)) * (1.0 if frames >= 40 else 1.6)
        self._length = min(pace_, 0.3) * (frames - 1)

    def draw(self, rng: Generator) -> Array | None:
        """(frames, 2) positions along a smooth walk past all candidates; None if it would hit a moving one."""
        line = self._waypoints(rng)
        path = smooth(self._space, np.concatenate(self._space.paths(line)) if len(line) > 1 else line)
        if not self._motions:
            return _in_time(self._space, path, self._length, self._frames, rng)
        return _past(self._space, path, self._length, self._frames, self._motions, rng)

    def _waypoints(self, rng: Generator) -> Array:
        """(M, 2) waypoints; each is chosen for the candidate that is seen from the fewest waypoints so far."""
        pool, wanted = self._pool, 1.15 * self._length + 0.5
        seen = np.zeros(len(self._views))
        focus = int(rng.integers(len(seen)))
        sees = self._views[focus][0].sees
        current = int(rng.choice(np.flatnonzero(sees))) if sees.any() else int(rng.integers(len(pool)))
        chosen, walked = [current], 0.0
        while walked < wanted and len(chosen) < 200:
            views = [view[min(int(walked / wanted * len(view)), len(view) - 1)] for view in self._views]
            focus = int(rng.choice(np.flatnonzero(seen <= seen.min() + 1.0)))
            options = rng.integers(len(pool), size=_OPTIONS)
            hop = np.linalg.norm(pool[options] - pool[current], axis=1)
            recent = pool[chosen[-6:]]
            novelty = np.linalg.norm(pool[options][:, None] - recent, axis=2).min(axis=1)
            bearing = views[focus].bearing
            turn = np.abs((bearing[options] - bearing[current] + np.pi) % (2 * np.pi) - np.pi)
            score = views[focus].comfort[options] + np.minimum(novelty, 1.0) + 0.3 * turn
            score += 0.5 * np.mean([view.sees[options] for view in views], axis=0)
            current = int(options[int(np.argmax(score - 0.4 * np.maximum(hop - 2.0, 0)))])
            walked += float(np.linalg.norm(pool[current] - pool[chosen[-1]])) + 1e-3
            seen += [view.sees[current] and view.comfort[current] > 0 for view in views]
            chosen.append(current)
        return np.asarray(pool[chosen])


def track_penalty(sights: Sequence[Sight], watchers: Sequence[Watcher]) -> float:
    """Penalty of a track for any gaze: few or one-sided views, too near or too far, too little movement."""
    ground = sights[0].eyes[:, [0, 2]]
    each = []
    for sight, watcher in zip(sights, watchers, strict=True):
        distance = horizontal_distance(sight)
        seen = float(sight.visible.mean())
        inside = float(((distance >= NEAR) & (distance <= watcher.far)).mean())
        # All candidates should get the same time near them.
        far = max(0.0, 1.0 / len(sights) - inside)
        one_sided = max(0.0, 1.0 - spread_degrees(sight) / 100)
        each.append(3 * max(0.0, 0.4 + 0.3 / len(sights) - seen) + 1.5 * far + 1.5 * one_sided)
    patches = np.unique(np.round(ground / 0.3).astype(int), axis=0)
    stuck = max(0.0, 1.0 - len(patches) / min(len(ground) / 3, 20))
    short = float((np.linalg.norm(np.diff(ground, axis=0), axis=1) < _LEAST_STEP).mean()) if len(ground) > 1 else 0.0
    return float((np.max(each) + np.mean(each)) / 2 + stuck + 20 * short)


def level_difference(eyes: Array, sources: Array) -> float:
    """How well the course of its level tells which of several equal sources sounds (dB).

    The largest rms difference, over the walk and over all pairs of sources, of their levels in the free field,
    −20·log10(distance), each without its mean: what sounds may have any level.

    Args:
        eyes: (n, 3) positions of the walk, metres.
        sources: (K, 3) positions of the sources, metres.
    """
    level = -20 * np.log10(np.linalg.norm(eyes[:, None] - sources, axis=2))
    level = level - level.mean(axis=0)
    return float(np.sqrt(((level[:, :, None] - level[:, None, :]) ** 2).mean(axis=0)).max())


def horizontal_distance(sight: Sight) -> Array:
    """(n,) distance from each position to the position of the candidate's sound source, metres."""
    return np.asarray(np.linalg.norm(sight.eyes[:, [0, 2]] - sight.source[..., [0, 2]], axis=1))


def spread_degrees(sight: Sight) -> float:
    """Width (degrees) of the smallest arc around a candidate with all positions from which it is in sight."""
    seen = sight.visible
    if seen.sum() < 2:
        return 0.0
    angles = np.sort(np.degrees(sight.bearing[seen]) % 360.0)
    return float(360.0 - np.max(np.diff(np.append(angles, angles[0] + 360.0))))


def distances(track: Array, motions: Sequence[Motion]) -> Array:
    """(K, 8·(n − 1) + 1) distances (m) between a walk (n, 2), one position per second, and K moving objects.

    There are 8 per second. All positions are interpolated linearly; a distance is horizontal and measured to the
    footprint.
    """
    seconds = np.arange(LOOKS * (len(track) - 1) + 1) / LOOKS
    walked = np.stack([np.interp(seconds, np.arange(len(track)), track[:, k]) for k in range(2)], axis=1)
    return np.array(
        [
            [
                distance_to_polygon(point[None], motion.outline(float(second)))[0]
                for second, point in zip(seconds, walked, strict=True)
            ]
            for motion in motions
        ]
    )


def best_piece(space: FreeSpace, watchers: Sequence[Watcher], least: float) -> FreeSpace | None:
    """The connected piece of floor, of at least ``least`` m², with the most views of all candidates.

    If no piece has a view of every candidate, it is the one with the most views of any, then the largest.
    """
    best, best_score = None, -1.0
    for label in range(1, min(int(space.labels.max()), 6) + 1):
        piece = space.component(label)
        if piece.area < least:
            continue
        cells = piece.points[:: max(1, len(piece.points) // 150)]
        seen = [np.mean([w.sees(cells, phase).mean() for phase in range(w.phases)]) for w in watchers]
        score = (min(seen) + 0.1 * np.mean(seen) + 1e-3) * piece.area
        if score > best_score:
            best, best_score = piece, float(score)
    return best


def _speeds(frames: int, rng: Generator) -> Array:
    """(frames − 1,) a slowly varying relative speed with a mean near 1."""
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
    """``out`` (n, 2) with each point that a chord of the polyline moved into an obstacle put back onto ``path``."""
    for index in np.flatnonzero(~space.contains(out)):
        near = path[space.contains(path)]
        out[index] = near[int(np.argmin(((near - out[index]) ** 2).sum(axis=1)))]
    return out


def _past(
    space: FreeSpace, path: Array, length: float, frames: int, motions: Sequence[Motion], rng: Generator
) -> Array | None:
    """(frames, 2) positions along ``path`` that wait for moving objects; None if they cannot be avoided."""
    places = _into(space, path, resample(path, _PACE))
    spacing = float(arc_length(places)[-1]) / max(len(places) - 1, 1)
    wanted = _speeds(frames, rng) * length / max(frames - 1, 1)
    free = np.stack(
        [
            np.all(
                [distance_to_polygon(places, one.outline(half / 2)) >= OBJECT_DISTANCE + _SLACK for one in motions], 0
            )
            for half in range(2 * frames - 1)
        ]
    )
    steps = pace(free, wanted, max(spacing, 1e-6), most=0.3, back=_BACK)
    if steps is None:
        return None
    track = places[steps]
    return track if distances(track, motions).min() >= OBJECT_DISTANCE else None
