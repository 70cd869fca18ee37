"""`python -m benchmarks.faults`: tests of `avs3d generate` with injected faults. For Linux; mounts need root.

Every trial starts a run on a tiny manifest in a process of its own, injects a fault at a time drawn from the seed,
waits for the run to end, and repeats the same command until it succeeds. The dataset must then be equal to that of an
undisturbed run, byte for byte, without other files in the folder, and `validate --deep` must find no problem.

| kind            | fault                                                                                         |
|-----------------|-----------------------------------------------------------------------------------------------|
| worker          | SIGKILL of a random process below the run (local scheduler, two workers)                        |
| client          | SIGKILL of the run itself                                                                     |
| dask-worker     | SIGKILL of a random process below a run with a Dask cluster of its own                          |
| dask-client     | SIGKILL of a run on a cluster that others started; the next run joins the same cluster          |
| dask-scheduler  | SIGKILL of that cluster's scheduler; the next run has a new cluster                             |
| hang            | SIGSTOP of a random worker, like an engine that hangs; ``--time-limit`` ends it                 |
| disk-full       | the dataset's file system (tmpfs) is full after a random number of bytes; then it is enlarged   |
| read-only       | the file system turns read-only; then it can be written to again                              |
| clock           | the clock jumps by up to three days, back or forth (libfaketime)                                |

``healed``: the disturbed run itself succeeded; ``recovered``: the dataset was right in the end.
"""

from __future__ import annotations

import ctypes
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import click

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import write_json
from avs3d_bench.validate import validate
from tests.support.homes import tree_digest, write_manifest

ROOT = Path(__file__).resolve().parent.parent
#: Time limit of a run (s).
PATIENCE = 300.0
#: Time limit of an observation in runs with a stopped worker: multiple of an undisturbed run's time, and minimum (s).
#: (The limit of a home is ten times as long.)
TIME_LIMIT, LEAST_LIMIT = 2.0, 5.0
#: Of runs whose file system fails: what one worker meets there, two would meet.
ALONE = ("--workers", "1")
#: Largest number of repetitions of the same command.
RERUNS = 3
KILLS = ("worker", "client", "dask-worker", "dask-client", "dask-scheduler")
KINDS = (*KILLS, "hang", "disk-full", "read-only", "clock")
_FAKETIME = Path("/usr/lib/x86_64-linux-gnu/faketime/libfaketime.so.1")
_REMOUNT, _READ_ONLY = 32, 1


@dataclass(frozen=True)
class Bench:
    """Common data of all trials: manifest, dataset and duration of an undisturbed run, working folder."""

    manifest: Path
    truth: dict[str, str]
    seconds: float
    size: int
    folder: Path


@dataclass(frozen=True)
class Trial:
    """One trial: its kind, seed and time (as a share of an undisturbed run's), and its outcome."""

    kind: str
    seed: int
    moment: float
    healed: bool
    recovered: bool
    reruns: int
    problem: str = ""


# Runs


def command(bench: Bench, root: Path, *more: str) -> list[str]:
    """`avs3d generate` of the tiny manifest into ``root``."""
    program = [sys.executable, "-m", "avs3d_bench", "generate", str(bench.manifest), "-o", str(root)]
    return [*program, "--audio", "analytic", "--workers", "2", *more]


def start(arguments: list[str], log: Path, **environment: str) -> subprocess.Popen[bytes]:
    """Start a program whose output goes to ``log``."""
    path = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    with log.open("ab") as stream:
        return subprocess.Popen(
            arguments,
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=stream,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path), **environment},
        )


