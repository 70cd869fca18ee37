"""`python warm_server.py FD`: runs the programs that clients ask for at a listening socket, until its input ends.

It loads libraries, is forked for each program, and tells the client how the program ended. A program whose client is
gone is killed.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import json
import os
import runpy
import selectors
import signal
import socket
import sys
import traceback
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import cast

#: Loaded at the start.
LIBRARIES = (
    "click", "cv2", "embreex.rtcore_scene", "lazy_loader", "networkx", "numba", "numpy", "PIL.Image",
    "platformdirs", "pydantic", "pytest", "scipy.integrate", "scipy.interpolate", "scipy.ndimage", "scipy.optimize",
    "scipy.signal", "scipy.spatial", "scipy.stats", "shapely", "soundfile", "threadpoolctl", "trimesh",
    "xatlas", "yaml",
)  # fmt: skip
#: Torch is loaded when a program names one of these.
TORCH = ("torch", "AVS3DDataset", "listener")
#: A program that names one of these, a command, has no processes of its own for work on one core.
GENERATING = ("generate", "--regenerate", "seal")
ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Program:
    """What to run: the command line of Python, in a folder, with an environment."""

    arguments: list[str]
    folder: str
    environment: dict[str, str]

    def names(self, words: tuple[str, ...]) -> bool:
        """Whether its arguments or its text contain one of ``words``."""
        text = " ".join(self.arguments)
        with suppress(OSError, UnicodeDecodeError), open(os.path.join(self.folder, self.arguments[0])) as file:
            text += file.read()
        return any(word in text for word in words)

    def run(self, path: list[str]) -> None:
        """Do what Python does with this command line; ``path`` is that of the libraries."""
        os.chdir(self.folder)
        os.environ.clear()
        os.environ.update(self.environment)
        if "numba" in sys.modules:
            importlib.import_module("numba.core.config").reload_config()
        own = [os.path.abspath(name) for name in os.environ.get("PYTHONPATH", "").split(os.pathsep) if name]
        sys.path[:] = own + path
        importlib.invalidate_caches()
        with nullcontext() if not self.names(GENERATING) else self._here():
            self._main()

    def _here(self) -> AbstractContextManager[None]:
        sys.path.append(str(ROOT))  # behind a copy of the packages
        return cast("AbstractContextManager[None]", importlib.import_module("tests.support.here").generated_here())

    def _main(self) -> None:
        first, *rest = self.arguments
        if first == "-m":
            sys.argv = rest
            sys.path.insert(0, os.getcwd())
            runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
            return
        main = ModuleType("__main__")
        sys.modules["__main__"] = main
        if first == "-c":
            sys.argv = ["-c", *rest[1:]]
            sys.path.insert(0, "")
            exec(rest[0], main.__dict__)
            return
        sys.argv = self.arguments
        sys.path.insert(0, os.path.dirname(os.path.abspath(first)))
        main.__file__ = first
        with open(first, "rb") as file:
            code = compile(file.read(), first, "exec")
        exec(code, main.__dict__)


def load(*names: str) -> None:
    for name in names:
        with suppress(ImportError):  # of an extra that is not installed
            importlib.import_module(name)
    # A lock that a thread held would be held for ever in a fork, in which that thread is not.
    assert len(os.listdir("/proc/self/task")) == 1, "one of the libraries has started a thread"
    gc.collect()
    gc.freeze()


def received(connection: socket.socket) -> tuple[Program, list[int]]:
    """A program and its three standard streams."""
    head, streams, _, _ = socket.recv_fds(connection, 8, 3)
    size, text = int.from_bytes(head, "little"), b""
    while len(text) < size and (more := connection.recv(size - len(text))):
        text += more
    return Program(*json.loads(text)), streams


def use(streams: list[int]) -> None:
    """Read from and write to these: Python's own objects are for the streams of the server."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        os.dup2(streams[number], number)
        os.close(streams[number])
        old = getattr(sys, name)
        new = open(number, mode, 1 if number == 2 else -1, old.encoding, old.errors, closefd=False)  # noqa: SIM115
        setattr(sys, name, new)
        setattr(sys, f"__{name}__", new)


def serve(listener: socket.socket) -> Program | None:
    """Fork for each program, in which this returns it; None when the input of the server has ended."""
    running: dict[int, tuple[socket.socket, int]] = {}  # of a child's pidfd: its client, its number
    with selectors.DefaultSelector() as selector:
        selector.register(listener, selectors.EVENT_READ)
        selector.register(0, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select()[:1]:  # what one does may concern the next
                if key.fd == 0:
                    for _, pid in running.values():
                        os.killpg(pid, signal.SIGKILL)
                    return None
                if key.fileobj is listener:
                    client, _ = listener.accept()
                    program, streams = received(client)
                    if program.names(TORCH) and "torch" not in sys.modules:
                        load("torch")
                    pid = os.fork()
                    if pid == 0:
                        os.setpgid(0, 0)
                        for fd in {*(other.fd for other in selector.get_map().values()), client.fileno()} - {0}:
                            os.close(fd)
                        use(streams)
                        return program
                    with suppress(OSError):  # the child did it, or is gone
                        os.setpgid(pid, pid)
                    for fd in streams:
                        os.close(fd)
                    ended = os.pidfd_open(pid)
                    running[ended] = client, pid
                    selector.register(ended, selectors.EVENT_READ)
                    selector.register(client, selectors.EVENT_READ, ended)
                elif key.data is not None and key.data in running:  # the client is gone
                    os.killpg(running[key.data][1], signal.SIGKILL)
                    selector.unregister(key.fileobj)
                elif key.fd in running:
                    client, pid = running.pop(key.fd)
                    _, status = os.waitpid(pid, 0)
                    with suppress(OSError):
                        client.sendall(os.waitstatus_to_exitcode(status).to_bytes(8, "little", signed=True))
                    with suppress(KeyError):
                        selector.unregister(client)
                    selector.unregister(key.fd)
                    os.close(key.fd)
                    client.close()


def leave(codes: list[int]) -> None:
    """End with the last code. To take a big interpreter apart first takes 0.1 s."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # the reader is gone; the program closed it
            stream.flush()
    os._exit(codes[-1])


def code_of(run: Callable[[], None]) -> int:
    """What Python would end with."""
    try:
        run()
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            return (end.code or 0) & 0xFF
        print(end.code, file=sys.stderr)
        return 1
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


if __name__ == "__main__":
    codes = [0]
    atexit.register(leave, codes)  # before all others, thus after them
    del sys.path[0]  # the folder of this file
    found = list(sys.path)
    load(*LIBRARIES)
    if (asked := serve(socket.socket(fileno=int(sys.argv[1])))) is not None:
        codes.append(code_of(partial(asked.run, found)))
