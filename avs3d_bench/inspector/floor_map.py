"""The map of an observation from above: one list of shapes for its page (SVG), its film and its contact sheet.

Shapes are in pixels of the drawing, whose longer side is `FloorMap.side`: whoever shows it scales all of it, with its
names. `templates/map.html.j2` writes them as SVG, whose moving ones `map.js` moves; `FloorMap.paint` draws them with
matplotlib.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.dataset import Observation
from avs3d_bench.inspector.facts import PageFacts
from avs3d_bench.inspector.floorplan import Bounds, map_bounds, plan_picture
from avs3d_bench.inspector.labels import LabelBox, place_labels
from avs3d_bench.inspector.pictures import SOUNDING, hexadecimal
from avs3d_bench.inspector.video_text import U8, Colour, fitting, text_width

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_INK: Colour = (31, 36, 48)
_GREY: Colour = (110, 116, 124)
_WHITE: Colour = (255, 255, 255)
AGENT: Colour = (0, 114, 178)
#: Outside of all floors.
OUTSIDE: Colour = (236, 233, 226)
#: The path that is still ahead in a film, and RGB of the path over time: violet, magenta, amber.
_AHEAD: Colour = (150, 156, 164)
_TIME = ((76, 52, 168), (196, 58, 124), (242, 160, 61))
#: Length of the drawn field of view (m), and its angle where no camera is known (degrees).
_REACH, _HFOV = 0.95, 90.0
#: Widths of letters in the bold fonts of pages and matplotlib, in those of OpenCV's font, and the height of a line of
#: text, in sizes of the font.
_BOLD, _LINE = 1.25, 1.35
#: Longer side of a film's map, in widths of the picture; and of its drawing in pixels, with the size of its names.
FILM_SHARE, _FILM = 0.3, (260.0, 11.0)


@dataclass(frozen=True, eq=False)
class Shape:
    """One shape of a map.

    Attributes:
        kind: key of `_STYLES`; the classes of the element in a page.
        points: (N, 2) of its outline or line, around ``at``.
        colour: RGB in place of that of its kind.
        text: what is written around ``at``; None: it is no text.
        at: where it is.
        turn: angle that it is turned by, degrees.
    """

    kind: str
    points: NDArray[np.float64]
    colour: Colour | None = None
    text: str | None = None
    at: tuple[float, float] = (0.0, 0.0)
    turn: float = 0.0

    @property
    def is_line(self) -> bool:
        """Whether it has no area."""
        return _STYLES[self.kind].fill is None

    @property
    def placed(self) -> NDArray[np.float64]:
        """Its points in the drawing."""
        cos, sin = math.cos(math.radians(self.turn)), math.sin(math.radians(self.turn))
        return np.asarray(self.points @ np.array([[cos, sin], [-sin, cos]]) + self.at, dtype=np.float64)


class _ShapeStyle(NamedTuple):
    """How matplotlib draws a kind of shape; style.css says how a page does. An area of no opacity (None) is a line."""

    colour: Colour
    width: float
    fill: float | None = None
    edge: Colour | None = None
    area: Colour | None = None
    dash: Any = "-"


_STYLES = {
    "thing sounds": _ShapeStyle(SOUNDING, 2, 0.25),
    "thing twin": _ShapeStyle(SOUNDING, 2, 0.08, dash=(0, (2, 1.5))),
    "thing other": _ShapeStyle(_GREY, 2, 0.25),
    "way": _ShapeStyle(SOUNDING, 2.5, dash=":"),
    "halo": _ShapeStyle(_WHITE, 7),
    "step": _ShapeStyle(_AHEAD, 3),
    "wedge": _ShapeStyle((88, 180, 230), 1, 0.45, edge=_WHITE),
    "listener": _ShapeStyle(AGENT, 2, 1.0, edge=_WHITE),
    "source": _ShapeStyle(SOUNDING, 1.5, 1.0, edge=_WHITE),
    "source hollow": _ShapeStyle(SOUNDING, 2, 1.0, area=_WHITE),
    "leader": _ShapeStyle(_INK, 1),
    "scale": _ShapeStyle(_INK, 1.5),
    "label": _ShapeStyle(_INK, 0),
    "label away": _ShapeStyle(_INK, 0),
    "label sounds": _ShapeStyle(SOUNDING, 0),
}
_CIRCLE = np.array([(math.cos(a), math.sin(a)) for a in np.linspace(0, 2 * math.pi, 24, endpoint=False)])
_STAR = np.array(
    [((4 if i % 2 else 9) * math.sin(i * math.pi / 5), (-4 if i % 2 else -9) * math.cos(i * math.pi / 5))
     for i in range(10)]
)  # fmt: skip
_ARROW = np.array([(12.0, 0.0), (-7.0, -8.0), (-3.0, 0.0), (-7.0, 8.0)])
#: Distance from the border of the map at which the arrow to a source outside of it lies (pixels).
_INSET = 18.0


def path_colour(number: int, frames: int) -> Colour:
    """RGB of the path at frame ``number``: time as colour."""
    at = number / max(1, frames - 1) * (len(_TIME) - 1)
    red, green, blue = (round(float(np.interp(at, range(len(_TIME)), channel))) for channel in zip(*_TIME, strict=True))
    return red, green, blue


@dataclass(frozen=True, eq=False)
class FloorMap:
    """The drawing.

    Attributes:
        facts: of the observation.
        bounds: of the shown area, metres.
        side: longer side of the drawing, pixels.
        text: size of the names, pixels.
        object_names: whether objects are named; sources of other rooms always are.
    """

    facts: PageFacts
    bounds: Bounds
    side: float = 560.0
    text: float = 17.0
    object_names: bool = True

    @classmethod
    def of(cls, facts: PageFacts, **values: Any) -> FloorMap | None:
        """The map of an observation; None if no frame has a pose."""
        bounds = map_bounds(facts)
        return None if bounds is None else cls(facts, bounds, **values)

    @property
    def scale(self) -> float:
        """Pixels a metre."""
        return self.side / max(self.bounds.width, self.bounds.height)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, pixels."""
        return self.bounds.width * self.scale, self.bounds.height * self.scale

    def place(self, point: Sequence[float]) -> tuple[float, float]:
        """Where (x, y, z) is in the drawing."""
        return (point[0] - self.bounds.left) * self.scale, (point[2] - self.bounds.top) * self.scale

    def ground(self, number: int | None = None) -> list[Shape]:
        """Objects and paths; of the paths what is behind in frame ``number`` in colour, or all of it."""
        moments, lanes = self.facts.moments, self.facts.lanes
        shapes = []
        for instance, box in zip(self.facts.instances, self._boxes, strict=True):
            if instance.id in self.facts.moving and number is not None:
                continue  # in a film it is elsewhere: the star of a source shows where it is now
            kind = "sounds" if instance.sounding else "twin" if self.facts.is_twin(instance) else "other"
            colour = lanes.colours[instance.id] if lanes and kind != "other" else None
            corners = [(box.left, box.top), (box.right, box.top), (box.right, box.bottom), (box.left, box.bottom)]
            shapes.append(_shape(f"thing {kind}", corners, colour))
        for way in self.facts.ways:
            passed = way if number is None else way[: number + 1]
            shapes.append(_shape("way", [self.place(point) for point in passed]))
        at = [self.place(m.position) if m.position else None for m in moments]
        shapes.append(_shape("halo", [p for p in at if p]))
        for i in range(1, len(at)):
            start, end = at[i - 1], at[i]
            if start and end:
                colour = path_colour(i, len(at)) if number is None or i <= number else None
                shapes.append(_shape("step", [start, end], colour))
        return shapes

    def agent(self, number: int | None = None) -> list[Shape]:
        """The camera with its field of view; without a number at the origin, looking along x."""
        half = math.radians(self.facts.hfov or _HFOV) / 2
        arc = [(math.cos(a), math.sin(a)) for a in np.linspace(-half, half, 24)]
        shapes = [
            _shape("wedge", _REACH * self.scale * np.array([(0.0, 0.0), *arc])),
            _shape("listener", 5.5 * _CIRCLE),
        ]
        if number is None:
            return shapes
        moment = self.facts.moments[number]
        if moment.position is None or moment.heading is None:
            return []
        turn = math.degrees(math.atan2(moment.heading[1], moment.heading[0]))
        return [replace(shape, at=self.place(moment.position), turn=turn) for shape in shapes]

    def sources(self, number: int | None = None) -> list[Shape]:
        """A star for each source, hollow if it is not audible in that frame; an arrow if it is off the map.

        Without a number all are filled, and one that moves is where it starts.
        """
        if self.facts.lanes is None:
            known = [m.source for m in self.facts.moments if m.source]
            now = known[:1] if number is None else [self.facts.moments[number].source]
            return [replace(_shape("source", _STAR), at=self.place(source)) for source in now if source]
        shapes = []
        middle = np.array(self.size) / 2
        for source in self.facts.lanes.sources:
            at = np.array(self.place(source.places[number or 0] if source.places else source.record.position))
            away = at - middle
            share = float(np.min((middle - _INSET) / np.maximum(1e-9, np.abs(away))))
            kind = "source hollow" if number is not None and source.heard[number] is None else "source"
            shape = _shape(kind, _STAR if share >= 1 else _ARROW, source.colour)
            x, y = (middle + away * min(1.0, share)).tolist()
            shapes.append(replace(shape, at=(x, y), turn=0.0 if share >= 1 else math.degrees(math.atan2(*away[::-1]))))
        return shapes

    @cached_property
    def labels(self) -> list[Shape]:
        """Names, so that none overlaps another, with lines to what is further away; and the length of a metre."""
        width, height = self.size
        lanes = self.facts.lanes
        wanted: list[tuple[LabelBox, str, str]] = []
        for source, mark in zip(lanes.sources if lanes else (), self.sources() if lanes else (), strict=True):
            if source.off_screen:
                x, y = mark.at
                wanted.append((LabelBox(x - 10, y - 10, x + 10, y + 10), source.name, "label away"))
        for instance, box in zip(self.facts.instances, self._boxes, strict=True):
            if not self.object_names:
                break
            name = self.facts.sound.names[instance.id] if self.facts.sound else ""
            if lanes is None:
                name += ", sounds" if instance.sounding else ", silent twin" if self.facts.is_twin(instance) else ""
            wanted.append((box, name, "label sounds" if instance.sounding and lanes is None else "label"))
        texts = [fitting(text, self.text, (width - 16) / _BOLD) for _, text, _ in wanted]
        line = _LINE * self.text
        bar, metre = self._scale_bar()
        sizes = [(_BOLD * text_width(text, self.text) + 0.4 * self.text, line) for text in texts]
        places = place_labels([mark for mark, *_ in wanted], sizes, LabelBox(4, 4, width - 4, height - 4), taken=[bar])
        names, leaders = [], []
        for (target, _, kind), text, box in zip(wanted, texts, places, strict=True):
            near, end = target.nearest(box), box.nearest(target)
            if math.dist(near, end) > 0.75 * line:
                leaders.append(_shape("leader", [near, end]))
            names.append(_text(kind, text, ((box.left + box.right) / 2, (box.top + box.bottom) / 2)))
        return [*leaders, *names, *metre]

    def _scale_bar(self) -> tuple[LabelBox, list[Shape]]:
        """A bar of a metre with its length above it, and the room that it takes."""
        bottom, letters = self.size[1] - 12, _BOLD * text_width("1 m", self.text)
        left = 12 + max(0.0, (letters - self.scale) / 2)
        right = left + self.scale
        line = _shape("scale", [(left, bottom - 5), (left, bottom), (right, bottom), (right, bottom - 5)])
        text = _text("scale", "1 m", ((left + right) / 2, bottom - 6 - _LINE / 2 * self.text))
        room = LabelBox(6, bottom - 8 - _LINE * self.text, max(right, left + letters) + 6, bottom + 6)
        return room, [line, text]

    @property
    def _boxes(self) -> list[LabelBox]:
        """Of the objects, at least three pixels wide and high."""
        found = []
        for low, high in ((self.place(i.bounds[0]), self.place(i.bounds[1])) for i in self.facts.instances):
            found.append(LabelBox(*low, max(high[0], low[0] + 3), max(high[1], low[1] + 3)))
        return found

    def show_plan(self, axes: Axes, observation: Observation, scale: float) -> None:
        """Draw the floor plan, ``scale`` pixels a metre, into axes that get the limits of the map.

        Raises:
            Avs3dError: if the sparse model is missing or damaged.
        """
        box = self.bounds
        size = max(1, round(box.width * scale)), max(1, round(box.height * scale))
        axes.set_facecolor(hexadecimal(OUTSIDE))
        axes.imshow(
            plan_picture(observation, box, size),
            extent=(box.left, box.left + box.width, box.top + box.height, box.top), interpolation="antialiased",
        )  # fmt: skip

    def paint(self, axes: Axes, shapes: Sequence[Shape]) -> None:
        """Draw shapes into axes in metres, whose size in pixels is settled."""
        from matplotlib.patheffects import withStroke

        figure: Any = axes.get_figure(root=True)
        pixel = axes.get_window_extent().width / self.size[0] * 72 / figure.dpi
        for order, shape in enumerate(shapes, start=3):
            style = _STYLES[shape.kind]
            colour = shape.colour or style.colour
            x, y = (shape.placed / self.scale + (self.bounds.left, self.bounds.top)).T
            if shape.text is not None:
                axes.text(
                    x[0], y[0], shape.text, fontsize=pixel * self.text, color=hexadecimal(colour), weight="bold",
                    ha="center", va="center_baseline", zorder=order,
                    path_effects=[withStroke(linewidth=3.5 * pixel, foreground="white")],
                )  # fmt: skip
            elif style.fill is None:
                axes.plot(
                    x, y, color=hexadecimal(colour), linewidth=pixel * style.width, linestyle=style.dash,
                    label=shape.kind, zorder=order,
                )  # fmt: skip
            else:
                axes.fill(
                    x, y, facecolor=(hexadecimal(style.area or colour), style.fill), linewidth=pixel * style.width,
                    edgecolor=hexadecimal(style.edge or colour), linestyle=style.dash, zorder=order,
                )  # fmt: skip


