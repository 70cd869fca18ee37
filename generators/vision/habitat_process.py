"""The child process that runs habitat-sim: started, asked, restarted once, and explained when it ends.

Its output goes to an unnamed file, whose last lines are quoted when it dies. It ends with its standard input, and
looks after its parent while it works (generators/vision/habitat_worker.py).
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import tempfile
import threading
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.user_path import user_path
from generators.vision import habitat_worker
from generators.vision.habitat_worker import PROTOCOL, Channel

VARIABLE = "AVS3D_HABITAT_PYTHON"
GPU_VARIABLE = "AVS3D_HABITAT_GPU"
HOW = f"set {VARIABLE} or --habitat-python to a Python ≥ 3.8 in which 'import habitat_sim' works"
#: Variables of this interpreter that would mislead another one.
_OURS = ("PYTHONHOME", "PYTHONPATH", "PYTHONSTARTUP", "VIRTUAL_ENV")
#: Quoted part of the worker's output: number of lines, and of bytes that are read for them.
_LINES, _TAIL = 3, 8192
_LONGEST = 600

Header = dict[str, Any]
Arrays = dict[str, NDArray[Any]]
Named = Sequence[tuple[str, NDArray[Any]]]


@dataclass(frozen=True)
class WorkerTimeouts:
    """Seconds after which a worker that has not answered is killed."""

    hello: float = 180.0
    open: float = 900.0
    render: float = 300.0
    navmesh: float = 900.0


class WorkerLostError(Exception):
    """The worker has ended or was killed; the text says how, with its own last lines."""

    def __init__(self, text: str, status: int | None, lines: str) -> None:
        super().__init__(text)
        self.status, self.lines = status, lines


def find_interpreter(named: str | None = None) -> str:
    """The interpreter that is to run habitat-sim: ``named``, else what the environment names.

    Raises:
        Avs3dError: if none is named or it is no file that can be run.
    """
    chosen = named or os.environ.get(VARIABLE)
    if not chosen:
        raise Avs3dError(f"vision backend habitat: no interpreter is named; {HOW}")
    path, found = user_path(chosen), ""
    try:
        if not path.is_file() or not os.access(path, os.X_OK):
            found = "is not there" if not path.exists() else "is no program that can be run"
    except OSError as error:  # of a folder on the way that may not be read
        found = f"cannot be looked at ({error.strerror})"
    if found:
        raise Avs3dError(f"vision backend habitat: the interpreter {chosen} {found}; {HOW}")
    # Not resolved: a virtual environment's python is a link, and works by where it lies.
    return str(path.absolute())


def graphics_device() -> int:
    """The CUDA device on which habitat-sim must render; −1: the first EGL device.

    Raises:
        Avs3dError: if the environment names something else than a number ≥ −1.
    """
    text = os.environ.get(GPU_VARIABLE, "-1")
    try:
        device = int(text)
    except ValueError:
        device = -2
    if device < -1:
        raise Avs3dError(f"{GPU_VARIABLE} is {text!r}; expected a CUDA device's number, or -1 for the first EGL device")
    return device


class Worker:
    """One worker process. Not for several threads at once."""

    def __init__(self, interpreter: str) -> None:
        """Start it.

        Raises:
            Avs3dError: if the interpreter cannot be run.
        """
        self._printed = tempfile.TemporaryFile()  # noqa: SIM115 (open as long as the process)
        environment = {key: value for key, value in os.environ.items() if key not in _OURS}
        try:
            self._process = subprocess.Popen(
                [interpreter, str(Path(habitat_worker.__file__).resolve())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._printed,
                env=environment,
            )
        except OSError as error:
            raise Avs3dError(
                f"vision backend habitat: {interpreter} cannot be run ({error.strerror or error}); {HOW}"
            ) from error
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._channel = Channel(self._process.stdout, self._process.stdin)
        self._end = weakref.finalize(self, _end, self._process)

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    def ask(self, header: Header, limit: float, arrays: Named = ()) -> tuple[Header, Arrays]:
        """Send a request and wait for the answer.

        Raises:
            WorkerLostError: if the worker has ended, or did not answer within ``limit`` seconds and was killed.
            Avs3dError: if it says that the request failed.
        """
        late = threading.Event()

        def give_up() -> None:
            late.set()
            self._process.kill()

        timer = threading.Timer(limit, give_up)
        timer.daemon = True
        timer.start()
        try:
            self._channel.send(header, arrays)
            answer, results = self._channel.receive()
        except (OSError, ValueError):  # a pipe that broke in the middle, or something that is no message
            answer, results = None, {}
        finally:
            timer.cancel()
        if answer is None:
            raise self._lost(f"did not answer within {limit:g} s" if late.is_set() else None)
        if not answer.get("ok"):
            raise Avs3dError(f"habitat-sim: {header['command']} failed: {_one_line(str(answer.get('error')))}")
        return answer, results

    def close(self) -> None:
        """End the process; closing twice is fine."""
        self._end()
        self._printed.close()

    def _lost(self, reason: str | None) -> WorkerLostError:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(10.0)  # its pipe closes a moment before it ends
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
            reason = reason or "broke off its answers"
        status = self._process.returncode
        if reason is None:
            reason = f"was killed by {_signal_name(-status)}" if status < 0 else f"ended with status {status}"
        lines = self._last_lines()
        quoted = f"; its last lines: {lines}" if lines else ", without a word"
        return WorkerLostError(f"{reason}{quoted}", status, lines)

    def _last_lines(self) -> str:
        handle = self._printed.fileno()
        # The worker writes through the same file: reading must not move its position.
        data = os.pread(handle, _TAIL, max(0, os.fstat(handle).st_size - _TAIL))
        lines = [line.strip() for line in data.decode("utf-8", "replace").splitlines() if line.strip()]
        return _one_line(" | ".join(lines[-_LINES:]))


class Client:
    """A worker that is prepared by some requests and, if it dies later, is replaced once."""

    def __init__(
        self, interpreter: str, what: str, prepare: Sequence[tuple[Header, float]], limits: WorkerTimeouts
    ) -> None:
        """Start a worker and make it ready.

        Args:
            interpreter: path of the other Python.
            what: what is opened, for messages.
            prepare: requests and their limits, asked in order of every new worker.
            limits: how long to wait.

        Raises:
            Avs3dError: if the worker cannot be started or ends while it is being prepared.
        """
        self._interpreter, self._what, self._prepare, self._limits = interpreter, what, tuple(prepare), limits
        self._replaced = False
        self.answers: list[Header] = []
        self.about: Header = {}
        self.worker: Worker | None = self._start()

    def ask(self, header: Header, limit: float, arrays: Named = ()) -> tuple[Header, Arrays]:
        """The answer to a request; if the worker dies over it, a second one is asked.

        Raises:
            Avs3dError: if the second one dies, too, or the request fails, or the client is closed.
        """
        if self.worker is None:
            raise Avs3dError(f"habitat-sim is closed for {self._what}; open the scene again")
        try:
            return self.worker.ask(header, limit, arrays)
        except WorkerLostError as lost:
            self.close()
            if self._replaced:
                raise Avs3dError(f"habitat-sim died a second time over {self._what}: it {lost}") from lost
        self._replaced = True
        self.worker = self._start()
        try:
            return self.worker.ask(header, limit, arrays)
        except WorkerLostError as lost:
            self.close()
            raise Avs3dError(f"habitat-sim died a second time over {self._what}: it {lost}") from lost

    def close(self) -> None:
        """End the worker; closing twice is fine."""
        if self.worker is not None:
            self.worker.close()
            self.worker = None

    def _start(self) -> Worker:
        folder = next((header["folder"] for header, _ in self._prepare if "folder" in header), None)
        worker, self.about = start(self._interpreter, self._limits, folder)
        try:
            self.answers = [worker.ask(header, limit)[0] for header, limit in self._prepare]
        except WorkerLostError as lost:
            worker.close()
            raise Avs3dError(f"habitat-sim cannot open {self._what}: it {lost}{_advice(lost)}") from lost
        except BaseException:
            worker.close()
            raise
        return worker


def start(interpreter: str, limits: WorkerTimeouts, folder: str | None = None) -> tuple[Worker, Header]:
    """A worker that has started, and its description: ``version`` of habitat_sim, ``python``, ``cuda``.

    It removes ``folder`` when this process lets it go, or is killed. It is told so before it loads habitat_sim, which
    takes a while.

    Raises:
        Avs3dError: if the interpreter cannot be run, is no Python ≥ 3.8, or has no habitat_sim.
    """
    worker = Worker(interpreter)
    try:
        answer, _ = worker.ask({"command": "hello"} | ({"folder": folder} if folder else {}), limits.hello)
    except WorkerLostError as lost:
        worker.close()
        raise Avs3dError(f"vision backend habitat: {interpreter} {lost}; {HOW}") from lost
    except Avs3dError as error:
        worker.close()
        raise Avs3dError(
            f"vision backend habitat: {interpreter} has no habitat_sim that works ({error}); {HOW}"
        ) from error
    if answer.get("protocol") != PROTOCOL:
        worker.close()
        raise Avs3dError(f"vision backend habitat: {interpreter} answered {answer!r}; expected protocol {PROTOCOL}")
    return worker, answer


def _advice(lost: WorkerLostError) -> str:
    """Advice about a worker that ended while a scene was being opened."""
    if lost.status == 1 or "EGL" in lost.lines:
        return (
            "; it ends like that where it finds no EGL device: install a GPU driver or Mesa (apt-get install libegl1"
            f" libgl1-mesa-dri), or choose the device with {GPU_VARIABLE} (-1: the first)"
        )
    return ""


def _end(process: subprocess.Popen[bytes]) -> None:
    """Let the process go: by closing its input first, by force if it stays."""
    for stream in (process.stdin, process.stdout):
        with contextlib.suppress(OSError):
            if stream is not None:
                stream.close()
    try:
        process.wait(3.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _one_line(text: str) -> str:
    flat = " ".join(text.split())
    return flat if len(flat) <= _LONGEST else "…" + flat[-_LONGEST:]


def as_points(points: NDArray[Any]) -> NDArray[np.float32]:
    """(N, 3) float32 in C order, as the worker takes them."""
    return np.ascontiguousarray(np.asarray(points, dtype=np.float32).reshape(-1, 3))
