"""Printed faces drawn with anti-aliasing: seven-segment displays, clock faces, oven windows, any lettering."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Pixels = NDArray[np.uint8]
XY = tuple[float, float]

#: Factor of supersampling: the picture is drawn larger and averaged, so that every edge is smooth.
_OVERSAMPLE = 4
_SEGMENTS = {  # a b c d e f g: top, upper right, lower right, bottom, lower left, upper left, middle
    "0": "abcdef",
    "1": "bc",
    "2": "abged",
    "3": "abgcd",
    "4": "fgbc",
    "5": "afgcd",
    "6": "afgedc",
    "7": "abc",
    "8": "abcdefg",
    "9": "abcdfg",
    "-": "g",
    " ": "",
}


class DecalCanvas:
    """A picture in pixels, x to the right, y down; coordinates may be fractions.

    Args:
        width: final width, pixels.
        height: final height, pixels.
        background: ``"#rrggbb"``.
    """

    def __init__(self, width: int, height: int, background: str) -> None:
        self.width, self.height = width, height
        self._image = Image.new("RGB", (width * _OVERSAMPLE, height * _OVERSAMPLE), background)
        self._draw = ImageDraw.Draw(self._image)

    def pixels(self) -> Pixels:
        """(height, width, 3) uint8."""
        return np.asarray(self._image.resize((self.width, self.height), Image.Resampling.BOX)).copy()

    def box(
        self,
        low: XY,
        high: XY,
        fill: str | None = None,
        *,
        radius: float = 0.0,
        outline: str | None = None,
        width: float = 1.0,
    ) -> None:
        """A rectangle with rounded corners."""
        self._draw.rounded_rectangle(
            [v * _OVERSAMPLE for v in (*low, *high)],
            radius * _OVERSAMPLE,
            fill=fill,
            outline=outline,
            width=round(width * _OVERSAMPLE) if outline else 0,
        )

    def disc(
        self, centre: XY, radius: float, fill: str | None, *, outline: str | None = None, width: float = 1
    ) -> None:
        """A circle."""
        x, y = (v * _OVERSAMPLE for v in centre)
        r = radius * _OVERSAMPLE
        stroke = max(1, round(width * _OVERSAMPLE)) if outline else 0
        self._draw.ellipse([x - r, y - r, x + r, y + r], fill=fill, outline=outline, width=stroke)

    def line(self, points: Sequence[XY], fill: str, width: float = 1.0) -> None:
        """A polyline."""
        self._draw.line(
            [(x * _OVERSAMPLE, y * _OVERSAMPLE) for x, y in points],
            fill=fill,
            width=max(1, round(width * _OVERSAMPLE)),
            joint="curve",
        )

    def polygon(self, points: Sequence[XY], fill: str) -> None:
        """A filled polygon."""
        self._draw.polygon([(x * _OVERSAMPLE, y * _OVERSAMPLE) for x, y in points], fill=fill)

    def ray(self, centre: XY, degrees: float, inner: float, outer: float, fill: str, width: float) -> None:
        """A tick: along the clockwise angle from twelve o'clock, between two radii."""
        direction = np.array([np.sin(np.radians(degrees)), -np.cos(np.radians(degrees))])
        across = np.array([-direction[1], direction[0]]) * width / 2
        middle = np.asarray(centre)
        corners = [
            middle + direction * r + side * across for r, side in ((inner, -1), (outer, -1), (outer, 1), (inner, 1))
        ]
        self.polygon([(float(x), float(y)) for x, y in corners], fill)

    def text(self, centre: XY, text: str, size: float, fill: str, *, bold: float = 0.0) -> None:
        """``text`` centred on a point; ``bold`` thickens the strokes by that many pixels."""
        font = ImageFont.load_default(size=size * _OVERSAMPLE)
        self._draw.text(
            (centre[0] * _OVERSAMPLE, centre[1] * _OVERSAMPLE),
            text,
            fill=fill,
            font=font,
            anchor="mm",
            stroke_width=round(bold * _OVERSAMPLE),
            stroke_fill=fill,
        )

    def digits(self, centre: XY, text: str, height: float, fill: str, ghost: str | None = None) -> None:
        """Seven-segment digits and colons centred on a point; ``ghost`` colours the unlit segments."""
        width, gap = 0.55 * height, 0.22 * height
        advance = [0.3 * height if c == ":" else width + gap for c in text]
        x = centre[0] - (sum(advance) - gap) / 2
        for char, step in zip(text, advance, strict=True):
            if char == ":":
                for dy in (-0.18, 0.18):
                    self.disc((x + 0.04 * height, centre[1] + dy * height), 0.06 * height, fill)
            else:
                if ghost:
                    self._digit((x, centre[1]), "abcdefg", width, height, ghost)
                self._digit((x, centre[1]), _SEGMENTS[char], width, height, fill)
            x += step

    def _digit(self, origin: XY, lit: str, width: float, height: float, fill: str) -> None:
        t = 0.13 * height
        x0, y0 = origin[0], origin[1] - height / 2
        x1, ym, y1 = x0 + width, y0 + height / 2, y0 + height
        spans = {
            "a": ((x0, y0), (x1, y0)),
            "b": ((x1, y0), (x1, ym)),
            "c": ((x1, ym), (x1, y1)),
            "d": ((x0, y1), (x1, y1)),
            "e": ((x0, ym), (x0, y1)),
            "f": ((x0, y0), (x0, ym)),
            "g": ((x0, ym), (x1, ym)),
        }
        for name in lit:
            (ax, ay), (bx, by) = spans[name]
            h, e = t / 2, t * 0.62
            if ay == by:
                points = [
                    (ax + e - h, ay),
                    (ax + e, ay - h),
                    (bx - e, ay - h),
                    (bx - e + h, ay),
                    (bx - e, ay + h),
                    (ax + e, ay + h),
                ]
            else:
                points = [
                    (ax, ay + e - h),
                    (ax + h, ay + e),
                    (ax + h, by - e),
                    (ax, by - e + h),
                    (ax - h, by - e),
                    (ax - h, ay + e),
                ]
            self.polygon(points, fill)


