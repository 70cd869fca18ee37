"""The floor plan under every map: of a scan its picture from above, else traced from the points of the sparse model.

No dataset holds a mesh of the room. In the trace, a wall has points one above the other from the furniture's height up
to the lintels of the doors; furniture has points off the floor and below that height; floor lies around and below both.
Each becomes a grid, small gaps are closed, and the outlines are traced.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from avs3d_bench.inspector.facts import PageFacts
from avs3d_bench.inspector.pictures import U8, rgba_png

#: Metres around the path and the objects that the map shows.
MARGIN = 1.25
#: The sensor's height above the floor, and what is left out above it: ceilings and lamps would hide the room (m).
EYES, HEAD = 1.5, 0.4
PIXELS_PER_METRE = 96
_MAX_SIDE = 1600
#: Points below this height are floor (m).
_LOW = 0.1
#: Walls reach above head height; the ceiling and what hangs within this distance below it are no wall (m).
_BELOW_CEILING = 0.12
#: Side of a grid cell (m), and the most cells along a side of the map.
_CELL, _MOST_CELLS = 0.025, 1200
#: Gaps that are closed: points of the floor and of surfaces lie up to twice as far apart (m).
_FLOOR_GAP, _WALL_GAP, _FURNITURE_GAP = 0.45, 0.2, 0.12
#: How far points of one wall lie from one plane: skirting boards, door frames (m). Half of a drawn wall's thickness.
_WALL_HALF = 0.05
#: Smaller pieces of furniture and of wall are not drawn (m²).
_LEAST_AREA = 0.015
#: How much of the way to white a picture from above is made paler.
_PALER = 0.25
#: RGB of the plan, for a light page.
FLOOR_COLOUR, FURNITURE_COLOUR, EDGE_COLOUR, WALL_COLOUR = (
    (255, 255, 255),
    (233, 229, 219),
    (163, 156, 141),
    (66, 62, 56),
)

Outlines = tuple[NDArray[np.float64], ...]


@dataclass(frozen=True)
class Bounds:
    """The area that a map shows (m): x to the right, z downwards."""

    left: float
    top: float
    width: float
    height: float


@dataclass(frozen=True, eq=False)
class PlanOutlines:
    """A floor plan: closed outlines (N, 2) of x and z, metres. Within an odd number of them is inside.

    Attributes:
        floor: where there is a floor, or something on it.
        furniture: what stands on the floor or hangs on a wall, below head height.
        walls: what reaches above head height.
    """

    floor: Outlines
    furniture: Outlines
    walls: Outlines


def map_bounds(facts: PageFacts) -> Bounds | None:
    """The part of the floor that the map shows; None without a path.

    Sources of other rooms are left out, so that the siblings of a group have the same map.
    """
    spots = [(m.position[0], m.position[2]) for m in facts.moments if m.position]
    if not spots:
        return None
    spots += [(m.source[0], m.source[2]) for m in facts.moments if m.source]
    for instance in facts.instances:
        spots += [(corner[0], corner[2]) for corner in instance.bounds]
    points = np.array(spots)
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    return Bounds(*(round(float(v), 3) for v in (*low, *(high - low))))


def read_plan(observation: Observation, bounds: Bounds) -> PlanOutlines:
    """The floor plan of an observation whose frames have poses.

    Raises:
        Avs3dError: if the sparse model is missing or damaged.
    """
    floor = min(frame.pose.position[1] for frame in observation.frames if frame.has_pose) - EYES
    return trace_plan(observation.colmap.points.positions, bounds, floor)


def plan_picture(observation: Observation, bounds: Bounds, size: tuple[int, int]) -> U8:
    """The floor plan as a picture of ``size`` (width, height) that fills ``bounds``.

    Returns:
        (H, W, 4) RGBA, transparent where nothing is known.

    Raises:
        Avs3dError: if the picture from above or the sparse model is missing or damaged.
    """
    area = observation.record.top_view if observation.record else None
    if area is None:
        return paint_plan(read_plan(observation, bounds), bounds, size)
    rgb = media.read_png_rgb(observation.where(layout.TOP_VIEW))
    # Paths and names are drawn upon it: paler, they stand out.
    paler = np.rint(rgb + _PALER * (255.0 - rgb)).astype(np.uint8)
    whole = np.dstack([paler, np.where(rgb.any(axis=2), 255, 0).astype(np.uint8)])
    scale = size[0] / bounds.width, size[1] / bounds.height
    shown = max(1, round(area.width * scale[0])), max(1, round(area.height * scale[1]))
    column, row = round((area.left - bounds.left) * scale[0]), round((area.top - bounds.top) * scale[1])
    canvas = np.zeros((size[1], size[0], 4), dtype=np.uint8)
    canvas[max(0, row) : max(0, row + shown[1]), max(0, column) : max(0, column + shown[0])] = cv2.resize(
        whole, shown, interpolation=cv2.INTER_AREA
    )[max(0, -row) : max(0, size[1] - row), max(0, -column) : max(0, size[0] - column)]
    return canvas


def draw_floorplan(observation: Observation, facts: PageFacts) -> bytes:
    """The floor plan as a PNG that fills `map_bounds`; transparent where nothing is known.

    Raises:
        Avs3dError: if the sparse model is missing or damaged, or no frame has a pose.
    """
    bounds = map_bounds(facts)
    if bounds is None:
        raise Avs3dError(f"{observation.key}: no frame has a pose, so there is no map")
    scale = min(PIXELS_PER_METRE, _MAX_SIDE / max(bounds.width, bounds.height))
    size = max(1, round(bounds.width * scale)), max(1, round(bounds.height * scale))
    return rgba_png(plan_picture(observation, bounds, size))


def trace_plan(positions: NDArray[np.float64], bounds: Bounds, floor: float) -> PlanOutlines:
    """Trace floor, furniture and walls.

    Args:
        positions: (N, 3) points of surfaces, metres, Y up.
        bounds: the part that is wanted.
        floor: its height, metres.
    """
    cell = max(_CELL, max(bounds.width, bounds.height) / _MOST_CELLS)
    # Gaps at the border are closed with what lies just outside.
    ring = int(np.ceil(2 * _FLOOR_GAP / cell))
    shape = int(np.ceil(bounds.height / cell)) + 2 * ring, int(np.ceil(bounds.width / cell)) + 2 * ring
    height = positions[:, 1] - floor
    at = np.floor((positions[:, [0, 2]] - (bounds.left, bounds.top)) / cell).astype(np.int64) + ring
    inside = ((at >= 0) & (at < shape[::-1])).all(axis=1) & (height > -1.0)
    at, height = at[inside], height[inside]

    def cells(chosen: NDArray[np.bool_]) -> NDArray[np.uint8]:
        grid = np.zeros(shape, dtype=np.uint8)
        grid[at[chosen, 1], at[chosen, 0]] = 1
        return grid

    def square(reach: float) -> NDArray[np.uint8]:
        # Squares, not discs: corners stay corners.
        side = 2 * max(1, round(reach / cell)) + 1
        return np.ones((side, side), dtype=np.uint8)

    def closed(grid: NDArray[np.uint8], gap: float) -> NDArray[np.uint8]:
        return np.asarray(cv2.morphologyEx(grid, cv2.MORPH_CLOSE, square(gap)), dtype=np.uint8)

    def outlines(grid: NDArray[np.uint8], least: float, holes: bool = False) -> Outlines:
        found, _ = cv2.findContours(grid, cv2.RETR_CCOMP if holes else cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        lines = (cv2.approxPolyDP(line, 1.5, True)[:, 0] for line in found if cv2.contourArea(line) * cell**2 >= least)
        # A contour passes through the middles of the cells.
        return tuple(
            np.asarray((v + 0.5 - ring) * cell + (bounds.left, bounds.top), np.float64) for v in lines if len(v) > 2
        )

    head = EYES + HEAD
    ceiling = float(height.max(initial=head))
    reaching = min(head, ceiling - 5 * _BELOW_CEILING)
    low = cells((height >= _LOW) & (height < reaching))
    high = cells((height >= reaching) & (height < max(head, ceiling - _BELOW_CEILING)))
    thick = square(_WALL_HALF)
    # Above a door there are points at the height of lintels alone: it stays open.
    both = cv2.bitwise_and(cv2.dilate(high, thick), cv2.dilate(low, thick))
    wall = closed(np.asarray(both, dtype=np.uint8), _WALL_GAP)
    wall = np.asarray(cv2.morphologyEx(wall, cv2.MORPH_OPEN, square(_WALL_HALF / 2)), dtype=np.uint8)
    free = cv2.bitwise_and(closed(low, _FURNITURE_GAP), 1 - cv2.dilate(wall, square(_WALL_HALF / 2)))
    furniture = cv2.morphologyEx(free, cv2.MORPH_OPEN, square(0.02))
    ground = closed(cells(height < head), _FLOOR_GAP) | wall
    return PlanOutlines(
        outlines(ground, 25 * _LEAST_AREA),
        outlines(np.asarray(furniture, dtype=np.uint8), _LEAST_AREA),
        outlines(wall, _LEAST_AREA, holes=True),
    )


def paint_plan(plan: PlanOutlines, bounds: Bounds, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Draw a plan that fills a picture of ``size`` (width, height).

    Returns:
        (H, W, 4) RGBA, transparent outside of floor and walls.
    """
    # Drawn at twice the size and averaged, with eight bits of fractions: even edges.
    width, height = 2 * size[0], 2 * size[1]
    scale = np.array([width / bounds.width, height / bounds.height])

    def pixels(lines: Outlines) -> list[NDArray[np.int32]]:
        return [np.rint(((line - (bounds.left, bounds.top)) * scale - 0.5) * 256).astype(np.int32) for line in lines]

    colour = np.full((height, width, 3), FLOOR_COLOUR, dtype=np.uint8)
    cover = np.zeros((height, width), dtype=np.uint8)
    for lines in (plan.floor, plan.walls):
        cv2.fillPoly(cover, pixels(lines), 255, cv2.LINE_AA, 8)
    thick = max(2, round(float(scale.min()) * 0.018))
    cv2.fillPoly(colour, pixels(plan.furniture), FURNITURE_COLOUR, cv2.LINE_AA, 8)
    cv2.polylines(colour, pixels(plan.furniture), True, EDGE_COLOUR, thick, cv2.LINE_AA, 8)
    cv2.fillPoly(colour, pixels(plan.walls), WALL_COLOUR, cv2.LINE_AA, 8)
    whole = np.dstack([colour, cover])
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
