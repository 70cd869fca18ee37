"""An observation that renders several frames at the same time: the same bytes, and nothing left behind."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from avs3d_bench.ahead import process_ahead
from avs3d_bench.errors import Avs3dError
from avs3d_bench.scheduling.local import LocalScheduler
from avs3d_bench.scheduling.tasks import Context, Policy, Task
from generators import work
from generators.observation import generate_observation
from generators.plan import make_plans, read_manifest
from tests.homes import write_manifest


def _files(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


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
            plan, tmp_path / str(threads), tmp_path / "cache", indices.append, threads=threads
        )  # fmt: skip
    assert seen[1] == seen[3] == list(range(10))
    one, three = _files(tmp_path / "1"), _files(tmp_path / "3")
    assert len(one) > 60
    assert one == three


def test_the_last_observations_of_a_run_share_the_cores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last of nine tasks on four workers are told of the workers that will have nothing to do."""
    tasks = [Task(f"part_1/home/kitchen/{n}", _width, (), after="home") for n in range(9)]
    with LocalScheduler(4) as pool:
        found = [r.value for r in pool.run([Task("home", _width, ()), *tasks], Policy(), lambda _: None)]
    assert len(found) == 10
    # Nine wait for the first task; then 8, 7, … of nine are left to start: round(4 / 9) → 1 … 4 / 1 → 4.
    assert sorted(found) == [1, 1, 1, 1, 1, 1, 1, 1, 2, 4]
    handed: list[int] = []
    monkeypatch.setattr(work, "generate_observation", lambda *_, threads: handed.append(threads) or _Nothing())
    monkeypatch.setattr(work, "_warm_up", lambda *_: None)
    plan = make_plans(read_manifest(write_manifest(tmp_path)), only=["part_2/*"], audio="analytic")[0]
    for width in (1, 3, 32):
        work.make_observation(Context(0, lambda *_: None, width), plan, work.Place(tmp_path, tmp_path))
    assert handed == [1, 3, work.MOST_THREADS]


def _width(context: Context) -> int:
    return context.width


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
