"""An observation that renders several frames at the same time: the same bytes, and no threads left afterwards."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Generator, Iterator
from dataclasses import replace
from itertools import chain, repeat
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from avs3d_bench.runtime.ahead import continue_in_fork
from avs3d_bench.scheduling.local import LocalScheduler, divide
from avs3d_bench.scheduling.tasks import Context, Policy, Task
from generators.acoustics.receivers import choose_receivers
from generators.core.scene import Scene
from generators.observation import hearing
from generators.observation.generate import generate_observation
from generators.observation.writer import ObservationWriter
from generators.options import EngineOptions, GenerateOptions
from generators.plan import make_plans, read_manifest
from generators.run import worker as work
from generators.scenes.renderer import MOST_THREADS, Renderer
from generators.vision.base import RenderedView
from generators.vision.embree import EmbreeBackend, EmbreeSession
from tests.support.homes import write_manifest
from tests.support.scheduling_tasks import cores_seen, load_and_end, pid_after


def _files(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


@pytest.mark.slow
@pytest.mark.parametrize("audio", ["analytic", "soundspaces"])
def test_threads_change_no_byte(tmp_path: Path, audio: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if audio == "soundspaces":
        pytest.importorskip("rlr_audio_propagation", reason="the SoundSpaces engine is not installed")
    plan = make_plans(
        read_manifest(write_manifest(tmp_path)), GenerateOptions(only=["part_2/*"], frames=8, size=96, audio=audio,
        extras=("depth", "rirs")))[0]  # fmt: skip
    constant = {str(n): repeat(n) for n in (1, 32)}
    changing = {"growing": chain([1, 1, 1, 2, 2], repeat(32)), "shrinking": chain([1, 4, 4], repeat(1))}
    for name, cores in (constant | changing).items():
        seen: list[int] = []
        generate_observation(plan, tmp_path / name, tmp_path / "cache", seen.append, cores=lambda c=cores: next(c))
        assert seen == list(range(8))
        assert multiprocessing.active_children() == []
    # On one core, by a renderer that works on three frames at a time.
    monkeypatch.setattr(EmbreeBackend, "frames_at_once", 3, raising=False)
    drawing, drawn = EmbreeSession.render, set[int]()

    def draw(session: EmbreeSession, pose: Pose) -> RenderedView:
        drawn.add(threading.get_ident())
        return drawing(session, pose)

    monkeypatch.setattr(EmbreeSession, "render", draw)
    generate_observation(plan, tmp_path / "at once", tmp_path / "cache")
    assert len(drawn) > 1
    one = _files(tmp_path / "1")
    assert len(one) > 60
    for name in [*constant, *changing, "at once"]:
        assert _files(tmp_path / name) == one, name


class _Drawing:
    """A renderer's session that counts how many frames are drawn at the same time."""

    def __init__(self, counts: list[int], drawn: list[int]) -> None:
        self.counts, self.drawn = counts, drawn

    def open(self, *_: object) -> _Drawing:
        return self

    def share(self) -> _Drawing:
        return _Drawing(self.counts, self.drawn)

    def render(self, pose: Pose) -> int:
        self.counts.append(+1)
        time.sleep(0.02)
        self.drawn.append(sum(self.counts))
        self.counts.append(-1)
        return int(pose.position[0])

    def close(self) -> None:
        pass


#: Nothing to draw.
EMPTY = Scene("empty", (), (), ())


def _poses(count: int) -> dict[int, Pose]:
    """A pose for each second, at x = the second."""
    return {second: Pose.from_yaw((second, 0, 0), 0.0) for second in range(count)}


def test_frames_are_drawn_on_as_many_cores_as_there_are_now() -> None:
    drawn: list[int] = []
    at = {0: 1, 10: 2, 20: 3, 30: 99}
    cores = [at[max(start for start in at if start <= n)] for n in range(50)]
    given, finished = iter(cores), list[int]()
    with Renderer(EMPTY, _Drawing([], drawn)) as camera:  # type: ignore[arg-type]
        views = camera.frames(
            _poses(50), Intrinsics.from_fov(8), lambda second, _: finished.append(second), lambda: next(given)
        )
        shown = [int(view) for view in views]  # type: ignore[call-overload]
    assert shown == sorted(finished) == list(range(50))
    assert finished[:10] == list(range(10))
    assert max(drawn[:10]) == 1
    assert max(drawn[:18]) == 2
    assert max(drawn) == MOST_THREADS


def test_frames_are_drawn_on_fewer_cores_when_they_are_needed_elsewhere() -> None:
    drawn: list[int] = []
    cores = [*repeat(4, 10), *repeat(2, 20), *repeat(3, 15), *repeat(1, 25)]
    given = iter(cores)
    with Renderer(EMPTY, _Drawing([], drawn)) as camera:  # type: ignore[arg-type]
        assert list(camera.frames(_poses(70), Intrinsics.from_fov(8), cores=lambda: next(given))) == list(range(70))
    # Frames that were begun before the change, at most two per thread, are still drawn as before.
    assert max(drawn[:10]) == 4
    assert max(drawn[20:30]) == 2
    assert max(drawn[38:45]) == 3
    assert drawn[-15:] == [1] * 15


