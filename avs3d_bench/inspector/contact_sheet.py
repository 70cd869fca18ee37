"""One picture per observation: frames with their masks, a map of path, source and heading, and what is heard."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.commands.outputs import PNG_METADATA, PNG_OF_OURS, check_replaceable
from avs3d_bench.contract.layout import is_test
from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files
from avs3d_bench.inspector.contact_plots import INK, MUTED, draw_map, draw_sound, lay_out_map, write_audible
from avs3d_bench.inspector.facts import read_facts
from avs3d_bench.inspector.pictures import SOUNDING
from avs3d_bench.inspector.sources import Colour, ShownSound
from avs3d_bench.text.templates import words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Pixels per side of a thumbnail.
THUMBNAIL = 320


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
    dataset = Dataset(root)
    chosen = dataset.select(*only)
    for number, observation in enumerate(chosen):
        if advance is not None:
            advance(number, len(chosen))
        path = output / f"{observation.key.replace('/', '_')}.png"
        check_replaceable(path, (PNG_OF_OURS,))
        canvas: Any = draw_contact_sheet(dataset, observation.key, columns).canvas
        with files.atomic_path(path) as temporary:
            # No creation date, no version: the same observation gives the same picture.
            # `savefig` would lay out all once more, without drawing it.
            canvas.print_png(temporary, metadata=PNG_METADATA)
        drawn.append(path)
    return drawn


def draw_contact_sheet(dataset: Dataset, key: str, columns: int = 8) -> Figure:
    """The sheet of one observation that carries our observation.json.

    Raises:
        Avs3dError: if it does not (the official release has no poses of sources to draw).
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    observation = dataset[key]
    record, facts = observation.record, read_facts(dataset, observation)
    sound = facts.sound
    if record is None or sound is None:
        raise Avs3dError(f"{key}: no observation.json, so there is nothing to draw a map from")
    with mpl.rc_context({"font.size": 11, "text.color": INK, "axes.labelcolor": INK, "font.family": "DejaVu Sans"}):
        # The names of what is audible stand below the pictures, if that changes.
        lines = 0 if sound.always else max(1, *(len(sound.audible(number)) for number in range(len(observation))))
        upper = 5.0 + 0.25 * lines
        figure = Figure(figsize=(20, 12.6 + 0.28 * lines), facecolor="white", layout="constrained", dpi=100)
        FigureCanvasAgg(figure)
        figure.suptitle(_title(record, sound), fontsize=17, x=0.01, ha="left")
        halves: Any = figure.subfigures(2, 1, height_ratios=[upper, 6.2])
        top, bottom = halves
        _frames(top, observation, record, columns, sound)
        left, right = bottom.subfigures(1, 2, width_ratios=[1.0, 1.35])
        plan = left.subplots()
        drawing = lay_out_map(plan, observation, facts)
        draw_sound(right, observation, record, sound)
        # How many pixels a metre has is known once all is laid out; it stays as it is.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        draw_map(plan, drawing)
    return figure


def _title(record: ObservationRecord, sound: ShownSound) -> str:
    sounds = sound.title
    if sound.always:
        sounds += " sounds on its way" if record.moves else " sounds"
    elif sound.sources:
        away = sum(source.off_screen for source in sound.sources)
        sounds += f", {away} off-screen" if away and len(sound.sources) > 1 else ""
        sounds += f" over {words(sound.background.kind)}" if sound.background else ""
    visible = sum(frame.visible_pixels > 0 for frame in record.frames)
    t30 = f", T30 {record.acoustics.t30:.2f} s" if record.acoustics.t30 else ""
    return (
        f"{record.key}: {sounds}; "
        f"visible in {visible} of {len(record.frames)} frames{t30}; sound by {record.acoustics.backend}"
    )


def overlay(
    rgb: NDArray[np.uint8],
    mask: NDArray[np.bool_],
    ids: NDArray[np.integer] | None = None,
    colours: Mapping[int, Colour] | None = None,
) -> NDArray[np.uint8]:
    """``rgb`` (H, W, 3) faded around the mask, and every marked instance outlined in its colour.

    Args:
        rgb: the frame.
        mask: (H, W) what is audible and visible.
        ids: (H, W) instance ids; None: the mask is one instance.
        colours: instance id → RGB; None: that of the sounding object.
    """
    import cv2

    if ids is None or colours is None:
        ids, colours = mask.astype(np.uint8), {1: SOUNDING}
    out = rgb.astype(np.float32)
    out[~mask] = 0.45 * out[~mask] + 0.55 * 235
    for number in np.unique(ids[mask]):
        one = mask & (ids == number)
        edge = cv2.dilate(one.astype(np.uint8), np.ones((7, 7), np.uint8)).astype(bool) & ~mask
        out[edge] = colours.get(int(number), (255, 255, 255))
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
    figure: Figure, observation: Observation, record: ObservationRecord, columns: int, sound: ShownSound
) -> None:
    chosen = chosen_frames([frame.visible_pixels for frame in record.frames], columns)
    axes = figure.subplots(2, len(chosen), squeeze=False)
    for column, index in enumerate(chosen):
        frame = observation.frames[index]
        rgb, mask = frame.rgb(), frame.mask()
        axes[0, column].imshow(_thumbnail(rgb))
        if sound.always:
            marked = overlay(rgb, mask)
        else:
            marked = overlay(rgb, mask, frame.instance_ids(), sound.colours)
            write_audible(axes[1, column], sound, int(index))
        axes[1, column].imshow(_thumbnail(marked))
        split = "test" if is_test(int(index)) else "train"
        axes[0, column].set_title(f"{frame.name} ({split})", fontsize=10)
        info = record.frames[index]
        side = f", azimuth {info.azimuth:+.0f}°" if sound.always else ""
        axes[1, column].set_title(f"{info.visible_pixels} px{side}", fontsize=10, color=MUTED)
        for row in (0, 1):
            axes[row, column].set_axis_off()
