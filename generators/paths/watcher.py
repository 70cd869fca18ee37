"""Lines of sight from floor positions to the candidates (all placed objects), which may be still or moving."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.geometry import Pose
from generators.core.rays import RayCaster
from generators.core.scene import Mesh
from generators.paths import gaze
from generators.paths.gaze import Sight
from generators.paths.motion import Motion
from generators.placement.fitting import spread_points
from generators.placement.placement import Placement

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Number of samples on an object's surface.
_SAMPLES = 64
#: Largest distance of the walk from a large object (m).
FAR = 3.0


def watchers(
    caster: RayCaster,
    placements: Sequence[Placement],
    motions: Sequence[Motion],
    *,
    frames: int,
    eye: float,
    extent: float,
) -> tuple[Watcher, ...]:
    """One watcher for each of ``placements``, in their order; see `StillWatcher` and `MovingWatcher`."""
    moving = {motion.index: motion for motion in motions}
    return tuple(
        MovingWatcher(caster, moving[index], frames, eye, extent)
        if index in moving
        else StillWatcher(caster, placement, eye, extent)
        for index, placement in enumerate(placements)
    )


class Watcher(Protocol):
    """Visibility of one candidate, for the planning of a walk.

    Attributes:
        far: largest distance of the walk from it, metres.
        phases: number of equally long parts of the walk, in each of which its place is taken as constant.
    """

    far: float
    phases: int

    def sees(self, track: Array, phase: int = 0) -> Bools:
        """(n,) whether enough of the candidate is in sight from positions (n, 2) in a phase."""
        ...

    def ground(self, phase: int = 0) -> Array:
        """(2,) x and z of its sound source in a phase."""
        ...

    def sight(self, track: Array) -> Sight:
        """Its visibility along a walk (n, 2), one position per frame."""
        ...


class StillWatcher:
    """Watcher of an object that does not move.

    Args:
        caster: rays against the room and all objects in it.
        source: the object.
        eye: height of the sensor, world.
        extent: tangent of half the field of view.
    """

    phases = 1

    def __init__(self, caster: RayCaster, source: Placement, eye: float, extent: float) -> None:
        self.caster, self.eye, self.extent = caster, eye, extent
        self.points = outer_samples(source.mesh, _SAMPLES)
        self.centre = source.box.centre
        self.source = np.asarray(source.source_position)
        self.far = far(source)

    def clear(self, track: Array) -> Bools:
        """(n, S) whether the line from each position (n, 2) to each sample is free."""
        starts = np.repeat(np.insert(track, 1, self.eye, axis=1), len(self.points), axis=0)
        ends = np.tile(self.points, (len(track), 1))
        return ~self.caster.occluded(starts, ends - starts, 0.999).reshape(len(track), -1)

    def sees(self, track: Array, phase: int = 0) -> Bools:
        """See `Watcher`."""
        return np.asarray(self.clear(track).mean(axis=1) >= gaze.SEEN_SHARE)

    def ground(self, phase: int = 0) -> Array:
        """See `Watcher`."""
        return np.asarray(self.source[[0, 2]])

    def sight(self, track: Array) -> Sight:
        """See `Watcher`."""
        eyes = np.insert(track, 1, self.eye, axis=1)
        return Sight(eyes, self.centre, self.source, self.points, self.clear(track), self.extent)


class MovingWatcher:
    """Watcher of a moving object.

    Args:
        caster: rays against the room and the objects that do not move.
        motion: of the object.
        frames: one per second.
        eye: height of the sensor, world.
        extent: tangent of half the field of view.
    """

    phases = 12

    def __init__(self, caster: RayCaster, motion: Motion, frames: int, eye: float, extent: float) -> None:
        self.caster, self.eye, self.extent, self._motion = caster, eye, extent, motion
        self._sources = motion.seconds[:frames]
        self._points = outer_samples(motion.start.model.mesh, _SAMPLES)
        self.far = far(motion.start)

    def _at(self, phase: int) -> Placement:
        return self._sources[min(int((phase + 0.5) / self.phases * len(self._sources)), len(self._sources) - 1)]

    def _clear(self, eyes: Array, source: Placement) -> tuple[Bools, Array]:
        """The samples (S, 3) of the object at ``source``, and whether each is in free sight from ``eyes`` (n, 3).

        Returns:
            (n, S) bool, and the samples (S, 3).
        """
        points = self._points @ source.rotation.T + np.asarray(source.position)
        starts, ends = np.repeat(eyes, len(points), axis=0), np.tile(points, (len(eyes), 1))
        hidden = self.caster.occluded(starts, ends - starts, 0.999)
        hidden |= self._motion.occluded(source, starts, ends - starts, 0.999)
        return ~hidden.reshape(len(eyes), -1), points

    def sees(self, track: Array, phase: int = 0) -> Bools:
        """See `Watcher`."""
        clear, _ = self._clear(np.insert(track, 1, self.eye, axis=1), self._at(phase))
        return np.asarray(clear.mean(axis=1) >= gaze.SEEN_SHARE)

    def ground(self, phase: int = 0) -> Array:
        """See `Watcher`."""
        return np.asarray(self._at(phase).source_position)[[0, 2]]

    def sight(self, track: Array) -> Sight:
        """See `Watcher`."""
        eyes = np.insert(track, 1, self.eye, axis=1)
        seen = [self._clear(eyes[i : i + 1], source) for i, source in enumerate(self._sources)]
        return Sight(
            eyes,
            np.array([source.box.centre for source in self._sources]),
            np.array([source.source_position for source in self._sources]),
            np.stack([points for _, points in seen]),
            np.concatenate([clear for clear, _ in seen]),
            self.extent,
        )


def far(source: Placement) -> float:
    """Largest distance of the walk from an object: smaller for small objects, so that they fill enough of the image."""
    diagonal = float(2 * np.linalg.norm(source.box.half))
    return float(np.clip(1.0 + 1.8 * diagonal, 1.4, FAR))


def outer_samples(mesh: Mesh, count: int, off: float = 0.01) -> Array:
    """(≤ count, 3) points on the surface of ``mesh`` that is visible from outside, moved out by ``off`` metres.

    Inner surfaces (a drum behind its glass, the back of a panel) are those where a ray along the normal hits the mesh.
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


def line_of_sight(caster: RayCaster, pose: Pose, source: Placement) -> bool:
    """Whether nothing except the object itself is between the sensor and the object's sound source.

    Args:
        caster: rays against the scene with the placed objects.
        pose: the sensor.
        source: the instance; hits within 5 cm of its source, or on its own body, do not count.
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


def point_in_sight(caster: RayCaster, pose: Pose, point: ArrayLike) -> bool:
    """Whether nothing is between the sensor and a ``point`` (3,); hits within 5 cm of it do not count."""
    start, end = np.asarray(pose.position), np.asarray(point, dtype=np.float64)
    length = float(np.linalg.norm(end - start))
    if length < 0.05:
        return True
    return float(caster.closest(start[None], (end - start)[None] / length)[0][0]) >= length - 0.05
