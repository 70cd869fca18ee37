"""The page beside the manifest of a surveyed scan: plan, pictures, guesses. One file that loads nothing."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.commands.outputs import Signature
from avs3d_bench.text.templates import keep_units, template_environment, words
from generators.core.freespace import CELL
from generators.core.scene import Scene, Support
from generators.scans.patches import RefusedTop
from generators.scans.scan import SoundReport
from generators.surveying.fitting import FittingObservations
from generators.surveying.measures import RoomMeasures, eye_pictures
from generators.surveying.survey import Survey
from generators.vision.top_view import view_from_above

Array = NDArray[np.float64]

#: What a page of `avs3d scan` says about itself.
SCAN_PAGE = Signature(start=b"<!doctype html>\n<!-- avs3d scan -->")
#: Side of the picture from above (pixels), margin of the plan (m), and how far below the ceiling it is cut (m).
PLAN_PIXELS, PLAN_MARGIN, CUT = 900, 0.4, 0.4
_QUALITY = 82


@dataclass(frozen=True)
class PlanRectangle:
    """A rectangle or line of the drawing, metres: x and z of its corner and its sides; ``label``: of a tool tip."""

    x: float
    z: float
    width: float
    depth: float
    label: str = ""


@dataclass(frozen=True, eq=False)
class PlanDrawing:
    """The plan in metres; the picture from above covers all of it.

    Attributes:
        x, z, side: the square that is drawn.
        picture: data URI.
        rooms, unused: rectangles with the number and name of rooms that the manifest has, and of those that it has not.
        walkable, holes: rows of cells.
        tops, refused, walls, doors: supports, tops that are not used, and doorways.
    """

    x: float
    z: float
    side: float
    picture: str
    rooms: tuple[PlanRectangle, ...]
    unused: tuple[PlanRectangle, ...]
    walkable: tuple[PlanRectangle, ...]
    holes: tuple[PlanRectangle, ...]
    tops: tuple[PlanRectangle, ...]
    refused: tuple[PlanRectangle, ...]
    walls: tuple[PlanRectangle, ...]
    doors: tuple[PlanRectangle, ...]


def scan_page(
    title: str,
    home: Scene,
    survey: Survey,
    measures: Sequence[RoomMeasures],
    found: FittingObservations,
    sound: SoundReport,
    commands: Sequence[str],
) -> bytes:
    """The page as HTML; ``commands``: that come next."""
    environment = template_environment("generators.surveying")
    environment.filters |= {"words": words, "units": keep_units}
    pictures = [(room, f"{heading:.0f}", data_uri(picture)) for room, heading, picture in eye_pictures(home, measures)]
    entries = [
        {"room": entry.get("room"), "part": entry.get("part"), "category": entry.get("category"), "entry": entry}
        for entry in found.entries
    ]
    page = environment.get_template("scan.html.j2").render(
        title=title,
        survey=survey,
        plan=draw(home, survey, measures),
        measures=measures,
        pictures=pictures,
        fits=_fits(entries),
        count=len(entries),
        refused=found.refused,
        sound=sound,
        refused_tops=_refused(measures),
        commands=commands,
    )
    return page.encode()


def _fits(entries: Sequence[dict[str, object]]) -> dict[str, dict[str, list[str]]]:
    """Room → category → parts in which it sounds."""
    out: dict[str, dict[str, list[str]]] = {}
    for entry in entries:
        if entry["category"]:
            parts = out.setdefault(str(entry["room"]), {}).setdefault(str(entry["category"]), [])
            parts.append(str(entry["part"]))
    return out


def draw(home: Scene, survey: Survey, measures: Sequence[RoomMeasures]) -> PlanDrawing:
    """The plan with the picture from above under it."""
    corners = np.array([[box.low, box.high] for box in survey.boxes])[:, :, [0, 2]]
    low, high = corners[:, 0].min(axis=0) - PLAN_MARGIN, corners[:, 1].max(axis=0) + PLAN_MARGIN
    middle, side = (low + high) / 2, float((high - low).max())
    x, z = (middle - side / 2).tolist()
    heights = survey.levels.floor, survey.levels.ceiling - CUT
    picture = view_from_above(home, (x, z), (side, side), heights, PLAN_PIXELS / side)
    names = {number: name for name, number in survey.rooms.items()}
    boxes = [
        PlanRectangle(
            box.low[0], box.low[2], box.high[0] - box.low[0], box.high[2] - box.low[2],
            f"{number + 1}" + (f" {words(names[number])}" if number in names else ""),
        )
        for number, box in enumerate(survey.boxes)
    ]  # fmt: skip
    return PlanDrawing(
        x,
        z,
        side,
        data_uri(picture),
        tuple(box for number, box in enumerate(boxes) if number in names),
        tuple(box for number, box in enumerate(boxes) if number not in names),
        tuple(row for each in measures for row in rows_of(each.walkable)),
        tuple(row for each in measures for row in rows_of(each.holes)),
        tuple(_around(support, words(support.kind)) for each in measures for support in each.tops()),
        tuple(_bounding(top.corners[:, [0, 2]], str(n)) for n, (_, top, _) in enumerate(_refused(measures), start=1)),
        tuple(_around(support, "free wall") for each in measures for support in each.walls()),
        tuple(_bounding(door, "doorway") for each in measures for door in each.doors),
    )


def _refused(measures: Sequence[RoomMeasures]) -> list[tuple[str, RefusedTop, float]]:
    """Room, top that is not used, and its height above the floor (m)."""
    return [
        (each.room.name, top, float(top.corners[0, 1]) - each.room.low[1]) for each in measures for top in each.refused
    ]


def rows_of(cells: Array) -> list[PlanRectangle]:
    """Cells (N, 2), x and z of their middles, as rectangles of whole rows along z."""
    out: list[PlanRectangle] = []
    for x in np.unique(np.round(cells[:, 0], 4)):
        z = np.sort(cells[np.abs(cells[:, 0] - x) < CELL / 4, 1])
        for run in np.split(z, np.flatnonzero(np.diff(z) > 1.5 * CELL) + 1):
            first = float(run[0]) - CELL / 2
            out.append(PlanRectangle(float(x) - CELL / 2, first, CELL, float(run[-1]) + CELL / 2 - first))
    return out


def _around(support: Support, label: str) -> PlanRectangle:
    """The bounding rectangle of a support on the plan."""
    origin, u, v = (np.asarray(vector)[[0, 2]] for vector in (support.origin, support.u, support.v))
    return _bounding(np.stack([origin, origin + u, origin + v, origin + u + v]), label)


def _bounding(points: Array, label: str) -> PlanRectangle:
    """The rectangle around points (N, 2)."""
    (x, z), (width, depth) = points.min(axis=0).tolist(), np.ptp(points, axis=0).tolist()
    return PlanRectangle(x, z, width, depth, label)


def data_uri(picture: NDArray[np.uint8]) -> str:
    """A picture (H, W, 3) as the text of a JPEG."""
    data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()
