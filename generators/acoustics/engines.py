"""Acoustic engines for rooms of one's own: one response, many, or a moving source and listener.

Each is a face of a backend that the benchmark's generator uses (`generators.acoustics.base`): the same sessions make
the same responses. An engine holds settings alone, so that one engine serves any number of rooms.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import UsageError, excerpt
from avs3d_bench.geometry import Pose
from avs3d_bench.runtime.parallel import process_each
from generators.acoustics.base import AcousticBackend, AcousticSession, ArrivalSession, BatchSession, Place
from generators.acoustics.rir import Rir
from generators.acoustics.rooms import Room
from generators.acoustics.tracks import as_pose, as_track

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import Scalar
    from generators.acoustics.directivity import Directivity
    from generators.acoustics.soundspaces import RaySettings
    from generators.acoustics.tracer.receivers.base import Receiver
    from generators.acoustics.tracer.settings import TraceSettings

#: A source, and the listeners that hear it.
_Task = tuple[Pose, Sequence[Pose]]

#: Listeners of one task of `Engine.responses`: they share a trace.
_TOGETHER = 128
#: Chunks per process whose responses are in memory together.
_GROUP = 4


class Engine(ABC):
    """What all engines can do.

    Positions are (x, y, z) in metres, Y up; a listener given as a point faces −Z. Sample rates are in Hz.
    """

    #: Whether a response depends on those before it in a session, so that a source's listeners stay together.
    _in_sequence = False
    #: Largest step (m) between two responses of a moving source or listener, and largest turn of a listener (radians).
    _step, _turn = 0.05, math.radians(5)

    @abstractmethod
    def backend(self, receiver: Receiver | None = None) -> AcousticBackend:
        """The backend of the generator that makes the responses.

        Raises:
            UsageError: if the engine has no such receiver.
        """

    def response(
        self,
        room: Room,
        source: ArrayLike | Pose,
        listener: ArrayLike | Pose,
        receiver: Receiver | None = None,
        directivity: Directivity | None = None,
        sample_rate: int = 44_100,
    ) -> Rir:
        """The impulse response of a room.

        Args:
            room: see `Room`.
            source: point, or the pose of a directional source.
            listener: point or pose.
            receiver: what hears it; None: the engine's own head.
            directivity: of the source, see `Directivity`; None: the same in all directions. The front of a source given
                as a point is +Z.
            sample_rate: 8000 to 192000 Hz; SoundSpaces has fewer.

        Raises:
            Avs3dError: one line: a position outside of the room, in a wall or not finite; a rate out of range; a
                receiver that the engine lacks; no sound that arrives.

        Examples:
            >>> from generators.acoustics import Analytic, Room
            >>> room = Room.shoebox((6, 2.7, 4), "plaster")
            >>> Analytic().response(room, (1, 1.5, 2), (4, 1.5, 2)).samples.shape[0]
            2
        """
        pose = as_pose(listener)
        with _Opened(_Asked(self, room, receiver, directivity, sample_rate), source) as opened:
            rir = opened.rir(pose)
            if isinstance(opened.session, ArrivalSession):
                rir = replace(rir, arrivals=opened.session.arrivals(pose))
            return rir

    def responses(
        self,
        room: Room,
        sources: Iterable[ArrayLike | Pose],
        listeners: Iterable[ArrayLike | Pose],
        *,
        receiver: Receiver | None = None,
        directivity: Directivity | None = None,
        sample_rate: int = 44_100,
        processes: int = 1,
        progress: bool = False,
    ) -> Iterator[Rir]:
        """The responses from every source to every listener, source by source, as they are made.

        Listeners of one source share traces, where the engine can do that. The responses and their order are the same
        for any number of processes; only a few are in memory at a time. They carry no arrivals.

        Args:
            room: see `Room`.
            sources: points, or poses of directional sources.
            listeners: points or poses.
            receiver: as in `response`.
            directivity: as in `response`.
            sample_rate: Hz.
            processes: 1: in this process.
            progress: show a bar on stderr.

        Raises:
            Avs3dError: as `response`.
        """
        places = [as_pose(source, f"source {number}") for number, source in enumerate(sources)]
        poses = [as_pose(listener, f"listener {number}") for number, listener in enumerate(listeners)]
        together = max(len(poses), 1) if self._in_sequence else _TOGETHER
        tasks: list[_Task] = [
            (place, poses[first : first + together]) for place in places for first in range(0, len(poses), together)
        ]
        asked = _Asked(self, room, receiver, directivity, sample_rate)
        if processes == 1 and not progress:
            yield from _each(asked, tasks)
        else:
            yield from _in_processes(asked, tasks, processes, progress)

    def render(
        self,
        room: Room,
        signal: ArrayLike,
        source: Any,
        listener: Any,
        receiver: Receiver | None = None,
        directivity: Directivity | None = None,
        sample_rate: int = 44_100,
    ) -> NDArray[np.float32]:
        """A signal as it is heard in a room, by receivers and from sources that may move and turn.

        Moving sound has no seams: see `generators.acoustics.moving` for how, and for what is exact.

        Args:
            room: see `Room`.
            signal: (n,) mono, at ``sample_rate``, from time 0 on.
            source: point or pose, or a path [(seconds, point or pose), …]; before its first time and after its last it
                stands still.
            listener: the same.
            receiver: as in `response`.
            directivity: as in `response`.
            sample_rate: Hz.

        Returns:
            (channels, n) float32: as long as the signal; append silence to it for the reverberation after its end.

        Raises:
            Avs3dError: as `response`, and for a signal or a path that is not finite or of another form.
        """
        from generators.acoustics.moving import Way, render

        samples = _checked_signal(signal)
        tracks = as_track(source, "source"), as_track(listener, "listener")
        with _Opened(_Asked(self, room, receiver, directivity, sample_rate), tracks[0].pose_at(0.0)) as opened:
            for what, track in zip(("source", "listener"), tracks, strict=True):
                for place in track.positions:
                    room.check_inside(what, place)
            heard = opened.receiver if isinstance(opened.session, ArrivalSession) else None
            way = Way(opened.session.sample_rate, len(samples), *tracks, directivity is not None)
            return render(opened.session, heard, samples, way, (self._step, self._turn))


class Tracer(Engine):
    """Geometric acoustics: image sources, diffraction, stochastic rays. Any room, any receiver.

    The same seed gives the same bytes, whatever was asked before.

    Args:
        seed: of the rays.
        device: ``cpu`` or ``cuda``.
        settings: how much work a trace is worth; `TraceSettings`.
        threads: of a trace on the CPU; the responses do not depend on it.

    Raises:
        Avs3dError: if one is out of range, or the device cannot be used.

    Examples:
        >>> from generators.acoustics import Omni, Room
        >>> asked = Room.shoebox((6, 2.7, 4), 0.5), (1, 1.5, 2), (4, 1.5, 2), Omni()
        >>> one, two = (Tracer(seed=3).response(*asked, sample_rate=8000) for _ in range(2))
        >>> one.samples.tobytes() == two.samples.tobytes()
        True
    """

    _step, _turn = 0.1, math.radians(2)

    def __init__(
        self, seed: int = 0, device: str = "cpu", *, settings: TraceSettings | None = None, threads: int = 1
    ) -> None:
        self.seed, self.device, self.settings, self.threads = seed, device, settings, threads
        self.backend()  # checks the arguments

    def backend(self, receiver: Receiver | None = None) -> AcousticBackend:
        """See `Engine.backend`."""
        from generators.acoustics.tracer.backend import TracerBackend

        return TracerBackend(receiver, self.settings, device=self.device, seed=self.seed, threads=self.threads)


class Analytic(Engine):
    """Closed-form acoustics of a box: image sources and a diffuse tail. Needs neither numba nor a compiler.

    A mesh is heard as the box that holds it. The receiver is the engine's own spherical head.

    Args:
        seed: of the noise of the tail.
        images: image sources up to the mixing time (about).
        tail: whether the diffuse tail follows them.

    Raises:
        Avs3dError: if a number is out of range.

    Examples:
        >>> from generators.acoustics import Room
        >>> rir = Analytic(tail=False).response(Room.shoebox((6, 2.7, 4), 0.2), (1, 1.5, 2), (4, 1.5, 2))
        >>> rir.channel_names
        ('left', 'right')
    """

    _step, _turn = 0.025, math.radians(3)

    def __init__(self, seed: int = 0, *, images: int = 2000, tail: bool = True) -> None:
        self.seed, self.images, self.tail = seed, images, tail
        self.backend()

    def backend(self, receiver: Receiver | None = None) -> AcousticBackend:
        """See `Engine.backend`."""
        from generators.acoustics.analytic import AnalyticBackend

        _refuse("Analytic", None if _is_usual_head(receiver) else receiver)
        return AnalyticBackend(images=self.images, tail=self.tail, seed=self.seed)


class SoundSpaces(Engine):
    """The engine of SoundSpaces 2.0 (extra ``soundspaces``; CC-BY-NC 4.0: its output is for non-commercial research).

    Its receivers are its own measured head and `Omni`. A response depends on those before it from the same source.

    Args:
        settings: how much work a response is worth; `generators.acoustics.soundspaces.RaySettings`.

    Raises:
        Avs3dError: if the package is not installed.

    Examples:
        >>> room = Room.shoebox((6, 2.7, 4), "plaster")
        >>> rir = SoundSpaces().response(room, source=(1, 1.5, 2), listener=(4, 1.5, 2))
        >>> rir.samples.shape[0], rir.sample_rate
        (2, 44100)
    """

    _in_sequence = True

    def __init__(self, *, settings: RaySettings | None = None) -> None:
        self.settings = settings
        self.backend()

    def backend(self, receiver: Receiver | None = None) -> AcousticBackend:
        """See `Engine.backend`."""
        from generators.acoustics.soundspaces import SoundSpacesBackend

        omni = type(receiver).__name__ == "Omni"
        _refuse("SoundSpaces", None if omni else receiver)
        return SoundSpacesBackend(self.settings, omni=omni)


@dataclass(frozen=True, eq=False)
class _Asked:
    """What is the same for all responses of a call."""

    engine: Engine
    room: Room
    receiver: Receiver | None
    directivity: Directivity | None
    sample_rate: int

    def check(self) -> None:
        """Refuse what no engine could say in words of the user.

        Raises:
            UsageError: one line.
        """
        if not isinstance(self.room, Room):
            raise UsageError(f"room: got {excerpt(self.room)}, expected Room.shoebox(…) or Room.from_mesh(…)")
        if isinstance(self.engine, Analytic) and not len(self.room.triangles):
            raise UsageError("Analytic has no free field: it needs a room with walls; use Tracer")
        if self.directivity is not None and isinstance(self.engine, SoundSpaces):
            raise UsageError("SoundSpaces has no directional sources; use Tracer or Analytic")
        if self.directivity is not None and not hasattr(self.directivity, "amplitudes"):
            got = excerpt(self.directivity)
            raise UsageError(f"directivity: got {got}, expected Directivity.cardioid(), .table(…) or .file(FILE)")
        if isinstance(self.receiver, type) or (self.receiver is not None and not hasattr(self.receiver, "channels")):
            got = excerpt(self.receiver)
            raise UsageError(
                f"receiver: got {got}, expected one of SphericalHead(), SofaHead(FILE), Array(…), Omni(), …"
            )
        if isinstance(self.sample_rate, bool) or not isinstance(self.sample_rate, int | np.integer):
            raise UsageError(f"sample_rate is {excerpt(self.sample_rate)}, expected a whole number of Hz")


class _Opened:
    """A session in a room, and what it takes to describe its responses."""

    def __init__(self, asked: _Asked, source: Any) -> None:
        asked.check()
        self.source = as_pose(source, "source")
        asked.room.check_inside("source", self.source.position)
        self._asked, self._backend = asked, asked.engine.backend(asked.receiver)
        self.receiver: Receiver | None = getattr(self._backend, "receiver", asked.receiver)
        # Engines that know of no directivity are not asked for one.
        more: dict[str, Any] = {} if asked.directivity is None else {"directivity": asked.directivity}
        self.session: AcousticSession = self._backend.open(
            asked.room.scene, self._place, room=asked.room.box_name, sample_rate=int(asked.sample_rate), **more
        )

    @property
    def _place(self) -> Place:
        """The pose of a directional source, else its position."""
        return self.source.position if self._asked.directivity is None else self.source

    def __enter__(self) -> _Opened:
        return self

    def __exit__(self, *_: object) -> None:
        self.session.close()

    def move_source(self, source: Pose) -> None:
        """Put the source elsewhere for the responses that follow."""
        self._asked.room.check_inside("source", source.position)
        self.source = source
        self.session.move_source(self._place)

    def rir(self, pose: Pose) -> Rir:
        """The response at a pose."""
        self._asked.room.check_inside("listener", pose.position)
        samples = self.session.impulse_response(pose)
        described = {} if self.receiver is None else self.receiver.describe()
        usual = ("left", "right") if len(samples) == 2 else ("omni",)
        return Rir(
            samples,
            self.session.sample_rate,
            usual if self.receiver is None else self.receiver.channel_names,
            self.source.position,
            pose,
            described,
            {**self._backend.describe(), **self._described()},
        )

    def _described(self) -> dict[str, Scalar]:
        """The room and the source."""
        room, directivity = self._asked.room, self._asked.directivity
        found: dict[str, Scalar] = {"room": room.name, "faces": len(room.triangles)}
        if directivity is not None:
            rotation = " ".join(f"{value:.6g}" for value in self.source.rotation)
            found |= {"directivity": directivity.name, "source_rotation": rotation}
        return found


def _each(asked: _Asked, tasks: Sequence[_Task]) -> Iterator[Rir]:
    """The responses of some sources and listeners; one session, unless its responses depend on those before."""
    opened: _Opened | None = None
    try:
        for source, poses in tasks:
            if opened is not None and not asked.engine._in_sequence:
                opened.move_source(source)
            else:
                if opened is not None:
                    opened.session.close()
                opened = _Opened(asked, source)
            if isinstance(opened.session, BatchSession):
                opened.session.prepare(poses)
            for pose in poses:
                yield opened.rir(pose)
    finally:
        if opened is not None:
            opened.session.close()


def _respond(asked: _Asked, numbered: tuple[int, Sequence[_Task]]) -> list[Rir]:
    return list(_each(asked, numbered[1]))


def _in_processes(asked: _Asked, tasks: list[_Task], processes: int, progress: bool) -> Iterator[Rir]:
    """The responses of all tasks in their order; a few chunks at a time, so that memory stays bounded."""
    chunks: list[list[_Task]] = []
    for task in tasks:
        if chunks and sum(len(poses) for _, poses in (*chunks[-1], task)) <= _TOGETHER:
            chunks[-1].append(task)
        else:
            chunks.append([task])
    group = _GROUP * max(processes, 1)
    for first in range(0, len(chunks), group):
        some = list(enumerate(chunks[first : first + group], first))
        sizes = [sum(len(poses) for _, poses in chunk) for _, chunk in some]
        label = f"responses, part {first // group + 1} of {math.ceil(len(chunks) / group)}"
        work = partial(_respond, asked)
        done = process_each(work, some, workers=processes, label=label, progress=progress, sizes=sizes)
        found = {number: rirs for (number, _), rirs in done}
        for number in sorted(found):
            yield from found[number]


def _checked_signal(signal: ArrayLike) -> NDArray[np.float64]:
    try:
        samples = np.array(signal, dtype=np.float64)
    except (TypeError, ValueError):
        samples = np.zeros(0)
    if samples.ndim != 1 or not len(samples):
        raise UsageError(f"signal: has shape {np.shape(signal)}, expected (n,) mono samples")
    bad = int((~np.isfinite(samples)).sum())
    if bad:
        raise UsageError(f"signal: {bad} of {len(samples)} samples are NaN or infinite; repair it")
    return samples


def _is_usual_head(receiver: Receiver | None) -> bool:
    """Whether a receiver is the spherical head of the usual radius."""
    from generators.acoustics.hrtf import HEAD_RADIUS

    return type(receiver).__name__ == "SphericalHead" and getattr(receiver, "radius", None) == HEAD_RADIUS


def _refuse(engine: str, receiver: Receiver | None) -> None:
    """Refuse receivers that only the tracer has."""
    if receiver is not None:
        raise UsageError(f"{engine} has no {type(receiver).__name__}; leave the receiver out, or use Tracer")
