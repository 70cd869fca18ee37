"""The pictures of a film: a frame with the object marked, and a caption below it.

Drawn with OpenCV alone. Captions are drawn at twice their size and averaged, for even edges. Masks are
outlined at their own size and the outline is scaled: a clock of twenty pixels keeps its shape in a smaller film.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.inspector.moments import Moment
from avs3d_bench.inspector.pictures import SOUNDING
from avs3d_bench.inspector.video_text import U8, Colour, at_pixel, fitting, halved, text_width, twice, write_text

Overlay = Literal["outline", "tint", "none"]

#: RGB. The prediction's blue and the truth's vermilion differ for every kind of colour vision (Okabe & Ito 2008).
TRUTH: Colour = SOUNDING
PREDICTED: Colour = (86, 180, 233)
GROUND: Colour = (20, 22, 26)
_INK, _DIM, _TRACK = (240, 240, 240), (150, 156, 164), (58, 62, 70)
#: Of the sounding object in its colour, under the outline.
TINT = 0.35
#: Height of the caption, in widths of the picture.
_CAPTION = 0.125
#: Range of the level meters (dB re full scale).
_QUIET_DB = -60.0


@dataclass(frozen=True)
class Loudness:
    """RMS of both ears as the film plays them, dB re full scale, and the film's gain in dB."""

    left: float
    right: float
    gain_db: int


@dataclass(frozen=True, eq=False)
class AudibleNow:
    """A source of a part_3 observation that is audible in a frame.

    Attributes:
        name: of it.
        colour: RGB.
        mask: (H, W) where it is visible; None where it is not to be marked, and off-screen.
        azimuth: degrees, 0 ahead, positive right; None without a pose.
        distance: metres; None without a pose.
    """

    name: str
    colour: Colour
    mask: NDArray[np.bool_] | None
    azimuth: float | None
    distance: float | None


@dataclass(frozen=True, eq=False)
class Shown:
    """The contents of one picture of the film.

    Attributes:
        rgb: (H, W, 3) the frame.
        truth: (H, W) the sounding object; None where it is not to be marked.
        predicted: (H, W) a submission's mask; None where there is none.
        moment: name, split, azimuth and distance.
        title: the observation's key.
        what: sounds.
        loudness: of the second; None in a silent film.
        method: of the submission; None without one.
        inset: (h, w, 3) the map of this moment, or None.
        audible: the audible sources of a part_3 observation, marked in place of ``truth``; None if it is none.
        nothing: what is heard where none of them is audible.
    """

    rgb: U8
    truth: NDArray[np.bool_] | None
    predicted: NDArray[np.bool_] | None
    moment: Moment
    title: str
    what: str
    loudness: Loudness | None
    method: str | None = None
    inset: U8 | None = None
    audible: tuple[AudibleNow, ...] | None = None
    nothing: str = "silence"

    @property
    def marks(self) -> list[tuple[NDArray[np.bool_], Colour, str]]:
        """The masks to draw, their colours, and whose they are; the prediction last."""
        found: list[tuple[NDArray[np.bool_] | None, Colour, str]] = [(self.truth, TRUTH, "the truth")]
        if self.audible is not None:
            found = [(source.mask, source.colour, source.name) for source in self.audible]
        found.append((self.predicted, PREDICTED, self.method or "the prediction"))
        return [(mask, colour, whose) for mask, colour, whose in found if mask is not None]


