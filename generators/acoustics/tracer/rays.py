"""Directions of the rays: a Fibonacci lattice, turned at random by a counter-based number."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from avs3d_bench.geometry import times_matrix
from generators.acoustics.tracer.philox import words
from generators.core.low_discrepancy import fibonacci_directions

#: Purpose of random numbers (third word of the counter): the turn of the lattice.
_TURN = 0x70


def key_of(seed: int) -> NDArray[np.uint64]:
    """(2,) the key of the random numbers for a seed of up to 64 bits."""
    return np.array([seed & 0xFFFFFFFF, (seed >> 32) & 0xFFFFFFFF], dtype=np.uint64)


def ray_directions(count: int, seed: int, purpose: int) -> NDArray[np.float64]:
    """(N, 3) the lattice after a random rotation that depends on the seed and the purpose alone.

    Uniform over rotations: K. Shoemake, "Uniform random rotations", Graphics Gems III (1992) 124–132.
    """
    low_word, high_word = (int(word) for word in key_of(seed))
    a, b, c, _ = ((word + 0.5) / 2**32 for word in words((purpose, 0, _TURN, 0), (low_word, high_word)))
    b, c = math.tau * b, math.tau * c
    low, high = math.sqrt(1 - a), math.sqrt(a)
    turn = Rotation.from_quat([low * math.sin(b), low * math.cos(b), high * math.sin(c), high * math.cos(c)])
    return times_matrix(fibonacci_directions(count), turn.as_matrix().T)
