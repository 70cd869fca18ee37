"""Tasks on supervised processes of this machine."""

from __future__ import annotations

from collections.abc import Collection, Generator, Mapping, Sequence
from multiprocessing.connection import wait
from typing import Self

from avs3d_bench.scheduling.ledger import Ledger, Next
from avs3d_bench.scheduling.supervised import Done, Supervised, TaskEvent
from avs3d_bench.scheduling.tasks import Event, Failure, Listener, Policy, Success, Task

#: How often time limits are looked at while nothing else happens, seconds.
_TICK = 1.0


class LocalScheduler:
    """``workers`` processes, each with a `Supervised` of its own slot.

    One loop in the calling thread serves them all: there are no threads and no locks that a dying process could hold.
    """

    def __init__(self, workers: int) -> None:
        self.slots = workers

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def run(self, tasks: Sequence[Task], policy: Policy, listen: Listener) -> Generator[Success | Failure, None, None]:
        """See `tasks.Scheduler`."""
        slots = max(1, min(self.slots, len(tasks)))
        ledger = Ledger(tasks, retries=policy.retries, ahead=2 * slots)
        everyone = [Supervised(_environment(policy, slot), slot=slot, name=f"worker {slot}") for slot in range(slots)]
        free, busy = list(reversed(everyone)), dict[Supervised, Next]()
        loading, warm_up = set[Supervised](), policy.warm_up
        groups: dict[Supervised, str] = {}  # of what each did last
        try:
            while not ledger.finished:
                while free and (item := _next(ledger, free, busy, groups)):
                    worker = _choose(free, item, groups)
                    worker.start(item.task)
                    busy[worker] = item
                    groups.pop(worker, None)
                    if item.task.group is not None:
                        groups[worker] = item.task.group
                most = [item.task.most_cores for item in busy.values()]
                for worker, cores in zip(busy, divide(self.slots, ledger.unstarted, most), strict=True):
                    worker.lend(cores)
                while warm_up and free:
                    worker = free.pop()
                    worker.start(warm_up)
                    loading.add(worker)
                warm_up = None  # at the start only
                limits = [left for worker in (*busy, *loading) if (left := worker.remaining) is not None]
                wait([worker.connection for worker in (*busy, *loading)], min([_TICK, *limits]))
                for worker in _that_ended(loading):
                    loading.remove(worker)
                    free.append(worker)
                for worker, item in list(busy.items()):
                    while (found := worker.read()) is not None:
                        name = item.task.name
                        if isinstance(found, TaskEvent):
                            listen(Event(found.kind, name, found.text))
                            continue
                        del busy[worker]
                        free.append(worker)
                        if isinstance(found, Done):
                            ledger.done(item.task)
                            yield Success(item.task, found.value)
                        else:
                            given_up = list(ledger.failed(item, found))
                            if not given_up:
                                listen(Event("retry", name, found.message))
                            yield from given_up
                        break
        finally:
            for worker in everyone:
                worker.kill()


def _environment(policy: Policy, slot: int) -> dict[str, str]:
    """What the worker of a slot gets: one GPU, if the run has several."""
    own = {"CUDA_VISIBLE_DEVICES": policy.gpus[slot % len(policy.gpus)]} if policy.gpus else {}
    return dict(policy.environment) | own


def _next(
    ledger: Ledger, free: Collection[Supervised], busy: Collection[Supervised], groups: Mapping[Supervised, str]
) -> Next | None:
    """The next task: one of a group that a free worker has begun, else none of those that busy ones are at."""
    own, others = ({groups[worker] for worker in some if worker in groups} for some in (free, busy))
    return ledger.take(own, others)


def _that_ended(loading: Collection[Supervised]) -> list[Supervised]:
    """Those that have nothing more to load; what they say is of no interest."""
    ended = []
    for worker in loading:
        while (found := worker.read()) is not None:
            if not isinstance(found, TaskEvent):
                ended.append(worker)
                break
    return ended


def divide(cores: int, waiting: int, most: Sequence[int]) -> list[int]:
    """Number of cores for each running task, in the order in which they began.

    A core that a waiting task will need is not lent. The task that began last has most of its work ahead of it and
    ends the run: it is lent as many cores as it can use, then the one before it.

    Args:
        cores: number of all cores.
        waiting: tasks that have not begun, those included that wait for others.
        most: how many cores each running task can use, in the order in which they began.
    """
    spare, shares = max(0, cores - len(most) - waiting), []
    for useful in reversed(most):
        lent = min(spare, useful - 1)
        shares.append(1 + lent)
        spare -= lent
    return shares[::-1]


def _choose(free: list[Supervised], item: Next, groups: Mapping[Supervised, str]) -> Supervised:
    """Take a free worker: the one that did the group's last task, and none that the task failed on.

    If there is only the one that it failed on, that one gets a new process.
    """
    avoid = item.failed[-1].worker.partition(" (")[0] if item.failed else None
    fit = [at for at in reversed(range(len(free))) if free[at].worker.partition(" (")[0] != avoid]
    if fit:
        return free.pop(next((at for at in fit if groups.get(free[at], "") == item.task.group), fit[0]))
    worker = free.pop()
    worker.kill()
    return worker
