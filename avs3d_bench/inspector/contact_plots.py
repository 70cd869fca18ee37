"""The plots of a contact sheet: the map with all sources, who is audible when, levels, directions and a spectrogram."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.signal import spectrogram

from avs3d_bench.contract.layout import FRAME_RATE, is_test
from avs3d_bench.contract.schema import AUDIBLE_LEVEL_DB, ObservationRecord
from avs3d_bench.dataset import Observation
from avs3d_bench.inspector.floorplan import MARGIN, PIXELS_PER_METRE, Bounds, paint_plan, read_plan
from avs3d_bench.inspector.labels import LabelBox, place_labels
from avs3d_bench.inspector.pictures import SOUNDING
from avs3d_bench.inspector.sources import Colour, ShownSound, ShownSource
from avs3d_bench.measures.levels import ild_db
from avs3d_bench.text.templates import words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#1f2430"
MUTED = "#8a90a0"
SOURCE = "#e4572e"
SILENT = "#4b7bec"
PATH = "#1b998b"
#: Around the floor plan, and pixels of the plan a metre.
OUTSIDE, PLAN_SCALE = "#ece9e2", 2 * PIXELS_PER_METRE
_BACKGROUND = "#b9b4a7"
#: The lowest level at the top of a lane, dB re full scale.
_LEAST_TOP_DB = -24.0
#: The brightest colour of the spectrogram stands for this density at least (dB re 1/Hz): silence is dark.
QUIETEST_DB = -110.0


def _rgb(colour: Colour) -> tuple[float, float, float]:
    red, green, blue = colour
    return red / 255, green / 255, blue / 255


def write_audible(axes: Axes, sound: ShownSound, number: int) -> None:
    """Below a picture: the sources that are audible in frame ``number``, each in its colour, or that none is."""
    rows: list[tuple[str, Any]] = [(f"\N{BLACK CIRCLE} {s.name}", _rgb(s.colour)) for s in sound.audible(number)]
    for row, (text, colour) in enumerate(rows or [(sound.nothing, MUTED)]):
        axes.text(
            0.0, -0.03 - 0.09 * row, text, transform=axes.transAxes, va="top", fontsize=9.5, color=colour, weight="bold"
        )  # fmt: skip


def _mark_sources(axes: Axes, sound: ShownSound, *, moves: bool) -> None:
    """All sources on the map, whose limits are set; one outside of it as an arrow at its border, with its room."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    inset = 0.03 * abs(right - left)
    low = np.array([min(left, right), min(bottom, top)]) + inset
    high = np.array([max(left, right), max(bottom, top)]) - inset
    for source in sound.sources:
        at = np.array([source.record.position[0], source.record.position[2]])
        edge = np.clip(at, low, high)
        colour = _rgb(source.colour)
        if (edge == at).all():
            label = _label(source)
            if sound.always:
                label = "source at the first frame" if moves else "source"
            # A lone source lies above the path.
            order = 5 if sound.always else 2
            axes.plot(*at, "*", color=colour, markersize=16, markeredgecolor="white", label=label, zorder=order)
            continue
        towards = (at - edge) / np.linalg.norm(at - edge)
        axes.annotate(
            "", edge, xytext=edge - 1.5 * inset * towards,
            arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 3, "mutation_scale": 22},
        )  # fmt: skip
        axes.plot([], [], ">", color=colour, markersize=10, label=_label(source))


def _label(source: ShownSource) -> str:
    return f"{source.name} (off-screen)" if source.off_screen else source.name


