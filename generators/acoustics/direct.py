"""The direct sound of an impulse response, for the direct-to-reverberant ratio."""

from __future__ import annotations

import math
from copy import copy

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.geometry import Pose
from generators.acoustics.geometry import SPEED_OF_SOUND, acoustic_mesh, blocked
from generators.core.scene import Scene

#: The direct sound lies between these times after r/c (s): the nearer ear hears it up to 0.3 ms early, and what a head
#: makes of an impulse is over after 1.5 to 2 ms. A longer window takes in reflections from surfaces near the path.
BEFORE, AFTER = 0.0005, 0.002


class DirectPath:
    """The straight path from a source, as an acoustic engine sees it: without the body of the sounding object.

    Args:
        scene: the home with its objects.
        source: (x, y, z) metres.
    """

    def __init__(self, scene: Scene, source: tuple[float, float, float]) -> None:
        self._triangles = acoustic_mesh(scene, source).triangles
        self._source = np.asarray(source, dtype=np.float64)

    def at(self, source: tuple[float, float, float]) -> DirectPath:
        """The path from where the same source is at another time."""
        moved = copy(self)
        moved._source = np.asarray(source, dtype=np.float64)
        return moved

    def is_free(self, pose: Pose) -> bool:
        """Whether nothing is between the source and the listener."""
        return not blocked(self._triangles, np.asarray(pose.position), self._source)

    def of(
        self, response: NDArray[np.float32], pose: Pose, sample_rate: int = SAMPLE_RATE
    ) -> NDArray[np.float32] | None:
        """The direct part of a response; None if something is between source and listener.

        Args:
            response: (2, n) from the source to the pose.
            pose: of the listener.
            sample_rate: Hz.

        Returns:
            (2, m), m ≤ n: the response with all but its direct sound set to 0.
        """
        if not self.is_free(pose):
            return None
        arrival = math.dist(pose.position, self._source) / SPEED_OF_SOUND
        first = max(math.floor((arrival - BEFORE) * sample_rate), 0)
        last = math.ceil((arrival + AFTER) * sample_rate)
        direct = response[:, :last].copy()
        direct[:, :first] = 0.0
        return direct
