"""One picture per observation: frames with their masks, a map of path, source and heading, and what is heard."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import spectrogram

from avs3d_bench import files
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.inspector.contact_scenes import (
    azimuth_line,
    draw_azimuths,
    draw_lanes,
    instance_style,
    mark_sources,
    overlay_sources,
    scene_summary,
    write_audible,
)
from avs3d_bench.inspector.floorplan import MARGIN, PIXELS_PER_METRE, Bounds, paint_plan, read_plan
from avs3d_bench.inspector.labels import LabelBox, place_labels
from avs3d_bench.inspector.sound_scenes import ShownScene, read_sound_scene
from avs3d_bench.layout import FRAME_RATE, is_test
from avs3d_bench.levels import ild_db
from avs3d_bench.outputs import PNG_METADATA, PNG_OF_OURS, check_replaceable
from avs3d_bench.schema import ObservationRecord
from avs3d_bench.templates import words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK = "#1f2430"
MUTED = "#8a90a0"
SOURCE = "#e4572e"
SILENT = "#4b7bec"
PATH = "#1b998b"
#: Around the floor plan, and pixels of the plan a metre.
OUTSIDE, PLAN_SCALE = "#ece9e2", 2 * PIXELS_PER_METRE
#: Pixels per side of a thumbnail.
THUMBNAIL = 320
#: The brightest colour of the spectrogram stands for this density at least (dB re 1/Hz): silence is dark.
QUIETEST_DB = -110.0


def draw_contact_sheets(
    root: Path,
    output: Path,
    *,
    only: Sequence[str] = (),
    columns: int = 8,
    advance: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Draw a PNG per observation of the dataset ``root`` into ``output``; returns the files.

    ``advance`` is called with the number of sheets that are done and that of all, from 0 on.

    Raises:
        UsageError: if ``output`` holds another file of such a name.
        Avs3dError: if ``root`` is no dataset, a file in it cannot be read, or ``output`` cannot be written.
    """
    drawn: list[Path] = []
    chosen = Dataset(root).select(*only)
    for number, observation in enumerate(chosen):
        if advance is not None:
            advance(number, len(chosen))
        path = output / f"{observation.key.replace('/', '_')}.png"
        check_replaceable(path, (PNG_OF_OURS,))
        canvas: Any = draw_contact_sheet(observation, columns).canvas
        with files.atomic_path(path) as temporary:
            # No creation date, no version: the same observation gives the same picture.
            # `savefig` would lay out all once more, without drawing it.
            canvas.print_png(temporary, metadata=PNG_METADATA)
        drawn.append(path)
    return drawn


