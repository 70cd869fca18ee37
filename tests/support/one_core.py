"""Programs that tests start have a core each: by themselves they would start a process, or threads, for each core."""

from __future__ import annotations

import os


def keep_to_one_core() -> None:
    """Let this process, and those that it starts, use one core: for ``preexec_fn`` of `subprocess`.

    Each process of pytest-xdist has its own, as long as there are enough.
    """
    if hasattr(os, "sched_getaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        number = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
        os.sched_setaffinity(0, {cores[number % len(cores)]})