def _draw_lanes(axes: Axes, sound: ShownSound, frames: int) -> None:
    """A lane for each source: its programme, and its level in the frames in which it is audible."""
    levels = [entry.level_db for source in sound.sources for entry in source.heard if entry is not None]
    top = max([_LEAST_TOP_DB, *levels])
    names: list[str] = []
    for row, source in enumerate(sound.sources):
        colour = _rgb(source.colour)
        axes.broken_barh([(start, end - start) for start, end in source.spans], (-row - 0.4, 0.8), color=(*colour, 0.2))
        heard = [(k, entry.level_db) for k, entry in enumerate(source.heard) if entry is not None]
        heights = [0.05 + 0.75 * max(0.0, (level - AUDIBLE_LEVEL_DB) / (top - AUDIBLE_LEVEL_DB)) for _, level in heard]
        axes.bar([k + 0.5 for k, _ in heard], heights, bottom=-row - 0.4, width=0.92, color=colour)
        names.append(_label(source))
    if sound.background is not None:
        row = len(names)
        axes.broken_barh([(0, frames)], (-row - 0.4, 0.12), color=_BACKGROUND)
        names.append(f"{words(sound.background.kind)}, {sound.background.level_db:.0f} dB")
    axes.set_xlim(0, frames)
    axes.set_ylim(-max(1, len(names)) + 0.45, 0.55)
    axes.set_yticks([-row for row in range(len(names))], names)
    axes.set_title(
        "programme (pale) and level where audible" if sound.sources else sound.title, fontsize=10, loc="left"
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


def _draw_azimuths(axes: Axes, sound: ShownSound, times: list[float]) -> None:
    """The azimuth of every source, degrees; if sources sound by turns, with dots where they are audible."""
    alpha, width = (1.0, 1.6) if sound.always else (0.45, 1.2)
    label = "azimuth of the source" if sound.always else None
    for source in sound.sources:
        colour = _rgb(source.colour)
        known = [(t, a, e) for t, a, e in zip(times, source.azimuth, source.heard, strict=True) if a is not None]
        line = azimuth_line([t for t, _, _ in known], [a for _, a, _ in known])
        axes.plot(*line, color=(*colour, alpha), linewidth=width, label=label)
        if not sound.always:
            heard = [(t, a) for t, a, entry in known if entry is not None]
            axes.plot([t for t, _ in heard], [a for _, a in heard], ".", color=colour, markersize=5)
    if not sound.always:
        axes.plot([], [], ".-", color=MUTED, label="azimuth of each source, dots where it is audible")


@dataclass(frozen=True)
class _Label:
    """The name of an object on the map: its box (left, top, right, bottom) in metres, and the colour of the text."""

    box: tuple[float, float, float, float]
    text: str
    colour: Any


def draw_map(axes: Axes, observation: Observation, record: ObservationRecord, sound: ShownSound) -> list[_Label]:
    """The floor plan from above (x to the right, z downwards) with path, headings of test frames, and objects.

    Returns:
        The names of the objects, still to be written.
    """
    path = np.array([frame.position for frame in record.frames])[:, [0, 2]]
    boxes = np.array([instance.bounds for instance in record.instances]).reshape(-1, 2, 3)[:, :, [0, 2]]
    reach = np.concatenate([path, boxes.reshape(-1, 2)])
    low, high = reach.min(axis=0) - MARGIN, reach.max(axis=0) + MARGIN
    bounds = Bounds(*(float(v) for v in (*low, *(high - low))))
    size = round(bounds.width * PLAN_SCALE), round(bounds.height * PLAN_SCALE)
    axes.set_facecolor(OUTSIDE)
    axes.imshow(
        paint_plan(read_plan(observation, bounds), bounds, size),
        extent=(low[0], high[0], high[1], low[1]), interpolation="antialiased", zorder=0,
    )  # fmt: skip
    axes.plot(*path.T, color="white", linewidth=5, solid_capstyle="round", zorder=2)
    axes.plot(*path.T, color=PATH, linewidth=2.2, label="path", zorder=3)
    axes.plot(*path[0], "o", color=PATH, markersize=8, markeredgecolor="white", label="start", zorder=4)
    heading = np.array([frame.pose.rotation_matrix @ (0.0, 0.0, -1.0) for frame in record.frames])[:, [0, 2]]
    test = np.array([is_test(index) for index in range(len(path))])
    axes.quiver(
        *path[test].T, *heading[test].T, color=INK, angles="xy", scale_units="xy", scale=2.5, width=0.0045,
        label="heading in test frames", zorder=4,
    )  # fmt: skip
    labels: list[_Label] = []
    for instance, ((x0, z0), (x1, z1)) in zip(record.instances, boxes.tolist(), strict=True):
        name = sound.names[instance.id]
        if sound.always:
            style = colour = _rgb(SOUNDING) if instance.sounding else SILENT
        else:
            style, colour = (_rgb(sound.colours[instance.id]),) * 2 if instance.sounding else (MUTED, INK)
        axes.fill(
            [x0, x1, x1, x0], [z0, z0, z1, z1], facecolor=_with_alpha(style, 0.25), edgecolor=style, linewidth=2.2
        )
        text = f"{name} (sounds)" if instance.sounding else name
        labels.append(_Label((x0, z0, x1, z1), text, colour))
    if record.moves:
        way = np.array([record.source_at(frame) for frame in record.frames])
        axes.plot(way[:, 0], way[:, 2], color=SOURCE, linewidth=2, label="path of the source", zorder=3)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(high[1], low[1])
    _mark_sources(axes, sound, moves=record.moves)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("z (m)")
    # Beside the plan, which it would hide.
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=9, frameon=False, borderaxespad=0)
    return labels


