"""A child process that runs one task at a time, with a time limit; it is replaced when it dies or hangs.

The child is a process group of its own that the kernel kills when its parent is gone. It is started by `subprocess`,
not `multiprocessing`, because Dask's workers are daemons, which may have no children of the latter kind.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from avs3d_bench.scheduling.tasks import Attempt, Task

#: Time limits for a process to write its stack before it is killed, and to end by itself (s).
_GRACE = 0.5
#: How long one may be stuck in the middle of a message to the other, seconds.
_STALL = 5
#: How much of a stack is kept, characters.
_TRACE = 8000
#: A task must be found wherever it was found here, the child's own program first of all. (Not by PYTHONPATH, which
#: would reach engines that run in interpreters of their own.)
_BOOT = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from avs3d_bench.scheduling.child import main; main()"
_REASONS = {
    signal.SIGKILL: "killed, or out of memory; use fewer workers on this machine if memory was short",
    signal.SIGSEGV: "a crash in a library",
    signal.SIGBUS: "a crash in a library, or the disk of a mapped file is full",
    signal.SIGABRT: "a crash in a library",
    signal.SIGXCPU: "the limit of CPU time",
}


@dataclass(frozen=True)
class TaskEvent:
    """An event of the running task."""

    kind: str
    text: str


@dataclass(frozen=True)
class Done:
    """The task returned ``value``."""

    value: Any


class Supervised:
    """One child process, started with the first task and again whenever it is gone.

    Args:
        environment: variables it gets besides those of this process.
        slot: see `tasks.Context`.
        name: what failures call it.
    """

    def __init__(self, environment: Mapping[str, str] | None = None, *, slot: int = 0, name: str = "") -> None:
        self._environment = dict(environment or {})
        self._slot = slot
        self._name = name
        self._process: subprocess.Popen[bytes] | None = None
        self._work = b""
        self._begun = False
        self._lent = 1
        self._limit: float | None = None
        self._deadline: float | None = None

    @property
    def pid(self) -> int | None:
        """Of the process, if it stands."""
        return self._process.pid if self._process else None

    @property
    def worker(self) -> str:
        """Name of this process in failures."""
        return f"{self._name or socket.gethostname()} (process {self.pid})"

    @property
    def connection(self) -> Connection[Any, Any]:
        """Readable when `read` has something to say; for `multiprocessing.connection.wait`."""
        assert self._process is not None
        return self._connection

    @property
    def remaining(self) -> float | None:
        """Seconds until the running task's limit; None without one."""
        return None if self._deadline is None else max(0.0, self._deadline - time.monotonic())

    def start(self, task: Task) -> None:
        """Give the process a task; `read` tells how it goes. Only one at a time."""
        self._work = pickle.dumps((task.call, task.arguments, self._slot))
        self._limit = task.limit
        self._send()

    def lend(self, cores: int) -> None:
        """Let the running task use so many cores from now on (see `Context`)."""
        # In one write, so that the child never reads half of it.
        if self._process is not None and cores != self._lent:
            os.pwrite(self._share.fileno(), cores.to_bytes(4, "little"), 0)
            self._lent = cores

    def _send(self) -> None:
        self._begun = False
        self._deadline = None if self._limit is None else time.monotonic() + self._limit
        if self._process is None or self._process.poll() is not None:
            self._spawn()
        try:
            self._connection.send_bytes(self._work)
        except OSError:  # the idle timeout ended it at this moment
            self._spawn()
            self._connection.send_bytes(self._work)

    def read(self) -> TaskEvent | Done | Attempt | None:
        """The next thing that happened, without waiting; None if nothing did.

        After `Done` or an `Attempt` (a failed one) the process is free for the next task.
        """
        try:
            while self._connection.poll():
                kind, content = self._connection.recv()
                if kind == "begun":
                    self._begun = True
                elif kind == "event":
                    return TaskEvent(*content)
                elif kind == "done":
                    return Done(content)
                else:
                    cause, message, trace = content
                    return Attempt(self.worker, cause, message, trace)
        except (EOFError, OSError, pickle.UnpicklingError):
            return self._died()
        if self.remaining == 0.0:
            return self._hung()
        return None

    def run(
        self, task: Task, report: Callable[[str, str], None], *, wanted: Callable[[], bool] = lambda: True
    ) -> Done | Attempt | None:
        """Run a task to its end.

        Args:
            task: what to run.
            report: gets its events.
            wanted: asked every second; once it says no, the task is killed and None comes back.
        """
        self.start(task)
        asked = time.monotonic()
        while True:
            self._connection.poll(min(1.0, self.remaining if self.remaining is not None else 1.0))
            found = self.read()
            if isinstance(found, TaskEvent):
                report(found.kind, found.text)
            elif found is not None:
                return found
            if time.monotonic() - asked >= 1.0:
                asked = time.monotonic()
                if not wanted():
                    self.kill()
                    return None

    def _spawn(self) -> None:
        self.kill()
        trace, share = tempfile.TemporaryFile(), tempfile.TemporaryFile()  # noqa: SIM115 - live as long as the process
        ours, theirs = socket.socketpair()
        for timeout in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
            ours.setsockopt(socket.SOL_SOCKET, timeout, struct.pack("ll", _STALL, 0))
        connection: Connection[Any, Any] = Connection(ours.detach())
        end, lifeline = os.pipe()
        inherited = (theirs.fileno(), end, trace.fileno(), share.fileno())
        try:
            process = subprocess.Popen(
                [sys.executable, "-c", _BOOT, json.dumps(sys.path), *map(str, inherited)],
                stdin=subprocess.DEVNULL,
                pass_fds=inherited,
                start_new_session=True,
                env=os.environ | self._environment,
            )
        except BaseException:
            trace.close()
            share.close()
            connection.close()
            os.close(lifeline)
            raise
        finally:
            theirs.close()
            os.close(end)
        self._process, self._connection, self._lifeline = process, connection, lifeline
        self._trace, self._share = trace, share
        self._lent = 1  # what an empty file says

    def _died(self) -> Attempt | None:
        """The process is gone: a failed attempt, unless it had ended before it saw the task."""
        assert self._process is not None
        worker = self.worker
        try:
            code = self._process.wait(timeout=_GRACE)
        except subprocess.TimeoutExpired:
            code = None
        trace = self._stack()
        self.kill()
        if code == 0 and not self._begun:
            self._send()
            return None
        if code is None:
            message = "the worker process closed its connection, or stopped in the middle of a message"
        elif code < 0:
            number = signal.Signals(-code) if -code in set(signal.Signals) else None
            name = number.name if number else "unknown"
            reason = _REASONS.get(number, "ended from outside") if number else "ended from outside"
            message = f"the worker process died of signal {-code} ({name}): {reason}"
        else:
            message = f"the worker process ended with exit code {code}"
        return Attempt(worker, "crash", message, trace)

    def _hung(self) -> Attempt:
        assert self._process is not None
        worker = self.worker
        self._process.send_signal(signal.SIGUSR1)  # faulthandler writes the stack
        deadline = time.monotonic() + _GRACE
        while not self._stack() and time.monotonic() < deadline:
            time.sleep(0.02)
        time.sleep(0.05)
        trace = self._stack()
        self.kill()
        message = f"not done after {self._limit:g} s; a larger --time-limit gives it longer"
        return Attempt(worker, "hang", message, trace)

    def _stack(self) -> str:
        # Not read(): the child writes at the same file position.
        return os.pread(self._trace.fileno(), _TRACE, 0).decode(errors="replace")

    def kill(self) -> None:
        """End the process and its own children now; the next task starts another."""
        process, self._process = self._process, None
        if process is None:
            return
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        self._connection.close()
        self._trace.close()
        self._share.close()
        os.close(self._lifeline)
