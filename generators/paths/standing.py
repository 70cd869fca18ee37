"""An agent that stays at one place of a walk: it stands, or turns slowly.

Recordings for sound event localisation are made with microphones that stand in a room (STARSS23). The place is one of
those that a walk passes, so that all that holds for a walk holds for it: free floor, objects in sight from somewhere
along it, none of them preferred.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from generators.paths.motion import Motion, categories_of
from generators.paths.tours import OBJECT_DISTANCE, distances

#: Range of the rate at which an agent turns (degrees a second), to the left or to the right.
TURN_RATE = (3.0, 9.0)


def stay(
    poses: Sequence[Pose], rng: Generator, *, turns: bool, motions: Sequence[Motion] = (), name: str = "room"
) -> tuple[Pose, ...]:
    """Poses at one place of a walk, level, as many as the walk has.

    Args:
        poses: of the walk, one a second.
        rng: the only source of randomness.
        turns: whether the agent turns at an even rate (`TURN_RATE`); else it faces as it did there.
        motions: of the objects that move: none of them may come nearer than `OBJECT_DISTANCE`.
        name: of the room, for the message.

    Raises:
        Avs3dError: if a moving object comes near to every place of the walk.
    """
    for index in rng.permutation(len(poses)):
        start = poses[int(index)]
        track = np.tile(np.array(start.position)[[0, 2]], (len(poses), 1))
        if not motions or distances(track, motions).min() >= OBJECT_DISTANCE:
            break
    else:
        raise Avs3dError(
            f"{name}: the moving {categories_of(motions)} comes nearer than {OBJECT_DISTANCE} m to every place of "
            "the walk; choose a larger room, another seed, or agent: walking"
        )
    ahead = -start.rotation_matrix[:, 2]
    yaw = math.atan2(-ahead[0], -ahead[2])
    rate = math.radians(rng.uniform(*TURN_RATE)) * (1 if rng.uniform() < 0.5 else -1) if turns else 0.0
    return tuple(Pose.from_yaw(start.position, yaw + rate * second) for second in range(len(poses)))
