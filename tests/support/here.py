"""`avs3d generate` without a process of its own, which takes seconds to load what this process has loaded."""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Self

import pytest
from threadpoolctl import threadpool_limits

from avs3d_bench.scheduling import child, local
from avs3d_bench.scheduling.ledger import Ledger
from avs3d_bench.scheduling.tasks import Attempt, Event, Failure, Listener, Policy, Success, Task
from generators.observation import prepare
from generators.run import runner


class Here:
    """A scheduler that runs one task after the other in this process, as the program of a worker does."""

    slots = 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def run(self, tasks: Sequence[Task], policy: Policy, listen: Listener) -> Generator[Success | Failure, None, None]:
        """See `tasks.Scheduler`; time limits are not watched."""
        ledger = Ledger(tasks, retries=policy.retries, ahead=2)
        while not ledger.finished:
            item = ledger.take()
            assert item is not None
            kind, found = attempted(item.task, listen)
            if kind == "done":
                ledger.done(item.task)
                yield Success(item.task, found)
                continue
            given_up = list(ledger.failed(item, Attempt("this process", *found)))
            if not given_up:
                listen(Event("retry", item.task.name, found[1]))
            yield from given_up


class _Connection:
    """Passes on what the task reports."""

    def __init__(self, name: str, listen: Listener) -> None:
        self._name, self._listen = name, listen

    def send(self, message: tuple[str, tuple[str, str]]) -> None:
        kind, text = message[1]
        self._listen(Event(kind, self._name, text))


def attempted(task: Task, listen: Listener) -> tuple[str, Any]:
    """What a worker says in the end."""
    with tempfile.TemporaryFile() as share, threadpool_limits(1):  # an empty file: no core is lent
        work = pickle.dumps((task.call, task.arguments, 0))
        kind, found = child._attempt(_Connection(task.name, listen), share.fileno(), work)  # type: ignore[arg-type]
    if kind == "failed" and "internal error: KeyboardInterrupt" in found[1]:
        raise KeyboardInterrupt  # not that of a worker: the tests shall end
    return kind, found


def forget_arrangements() -> None:
    """Arrange and light the next observation again, whatever was made before."""
    prepare._arrangement_cache.clear()


@contextmanager
def generated_here() -> Iterator[None]:
    """Runs on one worker have no process of their own."""
    real: Callable[[int], local.LocalScheduler] = local.LocalScheduler

    def scheduler(workers: int) -> Here | local.LocalScheduler:
        return Here() if workers == 1 else real(workers)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(local, "LocalScheduler", scheduler)
        patch.setattr(runner, "LocalScheduler", scheduler)
        # The same few small observations are made again and again, and what they show is arranged and lit once. That it
        # would be the same in another process, runs on two workers and of real programs tell.
        patch.setattr(prepare, "KEPT", 4)
        yield
