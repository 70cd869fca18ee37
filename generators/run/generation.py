"""Generation from Python: a manifest to a dataset in one call."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, Concatenate, ParamSpec

from avs3d_bench.errors import UsageError, excerpt
from avs3d_bench.runtime.one_thread import ONE_THREAD
from avs3d_bench.runtime.parallel import available_cores
from avs3d_bench.runtime.user_path import user_path
from avs3d_bench.scheduling.options import Options as Scheduling
from avs3d_bench.scheduling.options import scheduler_of
from avs3d_bench.scheduling.tasks import Listener
from generators.backends import vision_backend
from generators.core.cuda import cuda_problem, most_workers, visible_devices
from generators.core.folders import default_cache
from generators.manifest.reading import ManifestFile, read_manifest, select
from generators.options import GenerateOptions, check_path
from generators.plan import ObservationPlan, make_plans
from generators.run.progress import reporting
from generators.run.runner import Outcome, RunSettings, default_limit, run
from generators.vision.base import frames_at_once

#: Processes that share a device on which each works on several frames at once.
_SHARING = 2

_Options = ParamSpec("_Options")
_Generate = Callable[Concatenate[ManifestFile | str | Path, str | Path, _Options], Outcome]


def _taking(record: Callable[_Options, GenerateOptions]) -> Callable[[Callable[..., Outcome]], _Generate[_Options]]:
    """Give a function the fields of a record as arguments, for `help`, completion and type checkers.

    Args:
        record: the record that the function makes of ``**options``.
    """

    def decorate(function: Callable[..., Outcome]) -> _Generate[_Options]:
        shown = list(inspect.signature(function).parameters.values())[:-1]
        shown += inspect.signature(record).parameters.values()
        signature = inspect.signature(function).replace(parameters=shown)
        function.__signature__ = signature  # type: ignore[attr-defined]
        return function

    return decorate


@_taking(GenerateOptions)
def generate(manifest: ManifestFile | str | Path, root: str | Path, **options: Any) -> Outcome:
    """Generate the dataset that a manifest describes into a folder, as `avs3d generate` does.

    The same manifest and the same versions give the same bytes, whatever the number of workers. After an interruption
    the same call goes on: finished observations are kept.

    Args:
        manifest: the manifest's file, or what `read_manifest` returns.
        root: the dataset's folder; made if missing.
        options: see the attributes of `GenerateOptions`.

    Returns:
        The keys that were made, kept from an earlier call, and failed with their message.

    Raises:
        UsageError: if the manifest is wrong, a pattern of ``only`` matches nothing, or ``root`` holds observations that
            were made from another manifest or version.
        Avs3dError: if a backend, a scan or an asset is missing, or the folder cannot be written.
        TypeError: if there is no option of that name.

    Examples:
        An observation of 4 frames of 64 × 64 pixels, with sound of the closed-form engine:

        >>> options = {"only": ["part_1/*"], "audio": "analytic", "frames": 4, "size": 64, "workers": 1}
        >>> outcome = generate("room.yaml", "data/small", **options)
        >>> outcome.made, outcome.failed
        (('part_1/box/kitchen/1',), ())
        >>> from avs3d_bench import Dataset
        >>> Dataset("data/small")[0].frames[0].audio().shape
        (2, 44100)
    """
    check_path("root", root)
    if not isinstance(manifest, ManifestFile):
        check_path("manifest", manifest)
    chosen = GenerateOptions(**options)
    source = manifest if isinstance(manifest, ManifestFile) else read_manifest(Path(manifest))
    return generate_plans(source, make_plans(source, chosen), Path(root), chosen, progress=chosen.progress)


def generate_plans(
    source: ManifestFile,
    plans: tuple[ObservationPlan, ...],
    root: Path,
    options: GenerateOptions,
    scheduling: Scheduling | None = None,
    *,
    progress: bool = True,
) -> Outcome:
    """Generate planned observations into a folder: the part that `generate` and `avs3d generate` share.

    Args:
        source: the manifest.
        plans: the observations to make, from `make_plans`.
        root: the dataset's folder; made if missing.
        options: number of processes, cache.
        scheduling: where it runs, retries and time limits; None: on this machine, with the defaults.
        progress: report on stderr.

    Raises:
        UsageError, Avs3dError: see `generators.run.runner.run`.
    """
    gpus = _gpus(options)
    count = options.workers or _workers(options, max(1, len(gpus)))
    where = scheduling or Scheduling()
    policy = where.policy(one_thread=True)
    environment = dict(policy.environment) | ONE_THREAD
    settings = RunSettings(
        cache=user_path(options.cache) if options.cache else default_cache(),
        workers=count,
        scheduler=lambda: scheduler_of(where, count),
        shared=where.remote,
        policy=replace(policy, environment=tuple(sorted(environment.items())), gpus=gpus),
        limit=where.limit(default_limit(plans[0].camera)),
        max_failures=where.max_failures,
        format=options.format,
        remake=_to_remake(source, plans, options.remake),
    )
    shown: AbstractContextManager[Listener] = reporting(plans) if progress else nullcontext(_ignore)
    with shown as listen:
        return run(source, plans, root, settings, listen)


def _to_remake(source: ManifestFile, plans: Sequence[ObservationPlan], patterns: Sequence[str]) -> frozenset[str]:
    """The keys of ``plans`` that match a pattern.

    Raises:
        UsageError: if a pattern matches none of them.
    """
    chosen = {plan.key for plan in plans}
    found: set[str] = set()
    for pattern in patterns:
        named = {spec.key for spec in select(source.manifest, (pattern,), "--remake")}
        if named.isdisjoint(chosen):
            raise UsageError(
                f"--remake {excerpt(pattern)} matches no observation that --only chooses; leave out --only"
            )
        found |= named & chosen
    return frozenset(found)


def _gpus(options: GenerateOptions) -> tuple[str, ...]:
    """The GPUs that worker processes share, see `Policy.gpus`."""
    if "cuda" in (options.device, options.vision):
        return visible_devices()
    return visible_devices() if _is_pathtraced_on_gpu(options) and cuda_problem() is None else ()


def _is_pathtraced_on_gpu(options: GenerateOptions) -> bool:
    return options.vision == "pathtraced" and frames_at_once(vision_backend(options.vision, options.device)) > 1


def _workers(options: GenerateOptions, gpus: int) -> int:
    """One worker process per core; with CUDA no more than the memory of the devices has room for.

    A renderer that works on several frames at once keeps its device busy with one process; another one opens scenes
    meanwhile.
    """
    cores = available_cores()
    if _is_pathtraced_on_gpu(options):
        return min(cores, _SHARING * gpus)
    return min(cores, most_workers() * gpus) if "cuda" in (options.device, options.vision) else cores


def _ignore(_: object) -> None:
    """The listener of a run that reports nothing."""
