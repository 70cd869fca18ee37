"""Random numbers as a caller gives them: a generator, or a seed."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from avs3d_bench.errors import UsageError, excerpt


def random_numbers(given: Generator | int, name: str = "rng") -> Generator:
    """The generator itself, or one with that seed.

    Args:
        given: a generator, whose state goes on, or a seed of 0 or more.
        name: of the argument, for the message.

    Raises:
        UsageError: for anything else.

    Examples:
        >>> int(random_numbers(7).integers(100)) == int(random_numbers(np.random.default_rng(7)).integers(100))
        True
    """
    if isinstance(given, Generator):
        return given
    if isinstance(given, bool) or not isinstance(given, int | np.integer) or given < 0:
        raise UsageError(f"{name}: found {excerpt(given)}; expected a whole number of 0 or more, or a numpy Generator")
    return np.random.default_rng(int(given))
