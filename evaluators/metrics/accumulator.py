"""This toolkit's figures of masks for arrays in memory: of a whole set at once, or batch by batch.

    metrics.evaluate(truth, prediction)

    figures = metrics.Accumulator()
    for truth, prediction in batches:
        figures.update(truth, prediction)
    figures.compute()

Every frame counts once, and means are exactly rounded: the figures depend neither on the size of batches nor on the
order of frames. IoU, F, boundary_F, FP_rate and FP_area are those of protocol ``strict`` (docs/protocol-strict.md), of
all frames given.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError, UsageError, excerpt
from avs3d_bench.formats.mask_values import as_mask
from evaluators.metrics.frames import FrameFigures, Truth, frame_figures
from evaluators.metrics.inputs import as_array, paired_frames, probabilities, truth_mask
from evaluators.metrics.masks import FrameCounts, as_bytes, frame_counts, iou, mask_figures, mean
from evaluators.metrics.soft import average_precision

Bools = NDArray[np.bool_]


def evaluate(truth: object, prediction: object, *, threshold: float = 0.5) -> dict[str, float | None]:
    """The figures of predicted masks.

    Args:
        truth: (N, H, W) true masks: bool, or 0 and 1, or 0 and 255, of any numeric type; N frames of one clip in the
            order of time. (B, T, H, W) are B clips of T frames. An iterable of (H, W) frames is one clip, of which two
            frames are in memory at a time. Tensors of torch are read from any device.
        prediction: as many masks of the same shape, bool or integers like the truth; or soft masks, floating-point
            probabilities in [0, 1].
        threshold: a pixel of a soft mask is marked if its probability is above this.

    Returns:
        The figures of `Accumulator.compute`.

    Raises:
        UsageError: if an argument is no sequence of frames, there is none, or ``threshold`` is out of [0, 1].
        Avs3dError: if shapes, types or values are others (NaN, logits), or numbers of frames differ.

    Examples:
        >>> import numpy as np
        >>> truth = np.zeros((2, 8, 8), bool)
        >>> truth[0, 2:6, 2:6] = True
        >>> prediction = np.zeros((2, 8, 8), bool)
        >>> prediction[0, 2:6, 2:4] = True
        >>> found = evaluate(truth, prediction)
        >>> found["IoU"], found["J"], found["FP_rate"]
        (0.5, 0.75, 0.0)
    """
    accumulator = Accumulator(threshold=threshold)
    if getattr(truth, "ndim", 0) == 4:
        accumulator.update(truth, prediction)
    else:
        accumulator.add_clip(truth, prediction)
    return accumulator.compute()


class Accumulator:
    """Collects the figures of frames, batch by batch, for a training loop; a few numbers a frame are kept.

    Two of them, of different processes, can be pickled and merged.

    Examples:
        >>> import numpy as np
        >>> figures = Accumulator()
        >>> for step in range(3):
        ...     truth = np.ones((2, 1, 8, 8), np.float32)  # (batch, channel, height, width)
        ...     _ = figures.update(truth, 0.9 * truth)
        >>> figures
        Accumulator(6 frames, IoU 1.000)
        >>> figures.compute()["AP"]
        1.0
    """

    def __init__(self, *, threshold: float = 0.5) -> None:
        """Nothing counted yet.

        Args:
            threshold: a pixel of a soft mask is marked if its probability is above this.

        Raises:
            UsageError: if ``threshold`` is no number in [0, 1].
        """
        if isinstance(threshold, bool) or not isinstance(threshold, int | float) or not 0 <= threshold <= 1:
            raise UsageError(f"threshold: {excerpt(threshold)}, expected a number in [0, 1]")
        self.threshold = float(threshold)
        self._frames: list[FrameFigures] = []
        self._steady: list[float] = []
        self._precisions: list[float] = []
        self._soft: bool | None = None

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._frames)

    def __repr__(self) -> str:
        value = mask_figures(frame.counts for frame in self._frames)["IoU"]
        count = f"{len(self)} frame{'' if len(self) == 1 else 's'}"
        return f"Accumulator({count}, IoU {'–' if value is None else f'{value:.3f}'})"

    def update(self, truth: object, prediction: object) -> Self:
        """Add a batch; nothing of it is added if something is wrong with it.

        Args:
            truth: (N, H, W) masks in any order, or (B, T, H, W): B clips of T frames in the order of time, or one
                channel (B, 1, H, W). Values as for `evaluate`.
            prediction: of the same shape: masks or soft masks.

        Returns:
            The accumulator itself.

        Raises:
            UsageError: if the arrays have other dimensions, or there is no frame.
            Avs3dError: if shapes, types or values are others, or soft masks and others meet in one accumulator.
        """
        true, found = as_array(truth, "truth"), as_array(prediction, "prediction")
        if true.shape != found.shape:
            raise Avs3dError(f"prediction: shape {found.shape}, expected that of the truth, {true.shape}")
        if true.ndim not in (3, 4):
            raise UsageError(f"truth: shape {true.shape}, expected (frames, height, width) or (clips, frames, …, …)")
        batch = Accumulator(threshold=self.threshold)
        batch._soft = self._soft
        clips = zip(true, found, strict=True) if true.ndim == 4 else zip(true[:, None], found[:, None], strict=True)
        for clip in clips:
            batch.add_clip(*clip)
        return self.merge(batch)

    def add_clip(self, truth: Iterable[Any] | object, prediction: Iterable[Any] | object) -> Self:
        """Add the frames of one clip in the order of time; two of them are in memory at a time.

        Args:
            truth: (T, H, W), or an iterable of (H, W).
            prediction: likewise.

        Raises:
            As `update`.
        """
        before: tuple[Bools, Bools] | None = None
        for where, true, found in paired_frames(truth, prediction):
            here = self._add(where, true, found)
            if before is not None and before[0].shape == here[0].shape:
                self._steady.append(steadiness(before, here))
            before = here
        return self

    def merge(self, other: Accumulator) -> Self:
        """Add all that another one has collected.

        Raises:
            UsageError: if it has another threshold.
            Avs3dError: if one is of soft masks and the other is not.
        """
        if other.threshold != self.threshold:
            raise UsageError(f"threshold {other.threshold:g}, expected that of this accumulator, {self.threshold:g}")
        if other._soft is not None:
            self._check_kind(other._soft, "merged accumulator")
        self._frames += other._frames
        self._steady += other._steady
        self._precisions += other._precisions
        return self

    def compute(self) -> dict[str, float | None]:
        """The figures of all frames so far, in [0, 1] where nothing else is said; None where no frame has one.

        Returns:
            - ``IoU``, ``F`` (β² = 0.3), ``boundary_F``: means over the frames in which the object is visible;
            - ``AP``: of soft masks only, `average_precision`, mean over the same frames;
            - ``J``: IoU over all frames, 1 where truth and prediction are empty (DAVIS: Perazzi et al., CVPR 2016);
            - ``J&F``: mean of ``J`` and of the boundary F over all frames, as DAVIS;
            - ``FP_rate``, ``FP_area``: share of the other frames with a mark, and mean share of marked pixels;
            - ``temporal_consistency``: 1 − mean of |IoU(Pₜ, Pₜ₊₁) − IoU(Gₜ, Gₜ₊₁)| over successive frames of clips, see
              `steadiness`;
            - ``frames``, ``visible_frames``: how many there are.

        Raises:
            UsageError: if there is no frame yet.
        """
        if not self._frames:
            raise UsageError("no frame to score: expected at least one; call update(truth, prediction) first")
        counts = [frame.counts for frame in self._frames]
        outlines = [frame.boundary_f for frame in self._frames]
        found = mask_figures(counts)
        regions = mean(_overlap(frame) for frame in counts) or 0.0
        # Without an object, DAVIS scores 1 if nothing is marked.
        edges = mean(float(c.predicted == 0) if f is None else f for c, f in zip(counts, outlines, strict=True)) or 0.0
        return {
            "IoU": found["IoU"],
            "F": found["F"],
            "boundary_F": mean(value for value in outlines if value is not None),
            **({"AP": mean(self._precisions)} if self._soft else {}),
            "J": regions,
            "J&F": (regions + edges) / 2,
            "FP_rate": found["FP_rate"],
            "FP_area": found["FP_area"],
            "temporal_consistency": mean(self._steady),
            "frames": len(counts),
            "visible_frames": sum(frame.truth > 0 for frame in counts),
        }

    def _add(self, where: str, truth: NDArray[Any], prediction: NDArray[Any]) -> tuple[Bools, Bools]:
        """Count a frame; its masks."""
        true = truth_mask(truth, where)
        size = true.shape[0], true.shape[1]
        self._check_kind(prediction.dtype.kind == "f", where)
        if self._soft:
            probability = probabilities(prediction, size, where)
            marked = probability > self.threshold
            if true.any():
                self._precisions.append(average_precision(true, probability))
        else:
            marked = as_mask(prediction, size, f"prediction, {where}")
        seen = Truth.of(as_bytes(true), None, (), outlines=True)
        self._frames.append(frame_figures(seen, np.ascontiguousarray(as_bytes(marked))))
        return true, marked

    def _check_kind(self, soft: bool, where: str) -> None:
        if self._soft not in (None, soft):
            names = {True: "soft masks (floating point)", False: "masks (bool or integers)"}
            raise Avs3dError(f"prediction, {where}: {names[soft]} after {names[not soft]}; expected one kind")
        self._soft = soft


def steadiness(before: tuple[Bools, Bools], after: tuple[Bools, Bools]) -> float:
    """How alike the change of the prediction is to that of the truth from one frame to the next: 1 − |a − b|.

    a is the IoU of two successive predictions, b that of the two truths; of two empty masks it is 1. It is below 1 for
    predictions that flicker, and for those that stand still while the object moves in the picture. Where a mask lies is
    not its matter: it belongs beside IoU. (The consistency VC of Miao et al., "VSPW", CVPR 2021, needs pixels whose
    label does not change, and a camera that stands nearly still.)

    Args:
        before: truth and prediction, (H, W) bool.
        after: those of the next frame.
    """
    truth, prediction = (_overlap(frame_counts(*pair)) for pair in zip(before, after, strict=True))
    return 1.0 - abs(prediction - truth)


def _overlap(frame: FrameCounts) -> float:
    """IoU, 1 of two empty masks."""
    return iou(frame) if frame.union else 1.0
