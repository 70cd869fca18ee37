"""Generation from Python: a manifest to a dataset in one call."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

from avs3d_bench.errors import UsageError, excerpt
from avs3d_bench.one_thread import ONE_THREAD
from avs3d_bench.parallel import available_cores
from avs3d_bench.scheduling.options import Options as Scheduling
from avs3d_bench.scheduling.options import scheduler_of
from avs3d_bench.scheduling.tasks import Listener
from avs3d_bench.user_path import user_path
from generators.backends import RENDERERS
from generators.core.cuda import most_workers
from generators.core.folders import default_cache
from generators.manifest import ManifestFile, read_manifest, select
from generators.plan import ObservationPlan, make_plans
from generators.receivers import choose_receivers
from generators.run.options import Audio, Device, Extra, Form, GenerateOptions, Vision, check_path
from generators.run.progress import reporting
from generators.run.runner import Outcome, RunSettings, default_limit, run


def generate(
    manifest: ManifestFile | str | Path,
    root: str | Path,
    *,
    only: Sequence[str] = (),
    workers: int | None = None,
    vision: Vision | None = None,
    audio: Audio | None = None,
    frames: int | None = None,
    size: int | None = None,
    extras: Sequence[Extra] = (),
    progress: bool = False,
    hrtf: str | Path | None = None,
    ambisonics: int | None = None,
    array: str | Path | None = None,
    device: Device = "cpu",
    format: Form = "folders",
    remake: Sequence[str] = (),
) -> Outcome:
    """Generate the dataset that a manifest describes into a folder, as `avs3d generate` does.

    The same manifest and the same versions give the same bytes, whatever the number of workers. After an interruption
    the same call goes on: finished observations are kept.

    Args:
        manifest: the manifest's file, or what `read_manifest` returns.
        root: the dataset's folder; made if missing.
        only: shell patterns of observation keys, e.g. ``("part_2/*",)``; the others are left out.
        workers: number of processes; None: one per core.
        vision: renderer; None: that of ``device``, embree or cuda. habitat needs ``$AVS3D_HABITAT_PYTHON``.
        audio: acoustic engine; soundspaces needs rlr-audio-propagation (CC-BY-NC 4.0). None: the manifest's, or the
            tracer.
        frames: frames per observation; None: the manifest's.
        size: side of the pictures (pixels); None: the manifest's.
        extras: optional folders: depth pictures, impulse responses, stems (of part_3).
        progress: show a bar on stderr, and a line per finished observation.
        hrtf: SOFA file of the head that hears the binaural clips; only with the tracer, as the next two.
        ambisonics: order of ambisonic clips, 1 to 3, beside the binaural ones; None: there are none.
        array: file that lists the microphones of an array; None: there is none.
        device: what draws the pictures, bakes the light and, with the tracer, traces the sound; cuda needs ``[cuda]``.
        format: ``folders``, a dataset as `avs3d_bench.Dataset` reads it; or ``webdataset``, tar files of samples
            and ``shards.json``: see `avs3d_bench.exports.observation_tar`.
        remake: shell patterns of the keys of observations that are made again even if they are there, from whatever
            manifest or version. Each stays until the new one is whole.

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
    for name, path in (("root", root), ("hrtf", hrtf), ("array", array)):
        if path is not None or name == "root":
            check_path(name, path)
    if not isinstance(manifest, ManifestFile):
        check_path("manifest", manifest)
    options = GenerateOptions(
        only,
        workers,
        vision,
        audio,
        frames,
        size,
        extras,
        hrtf=None if hrtf is None else user_path(hrtf),
        ambisonics=ambisonics,
        array=None if array is None else user_path(array),
        device=device,
        format=format,
        remake=remake,
    )
    source = manifest if isinstance(manifest, ManifestFile) else read_manifest(Path(manifest))
    return generate_plans(source, plans_of(source, options), Path(root), options, progress=progress)


def plans_of(source: ManifestFile, options: GenerateOptions) -> tuple[ObservationPlan, ...]:
    """The observations that ``options`` ask for; raises what `make_plans` and `choose_receivers` do."""
    audio = source.manifest.engine(options.audio)
    return make_plans(
        source,
        only=options.only,
        vision=options.vision or RENDERERS[options.device],
        audio=audio,
        frames=options.frames,
        size=options.size,
        extras=options.extras,
        receivers=choose_receivers(audio, hrtf=options.hrtf, ambisonics=options.ambisonics, array=options.array),
        device=options.device,
    )


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
        plans: the observations to make, from `plans_of`.
        root: the dataset's folder; made if missing.
        options: number of processes, cache.
        scheduling: where it runs, retries and time limits; None: on this machine, with the defaults.
        progress: report on stderr.

    Raises:
        UsageError, Avs3dError: see `generators.run.runner.run`.
    """
    count = options.workers or _workers(options)
    where = scheduling or Scheduling()
    policy = where.policy(one_thread=True)
    environment = dict(policy.environment) | ONE_THREAD
    settings = RunSettings(
        cache=user_path(options.cache) if options.cache else default_cache(),
        workers=count,
        scheduler=lambda: scheduler_of(where, count),
        shared=where.remote,
        policy=replace(policy, environment=tuple(sorted(environment.items()))),
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


def _workers(options: GenerateOptions) -> int:
    """One worker process per core; with CUDA no more than the device's memory has room for."""
    cores = available_cores()
    uses_cuda = "cuda" in (options.device, options.vision)
    return min(cores, most_workers()) if uses_cuda else cores


def _ignore(_: object) -> None:
    """The listener of a run that reports nothing."""
