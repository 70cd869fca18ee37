"""How many Gaussians more a device holds, and how several trainings share one.

Without a cap on the number of Gaussians, memory is the limit. Before it is reached, growth ends (`train`), so that a
training ends with fewer Gaussians than it wanted rather than with nothing.
"""

from __future__ import annotations

import torch

#: Memory per Gaussian while the set is rebuilt, bytes: 59 float32 of parameters, two moments and a gradient, the new
#: copy of a parameter and its moments beside the old one, and sums.
BYTES = 4 * 59 * 4 + 3 * 4 * 48 + 3 * 4
#: Share of a training's memory that stays free: the driver's own, and lists of tiles, which differ from view to view.
RESERVE = 0.1
#: A step with more Gaussians needs more for intermediate results than any so far, by up to this factor.
_MARGIN = 1.25


#: Device → this process's part of its memory.
_PARTS: dict[torch.device, float] = {}


def share_device(device: torch.device, trainings: int) -> None:
    """Have this process take no more than its part of a CUDA device that so many trainings use at a time."""
    if device.type == "cuda":
        _PARTS[device] = 1.0 / trainings
        torch.cuda.set_per_process_memory_fraction(_PARTS[device], device)


def begin(device: torch.device) -> None:
    """Forget what earlier trainings of this process needed."""
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)


def room_for(count: int, device: torch.device) -> int | None:
    """How many Gaussians more than ``count`` fit into this process's part of the device; None: there is no limit.

    Counted are what lies there now, and what a step has needed so far beside it, for the new ones in proportion.
    """
    if device.type != "cuda":
        return None
    free, total = torch.cuda.mem_get_info(device)
    used, reserved = torch.cuda.memory_allocated(device), torch.cuda.memory_reserved(device)
    mine = total * _PARTS.get(device, 1.0)
    # Memory that this process has reserved is free for it; memory of other processes is not.
    available = min(mine - used, free + reserved - used) - RESERVE * mine
    passing = _MARGIN * (torch.cuda.max_memory_allocated(device) - used)
    return max(0, int((available - passing) / (BYTES + passing / max(1, count))))


def release(device: torch.device) -> None:
    """Give freed memory back to the device, as the reference does after a densification: the next sizes are others."""
    if device.type == "cuda":
        torch.cuda.empty_cache()
