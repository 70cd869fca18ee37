"""Pictures of a scene, one at a time or several at once; the scene is opened again whenever it changes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from queue import SimpleQueue
from threading import Semaphore
from types import TracebackType
from typing import Protocol, Self

from avs3d_bench.errors import UsageError, excerpt
from avs3d_bench.geometry import Intrinsics, Pose
from generators.backends import vision_backend
from generators.core.limits import MOST_CORES
from generators.core.scene import Scene
from generators.vision.base import RenderedView, VisionBackend, VisionSession
from generators.vision.views import check_camera, room_at

#: Largest number of frames that an observation renders at the same time. With more, its sound, which one process
#: computes, would take longer than its frames (docs/scaling.md).
MOST_THREADS = MOST_CORES - 1
#: Frames in flight per thread: enough to keep all threads busy, few enough for the memory.
_AHEAD = 2
#: The camera of a picture for which none is named.
_CAMERA = Intrinsics.from_fov(512)


class SceneInTime(Protocol):
    """What a `Renderer` draws: the lit scene of each second, and whether it changes."""

    @property
    def moves(self) -> bool:
        """Whether an object moves."""
        ...

    def scene(self, second: int = 0) -> Scene:
        """The lit scene at the beginning of a second; the same object while nothing changes."""
        ...


class _Still:
    """A `Scene` in which nothing moves."""

    moves = False

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    def scene(self, second: int = 0) -> Scene:
        """The scene."""
        return self._scene


class Renderer:
    """Renders a scene; it opens the scene again whenever the scene, its exposure or the camera changes.

    Args:
        scene: a home, a home with objects (`generators.Home.place`), or a bare `Scene`.
        vision: a key of `generators.backends.VISION` (``embree`` needs nothing but packages from PyPI), or a renderer,
            such as a `generators.vision.camera.CameraBackend`.
        room: whose exposure and white balance the pictures have; None: the room that the camera is in.
        device: where it draws, if it can choose: ``cpu`` or ``cuda``.

    Raises:
        UsageError: if there is no renderer of that name.
        Avs3dError: if what it needs is not installed.

    Examples:
        >>> from generators.vision.views import trial_scene
        >>> box, camera, pose = trial_scene()
        >>> view = Renderer(box).frame(pose, camera)
        >>> view.rgb.shape, view.depth.dtype.name, int(view.instance_ids.max())
        ((16, 16, 3), 'float32', 0)
    """

    def __init__(
        self,
        scene: SceneInTime | Scene,
        vision: str | VisionBackend = "embree",
        *,
        room: str | None = None,
        device: str = "cpu",
    ) -> None:
        self._backend = vision_backend(vision, device) if isinstance(vision, str) else vision
        self._source: SceneInTime = _Still(scene) if isinstance(scene, Scene) else scene
        self._room = room
        self._opened: tuple[Scene, str, Intrinsics] | None = None
        self._session: VisionSession | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.close()

    def frame(self, pose: Pose, intrinsics: Intrinsics = _CAMERA, second: int = 0) -> RenderedView:
        """Render the picture from ``pose`` at the beginning of a second; the same arguments give the same bytes.

        Args:
            pose: of the camera, metres, Y up.
            intrinsics: of the camera.
            second: where an object moves.

        Returns:
            rgb (H, W, 3) uint8, depth (H, W) float32 metres along the optical axis, instance ids (H, W) uint16.

        Raises:
            UsageError: if ``pose`` or ``intrinsics`` is of another type.
            Avs3dError: for a camera without pixels or focal length, or a scene that cannot be rendered.
        """
        return self._open(pose, intrinsics, second).render(pose)

    def _open(self, pose: Pose, intrinsics: Intrinsics, second: int) -> VisionSession:
        _check(pose, intrinsics)
        scene = self._source.scene(second)
        room = self._room or room_at(scene, pose)
        if self._session is None or self._opened is None or not _same(self._opened, (scene, room, intrinsics)):
            self.close()
            exposed = scene.for_room(room) if room else scene
            self._session, self._opened = self._backend.open(exposed, intrinsics), (scene, room, intrinsics)
        return self._session

    def frames(
        self,
        poses: Mapping[int, Pose],
        intrinsics: Intrinsics = _CAMERA,
        then: Callable[[int, RenderedView], None] = lambda *_: None,
        cores: Callable[[], int] = lambda: 1,
    ) -> Generator[RenderedView]:
        """Yield the frames of some seconds in order, after ``then(second, frame)`` has run on each.

        Args:
            poses: of the camera at the beginning of these seconds. Several at the same time have the exposure of the
                room of the first, if no ``room`` was named.
            intrinsics: of the camera.
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
                    wanted = 1 if self._source.moves else min(cores(), MOST_THREADS)
                    while shared < wanted > 1:
                        # A session that was to be retired, but is not yet, stays.
                        if not retired.acquire(blocking=False):
                            if (session := self._open(poses[order[0]], intrinsics, order[0]).share()) is None:
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
                        frame = self.frame(poses[second], intrinsics, second)
                        then(second, frame)
                        begun = number + 1
                        yield frame
            finally:
                for waiting in ahead:
                    waiting.cancel()

    def close(self) -> None:
        """Free the renderer's resources; the next frame opens the scene again."""
        if self._session is not None:
            self._session.close()
        self._session = self._opened = None


def _same(one: tuple[Scene, str, Intrinsics], other: tuple[Scene, str, Intrinsics]) -> bool:
    return one[0] is other[0] and one[1:] == other[1:]


def _check(pose: object, intrinsics: object) -> None:
    """Refuse other types with the call that makes the right one.

    Raises:
        UsageError: one line.
        Avs3dError: for a camera without pixels or focal length.
    """
    if not isinstance(pose, Pose):
        raise UsageError(
            f"frame: pose {excerpt(pose)}; expected avs3d_bench.geometry.Pose, e.g. scene.look_at(1) or "
            "Pose.from_yaw((x, y, z), yaw)"
        )
    if not isinstance(intrinsics, Intrinsics):
        raise UsageError(
            f"frame: intrinsics {excerpt(intrinsics)}; expected avs3d_bench.geometry.Intrinsics, e.g. "
            "Intrinsics.from_fov(512)"
        )
    check_camera(intrinsics)