def dotted_window(width: int, height: int, *, pitch: int = 8, margin: int = 18) -> Pixels:
    """The dark perforated window of a microwave, with the pale sheen of a reflected room."""
    canvas = DecalCanvas(width, height, "#0c0d0e")
    canvas.box((margin, margin), (width - margin, height - margin), "#1b1d1f", radius=0.08 * height)
    for row, y in enumerate(np.arange(margin + pitch, height - margin - pitch / 2, pitch * 0.87)):
        for x in np.arange(margin + pitch + (row % 2) * pitch / 2, width - margin - pitch / 2, pitch):
            canvas.disc((float(x), float(y)), 0.27 * pitch, "#060606")
    return glazed(canvas.pixels())


def glazed(pixels: Pixels, *, strength: float = 34.0) -> Pixels:
    """Add the reflection of a bright window to dark glass: two slanted soft bands and a lift towards the top."""
    height, width, _ = pixels.shape
    y, x = np.mgrid[0:height, 0:width]
    slant = (x / width) + 0.45 * (y / height)
    band = np.exp(-(((slant - 0.42) / 0.10) ** 2)) + 0.6 * np.exp(-(((slant - 0.68) / 0.04) ** 2))
    fade = 0.25 + 0.75 * (1 - y / height)
    lifted = pixels + (strength * (0.8 * band + 0.25) * fade)[..., None] * np.array([0.92, 0.98, 1.06])
    return np.asarray(np.clip(np.round(lifted), 0, 255), dtype=np.uint8)


def display(width: int, height: int, text: str, *, background: str = "#071013", ink: str = "#7df0c8") -> Pixels:
    """A lit seven-segment display."""
    canvas = DecalCanvas(width, height, background)
    canvas.digits((width / 2, height / 2), text, 0.6 * height, ink, "#12211f")
    return canvas.pixels()


def clock_face(
    size: int,
    *,
    paper: str = "#f7f5ee",
    ink: str = "#161616",
    numerals: str = "arabic",
    heavy: float = 1.0,
    brand: str = "",
) -> Pixels:
    """A clock's dial; ``numerals`` is arabic, roman, quarters or none."""
    roman = ("XII", "I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X", "XI")
    canvas = DecalCanvas(size, size, paper)
    middle = (size / 2, size / 2)
    canvas.disc(middle, 0.49 * size, None, outline=ink, width=0.004 * size)
    for minute in range(60):
        whole = minute % 5 == 0
        inner = 0.415 if whole else 0.445
        canvas.ray(middle, minute * 6, inner * size, 0.47 * size, ink, (0.022 if whole else 0.007) * size * heavy)
    for hour in range(12):
        if numerals == "none" or (numerals == "quarters" and hour % 3):
            continue
        label = roman[hour] if numerals == "roman" else str(hour or 12)
        angle = np.radians(hour * 30)
        radius = 0.335 * size
        at = (size / 2 + radius * np.sin(angle), size / 2 - radius * np.cos(angle))
        canvas.text(at, label, (0.085 if numerals == "roman" else 0.115) * size, ink, bold=0.003 * size * heavy)
    if brand:
        canvas.text((size / 2, 0.66 * size), brand, 0.04 * size, ink)
    return canvas.pixels()
