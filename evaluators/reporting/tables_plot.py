"""The paper's tables as pictures: dots and whiskers per method, curves over the voting threshold.

Needs matplotlib (extra ``plot``). The same scores give the same bytes: no date, no version of the program, element
names of the SVG from a fixed salt, nothing from the user's matplotlibrc.
"""

from __future__ import annotations

import io
import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from avs3d_bench.commands.outputs import PNG_METADATA, SVG_METADATA
from avs3d_bench.contract.scores import BLIND_REFERENCES, Metric
from evaluators.reporting import paper
from evaluators.reporting.pages import PART_NOTES, REFERENCE_TITLES, clean, figure, interval
from evaluators.reporting.table_contents import PaperRow, PaperSection, PaperTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, SOFT, LINE, BAND, MARKED = "#1c1b19", "#5d5950", "#dcd7cc", "#f6f4ef", "#ece8de"
#: Blue and vermilion first: distinguishable with every kind of colour vision.
COLOURS = ("#2a6f97", "#d1602f", "#4f8a5b", "#8a5a9e", "#a8842c", "#5d5950")
_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "text.color": INK,
    "axes.edgecolor": LINE,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": LINE,
    "grid.linewidth": 0.7,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.major.size": 0,
    "ytick.major.size": 0,
    "text.parse_math": False,
    "svg.hashsalt": "avs3d-bench",
    "svg.fonttype": "path",
}
_DPI = 160
#: Characters of a method's name in one line, and lines of it.
_NAME_WIDTH, _NAME_LINES = 34, 3
#: Lines of the title; a version of thousands of characters would leave no room for the axes.
_TITLE_LINES = 4
#: Characters of the title in an inch.
_TITLE_WIDTH = 10
#: Between the marks of the parts in one row.
_STEP = 0.3
TICKS = (0.0, 0.25, 0.5, 0.75, 1.0)


def draw(table: PaperTable, section: PaperSection) -> dict[str, bytes]:
    """The picture of a section: suffix (``png``, ``svg``) → file.

    Raises:
        ModuleNotFoundError: without matplotlib.
    """
    with style():
        drawn = methods_figure(section) if table.name == "table2" else thresholds_figure(section)
        return {"png": encode(drawn, "png", PNG_METADATA), "svg": encode(drawn, "svg", SVG_METADATA)}


@contextmanager
def style() -> Iterator[None]:
    """The style of every picture, whatever the user's matplotlibrc says."""
    import matplotlib as mpl

    with mpl.rc_context(), warnings.catch_warnings():
        # A method may be named in a script that the font lacks: boxes in the picture, no noise on the terminal.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def encode(drawn: Figure, suffix: str, metadata: dict[str, Any]) -> bytes:
    """The file of a figure (``png`` or ``svg``)."""
    stream = io.BytesIO()
    drawn.savefig(stream, format=suffix, dpi=_DPI, metadata=metadata, facecolor="white")
    return stream.getvalue()


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of that size (inches)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    drawn = Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08))
    FigureCanvasAgg(drawn)
    return drawn


def _name(title: str) -> str:
    lines = textwrap.wrap(clean(title), _NAME_WIDTH) or [""]
    if len(lines) > _NAME_LINES:
        lines = [*lines[: _NAME_LINES - 1], lines[_NAME_LINES - 1][: _NAME_WIDTH - 1] + "…"]
    return "\n".join(lines)


def head_of(axes: Axes, metric: Metric) -> None:
    """Title of a panel: the figure, its protocol, its direction."""
    axes.set_title(metric.title, loc="left", fontsize=11, fontweight="bold", pad=17)
    below = metric.protocol if metric.higher_is_better else f"{metric.protocol}, lower is better"
    axes.text(0.0, 1.012, below, transform=axes.transAxes, va="bottom", fontsize=8.5, color=SOFT)


