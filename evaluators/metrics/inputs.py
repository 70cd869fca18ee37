"""What users hand in: frames of truth and prediction, from arrays, tensors or iterators, checked one by one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError, UsageError, excerpt
from avs3d_bench.formats.mask_values import as_mask

Floats = NDArray[np.float32]
_END = object()


def as_array(values: object, where: str) -> NDArray[Any]:
    """An array of numbers, from an array, a nested sequence, or a tensor of torch on any device.

    Raises:
        Avs3dError: if it is none.
    """
    # A tensor: detached from its graph and copied to the CPU. torch itself is not needed for that.
    for step in ("detach", "cpu"):
        values = getattr(values, step)() if hasattr(values, step) else values
    if "bfloat16" in str(getattr(values, "dtype", "")):
        values = values.float()  # type: ignore[attr-defined]  # numpy has no such type
    try:
        array = np.asarray(values)
    except (TypeError, ValueError) as error:
        raise Avs3dError(f"{where}: no array of numbers ({error})") from None
    if array.dtype.kind not in "biuf":
        raise Avs3dError(f"{where}: {array.dtype}, expected an array of numbers or booleans")
    return array


def paired_frames(truth: object, prediction: object) -> Iterator[tuple[str, NDArray[Any], NDArray[Any]]]:
    """The frames of truth and prediction side by side, each with its name in messages.

    Args:
        truth: an array or tensor whose first axis counts frames, or an iterable of frames (H, W) or (1, H, W).
        prediction: likewise, as many.

    Raises:
        Avs3dError: if one has more frames than the other.
        UsageError: if one is nothing to iterate over.
    """
    both = []
    for name, frames in (("truth", truth), ("prediction", prediction)):
        if isinstance(frames, dict | str | bytes) or not isinstance(frames, Iterable):
            raise UsageError(f"{name}: a {type(frames).__name__}; expected an array (N, H, W) or an iterable of frames")
        shape = getattr(frames, "shape", None)
        if shape is not None and len(shape) < 3:
            raise UsageError(f"{name}: shape {tuple(shape)}, expected (N, H, W); of one frame, array[None]")
        # A tensor as a whole: one copy from its device, not one for each frame.
        both.append(iter(frames if shape is None else as_array(frames, name)))
    number = 0
    while True:
        true, found = (next(frames, _END) for frames in both)
        if true is _END and found is _END:
            return
        if true is _END or found is _END:
            short = "truth" if true is _END else "prediction"
            raise Avs3dError(f"{short}: ends after {number} frames, the other goes on; expected as many of both")
        where = f"frame {number}"
        yield (
            where,
            _one_channel(as_array(true, f"truth, {where}")),
            _one_channel(as_array(found, f"prediction, {where}")),
        )
        number += 1


def _one_channel(frame: NDArray[Any]) -> NDArray[Any]:
    """A frame without the axis of its only channel, which networks give."""
    return frame[0] if frame.ndim == 3 and len(frame) == 1 else frame


def whole_number(value: object, name: str, low: int, high: int | None = None) -> int:
    """A whole number of Python or numpy.

    Raises:
        UsageError: if it is none, or out of its range.
    """
    number = int(value) if isinstance(value, int | np.integer) and not isinstance(value, bool) else None
    if number is None or number < low or (high is not None and number > high):
        expected = f"from {low} on" if high is None else f"from {low} to {high}"
        raise UsageError(f"{name}: {excerpt(value)}, expected a whole number {expected}")
    return number


def truth_mask(truth: NDArray[Any], where: str) -> NDArray[np.bool_]:
    """A true mask as (H, W) bool.

    Args:
        truth: boolean, or numbers of any type that are all 0 and 1 or all 0 and 255.
        where: what messages name.

    Raises:
        Avs3dError: if it has another shape or other values.
    """
    if truth.ndim != 2 or truth.size == 0:
        raise Avs3dError(f"truth, {where}: shape {truth.shape}, expected (height, width)")
    if truth.dtype.kind == "f":
        whole = truth.astype(np.uint8) if np.isfinite(truth).all() and truth.min() >= 0 and truth.max() <= 255 else None
        if whole is None or not np.array_equal(whole, truth):
            raise Avs3dError(f"truth, {where}: holds numbers that are neither 0 nor 1; expected a binary mask")
        truth = whole
    return as_mask(truth, (truth.shape[0], truth.shape[1]), f"truth, {where}")


def real_numbers(values: NDArray[Any], shape: tuple[int, ...], where: str) -> Floats:
    """A soft prediction as float32: of the shape of the truth, without NaN.

    Raises:
        Avs3dError: if it is not.
    """
    if values.shape != shape:
        raise Avs3dError(f"prediction, {where}: shape {values.shape}, expected that of the truth, {shape}")
    found = values.astype(np.float32)
    if np.isnan(found).any():
        raise Avs3dError(f"prediction, {where}: holds NaN; expected numbers")
    return found


def probabilities(values: NDArray[Any], shape: tuple[int, ...], where: str) -> Floats:
    """A soft mask as float32: of the shape of the truth, all values in [0, 1].

    Raises:
        Avs3dError: if it is not.
    """
    found = real_numbers(values, shape, where)
    low, high = float(found.min()), float(found.max())
    if low < 0 or high > 1:
        raise Avs3dError(
            f"prediction, {where}: values from {low:.4g} to {high:.4g}, expected probabilities in [0, 1]; of logits, "
            "1 / (1 + exp(-x))"
        )
    return found
