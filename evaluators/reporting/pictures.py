"""Picture triples of a report: the frame, the truth in it, and the prediction with its errors.

Colours are of Okabe & Ito's palette (2008), which people with any colour vision tell apart, and no meaning hangs on
colour alone: missed pixels are hatched, the truth has an outline, a silent twin a dashed one.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from evaluators.reading.records import FrameScore, Submission
from evaluators.reporting.sounds import silent_twins, sounds_in

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

#: RGB of marked object, unmarked object, and marks beside it.
HIT = (86, 180, 233)
MISSED = (240, 228, 66)
FALSE = (213, 94, 0)
#: Longer side in pixels of the large picture (the prediction) and of the two small ones.
LARGE, SMALL = 560, 280
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 82, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
_HATCH, _DASH = 7, 6
#: Truths of fewer pixels a side get a ring around them.
_TINY = 14


@dataclass(frozen=True)
class Picture:
    """One picture in a page.

    Attributes:
        data: ``data:image/jpeg;base64,…``.
        width: pixels.
        height: pixels.
        alt: a description in words.
    """

    data: str
    width: int
    height: int
    alt: str


@dataclass(frozen=True)
class Triple:
    """One frame of a report.

    Attributes:
        score: which frame it is and how it went.
        frame: the camera's picture.
        truth: the object in its colours, all else grey.
        prediction: hit, missed and false pixels.
        twins: how many silent twins are in the frame.
        note: what went on, in a few words.
        sounds: what is audible in the frame, in words; empty in part_1 and part_2, where it is the object.
    """

    score: FrameScore
    frame: Picture
    truth: Picture
    prediction: Picture
    twins: int
    note: str
    sounds: str = ""


def read_masks(frame: Frame, submission: Submission, rgb: U8) -> tuple[Mask, Mask]:
    """Truth and prediction of a frame, each (H, W) bool like its picture (H, W, 3).

    Raises:
        Avs3dError: if one cannot be read, or has another size than the frame.
    """
    path = submission.mask_path(frame.observation.key, frame.name)
    truth, prediction = frame.mask(), media.read_png_mask(path)
    for where, mask in ((frame.path(layout.SEMANTIC_MASKS), truth), (path, prediction)):
        if mask.shape != rgb.shape[:2]:
            size, expected = "{1}×{0}".format(*mask.shape), "{1}×{0}".format(*rgb.shape)
            raise Avs3dError(f"{where}: {size} pixels, expected the frame's {expected}")
    return truth, prediction


def draw_triple(score: FrameScore, dataset: Dataset, submission: Submission) -> Triple:
    """Draw the three pictures of a scored frame.

    Raises:
        Avs3dError: if a picture cannot be read, or a mask has another size than the frame.
    """
    frame = frame_of(dataset, score.key, score.name)
    rgb = frame.rgb()
    truth, prediction = read_masks(frame, submission, rgb)
    twins = _twins(frame)
    label = f"{score.name} of {score.key}"
    sounds = sounds_in(frame) if frame.observation.is_part_3 else ""
    words = _truth_words(truth, frame.observation.category or "sounding object", sounds, twins)
    return Triple(
        score,
        picture(resized(rgb, SMALL), f"Camera frame {label}"),
        picture(truth_picture(rgb, truth, twins, SMALL), f"Truth in {label}: {words}"),
        picture(
            error_picture(rgb, truth, prediction, twins, LARGE),
            f"Prediction in {label}: {error_words(truth, prediction)}",
        ),
        len(twins),
        _note(score, truth, prediction),
        sounds,
    )


def frame_of(dataset: Dataset, key: str, name: str) -> Frame:
    """The frame of that name.

    Raises:
        Avs3dError: if there is none any more.
    """
    found = [frame for frame in dataset[key].frames if frame.name == name]
    if not found:
        raise Avs3dError(f"{dataset.root / key}: no frame {name}; the dataset has changed since scoring")
    return found[0]


def _twins(frame: Frame) -> list[Mask]:
    """The visible silent twins; none if the data do not identify them."""
    numbers = silent_twins(frame)
    if not numbers or not frame.observation.where(layout.INSTANCE_MASKS).is_dir():
        return []
    ids = frame.instance_ids()
    return [mask for mask in (ids == number for number in numbers) if mask.any()]


def truth_picture(rgb: U8, truth: Mask, twins: list[Mask], side: int) -> U8:
    """The object in its own colours with a white line around it on a grey frame, silent twins dashed.

    Args:
        rgb: (H, W, 3).
        truth: (H, W).
        twins: (H, W) each.
        side: longer side of the picture that comes out, pixels.
    """
    small = resized(rgb, side)
    share = _share(truth, small)
    out = _blend(_muted(small), small.astype(np.float32), np.minimum(1, 2 * share))
    return _outlined(_to_bytes(out), truth, twins)


def error_picture(rgb: U8, truth: Mask, prediction: Mask, twins: list[Mask], side: int) -> U8:
    """Hit, missed (hatched) and false pixels on a grey frame; the truth has a white line around it, twins a dashed one.

    Args:
        rgb: (H, W, 3).
        truth: (H, W).
        prediction: (H, W).
        twins: (H, W) each.
        side: longer side of the picture that comes out, pixels.
    """
    small = resized(rgb, side)
    out = _muted(small)
    rows, columns = np.indices(small.shape[:2])
    hatch = np.where((rows + columns) % _HATCH < _HATCH // 2 + 1, 1.0, 0.35).astype(np.float32)
    for mask, colour, weight in (
        (truth & prediction, HIT, np.float32(0.78)),
        (prediction & ~truth, FALSE, np.float32(0.82)),
        (truth & ~prediction, MISSED, 0.9 * hatch),
    ):
        # A few pixels of the original must not fade away in the smaller picture.
        alpha = weight * np.minimum(1, 2 * _share(mask, small))
        out = _blend(out, np.broadcast_to(np.array(colour, np.float32), out.shape), alpha)
    return _outlined(_to_bytes(out), truth, twins)


def resized(rgb: U8, side: int) -> U8:
    """Smaller by averaging, or larger by whole factors, which keeps pixels square."""
    height, width = rgb.shape[:2]
    scale = side / max(height, width)
    if scale >= 2:
        factor = int(scale)
        return np.asarray(cv2.resize(rgb, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST), np.uint8)
    if scale >= 1:
        return rgb
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def _share(mask: Mask, like: NDArray[Any]) -> F32:
    """(h, w) share of each pixel of ``like`` that the mask covers."""
    height, width = like.shape[:2]
    how = cv2.INTER_AREA if height <= mask.shape[0] else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(mask.astype(np.float32), (width, height), interpolation=how), np.float32)


def _muted(rgb: U8) -> F32:
    """Grey and of less contrast, so that colours on it stand out."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return np.repeat((0.6 * grey + 38)[..., None], 3, axis=2)


