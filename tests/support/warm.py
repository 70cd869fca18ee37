"""Programs of tests in forks of a process that has loaded the libraries of others, which takes a program 1 to 3 s.

Nothing of this project is loaded before: each program imports that by itself, from where its PYTHONPATH says.
"""

from __future__ import annotations

import atexit
import os
import shutil
import socket
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

from tests.support.one_core import keep_to_one_core

_HERE = Path(__file__).parent


def python() -> list[str]:
    """What a command begins with in place of ``[sys.executable]``; options but -c and -m are not understood."""
    if not hasattr(os, "pidfd_open"):  # not on Linux
        return [sys.executable]
    return [sys.executable, "-IS", str(_HERE / "warm_client.py"), _address()]


@lru_cache(maxsize=1)
def _address() -> str:
    """The socket of this process's server, which is started when it is first asked for and ends with this process."""
    folder = Path(tempfile.mkdtemp(prefix="avs3d-warm-"))
    address = str(folder / "socket")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(address)
        listener.listen(64)
        server = subprocess.Popen(
            [sys.executable, str(_HERE / "warm_server.py"), str(listener.fileno())], stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL, env=environment, pass_fds=[listener.fileno()], start_new_session=True,
            preexec_fn=keep_to_one_core,
        )  # fmt: skip

    def end() -> None:
        assert server.stdin is not None
        server.stdin.close()
        server.wait()
        shutil.rmtree(folder, ignore_errors=True)

    atexit.register(end)
    return address
