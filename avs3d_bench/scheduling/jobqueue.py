"""A Dask cluster started through a job queue, from options in a YAML file.

The options are the arguments of the cluster's own class (`dask_jobqueue.SLURMCluster`, `dask_jobqueue.PBSCluster`,
`dask_kubernetes.operator.KubeCluster`), by the names that its documentation gives them.

Dask's own adaptive scaling is not offered: it guesses the work from durations that it has not seen yet, closes workers
that are busy with long tasks, and starts and cancels jobs of several processes in turn for ever when there is work for
one process only. `Jobs` replaces jobs that the queue has ended instead.
"""

from __future__ import annotations

import inspect
import subprocess
from contextlib import suppress
from pathlib import Path
from typing import Any

from avs3d_bench.errors import Avs3dError, UsageError, did_you_mean, excerpt
from avs3d_bench.formats.yamlfile import read_yaml
from avs3d_bench.runtime.imports import import_by_name, needing

#: Name → (module, class, package to install).
KINDS = {
    "slurm": ("dask_jobqueue", "SLURMCluster", "dask-jobqueue"),
    "pbs": ("dask_jobqueue", "PBSCluster", "dask-jobqueue"),
    "kubernetes": ("dask_kubernetes.operator", "KubeCluster", "dask-kubernetes"),
}
#: What prints those of some jobs that have not ended; their numbers, joined by commas, are appended.
_LIST = {"slurm": ("squeue", "--noheader", "--format=%i", "--jobs")}


def read_options(path: Path) -> dict[str, Any]:
    """The YAML file as a mapping.

    Raises:
        UsageError: if it is no YAML file with a mapping.
        Avs3dError: if it cannot be read.
    """
    document, _ = read_yaml(path)
    if not isinstance(document, dict) or not all(isinstance(name, str) for name in document):
        raise UsageError(f"{path}: expected a mapping such as {{cores: 16, memory: 64GB}}, found {excerpt(document)}")
    walltime = document.get("walltime")
    if walltime is not None and not isinstance(walltime, str):  # YAML reads 12:00:00 as the number 43200
        raise UsageError(f'{path}: walltime: expected a text in quotes such as "12:00:00", found {excerpt(walltime)}')
    return document


def start_cluster(kind: str, path: Path, workers: int) -> Any:
    """Start a cluster and ask it for workers.

    Args:
        kind: one of `KINDS`.
        path: the YAML file.
        workers: worker processes to ask for.

    Returns:
        the cluster; it has ``scheduler_address`` and ``close()``.

    Raises:
        UsageError: if an option is unknown or one is missing.
        Avs3dError: if the package is not installed, or the queue refuses.
    """
    cluster = make_cluster(kind, read_options(path), path)
    try:
        _scale(cluster, workers)
    except FileNotFoundError as error:
        _close(cluster)
        raise Avs3dError(
            f"--jobqueue {kind}: {error.filename} is not installed here; run the command where jobs can be submitted"
        ) from error
    except Exception as error:
        _close(cluster)
        raise Avs3dError(f"--jobqueue {kind}: {_line(error)}") from error
    return cluster


