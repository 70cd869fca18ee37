"""Fixtures and settings of all tests."""

from __future__ import annotations

import signal

import pytest
from hypothesis import settings

# A slow machine is no failure of a test.
settings.register_profile("without deadline", deadline=None)
settings.load_profile("without deadline")


def pytest_configure(config: pytest.Config) -> None:
    """Let the programs that tests start hear Ctrl-C.

    A worker of pytest-xdist ignores SIGINT, and a program that is started by it would inherit that.
    """
    if hasattr(config, "workerinput"):
        signal.signal(signal.SIGINT, signal.default_int_handler)
