"""The picture of a sweep: a column per figure, a row per setting of the other parameters, a curve per method.

Needs matplotlib (extra ``plot``). The same scores give the same bytes, as in `evaluators.reporting.tables_plot`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from avs3d_bench.commands.outputs import PNG_METADATA
from evaluators.reporting.pages import clean, figure, interval
from evaluators.reporting.sweep_curve import Sweep, SweepCurve, Value, value_text, values_of
from evaluators.reporting.tables_plot import COLOURS, SOFT, TICKS, encode, head_of, new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from avs3d_bench.contract.scores import Metric

_TITLES = {
    "acoustics.absorption_scale": "absorption scale",
    "background.snr_db": "level of the sources above the background (dB)",
    "background.kind": "kind of background",
}
_MARKERS = "osD^vP"
#: Share of the distance between two values by which the methods are moved apart, so that their intervals show.
_APART = 0.09
#: Room beside the first and the last value, of the distance between two.
_MARGIN = 0.35


def draw(sweep: Sweep) -> bytes:
    """The PNG.

    Raises:
        ModuleNotFoundError: without matplotlib.
    """
    with style():
        return encode(sweep_figure(sweep), "png", PNG_METADATA)


def sweep_figure(sweep: Sweep) -> Figure:
    """Panels with a common axis of values, which are equally far apart: reverberant or clean at the left."""
    from matplotlib.lines import Line2D

    settings = list(dict.fromkeys(curve.setting for curve in sweep.curves))
    methods = list(dict.fromkeys(curve.method for curve in sweep.curves))
    values = values_of(sweep)
    drawn = new_figure(1.6 + 3.6 * len(sweep.metrics), 1.6 + 2.9 * len(settings) + 0.2 * len(methods))
    panels = drawn.subplots(len(settings), len(sweep.metrics), sharex=True, sharey=True, squeeze=False)
    for row, setting in zip(panels, settings, strict=True):
        curves = [curve for curve in sweep.curves if curve.setting == setting]
        for axes, metric in zip(row, sweep.metrics, strict=True):
            head_of(axes, metric)
            axes.grid(axis="y")
            axes.spines["left"].set_visible(False)
            for curve in curves:
                _curve(axes, curve, metric, values, methods.index(curve.method), len(methods))
        if setting:
            said = ", ".join(f"{_TITLES.get(name, name)} {value_text(value)}" for name, value in setting)
            row[0].set_ylabel(said, fontsize=8.5, color=SOFT)
    ticks = _ticks(sweep, values)
    for axes in panels[-1]:
        axes.set_xticks(range(len(values)), ticks)
        axes.set_xlabel(_TITLES.get(sweep.field, sweep.field) + (", and mean T30" if "\n" in ticks[0] else ""))
        axes.set_xlim(-_MARGIN, len(values) - 1 + _MARGIN)
    _limits(sweep, panels[0][0])
    drawn.suptitle(f"{clean(sweep.dataset)}: mean and 95 % interval", x=0.012, ha="left", fontsize=12.5)
    handles = [
        Line2D([], [], color=COLOURS[n % len(COLOURS)], marker=_MARKERS[n % len(_MARKERS)], markersize=5.5, lw=1.8,
               label=clean(method))
        for n, method in enumerate(methods)
    ]  # fmt: skip
    drawn.legend(handles=handles, loc="outside lower left", ncols=1, frameon=False, labelcolor=SOFT)
    return drawn


def _limits(sweep: Sweep, axes: Axes) -> None:
    """Shares have an axis from 0 to 1; a figure in metres has one of its own."""
    if all(not metric.unit for metric in sweep.metrics):
        axes.set_ylim(-0.02, 1.02)
        axes.set_yticks(TICKS, ["0", ".25", ".5", ".75", "1"])


def _ticks(sweep: Sweep, values: Sequence[Value]) -> list[str]:
    """The values; those of the absorption with the mean T30 below."""
    times: dict[Value, list[float]] = {}
    for curve in sweep.curves:
        for point in curve.points:
            if point.t30 is not None:
                times.setdefault(point.value, []).append(point.t30)
    if sweep.field != "acoustics.absorption_scale" or len(times) < len(values):
        return [value_text(value) for value in values]
    return [f"{value_text(value)}\n{sum(times[value]) / len(times[value]):.2f} s" for value in values]


def _curve(axes: Axes, curve: SweepCurve, metric: Metric, values: Sequence[Value], index: int, count: int) -> None:
    colour, shift = COLOURS[index % len(COLOURS)], _APART * (index - (count - 1) / 2)
    found = sorted(
        (values.index(point.value) + shift, value, interval(point.group, metric))
        for point in curve.points
        if (value := figure(point.group, metric)) is not None
    )
    axes.plot([x for x, _, _ in found], [y for _, y, _ in found], color=colour, lw=1.8, zorder=4, clip_on=False,
              marker=_MARKERS[index % len(_MARKERS)], markersize=5.5)  # fmt: skip
    for x, _, spread in found:
        if spread is not None:
            axes.plot((x, x), spread, color=colour, lw=1.4, alpha=0.65, zorder=3, clip_on=False)
