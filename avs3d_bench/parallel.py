"""Work on many observations in several processes, with a progress bar."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar

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
        Avs3dError: if a process was killed, e.g. for want of memory. What ``work`` raises passes through.
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
        with ProcessPoolExecutor(count, mp_context=context, initializer=_end_with_parent) as pool:
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


@contextmanager
def process_ahead(work: Callable[[Item], Iterator[Result]], item: Item) -> Iterator[Iterator[Result]]:
    """What ``work(item)`` yields, in order, computed in a process of its own that is about one result ahead.

    Leaving the context ends the process.

    Args:
        work: a generator function of a module (it is sent to the other process by name).
        item: what to work on; it is pickled.

    Raises:
        RuntimeError: from the iterator, if the process died. What ``work`` raises passes through.
    """
    # Not fork: the caller may have threads.
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_send_each, args=(theirs, work, item), daemon=True)
    process.start()
    theirs.close()

    def results() -> Iterator[Result]:
        while True:
            try:
                kind, content = ours.recv()
            except EOFError:
                process.join()
                raise RuntimeError(f"{process.name} ended with exit code {process.exitcode}") from None
            if kind == "end":
                return
            if kind == "error":
                raise content
            yield content

    try:
        yield results()
    finally:
        ours.close()
        process.kill()
        process.join()


def _send_each(connection: Connection[Any, Any], work: Callable[[Item], Iterator[Result]], item: Item) -> None:
    _end_with_parent()
    try:
        for result in work(item):
            connection.send(("result", result))
        connection.send(("end", None))
    except BrokenPipeError:
        return  # nobody wants the rest
    except Exception as error:
        connection.send(("error", error))


def _end_with_parent() -> None:
    """End this worker when its parent is gone: a killed parent tells nobody, and workers would wait for ever."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


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