@pytest.mark.slow
def test_the_last_tasks_of_a_run_are_lent_the_cores_of_those_that_have_nothing_to_do() -> None:
    """Six tasks on four workers: while all four work each has one core; the last one alone has all four."""
    tasks = [Task(str(n), cores_seen, (0.1 if n < 4 else 0.5 if n == 4 else 2.0,), most_cores=9) for n in range(6)]
    with LocalScheduler(4) as pool:
        found = {r.task.name: r.value for r in pool.run(tasks, Policy(), lambda _: None)}
    assert [found[str(n)] for n in range(4)] == [[1]] * 4
    assert found["4"] == [1]
    assert found["5"][-1] == 4
    assert found["5"] == sorted(found["5"])


@pytest.mark.slow
def test_nothing_is_lent_to_what_cannot_use_it_nor_while_tasks_wait() -> None:
    """A task that others wait for is alone on three workers; their cores are kept for those that wait."""
    wait_for = {"after": "first", "most_cores": 2}
    tasks = [Task("first", cores_seen, (0.5,), most_cores=9)]
    tasks += [Task(name, cores_seen, (seconds,), **wait_for) for name, seconds in [("a", 0.1), ("b", 1.0)]]  # type: ignore[arg-type]
    with LocalScheduler(3) as pool:
        found = {r.task.name: r.value for r in pool.run(tasks, Policy(), lambda _: None)}
    assert found["first"] == [1]
    assert found["b"][-1] == 2


@pytest.mark.slow
@pytest.mark.parametrize("end", ["well", "wrong", "dead"])
def test_workers_that_wait_for_a_first_task_load_meanwhile_and_do_their_work_however_that_ends(
    tmp_path: Path, end: str
) -> None:
    tasks = [Task("first", pid_after, (3.0,)), *(Task(str(n), pid_after, (1.0,), after="first") for n in range(2))]
    policy = Policy(warm_up=Task("load", load_and_end, (tmp_path, end)))
    with LocalScheduler(2) as pool:
        found = {r.task.name: r.value for r in pool.run(tasks, policy, lambda _: None)}
    (loaded,) = [int(path.name) for path in tmp_path.iterdir()]
    assert loaded != found["first"]
    assert found.keys() == {"first", "0", "1"}
    assert found["0"] != found["1"]
    assert (loaded in {found["0"], found["1"]}) == (end != "dead")


@pytest.mark.parametrize(
    ("cores", "waiting", "most", "shares"),
    [
        (4, 0, [], []),
        (4, 0, [5, 5, 5, 5], [1, 1, 1, 1]),
        (4, 0, [5, 5, 5], [1, 1, 2]),
        (32, 0, [5] * 30, [1] * 29 + [3]),
        (32, 0, [5] * 26, [1] * 24 + [3, 5]),
        (32, 0, [5, 5], [5, 5]),
        (32, 30, [5, 5], [1, 1]),
        (32, 29, [5, 5], [1, 2]),
        (32, 28, [5, 5, 1], [1, 2, 1]),
        (2, 9, [5, 5, 5], [1, 1, 1]),
    ],
)
def test_idle_cores_go_to_the_tasks_that_began_last(
    cores: int, waiting: int, most: list[int], shares: list[int]
) -> None:
    assert divide(cores, waiting, most) == shares


@pytest.mark.slow
def test_one_worker_lends_nothing() -> None:
    tasks = [Task(n, cores_seen, (0.0,), most_cores=9) for n in "ab"]
    with LocalScheduler(1) as pool:
        found = [r.value for r in pool.run(tasks, Policy(), lambda _: None)]
    assert found == [[1]] * 2


def test_an_observation_asks_how_many_cores_it_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    handed: list[int] = []
    monkeypatch.setattr(
        "generators.observation.generate.generate_observation",
        lambda *_, cores, pictures, output: handed.append(cores()) or _Nothing(),
    )
    monkeypatch.setattr(work, "_warm_up", lambda *_: None)
    plan = make_plans(read_manifest(write_manifest(tmp_path)), GenerateOptions(only=["part_2/*"], audio="analytic"))[0]
    place = work.RunTarget(tmp_path, tmp_path)
    work.make_observation(Context(0, lambda *_: None), plan, place)
    work.make_observation(Context(0, lambda *_: None, lambda: 3), plan, place)
    assert handed == [1, 3]


