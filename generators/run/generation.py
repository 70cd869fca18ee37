"""Generation from Python: a manifest to a dataset in one call."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Literal

from avs3d_bench.errors import UsageError, did_you_mean
from avs3d_bench.files import user_path
from avs3d_bench.parallel import available_cores
from avs3d_bench.scheduling.options import Options, scheduler_of
from avs3d_bench.scheduling.tasks import Listener
from generators.core.folders import default_cache
from generators.manifest import ManifestFile, read_manifest
from generators.plan import ObservationPlan, make_plans
from generators.run.progress import reporting
from generators.run.runner import Outcome, RunSettings, default_limit, run

#: Environment of workers: one thread a process, so that results are the same on any machine.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
#: Smallest and largest number of frames, of pixels per side, and of processes.
LIMITS = {"frames": (1, 999), "size": (16, 8192), "workers": (1, 256)}
#: Optional folders of an observation.
EXTRAS = ("depth", "rirs")


def generate(
    manifest: ManifestFile | str | Path,
    root: str | Path,
    *,
    only: Sequence[str] = (),
    workers: int | None = None,
    vision: Literal["embree", "habitat"] = "embree",
    audio: Literal["soundspaces", "analytic"] = "soundspaces",
    frames: int | None = None,
    size: int | None = None,
    extras: Collection[Literal["depth", "rirs"]] = (),
    progress: bool = False,
) -> Outcome:
    """Generate the dataset that a manifest describes into a folder, as `avs3d generate` does.

    The same manifest and the same versions give the same bytes, whatever the number of workers. After an interruption
    the same call goes on: finished observations are kept.

    Args:
        manifest: the manifest's file, or what `read_manifest` returns.
        root: the dataset's folder; made if missing.
        only: shell patterns of observation keys, e.g. ``("part_2/*",)``; the others are left out.
        workers: number of processes; None: one per core.
        vision: renderer; habitat needs ``$AVS3D_HABITAT_PYTHON``.
        audio: acoustic engine; soundspaces needs rlr-audio-propagation (CC-BY-NC 4.0).
        frames: frames per observation; None: the manifest's.
        size: side of the pictures (pixels); None: the manifest's.
        extras: optional folders: depth pictures, impulse responses.
        progress: show a bar on stderr, and a line per finished observation.

    Returns:
        The keys that were made, kept from an earlier call, and failed with their message.

    Raises:
        UsageError: if the manifest is wrong, a pattern of ``only`` matches nothing, or ``root`` holds observations that
            were made from another manifest or version.
        Avs3dError: if a backend, a scan or an asset is missing, or the folder cannot be written.

    Examples:
        Two observations of 8 frames of 128 × 128 pixels, with sound of the closed-form renderer:

            from avs3d_bench import Dataset
            from generators import generate

            outcome = generate("scenes_manifest/demo.yaml", "data/small", audio="analytic", frames=8, size=128)
            assert not outcome.failed
            print(Dataset("data/small")[0].frames[0].audio().shape)
    """
    for name, number in (("frames", frames), ("size", size), ("workers", workers)):
        low, high = LIMITS[name]
        if number is not None and not low <= number <= high:
            raise UsageError(f"{name} {number}: expected {low} to {high}")
    for name, texts, what in (("only", only, "patterns"), ("extras", extras, "names")):
        if isinstance(texts, str):
            raise UsageError(f"{name}: {texts!r}: expected a list of {what}")
    for extra in extras:
        if extra not in EXTRAS:
            hint = did_you_mean(extra, EXTRAS)
            raise UsageError(f"extras: unknown folder {extra!r}: expected some of {', '.join(EXTRAS)}{hint}")
    source = manifest if isinstance(manifest, ManifestFile) else read_manifest(Path(manifest))
    plans = make_plans(
        source,
        only=only,
        vision=vision,
        audio=audio,
        frames=frames,
        size=size,
        depth="depth" in extras,
        rirs="rirs" in extras,
    )
    return generate_plans(source, plans, Path(root), workers=workers, progress=progress)


def generate_plans(
    source: ManifestFile,
    plans: tuple[ObservationPlan, ...],
    root: Path,
    *,
    workers: int | None = None,
    cache: Path | None = None,
    scheduling: Options | None = None,
    progress: bool = True,
) -> Outcome:
    """Generate planned observations into a folder: the part that `generate` and `avs3d generate` share.

    Args:
        source: the manifest.
        plans: the observations to make, from `make_plans`.
        root: the dataset's folder; made if missing.
        workers: number of processes of this machine; None: one per core.
        cache: folder of baked homes; None: ``$AVS3D_CACHE``, or the user's cache folder.
        scheduling: where it runs, retries and time limits; None: on this machine, with the defaults.
        progress: report on stderr.

    Raises:
        UsageError, Avs3dError: see `generators.run.runner.run`.
    """
    count = workers or available_cores()
    options = scheduling or Options()
    policy = options.policy(one_thread=True)
    environment = dict(policy.environment) | ONE_THREAD
    settings = RunSettings(
        cache=user_path(cache) if cache else default_cache(),
        workers=count,
        scheduler=lambda: scheduler_of(options, count),
        shared=options.remote,
        policy=replace(policy, environment=tuple(sorted(environment.items()))),
        limit=options.limit(default_limit(plans[0].camera)),
        max_failures=options.max_failures,
    )
    shown: AbstractContextManager[Listener] = reporting(plans) if progress else nullcontext(_ignore)
    with shown as listen:
        return run(source, plans, root, settings, listen)


def _ignore(_: object) -> None:
    """The listener of a run that reports nothing."""
