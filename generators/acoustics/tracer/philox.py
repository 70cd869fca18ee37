"""Counter-based random numbers: Philox4x32-10.

J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC'11.

The numbers are a function of a counter and a key: nothing advances from call to call, so that they do not depend on
the order of calls or on the number of threads. This file is fixed by the known answers of the authors' test, so that
kernels of other files may use it (see `generators.core.jit`).
"""

from __future__ import annotations

import numpy as np

from generators.core.jit import inline

Words = tuple[np.uint64, np.uint64, np.uint64, np.uint64]

_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW, _32 = np.uint64(0xFFFFFFFF), np.uint64(32)
#: Words are 32 bits; half a step keeps uniform numbers off 0 and 1.
_STEP = 2.0**-32


@inline
def philox4x32(c0: np.uint64, c1: np.uint64, c2: np.uint64, c3: np.uint64, k0: np.uint64, k1: np.uint64) -> Words:
    """Four words of 32 random bits for a counter of four words and a key of two; all uint64 below 2^32."""
    for _ in range(10):
        p0, p1 = _M0 * c0, _M1 * c2
        c0, c1, c2, c3 = (p1 >> _32) ^ c1 ^ k0, p1 & _LOW, (p0 >> _32) ^ c3 ^ k1, p0 & _LOW
        k0, k1 = (k0 + _W0) & _LOW, (k1 + _W1) & _LOW
    return c0, c1, c2, c3


@inline
def uniform(word: np.uint64) -> float:
    """A word as a number in (0, 1)."""
    return (np.float64(word) + 0.5) * _STEP


def words(counter: tuple[int, int, int, int], key: tuple[int, int]) -> tuple[int, int, int, int]:
    """`philox4x32` outside of kernels, uncompiled."""
    plain = getattr(philox4x32, "py_func", philox4x32)  # the function itself with NUMBA_DISABLE_JIT
    a, b, c, d = plain(*(np.uint64(word) for word in (*counter, *key)))
    return int(a), int(b), int(c), int(d)
