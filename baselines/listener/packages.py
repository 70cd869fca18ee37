"""Packages that the listener needs beside the core install."""

from __future__ import annotations

from avs3d_bench.errors import UsageError
from baselines.networks.checkpoints import has_package

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
        if not any(has_package(name) for name in names):
            name = names[0].replace("_", "-")
            raise UsageError(
                f"the listener needs the Python package {name}, which is not installed: "
                f"pip install 'avs3d-bench[{extra}]'"
            )
