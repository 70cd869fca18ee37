"""Observations as tasks on devices: each is done or named as failed, and a failure takes nothing else with it."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol, TypeVar

import torch

from avs3d_bench.errors import Avs3dError
from avs3d_bench.scheduling.options import Options, scheduler_of
from avs3d_bench.scheduling.tasks import Attempt, Context, Event, Failure, Task
from baselines.echosegnet.memory import share_device
from baselines.echosegnet.rasteriser.default import Rasteriser, default_rasteriser

#: An observation takes minutes; one that takes longer than this hangs, seconds.
LIMIT = 6 * 3600.0


class KeyedJob(Protocol):
    """A job for `run_each`: it has the key of its observation."""

    @property
    def key(self) -> str: ...  # noqa: D102


J = TypeVar("J", bound=KeyedJob)


@dataclass(frozen=True)
class JobsOutcome:
    """Results of the jobs.

    Attributes:
        values: what the calls returned, in the order in which they were done.
        failed: those given up.
        total: number of jobs.
    """

    values: list[Any] = field(default_factory=list)
    failed: list[Failure] = field(default_factory=list)
    total: int = 0

    def check(self, kept: Path) -> None:
        """Raise an error if any job failed.

        Args:
            kept: the folder of intermediate results, which a rerun reuses.

        Raises:
            Avs3dError: one line that names every observation that failed and the cause of the first failure.
        """
        if not self.failed:
            return
        first, *others = sorted(self.failed, key=lambda failure: failure.task.name)
        text = first.message if first.task.name in first.message else f"{first.task.name}: {first.message}"
        if others:
            text += f" (and {len(others)} more: {', '.join(failure.task.name for failure in others)})"
        done = self.total - len(self.failed)
        if done:
            text += f"; {done} of {self.total} observations are done and kept in {kept}: run the same command again"
        raise Avs3dError(text)


def all_devices() -> tuple[str, ...]:
    """Every CUDA device, else the CPU."""
    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    return tuple(f"cuda:{index}" for index in range(count)) or ("cpu",)


def spread(devices: Sequence[str], jobs: int) -> tuple[str, ...]:
    """The device of each worker: at most as many as jobs, and a second worker on one only when every one has a first.

    Examples:
        >>> spread(["cuda:0", "cuda:0", "cuda:1", "cuda:1"], 3)
        ('cuda:0', 'cuda:1', 'cuda:0')
    """
    seen: Counter[str] = Counter()
    order = []
    for device in devices:
        order.append(seen[device])
        seen[device] += 1
    ranked = sorted(range(len(devices)), key=lambda place: order[place])
    return tuple(devices[place] for place in ranked[: max(1, jobs)])


def device_of(context: Context, devices: Sequence[str]) -> Rasteriser:
    """The rasteriser of a task's slot, kept by its process; a device that is listed k times is shared by k of them.

    Args:
        context: of the task.
        devices: of the workers of this machine (`spread`); none: every device it has.
    """
    mine = tuple(devices) or all_devices()
    name = mine[context.slot % len(mine)]
    return _rasteriser(name, mine.count(name))


@lru_cache(maxsize=1)
def _rasteriser(device: str, trainings: int) -> Rasteriser:
    rasteriser = default_rasteriser(device)
    share_device(rasteriser.device, trainings)
    return rasteriser


def run_each(
    call: Callable[[Context, J], Any],
    jobs: Sequence[J],
    workers: Sequence[str],
    *,
    progress: bool = False,
    scheduling: Options | None = None,
) -> JobsOutcome:
    """Run ``call(context, job)`` for every job, one process for each worker.

    With one worker and no time limit it is done in this process. What crashes or hangs is tried again, on another
    worker if there is one.

    Args:
        call: a function of a module.
        jobs: one per observation; they can be pickled.
        workers: the device of each worker (`spread`); a device may be listed several times.
        progress: report on stderr.
        scheduling: where it runs; None: here.
    """
    options = scheduling or Options()
    outcome = JobsOutcome(total=len(jobs))

    def say(kind: str, text: str) -> None:
        if progress:
            print("  ".join(filter(None, (kind, text))), file=sys.stderr, flush=True)

    def enough(failure: Failure) -> bool:
        outcome.failed.append(failure)
        say("failed", f"{failure.task.name}: {failure.message}")
        return options.max_failures is not None and len(outcome.failed) > options.max_failures

    tasks = [Task(job.key, call, (job,), limit=options.limit(LIMIT)) for job in jobs]
    if not options.remote and len(workers) == 1 and options.time_limit is None:
        context = Context(0, lambda kind, text: say("note" if kind == "note" else "", text))
        for task in tasks:
            try:
                outcome.values.append(call(context, *task.arguments))
            except Avs3dError as error:
                if enough(Failure(task, (Attempt("this process", "refused", str(error)),))):
                    break
        return outcome

    def listen(event: Event) -> None:
        say("" if event.kind in ("training", "done") else event.kind, event.text)

    gpus = any(device != "cpu" for device in workers)
    with scheduler_of(options, len(workers), gpus=gpus) as pool:
        results = pool.run(tasks, options.policy(one_thread=False), listen)
        with closing(results):
            for result in results:
                if not isinstance(result, Failure):
                    outcome.values.append(result.value)
                elif enough(result):
                    break
    return outcome
