"""Matrix products with the same bytes for any number of threads of the BLAS library.

OpenBLAS divides a product among its threads, and the order in which it adds depends on how many there are. Commands and
worker processes start with one thread each (`avs3d_bench.runtime.one_thread`); a program that calls the package may
have more.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

P = ParamSpec("P")
R = TypeVar("R")


def one_blas_thread(work: Callable[P, R]) -> Callable[P, R]:
    """Decorator: the function's products and decompositions run on one thread."""

    @wraps(work)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with threadpool_limits(limits=1, user_api="blas"):
            return work(*args, **kwargs)

    return limited
