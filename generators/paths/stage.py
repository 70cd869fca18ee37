"""What stands where at each second of an observation, and how it is lit: all still, or with the sounding one moving."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from queue import SimpleQueue

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.rays import RayCaster
from generators.core.scene import Scene
from generators.lighting.bake import insert
from generators.lighting.moving_light import MovingLight
from generators.paths.motion import Motion
from generators.placement.placement import Placement
from generators.vision.base import Frame, VisionBackend, VisionSession

Array = NDArray[np.float64]

#: An observation draws at most so many frames at the same time: its sound, which one process computes, then takes as
#: long as they do.
MOST_THREADS = 4
#: Frames in flight per thread: enough that no thread waits for the one that consumes them, few enough for the memory.
_AHEAD = 2


class Stage:
    """A lit home with the objects of an observation.

    Args:
        home: lit, without the objects.
        placements: the objects, at time 0; instance ids count from 1.
        sounding_id: instance id of the sounding one. Nothing that is seen depends on it.
        motion: of the sounding one, if it moves.

    Attributes:
        placements: the objects at time 0.
        sounding_id: instance id of the sounding one.
        moves: whether it moves.
        caster: rays against everything that stands still (all there is, where nothing moves).
    """

    def __init__(
        self, home: Scene, placements: Sequence[Placement], sounding_id: int, motion: Motion | None = None
    ) -> None:
        self.placements = tuple(placements)
        self._motion = motion
        self.moves = motion is not None
        self.sounding_id = sounding_id
        parts = tuple(p.part(n) for n, p in enumerate(self.placements, start=1))
        self._still = insert(home, tuple(p for p in parts if motion is None or p.instance_id != self.sounding_id))
        self._light = None if motion is None else self._follow(motion)
        self._known: tuple[int, Scene] | None = None
        self.caster = RayCaster(self._still)

    def _follow(self, motion: Motion) -> MovingLight:
        return MovingLight(self._still, motion.seconds[0].model.mesh, [placed.box for placed in motion.seconds])

    def source(self, second: int) -> Placement:
        """Where the sounding object is at the beginning of a second."""
        return self.placements[self.sounding_id - 1] if self._motion is None else self._motion.seconds[second]

    def scene(self, second: int) -> Scene:
        """The lit scene at the beginning of a second; the same object while nothing changes."""
        if self._light is None:
            return self._still
        if self._known is None or self._known[0] != second:
            self._known = second, self._light.at(self.source(second).part(self.sounding_id))
        return self._known[1]

    def hidden(self, second: int, origins: Array, directions: Array, distance: Array) -> NDArray[np.bool_]:
        """(N,) whether rays from origins (N, 3) along directions (N, 3) meet anything within distances (N,) then."""
        found = self.caster.occluded(origins, directions, distance)
        if self._motion is not None:
            found |= self._motion.occluded(self.source(second), origins, directions, distance)
        return found


class Camera:
    """A renderer's view of a stage; it opens the scene anew when it changes."""

    def __init__(self, backend: VisionBackend, stage: Stage, intrinsics: Intrinsics) -> None:
        self._backend, self._stage, self._intrinsics = backend, stage, intrinsics
        self._scene: Scene | None = None
        self._session: VisionSession | None = None

    def render(self, second: int, pose: Pose) -> Frame:
        """What is seen from ``pose`` at the beginning of a second."""
        return self._open(second).render(pose)

    def _open(self, second: int) -> VisionSession:
        scene = self._stage.scene(second)
        if self._session is None or scene is not self._scene:
            self.close()
            self._session, self._scene = self._backend.open(scene, self._intrinsics), scene
        return self._session

    def frames(
        self, poses: Sequence[Pose], then: Callable[[int, Frame], None], cores: Callable[[], int] = lambda: 1
    ) -> Iterator[Frame]:
        """Yield the frame of each second in order, after ``then(second, frame)`` has run on it.

        Args:
            poses: of the camera at the beginning of each second.
            then: work on a frame, done in the thread that has drawn it.
            cores: how many frames may be drawn at the same time, asked before each; more than `MOST_THREADS` never
                are, nor where the renderer cannot or something moves. The frames are the same.
        """
        sessions: SimpleQueue[VisionSession] = SimpleQueue()
        shared, begun = 0, 0

        def draw(second: int) -> Frame:
            session = sessions.get()
            try:
                frame = session.render(poses[second])
            finally:
                sessions.put(session)
            then(second, frame)
            return frame

        ahead: deque[Future[Frame]] = deque()
        with ThreadPoolExecutor(MOST_THREADS) as pool:
            try:
                for second, pose in enumerate(poses):
                    wanted = 1 if self._stage.moves else min(cores(), MOST_THREADS)
                    while shared < wanted > 1 and (session := self._open(0).share()) is not None:
                        sessions.put(session)
                        shared += 1
                    while shared > 1 and begun < min(len(poses), second + _AHEAD * shared):
                        ahead.append(pool.submit(draw, begun))
                        begun += 1
                    if ahead:
                        yield ahead.popleft().result()
                    else:
                        frame = self.render(second, pose)
                        then(second, frame)
                        begun = second + 1
                        yield frame
            finally:
                for waiting in ahead:
                    waiting.cancel()

    def close(self) -> None:
        """Free what the renderer holds."""
        if self._session is not None:
            self._session.close()
        self._session = self._scene = None