def draw_contact_sheet(observation: Observation, columns: int = 8) -> Figure:
    """The sheet of one observation that carries our observation.json.

    Raises:
        Avs3dError: if it does not (the official release has no poses of sources to draw).
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    record = observation.record
    if record is None:
        raise Avs3dError(f"{observation.key}: no observation.json, so there is nothing to draw a map from")
    with mpl.rc_context({"font.size": 11, "text.color": INK, "axes.labelcolor": INK, "font.family": "DejaVu Sans"}):
        scene = read_sound_scene(observation)
        # The names of what is audible stand below the pictures of a sound scene.
        lines = 0 if scene is None else max(1, *(len(scene.audible(number)) for number in range(len(observation))))
        upper = 5.0 + 0.25 * lines
        figure = Figure(figsize=(20, 12.6 + 0.28 * lines), facecolor="white", layout="constrained", dpi=100)
        FigureCanvasAgg(figure)
        figure.suptitle(_title(record, scene), fontsize=17, x=0.01, ha="left")
        halves: Any = figure.subfigures(2, 1, height_ratios=[upper, 6.2])
        top, bottom = halves
        _frames(top, observation, record, columns, scene)
        left, right = bottom.subfigures(1, 2, width_ratios=[1.0, 1.35])
        plan = left.subplots()
        labels = _map(plan, observation, record, scene)
        _sound(right, observation, record, scene)
        # How many pixels a metre has is known once all is laid out; it stays as it is.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        _name_objects(figure, plan, labels)
    return figure


def _title(record: ObservationRecord, scene: ShownScene | None) -> str:
    if scene is not None:
        sounds = scene_summary(scene, record)
    else:
        sounds = f"{words(record.category)} sounds{' on its way' if record.moves else ''}"
    visible = sum(frame.visible_pixels > 0 for frame in record.frames)
    t30 = f", T30 {record.acoustics.t30:.2f} s" if record.acoustics.t30 else ""
    return (
        f"{record.key}: {sounds}; "
        f"visible in {visible} of {len(record.frames)} frames{t30}; sound by {record.acoustics.backend}"
    )


def overlay(rgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """``rgb`` (H, W, 3) with the mask (H, W) tinted and outlined."""
    import cv2

    out = rgb.astype(np.float32)
    out[~mask] = 0.45 * out[~mask] + 0.55 * 235
    edge = cv2.dilate(mask.astype(np.uint8), np.ones((7, 7), np.uint8)).astype(bool) & ~mask
    out[edge] = (228, 87, 46)
    return np.asarray(out, dtype=np.uint8)


def _thumbnail(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    import cv2

    if pixels.shape[0] <= THUMBNAIL:
        return pixels
    return np.asarray(cv2.resize(pixels, (THUMBNAIL, THUMBNAIL), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def chosen_frames(visible: Sequence[int], count: int) -> list[int]:
    """The frames of a sheet: those that show the object, spread over time, then others if these are too few.

    Args:
        visible: pixels of the object in each frame.
        count: how many frames are wanted.

    Examples:
        >>> chosen_frames([0, 0, 5, 5, 5, 0, 7, 0], 2)
        [2, 6]
        >>> chosen_frames([0, 9, 0, 0, 0], 3)
        [1, 0, 4]
    """
    shows = [number for number, pixels in enumerate(visible) if pixels]
    others = [number for number, pixels in enumerate(visible) if not pixels]
    first = _spread(shows, count)
    return first + _spread(others, count - len(first))


def _spread(numbers: Sequence[int], count: int) -> list[int]:
    """At most ``count`` of them, evenly."""
    kept = min(count, len(numbers))
    if kept < 1:
        return []
    return [numbers[at] for at in np.linspace(0, len(numbers) - 1, kept).round().astype(int)]


def _frames(
    figure: Any, observation: Observation, record: ObservationRecord, columns: int, scene: ShownScene | None
) -> None:
    chosen = chosen_frames([frame.visible_pixels for frame in record.frames], columns)
    axes = figure.subplots(2, len(chosen), squeeze=False)
    for column, index in enumerate(chosen):
        frame = observation.frames[index]
        rgb, mask = frame.rgb(), frame.mask()
        axes[0, column].imshow(_thumbnail(rgb))
        if scene is None:
            marked = overlay(rgb, mask)
        else:
            marked = overlay_sources(rgb, mask, frame.instance_ids(), scene.colours)
            write_audible(axes[1, column], scene, int(index))
        axes[1, column].imshow(_thumbnail(marked))
        split = "test" if is_test(int(index)) else "train"
        axes[0, column].set_title(f"{frame.name} ({split})", fontsize=10)
        info = record.frames[index]
        side = f", azimuth {info.azimuth:+.0f}°" if scene is None else ""
        axes[1, column].set_title(f"{info.visible_pixels} px{side}", fontsize=10, color=MUTED)
        for row in (0, 1):
            axes[row, column].set_axis_off()


@dataclass(frozen=True)
class _Label:
    """The name of an object on the map: its box (left, top, right, bottom) in metres, and the colour of the text."""

    box: tuple[float, float, float, float]
    text: str
    colour: Any


def _map(axes: Any, observation: Observation, record: ObservationRecord, scene: ShownScene | None) -> list[_Label]:
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
        style: Any = SOURCE if instance.sounding else SILENT
        name = words(instance.category)
        if scene is not None:
            style, name = instance_style(scene, instance.id, sounding=instance.sounding), scene.names[instance.id]
        axes.fill(
            [x0, x1, x1, x0], [z0, z0, z1, z1], facecolor=_with_alpha(style, 0.25), edgecolor=style, linewidth=2.2
        )
        text = f"{name} (sounds)" if instance.sounding else name
        labels.append(_Label((x0, z0, x1, z1), text, style if instance.sounding or scene is None else INK))
    if record.moves:
        way = np.array([record.source_at(frame) for frame in record.frames])
        axes.plot(way[:, 0], way[:, 2], color=SOURCE, linewidth=2, label="path of the source", zorder=3)
    if record.source_position is not None and scene is None:
        label = "source at the first frame" if record.moves else "source"
        x, _, z = record.source_position
        axes.plot(x, z, "*", color=SOURCE, markersize=16, markeredgecolor="white", label=label, zorder=5)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(high[1], low[1])
    if scene is not None:
        mark_sources(axes, scene)
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


def _name_objects(figure: Figure, axes: Any, labels: Sequence[_Label]) -> None:
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


def _sound(figure: Any, observation: Observation, record: ObservationRecord, scene: ShownScene | None) -> None:
    if scene is None:
        upper, lower = figure.subplots(2, 1)
    else:
        lanes, upper, lower = figure.subplots(3, 1, height_ratios=[max(1.0, 0.4 * len(scene.sources) + 0.4), 1.2, 1.6])
        draw_lanes(lanes, scene, len(record.frames))
    times = [frame.time + 0.5 / FRAME_RATE for frame in record.frames]  # the middle of each clip
    difference = [ild_db(frame.rms_left, frame.rms_right) for frame in record.frames]
    upper.axhline(0, color=MUTED, linewidth=0.8)
    upper.bar(times, difference, width=0.9, color=PATH, label="ILD (right − left)")
    upper.set_ylabel("ILD (dB)")
    side = upper.twinx()
    if scene is None:
        azimuth = [frame.azimuth for frame in record.frames if frame.azimuth is not None]
        side.plot(*azimuth_line(times, azimuth), color=SOURCE, linewidth=1.6, label="azimuth of the source")
    else:
        draw_azimuths(side, scene, times)
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
