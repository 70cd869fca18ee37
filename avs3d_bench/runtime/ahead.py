"""Go on with an iterator in a process beside this one."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar

Result = TypeVar("Result")


@contextmanager
def continue_in_fork(results: Generator[Result], wanted: Callable[[], bool]) -> Iterator[Iterator[Result]]:
    """The same results in the same order; from the moment they are ``wanted`` there, from a process beside this one.

    The process is a fork of this one: it inherits whatever state the iterator has reached (an engine that no other
    process could put into this state), needs no start-up time and shares the memory. It is about one result ahead.
    Where fork is unsafe (all systems but Linux), the results stay in this process.

    The caller must not run other threads when ``wanted`` first says yes: they might hold a lock that is never released
    in the fork.

    Leaving the context ends the process, and closes ``results``.

    Args:
        results: an iterator that is used by nobody else.
        wanted: asked before each result, until it says yes.

    Raises:
        ChildProcessError: from the iterator, if the process died. What ``results`` raises passes through.
    """
    started: list[_Beside] = []

    def each() -> Iterator[Result]:
        while not (sys.platform == "linux" and wanted()):
            try:
                result = next(results)
            except StopIteration:
                return
            yield result
        started.append(_Beside(results))
        yield from started[0]

    try:
        yield each()
    finally:
        for process in started:
            process.end()
        results.close()


class _Beside:
    """A forked process that goes on with an iterator."""

    def __init__(self, results: Iterator[Any]) -> None:
        context = multiprocessing.get_context("fork")
        self._ours, theirs = context.Pipe(duplex=False)
        self._process = context.Process(target=_send_each, args=(self._ours, theirs, results), daemon=True)
        with warnings.catch_warnings():
            # Python 3.12 warns of threads of any kind; those of Embree sleep, and the fork never needs them.
            warnings.simplefilter("ignore", DeprecationWarning)
            self._process.start()
        theirs.close()

    def __iter__(self) -> Iterator[Any]:
        while True:
            try:
                kind, content = self._ours.recv()
            except EOFError:
                self._process.join()
                code = self._process.exitcode or 0
                how = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
                hint = "; if memory was short, use fewer workers on this machine" if code == -signal.SIGKILL else ""
                raise ChildProcessError(f"the process that works beside this one {how}{hint}") from None
            if kind == "end":
                return
            if kind == "error":
                raise content
            yield content

    def end(self) -> None:
        self._ours.close()
        self._process.kill()
        self._process.join()


def _send_each(other: Connection[Any, Any], connection: Connection[Any, Any], results: Iterator[Any]) -> None:
    # Only the parent may hold the receiving end: sending must fail when it has closed that.
    other.close()
    # Ctrl-C reaches every process of a terminal; the parent ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    try:
        for result in results:
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
