"""Time of the stages of a job: functions are replaced by ones that note their wall and CPU time, and put back after it.

with StageClock({"open it": "package.module:function", "read it": "package.module:Class.method"}) as clock:
    job()
print(clock.table())
"""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from types import TracebackType
from typing import Any

#: Stages that took less than this are left out of a table (s).
_LEAST = 0.005


@dataclass
class Stage:
    """What a function took.

    Attributes:
        calls: how often it was called.
        wall: time from call to return, in all calls (s).
        cpu: CPU time meanwhile (s): of all threads in the main thread, else of the calling thread alone.
        first: when it was first called, last: when it last returned (s after the start).
        inner: stages called from it.
    """

    calls: int = 0
    wall: float = 0.0
    cpu: float = 0.0
    first: float = float("inf")
    last: float = 0.0
    inner: dict[str, Stage] = field(default_factory=dict)


class StageClock:
    """Times functions while it is open.

    Args:
        stages: title → ``module:function`` or ``module:Class.method``; the name is replaced in that module, where its
            callers look it up.
    """

    def __init__(self, stages: dict[str, str]) -> None:
        self._stages = stages
        self._undo: list[tuple[Any, str, Any]] = []
        self._local = threading.local()
        self._lock = threading.Lock()
        self._main, self._threads = Stage(), Stage()
        self._owner = threading.get_ident()
        self._wall, self._cpu = 0.0, 0.0

    def __enter__(self) -> StageClock:
        for title, path in self._stages.items():
            module, _, name = path.partition(":")
            *classes, last = name.split(".")
            owner = functools.reduce(getattr, classes, import_module(module))
            old = owner.__dict__[last]
            self._undo.append((owner, last, old))
            is_static = isinstance(old, staticmethod)
            timed = self._timed(title, old.__func__ if is_static else old)
            setattr(owner, last, staticmethod(timed) if is_static else timed)
        self._wall, self._cpu = time.perf_counter(), time.process_time()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._main.wall, self._main.cpu = time.perf_counter() - self._wall, time.process_time() - self._cpu
        for owner, name, old in reversed(self._undo):
            setattr(owner, name, old)

    def _timed(self, title: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def timed(*arguments: Any, **options: Any) -> Any:
            with self._noted(title):
                return function(*arguments, **options)

        return timed

    @contextmanager
    def _noted(self, title: str) -> Iterator[None]:
        is_main = threading.get_ident() == self._owner
        cpu_time = time.process_time if is_main else time.thread_time
        stack: list[Stage] = self._local.__dict__.setdefault("stack", [self._main if is_main else self._threads])
        with self._lock:
            stage = stack[-1].inner.setdefault(title, Stage())
        stack.append(stage)
        wall, cpu = time.perf_counter(), cpu_time()
        try:
            yield
        finally:
            taken, used = time.perf_counter() - wall, cpu_time() - cpu
            stack.pop()
            with self._lock:
                stage.calls += 1
                stage.wall += taken
                stage.cpu += used
                stage.first = min(stage.first, wall - self._wall)
                stage.last = max(stage.last, wall - self._wall + taken)

    def table(self) -> str:
        """The stages, in the order in which they were first reached: wall time, CPU time, CPU time / wall time."""
        lines = [f"  {'stage':44s} {'wall s':>8s} {'CPU s':>8s} {'cores':>6s}  begins–ends, s"]
        lines += _rows(self._main, 0)
        if self._threads.inner:
            lines.append("  in other threads, times of all calls added:")
            lines += _rows(self._threads, 0)
        lines.append(f"  {'all':44s} {self._main.wall:8.2f} {self._main.cpu:8.2f}")
        return "\n".join(lines)


def _rows(stage: Stage, depth: int) -> list[str]:
    lines = []
    for title, inner in sorted(stage.inner.items(), key=lambda item: item[1].first):
        if inner.wall < _LEAST:
            continue
        name = "  " * depth + title + (f" ({inner.calls} calls)" if inner.calls > 1 else "")
        cores = inner.cpu / max(inner.wall, 1e-9)
        times = f"{inner.wall:8.2f} {inner.cpu:8.2f} {cores:6.1f}"
        lines.append(f"  {name:44s} {times}  {inner.first:.2f}–{inner.last:.2f}")
        lines += _rows(inner, depth + 1)
    return lines
