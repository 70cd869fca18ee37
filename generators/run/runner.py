"""Runs a manifest: what is to be made goes to a scheduler, what is made is kept, and the dataset is sealed.

Observations are independent of one another and of the number of workers. A finished one is recognised by the digest
of its plan and the sizes of its files (of shards, their digests); whatever was interrupted has a temporary name and is
regenerated.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from avs3d_bench.commands.outputs import Signature, check_replaceable
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import CameraSplits, ObservationRecord
from avs3d_bench.errors import Avs3dError, UsageError, excerpt
from avs3d_bench.formats.files import read_json
from avs3d_bench.runtime.parallel import available_cores
from avs3d_bench.scheduling.failures import FailureLog
from avs3d_bench.scheduling.local import LocalScheduler
from avs3d_bench.scheduling.lock import folder_lock
from avs3d_bench.scheduling.tasks import Event, Failure, Listener, Policy, Scheduler, Task
from generators.backends import observation_provenance
from generators.core.limits import MOST_CORES
from generators.homes.cache import check_writable, is_stored
from generators.manifest.reading import ManifestFile
from generators.manifest.schema import CameraSpec
from generators.observation.output import sweep
from generators.plan import ObservationPlan, check_scans
from generators.run.dataset_record import check
from generators.run.formats import (
    FOLDERS,
    FORMATS,
    DatasetFormat,
    WebdatasetFormat,
    find_finished,
    is_of_plan,
)
from generators.run.preflight import check_files
from generators.run.worker import RunTarget, make_observation, prepare, warm_up_worker

#: A home is built and lit once for all its observations and has this many times their time limit, but at most so many
#: seconds.
HOME_FACTOR, HOME_LIMIT = 10.0, 4 * 3600.0
#: A network file system shows a new folder to other machines after a while: seconds that are waited for it.
VISIBLE_WITHIN = 90.0


#: The least time limit of an observation, and what every frame of the benchmark's size adds, seconds: far beyond what
#: slow machines need.
LEAST_LIMIT, FRAME_LIMIT = 3600.0, 30.0


def default_limit(camera: CameraSpec) -> float:
    """Seconds after which an observation counts as hung."""
    return max(LEAST_LIMIT, FRAME_LIMIT * camera.frames * (camera.size / layout.IMAGE_SIZE) ** 2)


#: Number of observations that a warning names.
_NAMED = 3


@dataclass(frozen=True)
class Outcome:
    """Result of a run: keys that were made, kept from an earlier run, and failed (with their message).

    Attributes:
        made, kept, failed: see above.
        stopped: whether it ended early because too much failed.
        present: number of observations of the manifest that are there now.
        unseen: keys of those whose sounding object is in no test frame: strict IoU, F and boundary F leave them out.

    Examples:
        >>> options = {"only": ["part_2/*"], "audio": "analytic", "frames": 4, "size": 32, "workers": 1}
        >>> outcome = generate("room.yaml", "data/clocks", **options)
        >>> outcome.made, outcome.failed
        (('part_2/box/kitchen/1',), ())
        >>> again = generate("room.yaml", "data/clocks", **options)  # what is there is kept
        >>> again.made, again.kept
        ((), ('part_2/box/kitchen/1',))
    """

    made: tuple[str, ...]
    kept: tuple[str, ...]
    failed: tuple[tuple[str, str], ...]
    stopped: bool = False
    present: int = 0
    unseen: tuple[str, ...] = ()

    @property
    def warning(self) -> str | None:
        """One line on what no test frame shows; None if there is nothing to say."""
        if not self.unseen:
            return None
        few = ", ".join(self.unseen[:_NAMED]) + (", …" if len(self.unseen) > _NAMED else "")
        return (
            f"{len(self.unseen)} of {self.present} observations never show{'s' if len(self.unseen) == 1 else ''} the "
            f"object in a test frame ({few}); scores leave them out. Every eighth frame is a test frame: more frames "
            "(--frames) or another index show it"
        )


@dataclass(frozen=True)
class RunSettings:
    """Where and how a run does its work.

    Attributes:
        cache: folder of baked homes.
        workers: number of processes of this machine, where no scheduler is given.
        scheduler: makes the one that does the work; called only if there is any.
        shared: the scheduler's workers are on other machines: they check that they see the same folder and have the
            same versions.
        policy: retries and environment.
        limit: seconds for an observation, of which a home has `HOME_FACTOR` times as many; None: no limit.
        max_failures: end the run when more than so many have failed; None: go on whatever fails.
        format: of what is written: a name of `FORMATS`.
        remake: keys of observations that are regenerated even if they are there; each stays until the new one is whole.
    """

    cache: Path
    workers: int = 1
    scheduler: Callable[[], Scheduler] | None = None
    shared: bool = False
    policy: Policy = field(default_factory=Policy)
    limit: float | None = None
    max_failures: int | None = None
    format: str = "folders"
    remake: frozenset[str] = frozenset()


def run(
    source: ManifestFile, plans: tuple[ObservationPlan, ...], root: Path, settings: RunSettings, listen: Listener
) -> Outcome:
    """Generate ``plans`` into ``root`` and write the index over them, dataset.json or shards.json.

    Args:
        source: the manifest, for dataset.json.
        plans: the observations to make.
        root: the dataset's folder; made if missing.
        settings: where and how.
        listen: gets every event, in this process. Its name is the observation's key, or the home's name. Kinds are
            "home", "start", "frame", "done", "kept", "failed", "retry", "worker" (one was lost) and "note"; the text of
            "frame" is the number of the newest one.

    Raises:
        UsageError: if ``root`` holds observations made from another plan or in another form, or files and no dataset;
            or the index could not hold what the manifest says.
        Avs3dError: if no scan that ``plans`` need is there, another file that what is to be made needs is missing or
            broken, the folder or the cache cannot be written, or another run is at work in the folder.
    """
    check(source)
    check_scans(plans)
    root, form = root.absolute(), FORMATS[settings.format](source.manifest)
    settings = replace(settings, cache=settings.cache.absolute())
    refuse_foreign(root, form, source.manifest.name)
    new = [plan for plan in plans if plan.key in settings.remake or not form.path(root, plan.key).exists()]
    check_files(source, new)  # before the folder is made
    with folder_lock(root) as me:
        sweep(root)
        # Existing observations must come from the same manifest and software, selected or not.
        done = _finished(form, source, plans, root, listen, settings.remake)
        software = observation_provenance(plans[0].options)
        if without := _of_other_plans(form, root, plans, settings.remake):
            form.seal(source, root, software, without)  # the index lists them no longer: the run may be killed
        log = FailureLog(root, {spec.key: plans[0].seed for spec in source.manifest.observations})
        log.tidy(done)
        todo = [plan for plan in plans if plan.key not in done]
        kept = tuple(plan.key for plan in plans if plan.key in done)
        for key in kept:
            listen(Event("kept", key, ""))
        outcome = Outcome((), kept, ())
        if todo:
            place = RunTarget(root, settings.cache, me.token if settings.shared else None, form)
            try:
                outcome = _make(todo, place, settings, listen, log, kept)
            finally:
                sweep(root)
        log.tidy({*done, *outcome.made})
        _await(form, root, [plan for plan in plans if plan.key in outcome.made], settings.remake)
        records: list[str] = []
        unseen: list[str] = []

        def see(record: ObservationRecord) -> None:
            records.append(record.key)
            if never_in_a_test_frame(record):
                unseen.append(record.key)

        form.seal(source, root, software, _of_other_plans(form, root, plans, settings.remake), see)
        return replace(outcome, unseen=tuple(unseen), present=len(records))


def _make(
    todo: Sequence[ObservationPlan],
    place: RunTarget,
    settings: RunSettings,
    listen: Listener,
    log: FailureLog,
    kept: tuple[str, ...],
) -> Outcome:
    """Hand what is to be made to the scheduler; failures are logged as they come."""
    if not settings.shared:  # workers on other machines see to it themselves
        _check_cache(place.cache, todo)
    made: list[str] = []
    failed: list[tuple[str, str]] = []
    stopped = False
    with (settings.scheduler or (lambda: LocalScheduler(settings.workers)))() as pool:
        threads = 1 if settings.shared else settings.workers
        tasks = _tasks(todo, place, threads=threads, limit=settings.limit, remake=settings.remake)
        policy = replace(
            settings.policy,
            warm_up=Task("warm_up_worker", warm_up_worker, (todo[0].options,)),
        )
        with closing(pool.run(tasks, policy, lambda event: listen(_named(event)))) as results:
            for result in results:
                key = result.task.name
                if result.task.after is None:
                    continue  # a home; the observations that waited for it tell the rest
                if isinstance(result, Failure):
                    message = result.message
                    if key in settings.remake and place.form.path(place.root, key).exists():
                        message += " (the earlier observation is left as it was)"
                    failed.append((key, message))
                    log.add(key, result.attempts)
                    listen(Event("failed", key, message))
                    stopped = settings.max_failures is not None and len(failed) > settings.max_failures
                    if stopped:
                        break
                else:
                    made.append(key)
                    listen(Event("done", key, result.value))
    return Outcome(tuple(made), kept, tuple(failed), stopped)


def never_in_a_test_frame(record: ObservationRecord) -> bool:
    """Whether something that sounds could be seen, but no test frame shows any of it while it is audible."""
    if record.sources is not None and not any(source.instance is not None for source in record.sources):
        return False  # silence, or sound from other rooms alone, is the task
    test = frozenset(CameraSplits.of(len(record.frames)).test)
    return not any(frame.visible_pixels for frame in record.frames if frame.name in test)


#: What the failures of an earlier run say about themselves.
_FAILURES = Signature(start=b'{"key": ')


def refuse_foreign(root: Path, form: DatasetFormat = FOLDERS, name: str | None = None) -> None:
    """Refuse a folder that holds something and is no dataset, finished or not: nothing is mixed into it.

    A dataset shows in its index (dataset.json or shards.json), its parts or shards, or the lock and the failures of an
    earlier run.

    Args:
        root: the folder.
        form: what is to be written.
        name: of the dataset; None: any.

    Raises:
        UsageError: naming what is there.
    """
    check_replaceable(root / form.index, (form.signature,))
    check_replaceable(root / layout.FAILURES_JSONL, (_FAILURES,))
    with suppress(OSError):  # whoever makes the folder says what is wrong with it
        there = sorted(path.name for path in root.iterdir()) if root.is_dir() else []
        own = [name for name in there if form.owns(name) or name in (layout.LOCK, layout.FAILURES_JSONL)]
        others = (FOLDERS, WebdatasetFormat({}))
        mixed = [name for name in there if not form.owns(name) and any(other.owns(name) for other in others)]
        if mixed:
            raise UsageError(f"{root}: holds {mixed[0]}, which is of another --format; choose another folder with -o")
        if there and not own:
            raise UsageError(
                f"{root}: not empty and no dataset (holds {excerpt(there[0])}); choose another folder with -o"
            )
    index = root / form.index
    if name is not None and index.is_file() and index.stat().st_size:
        found = form.name_of(read_json(index))
        if found != name:
            raise UsageError(
                f"{root}: holds the dataset {excerpt(str(found))}, the manifest is that of {name}; choose another "
                "folder with -o"
            )


def _check_cache(cache: Path, todo: Sequence[ObservationPlan]) -> None:
    """Refuse a folder that no home can be stored in, if one has to be built.

    Raises:
        Avs3dError: one line.
    """
    if any(
        plan.scan.source == "apartment" and not is_stored(cache, plan.home_digest, plan.options.device) for plan in todo
    ):
        check_writable(cache)


def _tasks(
    todo: Sequence[ObservationPlan], place: RunTarget, *, threads: int, limit: float | None, remake: Collection[str]
) -> list[Task]:
    """A task for each home, and one for each observation, which waits for its home or for its first sibling."""
    homes: dict[str, list[ObservationPlan]] = {}
    for plan in todo:
        homes.setdefault(plan.home_digest, []).append(plan)
    keys = {plan.key for plan in todo}
    each = math.ceil(threads / len(homes))
    home_limit = None if limit is None else min(HOME_FACTOR * limit, HOME_LIMIT)
    tasks = []
    bare = replace(place, form=place.form.limited_to(()))
    for digest, group in homes.items():
        home = Task(f"home {digest[:16]}", prepare, (group[0], bare, each), limit=home_limit)
        tasks.append(home)
        for plan in group:
            named = (plan.key,) if plan.first is None else (plan.key, plan.first.key)
            own = replace(place, form=place.form.limited_to(named), replaces=plan.key in remake)
            task = Task(
                plan.key, make_observation, (plan, own), after=home.name, limit=limit, most_cores=MOST_CORES,
                group=named[-1],
            )  # fmt: skip
            if plan.first is not None and plan.first.key in keys:
                # It links the pictures of the first of its group, or renders them if that one has failed.
                task = replace(task, after=plan.first.key, after_any=True)
            tasks.append(task)
    return tasks


def _named(event: Event) -> Event:
    """An event of the scheduler as this run's listener knows it; a home is called by its name."""
    return Event("home", event.text, "") if event.kind == "home" else event


