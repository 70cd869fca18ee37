"""The device that networks run on, and its errors, in one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.runtime.freed_memory import keep_freed_memory

if TYPE_CHECKING:
    import torch


def pick_device(name: str | None = None) -> torch.device:
    """The `torch.device` of that name; without one, the first GPU or else the CPU.

    With a CPU, freed memory stays with the process from now on: see `keep_freed_memory`.

    Raises:
        UsageError: if there is no such device here.
    """
    import torch

    if name is None:
        name = "cuda" if torch.cuda.is_available() else "cpu"
    try:
        device = torch.device(name)
    except RuntimeError:
        raise UsageError(f"device {name!r}: expected cpu, cuda or cuda:<number>") from None
    if device.type not in ("cpu", "cuda"):
        raise UsageError(f"device {name!r}: expected cpu, cuda or cuda:<number>")
    if device.type == "cuda":
        count = torch.cuda.device_count() if torch.cuda.is_available() else 0
        if not count:
            raise UsageError(f"device {name!r}: no CUDA device here (torch {torch.__version__}); use --device cpu")
        if device.index is not None and device.index >= count:
            raise UsageError(f"device {name!r}: only {count} CUDA devices here, the last is cuda:{count - 1}")
    else:
        keep_freed_memory()
    return device


@contextmanager
def enough_memory(device: torch.device, where: str) -> Iterator[None]:
    """A block after which too little memory has become one line.

    Args:
        device: on which the block runs.
        where: the place that the message names, e.g. the frame.

    Raises:
        Avs3dError: if the device, or the machine, has too little memory.
    """
    import torch

    try:
        yield
    except (torch.OutOfMemoryError, MemoryError) as error:
        raise _too_little(device, where) from error
    except RuntimeError as error:
        # The CPU's allocator has no class of its own.
        if "can't allocate memory" not in str(error):
            raise
        raise _too_little(device, where) from error


def _too_little(device: torch.device, where: str) -> Avs3dError:
    hint = "; or use --device cpu" if device.type == "cuda" else ""
    return Avs3dError(f"{where}: too little memory on {device}; free some or take smaller checkpoints{hint}")


@contextmanager
def inference(device: torch.device, where: str) -> Iterator[None]:
    """A block that runs networks: no gradients, and `enough_memory`."""
    import torch

    with enough_memory(device, where), torch.inference_mode():
        yield
