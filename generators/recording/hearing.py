"""What is heard from each pose of an observation: in this process, or in one beside it once a core is free."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout
from avs3d_bench.ahead import moved_beside
from avs3d_bench.geometry import Pose
from generators.acoustics.base import AcousticSession, BatchSession
from generators.acoustics.clips import binaural_clip, moving_clip
from generators.backends import acoustic_backend
from generators.core.scene import Scene

#: Seconds of the source before the first frame, so that the first clip holds reverberation too.
PRE_ROLL = 2
#: Poses that hear a moving source at one place: a clip needs the places one second before and after it too.
_POSES_OF_A_PLACE = 3

Vector = tuple[float, float, float]
#: A frame's clip (2, 44100) and the impulse response (2, n) from where the source is at its beginning.
Heard = tuple[NDArray[np.float32], NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class Listening:
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
    """

    backend: str
    absorption_scale: float
    scene: Scene
    room: str
    samples: NDArray[np.float32]
    poses: tuple[Pose, ...]
    sources: tuple[Vector, ...]


def hear(listening: Listening) -> Generator[Heard]:
    """What is heard in each second, in order: an engine's responses depend on the sequence of calls."""
    engine = acoustic_backend(listening.backend, absorption_scale=listening.absorption_scale)
    session = engine.open(listening.scene, listening.sources[0], room=listening.room, sample_rate=layout.SAMPLE_RATE)
    if isinstance(session, BatchSession):
        moves = len(listening.sources) > 1
        session.prepare(listening.poses, *([_POSES_OF_A_PLACE] if moves else []))
    try:
        for index in range(len(listening.poses)):
            yield _hear_second(session, listening, index)
    finally:
        session.close()


def heard(listening: Listening, beside: Callable[[], bool] = lambda: False) -> AbstractContextManager[Iterator[Heard]]:
    """`hear`, in a process of its own from the second on for which ``beside`` says yes (see `moved_beside`).

    The SoundSpaces engine holds Python's global lock while it works: in this process no other thread would get on. Its
    responses depend on all that came before them, so that no second process could share the work.
    """
    return moved_beside(hear(listening), beside)


def _hear_second(session: AcousticSession, listening: Listening, index: int) -> Heard:
    pose, sources = listening.poses[index], listening.sources
    if len(sources) == 1:
        response = session.impulse_response(pose)
        return binaural_clip(listening.samples, response, index + PRE_ROLL), response
    # Before the first frame the source stands where it begins.
    places = [sources[second] for second in range(max(index - 1, 0), index + 2)]
    responses = []
    for place in places:
        session.move_source(place)
        responses.append(session.impulse_response(pose))
    distances = [math.dist(place, pose.position) for place in places]
    return moving_clip(listening.samples, responses, distances, index + PRE_ROLL), responses[-2]
