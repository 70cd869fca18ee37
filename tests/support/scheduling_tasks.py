"""Tasks for the tests of scheduling: each does one thing to the process that runs it."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from pathlib import Path

from avs3d_bench.errors import Avs3dError
from avs3d_bench.scheduling.errors import UnfitError
from avs3d_bench.scheduling.tasks import Context


def double(context: Context, value: int) -> int:
    context.report("half", str(value))
    return 2 * value


def nothing(context: Context) -> None:
    pass


def pid(context: Context) -> int:
    return os.getpid()


def place(context: Context) -> tuple[int, int]:
    """(slot, pid), after long enough that every worker gets one."""
    time.sleep(0.3)
    return context.slot, os.getpid()


def gpu(context: Context) -> tuple[int, str | None]:
    """(slot, the GPU that the process sees), after long enough that every worker gets one."""
    time.sleep(0.3)
    return context.slot, os.environ.get("CUDA_VISIBLE_DEVICES")


def interrupted(context: Context) -> str:
    os.kill(os.getpid(), signal.SIGINT)
    return "went on"


def environment(context: Context, name: str) -> str | None:
    return os.environ.get(name)


def refuse(context: Context, marks: Path) -> None:
    _mark(marks)
    raise Avs3dError("no place for a washing machine")


def unfit(context: Context, marks: Path) -> None:
    _mark(marks)
    raise UnfitError("another version")


def bug(context: Context, marks: Path) -> None:
    _mark(marks)
    raise RuntimeError("a thing that cannot be")


def throw(context: Context, error: Exception) -> None:
    raise error


def verbose(context: Context) -> None:
    raise RuntimeError("first\n  second")


def half_a_message(context: Context) -> None:
    """Promise a long message to the parent, and say no more."""
    socket = int(sys.argv[-4])  # see scheduling/child.py
    os.write(socket, (1000).to_bytes(4, "big") + b"begin")
    time.sleep(60)


def hang(context: Context, marks: Path, times: int = 10**6) -> str:
    """Hang the first ``times`` times, inside a library that never lets Python run again."""
    if _mark(marks) <= times:
        _never_return()
    return "done"


def die(context: Context, number: int, marks: Path, times: int = 10**6) -> str:
    """Die of a signal the first ``times`` times."""
    if _mark(marks) <= times:
        os.kill(os.getpid(), number)
        time.sleep(60)
    return "done"


def segfault(context: Context) -> None:
    ctypes.string_at(0)


def leave(context: Context, code: int) -> None:
    os._exit(code)


def wait(context: Context, seconds: float, marks: Path) -> str:
    _mark(marks)
    context.report("waiting", str(os.getpid()))
    time.sleep(seconds)
    return "waited"


def lambda_back(context: Context) -> object:
    return lambda: None


def _mark(marks: Path) -> int:
    """Note this attempt; how many there were."""
    marks.mkdir(exist_ok=True)
    (marks / f"{os.getpid()}-{time.monotonic_ns()}").touch()
    return len(list(marks.iterdir()))


def _never_return() -> None:
    # PyDLL keeps the interpreter's lock: no other thread of the process, and no signal handler in Python, runs.
    ctypes.PyDLL(None).sleep(10_000)


def pid_after(_: Context, seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def load_and_end(context: Context, folder: Path, end: str) -> None:
    context.report("frame", "0")
    (folder / str(os.getpid())).touch()
    if end == "wrong":
        raise Avs3dError("wrong")
    if end == "dead":
        os.kill(os.getpid(), signal.SIGKILL)


def cores_seen(context: Context, seconds: float) -> list[int]:
    seen = [context.cores()]
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        time.sleep(0.01)
        if context.cores() != seen[-1]:
            seen.append(context.cores())
    return seen
