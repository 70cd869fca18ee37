"""Work ahead in one process beside this one."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


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
    end_with_parent()
    try:
        for result in work(item):
            connection.send(("result", result))
        connection.send(("end", None))
    except BrokenPipeError:
        return  # the rest is not needed
    except Exception as error:
        connection.send(("error", error))


def end_with_parent() -> None:
    """End this worker when its parent has ended: a killed parent cannot notify it, and it would wait for ever."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
