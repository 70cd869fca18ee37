"""The command-line options for where the work is done, and `scheduler_of`, which starts the scheduler."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

import click

from avs3d_bench.commands.click_options import PATH
from avs3d_bench.errors import UsageError
from avs3d_bench.runtime.one_thread import ONE_THREAD
from avs3d_bench.scheduling.jobqueue import KINDS
from avs3d_bench.scheduling.tasks import Policy, Scheduler

_F = TypeVar("_F", bound=Callable[..., Any])

#: Environment variables that are copied to workers on other machines.
_PREFIX = "AVS3D_"
#: Settings of glibc's allocator: freed memory stays with the process (bytes). Arrays of a frame's size would otherwise
#: be fresh memory for every frame, which costs page faults: 7 % of an observation with 16 processes on 16 cores
#: (`python -m benchmarks.many_cores`).
_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(1 << 30), "MALLOC_TRIM_THRESHOLD_": str(1 << 32)}


@dataclass(frozen=True)
class Options:
    """Where the work is done.

    Attributes:
        scheduler: ``local``: processes of this machine; ``dask``: a Dask cluster.
        address: of a Dask scheduler that runs already.
        jobqueue: what starts a cluster: one of `jobqueue.KINDS`.
        jobqueue_options: YAML file for that.
        retries: how often a failed task is tried again.
        max_failures: how many may fail before the run is ended; None: all.
        time_limit: seconds for one task; None: the caller's default; 0: none.
    """

    scheduler: str = "local"
    address: str | None = None
    jobqueue: str | None = None
    jobqueue_options: Path | None = None
    retries: int = 1
    max_failures: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        """Refuse what contradicts itself.

        Raises:
            UsageError: one line.
        """
        dask_only = {
            "--scheduler-address": self.address,
            "--jobqueue": self.jobqueue,
            "--jobqueue-options": self.jobqueue_options,
        }
        given = [name for name, value in dask_only.items() if value is not None]
        if self.scheduler == "local" and given:
            raise UsageError(f"{given[0]} needs --scheduler dask; the local scheduler uses this machine alone")
        if self.address is not None and self.jobqueue is not None:
            raise UsageError(
                "--scheduler-address joins a cluster that runs, --jobqueue starts one: give one of the two"
            )
        if self.jobqueue is not None and self.jobqueue_options is None:
            raise UsageError(
                f"--jobqueue {self.jobqueue} needs --jobqueue-options FILE.yaml (cores, memory, queue, walltime, …); "
                "docs/cluster.md shows one"
            )
        if self.jobqueue_options is not None and self.jobqueue is None:
            raise UsageError(f"--jobqueue-options needs --jobqueue {'|'.join(KINDS)}")
        if self.time_limit is not None and not math.isfinite(self.time_limit):
            raise UsageError(f"--time-limit {self.time_limit}: expected seconds; 0 for no limit")

    @property
    def remote(self) -> bool:
        """Whether workers may be on other machines."""
        return self.scheduler != "local"

    def policy(self, *, one_thread: bool) -> Policy:
        """Retries, and what workers get of this process's environment: all that configures this project.

        Args:
            one_thread: numerical libraries use one thread a process and memory stays with it, unless the environment
                says otherwise.
        """
        own = {name: value for name, value in os.environ.items() if name.startswith(_PREFIX)}
        if one_thread:
            own |= {name: os.environ.get(name, value) for name, value in (ONE_THREAD | _MEMORY).items()}
        return Policy(retries=self.retries, environment=tuple(sorted(own.items())))

    def limit(self, default: float) -> float | None:
        """Seconds for one task, where the caller would choose ``default``."""
        chosen = default if self.time_limit is None else self.time_limit
        return chosen or None


def scheduling_options(command: _F) -> _F:
    """Add the options, which are the fields of `Options`; the command gets them as one, ``scheduling``."""

    @wraps(command)
    def gathered(*args: Any, **kwargs: Any) -> Any:
        own = {field.name: kwargs.pop(field.name) for field in fields(Options)}
        return command(*args, scheduling=Options(**own), **kwargs)

    decorated: Any = gathered
    for option in (
        click.option(
            "--time-limit", type=click.FloatRange(min=0), default=None, metavar="SECONDS",
            help="End an observation that takes longer, and try it again; 0: never [an hour or more].",
        ),
        click.option("--retries", type=click.IntRange(0, 100), default=1, show_default=True, metavar="N",
                     help="Try what crashed, hung or failed unexpectedly again, on another worker."),
        click.option("--max-failures", type=click.IntRange(0), default=None, metavar="N",
                     help="Stop when more than N observations have failed [never]."),
        click.option("--jobqueue-options", type=PATH, default=None, metavar="FILE",
                     help="YAML: how to start a job (cores, memory, queue, walltime, …)."),
        click.option("--jobqueue", type=click.Choice(list(KINDS)), default=None, help="Start a Dask cluster there."),
        click.option("--scheduler-address", "address", default=None, metavar="tcp://HOST:PORT",
                     help="Join a Dask cluster that runs (tls://… where it asks for certificates)."),
        click.option("--scheduler", type=click.Choice(["local", "dask"]), default="local", show_default=True,
                     help="Processes of this machine, or a Dask cluster (docs/cluster.md)."),
    ):  # fmt: skip
        decorated = option(decorated)
    return decorated  # type: ignore[no-any-return]


def scheduler_of(options: Options, workers: int, *, gpus: bool = False) -> Scheduler:
    """The scheduler that ``options`` ask for, to be entered with ``with``.

    Args:
        options: of the command line.
        workers: number of processes; for a running cluster, all of its workers are used.
        gpus: each task takes a GPU.

    Raises:
        UsageError: if the file of options is wrong.
        Avs3dError: if a package is missing or the cluster does not answer.
    """
    if not options.remote:
        from avs3d_bench.scheduling.local import LocalScheduler

        return LocalScheduler(workers)
    from avs3d_bench.scheduling.dask_backend import DaskScheduler

    return DaskScheduler(
        workers,
        address=options.address,
        jobqueue=options.jobqueue,
        jobqueue_options=options.jobqueue_options,
        gpus=gpus,
    )
