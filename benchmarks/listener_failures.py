"""A picture of what fails: the worst and the median observations of the listener's rows: truth, prediction, sound."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.signal import spectrogram

from avs3d_bench.contract import layout
from avs3d_bench.contract.scores import ObservationScores, Scores
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.formats.files import write_bytes
from avs3d_bench.formats.media import read_png_mask, read_record
from avs3d_bench.inspector.contact_sheet import overlay
from evaluators.metrics.masks import frame_counts, iou

#: Rows of the tables that are shown, if their submissions are there.
SHOWN = ("2d", "spatial")
#: Observations of each row: the worst ones, and those about the median.
WORST, MEDIAN = 4, 2
#: Side of a picture, height of the line of text, and gap (pixels).
SIDE, TEXT, GAP = 240, 22, 8
#: Of a spectrogram: octaves that are shown below half of the sampling rate, level of the brightest colour (re full
#: scale), and how far below it is black (dB).
OCTAVES, LOUDEST, RANGE = 8.0, -30.0, 80.0
#: Quality of the JPEG.
QUALITY = 85


def iou_of(observation: ObservationScores) -> float | None:
    """The IoU by which observations are ranked: strict, or listen of part_3."""
    score = observation.listen or observation.strict
    return None if score is None else score.IoU


def chosen(scores: Scores) -> list[tuple[str, str, float]]:
    """(``worst`` or ``median``, key, IoU) of the observations that are shown."""
    ranked = sorted((iou, one.key) for one in scores.observations if (iou := iou_of(one)) is not None)
    middle = max(WORST, len(ranked) // 2 - MEDIAN // 2)
    some = [("worst", *each) for each in ranked[:WORST]]
    some += [("median", *each) for each in ranked[middle : middle + MEDIAN]]
    return [(kind, key, iou) for kind, iou, key in some]


def typical_frame(frames: Sequence[Frame], masks: Path) -> tuple[Frame, float] | None:
    """The frame with the median IoU among those in which the truth is visible; None if there is none."""
    found = []
    for frame in frames:
        truth = frame.mask()
        if truth.any():
            counts = frame_counts(truth, read_png_mask(masks / f"{frame.name}.png"))
            found.append((iou(counts), frame.index, frame))
    if not found:
        return None
    share, _, frame = sorted(found, key=lambda each: each[:2])[(len(found) - 1) // 2]
    return frame, share


def spectrograms(clip: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(SIDE, SIDE, 3) the left ear above the right: a second from left to right, `OCTAVES` octaves upwards.

    Args:
        clip: (2, n).
    """
    _, _, power = spectrogram(clip, fs=1.0, nperseg=1024, noverlap=768, scaling="spectrum")
    rows = (power.shape[1] - 1) * 2.0 ** np.linspace(0, -OCTAVES, SIDE // 2)
    level = 10 * np.log10(power[:, rows.round().astype(int)].reshape(-1, power.shape[-1]) + 1e-20)
    grey = np.clip(255 * (level - LOUDEST + RANGE) / RANGE, 0, 255).astype(np.uint8)
    wide = cv2.resize(grey, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.applyColorMap(wide, cv2.COLORMAP_MAGMA)[..., ::-1], np.uint8)


def strip(title: str, frame: Frame, mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """A line of text above the frame, the truth, the prediction, and what both ears hear."""
    rgb = frame.rgb()
    pictures = [rgb, overlay(rgb, frame.mask()), overlay(rgb, mask)]
    small = [cv2.resize(one, (SIDE, SIDE), interpolation=cv2.INTER_AREA) for one in pictures]
    gap = np.full((SIDE, GAP, 3), 255, np.uint8)
    row = np.hstack([small[0], gap, small[1], gap, small[2], gap, spectrograms(frame.audio())])
    head = np.full((TEXT, row.shape[1], 3), 255, np.uint8)
    cv2.putText(head, title, (2, TEXT - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (30, 30, 30), 1, cv2.LINE_AA)
    return np.asarray(np.vstack([head, row, np.full((GAP, row.shape[1], 3), 255, np.uint8)]), np.uint8)


def draw_failures(label: str, root: Path, output: Path, submissions: Path, images: Path) -> list[Path]:
    """Draw ``listener-<label>-failures.jpg``: a column for each row of the tables that has scores and a submission.

    Args:
        label: of the dataset.
        root: its folder.
        output: folder of the scores.
        submissions: folder with a submission for each row.
        images: where the picture goes.

    Returns:
        The picture, or nothing if no row is there.

    Raises:
        Avs3dError: if a file is missing or damaged.
    """
    dataset, columns = Dataset(root), []
    for name in SHOWN:
        scored = output / f"listener-{label}-{name}.json"
        if not scored.exists() or not (submissions / name).is_dir():
            continue
        strips = []
        for kind, key, _ in chosen(read_record(scored, Scores)):
            masks = submissions / name / key / layout.SUBMISSION_MASKS
            shown = typical_frame(dataset[key].test, masks)
            if shown is not None:
                frame, iou = shown
                title = f"{name}, {kind}: {key} {frame.name}, IoU {iou:.2f}"
                strips.append(strip(title, frame, read_png_mask(masks / f"{frame.name}.png")))
        if strips:
            columns.append(np.vstack(strips))
    if not columns:
        return []
    tallest = max(column.shape[0] for column in columns)
    padded = [
        np.pad(column, ((0, tallest - column.shape[0]), (0, 2 * GAP), (0, 0)), constant_values=255)
        for column in columns
    ]
    done, data = cv2.imencode(".jpg", np.hstack(padded)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    assert done
    path = images / f"listener-{label}-failures.jpg"
    write_bytes(path, data.tobytes())
    return [path]
