"""Packages that only an export needs: imported when it runs, named with the way to get them when they are missing."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from avs3d_bench.errors import Avs3dError

#: Package → what installs it.
_EXTRA = "pip install 'avs3d-bench[exports]'"
_WAYS = {"torch": "pip install torch", "datasets": _EXTRA, "pyarrow": _EXTRA}


def need(module: str) -> Any:
    """Import ``module``.

    Raises:
        Avs3dError: if its package is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        package = (error.name or module).split(".")[0]
        way = _WAYS.get(package, f"pip install {package}")
        raise Avs3dError(f"{package} is not installed; this export needs it: {way}") from None
