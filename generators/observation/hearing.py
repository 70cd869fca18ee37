"""Hear the sources of an observation from each pose: in this process, or in one beside it once a core is free.

The sources are independent of one another: each has an acoustic session of its own, so that what is heard of it has the
same bytes whatever else sounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.geometry import Pose
from avs3d_bench.runtime.ahead import continue_in_fork
from generators.acoustics.base import AcousticBackend, AcousticSession, BatchSession, Place, ReceiverSession
from generators.acoustics.clips import STEP_SECONDS, joined, moving_clip, receiver_clip
from generators.acoustics.direct import DirectPath
from generators.acoustics.directivity import Directivity
from generators.backends import acoustic_backend
from generators.core.scene import Scene
from generators.observation.stems import Clip, direct_to_reverberant
from generators.options import EngineOptions

Sound = TypeVar("Sound")

#: Seconds of the source before the first frame, so that the first clip holds reverberation too.
PRE_ROLL = 2
#: Samples in which the listener gets from one pose to the next.
_STEP = round(STEP_SECONDS * layout.SAMPLE_RATE)
#: Name of the head among the receivers of `responses_at`.
HEAD = "head"
#: Poses that hear a moving source at one place: a clip needs the places one second before and after it too.
_POSES_OF_A_PLACE = 3
#: Poses that all sessions together compute at a time; their arrivals are in memory, about 1 MB each.
_TOGETHER = 128


@dataclass(frozen=True, eq=False)
class Recording:
    """The sound of one receiver in one second.

    Attributes:
        clip: (channels, 44100) float32.
        response: (channels, n) float32, from where the source is at the beginning of the second.
        tail: (channels, k) float32, how the sound goes on for a listener who stays where they are.
    """

    clip: NDArray[np.float32]
    response: NDArray[np.float32]
    tail: NDArray[np.float32]

    @classmethod
    def of(cls, samples: NDArray[np.float32], response: NDArray[np.float32]) -> Recording:
        """A second with its tail, as `receiver_clip` and `moving_clip` give them."""
        return cls(samples[:, : layout.BINAURAL_SAMPLES], response, samples[:, layout.BINAURAL_SAMPLES :])

    def after(self, before: Recording) -> Recording:
        """The recording of a second, joined to that of the second before."""
        return replace(self, clip=joined(self.clip, before.tail))


@dataclass(frozen=True, eq=False)
class HeardSource:
    """The sound of one source in one second.

    Attributes:
        head: what the two ears hear; channel 0 is left.
        others: name of each other receiver → what it hears.
        drr_db: level of the direct sound in the head's clip above that of all that comes later; None where there is
            none of either, or it was not asked for.
    """

    head: Recording
    others: Mapping[str, Recording] = field(default_factory=dict)
    drr_db: float | None = None

    def after(self, before: HeardSource) -> HeardSource:
        """What is heard in a second, joined to what is heard in the second before."""
        others = {name: one.after(before.others[name]) for name, one in self.others.items()}
        return replace(self, head=self.head.after(before.head), others=others)


@dataclass(frozen=True, eq=False)
class AcousticJob:
    """Everything that decides what is heard of one source.

    Attributes:
        options: the acoustic engine, its receivers and its device.
        absorption_scale: see `AcousticBackend`.
        seed: of the engine's random numbers; None: its usual one.
        scene: the home with the objects at time 0.
        room: where the source is.
        samples: (n,) float32, what the source plays from `PRE_ROLL` seconds before the first frame on.
        poses: of the listener at the beginning of each second.
        path: pose of a source that moves at the beginning of each second and at the end, len(poses) + 1; the one pose
            of a source that stands still.
        directivity: of the source in its own frame; None: alike in all directions.
        measures_direct: whether the level of the direct sound is measured.
    """

    options: EngineOptions
    absorption_scale: float
    seed: int | None
    scene: Scene
    room: str
    samples: NDArray[np.float32]
    poses: tuple[Pose, ...]
    path: tuple[Pose, ...]
    directivity: Directivity | None = None
    measures_direct: bool = False

    def engine(self) -> AcousticBackend:
        """The acoustic engine with its receivers."""
        return acoustic_backend(self.options, absorption_scale=self.absorption_scale, seed=self.seed)

    def open(self, together: int) -> AcousticSession:
        """A session of the engine; ``together``: number of poses that it may compute at a time."""
        # Engines that know of no directivity are asked without one.
        directed = {} if self.directivity is None else {"directivity": self.directivity}
        session = self.engine().open(
            self.scene, self.place(0), room=self.room, sample_rate=layout.SAMPLE_RATE, **directed
        )
        if isinstance(session, BatchSession):
            session.prepare(self.poses, together)
        return session

    def place(self, second: int) -> Place:
        """Where the source is at the beginning of a second; how it is turned, if that can be heard."""
        pose = self.path[second]
        return pose.position if self.directivity is None else pose

    def seconds(self, index: int) -> Sequence[int]:
        """When what is heard in a second has left the source: full seconds, those of ``path``."""
        # Before the first frame the source stands where it begins.
        return range(max(index - 1, 0), index + 2) if self.moves else (0,)

    @property
    def moves(self) -> bool:
        """Whether the source moves."""
        return len(self.path) > 1


def hear_sources(jobs: Sequence[AcousticJob], seconds: int) -> Generator[tuple[HeardSource, ...]]:
    """Hear every source in each second, in order: an engine's responses depend on the sequence of calls.

    Args:
        jobs: one per source, with the same poses; none for silence.
        seconds: number of seconds.

    Yields:
        for each second what is heard of each source.
    """
    sessions: list[AcousticSession] = []
    try:
        for job in jobs:
            sessions.append(job.open(_POSES_OF_A_PLACE if job.moves else max(1, _TOGETHER // len(jobs))))
        paths = [DirectPath(job.scene, job.path[0].position) if job.measures_direct else None for job in jobs]
        before: tuple[HeardSource, ...] = ()
        for index in range(seconds):
            heard = tuple(_hear(*one, index) for one in zip(jobs, sessions, paths, strict=True))
            yield tuple(one.after(last) for one, last in zip(heard, before, strict=True)) if before else heard
            before = heard
    finally:
        for session in sessions:
            session.close()


def hear_in_background(
    sounds: Generator[Sound], device: str, beside: Callable[[], bool] = lambda: False
) -> AbstractContextManager[Iterator[Sound]]:
    """Hear in a process of its own from the second on for which ``beside`` says yes (see `continue_in_fork`).

    The SoundSpaces engine holds Python's global lock while it works: in this process no other thread would get on. Its
    responses depend on all that came before them, so that no second process could share the work. What CUDA does stays
    here: a forked process cannot use the device.

    Args:
        sounds: of each second, as `hear_sources` makes them.
        device: that traces them.
        beside: asked before each second.
    """
    return continue_in_fork(sounds, beside if device == "cpu" else lambda: False)


def responses_at(session: AcousticSession, pose: Pose) -> dict[str, NDArray[np.float32]]:
    """Receiver → its response (channels, n) at a pose; the head, called `HEAD`, comes first."""
    found = {HEAD: session.impulse_response(pose)}
    return found | session.other_responses(pose) if isinstance(session, ReceiverSession) else found


def _hear(job: AcousticJob, session: AcousticSession, direct: DirectPath | None, index: int) -> HeardSource:
    """Hear second ``index`` of one source."""
    pose = job.poses[index]
    found: list[dict[str, NDArray[np.float32]]] = []
    for second in job.seconds(index):
        if job.moves:
            session.move_source(job.place(second))
        found.append(responses_at(session, pose))
    recordings = {}
    for name in found[0]:
        responses = [one[name] for one in found]
        # The response from where the source is at the beginning of the second.
        recordings[name] = Recording.of(_clip(job, responses, index, _STEP), responses[-2 if job.moves else 0])
    head = recordings.pop(HEAD)
    level = None if direct is None else _direct_level(job, direct, head, [one[HEAD] for one in found], index)
    return HeardSource(head, recordings, level)


def _clip(job: AcousticJob, responses: Sequence[NDArray[np.float32]], index: int, tail: int) -> Clip:
    """A clip with its tail; a source that moves is heard from where it was when the sound left it.

    Args:
        job: of the source.
        responses: from where it is at each of `AcousticJob.seconds`.
        index: of the clip.
        tail: samples of the next second.
    """
    if not job.moves:
        return receiver_clip(job.samples, responses[0], index + PRE_ROLL, tail=tail)
    listener = job.poses[index].position
    distances = [math.dist(job.path[second].position, listener) for second in job.seconds(index)]
    return moving_clip(job.samples, responses, distances, index + PRE_ROLL, tail=tail)


def _direct_level(
    job: AcousticJob, path: DirectPath, head: Recording, responses: Sequence[NDArray[np.float32]], index: int
) -> float | None:
    """Level of the direct sound above that of the rest, dB; None if there is no direct sound."""
    pose = job.poses[index]
    places = [job.path[second].position for second in job.seconds(index)]
    found = [path.at(place).of(one, pose) for place, one in zip(places, responses, strict=True)]
    if all(one is None for one in found):
        return None
    direct = [np.zeros((2, 1), dtype=np.float32) if one is None else one for one in found]
    return direct_to_reverberant(_clip(job, direct, index, 0), head.clip)
