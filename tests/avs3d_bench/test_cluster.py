"""`--scheduler dask` from end to end: the same bytes as on one machine, even if processes die; and job queues."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.scheduling import dask_backend, jobqueue
from avs3d_bench.scheduling.dask_backend import DaskScheduler
from avs3d_bench.scheduling.failures import read_failures
from avs3d_bench.scheduling.tasks import Event, Policy, Success, Task
from avs3d_bench.validate import validate
from tests.support import scheduling_tasks as work
from tests.support.homes import tree_digest, write_manifest
from tests.support.needs import need
from tests.support.once import made_once

need("distributed", reason="distributed is not installed; it is in the cluster extra")

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-m", "avs3d_bench", "generate"]
DASK = ["--scheduler", "dask", "--workers", "2"]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_manifest(tmp_path_factory.mktemp("manifest"))


def call(manifest: Path, root: Path, *more: object) -> tuple[int, str]:
    args = [manifest, "-o", root, "--audio", "analytic", *more]
    done = subprocess.run([*COMMAND, *map(str, args)], capture_output=True, text=True, check=False, timeout=120)
    return done.returncode, done.stdout + done.stderr


@pytest.fixture(scope="module")
def plain(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The tree as the local scheduler makes it."""

    def make() -> dict[str, str]:
        root = tmp_path_factory.mktemp("plain") / "data"
        code, output = call(manifest, root, "--workers", "2")
        assert code == 0, output
        return tree_digest(root)

    return made_once("cluster-plain", make)


def waited(what: Any, seconds: float = 240.0) -> Any:
    """The first true answer of ``what()``."""
    deadline = time.monotonic() + seconds
    while not (found := what()):
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.02)
    return found


SCHEDULER = ["-m", "distributed.cli.dask_scheduler"]
WORKER = ["-m", "distributed.cli.dask_worker"]
#: On a machine where this project is not installed.
BARE_SCHEDULER, BARE_WORKER = (
    ["-c", f"import sys; sys.modules['avs3d_bench'] = None; from {program[1]} import main; main()"]
    for program in (SCHEDULER, WORKER)
)


@contextmanager
def cluster_of(folder: Path, *workers: list[str], scheduler: list[str] = SCHEDULER) -> Iterator[str]:
    """The address of a scheduler and workers that somebody else has started."""
    file = folder / "scheduler.json"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    programs = [
        [sys.executable, *scheduler, "--port", "0", "--host", "127.0.0.1", "--no-dashboard"],
        *([sys.executable, *worker, "--nthreads", "1", "--no-dashboard"] for worker in workers),
    ]
    log = (folder / "log").open("w")
    running = [
        subprocess.Popen(
            [*program, "--scheduler-file", file],
            stdout=log,
            stderr=log,
            env=environment,
            cwd=folder,
            start_new_session=True,
        )
        for program in programs
    ]
    try:
        waited(file.exists)
        yield waited(lambda: json.loads(file.read_text() or "{}").get("address"))
    finally:
        for program in reversed(running):
            program.terminate()
        for program in running:
            with suppress(subprocess.TimeoutExpired):  # Dask's nannies may wait long for a scheduler that is gone
                program.wait(timeout=10)
            with suppress(ProcessLookupError):
                os.killpg(program.pid, signal.SIGKILL)
            program.wait()
        log.close()


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Of a cluster with two workers."""
    with cluster_of(tmp_path_factory.mktemp("cluster"), WORKER, WORKER) as found:
        yield found


def parent_of(process: int) -> int:
    return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])


def test_two_dask_workers_write_the_same_bytes_and_a_rerun_keeps_them(
    manifest: Path, plain: dict[str, str], tmp_path: Path
) -> None:
    root = tmp_path / "data"
    code, output = call(manifest, root, *DASK)
    assert code == 0, output
    assert "2 made, 0 kept, 0 failed" in output
    assert "dashboard" in output
    assert tree_digest(root) == plain
    code, output = call(manifest, root, *DASK)
    assert "0 made, 2 kept" in output
    assert "dashboard" not in output  # nothing to do: nothing is started


def test_a_worker_killed_in_the_middle_is_made_up_for(manifest: Path, plain: dict[str, str], tmp_path: Path) -> None:
    root = tmp_path / "data"
    run = subprocess.Popen(
        [*COMMAND, manifest, "-o", root, "--audio", "analytic", *DASK],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    picture = waited(lambda: next(root.glob("part_*/*/*/.*.partial/input/frame_002.png"), None))
    child = int(picture.parents[1].name.split("-")[-2])  # the partial folder is named after the process that writes it
    os.kill(parent_of(child), signal.SIGKILL)
    output = run.communicate(timeout=120)[0]
    assert run.returncode == 0, output
    assert "is lost" in output
    assert tree_digest(root) == plain


def hearing() -> None:
    """A shell's background jobs, and all that they start, ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_ctrl_c_stops_the_cluster_and_leaves_nothing_half_written(
    manifest: Path, plain: dict[str, str], tmp_path: Path
) -> None:
    root = tmp_path / "data"
    run = subprocess.Popen(
        [*COMMAND, manifest, "-o", root, "--audio", "analytic", *DASK],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        preexec_fn=hearing,
    )
    waited(lambda: next(root.glob("part_*/*/*/.*.partial/input/frame_001.png"), None))
    os.killpg(run.pid, signal.SIGINT)
    output = run.communicate(timeout=60)[0]
    assert run.returncode == 130, output
    assert "Traceback" not in output
    assert not list(root.rglob(".*"))