def _blend(below: F32, above: F32, alpha: F32) -> F32:
    return np.asarray(below + alpha[..., None] * (above - below), np.float32)


def _to_bytes(pixels: F32) -> U8:
    return np.asarray(np.rint(pixels).clip(0, 255), np.uint8)


def _outlined(pixels: U8, truth: Mask, twins: list[Mask]) -> U8:
    out = np.ascontiguousarray(pixels)
    contours = _contours(truth, out)
    for colour, width in (((20, 20, 20), 3), ((255, 255, 255), 1)):
        cv2.polylines(out, contours, True, colour, width, cv2.LINE_AA)
    rows, columns = np.nonzero(_share(truth, out))
    if rows.size and max(np.ptp(rows), np.ptp(columns)) < _TINY:
        # A ring shows where to look for an object of a few pixels.
        centre = (int(columns.mean()), int(rows.mean()))
        for colour, width in (((20, 20, 20), 4), ((255, 255, 255), 2)):
            cv2.circle(out, centre, _TINY, colour, width, cv2.LINE_AA)
    for twin in twins:
        for contour in _contours(twin, out):
            _dashed(out, contour)
    return out


def _contours(mask: Mask, like: U8) -> list[NDArray[np.int32]]:
    cover = (_share(mask, like) > 0.25).astype(np.uint8)
    found, _ = cv2.findContours(cover, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return [np.asarray(contour, np.int32) for contour in found]


def _dashed(out: U8, contour: NDArray[np.int32]) -> None:
    """White dashes on a dark line."""
    cv2.polylines(out, [contour], True, (20, 20, 20), 3, cv2.LINE_AA)
    points = contour[:, 0]
    for start in range(0, len(points), 2 * _DASH):
        cv2.polylines(out, [points[start : start + _DASH]], False, (255, 255, 255), 2, cv2.LINE_AA)


def picture(pixels: U8, alt: str) -> Picture:
    """A picture (H, W, 3) for a page, as JPEG.

    Raises:
        Avs3dError: if OpenCV cannot encode it.
    """
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(pixels[..., ::-1]), _JPEG)
    if not done:
        raise Avs3dError(f"OpenCV could not encode a picture of {pixels.shape} as JPEG")
    text = base64.b64encode(data.tobytes()).decode()
    return Picture(f"data:image/jpeg;base64,{text}", pixels.shape[1], pixels.shape[0], alt)


def percent(share: float) -> str:
    """``3.1 %``, ``42 %``; only exact values are written as 0 % or 100 %."""
    value = 100 * share
    if 0 < value < 0.1:
        return "< 0.1 %"
    if 99.5 <= value < 100:
        return "> 99 %"
    return f"{value:.1f} %" if 0 < value < 10 else f"{value:.0f} %"


def _truth_words(truth: Mask, category: str, sounds: str, twins: list[Mask]) -> str:
    """The truth, for those who do not see the picture; ``sounds`` is empty in part_1 and part_2."""
    name = f"what is audible ({sounds})" if sounds else f"the {category.replace('_', ' ')}"
    absent = f"nothing to mark ({sounds})" if sounds else f"{name} is not in view"
    what = f"{name} covers {percent(float(truth.mean()))}" if truth.any() else absent
    if not twins:
        return what
    return f"{what}; {len(twins)} silent {'twin' if len(twins) == 1 else 'twins'}"


def error_words(truth: Mask, prediction: Mask) -> str:
    """Describe what a prediction hits and marks wrongly, for those who do not see the picture."""
    false = f"{percent(float((prediction & ~truth).mean()))} of the picture marked wrongly"
    if not truth.any():
        return false
    return f"{percent(float(prediction[truth].mean()))} of the object hit; {false}"


def _note(score: FrameScore, truth: Mask, prediction: Mask) -> str:
    """The one thing to know about the frame."""
    if score.twins_marked:
        return "marks a silent twin" if score.twins_marked == 1 else f"marks {score.twins_marked} silent twins"
    if not truth.any():
        what = "nothing audible in view" if score.key.startswith("part_3/") else "object not in view"
        return f"{what}, {percent(float(prediction.mean()))} marked"
    if not prediction.any():
        return "nothing marked"
    if not (truth & prediction).any():
        return "no overlap with the object"
    false = percent(float((~truth)[prediction].mean()))
    return f"{percent(float(prediction[truth].mean()))} hit, {false} of marks false"
