"""Hear an observation from each pose: in this process, or in one beside it once a core is free."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout
from avs3d_bench.ahead import continue_in_fork
from avs3d_bench.geometry import Pose
from generators.acoustics.base import AcousticBackend, AcousticSession, BatchSession, ReceiverSession
from generators.acoustics.clips import moving_clip, receiver_clip
from generators.backends import acoustic_backend
from generators.core.scene import Scene
from generators.receivers import OWN_HEAD, Receivers

Sound = TypeVar("Sound")

#: Seconds of the source before the first frame, so that the first clip holds reverberation too.
PRE_ROLL = 2
#: Name of the head among the receivers of `responses_at`.
HEAD = "head"
#: Poses that hear a moving source at one place: a clip needs the places one second before and after it too.
_POSES_OF_A_PLACE = 3

Vector = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Recording:
    """The sound of one receiver in one second.

    Attributes:
        clip: (channels, 44100) float32.
        response: (channels, n) float32, from where the source is at the beginning of the second.
    """

    clip: NDArray[np.float32]
    response: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class ReceiverClips:
    """The sound of all receivers in one second.

    Attributes:
        head: what the two ears hear; channel 0 is left.
        others: name of each other receiver → what it hears.
    """

    head: Recording
    others: Mapping[str, Recording] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class AcousticJob:
    """Everything that decides the clips of an observation.

    Attributes:
        backend: name of the acoustic engine.
        absorption_scale: see `AcousticBackend`.
        scene: the home with the objects at time 0.
        room: where the source is.
        samples: (n,) float32, what the source plays from `PRE_ROLL` seconds before the first frame on.
        poses: of the listener at the beginning of each second.
        sources: position of a source that moves at the beginning of each second and at the end, len(poses) + 1; the
            one position of a source that stands still.
        receivers: what hears it.
        device: what traces the sound: ``cpu`` or ``cuda``.
        seed: of the engine's random numbers; None: its usual one.
    """

    backend: str
    absorption_scale: float
    scene: Scene
    room: str
    samples: NDArray[np.float32]
    poses: tuple[Pose, ...]
    sources: tuple[Vector, ...]
    receivers: Receivers = OWN_HEAD
    device: str = "cpu"
    seed: int | None = None

    def engine(self) -> AcousticBackend:
        """The acoustic engine with its receivers."""
        return acoustic_backend(
            self.backend,
            absorption_scale=self.absorption_scale,
            receivers=self.receivers,
            device=self.device,
            seed=self.seed,
        )


def hear(listening: AcousticJob) -> Generator[ReceiverClips]:
    """Hear each second, in order: an engine's responses depend on the sequence of calls."""
    session = listening.engine().open(
        listening.scene, listening.sources[0], room=listening.room, sample_rate=layout.SAMPLE_RATE
    )
    moves = len(listening.sources) > 1
    hear_one = _hear_moving if moves else hear_still
    if isinstance(session, BatchSession):
        session.prepare(listening.poses, *([_POSES_OF_A_PLACE] if moves else []))
    try:
        for index in range(len(listening.poses)):
            yield hear_one(session, listening, index)
    finally:
        session.close()


def hear_in_background(
    sounds: Generator[Sound], device: str, beside: Callable[[], bool] = lambda: False
) -> AbstractContextManager[Iterator[Sound]]:
    """Hear in a process of its own from the second on for which ``beside`` says yes (see `continue_in_fork`).

    The SoundSpaces engine holds Python's global lock while it works: in this process no other thread would get on. Its
    responses depend on all that came before them, so that no second process could share the work. What CUDA does stays
    here: a forked process cannot use the device.

    Args:
        sounds: of each second, as `hear` makes them.
        device: that traces them.
        beside: asked before each second.
    """
    return continue_in_fork(sounds, beside if device == "cpu" else lambda: False)


def responses_at(session: AcousticSession, pose: Pose) -> dict[str, NDArray[np.float32]]:
    """Receiver → its response (channels, n) at a pose; the head, called `HEAD`, comes first."""
    found = {HEAD: session.impulse_response(pose)}
    return found | session.other_responses(pose) if isinstance(session, ReceiverSession) else found


def hear_still(session: AcousticSession, listening: AcousticJob, index: int) -> ReceiverClips:
    """Hear second ``index`` of a source that stands still."""
    responses = responses_at(session, listening.poses[index])
    samples, second = listening.samples, index + PRE_ROLL
    return _heard({name: Recording(receiver_clip(samples, one, second), one) for name, one in responses.items()})


def _hear_moving(session: AcousticSession, listening: AcousticJob, index: int) -> ReceiverClips:
    """The same of a source that moves: it is heard from where it was when the sound left it."""
    pose = listening.poses[index]
    # Before the first frame the source stands where it begins.
    places = [listening.sources[second] for second in range(max(index - 1, 0), index + 2)]
    found: list[dict[str, NDArray[np.float32]]] = []
    for place in places:
        session.move_source(place)
        found.append(responses_at(session, pose))
    distances = [math.dist(place, pose.position) for place in places]
    recordings = {}
    for name in found[0]:
        clip = moving_clip(listening.samples, [one[name] for one in found], distances, index + PRE_ROLL)
        recordings[name] = Recording(clip, found[-2][name])
    return _heard(recordings)


def _heard(recordings: dict[str, Recording]) -> ReceiverClips:
    return ReceiverClips(recordings[HEAD], {name: one for name, one in recordings.items() if name != HEAD})
