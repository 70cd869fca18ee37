"""Checkpoints of a training: parameters, moments and running sums, with a digest of their inputs."""

from __future__ import annotations

import hashlib
import pickle
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import atomic_path, dump_json
from baselines.echosegnet.densify import PARAMETERS, GradientStats, parameters
from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.schedule import TrainingSettings

_FORMAT = 2
_MOMENTS = ("step", "exp_avg", "exp_avg_sq")
_SUMS = ("total", "count", "radius")


def digest(settings: TrainingSettings, start: Gaussians, pictures: Tensor) -> str:
    """sha256 over settings, initial Gaussians and pictures (one pixel in 16 of each)."""
    out = hashlib.sha256(dump_json(asdict(settings)).encode())
    out.update(start.means.numpy().tobytes() + start.sh[:, 0].contiguous().numpy().tobytes())
    out.update(pictures[:, ::4, ::4].cpu().numpy().tobytes())
    return out.hexdigest()


def save(
    path: Path, optimiser: torch.optim.Adam, pull: GradientStats, iteration: int, full_at: int | None, made_from: str
) -> None:
    """Write a checkpoint; the file before it stays whole until the new one is.

    Raises:
        Avs3dError: if the system refuses.
    """
    values = parameters(optimiser)
    state = {name: {key: optimiser.state[values[name]][key] for key in _MOMENTS} for name in PARAMETERS}
    content = {
        "format": _FORMAT,
        "digest": made_from,
        "iteration": iteration,
        "parameters": {name: value.detach() for name, value in values.items()},
        "state": state,
        "full_at": full_at,
        "pull": {name: getattr(pull, name) for name in _SUMS},
    }
    with atomic_path(path) as temporary:
        try:
            torch.save(content, temporary)
        except RuntimeError as error:
            # torch's archive writer reports a full disk that way.
            raise Avs3dError(f"{path}: cannot write the checkpoint: {str(error).splitlines()[0]}") from None


def load(
    path: Path, optimiser: torch.optim.Adam, made_from: str, device: torch.device
) -> tuple[int, GradientStats, int | None]:
    """Put a checkpoint's parameters and moments into the optimiser.

    Returns:
        Iterations done, the running sums, and the iteration at which memory ended growth (None: it did not).

    Raises:
        Avs3dError: if the file is damaged, or was made from other pictures, points or settings.
    """
    try:
        content = torch.load(path, map_location=device, weights_only=True)
        if content["format"] != _FORMAT:
            raise KeyError("format")
        if content["digest"] != made_from:
            raise Avs3dError(f"{path}: made from other pictures, points or settings; delete it or name another file")
        pull = _checked(content, parameters(optimiser))
        for group in optimiser.param_groups:
            name = group["name"]
            optimiser.state.pop(group["params"][0], None)
            new = torch.nn.Parameter(content["parameters"][name])
            state = {key: content["state"][name][key] for key in _MOMENTS}
            optimiser.state[new] = state
            group["params"] = [new]
        return content["iteration"], pull, content["full_at"]
    except (
        OSError, RuntimeError, EOFError, KeyError, TypeError, ValueError, AttributeError, pickle.UnpicklingError,
    ) as error:  # fmt: skip
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise Avs3dError(f"{path}: damaged checkpoint ({reason[:80]}); delete it to start again") from None


def _checked(content: dict[str, Any], started: dict[str, Tensor]) -> GradientStats:
    """The running sums of a checkpoint in which all tensors have the shapes that belong together.

    Args:
        content: of the file.
        started: the parameters at the start: all but their number of Gaussians stays.

    Raises:
        ValueError: naming what does not fit.
    """
    count = len(content["parameters"]["means"])
    for name, value in started.items():
        found, state = content["parameters"][name], content["state"][name]
        for what, tensor in {name: found, **{f"{key} of {name}": state[key] for key in _MOMENTS[1:]}}.items():
            if tensor.shape != (count, *value.shape[1:]) or tensor.dtype != value.dtype:
                raise ValueError(f"{what} has shape {tuple(tensor.shape)}, expected {(count, *value.shape[1:])}")
        if not torch.isfinite(found).all():
            raise ValueError(f"{name} holds NaN or infinite numbers")
        if state["step"].numel() != 1:
            raise ValueError(f"step of {name} is no number")
    pull = GradientStats(*(content["pull"][name] for name in _SUMS))
    if any(getattr(pull, name).shape != (count,) for name in _SUMS):
        raise ValueError(f"running sums of another number of Gaussians, expected {count}")
    if any(type(number) is not int for number in (content["iteration"], content["full_at"] or 0)):
        raise ValueError("iteration is no number")
    return pull