class Jobs:
    """The jobs of a cluster in the queue.

    Dask is not told when a job ends or its workers cannot start. Queues that cannot be asked
    (`_LIST`) are taken to keep their jobs.
    """

    def __init__(self, kind: str, cluster: Any) -> None:
        self._cluster = cluster
        self._list = _LIST.get(kind)
        self._worked: set[str] = set()

    def see(self) -> None:
        """Note which jobs have workers. Call it often: a job that was never seen to work is not replaced."""
        # The workers of a job are called like the job, with a number where there are several.
        named = {str(worker["name"]) for worker in dict(self._cluster.scheduler_info["workers"]).values()}
        self._worked |= named | {name.rpartition("-")[0] for name in named}

    def mend(self) -> tuple[int, bool]:
        """Submit another job for every one that has ended after its workers had come.

        Returns:
            how many were replaced, and whether neither a job nor hope is left.
        """
        if self._list is None:
            return 0, False
        jobs = {name: str(job.job_id) for name, job in dict(self._cluster.workers).items()}
        standing = self._standing(list(jobs.values()))
        if standing is None:
            return 0, False
        ended = [name for name, job in jobs.items() if job not in standing]
        again = [name for name in ended if name in self._worked]
        if again:
            try:
                self._cluster.sync(self._replace, again)
            except Exception:  # the queue takes no more now: asked again later, as long as any job stands
                again = []
        return len(again), len(ended) == len(jobs) and not again

    def _standing(self, jobs: list[str]) -> set[str] | None:
        """Those of ``jobs`` that wait or run; None if the queue does not answer."""
        assert self._list is not None
        command = [*self._list, ",".join(jobs)]
        try:
            listed = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
        except (OSError, subprocess.TimeoutExpired):
            return None
        # Slurm forgets jobs some minutes after their end; an unknown number is then not an error.
        if listed.returncode != 0 and "Invalid job id" not in listed.stderr:
            return None
        return set(listed.stdout.split())

    async def _replace(self, names: list[str]) -> None:
        cluster = self._cluster
        for name in names:
            cluster.worker_spec.update(cluster.new_worker_spec())  # before the old name is free, to get another
            cluster.worker_spec.pop(name, None)
            cluster.workers.pop(name, None)
        await cluster._correct_state()


def _scale(cluster: Any, workers: int) -> None:
    """Ask for workers, and wait until the queue has taken or refused their jobs."""
    from distributed import SpecCluster

    spec_cluster: Any = SpecCluster
    if not isinstance(cluster, spec_cluster):
        cluster.scale(workers)
        return

    async def scale() -> None:
        cluster.scale(workers)
        await cluster._correct_state()  # `scale` only schedules this, and its errors would be lost

    cluster.sync(scale)


def _close(cluster: Any) -> None:
    """Close a cluster, some of whose jobs the queue has refused; otherwise Dask reports an error for these."""
    from distributed import Status

    for job in getattr(cluster, "workers", {}).values():
        if job.status == Status.created:
            job.status = Status.failed
    with suppress(Exception):
        cluster.close(timeout=10)


def make_cluster(kind: str, options: dict[str, Any], path: Path) -> Any:
    """The cluster object without any workers; see `start_cluster`."""
    module, name, package = KINDS[kind]
    extra = "'avs3d-bench[cluster]'" if package == "dask-jobqueue" else package
    with needing(f"--jobqueue {kind}", f"pip install {extra}"):
        import dask

        found = import_by_name(f"{module}:{name}")
    known = _parameters(found)
    for option in options:
        if option not in known:
            hint = did_you_mean(option, known, otherwise=f"; expected one of {', '.join(sorted(known))}")
            raise UsageError(f"{path}: unknown option {option!r} of {name}{hint}")
    if "protocol" in known and dask.config.get("distributed.comm.require-encryption", None):
        # Without it, the scheduler would try to listen without TLS, and be refused.
        options = {"protocol": "tls://"} | options
    try:
        return found(**options)
    except (ValueError, TypeError) as error:
        raise UsageError(f"{path}: {_line(error)}") from error
    except Exception as error:
        raise Avs3dError(f"--jobqueue {kind}: {_line(error)}") from error


def _line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _parameters(cluster: Any) -> set[str]:
    """Names of the arguments that the class, its bases and its kind of job take."""
    classes = [*cluster.__mro__, *getattr(getattr(cluster, "job_cls", None), "__mro__", ())]
    names: set[str] = set()
    for each in classes:
        if each.__module__.startswith(("dask_jobqueue", "dask_kubernetes")) and "__init__" in vars(each):
            names.update(
                name
                for name, parameter in inspect.signature(each.__init__).parameters.items()
                if parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)
            )
    return names - {"self", "scheduler", "job_cls", "asynchronous", "loop", "n_workers"}
