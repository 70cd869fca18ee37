"""Work on many observations in several processes, with a progress bar."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.ahead import end_with_parent

Item = TypeVar("Item")
Result = TypeVar("Result")


def available_cores() -> int:
    """Number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def process_each(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    workers: int | None = None,
    label: str = "",
    progress: bool = False,
    sizes: Sequence[int] | None = None,
) -> Iterator[tuple[Item, Result]]:
    """Yield (item, ``work(item)``) as they are done, in any order; with one worker in this process and in order.

    Args:
        work: a function of a module (it is sent to other processes by name). It may call `advance`.
        items: what to work on.
        workers: processes; None: one per core. Never more than items.
        label: what the progress bar says.
        progress: show a bar on stderr.
        sizes: what each item counts on the bar, e.g. its number of frames; None: 1 each.

    Raises:
        Avs3dError: if a process was killed, e.g. because memory ran out. What ``work`` raises passes through.
    """
    count = max(1, min(workers or available_cores(), len(items)))
    counted = list(sizes) if sizes is not None else [1] * len(items)
    pairs = list(zip(items, counted, strict=True))
    with _Bar(label, sum(counted), progress) as bar:
        if count == 1:
            for item, size in pairs:
                result = _measured(work, item, size, bar.add)
                yield item, result
            return
        # Not fork: the caller may have threads (a progress bar, OpenCV's pool).
        context = multiprocessing.get_context("spawn")
        shared = context.Value("d", 0.0) if progress else None
        with ProcessPoolExecutor(count, mp_context=context, initializer=_begin, initargs=(shared,)) as pool:
            futures = {pool.submit(_work_here, work, item, size): item for item, size in pairs}
            try:
                while futures:
                    done, _ = wait(futures, _POLL if shared else None, FIRST_COMPLETED)
                    if shared is not None:
                        bar.set(shared.value)
                    for future in done:
                        result = future.result()
                        yield futures.pop(future), result
            except BrokenProcessPool:
                raise Avs3dError("a worker process was ended (memory?); run with --workers 1") from None
            finally:
                for future in futures:
                    future.cancel()


def advance(done: int, total: int) -> None:
    """Say, from the work of `process_each`, which part of the present item is done; elsewhere it does nothing.

    Args:
        done: parts that are done, e.g. frames.
        total: parts of the item.
    """
    if _item is not None:
        _item.reach(done / max(1, total))


class _Item:
    """How far the present item is. ``add`` gets what is new, in the unit of ``size``."""

    def __init__(self, size: int, add: Callable[[float], None]) -> None:
        self._size, self._add, self._share = size, add, 0.0

    def reach(self, share: float) -> None:
        share = min(1.0, share)
        if share > self._share:
            self._add((share - self._share) * self._size)
            self._share = share


#: The current item of this process; None: its progress is not reported.
_item: _Item | None = None
#: The counter of a worker process, which its parent reads.
_shared: Any = None
#: Time between two looks at the counter (s).
_POLL = 0.2


def _measured(work: Callable[[Item], Result], item: Item, size: int, add: Callable[[float], None]) -> Result:
    """``work(item)``, which may tell how far it is; at its end all of the item is counted."""
    global _item
    before, _item = _item, _Item(size, add)
    try:
        result = work(item)
        _item.reach(1.0)
        return result
    finally:
        _item = before


def _begin(shared: Any) -> None:
    """Start a worker process."""
    global _shared
    _shared = shared
    end_with_parent()


def _work_here(work: Callable[[Item], Result], item: Item, size: int) -> Result:
    """Work on an item in a worker process."""
    return work(item) if _shared is None else _measured(work, item, size, _count)


def _count(size: float) -> None:
    with _shared.get_lock():
        _shared.value += size


class _Bar:
    """A context with a progress bar on stderr if ``shown``."""

    def __init__(self, label: str, total: int, shown: bool) -> None:
        self._label, self._total, self._shown = label, total, shown
        self._done = 0.0

    def __enter__(self) -> _Bar:
        if self._shown:
            from rich.console import Console
            from rich.progress import Progress

            self._progress = Progress(console=Console(stderr=True), transient=True)
            self._progress.start()
            self._task = self._progress.add_task(self._label, total=self._total)
        return self

    def add(self, size: float) -> None:
        """Count ``size`` more."""
        self.set(self._done + size)

    def set(self, done: float) -> None:
        """Show that ``done`` of the total are done."""
        self._done = done
        if self._shown:
            self._progress.update(self._task, completed=done)

    def __exit__(self, *_: object) -> None:
        if self._shown:
            self._progress.stop()
