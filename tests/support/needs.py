"""What files of tests need, not imported: every process of pytest-xdist collects all files, and uses few of them."""

from __future__ import annotations

from importlib.util import find_spec

import pytest


def need(package: str, reason: str) -> None:
    """Skip the file of tests that calls this if ``package`` is not installed."""
    if find_spec(package) is None:
        pytest.skip(reason, allow_module_level=True)
