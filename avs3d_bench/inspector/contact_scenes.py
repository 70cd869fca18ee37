"""Parts of the contact sheet for part_3 alone: who is audible, all sources on the map, lanes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.inspector.sound_scenes import Colour, ShownScene, ShownSource
from avs3d_bench.schema import AUDIBLE_LEVEL_DB, ObservationRecord
from avs3d_bench.templates import words

#: Colours of what is not audible, and of the background.
_QUIET, _BACKGROUND = "#8a90a0", "#b9b4a7"
#: The lowest level at the top of a lane, dB re full scale.
_LEAST_TOP_DB = -24.0


def _rgb(colour: Colour) -> tuple[float, float, float]:
    red, green, blue = colour
    return red / 255, green / 255, blue / 255


def overlay_sources(
    rgb: NDArray[np.uint8], mask: NDArray[np.bool_], ids: NDArray[np.uint16], colours: dict[int, Colour]
) -> NDArray[np.uint8]:
    """``rgb`` (H, W, 3) with every marked instance outlined in its colour.

    Args:
        rgb: the frame.
        mask: (H, W) what is audible and visible.
        ids: (H, W) instance ids.
        colours: instance id → RGB.
    """
    import cv2

    out = rgb.astype(np.float32)
    out[~mask] = 0.45 * out[~mask] + 0.55 * 235
    for number in np.unique(ids[mask]):
        one = mask & (ids == number)
        edge = cv2.dilate(one.astype(np.uint8), np.ones((7, 7), np.uint8)).astype(bool) & ~mask
        out[edge] = colours.get(int(number), (255, 255, 255))
    return np.asarray(out, dtype=np.uint8)


def write_audible(axes: Any, scene: ShownScene, number: int) -> None:
    """Below a picture: the sources that are audible in frame ``number``, each in its colour, or that none is."""
    rows: list[tuple[str, Any]] = [(f"\N{BLACK CIRCLE} {s.name}", _rgb(s.colour)) for s in scene.audible(number)]
    for row, (text, colour) in enumerate(rows or [(scene.nothing, _QUIET)]):
        axes.text(
            0.0, -0.03 - 0.09 * row, text, transform=axes.transAxes, va="top", fontsize=9.5, color=colour, weight="bold"
        )  # fmt: skip


def mark_sources(axes: Any, scene: ShownScene) -> None:
    """All sources on the map, whose limits are set; one outside of it as an arrow at its border, with its room."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    inset = 0.03 * abs(right - left)
    low = np.array([min(left, right), min(bottom, top)]) + inset
    high = np.array([max(left, right), max(bottom, top)]) - inset
    for source in scene.sources:
        at = np.array([source.record.position[0], source.record.position[2]])
        edge = np.clip(at, low, high)
        colour = _rgb(source.colour)
        if (edge == at).all():
            axes.plot(*at, "*", color=colour, markersize=16, markeredgecolor="white", label=_label(source))
            continue
        towards = (at - edge) / np.linalg.norm(at - edge)
        axes.annotate(
            "", edge, xytext=edge - 1.5 * inset * towards,
            arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 3, "mutation_scale": 22},
        )  # fmt: skip
        axes.plot([], [], ">", color=colour, markersize=10, label=_label(source))


def _label(source: ShownSource) -> str:
    return f"{source.name} (off-screen)" if source.off_screen else source.name


def instance_style(scene: ShownScene, number: int, *, sounding: bool) -> Any:
    """Colour of an instance's outline on the map."""
    return _rgb(scene.colours[number]) if sounding else _QUIET


def draw_lanes(axes: Any, scene: ShownScene, frames: int) -> None:
    """A lane for each source: its programme, and its level in the frames in which it is audible."""
    levels = [entry.level_db for source in scene.sources for entry in source.heard if entry is not None]
    top = max([_LEAST_TOP_DB, *levels])
    names: list[str] = []
    for row, source in enumerate(scene.sources):
        colour = _rgb(source.colour)
        axes.broken_barh([(start, end - start) for start, end in source.spans], (-row - 0.4, 0.8), color=(*colour, 0.2))
        heard = [(k, entry.level_db) for k, entry in enumerate(source.heard) if entry is not None]
        heights = [0.05 + 0.75 * max(0.0, (level - AUDIBLE_LEVEL_DB) / (top - AUDIBLE_LEVEL_DB)) for _, level in heard]
        axes.bar([k + 0.5 for k, _ in heard], heights, bottom=-row - 0.4, width=0.92, color=colour)
        names.append(_label(source))
    if scene.background is not None:
        row = len(names)
        axes.broken_barh([(0, frames)], (-row - 0.4, 0.12), color=_BACKGROUND)
        names.append(f"{words(scene.background.kind)}, {scene.background.level_db:.0f} dB")
    axes.set_xlim(0, frames)
    axes.set_ylim(-max(1, len(names)) + 0.45, 0.55)
    axes.set_yticks([-row for row in range(len(names))], names)
    axes.set_title(
        "programme (pale) and level where audible" if scene.sources else scene.title, fontsize=10, loc="left"
    )  # fmt: skip
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def azimuth_line(times: Sequence[float], azimuths: Sequence[float]) -> tuple[list[float], list[float]]:
    """A line of azimuths (degrees), interrupted by NaN where they wrap from −180° to 180°.

    Examples:
        >>> azimuth_line([0, 1, 2], [-150, -170, 175])
        ([0, 1, 1.5, 2], [-150, -170, nan, 175])
    """
    xs, ys = [*times[:1]], [*azimuths[:1]]
    for (t0, a0), (t1, a1) in itertools.pairwise(zip(times, azimuths, strict=True)):
        if abs(a1 - a0) > 180:
            xs.append((t0 + t1) / 2)
            ys.append(math.nan)
        xs.append(t1)
        ys.append(a1)
    return xs, ys


def draw_azimuths(axes: Any, scene: ShownScene, times: list[float]) -> None:
    """The azimuth of every source, degrees; dots where it is audible."""
    for source in scene.sources:
        colour = _rgb(source.colour)
        known = [(t, a, e) for t, a, e in zip(times, source.azimuth, source.heard, strict=True) if a is not None]
        line = azimuth_line([t for t, _, _ in known], [a for _, a, _ in known])
        axes.plot(*line, color=(*colour, 0.45), linewidth=1.2)
        heard = [(t, a) for t, a, entry in known if entry is not None]
        axes.plot([t for t, _ in heard], [a for _, a in heard], ".", color=colour, markersize=5)
    axes.plot([], [], ".-", color=_QUIET, label="azimuth of each source, dots where it is audible")


def scene_summary(scene: ShownScene, record: ObservationRecord) -> str:
    """The sounding sources in words, for the title of the sheet."""
    away = sum(source.off_screen for source in scene.sources)
    names = f"{scene.title}, {away} off-screen" if away and len(scene.sources) > 1 else scene.title
    tail = f" over {words(record.background.kind)}" if record.background and scene.sources else ""
    return f"{names}{tail}"
