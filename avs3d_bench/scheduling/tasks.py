"""Tasks and their results."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, Self

#: Why an attempt failed. ``refused``: an `Avs3dError`, which another attempt would meet again; ``unfit``: this worker
#: cannot do it, another may; ``error``: an unexpected exception; ``crash``: the process died; ``hang``: the time
#: limit passed.
Cause = Literal["refused", "unfit", "error", "crash", "hang"]


@dataclass(frozen=True)
class Context:
    """The first argument of every task.

    Attributes:
        slot: number of the place it runs in, from 0, unique among what runs on the same machine for this run; picks
            a device.
        report: ``report(kind, text)`` sends an event to the one who started the run. Of several of one kind in short
            order, only the last may arrive.
        cores: how many cores the task may use at this moment, at least 1. It grows while the last tasks of a run go on:
            workers that have nothing to do lend theirs. It shrinks when they need them again. Always 1 where that is
            unknown.
    """

    slot: int
    report: Callable[[str, str], None]
    cores: Callable[[], int] = lambda: 1


@dataclass(frozen=True)
class Task:
    """One piece of work: ``call(context, *arguments)`` in some process.

    Attributes:
        name: unique in its run.
        call: a function of a module that every worker can import.
        arguments: whatever can be pickled.
        after: name of the task that must be done first; if that fails, so does this one, untried.
        after_any: it is tried even if that task was tried and failed (as Slurm's dependency ``afterany``).
        limit: seconds after which an attempt is ended; None: never.
        most_cores: how many cores it can make use of (see `Context`).
        group: of tasks that find much of one another's work in the memory of a process; None: it is in none.
    """

    name: str
    call: Callable[..., Any]
    arguments: tuple[Any, ...]
    after: str | None = None
    after_any: bool = False
    limit: float | None = None
    most_cores: int = 1
    group: str | None = None


@dataclass(frozen=True)
class Policy:
    """How a run handles failures.

    Attributes:
        retries: how often a task is tried again after anything but a refusal.
        environment: variables that every worker process gets before it imports anything.
        gpus: values of CUDA_VISIBLE_DEVICES, of which worker processes of this machine get one each, in turn; none:
            each sees what this process sees.
        warm_up: run by the workers that find nothing to do at the start, because all tasks wait for a few: they load
            what the tasks need meanwhile. How it ends changes nothing. For processes of this machine only.
    """

    retries: int = 1
    environment: tuple[tuple[str, str], ...] = ()
    gpus: tuple[str, ...] = ()
    warm_up: Task | None = None


@dataclass(frozen=True)
class Event:
    """Something happened to the task ``name``: its own reports, and ``retry``, ``worker`` (one was lost), ``note``."""

    kind: str
    name: str
    text: str


@dataclass(frozen=True)
class Attempt:
    """A failed attempt.

    Attributes:
        worker: the process, machine or address that it ran on.
        cause: what kind of failure.
        message: one line.
        traceback: where it happened, as far as that could be found out.
    """

    worker: str
    cause: Cause
    message: str
    traceback: str = ""


@dataclass(frozen=True)
class Success:
    """A task that is done, with what its call returned."""

    task: Task
    value: Any


@dataclass(frozen=True)
class Failure:
    """A task that is given up.

    Attributes:
        task: which.
        attempts: of itself, or of the task that it was to follow.
    """

    task: Task
    attempts: tuple[Attempt, ...] = field(default=())

    @property
    def message(self) -> str:
        """The message of the last attempt, in one line."""
        last = self.attempts[-1]
        if len(self.attempts) == 1:
            return last.message
        return f"{last.message} (tried {len(self.attempts)} times)"


Listener = Callable[[Event], None]


class Scheduler(Protocol):
    """Runs tasks somewhere. To be used as a context manager: on leaving it every process is ended."""

    #: How many tasks run at once, as far as is known.
    slots: int

    def run(self, tasks: Sequence[Task], policy: Policy, listen: Listener) -> Generator[Success | Failure, None, None]:
        """Yield every task when it is done or given up, in any order.

        Closing the iterator (or an exception in it, such as Ctrl-C) ends whatever still runs.
        """
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...
