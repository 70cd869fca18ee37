"""Work on many observations in several processes, with a progress bar."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from avs3d_bench.ahead import end_with_parent
from avs3d_bench.errors import Avs3dError

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
) -> Iterator[tuple[Item, Result]]:
    """Yield (item, ``work(item)``) as they are done, in any order; with one worker in this process and in order.

    Args:
        work: a function of a module (it is sent to other processes by name).
        items: what to work on.
        workers: processes; None: one per core. Never more than items.
        label: what the progress bar says.
        progress: show a bar on stderr.

    Raises:
        Avs3dError: if a process was killed, e.g. because memory ran out. What ``work`` raises passes through.
    """
    count = max(1, min(workers or available_cores(), len(items)))
    with _Bar(label, len(items), progress) as advance:
        if count == 1:
            for item in items:
                result = work(item)
                advance()
                yield item, result
            return
        # Not fork: the caller may have threads (a progress bar, OpenCV's pool).
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(count, mp_context=context, initializer=end_with_parent) as pool:
            futures = {pool.submit(work, item): item for item in items}
            try:
                for future in as_completed(futures):
                    result = future.result()
                    advance()
                    yield futures.pop(future), result
            except BrokenProcessPool:
                raise Avs3dError("a worker process was ended (memory?); run with --workers 1") from None
            finally:
                for future in futures:
                    future.cancel()


class _Bar:
    """A context that gives ``advance()``; a progress bar on stderr if ``shown``."""

    def __init__(self, label: str, total: int, shown: bool) -> None:
        self._label, self._total, self._shown = label, total, shown

    def __enter__(self) -> Callable[[], None]:
        if not self._shown:
            return lambda: None
        from rich.console import Console
        from rich.progress import Progress

        self._progress = Progress(console=Console(stderr=True), transient=True)
        self._progress.start()
        task = self._progress.add_task(self._label, total=self._total)
        return lambda: self._progress.update(task, advance=1)

    def __exit__(self, *_: object) -> None:
        if self._shown:
            self._progress.stop()
