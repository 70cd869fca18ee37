"""An observation that renders several frames at the same time: the same bytes, and nothing left behind."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from avs3d_bench.ahead import process_ahead
from avs3d_bench.errors import Avs3dError
from generators.observation import generate_observation
from generators.plan import make_plans, read_manifest
from generators.runner import threads_each
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


def test_the_last_observations_share_the_cores() -> None:
    assert threads_each(36, 32) == [1] * 32 + [4] * 4
    assert threads_each(34, 2) == [1] * 34
    assert threads_each(3, 2) == [1, 1, 2]
    assert threads_each(20, 32) == [2] * 20
    assert threads_each(31, 32) == [1] * 31
    assert threads_each(1, 1) == [1]
    assert threads_each(1, 16) == [4]


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