def test_ctrl_c_while_the_cluster_starts_is_heard_once_it_has(manifest: Path, tmp_path: Path) -> None:
    run = subprocess.Popen(
        [*COMMAND, manifest, "-o", tmp_path / "data", "--audio", "analytic", *DASK],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
    threads = Path(f"/proc/{run.pid}/task")

    def starting() -> bool:
        """A Dask worker is being started: it is a child of the thread that Dask works in."""
        return any((thread / "children").read_text() for thread in threads.iterdir() if thread / "children" != children)

    waited(starting)
    os.killpg(run.pid, signal.SIGINT)
    output = run.communicate(timeout=60)[0]
    assert run.returncode == 130, output
    assert output.strip() == "avs3d: error: interrupted"
    assert list((tmp_path / "data").iterdir()) == []


def test_a_cluster_that_runs_is_joined_and_left_as_it_was(
    address: str, manifest: Path, plain: dict[str, str], tmp_path: Path
) -> None:
    root = tmp_path / "data"
    code, output = call(manifest, root, "--scheduler", "dask", "--scheduler-address", address)
    assert code == 0, output
    assert tree_digest(root) == plain
    # Killed, not asked: its workers stop by themselves, and the next run finds the folder free.
    other = tmp_path / "other"
    run = subprocess.Popen(
        [*COMMAND, manifest, "-o", other, "--audio", "analytic", "--scheduler", "dask", "--scheduler-address", address],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    waited(lambda: next(other.glob("part_*/*/*/.*.partial/input/frame_000.png"), None))
    run.kill()
    run.wait()
    code, output = call(manifest, other, "--scheduler", "dask", "--scheduler-address", address)
    assert code == 0, output
    assert tree_digest(other) == plain


def tasks_on(address: str, tasks: list[Task], retries: int = 1) -> tuple[dict[str, Any], list[Event]]:
    events: list[Event] = []
    with DaskScheduler(1, address=address) as cluster:
        results = {r.task.name: r for r in cluster.run(tasks, Policy(retries=retries), events.append)}
    return results, events


def test_crashes_and_hangs_are_tried_again_on_the_other_worker(address: str, tmp_path: Path) -> None:
    tasks = [
        Task("crash", work.die, (signal.SIGKILL, tmp_path / "crash", 1)),
        Task("hang", work.hang, (tmp_path / "hang", 1), limit=6.0),
        Task("bug", work.bug, (tmp_path / "bug",)),
        Task("refused", work.refuse, (tmp_path / "refused",)),
        Task("home", work.double, (1,)),
        Task("room", work.double, (2,), after="home"),
    ]
    results, events = tasks_on(address, tasks)
    assert {name for name, r in results.items() if isinstance(r, Success)} == {"crash", "hang", "home", "room"}
    assert [len(results[name].attempts) for name in ("bug", "refused")] == [2, 1]
    first, second = (attempt.worker.partition(" ")[0] for attempt in results["bug"].attempts)
    assert first.startswith("tcp://")
    assert first != second
    assert "a thing that cannot be" in results["bug"].attempts[0].traceback
    assert {event.name for event in events if event.kind == "retry"} == {"crash", "hang", "bug"}
    assert {(event.name, event.text) for event in events if event.kind == "half"} == {("home", "1"), ("room", "2")}


def test_what_is_closed_stops_on_the_workers(address: str, tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    with DaskScheduler(1, address=address) as cluster:
        run = cluster.run(
            [Task("quick", work.double, (1,)), Task("long", work.wait, (600, marks))], Policy(), lambda _: None
        )
        next(run)
        waited(lambda: marks.is_dir() and list(marks.iterdir()))
        run.close()
        (pid,) = (int(path.name.partition("-")[0]) for path in marks.iterdir())
        assert not Path(f"/proc/{pid}").exists()


def test_a_worker_that_does_not_answer_cannot_hold_up_the_end(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_backend, "_STOP", 1.5)
    marks = tmp_path / "marks"
    with DaskScheduler(1, address=address) as cluster:
        run = cluster.run(
            [Task("quick", work.double, (1,)), Task("long", work.wait, (600, marks))], Policy(), lambda _: None
        )
        next(run)
        (mark,) = waited(lambda: marks.is_dir() and list(marks.iterdir()))
        worker = parent_of(int(mark.name.partition("-")[0]))
        os.kill(worker, signal.SIGSTOP)
        try:
            start = time.monotonic()
            run.close()
            assert time.monotonic() - start < 5
        finally:
            os.kill(worker, signal.SIGCONT)


def test_a_result_that_is_lost_with_its_worker_is_made_again(tmp_path: Path) -> None:
    tasks = [Task(name, work.wait, (seconds, tmp_path / name)) for name, seconds in (("a", 0.1), ("b", 1.0))]
    with (
        cluster_of(tmp_path, [*WORKER, "--no-nanny"], [*WORKER, "--no-nanny"]) as address,
        DaskScheduler(1, address=address) as cluster,
    ):
        waited(lambda: len(cluster._client.nthreads()) == 2)
        run = cluster.run(tasks, Policy(), lambda _: None)
        assert next(run).task.name == "a"
        (mark,) = waited(lambda: (tmp_path / "b").is_dir() and list((tmp_path / "b").iterdir()))
        worker = parent_of(int(mark.name.partition("-")[0]))
        time.sleep(1.3)  # it is done as well, and nobody has asked for its result
        os.kill(worker, signal.SIGKILL)
        time.sleep(0.5)
        assert [(type(r), r.task.name) for r in run] == [(Success, "b")]


def test_what_a_worker_without_the_package_cannot_do_is_done_by_another(tmp_path: Path) -> None:
    with cluster_of(tmp_path, WORKER, [*BARE_WORKER, "--no-nanny"]) as address:
        with DaskScheduler(1, address=address) as cluster:
            waited(lambda: len(cluster._client.nthreads()) == 2)
        results, events = tasks_on(address, [Task(str(n), work.double, (n,)) for n in range(8)], retries=0)
    assert all(isinstance(r, Success) for r in results.values()), results
    assert len([event for event in events if event.kind == "worker"]) == 1


def test_a_scheduler_without_the_package_is_one_line_not_one_for_each_task(tmp_path: Path) -> None:
    with (
        cluster_of(tmp_path, WORKER, scheduler=BARE_SCHEDULER) as address,
        pytest.raises(Avs3dError, match=r"install the same avs3d-bench\[cluster\] on the scheduler's machine"),
    ):
        tasks_on(address, [Task(str(n), work.double, (n,)) for n in range(8)])


def test_a_gpu_that_nobody_offers_is_one_line(address: str) -> None:
    with DaskScheduler(1, address=address, gpus=True) as cluster, pytest.raises(UsageError, match="GPU=1"):
        list(cluster.run([Task("a", work.nothing, ())], Policy(), lambda _: None))


@pytest.fixture
def silent() -> Iterator[str]:
    """An address that accepts connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"


@pytest.mark.parametrize("wrong", ["tcp://127.0.0.1:9", "nonsense", "http://127.0.0.1:9", "tls://127.0.0.1:9", ""])
def test_a_scheduler_that_is_not_there_is_one_line(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    refused = refusal_of(wrong, monkeypatch)
    assert f"--scheduler-address {wrong}: no Dask scheduler answers there" in refused
    assert "tcp://HOST:8786" in refused


def test_who_is_not_a_scheduler_is_one_line_too(silent: str, address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "no Dask scheduler answers there" in refusal_of(silent, monkeypatch)
    with DaskScheduler(1, address=address) as cluster:
        worker = next(iter(cluster._client.nthreads()))
    assert "this is a Dask worker, expected the scheduler" in refusal_of(worker, monkeypatch)


def refusal_of(address: str, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(dask_backend, "_CONNECT", 1.0)
    start = time.monotonic()
    with pytest.raises(Avs3dError) as refused, DaskScheduler(1, address=address):
        pass
    assert time.monotonic() - start < 4
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_failures_reach_the_terminal_and_the_file_and_go_when_mended(
    address: str, manifest: Path, plain: dict[str, str], tmp_path: Path
) -> None:
    root = tmp_path / "data"
    there = ["--scheduler", "dask", "--scheduler-address", address]
    code, output = call(manifest, root, *there, "--time-limit", "0.05", "--retries", "1")
    assert code == 1, output
    assert output.count("avs3d: error: part_") == 2
    lines = read_failures(root / "failures.jsonl")
    assert [len(line["attempts"]) for line in lines] == [2, 2]
    assert {(line["seed"], attempt["cause"]) for line in lines for attempt in line["attempts"]} == {(5, "hang")}
    code, output = call(manifest, root, *there, "--time-limit", "0.05", "--max-failures", "0", "--retries", "0")
    assert code == 1
    assert "stopped by --max-failures 0" in output
    code, output = call(manifest, root, *there)
    assert code == 0, output
    assert tree_digest(root) == plain
    assert validate(root).valid


# Job queues: what would be submitted, without a queue

SLURM = """
queue: long
account: my-project
cores: 16
processes: 16
memory: 64GB
walltime: "08:00:00"
job_extra_directives: ["--exclusive"]
worker_extra_args: ["--lifetime", "7h30m"]
"""


def test_the_job_of_a_slurm_cluster_is_what_the_file_says(tmp_path: Path) -> None:
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed; it is in the cluster extra")
    path = tmp_path / "slurm.yaml"
    path.write_text(SLURM)
    options = jobqueue.read_options(path) | {"scheduler_options": {"host": "127.0.0.1", "dashboard_address": ":0"}}
    cluster = jobqueue.make_cluster("slurm", options, path)
    try:
        script = cluster.job_script()
    finally:
        cluster.close()
    for line in ("#SBATCH -p long", "#SBATCH -A my-project", "#SBATCH -t 08:00:00", "#SBATCH --exclusive"):
        assert line in script
    assert "#SBATCH --cpus-per-task=16" in script
    assert "--nworkers 16" in script
    assert "--nthreads 1" in script
    assert "--lifetime 7h30m" in script


@pytest.mark.parametrize(
    ("kind", "text", "words"),
    [
        ("slurm", "cores: 4\nmemory: 8GB\nwaltime: 1h\n", ["'waltime'", "'walltime'", "SLURMCluster"]),
        ("pbs", "cores: 4\n", ["memory", "PBSCluster"]),
        ("slurm", "- cores\n", ["expected a mapping"]),
        ("slurm", "cores: [\n", ["not valid YAML"]),
        ("slurm", "cores: 1\nmemory: 1GB\nadapt: {maximum: 8}\n", ["unknown option 'adapt'", "expected one of"]),
        ("slurm", "cores: 1\nmemory: 1GB\nwalltime: 12:00:00\n", ["walltime", "in quotes", "43200"]),
    ],
)
def test_a_wrong_option_is_one_line(tmp_path: Path, kind: str, text: str, words: list[str]) -> None:
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed; it is in the cluster extra")
    path = tmp_path / "options.yaml"
    path.write_text(text)
    with pytest.raises(UsageError) as refused:
        jobqueue.start_cluster(kind, path, 4)
    assert str(path) in str(refused.value)
    assert all(word in str(refused.value) for word in words)
    assert "\n" not in str(refused.value)


def test_a_queue_that_refuses_or_is_not_here_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed; it is in the cluster extra")
    programs, path = tmp_path / "bin", tmp_path / "slurm.yaml"
    programs.mkdir()
    scheduler = 'scheduler_options: {host: 127.0.0.1, dashboard_address: ":0"}\n'
    path.write_text("cores: 1\nmemory: 1GB\n" + scheduler)
    monkeypatch.setenv("PATH", str(programs))
    with pytest.raises(Avs3dError, match="sbatch is not installed here; run the command where jobs can be submitted"):
        jobqueue.start_cluster("slurm", path, 4)
    (programs / "sbatch").write_text("#!/bin/sh\necho 'sbatch: error: invalid account' >&2\nexit 1\n")
    (programs / "sbatch").chmod(0o755)
    with pytest.raises(Avs3dError, match=r"--jobqueue slurm: .*invalid account") as refused:
        jobqueue.start_cluster("slurm", path, 4)
    assert "\n" not in str(refused.value)


#: A queue for one machine: a job is a process group, its number that of its leader.
QUEUE = {
    "sbatch": (
        'cp "$1" "$0.$$"; setsid sh "$0.$$" >"$0.$$.log" 2>&1 & echo Submitted batch job $!; echo $! >> "$0.jobs"'
    ),
    "squeue": 'for job in $(echo "$4" | tr , " "); do kill -0 "$job" 2>/dev/null && echo "$job"; done; true',
    "scancel": 'for job in "$@"; do kill -KILL "-$job" 2>/dev/null; done; true',
}


@pytest.fixture
def queue(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The file of the jobs that were submitted to a queue of our own, whose programs have Slurm's names."""
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed; it is in the cluster extra")
    programs = tmp_path / "queue"
    programs.mkdir()
    for name, script in QUEUE.items():
        (programs / name).write_text(f"#!/bin/sh\n{script}\n")
        (programs / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(programs), prepend=os.pathsep)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setattr(dask_backend, "_ASK", 0.5)
    jobs = programs / "sbatch.jobs"
    yield jobs
    for job in jobs.read_text().split() if jobs.exists() else []:
        subprocess.run([programs / "scancel", job], check=False)


def queue_options(folder: Path, *lines: str) -> Path:
    path = folder / "slurm.yaml"
    scheduler = 'scheduler_options: {host: 127.0.0.1, dashboard_address: ":0"}'
    path.write_text("\n".join(["cores: 2", "processes: 2", "memory: 2GB", "interface: lo", scheduler, *lines, ""]))
    return path


def test_a_job_that_the_queue_ends_is_submitted_again(queue: Path, tmp_path: Path) -> None:
    events = list[Event]()
    tasks = [Task(name, work.hang, (tmp_path / name, 1)) for name in "ab"]  # the first attempt of each never ends
    with DaskScheduler(2, jobqueue="slurm", jobqueue_options=queue_options(tmp_path)) as cluster:
        run = cluster.run(tasks, Policy(), events.append)

        def end_the_job() -> None:
            waited(lambda: all((tmp_path / name).is_dir() and list((tmp_path / name).iterdir()) for name in "ab"))
            subprocess.run(["scancel", queue.read_text().strip()], check=True)

        threading.Thread(target=end_the_job, daemon=True).start()
        assert [type(result) for result in run] == [Success, Success]
    assert len(queue.read_text().split()) == 2
    assert "1 job has ended before the work; submitted again" in [event.text for event in events]
    waited(
        lambda: subprocess.run(["squeue", "-", "-", "-", queue.read_text().strip()], capture_output=True).stdout == b""
    )


def test_jobs_that_never_bring_a_worker_end_the_run(queue: Path, tmp_path: Path) -> None:
    options = queue_options(tmp_path, 'job_script_prologue: ["exit 1"]')
    with (
        DaskScheduler(4, jobqueue="slurm", jobqueue_options=options) as cluster,
        pytest.raises(Avs3dError, match="its jobs have ended, and no worker is left; their logs"),
    ):
        list(cluster.run([Task("a", work.nothing, ())], Policy(), lambda _: None))
    assert len(queue.read_text().split()) == 2


@pytest.mark.parametrize(
    ("modules", "arguments", "words"),
    [
        (["distributed", "dask"], [], ["pip install 'avs3d-bench[cluster]'"]),
        (["dask_jobqueue"], ["--jobqueue", "slurm"], ["dask_jobqueue", "pip install 'avs3d-bench[cluster]'"]),
        (["dask_kubernetes"], ["--jobqueue", "kubernetes"], ["pip install dask-kubernetes"]),
    ],
)
def test_a_missing_package_is_one_line_with_the_way_out(
    manifest: Path, tmp_path: Path, modules: list[str], arguments: list[str], words: list[str]
) -> None:
    (tmp_path / "options.yaml").write_text("cores: 1\nmemory: 1GB\n")
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({modules!r}))\n"
        "from avs3d_bench.cli import main\n"
        "main(sys.argv[1:])"
    )
    options = [*arguments, "--jobqueue-options", tmp_path / "options.yaml"] if arguments else []
    args = ["generate", manifest, "-o", tmp_path / "data", "--audio", "analytic", "--scheduler", "dask", *options]
    done = subprocess.run([sys.executable, "-c", code, *map(str, args)], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    (line,) = (line for line in done.stderr.splitlines() if "error" in line)
    assert all(word in line for word in words), line
    assert not list((tmp_path / "data").rglob("*"))