def _caption(drawn: Figure, title: str, section: PaperSection, handles: Sequence[Any], columns: int) -> None:
    words = textwrap.wrap(
        f"{title}: {clean(section.heading)}", int(drawn.get_figwidth() * _TITLE_WIDTH),
        max_lines=_TITLE_LINES, placeholder=" …",
    )  # fmt: skip
    drawn.suptitle("\n".join(words), x=0.012, ha="left", fontsize=12.5)
    legend = drawn.legend(
        handles=list(handles), loc="outside lower left", ncols=columns, frameon=False, handlelength=2.6,
        handletextpad=0.6,
        columnspacing=2.2,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_color(SOFT)


def methods_figure(section: PaperSection) -> Figure:
    """A row per method, a panel per figure, a colour per part; the paper's figure is hollow."""
    from matplotlib.lines import Line2D

    columns = section.columns
    parts = list(dict.fromkeys(row.part for row in section.rows))
    titles = list(dict.fromkeys((row.title, row.entry is None) for row in section.rows))
    names = [_name(title) for title, _ in titles]
    heights = [max(1.0, 0.52 * (name.count("\n") + 1)) * (0.62 if reference else 1.0)
               for name, (_, reference) in zip(names, titles, strict=True)]  # fmt: skip
    places = [sum(heights[:index]) + heights[index] / 2 for index in range(len(heights))]
    drawn = new_figure(2.9 + 2.15 * len(columns), (1.75 if len(columns) > 2 else 2.2) + 0.43 * sum(heights))
    panels = drawn.subplots(1, max(1, len(columns)), sharey=True, squeeze=False)[0]
    for axes, metric in zip(panels, columns, strict=True):
        head_of(axes, metric)
        axes.set_xlim(-0.03, 1.03)
        axes.set_xticks(TICKS, ["0", ".25", ".5", ".75", "1"])
        axes.grid(axis="x")
        axes.spines["left"].set_visible(False)
        for index, place in enumerate(places):
            if index % 2 == 0:
                axes.axhspan(place - heights[index] / 2, place + heights[index] / 2, color=BAND, lw=0, zorder=0)
        for row in section.rows:
            index = titles.index((row.title, row.entry is None))
            shift = (parts.index(row.part) - (len(parts) - 1) / 2) * _STEP
            shift *= 0.62 if row.entry is None else 1.0
            _mark(axes, row, metric, places[index] + shift, COLOURS[parts.index(row.part)])
    panels[0].set_ylim(sum(heights), 0)
    panels[0].set_yticks(places, names)
    for label, (_, reference) in zip(panels[0].get_yticklabels(), titles, strict=True):
        label.set_color(SOFT if reference else INK)
        label.set_fontstyle("italic" if reference else "normal")
    counts = {row.part: row.group.observations for row in section.rows}
    handles = [
        Line2D([], [], color=COLOURS[i], marker="o", markersize=6, lw=1.6, label=f"{PART_NOTES[p]} (n = {counts[p]})")
        for i, p in enumerate(parts)
    ]
    if any(row.paper for row in section.rows) and any(m.protocol == "official" for m in columns):
        handles.append(
            Line2D([], [], color=SOFT, marker="D", markersize=6.5, markerfacecolor="white", lw=0,
                   label=f"the paper's figure, on {paper.DATASET}")
        )  # fmt: skip
    _caption(drawn, "Methods and parts", section, handles, len(handles) if len(columns) > 2 else 1)
    return drawn


def _mark(axes: Axes, row: PaperRow, metric: Metric, y: float, colour: str) -> None:
    value, spread = figure(row.group, metric), interval(row.group, metric)
    if row.entry is None:
        if value is not None:
            axes.plot(value, y, "|", color=colour, markersize=7, markeredgewidth=1.8, clip_on=False)
        return
    if metric.protocol == "official" and metric.name in row.paper:
        axes.plot(row.paper[metric.name], y, "D", color=colour, markersize=7.5, markerfacecolor="white",
                  markeredgewidth=1.1, zorder=3, clip_on=False)  # fmt: skip
    if spread is not None:
        axes.plot(spread, (y, y), color=colour, lw=1.6, solid_capstyle="round", zorder=4, clip_on=False)
    if value is not None:
        axes.plot(value, y, "o", color=colour, markersize=5.5, zorder=5, clip_on=False)


def thresholds_figure(section: PaperSection) -> Figure:
    """Two panels, a curve per series; the paper's is dashed."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    shown = section.columns
    columns = [m for m in shown if m.protocol == "official"] or [m for m in shown if m.name in ("IoU", "F")]
    titles = list(dict.fromkeys(row.title for row in section.rows if row.entry))
    beside = any(row.paper for row in section.rows)
    drawn = new_figure(9.6, 4.5 + 0.2 * (len(titles) + beside))
    for axes, metric in zip(drawn.subplots(1, len(columns), sharey=True, squeeze=False)[0], columns, strict=True):
        head_of(axes, metric)
        axes.set_xlabel("voting threshold")
        axes.set_ylim(-0.02, 1.02)
        axes.set_yticks(TICKS, ["0", ".25", ".5", ".75", "1"])
        axes.grid(axis="y")
        axes.spines["left"].set_visible(False)
        axes.axvline(paper.VOTING_THRESHOLD, color=MARKED, lw=9, zorder=0.5, solid_capstyle="butt")
        _floor(axes, section, metric)
        drawn_thresholds = {row.threshold for row in section.rows if row.threshold is not None}
        if beside and metric.protocol == "official":
            known = sorted(paper.TABLE_3.items())
            drawn_thresholds |= set(paper.TABLE_3)
            axes.plot([t for t, _ in known], [f[metric.name] for _, f in known], color=SOFT, lw=1.3, ls=(0, (4, 3)),
                      marker="D", markersize=5, markerfacecolor="white", zorder=3, clip_on=False)  # fmt: skip
        for index, title in enumerate(titles):
            _curve(axes, [row for row in section.rows if row.title == title and row.entry], metric, index)
        ticks = sorted(drawn_thresholds)
        if len(ticks) <= 12:
            axes.set_xticks(ticks, [f"{tick:g}".removeprefix("0") or "0" for tick in ticks])
    handles: list[Any] = [
        Line2D([], [], color=_colour(i), marker="o", markersize=5.5, lw=1.8, label=clean(title))
        for i, title in enumerate(titles)
    ]
    if beside:
        handles.append(
            Line2D([], [], color=SOFT, marker="D", markersize=5, markerfacecolor="white", lw=1.3, ls=(0, (4, 3)),
                   label=f"the paper: {paper.SWEEP}")
        )  # fmt: skip
    handles.append(Patch(color=MARKED, label=f"{paper.VOTING_THRESHOLD:g}, the paper's choice"))
    _caption(drawn, "Voting thresholds", section, handles, 1)
    return drawn


def _floor(axes: Axes, section: PaperSection, metric: Metric) -> None:
    """The best of what looks at nothing, as a dotted line."""
    blind = {REFERENCE_TITLES[name] for name in BLIND_REFERENCES}
    rows = [row for row in section.rows if row.entry is None and row.title in blind]
    known = [(value, row.title) for row in rows if (value := figure(row.group, metric)) is not None]
    if known:
        value, title = max(known)
        axes.axhline(value, color=SOFT, lw=1.0, ls=(0, (1, 2.5)), zorder=1)
        axes.annotate(title, (0.0, value), (2, -3), xycoords=("axes fraction", "data"), textcoords="offset points",
                      va="top", fontsize=8, fontstyle="italic", color=SOFT)  # fmt: skip


def _colour(index: int) -> str:
    return COLOURS[index % len(COLOURS)]


def _curve(axes: Axes, rows: Sequence[PaperRow], metric: Metric, index: int) -> None:
    points = sorted(
        (row.threshold, value, interval(row.group, metric))
        for row in rows
        if row.threshold is not None and (value := figure(row.group, metric)) is not None
    )
    xs = [point[0] for point in points]
    spreads = [point[2] for point in points]
    if points and None not in spreads:
        lows, highs = zip(*(spread for spread in spreads if spread), strict=True)
        axes.fill_between(xs, lows, highs, color=_colour(index), alpha=0.14, lw=0, zorder=2)
    axes.plot(xs, [point[1] for point in points], color=_colour(index), lw=1.8, marker="o", markersize=5.5, zorder=4,
              clip_on=False)  # fmt: skip