@dataclass(frozen=True)
class Canvas:
    """Sizes in pixels, all even, as yuv420p requires: the picture, and the caption below it."""

    width: int
    picture: int
    caption: int

    @classmethod
    def of(cls, shape: tuple[int, ...], size: int) -> Canvas:
        """For frames of this (H, W, 3), with ``size`` pixels on the longer side."""
        scale = size / max(shape[:2])
        width, height = (max(2, 2 * round(side * scale / 2)) for side in (shape[1], shape[0]))
        return cls(width, height, max(2, 2 * round(width * _CAPTION / 2)))

    @property
    def height(self) -> int:
        """Of both."""
        return self.picture + self.caption

    def draw(self, shown: Shown, overlay: Overlay) -> U8:
        """The picture (height, width, 3), RGB.

        Raises:
            Avs3dError: if a mask has another size than the frame.
        """
        shrinks = shown.rgb.shape[1] >= self.width
        how = cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC
        picture = np.ascontiguousarray(cv2.resize(shown.rgb, (self.width, self.picture), interpolation=how), np.uint8)
        for mask, colour, whose in shown.marks:
            if mask.shape != shown.rgb.shape[:2]:
                raise Avs3dError(
                    f"{shown.title}: {shown.moment.name}: {whose} has a mask of {mask.shape}, "
                    f"expected {shown.rgb.shape[:2]} as the frame"
                )
            if overlay == "tint" and mask is not shown.predicted:
                self._tint(picture, mask, colour)
            self._outline(picture, mask, colour)
        if shown.truth is not None or shown.method is not None or shown.audible is not None:
            self._legend(picture, shown)
        if shown.inset is not None:
            edge = round(self.width * 0.018)
            height, width = shown.inset.shape[:2]
            picture[edge : edge + height, self.width - edge - width : self.width - edge] = shown.inset
        return np.concatenate([picture, self._caption(shown)])

    def _tint(self, picture: U8, mask: NDArray[np.bool_], colour: Colour) -> None:
        size = (self.width, self.picture)
        cover = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)[..., None] * np.float32(TINT)
        picture[:] = np.rint(picture * (1 - cover) + np.array(colour, dtype=np.float32) * cover).astype(np.uint8)

    def _outline(self, picture: U8, mask: NDArray[np.bool_], colour: Colour) -> None:
        found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        scale = np.array([self.width / mask.shape[1], self.picture / mask.shape[0]])
        # Fixed point with four fractional bits; OpenCV's whole numbers are pixel centres, ours lie at + 0.5.
        lines = [np.rint(((contour + 0.5) * scale - 0.5) * 16).astype(np.int32) for contour in found]
        thick = max(1, round(self.width / 360))
        cv2.polylines(picture, lines, True, GROUND, thick + 2, cv2.LINE_AA, 4)
        cv2.polylines(picture, lines, True, colour, thick, cv2.LINE_AA, 4)

    def _legend(self, picture: U8, shown: Shown) -> None:
        unit = self.width / 720
        rows = [(shown.what, TRUTH)] if shown.truth is not None else []
        if shown.audible is not None:
            rows = [(source.name, source.colour) for source in shown.audible] or [(shown.nothing, _DIM)]
        if shown.method is not None:
            rows.append((shown.method, PREDICTED))
        # Measured as it is drawn, at twice the size: small letters are narrower than half of large ones.
        size, margin = 30 * unit, 88 * unit
        most = 2 * self.width * (0.6 if shown.inset is not None else 0.9) - margin
        # What follows the method's name is kept, however long that is.
        tail = "" if shown.predicted is None or shown.predicted.any() else ": nothing"
        tail = ": no mask" if shown.predicted is None else tail
        most -= text_width(tail, size)
        rows = [(fitting(text, size, most) + tail * (colour == PREDICTED), colour) for text, colour in rows]
        width = round((max(text_width(text, size) for text, _ in rows) + margin) / 2)
        height, edge = round((len(rows) * 24 + 10) * unit), round(13 * unit)
        panel = picture[edge : edge + height, edge : edge + min(width, self.width - 2 * edge)]
        panel[:] = np.rint(panel * 0.25 + np.array(GROUND) * 0.75).astype(np.uint8)
        big = twice(panel)
        for number, (text, colour) in enumerate(rows):
            y = (21 + 24 * number) * unit * 2
            cv2.line(
                big,
                at_pixel(20 * unit, y - 10 * unit),
                at_pixel(48 * unit, y - 10 * unit),
                colour,
                round(6 * unit) or 1,
            )
            write_text(big, text, (64 * unit, y), size, _INK)
        panel[:] = halved(big, panel.shape)

    def _caption(self, shown: Shown) -> U8:
        big = np.full((2 * self.caption, 2 * self.width, 3), GROUND, dtype=np.uint8)
        unit, moment = 2 * self.width / 720, shown.moment
        x = write_text(big, moment.name, (18 * unit, 38 * unit), 24 * unit, _INK)
        if moment.split:
            x = write_text(big, moment.split, (x + 12 * unit, 38 * unit), 17 * unit, _DIM)
        room = (
            (470 * unit)
            if shown.loudness is not None or moment.azimuth is not None or shown.audible is not None
            else 2 * self.width
        )
        title = fitting(shown.title, 14 * unit, room - x - 24 * unit)
        write_text(big, title, (x + 22 * unit, 38 * unit), 14 * unit, _DIM)
        x = 18 * unit
        for text, colour in _whereabouts(shown):
            x = write_text(big, text, (x, 72 * unit), 19 * unit, colour) + 22 * unit
        directions = [] if moment.azimuth is None else [(moment.azimuth, TRUTH)]
        if shown.audible is not None:
            directions = [(source.azimuth, source.colour) for source in shown.audible if source.azimuth is not None]
        if directions or shown.audible is not None:
            _compass(big, (520 * unit, 45 * unit), 31 * unit, directions)
        if shown.loudness is not None:
            _meters(big, shown.loudness, 576 * unit, unit)
        return halved(big, (self.caption, self.width, 3))