def _shape(kind: str, points: ArrayLike, colour: Colour | None = None) -> Shape:
    return Shape(kind, np.asarray(points, dtype=np.float64).reshape(-1, 2), colour)


def _text(kind: str, text: str, at: tuple[float, float]) -> Shape:
    return Shape(kind, np.zeros((1, 2)), text=text, at=at)


@dataclass(frozen=True, eq=False)
class MapInset:
    """The map in a corner of a film.

    Attributes:
        drawing: what is drawn.
        axes: with the floor plan.
        scale: pixels of the film a metre.
    """

    drawing: FloorMap
    axes: Axes
    scale: float

    @classmethod
    def of(cls, observation: Observation, facts: PageFacts, width: int) -> MapInset | None:
        """Draw the floor plan for a film of this width in pixels; None if no frame has a pose.

        Raises:
            Avs3dError: if the sparse model is missing or damaged.
        """
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        side, text = _FILM
        drawing = FloorMap.of(facts, side=side, text=text, object_names=False)
        if drawing is None:
            return None
        scale = width * FILM_SHARE / side
        figure = Figure(figsize=(drawing.size[0] * scale / 100, drawing.size[1] * scale / 100), dpi=100)
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0, 0, 1, 1), xticks=[], yticks=[])
        axes.spines[:].set_visible(False)  # half of a frame lies outside of the figure
        drawing.show_plan(axes, observation, 2 * drawing.scale * scale)
        axes.set_aspect("auto")
        return cls(drawing, axes, drawing.scale * scale)

    def draw(self, number: int) -> U8:
        """The map (h, w, 3) while frame ``number`` is shown: the way so far, the heading, the sources."""
        drawing, axes = self.drawing, self.axes
        drawing.paint(
            axes, [*drawing.ground(number), *drawing.agent(number), *drawing.sources(number), *drawing.labels]
        )
        canvas: Any = axes.figure.canvas
        canvas.draw()
        for artist in [*axes.lines, *axes.patches, *axes.texts]:
            artist.remove()
        return np.array(canvas.buffer_rgba())[..., :3]