def test_a_process_warms_up_once_for_all_heads_of_a_family(monkeypatch: pytest.MonkeyPatch) -> None:
    warmed: list[EngineOptions] = []
    monkeypatch.setattr(work, "_warm", set())
    monkeypatch.setattr(work, "warm_up", warmed.append)
    family = EngineOptions(audio="tracer", receivers=choose_receivers("tracer", hrtf="family"))
    drawn = [family.receivers.for_observation(np.random.default_rng(seed)) for seed in (1, 2)]
    heads = [replace(family, receivers=each) for each in drawn]
    for options in (*heads, EngineOptions(audio="tracer"), *heads):
        work.warm_up_worker(Context(0, lambda *_: None), options)
    assert warmed == [heads[0], EngineOptions(audio="tracer")]


class _Nothing:
    """A record with no frames."""

    category, sources, instances, frames, acoustics = "clock", None, (), (), SimpleNamespace(t30=None)


def _count(until: int) -> Generator[int]:
    yield from range(until)
    if until == 3:
        raise Avs3dError("three is wrong; expected another number")
    if until == 5:
        os.kill(os.getpid(), signal.SIGKILL)
    if until == 6:
        os._exit(7)


def _pids() -> Generator[int]:
    while True:
        yield os.getpid()


forked = pytest.mark.skipif(sys.platform != "linux", reason="results move to another process on Linux only")


@forked
@pytest.mark.parametrize("stay", [0, 1, 2, 200])
def test_results_that_move_to_another_process_come_in_order_and_errors_with_them(stay: int) -> None:
    def rest(until: int) -> Iterator[int]:
        asked = chain(repeat(False, stay), repeat(True))
        with continue_in_fork(_count(until), lambda: next(asked)) as results:
            yield from results

    assert list(rest(100)) == list(range(100))
    with pytest.raises(Avs3dError, match="three is wrong"):
        list(rest(3))
    if stay <= 5:  # else it would be this process that dies
        with pytest.raises(ChildProcessError, match=r"beside this one was killed by signal 9; if memory was short"):
            list(rest(5))
        with pytest.raises(ChildProcessError, match=r"ended with exit code 7$"):
            list(rest(6))
    assert multiprocessing.active_children() == []


@forked
def test_a_process_beside_goes_on_from_where_the_results_are_and_ends_with_the_context() -> None:
    asked = chain([False, False], repeat(True))
    with continue_in_fork(_pids(), lambda: next(asked)) as results:
        pids = [next(results) for _ in range(4)]
    assert pids[:2] == [os.getpid()] * 2
    assert pids[2] == pids[3] != os.getpid()
    with pytest.raises(ProcessLookupError):
        os.kill(pids[2], 0)


def test_results_stay_where_they_are_unless_they_are_wanted_elsewhere() -> None:
    results = _pids()
    with continue_in_fork(results, lambda: False) as same:
        assert [next(same) for _ in range(3)] == [os.getpid()] * 3
    assert list(results) == []  # closed


@forked
def test_what_cuda_hears_stays_in_the_process_that_has_the_device() -> None:
    for device, here in (("cpu", False), ("cuda", True)):
        with hearing.hear_in_background(_pids(), device, lambda: True) as results:
            assert (next(results) == os.getpid()) is here
    users = [
        path for path in Path(hearing.__file__).parents[1].rglob("*.py") if "continue_in_fork(" in path.read_text()
    ]
    assert [path.name for path in users] == ["hearing.py"]  # the one that knows the device


@forked
@pytest.mark.slow
@pytest.mark.parametrize("what", ["sound", "picture", "interrupt", "killed"])
def test_an_observation_that_fails_on_several_cores_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    """One error, no process, no thread that draws, no file."""
    plan = make_plans(
        read_manifest(write_manifest(tmp_path)),
        GenerateOptions(only=["part_2/*"], frames=10, size=64, audio="analytic"),
    )[0]

    def fail(*_: object, **__: object) -> None:
        raise Avs3dError("the clip is wrong")

    def interrupt(index: int) -> None:
        if what == "interrupt" and index == 3:
            raise KeyboardInterrupt
        if what == "killed" and index == 3:
            (child,) = multiprocessing.active_children()
            child.kill()

    if what == "sound":
        monkeypatch.setattr(hearing, "receiver_clip", fail)
    if what == "picture":
        monkeypatch.setattr(ObservationWriter, "add_pictures", fail)
    kind, words = {
        "interrupt": (KeyboardInterrupt, "^$"),
        "killed": (ChildProcessError, "killed by signal 9"),
    }.get(what, (Avs3dError, "the clip is wrong"))
    threads = threading.active_count()
    with pytest.raises(kind, match=words):
        generate_observation(plan, tmp_path / "data", tmp_path / "cache", interrupt, cores=lambda: 4)
    assert multiprocessing.active_children() == []
    assert threading.active_count() == threads
    assert [path for path in (tmp_path / "data").rglob("*") if path.is_file()] == []
