"""A home with objects placed in it: lit when it is first looked at, all objects still or some moving."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import UsageError, excerpt
from avs3d_bench.geometry import Pose
from generators.core.rays import RayCaster
from generators.core.scene import Part, Scene
from generators.lighting.bake import insert
from generators.lighting.moving_light import MovingLight
from generators.paths.motion import Motion
from generators.paths.watcher import line_of_sight, point_in_sight
from generators.placement.placement import Placement
from generators.vision.top_view import TopView, render_top_view

Array = NDArray[np.float64]


class PlacedScene:
    """A home with objects; it is lit when its light is first asked for.

    Args:
        home: lit, without the objects.
        placements: the objects, at time 0; instance ids count from 1.
        motions: of the objects that move.

    Attributes:
        placements: the objects at time 0; instance n is number n − 1.
        moves: whether any of them moves.
        moving: ids of those that move, sorted.
    """

    def __init__(self, home: Scene, placements: Sequence[Placement] = (), motions: Sequence[Motion] = ()) -> None:
        self.placements = tuple(placements)
        self.moves = bool(motions)
        self.moving = tuple(sorted(motion.index + 1 for motion in motions))
        self._home, self._motions = home, {motion.index + 1: motion for motion in motions}
        self._known: tuple[int, Scene] | None = None

    def _numbered(self) -> enumerate[Placement]:
        return enumerate(self.placements, start=1)

    @cached_property
    def _still_parts(self) -> tuple[Part, ...]:
        return tuple(placement.part(number) for number, placement in self._numbered() if number not in self._motions)

    def _moving_parts(self, second: int) -> tuple[Part, ...]:
        return tuple(motion.seconds[second].part(number) for number, motion in self._motions.items())

    @cached_property
    def caster(self) -> RayCaster:
        """Ray caster of all parts that do not move."""
        return RayCaster(self._home.with_parts(self._still_parts))

    @cached_property
    def _still(self) -> Scene:
        return insert(self._home, self._still_parts)

    @cached_property
    def _light(self) -> MovingLight:
        ways = [[placed.box for placed in motion.seconds] for motion in self._motions.values()]
        return MovingLight(self._still, [motion.start.model.mesh for motion in self._motions.values()], ways)

    def placement(self, instance: int, second: int = 0) -> Placement:
        """The placement of an instance at the beginning of a second: its box, position, front and sound source.

        Raises:
            UsageError: if no object has that id.
        """
        if instance not in range(1, len(self.placements) + 1):
            known = ", ".join(f"{number} ({each.model.category})" for number, each in self._numbered()) or "none"
            raise UsageError(f"{self._home.name}: no instance {excerpt(instance)}; placed objects: {known}")
        motion = self._motions.get(instance)
        return self.placements[instance - 1] if motion is None else motion.seconds[second]

    @property
    def acoustic_scene(self) -> Scene:
        """The scene at time 0, as an acoustic engine needs it: its light may be missing."""
        return self.scene(0) if self.moves else self._home.with_parts(self._still_parts)

    def acoustic_scene_of(self, instance: int | None) -> Scene:
        """The same for the sound of one instance; None: of something that is no instance.

        The bodies of other objects that move are left out: they are small, and not where they were at time 0.
        """
        scene = self.acoustic_scene
        others = self._motions.keys() - {instance}
        return replace(scene, parts=tuple(p for p in scene.parts if p.instance_id not in others)) if others else scene

    def top_view(self, room: str) -> TopView | None:
        """The home from above, without the objects; None if it is no scan."""
        return render_top_view(self._home, self._home.room(room))

    def scene(self, second: int = 0) -> Scene:
        """The lit scene at the beginning of a second, its parts and rooms; the same object while nothing changes."""
        if not self._motions:
            return self._still
        if self._known is None or self._known[0] != second:
            self._known = second, self._light.at(self._moving_parts(second))
        return self._known[1]

    def is_in_sight(self, instance: int, pose: Pose, second: int) -> bool:
        """Whether nothing but the instance is between a sensor and its sound source at the beginning of a second."""
        placed = self.placement(instance, second)
        if not line_of_sight(self.caster, pose, placed):
            return False
        return not self._behind_moving(pose, placed.source_position, second, instance)

    def is_point_in_sight(self, pose: Pose, point: ArrayLike, second: int) -> bool:
        """Whether nothing is between a sensor and a point (3,) at the beginning of a second."""
        return point_in_sight(self.caster, pose, point) and not self._behind_moving(pose, point, second)

    def _behind_moving(self, pose: Pose, point: ArrayLike, second: int, instance: int | None = None) -> bool:
        """Whether an object that moves, other than ``instance``, is before a point."""
        start = np.asarray(pose.position)
        way = np.asarray(point) - start
        return any(
            bool(motion.occluded(motion.seconds[second], start[None], way[None], 1.0)[0])
            for number, motion in self._motions.items()
            if number != instance
        )

    def hidden(self, second: int, origins: Array, directions: Array, distance: Array) -> NDArray[np.bool_]:
        """(N,) whether rays hit anything at the beginning of a second.

        Origins and directions are (N, 3); only hits nearer than the distances (N,) count.
        """
        found = self.caster.occluded(origins, directions, distance)
        for motion in self._motions.values():
            found |= motion.occluded(motion.seconds[second], origins, directions, distance)
        return found