def _whereabouts(shown: Shown) -> list[tuple[str, Colour]]:
    """The known direction and distance of the source as text; in part_3 of the audible one if it is alone."""
    out: list[tuple[str, Colour]] = []
    moment = shown.moment
    azimuth, distance = moment.azimuth, moment.distance
    if shown.audible is not None:
        if len(shown.audible) != 1:
            out.append((f"{len(shown.audible)} audible sources" if shown.audible else shown.nothing, _INK))
        alone = shown.audible[0] if len(shown.audible) == 1 else None
        azimuth, distance = (alone.azimuth, alone.distance) if alone else (None, None)
    if azimuth is not None:
        degrees = round(azimuth)
        side = "right" if degrees > 0 else "left" if degrees < 0 else "ahead"
        out.append((f"azimuth {degrees:+d}° {side}" if degrees else "azimuth 0° ahead", _INK))
    if distance is not None:
        out.append((f"{distance:.2f} m", _INK))
    if shown.audible == ():
        return out
    if moment.line_of_sight is False:
        out.append(("hidden", _DIM))
    elif moment.visible == 0:
        out.append(("out of view", _DIM))
    return out


def _compass(big: U8, centre: tuple[float, float], radius: float, directions: list[tuple[float, Colour]]) -> None:
    """Where sounds come from (azimuth and colour of each source), seen from above: up is ahead."""
    thin = max(1, round(radius / 24))
    cv2.circle(big, at_pixel(*centre), round(radius), _TRACK, 2 * thin, cv2.LINE_AA)
    wedge = np.array([_polar(centre, radius * 0.92, a) for a in np.linspace(-45, 45, 19)] + [centre])
    cv2.fillPoly(big, [np.rint(wedge).astype(np.int32)], (38, 41, 47), cv2.LINE_AA)
    for azimuth, colour in directions:
        tip = _polar(centre, radius, azimuth)
        cv2.line(big, at_pixel(*centre), at_pixel(*tip), colour, 2 * thin, cv2.LINE_AA)
        cv2.circle(big, at_pixel(*tip), round(radius * 0.17), colour, -1, cv2.LINE_AA)
    cv2.circle(big, at_pixel(*centre), round(radius * 0.1), _INK, -1, cv2.LINE_AA)


def _polar(centre: tuple[float, float], radius: float, degrees: float) -> tuple[float, float]:
    angle = math.radians(degrees)
    return centre[0] + radius * math.sin(angle), centre[1] - radius * math.cos(angle)


def _meters(big: U8, loudness: Loudness, left: float, unit: float) -> None:
    """A bar for each ear, from `_QUIET_DB` to full scale."""
    length = 720 * unit - left - 40 * unit
    for number, (name, level) in enumerate((("L", loudness.left), ("R", loudness.right))):
        y = (16 + 20 * number) * unit
        write_text(big, name, (left, y + 12 * unit), 14 * unit, _DIM)
        start, share = left + 20 * unit, float(np.clip(1 - level / _QUIET_DB, 0, 1))
        cv2.rectangle(big, at_pixel(start, y), at_pixel(start + length, y + 12 * unit), _TRACK, -1)
        if share > 0:
            cv2.rectangle(big, at_pixel(start, y), at_pixel(start + share * length, y + 12 * unit), (0, 158, 115), -1)
    write_text(big, f"sound {loudness.gain_db:+d} dB", (left, 72 * unit), 14 * unit, _DIM)
