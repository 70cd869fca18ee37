"""Text on the pictures of a film, in OpenCV's font; drawn at twice the size and averaged, for even edges."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

U8 = NDArray[np.uint8]
Colour = tuple[int, int, int]

_FONT = cv2.FONT_HERSHEY_DUPLEX


def at_pixel(x: float, y: float) -> tuple[int, int]:
    """Whole pixels, as OpenCV requires."""
    return round(x), round(y)


def twice(picture: U8) -> U8:
    """A picture (H, W, …) at twice its size, to be drawn on and `halved`."""
    return np.asarray(cv2.resize(picture, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR), np.uint8)


def halved(picture: U8, shape: tuple[int, ...]) -> U8:
    """A picture that was drawn at twice the size (H, W, …), averaged."""
    return np.asarray(cv2.resize(picture, (shape[1], shape[0]), interpolation=cv2.INTER_AREA), np.uint8)


def _plain(text: str) -> str:
    """Replace letters that OpenCV's font does not have by question marks."""
    return text.encode("ascii", "replace").decode()


def _scale(height: float) -> float:
    """Of the font, for capitals of about 0.7 of this height in pixels."""
    return height / 30


def text_width(text: str, height: float) -> float:
    """Width of a line in pixels, as `write_text` writes it."""
    pieces = text.split("°")
    width = sum(cv2.getTextSize(_plain(piece), _FONT, _scale(height), 1)[0][0] for piece in pieces if piece)
    return float(width + (len(pieces) - 1) * 0.4 * height)


def fitting(text: str, height: float, room: float) -> str:
    """The text, cut in its middle where it is too long."""
    if text_width(text, height) <= room:
        return text
    for kept in range(len(text) - 1, 4, -1):
        short = f"{text[: kept // 2]}...{text[len(text) - (kept - kept // 2) :]}"
        if text_width(short, height) <= room:
            return short
    return ""


def write_text(picture: U8, text: str, at: tuple[float, float], height: float, colour: Colour) -> float:
    """Write a line whose base starts at ``at``; OpenCV's font has no degree sign, which is drawn. Returns its end."""
    x, thick = at[0], max(1, round(height / 22))
    for number, piece in enumerate(text.split("°")):
        if number:
            centre = at_pixel(x + 0.16 * height, at[1] - 0.58 * height)
            cv2.circle(picture, centre, max(1, round(0.11 * height)), colour, thick, cv2.LINE_AA)
            x += 0.4 * height
        if piece:
            cv2.putText(picture, _plain(piece), at_pixel(x, at[1]), _FONT, _scale(height), colour, thick, cv2.LINE_AA)
            x += cv2.getTextSize(_plain(piece), _FONT, _scale(height), thick)[0][0]
    return x
