"""Runs a manifest: prepares the homes, spreads observations over worker processes, resumes, reports, seals the dataset.

Observations are independent of one another and of the number of workers. A finished one is recognised by the digest
of its plan; whatever was interrupted lies in a temporary folder and is made again.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing import active_children, get_context
from multiprocessing.queues import SimpleQueue
from pathlib import Path

from avs3d_bench import __version__, files, layout
from avs3d_bench.cli import missing_extra
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.schema import (
    AttributionRecord,
    DatasetEntry,
    DatasetRecord,
    LicenceRecord,
    ObservationRecord,
    parse_record,
    unique_attributions,
)
from generators.backends import vision_backend
from generators.homes import prepare_home
from generators.library.licences import conditions
from generators.observation import generate_observation
from generators.plan import ManifestFile, ObservationPlan

#: What a run tells its caller: (kind, key, text); kinds are "home", "start", "frame", "done", "kept", "failed".
Event = tuple[str, str, str]
Listener = Callable[[Event], None]


@dataclass(frozen=True)
class Outcome:
    """What a run did: keys that were made, kept from an earlier run, and failed (with their message)."""

    made: tuple[str, ...]
    kept: tuple[str, ...]
    failed: tuple[tuple[str, str], ...]


def run(
    source: ManifestFile,
    plans: tuple[ObservationPlan, ...],
    root: Path,
    *,
    workers: int,
    cache: Path,
    listen: Listener,
) -> Outcome:
    """Generate ``plans`` into ``root`` and write dataset.json.

    Args:
        source: the manifest, for dataset.json.
        plans: the observations to make.
        root: the dataset's folder; made if missing.
        workers: number of processes.
        cache: folder of baked homes.
        listen: gets every event, in this process.

    Raises:
        UsageError: if ``root`` holds observations made from another plan.
        Avs3dError: if the folder cannot be written or another run is at work in it.
    """
    with _locked(root):
        _sweep(root)
        # What is there already must be of one piece with what is to come, selected or not.
        every = [
            replace(plans[0], spec=spec, scan=source.manifest.scans[spec.scan]) for spec in source.manifest.observations
        ]
        done = {plan.key for plan in every if _is_done(root, plan)}
        todo = [plan for plan in plans if plan.key not in done]
        kept = [plan for plan in plans if plan.key in done]
        for plan in kept:
            listen(("kept", plan.key, ""))
        ready, failed = _prepare(todo, workers=workers, cache=cache, listen=listen)
        if ready:
            vision_backend(ready[0].vision).warm_up()
        made, broken = _make(ready, root, workers=workers, cache=cache, listen=listen)
        _seal(source, root)
        return Outcome(tuple(made), tuple(plan.key for plan in kept), (*failed, *broken))


def _prepare(
    todo: list[ObservationPlan], *, workers: int, cache: Path, listen: Listener
) -> tuple[list[ObservationPlan], list[tuple[str, str]]]:
    """Build and light every home once; the plans whose home stands, and the others with what is wrong with theirs."""
    homes: dict[str, list[ObservationPlan]] = {}
    for plan in todo:
        homes.setdefault(plan.home_digest, []).append(plan)
    ready: list[ObservationPlan] = []
    failed: list[tuple[str, str]] = []
    for group in homes.values():
        listen(("home", group[0].spec.scan, ""))
        try:
            prepare_home(group[0], cache, workers=workers)
            ready += group
        except Avs3dError as error:
            for plan in group:
                failed.append((plan.key, str(error)))
                listen(("failed", plan.key, str(error)))
    return ready, failed


def _make(
    todo: list[ObservationPlan], root: Path, *, workers: int, cache: Path, listen: Listener
) -> tuple[list[str], list[tuple[str, str]]]:
    made: list[str] = []
    failed: list[tuple[str, str]] = []

    def finished(key: str, error: str | None, text: str) -> None:
        if error is None:
            made.append(key)
            listen(("done", key, text))
        else:
            failed.append((key, error))
            listen(("failed", key, error))

    count = min(workers, len(todo))
    if count <= 1:
        for plan in todo:
            finished(plan.key, *_attempt(plan, root, cache, listen))
        return made, failed
    context = get_context("spawn")
    events: SimpleQueue[Event | None] = context.SimpleQueue()
    reader = threading.Thread(target=_relay, args=(events, listen), daemon=True)
    reader.start()
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_start_worker, initargs=(events, os.getpid()))
    jobs: dict[Future[tuple[str | None, str]], str] = {}
    try:
        jobs = {pool.submit(_in_worker, plan, root, cache): plan.key for plan in todo}
        for job in as_completed(jobs):
            finished(jobs[job], *job.result())
    except BaseException as error:
        # Ctrl-C, or a worker that died: end the others too. A dead worker may hold the lock of the queue, so the
        # reader, a daemon, is left to itself.
        pool.shutdown(wait=False, cancel_futures=True)
        for process in active_children():
            process.terminate()
            process.join()
        _sweep(root)
        if not isinstance(error, BrokenProcessPool):
            raise
        lost = [key for key in jobs.values() if key not in made]
        raise Avs3dError(
            f"{root}: a worker process died (killed, or out of memory) while making {', '.join(lost[:3])}; "
            "run the same command again to go on, with fewer --workers if memory was short"
        ) from None
    pool.shutdown()
    events.put(None)
    reader.join(timeout=5)
    return made, failed


def _relay(events: SimpleQueue[Event | None], listen: Listener) -> None:
    while (event := events.get()) is not None:
        listen(event)


_events: SimpleQueue[Event | None] | None = None


def _start_worker(events: SimpleQueue[Event | None], parent: int) -> None:
    global _events
    _events = events
    # Ctrl-C reaches every process of the terminal; the parent decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        # A pool's processes outlive a parent that was killed with -9; they must not go on writing beside its successor.
        while os.getppid() == parent:
            time.sleep(0.25)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _in_worker(plan: ObservationPlan, root: Path, cache: Path) -> tuple[str | None, str]:
    assert _events is not None
    return _attempt(plan, root, cache, _events.put)


def _attempt(plan: ObservationPlan, root: Path, cache: Path, listen: Listener) -> tuple[str | None, str]:
    """(None, summary) or (error message, "")."""
    started = time.perf_counter()
    listen(("start", plan.key, str(plan.camera.frames)))
    try:
        record = generate_observation(plan, root, cache, lambda index: listen(("frame", plan.key, str(index))))
    except Avs3dError as error:
        return str(error), ""
    except OSError as error:
        return files.os_error_line(error), ""
    except ModuleNotFoundError as error:
        return missing_extra(error, "generators"), ""
    except Exception as error:
        if os.environ.get("AVS3D_DEBUG"):
            traceback.print_exc()
        return f"internal error: {type(error).__name__}: {error} (AVS3D_DEBUG=1 shows where; please report it)", ""
    visible = sum(frame.visible_pixels > 0 for frame in record.frames)
    return None, (
        f"{record.category}, {len(record.instances)} objects, visible in {visible} of {len(record.frames)} frames, "
        f"T30 {record.acoustics.t30 or float('nan'):.2f} s, {time.perf_counter() - started:.0f} s"
    )


@contextmanager
def _locked(root: Path) -> Iterator[None]:
    """Make ``root`` and hold it against a second run."""
    try:
        root.mkdir(parents=True, exist_ok=True)
        handle = os.open(root, os.O_RDONLY)
    except OSError as error:
        raise Avs3dError(f"{root}: cannot write there ({error.strerror}); choose another folder with -o") from error
    try:
        # The folder itself is locked, so that nothing is left in it, and the lock ends with the process.
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise Avs3dError(f"{root}: another avs3d generate is at work in this folder; wait for it") from None
    except OSError as error:
        os.close(handle)
        raise Avs3dError(files.os_error_line(error, root, "lock")) from error
    try:
        yield
    finally:
        os.close(handle)


def _sweep(root: Path) -> None:
    """Remove what interrupted runs left behind."""
    for partial in root.glob("part_*/*/*/.*.partial"):
        shutil.rmtree(partial, ignore_errors=True)


def _is_done(root: Path, plan: ObservationPlan) -> bool:
    folder = root / plan.key
    if not folder.exists():
        return False
    record = _read(folder)
    if record.plan_sha256 != plan.digest:
        raise UsageError(
            f"{folder}: was generated from another manifest, other options or another version; "
            "choose another folder with -o, or delete it to have it made again"
        )
    return True


def _read(folder: Path) -> ObservationRecord:
    path = folder / layout.OBSERVATION_JSON
    try:
        return parse_record(path.read_bytes(), ObservationRecord, path)
    except OSError as error:
        raise Avs3dError(f"{path}: cannot be read ({error.strerror}); delete {folder} to have it made again") from error


def _seal(source: ManifestFile, root: Path) -> None:
    """Write dataset.json over every observation of the manifest that is there."""
    entries, attributions = [], []
    backends: dict[str, str] = {}
    for spec in sorted(source.manifest.observations, key=lambda spec: spec.key):
        folder = root / spec.key
        if not folder.exists():
            continue
        record = _read(folder)
        entries.append(DatasetEntry.of(record, files.sha256_file(folder / layout.OBSERVATION_JSON)))
        backends[record.vision.backend] = record.vision.version
        backends[record.acoustics.backend] = record.acoustics.version
        used = [(instance.asset, instance.licence) for instance in record.instances]
        if record.sound is not None:
            used.append((record.sound.asset, record.sound.licence))
        attributions += [AttributionRecord(asset=asset, **licence.model_dump()) for asset, licence in used]
    for name, scan in source.manifest.scans.items():
        licence = scan.licence or LicenceRecord(name="Apache-2.0", author="avs3d-bench", source="procedural")
        if scan.source == "scan" and scan.licence is None:
            licence = LicenceRecord(name="unknown", author="unknown", source=scan.file or name)
        attributions.append(
            AttributionRecord(asset=f"scan:{name}", name=licence.name, author=licence.author, source=licence.source)
        )
    if not entries:
        return
    terms = [
        "CC-BY-NC-4.0 (the sound was computed with RLRAudioPropagation, whose licence is non-commercial)"
        if "soundspaces" in backends
        else "Apache-2.0",
        # What is not made here keeps its own terms; those that only ask for attribution find it beside.
        *conditions(attribution.name for attribution in attributions),
    ]
    files.write_json(
        root / layout.DATASET_JSON,
        DatasetRecord(
            name=source.manifest.name,
            version=source.manifest.version,
            toolkit_version=__version__,
            manifest=source.text,
            manifest_sha256=source.sha256,
            backends=dict(sorted(backends.items())),
            licence="; ".join(terms),
            attributions=unique_attributions(attributions),
            observations=tuple(entries),
        ),
    )
