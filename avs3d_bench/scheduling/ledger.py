"""The state of a run: the next task, the tasks to try again, the failed ones. Pure; knows no processes."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from avs3d_bench.scheduling.tasks import Attempt, Failure, Task


@dataclass(frozen=True)
class Next:
    """A task to start, with its failed attempts so far (the newest names the worker to avoid)."""

    task: Task
    failed: tuple[Attempt, ...] = ()


class Ledger:
    """Hands out tasks.

    Tasks that others wait for (and that wait for nothing themselves) come first, but only while fewer than ``ahead``
    other tasks are ready: so every worker has something to do, and a run of many thousands does not prepare everything
    before it shows a first result.

    Args:
        tasks: all of the run; one that names another in ``after`` follows it in this sequence or precedes it.
        retries: how often a task is tried again.
        ahead: how many ready tasks are enough.
    """

    def __init__(self, tasks: Sequence[Task], *, retries: int, ahead: int) -> None:
        self._retries = retries
        self.ahead = ahead
        self._waiting: dict[str, list[Task]] = {}
        for task in tasks:
            if task.after is not None:
                self._waiting.setdefault(task.after, []).append(task)
        reached = [task.name for task in tasks if task.after is None]
        for name in reached:  # grows while it is walked through
            reached += [follower.name for follower in self._waiting.get(name, ())]
        stuck = {task.name: task.after for task in tasks if task.name not in set(reached)}
        if stuck:
            raise ValueError(f"tasks wait for what is no task, or for one another (task: waits for): {stuck}")
        self._leaders = deque(task for task in tasks if task.name in self._waiting and task.after is None)
        self._ready = deque(Next(task) for task in tasks if task.name not in self._waiting and task.after is None)
        self._open = self._unstarted = len(tasks)

    @property
    def left(self) -> int:
        """How many tasks are neither done nor given up."""
        return self._open

    @property
    def unstarted(self) -> int:
        """How many tasks have not been taken, those included that wait for others."""
        return self._unstarted

    @property
    def finished(self) -> bool:
        """Whether every task is done or given up."""
        return self._open == 0

    def take(self, own: Collection[str] = (), others: Collection[str] = ()) -> Next | None:
        """The next task to start; None if there is none now.

        Args:
            own: groups (`Task.group`) of what the free processes did last: their tasks come first.
            others: those of what runs: their tasks are left to these processes as long as there is anything else.
        """
        item = next((item for item in self._ready if item.task.group in own), None) if own else None
        apart = [item for item in self._ready if item.task.group not in others] if others else self._ready
        if item is None and self._leaders and len(apart) < self.ahead:
            item = Next(self._leaders.popleft())
        else:
            item = item or next(iter(apart or self._ready), None)
            if item is None:
                return None
            self._ready.remove(item)
        self._unstarted -= 1
        return item

    def give_back(self, item: Next) -> None:
        """Put a task that was taken but not tried back at the head."""
        self._ready.appendleft(item)
        self._unstarted += 1

    def done(self, task: Task) -> None:
        """Note that ``task`` is done; what waited for it is ready, and comes first if others wait for it in turn."""
        self._open -= 1
        self._release(self._waiting.pop(task.name, ()))

    def _release(self, tasks: Iterable[Task]) -> None:
        """Make tasks ready that have waited; those come first for which others wait."""
        followers = [Next(follower) for follower in tasks]
        self._ready.extendleft(reversed([item for item in followers if item.task.name in self._waiting]))
        self._ready.extend(item for item in followers if item.task.name not in self._waiting)

    def failed(self, item: Next, attempt: Attempt) -> Iterator[Failure]:
        """Note a failed attempt: the task is put at the head of the queue, or given up with all that need it."""
        attempts = (*item.failed, attempt)
        if attempt.cause != "refused" and len(attempts) <= self._retries:
            self.give_back(Next(item.task, attempts))
            return
        self._open -= 1
        followers = self._waiting.pop(item.task.name, ())
        self._release(follower for follower in followers if follower.after_any)
        yield Failure(item.task, attempts)
        doomed = [follower for follower in followers if not follower.after_any]
        for follower in doomed:  # grows while it is walked through
            doomed += self._waiting.pop(follower.name, ())
            self._open -= 1
            self._unstarted -= 1
            yield Failure(follower, attempts)
