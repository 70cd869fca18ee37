"""Loads what a text ``module:name`` names, on first use.

Tables of such texts name the backends, so that only the chosen one is imported, and only its sources count for an
observation (see `avs3d_bench.provenance` and `generators.backends.unused_backends`).
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


def import_by_name(named: str) -> Any:
    """The class or function of a text ``module:name``."""
    module, _, name = named.partition(":")
    return getattr(import_module(module), name)
