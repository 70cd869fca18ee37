"""Loads what a text ``module:name`` names, on first use.

A table of such texts keeps the digest of an observation's software small: of a table's entries only those count that
are chosen (see `avs3d_bench.provenance`, and `generators.backends.unused_backends`). An import statement would count
for every observation.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


def import_by_name(named: str) -> Any:
    """The class or function of a text ``module:name``."""
    module, _, name = named.partition(":")
    return getattr(import_module(module), name)
