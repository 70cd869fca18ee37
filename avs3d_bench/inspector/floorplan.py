"""The floor plan under the map: the sparse model seen from above, below head height."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.inspector.facts import Facts
from avs3d_bench.inspector.pictures import rgba_png

#: Metres around the path and the objects that the map shows.
MARGIN = 1.25
#: The sensor's height above the floor, and what is left out above it: ceilings and lamps would hide the room.
EYES, HEAD = 1.5, 0.4
PIXELS_PER_METRE = 96
_MAX_SIDE = 1600
#: Layers of the plan from below, metres: heights above the floor, how far a point spreads, how far colours blend.
_LAYERS = ((-1.0, 0.1, 0.45, 0.05), (0.1, EYES + HEAD, 0.08, 0.012))


@dataclass(frozen=True)
class Bounds:
    """What a map shows, metres: x to the right, z downwards."""

    left: float
    top: float
    width: float
    height: float


def map_bounds(facts: Facts) -> Bounds | None:
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


def draw_floorplan(observation: Observation, facts: Facts) -> bytes:
    """The points of `sparse/0` from above in their colours, as a transparent PNG that fills `map_bounds`.

    Raises:
        Avs3dError: if the sparse model is missing or damaged, or no frame has a pose.
    """
    bounds = map_bounds(facts)
    if bounds is None:
        raise Avs3dError(f"{observation.key}: no frame has a pose, so there is no map")
    points = observation.colmap.points
    return rgba_png(rasterise(points.positions, points.colours, bounds, _floor(facts)))


def _floor(facts: Facts) -> float:
    return min(m.position[1] for m in facts.moments if m.position) - EYES


def rasterise(
    positions: NDArray[np.float64], colours: NDArray[np.uint8], bounds: Bounds, floor: float
) -> NDArray[np.uint8]:
    """A floor plan from points (N, 3) of RGB colours (N, 3): each pixel has the colour of the nearest point.

    Points near the floor spread further than those of furniture and walls, which lie over them. Further away from any
    point the plan is transparent.

    Returns:
        (H, W, 4) RGBA.
    """
    scale = min(PIXELS_PER_METRE, _MAX_SIDE / max(bounds.width, bounds.height))
    size = (max(1, round(bounds.height * scale)), max(1, round(bounds.width * scale)))
    height = positions[:, 1] - floor
    colour, cover = np.zeros((*size, 3), dtype=np.float32), np.zeros(size, dtype=np.float32)
    for low, high, reach, blur in _LAYERS:
        chosen = (height >= low) & (height < high)
        # Lower points first: where two fall on one pixel the higher is seen.
        order = np.argsort(height[chosen], kind="stable")
        at = np.floor((positions[chosen][order][:, [0, 2]] - (bounds.left, bounds.top)) * scale).astype(int)
        inside = ((at >= 0) & (at < size[::-1])).all(axis=1)
        if not inside.any():
            continue
        upper, share = _spread(at[inside], colours[chosen][order][inside], size, reach * scale, blur * scale)
        colour += share[..., None] * (upper - colour)
        # Colours are kept apart from cover: a soft edge must not darken.
        colour = np.where((cover == 0)[..., None], upper, colour)
        cover = np.maximum(cover, share)
    return np.dstack([np.rint(colour), np.rint(255 * cover)]).clip(0, 255).astype(np.uint8)


def _spread(
    at: NDArray[np.int64], colours: NDArray[np.uint8], size: tuple[int, int], reach: float, blur: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Colours (H, W, 3) of the nearest of the points at (column, row), and how much each pixel is covered (H, W)."""
    empty = np.ones(size, dtype=np.uint8)
    empty[at[:, 1], at[:, 0]] = 0
    seeds = np.zeros((*size, 3), dtype=np.float32)
    seeds[at[:, 1], at[:, 0]] = colours
    distance, labels = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    table = np.zeros((int(labels.max()) + 1, 3), dtype=np.float32)
    table[labels[empty == 0]] = seeds[empty == 0]
    near = table[labels]
    if blur > 0:
        near = np.asarray(cv2.GaussianBlur(near, (0, 0), blur), dtype=np.float32)
    # Gaps narrower than twice the reach are closed, but the outside is not pushed out (a morphological closing).
    within = np.pad((distance <= reach).astype(np.uint8), 1, mode="edge")
    depth = cv2.distanceTransform(within, cv2.DIST_L2, 5)[1:-1, 1:-1]
    return near, np.clip(depth - 0.9 * reach + 0.5, 0, 1).astype(np.float32)