def end(run: subprocess.Popen[bytes]) -> int:
    """Wait for a run and return its exit code; a run that does not end is killed and gives -1."""
    try:
        return run.wait(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        run.kill()
        run.wait()
        return -1


def below(process: int) -> list[int]:
    """The processes that descend from ``process``."""
    children: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            head, _, tail = stat.read_text().rpartition(")")
            children.setdefault(int(tail.split()[1]), []).append(int(head.split()[0]))
    found, rest = [], [process]
    while rest:
        mine = sorted(children.get(rest.pop(), []))
        found += mine
        rest += mine
    return found


def runs(process: int, program: bytes) -> bool:
    """Whether a process was started with ``program`` in its command line."""
    try:
        return program in Path(f"/proc/{process}/cmdline").read_bytes()
    except OSError:
        return False


def victim(run: subprocess.Popen[bytes], rng: random.Random, program: bytes = b"") -> int | None:
    """A random descendant of a run that executes ``program``; None if there is none any more.

    Processes that only track their parent's semaphores are excluded, because they do no work.
    """
    while run.poll() is None:
        alive = [each for each in below(run.pid) if runs(each, program) and not runs(each, b"resource_tracker")]
        if alive:
            return rng.choice(alive)
        time.sleep(0.02)
    return None


def wait_until(moment: float, run: subprocess.Popen[bytes]) -> None:
    """Sleep to a time of the monotonic clock, or until the run has ended."""
    while time.monotonic() < moment and run.poll() is None:
        time.sleep(0.005)


# Clusters that others started


@contextmanager
def cluster(folder: Path, log: Path) -> Iterator[tuple[list[str], subprocess.Popen[bytes]]]:
    """A Dask scheduler and two workers: the options that join it, and the scheduler's process."""
    file = Path(tempfile.mkdtemp(dir=folder)) / "scheduler.json"
    dask = [sys.executable, "-m"]
    quiet = ["--no-dashboard", "--scheduler-file", str(file)]
    scheduler = start([*dask, "distributed.cli.dask_scheduler", "--port", "0", "--host", "127.0.0.1", *quiet], log)
    running = [scheduler]
    try:
        address = ""
        deadline = time.monotonic() + 60
        while not address:
            if time.monotonic() > deadline:
                raise Avs3dError(f"{log}: the Dask scheduler did not start")
            with suppress(OSError, ValueError, KeyError):
                address = json.loads(file.read_text())["address"]
            time.sleep(0.05)
        for name in "ab":
            worker = ["distributed.cli.dask_worker", "--nthreads", "1", "--death-timeout", "20", "--name", name]
            running.append(start([*dask, *worker, *quiet], log))
        yield ["--scheduler", "dask", "--scheduler-address", address], scheduler
    finally:
        for process in reversed(running):
            family = [process.pid, *below(process.pid)]
            for each in family:
                with suppress(ProcessLookupError):
                    os.kill(each, signal.SIGKILL)
            process.wait()


# Kinds. Each gives the exit code of the disturbed run, and the options and environment of the runs after it.


def kill_below(bench: Bench, root: Path, log: Path, rng: random.Random, moment: float, *more: str) -> int:
    run = start(command(bench, root, *more), log)
    wait_until(time.monotonic() + moment * bench.seconds, run)
    process = victim(run, rng)
    if process is not None:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
    return end(run)


def kill_client(bench: Bench, root: Path, log: Path, rng: random.Random, moment: float, *more: str) -> int:
    run = start(command(bench, root, *more), log)
    wait_until(time.monotonic() + moment * bench.seconds, run)
    run.kill()
    return end(run)


def kill_scheduler(bench: Bench, root: Path, log: Path, rng: random.Random, moment: float) -> int:
    with cluster(bench.folder, log) as (options, scheduler):
        run = start(command(bench, root, *options), log)
        wait_until(time.monotonic() + moment * bench.seconds, run)
        scheduler.kill()
        return end(run)


def hang(bench: Bench, root: Path, log: Path, rng: random.Random, moment: float) -> int:
    limit = max(LEAST_LIMIT, TIME_LIMIT * bench.seconds)
    run = start(command(bench, root, "--time-limit", f"{limit:.0f}"), log)
    wait_until(time.monotonic() + moment * bench.seconds, run)
    # Stop only a worker that has started its work, because the fault stands for an engine that hangs.
    process = victim(run, rng, b"scheduling.child")
    if process is not None:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGSTOP)
    return end(run)


def clock(bench: Bench, root: Path, log: Path, rng: random.Random, moment: float) -> int:
    jumps = Path(tempfile.mkdtemp(dir=bench.folder)) / "faketime"
    jumps.write_text("+0\n")
    run = start(
        command(bench, root), log, LD_PRELOAD=str(_FAKETIME), FAKETIME_TIMESTAMP_FILE=str(jumps),
        FAKETIME_NO_CACHE="1", FAKETIME_DONT_FAKE_MONOTONIC="1",
    )  # fmt: skip
    wait_until(time.monotonic() + moment * bench.seconds, run)
    jumps.write_text(f"{rng.choice('+-')}{rng.randint(60, 3 * 86400)}\n")
    return end(run)


