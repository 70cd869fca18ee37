"""Packages that the listener needs beside the core install."""

from __future__ import annotations

from avs3d_bench.errors import UsageError
from avs3d_bench.runtime.imports import require_package

#: Extra of the package → modules, of each tuple one is enough.
NEEDED = {
    "baselines": (("torch",), ("safetensors",)),
    "train": (("torch",), ("safetensors",), ("lightning_fabric", "lightning")),
}


def require(extra: str) -> None:
    """Raise an error if a package of an extra is missing; nothing is imported.

    Raises:
        UsageError: naming the package and how to install it.
    """
    for names in NEEDED[extra]:
        require_package(*names, user="the listener", how=f"pip install 'avs3d-bench[{extra}]'", kind=UsageError)
