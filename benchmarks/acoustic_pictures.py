"""`python -m benchmarks.acoustic_pictures`: the plots of docs/acoustics.md.

python -m benchmarks.acoustic_closed_forms -o build/agreement
python -m benchmarks.acoustic_agreement -o build/agreement
python -m benchmarks.acoustic_pictures --agreement build/agreement -o docs/images
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from avs3d_bench.formats import files
from benchmarks.acoustic_closed_forms import FILTERED, SHOWN, STEP
from benchmarks.acoustic_measures import OCTAVES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Names and colours (Okabe and Ito).
TRACER, OTHER, CLOSED = ("tracer", "#0072b2"), ("soundspaces", "#d55e00"), ("closed form", "black")
#: Width and height of one plot (inches), and dots per inch.
WIDTH, HEIGHT, DPI = 4.6, 3.4, 90


def draw_decay(axes: Axes, closed: dict[str, Any]) -> None:
    """Schroeder's curves in the box of mirrors with a hard floor."""
    curves = closed["mirrors"]["hard floor"]["curve (dB)"]
    time = np.arange(0, SHOWN, STEP)
    styles = {
        "image sources": ("black", "-", 3.0),
        TRACER[0]: (TRACER[1], "-", 1.5),
        OTHER[0]: (OTHER[1], "-", 1.5),
        f"{TRACER[0]}, all scattered": (TRACER[1], ":", 1.5),
        f"{OTHER[0]}, all scattered": (OTHER[1], ":", 1.5),
    }
    for name, (colour, line, width) in styles.items():
        curve = np.array(curves[name])[: len(time)]
        axes.plot(time[: len(curve)], curve, color=colour, linestyle=line, linewidth=width, label=name)
    axes.set(ylim=(-40, 1), xlim=(0, 0.6), xlabel="s", ylabel="dB", title="Mirrors, hard floor: decay at 1 kHz")
    axes.legend(fontsize=7)


def draw_plaster(axes: Axes, closed: dict[str, Any]) -> None:
    """T30 per octave in a diffuse box of plaster."""
    for name, colour in (CLOSED, TRACER, OTHER):
        axes.semilogx(OCTAVES, closed["plaster"][name], "o-", color=colour, label=name)
    axes.semilogx(OCTAVES, closed["plaster"][FILTERED], "x:", color="black", label="closed form, as measured")
    axes.set(xlabel="Hz", ylabel="T30, s", ylim=(0, 1.2), title="Diffuse box of plaster")
    axes.set_xticks(OCTAVES, [str(band) for band in OCTAVES])
    axes.minorticks_off()
    axes.legend(fontsize=7)


def draw_levels(axes: Axes, closed: dict[str, Any]) -> None:
    """Level of all but the direct sound in a diffuse box against its absorption."""
    rows = closed["diffuse"]
    for name, colour in (CLOSED, TRACER, OTHER):
        axes.plot([float(a) for a in rows], [row["level (dB)"][name] for row in rows.values()], "o-", color=colour)
    axes.set(xlabel="absorption", ylabel="dB", title="Diffuse box: level of the reverberation")


def draw_coherence(axes: Axes, closed: dict[str, Any]) -> None:
    """Coherence of two microphones in the late field."""
    found = closed["coherence"]
    axes.plot(found["frequency (Hz)"], found["closed form"], color="black", label="sin(kd)/(kd)")
    axes.plot(found["frequency (Hz)"], found["measured"], "o", markersize=3, color=TRACER[1], label=TRACER[0])
    axes.set(xlabel="Hz", title="Two microphones 0.2 m apart: coherence")
    axes.legend(fontsize=7)


def draw_noise(axes: Axes, closed: dict[str, Any]) -> None:
    """Standard deviation of the late level over seeds against the number of rays."""
    rays = np.array([float(count) for count in closed["noise"]])
    spread = np.array(list(closed["noise"].values()))
    middle = np.exp(np.mean(np.log(spread * np.sqrt(rays))))
    axes.loglog(rays, middle / np.sqrt(rays), color="black", label="1/√N")
    axes.loglog(rays, spread, "o", color=TRACER[1], label=TRACER[0])
    axes.set(xlabel="rays", ylabel="dB", title="Standard deviation of the late level")
    axes.legend(fontsize=7)


def draw_room_decay(axes: Axes, rooms: dict[str, Any]) -> None:
    """T30 of both engines in every room, one colour per octave."""
    for k, band in enumerate(OCTAVES):
        pairs = [(row["T30 of SoundSpaces (s)"][k], row["T30 of the tracer (s)"][k]) for row in rooms["rooms"].values()]
        axes.plot(*zip(*pairs, strict=True), "o", markersize=4, label=f"{band} Hz")
    ends = np.array([0.2, 0.9])
    axes.plot(ends, ends, color="black", linewidth=0.8)
    for factor in (0.9, 1.1):
        axes.plot(ends, factor * ends, color="black", linewidth=0.5, linestyle=":")
    axes.set(xlabel="soundspaces, s", ylabel="tracer, s", title="T30 in 12 rooms (dotted: ±10 %)")
    axes.legend(fontsize=7)


def draw_room_levels(axes: Axes, rooms: dict[str, Any]) -> None:
    """Difference of level and of DRR in every room."""
    rows = rooms["rooms"].values()
    axes.plot([row["level (dB)"] for row in rows], [row["DRR (dB)"] for row in rows], "o", color=TRACER[1])
    axes.axvspan(-1, 1, color="0.93")
    axes.axhspan(-1.5, 1.5, color="0.88", alpha=0.5)
    axes.set(xlabel="level, dB", ylabel="DRR, dB", xlim=(-2, 2), ylim=(-2, 5), title="tracer − soundspaces in 12 rooms")


def draw(path: Path, plots: list[Callable[[Axes], None]]) -> None:
    """Write a row of plots as a PNG; the same figures give the same bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH * len(plots), HEIGHT), layout="constrained")
    FigureCanvasAgg(figure)
    for plot, axes in zip(plots, np.atleast_1d(figure.subplots(1, len(plots))), strict=True):
        plot(axes)
        axes.grid(linewidth=0.3)
    with files.atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=DPI, metadata={"Software": None})


@click.command()
@click.option("--agreement", type=click.Path(exists=True, path_type=Path), required=True, help="Folder of the figures.")
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="Folder to write the pictures to.")
def main(agreement: Path, output: Path) -> None:
    """Draw the plots of docs/acoustics.md."""
    closed = files.read_json(agreement / "closed_forms.json")
    rooms = files.read_json(agreement / "agreement.json")
    draw(
        output / "acoustics-boxes.png",
        [lambda axes: draw_decay(axes, closed), lambda axes: draw_plaster(axes, closed),
         lambda axes: draw_levels(axes, closed)],
    )  # fmt: skip
    draw(
        output / "acoustics-rooms.png",
        [lambda axes: draw_room_decay(axes, rooms), lambda axes: draw_room_levels(axes, rooms)],
    )
    draw(
        output / "acoustics-noise.png",
        [lambda axes: draw_noise(axes, closed), lambda axes: draw_coherence(axes, closed)],
    )


if __name__ == "__main__":
    main()
