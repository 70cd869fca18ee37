"""A home with objects placed in it: lit when it is first looked at, all objects still or one moving."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import UsageError, excerpt
from generators.core.rays import RayCaster
from generators.core.scene import Part, Scene
from generators.lighting.bake import insert
from generators.lighting.moving_light import MovingLight
from generators.paths.motion import Motion
from generators.placement.placement import Placement
from generators.vision.top_view import TopView, render_top_view

Array = NDArray[np.float64]


class PlacedScene:
    """A home with objects; it is lit when its light is first asked for.

    Args:
        home: lit, without the objects.
        placements: the objects, at time 0; instance ids count from 1.
        motion: of the object that moves, if one does.

    Attributes:
        placements: the objects at time 0; instance n is number n − 1.
        moves: whether one of them moves.
    """

    def __init__(self, home: Scene, placements: Sequence[Placement] = (), motion: Motion | None = None) -> None:
        self.placements = tuple(placements)
        self.moves = motion is not None
        self._home, self._motion = home, motion
        self._known: tuple[int, Scene] | None = None

    def _numbered(self) -> enumerate[Placement]:
        return enumerate(self.placements, start=1)

    @cached_property
    def _still_parts(self) -> tuple[Part, ...]:
        moving = None if self._motion is None else self._motion.index + 1
        return tuple(placement.part(number) for number, placement in self._numbered() if number != moving)

    @cached_property
    def caster(self) -> RayCaster:
        """Ray caster of all parts that do not move."""
        return RayCaster(self._home.with_parts(self._still_parts))

    @cached_property
    def _still(self) -> Scene:
        return insert(self._home, self._still_parts)

    @cached_property
    def _light(self) -> MovingLight:
        assert self._motion is not None
        seconds = self._motion.seconds
        return MovingLight(self._still, seconds[0].model.mesh, [placed.box for placed in seconds])

    def placement(self, instance: int, second: int = 0) -> Placement:
        """The placement of an instance at the beginning of a second: its box, position, front and sound source.

        Raises:
            UsageError: if no object has that id.
        """
        if instance not in range(1, len(self.placements) + 1):
            known = ", ".join(f"{number} ({each.model.category})" for number, each in self._numbered()) or "none"
            raise UsageError(f"{self._home.name}: no instance {excerpt(instance)}; placed objects: {known}")
        if self._motion is None or self._motion.index != instance - 1:
            return self.placements[instance - 1]
        return self._motion.seconds[second]

    @property
    def acoustic_scene(self) -> Scene:
        """The scene at time 0, as an acoustic engine needs it: its light may be missing."""
        return self.scene(0) if self.moves else self._home.with_parts(self._still_parts)

    def top_view(self, room: str) -> TopView | None:
        """The home from above, without the objects; None if it is no scan."""
        return render_top_view(self._home, self._home.room(room))

    def scene(self, second: int = 0) -> Scene:
        """The lit scene at the beginning of a second, its parts and rooms; the same object while nothing changes."""
        if self._motion is None:
            return self._still
        if self._known is None or self._known[0] != second:
            instance = self._motion.index + 1
            self._known = second, self._light.at(self.placement(instance, second).part(instance))
        return self._known[1]

    def hidden(self, second: int, origins: Array, directions: Array, distance: Array) -> NDArray[np.bool_]:
        """(N,) whether rays hit anything at the beginning of a second.

        Origins and directions are (N, 3); only hits nearer than the distances (N,) count.
        """
        found = self.caster.occluded(origins, directions, distance)
        if self._motion is not None:
            found |= self._motion.occluded(self._motion.seconds[second], origins, directions, distance)
        return found
