"""Work that is done one step ahead, in a thread."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")
#: Items that are worked on before they are asked for.
DEPTH = 3


class Ahead(Generic[Item, Result]):
    """A context that iterates over (item, work(item)), in order; the next items are worked on meanwhile.

    Args:
        work: called in one thread.
        items: what to work on.
    """

    def __init__(self, work: Callable[[Item], Result], items: Sequence[Item]) -> None:
        self._work, self._items = work, items
        self._pool = ThreadPoolExecutor(1)

    def __enter__(self) -> Iterator[tuple[Item, Result]]:
        return self._iterate()

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _iterate(self) -> Iterator[tuple[Item, Result]]:
        waiting: list[tuple[Item, Future[Result]]] = []
        for item in self._items:
            waiting.append((item, self._pool.submit(self._work, item)))
            if len(waiting) > DEPTH:
                first, future = waiting.pop(0)
                yield first, future.result()
        for first, future in waiting:
            yield first, future.result()
