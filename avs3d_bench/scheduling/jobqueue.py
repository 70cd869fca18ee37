"""A Dask cluster started through a job queue, from options in a YAML file.

The options are the arguments of the cluster's own class (`dask_jobqueue.SLURMCluster`, `dask_jobqueue.PBSCluster`,
`dask_kubernetes.operator.KubeCluster`), by the names that its documentation gives them, and ``adapt``: {minimum,
maximum}, which lets the number of workers follow the work.
"""

from __future__ import annotations

import inspect
from contextlib import suppress
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

from avs3d_bench.errors import Avs3dError, UsageError

#: Name → (module, class, package to install).
KINDS = {
    "slurm": ("dask_jobqueue", "SLURMCluster", "dask-jobqueue"),
    "pbs": ("dask_jobqueue", "PBSCluster", "dask-jobqueue"),
    "kubernetes": ("dask_kubernetes.operator", "KubeCluster", "dask-kubernetes"),
}
_ADAPT = "adapt"


def read_options(path: Path) -> dict[str, Any]:
    """The YAML file as a mapping.

    Raises:
        UsageError: if it is no YAML file with a mapping.
        Avs3dError: if it cannot be read.
    """
    from avs3d_bench.files import read_bytes  # brings the schema, which `--help` can do without

    try:
        document = yaml.safe_load(read_bytes(path).decode())
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: not valid YAML: {getattr(error, 'problem', None) or error}") from None
    if not isinstance(document, dict) or not all(isinstance(name, str) for name in document):
        raise UsageError(f"{path}: expected a mapping such as {{cores: 16, memory: 64GB}}, found {document!r:.60}")
    adapt = document.get(_ADAPT)
    if adapt is not None and not (
        isinstance(adapt, dict)
        and set(adapt) <= {"minimum", "maximum"}
        and all(isinstance(value, int) and value >= 0 for value in adapt.values())
    ):
        raise UsageError(f"{path}: adapt: expected {{minimum: 0, maximum: 64}}, found {adapt!r:.60}")
    walltime = document.get("walltime")
    if walltime is not None and not isinstance(walltime, str):  # YAML reads 12:00:00 as the number 43200
        raise UsageError(f'{path}: walltime: expected a text in quotes such as "12:00:00", found {walltime!r:.60}')
    return document


def start_cluster(kind: str, path: Path, workers: int) -> Any:
    """Start a cluster and ask it for workers.

    Args:
        kind: one of `KINDS`.
        path: the YAML file.
        workers: worker processes to ask for, unless the file has ``adapt``.

    Returns:
        the cluster; it has ``scheduler_address`` and ``close()``.

    Raises:
        UsageError: if an option is unknown or one is missing.
        Avs3dError: if the package is not installed, or the queue refuses.
    """
    options = read_options(path)
    cluster = make_cluster(kind, options, path)
    try:
        adapt = options.get(_ADAPT)
        # The first worker is asked for at once even where there may be none: so a queue that refuses is noticed.
        _scale(cluster, workers if adapt is None else max(1, adapt.get("minimum", 0)))
        if adapt is not None:
            minimum = adapt.get("minimum", 0)
            cluster.adapt(minimum=minimum, maximum=adapt.get("maximum", max(minimum, workers)))
    except FileNotFoundError as error:
        _close(cluster)
        raise Avs3dError(
            f"--jobqueue {kind}: {error.filename} is not installed here; run the command where jobs can be submitted"
        ) from error
    except Exception as error:
        _close(cluster)
        raise Avs3dError(f"--jobqueue {kind}: {_line(error)}") from error
    return cluster


def _scale(cluster: Any, workers: int) -> None:
    """Ask for workers, and wait until the queue has taken or refused their jobs."""
    from distributed import SpecCluster

    spec_cluster: Any = SpecCluster
    if not isinstance(cluster, spec_cluster):
        cluster.scale(workers)
        return

    async def scale() -> None:
        cluster.scale(workers)
        await cluster._correct_state()  # what `scale` has only put in line; its errors reach nobody there

    cluster.sync(scale)


def _close(cluster: Any) -> None:
    """Close a cluster, some of whose jobs the queue has refused; left as they are, Dask takes that for a mistake."""
    from distributed import Status

    for job in getattr(cluster, "workers", {}).values():
        if job.status == Status.created:
            job.status = Status.failed
    with suppress(Exception):
        cluster.close(timeout=10)


def make_cluster(kind: str, options: dict[str, Any], path: Path) -> Any:
    """The cluster object without any workers; see `start_cluster`."""
    module, name, package = KINDS[kind]
    try:
        found = getattr(import_module(module), name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != module.partition(".")[0]:
            raise
        extra = "'avs3d-bench[cluster]'" if package == "dask-jobqueue" else package
        raise Avs3dError(f"--jobqueue {kind} needs {package}: pip install {extra}") from None
    given = {name: value for name, value in options.items() if name != _ADAPT}
    known = _parameters(found)
    for option in given:
        if option not in known:
            near = get_close_matches(option, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else f"; expected one of {', '.join(sorted(known))}"
            raise UsageError(f"{path}: unknown option {option!r} of {name}{hint}")
    try:
        return found(**given)
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