def mount(target: Path, *, size: int = 0, read_only: bool = False, again: bool = False) -> None:
    """Mount a tmpfs, or change the one that is there.

    Raises:
        OSError: what mount(2) says; EBUSY while a file is open for writing and it is to be read-only.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    flags = (_REMOUNT if again else 0) | (_READ_ONLY if read_only else 0)
    options = f"size={size}".encode() if size else None
    if libc.mount(b"tmpfs", os.fsencode(target), b"tmpfs", flags, options) != 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code), str(target))


def fill_disk(bench: Bench, root: Path, log: Path, rng: random.Random, moment: float) -> int:
    # Not less than the run needs to say so: a page for each of its folders.
    mount(root.parent, size=max(64 * 1024, int(moment * bench.size)))
    code = end(start(command(bench, root, *ALONE), log))
    mount(root.parent, size=8 * bench.size + 2**24, again=True)
    return code


def turn_read_only(bench: Bench, root: Path, log: Path, rng: random.Random, moment: float) -> int:
    mount(root.parent, size=8 * bench.size + 2**24)
    run = start(command(bench, root, *ALONE), log)
    wait_until(time.monotonic() + moment * bench.seconds, run)
    while run.poll() is None:
        with suppress(OSError):  # a file is still open for writing: try again
            mount(root.parent, read_only=True, again=True)
            break
    code = end(run)
    mount(root.parent, size=8 * bench.size + 2**24, again=True)
    return code


_DISTURB: dict[str, Callable[[Bench, Path, Path, random.Random, float], int]] = {
    "worker": kill_below,
    "client": kill_client,
    "dask-worker": lambda *a: kill_below(*a, "--scheduler", "dask"),
    "dask-scheduler": kill_scheduler,
    "hang": hang,
    "disk-full": fill_disk,
    "read-only": turn_read_only,
    "clock": clock,
}


def reason_against(kind: str) -> str:
    """The reason why a kind cannot be tested on this machine; empty if it can."""
    if kind in ("disk-full", "read-only"):
        with tempfile.TemporaryDirectory() as folder:
            try:
                mount(Path(folder), size=2**20)
            except OSError as error:
                return f"a tmpfs cannot be mounted ({error.strerror}); run it as root"
            subprocess.run(["umount", folder], check=True)
    if kind == "clock" and not _FAKETIME.exists():
        return f"{_FAKETIME} is missing (apt install faketime)"
    if kind.startswith("dask"):
        try:
            import distributed  # noqa: F401
        except ModuleNotFoundError:
            return "distributed is not installed (pip install 'avs3d-bench[cluster]')"
    return ""


# Trials


def again(bench: Bench, root: Path, log: Path, options: list[str]) -> int:
    """The same command again, with nothing in its way; its exit code."""
    return end(start(command(bench, root, *options), log))


def try_once(bench: Bench, kind: str, seed: int) -> Trial:
    """One trial: inject the fault, repeat the run until it succeeds, compare."""
    rng = random.Random(f"{kind} {seed}")
    moment = rng.uniform(0.0, 1.0)
    work = Path(tempfile.mkdtemp(prefix=f"{kind}-{seed}-", dir=bench.folder))
    disk = work / "disk"
    disk.mkdir()
    root, log = disk / "data", work / "log"
    try:
        if kind == "dask-client":
            with cluster(bench.folder, log) as (options, _):
                code = kill_client(bench, root, log, rng, moment, *options)
                return judged(bench, kind, seed, moment, root, log, code, options)
        code = _DISTURB[kind](bench, root, log, rng, moment)
        return judged(bench, kind, seed, moment, root, log, code, [])
    except Exception as error:  # a trial that fails itself must not count as a success
        return Trial(kind, seed, round(moment, 3), False, False, 0, f"{type(error).__name__}: {error}")
    finally:
        while os.path.ismount(disk):
            subprocess.run(["umount", "-l", disk], check=False, capture_output=True)
        shutil.rmtree(work, ignore_errors=True)


def judged(
    bench: Bench, kind: str, seed: int, moment: float, root: Path, log: Path, code: int, options: list[str]
) -> Trial:
    """Repeat the run until it succeeds, then compare the dataset with that of the undisturbed run."""
    healed, reruns = code == 0, 0
    said = log.read_text(errors="replace")
    verdict = partial(Trial, kind, seed, round(moment, 3), healed)
    if "Traceback" in said and kind not in ("dask-client", "dask-scheduler", "dask-worker"):
        # (Dask's own processes print tracebacks of lost connections into the same log.)
        return verdict(False, reruns, f"a traceback: {said[-400:]}")
    while code != 0 and reruns < RERUNS:
        code, reruns = again(bench, root, log, options), reruns + 1
    if code != 0:
        return verdict(False, reruns, f"still exit code {code}: {log.read_text(errors='replace')[-400:]}")
    found = tree_digest(root)
    if found != bench.truth:
        names = sorted(set(found) ^ set(bench.truth)) or [n for n in found if found[n] != bench.truth[n]]
        return verdict(False, reruns, f"{len(names)} files differ, e.g. {names[0]}")
    report = validate(root, deep=True, workers=1)
    if report.problems:
        return verdict(False, reruns, f"validate --deep: {report.problems[0]}")
    return verdict(True, reruns)


def prepare(folder: Path, names: Sequence[str] = ("first", "second"), **changes: object) -> Bench:
    """The manifest and an undisturbed run; its last repetition is timed, because the first one compiles.

    Args:
        folder: of the trials.
        names: of the repetitions.
        changes: of the manifest.
    """
    bench = Bench(write_manifest(folder, **changes), {}, 0.0, 0, folder)
    for name in names:
        root, log = folder / name / "data", folder / f"{name}.log"
        began = time.monotonic()
        if end(start(command(bench, root), log)) != 0:
            raise Avs3dError(f"an undisturbed run failed: {log.read_text(errors='replace')[-600:]}")
        seconds = time.monotonic() - began
    size = sum(-(-path.stat().st_size // 4096) * 4096 for path in root.rglob("*") if path.is_file())
    return Bench(bench.manifest, tree_digest(root), seconds, size, folder)


def _mark(trial: Trial) -> str:
    if not trial.recovered:
        return f"NOT RECOVERED: {trial.problem}"
    return "ok by itself" if trial.healed else f"ok after {trial.reruns} more run{'s' * (trial.reruns != 1)}"


def print_table(trials: list[Trial], skipped: dict[str, str]) -> None:
    """The table: kind, number of trials, number of recoveries."""
    click.echo(f"{'kind':<16}{'tried':>7}{'healed':>8}{'recovered':>11}")
    for kind in KINDS:
        mine = [trial for trial in trials if trial.kind == kind]
        if kind in skipped:
            click.echo(f"{kind:<16}  not tried: {skipped[kind]}")
        elif mine:
            healed, recovered = sum(t.healed for t in mine), sum(t.recovered for t in mine)
            click.echo(f"{kind:<16}{len(mine):>7}{healed:>8}{recovered:>11}")
    for trial in trials:
        if not trial.recovered:
            click.echo(f"NOT RECOVERED {trial.kind} seed {trial.seed} at {trial.moment:.3f}: {trial.problem}")


@click.command()
@click.option(
    "--moments", type=click.IntRange(1, 10_000), default=50, show_default=True, help="Number of trials of each kind."
)
@click.option("--kinds", default=",".join(KINDS), show_default=True, help="Comma-separated.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of the first trial.")
@click.option(
    "--jobs", type=click.IntRange(1, 256), default=1, show_default=True, help="Number of trials at the same time."
)
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write every trial to this file.")
def main(moments: int, kinds: str, seed: int, jobs: int, json_file: Path | None) -> None:
    """Inject faults of all kinds into `avs3d generate`, and check that it recovers. Exit status 1 if it did not."""
    wanted = kinds.split(",")
    if unknown := sorted(set(wanted) - set(KINDS)):
        raise UsageError(f"unknown kind {unknown[0]!r}: expected some of {','.join(KINDS)}")
    os.environ["OMP_NUM_THREADS"] = "1"
    skipped = {kind: why for kind in wanted if (why := reason_against(kind))}
    with tempfile.TemporaryDirectory(prefix="avs3d-faults-") as folder:
        bench = prepare(Path(folder))
        click.echo(f"an undisturbed run: {bench.seconds:.1f} s, {bench.size / 1e6:.1f} MB", err=True)
        jobs_of = [(kind, seed + k) for kind in wanted if kind not in skipped for k in range(moments)]
        with ThreadPoolExecutor(jobs) as pool:
            trials = []
            for trial in pool.map(lambda job: try_once(bench, *job), jobs_of):
                trials.append(trial)
                click.echo(f"{trial.kind} {trial.seed} at {trial.moment:.3f}: {_mark(trial)}", err=True)
    print_table(trials, skipped)
    if json_file is not None:
        write_json(json_file, {"trials": [asdict(trial) for trial in trials], "skipped": skipped})
    if not all(trial.recovered for trial in trials):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
