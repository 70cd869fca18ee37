"""Supervised processes, the local pool, a folder's lock, failures.jsonl: the run continues after faults of tasks."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.scheduling import supervised
from avs3d_bench.scheduling.failures import FailureLog, read_failures
from avs3d_bench.scheduling.ledger import Ledger, Next
from avs3d_bench.scheduling.local import LocalScheduler
from avs3d_bench.scheduling.lock import folder_lock, holder_of
from avs3d_bench.scheduling.options import Options
from avs3d_bench.scheduling.supervised import Done, Supervised
from avs3d_bench.scheduling.tasks import Attempt, Event, Failure, Policy, Success, Task
from avs3d_bench.validate import validate
from tests.support import scheduling_tasks as work
from tests.support.tiny import write_dataset

ROOT = Path(__file__).parents[2]


def quiet(*_: object) -> None:
    pass


@pytest.fixture
def child() -> Iterator[Supervised]:
    made = Supervised(name="worker 0")
    yield made
    made.kill()


def attempt(child: Supervised, call: Callable[..., Any], *arguments: object, limit: float | None = None) -> Any:
    return child.run(Task(call.__name__, call, arguments, limit=limit), quiet)


def gone(pid: int, within: float = 5.0) -> bool:
    """Whether a process ends; one that nobody has waited for yet counts as ended."""
    deadline = time.monotonic() + within
    while time.monotonic() < deadline:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state == "Z":
            return True
        time.sleep(0.02)
    return False


# A supervised process


def test_one_process_does_one_task_after_the_other_and_tells_what_happens(child: Supervised) -> None:
    events: list[tuple[str, str]] = []
    found = child.run(Task("a", work.double, (21,)), lambda kind, text: events.append((kind, text)))
    assert found == Done(42)
    assert events == [("half", "21")]
    assert attempt(child, work.pid) == attempt(child, work.pid) == Done(child.pid)


@pytest.mark.parametrize(
    ("call", "cause", "words"),
    [
        (work.refuse, "refused", ["no place for a washing machine"]),
        (work.unfit, "unfit", ["another version"]),
        (work.bug, "error", ["RuntimeError", "a thing that cannot be"]),
    ],
)
def test_an_exception_is_an_attempt_and_the_process_goes_on(
    child: Supervised, tmp_path: Path, call: Callable[..., Any], cause: str, words: list[str]
) -> None:
    found = attempt(child, call, tmp_path / "marks")
    assert found.cause == cause
    assert all(word in found.message for word in words)
    assert "\n" not in found.message
    assert ("cannot be" in found.traceback) == (cause == "error")
    assert child.pid is not None
    assert attempt(child, work.pid) == Done(child.pid)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MemoryError("Unable to allocate 8. GiB"), "out of memory (Unable to allocate 8. GiB); "),
        (MemoryError(), "out of memory; "),
        (ImportError("libtorch.so: failed to map segment"), "out of memory (libtorch.so: failed to map segment); "),
    ],
)
def test_a_lack_of_memory_says_what_to_do(child: Supervised, error: Exception, said: str) -> None:
    found = attempt(child, work.throw, error)
    cure = "free some, use fewer --workers, or raise the limit (ulimit -v unlimited)"
    assert (found.cause, found.message) == ("crash", said + cure)
    assert attempt(child, work.double, 1) == Done(2)


def test_a_result_that_cannot_be_sent_is_an_attempt_too(child: Supervised) -> None:
    assert attempt(child, work.lambda_back).cause == "error"
    assert attempt(child, work.double, 1) == Done(2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "words"),
    [(signal.SIGKILL, ["signal 9", "memory"]), (signal.SIGTERM, ["signal 15"]), (signal.SIGABRT, ["signal 6"])],
)
def test_a_process_that_is_killed_is_named_by_its_signal_and_replaced(
    child: Supervised, tmp_path: Path, number: int, words: list[str]
) -> None:
    found = attempt(child, work.die, number, tmp_path / "marks")
    assert found.cause == "crash"
    assert all(word in found.message for word in words)
    assert attempt(child, work.double, 1) == Done(2)


def test_a_crash_in_a_library_leaves_its_stack(child: Supervised) -> None:
    found = attempt(child, work.segfault)
    assert (found.cause, "signal 11" in found.message) == ("crash", True)
    assert "in segfault" in found.traceback
    assert "exit code 7" in attempt(child, work.leave, 7).message


@pytest.mark.slow
def test_a_hang_ends_at_the_limit_and_says_where_it_hung(child: Supervised, tmp_path: Path) -> None:
    attempt(child, work.pid)
    hung, start = child.pid, time.monotonic()
    assert hung is not None
    found = attempt(child, work.hang, tmp_path / "marks", limit=1.0)
    assert found.cause == "hang"
    assert 1.0 <= time.monotonic() - start < 20
    assert "1 s" in found.message
    assert "_never_return" in found.traceback
    assert gone(hung)
    assert attempt(child, work.double, 1) == Done(2)


@pytest.mark.slow
def test_a_process_that_stops_in_the_middle_of_a_message_is_given_up(
    child: Supervised, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervised, "_STALL", 1)
    start = time.monotonic()
    found = attempt(child, work.half_a_message)
    assert time.monotonic() - start < 20
    assert (found.cause, "middle of a message" in found.message) == ("crash", True)
    assert attempt(child, work.double, 1) == Done(2)


def test_cores_are_lent_again_only_when_their_number_changes(
    child: Supervised, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[int] = []
    write = os.pwrite

    def count(file: int, data: bytes, at: int) -> int:
        written.append(int.from_bytes(data, "little"))
        return write(file, data, at)

    monkeypatch.setattr(supervised.os, "pwrite", count)
    assert attempt(child, work.environment, "HOME")
    for cores in (1, 2, 2, 3, 3, 1):
        child.lend(cores)
    assert written == [2, 3, 1]
    child.lend(2)
    child.kill()
    assert attempt(child, work.environment, "HOME")
    child.lend(2)  # the new process knows 1
    assert written == [2, 3, 1, 2, 2]


def test_a_message_of_many_lines_becomes_one(child: Supervised) -> None:
    assert "first second" in attempt(child, work.verbose).message


def test_ctrl_c_is_the_parents_business(child: Supervised) -> None:
    assert attempt(child, work.interrupted) == Done("went on")


def test_what_is_no_longer_wanted_is_killed(child: Supervised, tmp_path: Path) -> None:
    attempt(child, work.pid)
    stopped = child.pid
    assert stopped is not None
    task = Task("a", work.hang, (tmp_path / "marks",))
    assert child.run(task, quiet, wanted=lambda: False) is None
    assert gone(stopped)


def test_an_idle_process_that_ended_is_replaced_without_a_word(child: Supervised) -> None:
    attempt(child, work.pid)
    first = child.pid
    assert first is not None
    child.connection.close()  # what it sees when nobody gives it work for long enough is the same: it ends by itself
    assert gone(first)
    assert attempt(child, work.double, 1) == Done(2)
    assert child.pid != first


PARENT = """
import sys, time
from pathlib import Path
from avs3d_bench.scheduling.supervised import Supervised
from avs3d_bench.scheduling.tasks import Task
from avs3d_bench.validate import validate
from tests.support import scheduling_tasks as work
from tests.support.tiny import write_dataset
child = Supervised()
child.start(Task("a", getattr(work, sys.argv[1]), (Path(sys.argv[2]),)))
print(child.pid, flush=True)
time.sleep(60)
"""


def test_the_process_dies_with_its_parent_even_while_it_hangs(tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    parent = subprocess.Popen([sys.executable, "-c", PARENT, "hang", marks], stdout=subprocess.PIPE, cwd=ROOT)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    while not marks.is_dir() or not list(marks.iterdir()):
        assert parent.poll() is None
        time.sleep(0.01)
    parent.kill()
    assert gone(child, within=2.0)
    parent.communicate()


# The book of a run


def book(count: int, followers: int, *, retries: int = 1, ahead: int = 4) -> tuple[Ledger, list[Task]]:
    tasks = []
    for home in range(count):
        tasks.append(Task(f"home {home}", work.nothing, ()))
        tasks += [Task(f"{home}/{k}", work.nothing, (), after=f"home {home}") for k in range(followers)]
    return Ledger(tasks, retries=retries, ahead=ahead), tasks


@settings(max_examples=60)
@given(st.data())
def test_every_task_ends_exactly_once_and_none_before_what_it_follows(data: st.DataObject) -> None:
    retries = data.draw(st.integers(0, 2))
    ledger, tasks = book(data.draw(st.integers(1, 4)), data.draw(st.integers(1, 4)), retries=retries)
    busy: list[Next] = []
    ended: dict[str, str] = {}
    while not ledger.finished:
        item = ledger.take() if data.draw(st.booleans()) or not busy else None
        if item is not None:
            assert item.task.after is None or ended[item.task.after] == "done"
            busy.append(item)
            continue
        item = busy.pop(data.draw(st.integers(0, len(busy) - 1)))
        cause = data.draw(st.sampled_from(["done", "refused", "crash"]))
        if cause == "done":
            ledger.done(item.task)
            results = [item.task.name]
        else:
            given_up = list(ledger.failed(item, Attempt("w", cause, "no")))  # type: ignore[arg-type]
            assert bool(given_up) == (cause == "refused" or len(item.failed) == retries)
            results = [failure.task.name for failure in given_up]
        for name in results:
            assert name not in ended
            ended[name] = cause
    assert ended.keys() == {task.name for task in tasks}


def test_homes_come_first_but_no_more_of_them_than_keep_everyone_busy() -> None:
    ledger, _ = book(5, 3, ahead=4)
    order = []
    while item := ledger.take():
        order.append(item.task.name)
        ledger.done(item.task)
    assert order[:2] == ["home 0", "home 1"]
    assert order.index("home 4") > order.index("0/2")
    assert ledger.finished


def test_waiting_for_what_is_no_task_is_a_mistake() -> None:
    with pytest.raises(ValueError, match="home 7"):
        Ledger([Task("a", work.nothing, (), after="home 7")], retries=0, ahead=1)


def test_a_chain_is_handed_out_link_by_link() -> None:
    first, second = Task("first", work.nothing, (), after="home"), Task("second", work.nothing, (), after="first")
    home, other = Task("home", work.nothing, ()), Task("other", work.nothing, (), after="home")
    ledger = Ledger([second, other, first, home], retries=0, ahead=4)
    order = []
    while (item := ledger.take()) is not None:
        order.append(item.task.name)
        ledger.done(item.task)
    # What others wait for comes before what nobody waits for.
    assert order == ["home", "first", "other", "second"]
    assert ledger.finished


def test_all_that_follows_a_failed_task_fails_untried() -> None:
    chain = [Task("home", work.nothing, ()), *(Task(str(n), work.nothing, (), after=str(n - 1)) for n in range(1, 4))]
    chain[1] = Task("1", work.nothing, (), after="home")
    ledger = Ledger(chain, retries=0, ahead=4)
    item = ledger.take()
    assert item is not None
    failures = list(ledger.failed(item, Attempt("here", "refused", "no")))
    assert [failure.task.name for failure in failures] == ["home", "1", "2", "3"]
    assert (ledger.left, ledger.unstarted) == (0, 0)


def test_what_comes_after_any_end_is_tried_after_a_failure_but_not_after_a_task_that_was_not_tried() -> None:
    first = Task("first", work.nothing, (), after="home")
    sibling = Task("sibling", work.nothing, (), after="first", after_any=True)
    tasks = [Task("home", work.nothing, ()), first, sibling]
    refused = Attempt("here", "refused", "no")

    ledger = Ledger(tasks, retries=0, ahead=4)
    home = ledger.take()
    assert home is not None
    ledger.done(home.task)
    tried = ledger.take()
    assert tried is not None
    assert [failure.task.name for failure in ledger.failed(tried, refused)] == ["first"]
    assert ledger.take() == Next(sibling)
    ledger.done(sibling)
    assert ledger.finished

    ledger = Ledger(tasks, retries=0, ahead=4)
    home = ledger.take()
    assert home is not None
    assert [failure.task.name for failure in ledger.failed(home, refused)] == ["home", "first", "sibling"]
    assert ledger.finished


def test_tasks_that_wait_for_one_another_are_a_mistake() -> None:
    with pytest.raises(ValueError, match="one another"):
        Ledger([Task("a", work.nothing, (), after="b"), Task("b", work.nothing, (), after="a")], retries=0, ahead=1)


def test_a_group_is_left_to_its_process_while_there_is_other_work() -> None:
    tasks = [Task("first", work.nothing, (), group="g"), Task("x", work.nothing, ()), Task("y", work.nothing, ())]
    tasks += [Task(f"sibling {n}", work.nothing, (), after="first", group="g") for n in (1, 2)]
    ledger = Ledger(tasks, retries=0, ahead=4)
    assert ledger.take() == Next(tasks[0])
    ledger.done(tasks[0])
    taken = [ledger.take({"g"}), *(ledger.take((), {"g"}) for _ in range(4))]
    assert [item and item.task.name for item in taken] == ["sibling 1", "x", "y", "sibling 2", None]


def test_homes_are_built_ahead_although_siblings_wait_for_busy_processes() -> None:
    siblings = [Task(f"sibling {n}", work.nothing, (), group="g") for n in range(9)]
    ledger = Ledger([*siblings, *book(1, 1)[1]], retries=0, ahead=4)
    assert ledger.take((), {"g"}) == Next(Task("home 0", work.nothing, ()))


# The local pool


def test_what_waited_for_a_task_of_its_group_goes_on_in_the_same_process() -> None:
    tasks = [Task(name, work.pid, (), group=name) for name in "ab"]
    tasks += [Task(f"{name} next", work.pid, (), after=name, group=name) for name in "ab"]
    with LocalScheduler(2) as pool:
        pids = {one.task.name: one.value for one in pool.run(tasks, Policy(), quiet) if isinstance(one, Success)}
    assert pids["a"] == pids["a next"] != pids["b"] == pids["b next"]


def run(tasks: list[Task], workers: int = 2, retries: int = 1, **policy: Any) -> tuple[dict[str, Any], list[Event]]:
    events: list[Event] = []
    with LocalScheduler(workers) as pool:
        results = {r.task.name: r for r in pool.run(tasks, Policy(retries=retries, **policy), events.append)}
    assert len(results) == len(tasks)
    return results, events


def test_the_pool_runs_everything_on_as_many_processes_as_asked() -> None:
    results, _ = run([Task(str(n), work.place, ()) for n in range(6)])
    assert len({r.value for r in results.values()}) == 2
    assert {r.value[0] for r in results.values()} == {0, 1}


def test_workers_share_the_gpus() -> None:
    results, _ = run([Task(str(n), work.gpu, ()) for n in range(6)], workers=3, gpus=("4", "GPU-a"))
    assert {result.value for result in results.values()} == {(0, "4"), (1, "GPU-a"), (2, "4")}


@pytest.mark.slow
def test_what_crashed_or_hung_once_is_done_on_another_worker(tmp_path: Path) -> None:
    tasks = [
        Task("crash", work.die, (signal.SIGKILL, tmp_path / "crash", 1)),
        Task("hang", work.hang, (tmp_path / "hang", 1), limit=6.0),
        *(Task(str(n), work.double, (n,)) for n in range(6)),
    ]
    results, events = run(tasks)
    assert all(isinstance(r, Success) for r in results.values())
    assert sorted(event.name for event in events if event.kind == "retry") == ["crash", "hang"]
    pids = {path.name.split("-")[0] for path in (tmp_path / "crash").iterdir()}
    assert len(pids) == 2


@pytest.mark.slow
def test_what_fails_again_is_given_up_with_every_attempt_and_a_refusal_at_once(tmp_path: Path) -> None:
    tasks = [
        Task("bug", work.bug, (tmp_path / "bug",)),
        Task("refused", work.refuse, (tmp_path / "refused",)),
        Task("unfit", work.unfit, (tmp_path / "unfit",)),
        Task("good", work.double, (1,)),
    ]
    results, _ = run(tasks, retries=2)
    assert results["good"] == Success(tasks[3], 2)
    assert [len(results[name].attempts) for name in ("bug", "refused", "unfit")] == [3, 1, 3]
    assert [len(list((tmp_path / name).iterdir())) for name in ("bug", "refused", "unfit")] == [3, 1, 3]
    assert len({attempt.worker for attempt in results["bug"].attempts}) == 3


def test_what_waits_for_a_failed_task_fails_untried_with_its_message(tmp_path: Path) -> None:
    tasks = [
        Task("home", work.refuse, (tmp_path / "marks",)),
        Task("a", work.wait, (0, tmp_path / "never"), after="home"),
        Task("b", work.wait, (0, tmp_path / "never"), after="home"),
    ]
    results, _ = run(tasks)
    assert {type(r) for r in results.values()} == {Failure}
    assert results["a"].message == results["b"].message == "no place for a washing machine"
    assert not (tmp_path / "never").exists()


def test_closing_the_run_ends_what_is_in_flight(tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    tasks = [Task(str(n), work.wait, (60, marks)) for n in range(2)]
    with LocalScheduler(3) as pool:
        results = pool.run([*tasks, Task("quick", work.double, (1,))], Policy(), quiet)
        assert next(results).task.name == "quick"
        while not marks.is_dir() or len(list(marks.iterdir())) < 2:
            time.sleep(0.02)
        results.close()
    pids = [int(path.name.partition("-")[0]) for path in marks.iterdir()]
    assert all(gone(pid) for pid in pids)


def test_workers_get_the_environment_of_the_run() -> None:
    results, _ = run([Task("a", work.environment, ("OMP_NUM_THREADS",))], environment=(("OMP_NUM_THREADS", "7"),))
    assert results["a"].value == "7"


# Who holds a folder


def test_a_lock_says_who_holds_the_folder_and_leaves_nothing(tmp_path: Path) -> None:
    root = tmp_path / "new" / "data"
    with folder_lock(root) as me:
        assert holder_of(root) == me
        assert me.pid == os.getpid()
        with pytest.raises(Avs3dError) as refused, folder_lock(root):
            pass
        for word in ("another avs3d generate is at work in this folder since", me.host, str(me.pid), me.user):
            assert word in str(refused.value)
    assert list(root.iterdir()) == []
    with folder_lock(root):
        pass


def test_the_file_of_a_killed_process_is_taken_over(tmp_path: Path) -> None:
    code = (
        "import os, signal, sys; from pathlib import Path; from avs3d_bench.scheduling.lock import folder_lock\n"
        "with folder_lock(Path(sys.argv[1])): os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", code, tmp_path], check=False)
    left = holder_of(tmp_path)
    assert left is not None
    with folder_lock(tmp_path) as me:
        assert me.pid != left.pid
    assert list(tmp_path.iterdir()) == []


def test_the_file_of_another_user_is_named_though_it_cannot_be_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    really_open = os.open

    def refuse(path: Path, flags: int, *mode: int) -> int:
        if flags & os.O_RDWR:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return really_open(path, flags, *mode)

    with folder_lock(tmp_path) as other:
        monkeypatch.setattr(os, "open", refuse)
        with pytest.raises(Avs3dError, match=f"Permission denied.*user {other.user}"), folder_lock(tmp_path):
            pass
        monkeypatch.undo()


def test_other_machines_can_read_who_holds_it_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # NFS sends what is written to the server when the file is closed, or with fsync.
    sent: list[Path] = []
    monkeypatch.setattr(os, "fsync", lambda handle: sent.append(Path(os.readlink(f"/proc/self/fd/{handle}"))))
    with folder_lock(tmp_path):
        assert sent == [tmp_path / ".avs3d-lock"]


@pytest.mark.slow
def test_of_many_who_come_at_once_one_at_a_time_holds_it(tmp_path: Path) -> None:
    code = (
        "import os, sys, time; from pathlib import Path\n"
        "from avs3d_bench.scheduling.lock import folder_lock; from avs3d_bench.errors import Avs3dError\n"
        "root, got = Path(sys.argv[1]), 0\n"
        "end = time.monotonic() + 3\n"
        "while time.monotonic() < end:\n"
        "    try:\n"
        "        with folder_lock(root):\n"
        "            os.close(os.open(root / 'mine', os.O_CREAT | os.O_EXCL)); got += 1\n"
        "            os.unlink(root / 'mine')\n"
        "    except Avs3dError: pass\n"
        "print(got)"
    )
    many = [
        subprocess.Popen([sys.executable, "-c", code, tmp_path], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        for _ in range(4)
    ]
    said = [process.communicate()[0].decode() for process in many]
    assert all(text.strip().isdigit() for text in said), said
    assert sum(map(int, said)) > 10
    assert list(tmp_path.iterdir()) == []


def test_without_locks_in_the_file_system_the_file_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import fcntl

    def none(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", none)
    with folder_lock(tmp_path) as me, pytest.raises(Avs3dError, match="another avs3d generate"), folder_lock(tmp_path):
        pass
    lock = tmp_path / ".avs3d-lock"
    lock.write_text(json.dumps(vars(me) | {"host": "elsewhere"}))
    with pytest.raises(Avs3dError, match="host elsewhere"), folder_lock(tmp_path):
        pass
    ended = subprocess.Popen(["true"])
    ended.wait()
    lock.write_text(json.dumps(vars(me) | {"pid": ended.pid}))
    with folder_lock(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


# failures.jsonl


def test_failures_are_told_at_once_and_forgotten_when_mended(tmp_path: Path) -> None:
    log = FailureLog(tmp_path, {"a": 1, "b": 2})
    log.tidy(())
    assert list(tmp_path.iterdir()) == []
    log.add("b", [Attempt("w0", "crash", "died"), Attempt("w1", "error", "no", "Traceback …")])
    log.add("a", [Attempt("w0", "refused", "no place")])
    path = tmp_path / "failures.jsonl"
    with path.open("a") as stream:
        stream.write('{"key": "a", "se')  # a kill in the middle of a line
    assert [line["key"] for line in read_failures(path)] == ["b", "a"]
    log.tidy({"a"})
    (line,) = read_failures(path)
    assert (line["key"], line["seed"]) == ("b", 2)
    assert [(a["worker"], a["cause"], a["message"]) for a in line["attempts"]] == [
        ("w0", "crash", "died"),
        ("w1", "error", "no"),
    ]
    log.add("b", [Attempt("w2", "hang", "again")])
    log.tidy(())
    (line,) = read_failures(path)
    assert line["attempts"][0]["message"] == "again"
    log.tidy({"a", "b"})
    assert list(tmp_path.iterdir()) == []


def test_validate_minds_neither_the_lock_of_a_run_nor_its_failures(tmp_path: Path) -> None:
    root = tmp_path / "data"
    write_dataset(root)
    before = validate(root).as_dict()
    with folder_lock(root):
        FailureLog(root, {"a": 1}).add("a", [Attempt("w0", "crash", "died")])
        assert sorted(path.name for path in root.iterdir())[:1] == [".avs3d-lock"]
        assert validate(root).as_dict() == before


# The options


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"address": "tcp://a:1"}, ["--scheduler-address", "--scheduler dask"]),
        ({"jobqueue": "slurm"}, ["--jobqueue", "--scheduler dask"]),
        ({"scheduler": "dask", "address": "tcp://a:1", "jobqueue": "slurm"}, ["--scheduler-address", "--jobqueue"]),
        ({"scheduler": "dask", "jobqueue": "pbs"}, ["--jobqueue-options"]),
        ({"time_limit": float("nan")}, ["--time-limit nan", "0 for no limit"]),
        ({"time_limit": float("inf")}, ["--time-limit inf", "0 for no limit"]),
        ({"scheduler": "dask", "jobqueue_options": Path("x.yaml")}, ["--jobqueue slurm|pbs|kubernetes"]),
    ],
)
def test_options_that_contradict_each_other_are_one_line(options: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(UsageError) as refused:
        Options(**options)
    assert all(word in str(refused.value) for word in words)
    assert "\n" not in str(refused.value)


def test_the_environment_of_workers_is_what_configures_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AVS3D_SCANS", "/scans")
    monkeypatch.setenv("SECRET_TOKEN", "x")
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    environment = dict(Options().policy(one_thread=True).environment)
    assert environment["AVS3D_SCANS"] == "/scans"
    assert environment["OMP_NUM_THREADS"] == "1"
    assert "SECRET_TOKEN" not in environment
    assert (Options().limit(5), Options(time_limit=0).limit(5), Options(time_limit=2).limit(5)) == (5, None, 2)
