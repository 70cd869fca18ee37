"""Code that runs inside a Dask worker: it attempts a task in a supervised process, which the worker keeps.

A crash, a kill or a time limit ends the process of the task, not the worker. The worker raises an `AttemptError`, and
the scheduler that submitted the task decides what happens next.
"""

from __future__ import annotations

import signal
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from avs3d_bench.scheduling.supervised import Done, Supervised
from avs3d_bench.scheduling.tasks import Attempt, Task

#: The topic of Dask's event log that events go to.
TOPIC = "avs3d"


class AttemptError(Exception):
    """An attempt that failed; its only argument is the `Attempt`, so that it survives pickling."""

    @property
    def attempt(self) -> Attempt:
        """The failed attempt: where it failed and why."""
        return self.args[0]  # type: ignore[no-any-return]


@dataclass(frozen=True)
class TaskSettings:
    """The settings shared by all tasks of a run.

    Attributes:
        run: name of the run, unique in its cluster.
        environment: of the supervised processes.
        tick: least seconds between two events of one kind from one task.
    """

    run: str
    environment: tuple[tuple[str, str], ...]
    tick: float


class _WorkerPool:
    """The supervised processes of this worker: one for each thread that runs a task, kept between tasks."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: dict[int, tuple[tuple[tuple[str, str], ...], Supervised]] = {}
        self._busy: set[int] = set()
        self.runs: Counter[str] = Counter()

    def take(self, terms: TaskSettings) -> tuple[int, Supervised]:
        with self._lock:
            slot = min(set(range(len(self._busy) + 1)) - self._busy)
            self._busy.add(slot)
            self.runs[terms.run] += 1
            environment, child = self._idle.pop(slot, ((), None))
        if child is None or environment != terms.environment:
            if child is not None:
                child.kill()
            child = Supervised(dict(terms.environment), slot=slot)
        return slot, child

    def give_back(self, terms: TaskSettings, slot: int, child: Supervised) -> None:
        with self._lock:
            self._idle[slot] = (terms.environment, child)
            self._busy.discard(slot)
            self.runs[terms.run] -= 1


_NURSERY = _WorkerPool()


def dask_setup(_: Any) -> None:
    """Called by Dask in a worker of this machine: Ctrl-C is the business of the process that started it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def busy(run: str) -> int:
    """How many tasks of a run this worker is at, whether its cluster still wants them or not."""
    return _NURSERY.runs[run]


def attempt(task: Task, terms: TaskSettings) -> Any:
    """Run a task on a Dask worker.

    Returns:
        what its call returned.

    Raises:
        AttemptError: if it failed in any way.
    """
    from distributed import get_worker

    worker = get_worker()
    key = worker.get_current_task()

    def wanted() -> bool:
        state = worker.state.tasks.get(key)
        return state is not None and state.state in ("executing", "long-running")

    slot, child = _NURSERY.take(terms)
    try:
        found = child.run(task, _reporter(worker, task.name, terms), wanted=wanted)
    except OSError as error:  # no memory, or too many processes
        message = f"{socket.gethostname()} could not start a process for it: {error.strerror or error}"
        found = Attempt("", "unfit", message)
    finally:
        _NURSERY.give_back(terms, slot, child)
    if isinstance(found, Done):
        return found.value
    if found is None:
        found = Attempt("", "crash", "stopped, because the cluster no longer wanted it")
    raise AttemptError(replace(found, worker=f"{worker.address} {found.worker or socket.gethostname()}"))


def _reporter(worker: Any, name: str, terms: TaskSettings) -> Callable[[str, str], None]:
    last: dict[str, float] = {}

    def report(kind: str, text: str) -> None:
        now = time.monotonic()
        if now - last.get(kind, -terms.tick) >= terms.tick:
            last[kind] = now
            worker.log_event(TOPIC, {"run": terms.run, "kind": kind, "name": name, "text": text})

    return report
