"""The lit scene at each second of an observation, all objects still or one moving, and its frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cached_property
from queue import SimpleQueue
from threading import Semaphore

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.limits import MOST_CORES
from generators.core.rays import RayCaster
from generators.core.scene import Part, Scene
from generators.lighting.bake import insert
from generators.lighting.moving_light import MovingLight
from generators.paths.motion import Motion
from generators.placement.placement import Placement
from generators.vision.base import RenderedView, VisionBackend, VisionSession
from generators.vision.top_view import TopView, render_top_view

Array = NDArray[np.float64]

#: Largest number of frames that an observation renders at the same time. With more, its sound, which one process
#: computes, would take longer than its frames (docs/scaling.md).
MOST_THREADS = MOST_CORES - 1
#: Frames in flight per thread: enough to keep all threads busy, few enough for the memory.
_AHEAD = 2


class Stage:
    """A home with the objects of an observation; it is lit when its light is first asked for.

    Args:
        home: lit, without the objects.
        placements: the objects, at time 0; instance ids count from 1.
        motion: of the object that moves, if one does.

    Attributes:
        placements: the objects at time 0.
        moves: whether one of them moves.
    """

    def __init__(self, home: Scene, placements: Sequence[Placement], motion: Motion | None = None) -> None:
        self.placements = tuple(placements)
        self.moves = motion is not None
        self._home, self._motion = home, motion
        self._known: tuple[int, Scene] | None = None

    @cached_property
    def _still_parts(self) -> tuple[Part, ...]:
        moving = None if self._motion is None else self._motion.index
        placed = enumerate(self.placements)
        return tuple(placement.part(number + 1) for number, placement in placed if number != moving)

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

    def placement(self, instance: int, second: int) -> Placement:
        """The placement of an instance at the beginning of a second."""
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

    def scene(self, second: int) -> Scene:
        """The lit scene at the beginning of a second; the same object while nothing changes."""
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


class StageRenderer:
    """Renders a stage; it opens the scene again whenever the scene changes."""

    def __init__(self, backend: VisionBackend, stage: Stage, intrinsics: Intrinsics) -> None:
        self._backend, self._stage, self._intrinsics = backend, stage, intrinsics
        self._scene: Scene | None = None
        self._session: VisionSession | None = None

    def render(self, second: int, pose: Pose) -> RenderedView:
        """Render the frame from ``pose`` at the beginning of a second."""
        return self._open(second).render(pose)

    def _open(self, second: int) -> VisionSession:
        scene = self._stage.scene(second)
        if self._session is None or scene is not self._scene:
            self.close()
            self._session, self._scene = self._backend.open(scene, self._intrinsics), scene
        return self._session

    def frames(
        self,
        poses: Mapping[int, Pose],
        then: Callable[[int, RenderedView], None],
        cores: Callable[[], int] = lambda: 1,
    ) -> Generator[RenderedView]:
        """Yield the frames of some seconds in order, after ``then(second, frame)`` has run on each.

        Args:
            poses: of the camera at the beginning of these seconds.
            then: called on each frame in the thread that has rendered it.
            cores: how many frames may be rendered at the same time, called before each frame; it may grow and shrink.
                There are never more than `MOST_THREADS`, and only one if the renderer needs it or an object moves. The
                frames do not depend on it.
        """
        sessions: SimpleQueue[VisionSession] = SimpleQueue()
        retired = Semaphore(0)  # how many sessions are to be given up when their frame is drawn
        order, shared, begun = tuple(poses), 0, 0

        def draw(second: int) -> RenderedView:
            session = sessions.get()
            try:
                frame = session.render(poses[second])
            finally:
                if not retired.acquire(blocking=False):
                    sessions.put(session)
            then(second, frame)
            return frame

        ahead: deque[Future[RenderedView]] = deque()
        with ThreadPoolExecutor(MOST_THREADS) as pool:
            try:
                for number, second in enumerate(order):
                    wanted = 1 if self._stage.moves else min(cores(), MOST_THREADS)
                    while shared < wanted > 1:
                        # A session that was to be retired, but is not yet, stays.
                        if not retired.acquire(blocking=False):
                            if (session := self._open(0).share()) is None:
                                break
                            sessions.put(session)
                        shared += 1
                    while shared > wanted:
                        retired.release()
                        shared -= 1
                    while shared > 0 and begun < min(len(order), number + _AHEAD * shared):
                        ahead.append(pool.submit(draw, order[begun]))
                        begun += 1
                    if ahead:
                        yield ahead.popleft().result()
                    else:
                        frame = self.render(second, poses[second])
                        then(second, frame)
                        begun = number + 1
                        yield frame
            finally:
                for waiting in ahead:
                    waiting.cancel()

    def close(self) -> None:
        """Free the renderer's resources."""
        if self._session is not None:
            self._session.close()
        self._session = self._scene = None
