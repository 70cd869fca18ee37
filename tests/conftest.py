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


#: Marker → files whose tests all have it. Those that take the fixture ``browser`` are marked ``browser``.
MARKED = {
    "engine": {"test_habitat", "test_habitat_worker", "test_soundspaces"},
    "cluster": {"test_cluster", "test_cluster_tls"},
    "gpu": {"test_core_cuda", "test_cuda_compile", "test_cuda_vision", "test_device_rays", "test_tracer_cuda"},
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests by what they need, so that `pytest -m "not browser"` leaves them out."""
    for item in items:
        for name in (name for name, files in MARKED.items() if item.path.stem in files):
            item.add_marker(name)
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker("browser")


def pytest_configure(config: pytest.Config) -> None:
    """Let the programs that tests start hear Ctrl-C.

    A worker of pytest-xdist ignores SIGINT, and a program that is started by it would inherit that.
    """
    if hasattr(config, "workerinput"):
        signal.signal(signal.SIGINT, signal.default_int_handler)