def _with_alpha(colour: Any, alpha: float) -> Any:
    """A colour of matplotlib's with an opacity."""
    from matplotlib.colors import to_rgba

    return to_rgba(colour, alpha)


def name_objects(figure: Figure, axes: Axes, labels: Sequence[_Label]) -> None:
    """Write names so that none overlaps another; a line leads to the object of one that lies further away."""
    height = figure.bbox.height

    def pixels(box: Sequence[float]) -> LabelBox:
        (x0, y0), (x1, y1) = axes.transData.transform(np.reshape(box, (2, 2)))
        # matplotlib counts pixels from below.
        return LabelBox(min(x0, x1), height - max(y0, y1), max(x0, x1), height - min(y0, y1))

    texts = [
        axes.annotate(
            label.text,
            (0, 0),
            xycoords="figure pixels",
            ha="left",
            va="top",
            fontsize=9,
            color=label.colour,
            weight="bold",
            annotation_clip=False,
            zorder=7,
            bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 1},
        )
        for label in labels
    ]
    extents = [text.get_window_extent() for text in texts]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    marks = [pixels(label.box) for label in labels]
    sizes = [(extent.width + 4, extent.height + 4) for extent in extents]
    places = place_labels(marks, sizes, pixels((left, top, right, bottom)))
    for label, text, mark, place in zip(labels, texts, marks, places, strict=True):
        text.set_position((place.left + 2, height - place.top - 2))
        text.xy = text.get_position()
        start, end = mark.nearest(place), place.nearest(mark)
        if np.hypot(end[0] - start[0], end[1] - start[1]) > 0.75 * (place.bottom - place.top):
            axes.annotate(
                "", (start[0], height - start[1]), xytext=(end[0], height - end[1]), xycoords="figure pixels",
                textcoords="figure pixels", annotation_clip=False, zorder=6,
                arrowprops={"arrowstyle": "-", "color": label.colour, "linewidth": 1, "shrinkA": 0, "shrinkB": 0},
            )  # fmt: skip


def draw_sound(figure: Figure, observation: Observation, record: ObservationRecord, sound: ShownSound) -> None:
    """Lanes if sources sound by turns, levels and directions over time, and a spectrogram."""
    if sound.always:
        upper, lower = figure.subplots(2, 1)
    else:
        lanes, upper, lower = figure.subplots(3, 1, height_ratios=[max(1.0, 0.4 * len(sound.sources) + 0.4), 1.2, 1.6])
        _draw_lanes(lanes, sound, len(record.frames))
    times = [frame.time + 0.5 / FRAME_RATE for frame in record.frames]  # the middle of each clip
    difference = [ild_db(frame.rms_left, frame.rms_right) for frame in record.frames]
    upper.axhline(0, color=MUTED, linewidth=0.8)
    upper.bar(times, difference, width=0.9, color=PATH, label="ILD (right − left)")
    upper.set_ylabel("ILD (dB)")
    side = upper.twinx()
    _draw_azimuths(side, sound, times)
    side.set_ylim(-190, 190)
    side.set_yticks([-180, -90, 0, 90, 180])
    side.set_ylabel("azimuth (°), right positive")
    limit = 1.15 * max(1.0, *(abs(value) for value in difference))
    upper.set_ylim(-limit, limit)
    upper.set_xlim(0, len(record.frames))
    upper.set_xlabel("time (s)")
    bars, lines = upper.get_legend_handles_labels(), side.get_legend_handles_labels()
    upper.legend([*bars[0], *lines[0]], [*bars[1], *lines[1]], loc="upper right", fontsize=9)
    count = min(20, len(record.frames))
    signal = np.concatenate([frame.audio().mean(axis=0) for frame in observation.frames[:count]])
    frequency, time, power = spectrogram(signal, fs=record.acoustics.sample_rate, nperseg=2048, noverlap=1024)
    level = 10 * np.log10(power + 1e-14)
    loudest = max(level.max(), level.dtype.type(QUIETEST_DB))
    lower.pcolormesh(
        time, frequency[1:] / 1000, level[1:], vmin=loudest - 80, vmax=loudest, cmap="magma", rasterized=True
    )
    lower.set_yscale("log")
    lower.set_ylim(0.05, 20)
    lower.set_yticks([0.1, 1, 10], ["0.1", "1", "10"])
    lower.set_xlabel(f"time (s), the first {count} clips as the agent hears them")
    lower.set_ylabel("frequency (kHz)")
