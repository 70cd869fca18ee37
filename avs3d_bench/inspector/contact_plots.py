"""The plots of a contact sheet: the map with all sources, who is audible when, levels, directions and a spectrogram."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.signal import spectrogram

from avs3d_bench.contract.layout import FRAME_RATE
from avs3d_bench.contract.schema import AUDIBLE_LEVEL_DB, ObservationRecord
from avs3d_bench.dataset import Observation
from avs3d_bench.inspector.facts import PageFacts
from avs3d_bench.inspector.floor_map import FloorMap, path_colour
from avs3d_bench.inspector.floorplan import PIXELS_PER_METRE
from avs3d_bench.inspector.pictures import hexadecimal
from avs3d_bench.inspector.sources import ShownSound, ShownSource
from avs3d_bench.measures.levels import ild_db
from avs3d_bench.text.templates import words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#1f2430"
MUTED = "#8a90a0"
SOURCE = "#e4572e"
PATH = "#1b998b"
#: Pixels of the floor plan a metre.
PLAN_SCALE = 2 * PIXELS_PER_METRE
_BACKGROUND = "#b9b4a7"
#: The lowest level at the top of a lane, dB re full scale.
_LEAST_TOP_DB = -24.0
#: The brightest colour of the spectrogram stands for this density at least (dB re 1/Hz): silence is dark.
QUIETEST_DB = -110.0


def write_audible(axes: Axes, sound: ShownSound, number: int) -> None:
    """Below a picture: the sources that are audible in frame ``number``, each in its colour, or that none is."""
    rows: list[tuple[str, Any]] = [(f"\N{BLACK CIRCLE} {s.name}", hexadecimal(s.colour)) for s in sound.audible(number)]
    for row, (text, colour) in enumerate(rows or [(sound.nothing, MUTED)]):
        axes.text(
            0.0, -0.03 - 0.09 * row, text, transform=axes.transAxes, va="top", fontsize=9.5, color=colour, weight="bold"
        )  # fmt: skip


def _label(source: ShownSource) -> str:
    return f"{source.name} (off-screen)" if source.off_screen else source.name


def _draw_lanes(axes: Axes, sound: ShownSound, frames: int) -> None:
    """A lane for each source: its programme, and its level in the frames in which it is audible."""
    levels = [entry.level_db for source in sound.sources for entry in source.heard if entry is not None]
    top = max([_LEAST_TOP_DB, *levels])
    names: list[str] = []
    for row, source in enumerate(sound.sources):
        colour = hexadecimal(source.colour)
        axes.broken_barh([(start, end - start) for start, end in source.spans], (-row - 0.4, 0.8), color=(colour, 0.2))
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
        colour = hexadecimal(source.colour)
        known = [(t, a, e) for t, a, e in zip(times, source.azimuth, source.heard, strict=True) if a is not None]
        line = azimuth_line([t for t, _, _ in known], [a for _, a, _ in known])
        axes.plot(*line, color=(colour, alpha), linewidth=width, label=label)
        if not sound.always:
            heard = [(t, a) for t, a, entry in known if entry is not None]
            axes.plot([t for t, _ in heard], [a for _, a in heard], ".", color=colour, markersize=5)
    if not sound.always:
        axes.plot([], [], ".-", color=MUTED, label="azimuth of each source, dots where it is audible")


def lay_out_map(axes: Axes, observation: Observation, facts: PageFacts) -> FloorMap:
    """The floor plan from above (x to the right, z downwards) with a legend; `draw_map` draws the rest.

    Raises:
        Avs3dError: if the sparse model is missing or damaged.
    """
    from matplotlib.lines import Line2D

    drawing = FloorMap.of(facts, side=480.0, text=11.0)
    assert drawing is not None, "observation.json has poses"
    drawing.show_plan(axes, observation, PLAN_SCALE)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("z (m)")
    rows: list[tuple[str, str, Any]] = [("path, from violet (start) to amber", "_", hexadecimal(path_colour(1, 3)))]
    rows += [
        ("heading in test frames", r"$\rightarrow$", INK),
        *[("path of the source", "_", SOURCE)] * bool(facts.ways),
    ]
    if facts.lanes:
        rows += [(_label(s), ">" if s.off_screen else "*", hexadecimal(s.colour)) for s in facts.lanes.sources]
    else:
        rows.append(("source at the first frame" if facts.moves else "source", "*", SOURCE))
    handles = [Line2D([], [], label=t, color=c, marker=m, markersize=9, linestyle="none") for t, m, c in rows]
    # Beside the plan, which it would hide.
    axes.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=9, frameon=False, borderaxespad=0
    )  # fmt: skip
    return drawing


def draw_map(axes: Axes, drawing: FloorMap) -> None:
    """Draw path, objects, sources and headings of the test frames, once all is laid out."""
    drawing.paint(axes, [*drawing.ground(), *drawing.sources(), *drawing.labels])
    test = [m for m in drawing.facts.moments if m.split == "test" and m.position and m.heading]
    axes.quiver(
        [m.position[0] for m in test if m.position], [m.position[2] for m in test if m.position],
        *np.transpose([m.heading for m in test if m.heading]),
        color=INK, angles="xy", scale_units="xy", scale=2.5, width=0.0045, zorder=3 + len(drawing.facts.moments),
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
