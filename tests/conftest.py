"""Fixtures and settings of all tests."""

from __future__ import annotations

import signal

import pytest
from hypothesis import settings

# A slow machine is no failure of a test, and the same sources pass or fail in the same way on every machine.
# `pytest --hypothesis-profile explore` draws other examples each time.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None)
settings.load_profile("repeatable")


def pytest_configure(config: pytest.Config) -> None:
    """Let the programs that tests start hear Ctrl-C.

    A worker of pytest-xdist ignores SIGINT, and a program that is started by it would inherit that.
    """
    if hasattr(config, "workerinput"):
        signal.signal(signal.SIGINT, signal.default_int_handler)
