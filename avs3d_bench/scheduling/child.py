"""The program of a supervised process: receives one task after the other, sends back events and results."""

from __future__ import annotations

import faulthandler
import fcntl
import os
import pickle
import select
import signal
import sys
import threading
import traceback
from multiprocessing.connection import Connection
from typing import Any

#: Idle timeout of a worker process (s).
IDLE = 120.0


def main() -> None:
    """Work until the parent closes the socket, or there was nothing to do for `IDLE` seconds.

    The last four arguments of the command line are the numbers of inherited file descriptors: the socket carries tasks
    and messages; the lifeline is a pipe whose other end only the parent holds; the trace is a file for the stack of a
    process that crashes (faulthandler) or hangs (SIGUSR1); the share is a file with the number of cores.
    """
    socket, lifeline, trace, share = map(int, sys.argv[-4:])
    # Ctrl-C reaches every process of a terminal; the parent decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with_parent(lifeline)
    faulthandler.enable(trace)
    faulthandler.register(signal.SIGUSR1, trace)
    connection: Connection[Any, Any] = Connection(socket)
    while connection.poll(IDLE):
        try:
            work = connection.recv_bytes()
        except EOFError:
            return
        connection.send(("begun", None))
        connection.send(_attempt(connection, share, work))


def _attempt(connection: Connection[Any, Any], share: int, work: bytes) -> tuple[str, Any]:
    """("done", value) or ("failed", (cause, message, traceback))."""
    from avs3d_bench.errors import Avs3dError
    from avs3d_bench.formats.files import os_error_line
    from avs3d_bench.runtime.memory_limit import out_of_memory
    from avs3d_bench.scheduling.errors import UnfitError
    from avs3d_bench.scheduling.tasks import Context

    try:
        call, arguments, slot = pickle.loads(work)
        context = Context(
            slot,
            lambda kind, text: connection.send(("event", (kind, text))),
            lambda: max(1, int.from_bytes(os.pread(share, 4, 0), "little")),
        )
        value = call(context, *arguments)
        pickle.dumps(value)
        return "done", value
    except UnfitError as error:
        return "failed", ("unfit", str(error), "")
    except Avs3dError as error:
        return "failed", ("refused", str(error), "")
    except OSError as error:
        return "failed", ("error", os_error_line(error), traceback.format_exc())
    except BaseException as error:
        if (short := out_of_memory(error)) is not None:
            return "failed", ("crash", short, traceback.format_exc())
        if os.environ.get("AVS3D_DEBUG"):
            traceback.print_exc()
        text = " ".join(str(error).split())  # messages of libraries may have several lines
        message = f"internal error: {type(error).__name__}: {text} (AVS3D_DEBUG=1 shows where; please report it)"
        return "failed", ("error", message, traceback.format_exc())


def _end_with_parent(lifeline: int) -> None:
    """Have this process and its own children killed when the other end of the pipe is closed, whatever they do.

    On Linux the kernel does it (a signal of our choice for an event on a file), so that a library that never lets
    Python run again is no hindrance. Elsewhere a thread waits.
    """
    if hasattr(fcntl, "F_SETSIG"):
        fcntl.fcntl(lifeline, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(lifeline, fcntl.F_SETOWN, -os.getpgrp())
        fcntl.fcntl(lifeline, fcntl.F_SETFL, fcntl.fcntl(lifeline, fcntl.F_GETFL) | os.O_ASYNC)
        if select.select([lifeline], [], [], 0)[0]:  # closed before we listened
            os._exit(1)
        return

    def watch() -> None:
        os.read(lifeline, 1)
        os.killpg(os.getpgrp(), signal.SIGKILL)

    threading.Thread(target=watch, daemon=True).start()
