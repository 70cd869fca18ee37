"""An observation that renders several frames at the same time: the same bytes, and no threads left afterwards."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import chain, repeat
from pathlib import Path
from types import SimpleNamespace

import pytest

from avs3d_bench.ahead import process_ahead
from avs3d_bench.errors import Avs3dError
from avs3d_bench.scheduling.local import LocalScheduler
from avs3d_bench.scheduling.tasks import Context, Policy, Task
from generators.observation import generate_observation
from generators.paths.stage import MOST_THREADS, Camera
from generators.plan import make_plans, read_manifest
from generators.run import worker as work
from tests.homes import write_manifest


def _files(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


@pytest.mark.slow
@pytest.mark.parametrize("audio", ["analytic", "soundspaces"])
def test_threads_change_no_byte(tmp_path: Path, audio: str) -> None:
    if audio == "soundspaces":
        pytest.importorskip("rlr_audio_propagation", reason="the SoundSpaces engine is not installed")
    plan = make_plans(
        read_manifest(write_manifest(tmp_path)), only=["part_2/*"], frames=10, size=96, audio=audio,
        depth=True, rirs=True,
    )[0]  # fmt: skip
    seen: dict[int, list[int]] = {1: [], 3: []}
    for threads, indices in seen.items():
        generate_observation(
            plan, tmp_path / str(threads), tmp_path / "cache", indices.append, cores=lambda n=threads: n,
            beside=threads > 1,
        )  # fmt: skip
    growing = chain([1, 1, 1, 2, 2], repeat(32))
    generate_observation(plan, tmp_path / "growing", tmp_path / "cache", cores=lambda: next(growing), beside=True)
    assert seen[1] == seen[3] == list(range(10))
    one = _files(tmp_path / "1")
    assert len(one) > 60
    assert one == _files(tmp_path / "3") == _files(tmp_path / "growing")


class _Drawing:
    """A renderer's session that counts how many frames are drawn at the same time."""

    def __init__(self, counts: list[int], drawn: list[int]) -> None:
        self.counts, self.drawn = counts, drawn

    def open(self, *_: object) -> _Drawing:
        return self

    def share(self) -> _Drawing:
        return _Drawing(self.counts, self.drawn)

    def render(self, pose: int) -> int:
        self.counts.append(+1)
        time.sleep(0.02)
        self.drawn.append(sum(self.counts))
        self.counts.append(-1)
        return pose

    def close(self) -> None:
        pass


def test_frames_are_drawn_on_as_many_cores_as_there_are_now() -> None:
    drawn: list[int] = []
    at = {0: 1, 10: 2, 20: 3, 30: 99}
    cores = [at[max(start for start in at if start <= n)] for n in range(50)]
    given, finished = iter(cores), list[int]()
    still = SimpleNamespace(moves=False, scene=lambda _: None)
    with closing(Camera(_Drawing([], drawn), still, None)) as camera:  # type: ignore[arg-type]
        shown = list(camera.frames(range(50), lambda second, _: finished.append(second), lambda: next(given)))  # type: ignore[arg-type]
    assert shown == sorted(finished) == list(range(50))
    assert finished[:10] == list(range(10))
    assert max(drawn[:10]) == 1
    assert max(drawn[:18]) == 2
    assert max(drawn) == MOST_THREADS


@pytest.mark.slow
def test_the_last_tasks_of_a_run_are_lent_the_cores_of_those_that_have_nothing_to_do() -> None:
    """Six tasks on four workers: while all four work each has one core; the last one alone has all four."""
    tasks = [Task(str(n), _cores_seen, (0.1 if n < 4 else 0.5 if n == 4 else 2.0,)) for n in range(6)]
    with LocalScheduler(4) as pool:
        found = {r.task.name: r.value for r in pool.run(tasks, Policy(), lambda _: None)}
    assert [found[str(n)][1] for n in range(6)] == [False, False, True, True, True, True]
    assert found["0"][0][0] == 1
    assert found["5"][0][-1] == 4
    assert found["5"][0] == sorted(found["5"][0])


@pytest.mark.slow
def test_one_worker_lends_nothing() -> None:
    with LocalScheduler(1) as pool:
        found = [r.value for r in pool.run([Task(n, _cores_seen, (0.0,)) for n in "ab"], Policy(), lambda _: None)]
    assert found == [([1], False)] * 2


def test_an_observation_asks_how_many_cores_it_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    handed: list[tuple[int, bool]] = []
    monkeypatch.setattr(
        work, "generate_observation", lambda *_, cores, beside: handed.append((cores(), beside)) or _Nothing()
    )
    monkeypatch.setattr(work, "_warm_up", lambda *_: None)
    plan = make_plans(read_manifest(write_manifest(tmp_path)), only=["part_2/*"], audio="analytic")[0]
    place = work.Place(tmp_path, tmp_path)
    work.make_observation(Context(0, lambda *_: None), plan, place)
    work.make_observation(Context(0, lambda *_: None, lambda: 3, True), plan, place)
    assert handed == [(1, False), (3, True)]


def _cores_seen(context: Context, seconds: float) -> tuple[list[int], bool]:
    seen = [context.cores()]
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        time.sleep(0.01)
        if context.cores() != seen[-1]:
            seen.append(context.cores())
    return seen, context.last


class _Nothing:
    """A record with no frames."""

    category, instances, frames, acoustics = "clock", (), (), SimpleNamespace(t30=None)


def _count(until: int) -> Iterator[int]:
    yield from range(until)
    if until == 3:
        raise Avs3dError("three is wrong; expected another number")
    if until == 5:
        os.kill(os.getpid(), signal.SIGKILL)


def _pids(_: None) -> Iterator[int]:
    while True:
        yield os.getpid()


@pytest.mark.slow
def test_a_process_ahead_gives_results_in_order_and_passes_errors_on() -> None:
    with process_ahead(_count, 100) as results:
        assert list(results) == list(range(100))
    with process_ahead(_count, 3) as results, pytest.raises(Avs3dError, match="three is wrong"):
        list(results)
    with process_ahead(_count, 5) as results, pytest.raises(RuntimeError, match="ended with exit code -9"):
        list(results)
    with process_ahead(_pids, None) as results:
        pid = next(results)
        assert pid != os.getpid()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
