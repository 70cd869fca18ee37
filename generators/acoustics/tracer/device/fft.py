"""Fourier transforms on a CUDA device: mixed radix, of many rows at once, the same bytes for any number of rows.

The self-sorting algorithm of Stockham (C. Van Loan, *Computational Frameworks for the Fast Fourier Transform*, SIAM
1992, § 1.7): every stage reads all numbers and writes them in another order. Lengths are products of 2, 3, 5 and 7.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numba.cuda
import numpy as np

from generators.core.cuda import kernel, launch, upload

cuda: Any = numba.cuda

#: Radices of the stages, in the order in which they are taken out of a length.
_RADICES = (4, 2, 3, 5, 7)


def _stage_of(radix: int) -> Callable[..., None]:
    """The kernel of one stage; with a constant radix its loops are unrolled."""

    @kernel
    def stage(  # pragma: no cover  # compiled
        x: Any, y: Any, rows: int, first: int, length: int, inner: int, stride: int, twiddles: Any
    ) -> None:
        i = cuda.grid(1)
        threads = length // radix * inner
        row = i // threads
        if row >= rows:
            return
        t = i - row * threads
        p = t // stride
        q = t - p * stride
        done = stride // inner  # product of the radices of the stages before
        re, im = cuda.local.array(radix, x.dtype), cuda.local.array(radix, x.dtype)
        for j in range(radix):
            re[j], im[j] = x[row, first + t + threads * j, 0], x[row, first + t + threads * j, 1]
        for k in range(radix):
            a, b = re[0], im[0]
            for j in range(1, radix):
                w = (j * k % radix) * (length // radix)
                c, s = twiddles[w, 0], twiddles[w, 1]
                a, b = a + re[j] * c - im[j] * s, b + re[j] * s + im[j] * c
            c, s = twiddles[p * k * done, 0], twiddles[p * k * done, 1]
            at = first + q + stride * (radix * p + k)
            y[row, at, 0], y[row, at, 1] = a * c - b * s, a * s + b * c

    return stage  # type: ignore[no-any-return]


_stages = {radix: _stage_of(radix) for radix in _RADICES}


@lru_cache(maxsize=64)
def _twiddles(length: int, inverse: bool, double: bool) -> Any:
    """(length, 2) real and imaginary part of exp(∓2πi·k/length)."""
    angle = (2 if inverse else -2) * np.pi * np.arange(length) / length
    table = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return upload(table if double else table.astype(np.float32), "tables of the Fourier transform")


def factors(length: int) -> list[int]:
    """The radices of ``length``.

    Raises:
        ValueError: if it has a prime factor above 7.
    """
    found, left = [], length
    for radix in _RADICES:
        while left % radix == 0:
            found.append(radix)
            left //= radix
    if left != 1:
        raise ValueError(f"a Fourier transform of {length} numbers; expected a product of 2, 3, 5 and 7")
    return found


def transform(x: Any, y: Any, rows: int, first: int, length: int, inner: int, inverse: bool = False) -> bool:
    """Transform ``inner`` interleaved series of ``length`` complex numbers in each of the first ``rows`` rows.

    Args:
        x: (R, n, 2) real and imaginary parts, float32 or float64; a row's series are the numbers from ``first`` on, in
            the order (time, series). Overwritten.
        y: like ``x``; overwritten.
        rows: number of rows.
        first: number of a row at which the series begin.
        length: of a series.
        inner: number of series.
        inverse: exp(+2πi…) instead of exp(−2πi…); without the factor 1/length.

    Returns:
        whether the result is in ``y``.
    """
    double = np.dtype(x.dtype) == np.float64
    table = _twiddles(length, inverse, double)
    stride, swapped = inner, False
    for radix in factors(length):
        source, target = (y, x) if swapped else (x, y)
        launch(
            _stages[radix], rows * (length // radix) * inner, source, target, rows, first, length, inner, stride, table
        )
        stride *= radix
        swapped = not swapped
    return swapped