def _of_other_plans(
    form: DatasetFormat, root: Path, plans: Sequence[ObservationPlan], remake: Collection[str]
) -> frozenset[str]:
    """Keys of the observations to be regenerated that are there, but from another manifest or by other software."""
    there = [plan for plan in plans if plan.key in remake and form.path(root, plan.key).exists()]
    return frozenset(plan.key for plan in there if not is_of_plan(form, root, plan))


def _await(form: DatasetFormat, root: Path, made: Sequence[ObservationPlan], remake: Collection[str]) -> None:
    """Wait until everything that other machines have made is to be seen from here.

    Raises:
        Avs3dError: if it does not come.
    """
    deadline = time.monotonic() + VISIBLE_WITHIN
    for plan in made:
        key = plan.key
        while not (is_of_plan(form, root, plan) if key in remake else form.path(root, key).exists()):
            if time.monotonic() > deadline:
                raise Avs3dError(
                    f"{form.path(root, key)}: made on another machine, but not to be seen here; "
                    "check that the folder is shared, and run the same command again"
                )
            time.sleep(0.5)
            # Reading the folder has a network file system look again for what was not there before.
            if (parent := form.path(root, key).parent).is_dir():
                os.listdir(parent)


def _finished(
    form: DatasetFormat,
    source: ManifestFile,
    plans: Sequence[ObservationPlan],
    root: Path,
    listen: Listener,
    remake: Collection[str],
) -> set[str]:
    """Keys of the manifest's observations that are there; what is damaged among ``plans`` is removed, and said.

    Those of ``remake`` count as not there, whatever they are.
    """
    every = (
        replace(plans[0], spec=spec, scan=source.manifest.scans[spec.scan])
        for spec in source.manifest.observations
        if spec.key not in remake
    )
    looked = {plan.key: find_finished(form, root, plan) for plan in every}
    found = {key: record for key, record in looked.items() if record is not None}
    # Nothing is removed before everything has been found to come from the same manifest and software.
    there = [found[plan.key] for plan in plans if plan.key in found]
    for key in looked.keys() - found.keys():
        form.discard(root, key)
    with ThreadPoolExecutor(available_cores()) as pool:
        damages = pool.map(partial(form.find_damage, root), there)
        for record, damage in zip(there, damages, strict=True):
            if damage:
                listen(Event("note", record.key, f"regenerated: {damage}"))
                form.discard(root, record.key)
                del found[record.key]
    return set(found)
