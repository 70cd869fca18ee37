"""The free floor of a room, on which the agent can walk, measured on the room's geometry.

Works on any triangle mesh, modelled or scanned. Obstacles are the triangles that reach into the height band of the
agent's body; each is clipped to the band, projected onto the floor plane and rasterised on a fine grid, whose Euclidean
distance transform then gives a lower bound of the clearance anywhere. A grid cell is walkable if the clearance is at
least the agent's radius and a ray straight down hits the floor.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from avs3d_bench.errors import Avs3dError
from generators.core.rays import RayCaster
from generators.core.scene import F32, Room, Scene

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
#: A function from points (N, 3) to (N,) bool: whether an agent can stand on each.
Navigable: TypeAlias = Callable[[Array], Mask]

#: Side of a floor cell, metres.
CELL = 0.05
#: Fine cells per floor cell along each axis; obstacles are rasterised on the fine grid.
FINE = 4
#: Radius of the agent (m): its least horizontal distance from anything.
AGENT_RADIUS = 0.20
#: Height above the floor (m) up to which the agent walks over things, such as a rug or a threshold.
STEP_OVER = 0.05
#: The sensor's height above the floor (m); the agent walks under things higher than this plus its radius.
SENSOR_HEIGHT = 1.50
#: Rasterising moves points to cell centres: half a diagonal for the obstacle, half a diagonal for the queried point.
_RASTER_ERROR = 1.5 * CELL / FINE
_MARGIN = 0.3


def triangles_near(scene: Scene, boxes: Sequence[tuple[ArrayLike, ArrayLike]], margin: float = 0.5) -> F32:
    """(F, 3, 3) triangles of ``scene`` that touch one of the ``boxes`` (low, high) grown by ``margin`` metres."""
    out = []
    for part in scene.parts:
        positions = part.mesh.positions
        low, high = positions.min(axis=1), positions.max(axis=1)
        keep = np.zeros(len(positions), dtype=bool)
        for box_low, box_high in boxes:
            keep |= ((high >= np.asarray(box_low) - margin) & (low <= np.asarray(box_high) + margin)).all(axis=1)
        out.append(positions[keep])
    return np.concatenate(out) if out else np.zeros((0, 3, 3), dtype=np.float32)


def clip_to_band(triangles: ArrayLike, low: float, high: float) -> tuple[Array, list[Array]]:
    """Clip triangles (F, 3, 3) to low ≤ y ≤ high and project them onto the xz plane.

    Clipping a triangle by two parallel planes leaves a convex polygon: the hull of its corners inside the band and of
    the crossings of its edges with the planes.

    Returns:
        (K, 3, 2) the triangles that lie wholly in the band, and the outlines (M, 2) of the clipped remains of the
        others.
    """
    corners = np.asarray(triangles, dtype=np.float64)
    y = corners[:, :, 1]
    corners = corners[(y.max(axis=1) >= low) & (y.min(axis=1) <= high)]
    y = corners[:, :, 1]
    inside = (y >= low) & (y <= high)
    whole = inside.all(axis=1)
    crossing = corners[~whole]
    ends = np.roll(crossing, -1, axis=1)
    rise = ends[:, :, 1] - crossing[:, :, 1]
    points, valid = [crossing[:, :, [0, 2]]], [inside[~whole]]
    for level in (low, high):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (level - crossing[:, :, 1]) / rise
        valid.append((rise != 0) & (t >= 0) & (t <= 1))
        t = np.where(valid[-1], t, 0.0)[:, :, None]
        points.append((crossing * (1 - t) + ends * t)[:, :, [0, 2]])
    every, keep = np.concatenate(points, axis=1), np.concatenate(valid, axis=1)
    outlines = [
        cv2.convexHull(candidates[use].astype(np.float32)).reshape(-1, 2).astype(np.float64)
        for candidates, use in zip(every, keep, strict=True)
        if use.any()
    ]
    return corners[whole][:, :, [0, 2]], outlines


def rasterise(
    triangles: Array, outlines: Sequence[Array], origin: ArrayLike, shape: tuple[int, int], cell: float
) -> Mask:
    """Mark the cells of a grid (x first, then z) that triangles (K, 3, 2) and convex outlines (M, 2) cover.

    Every point of a figure is within a cell's side of the centre of a marked cell.
    """
    image = np.zeros(shape, dtype=np.uint8)
    at = (triangles - np.asarray(origin)) / cell
    # Most triangles of a scan are smaller than a cell: marking their corners is enough.
    small = (np.ptp(at, axis=1) < 1.0).all(axis=1)
    corners = np.floor(at[small]).astype(np.int64).reshape(-1, 2)
    corners = corners[((corners >= 0) & (corners < shape)).all(axis=1)]
    image[corners[:, 0], corners[:, 1]] = 1
    # OpenCV counts (column, row) = (z, x) from the centre of the first cell, here in sixteenths of a cell.
    shift, limit = 4, 1 << 24

    def scaled(points: Array) -> NDArray[np.int32]:
        return np.clip(np.round((points[..., ::-1] - 0.5) * (1 << shift)), -limit, limit).astype(np.int32)

    # A room has tens of thousands of triangles: their corners are rounded all at once.
    for outline in (*scaled(at[~small]), *(scaled((outline - np.asarray(origin)) / cell) for outline in outlines)):
        cv2.fillConvexPoly(image, outline, 1, 8, shift)
    return image.astype(bool)


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """The walkable floor of a room on a grid; the first axis is x, the second z.

    Attributes:
        floor: height of the floor, metres.
        origin: (2,) x and z of the outer corner of cell [0, 0].
        walkable: (NX, NZ) bool, cells of `CELL` metres whose centre the agent may occupy.
        obstacle_distance: (NX·FINE, NZ·FINE) float32, a lower bound of the horizontal distance from each fine cell's
            centre to the nearest thing within the agent's height, metres.
        radius: the agent's radius, metres.
    """

    floor: float
    origin: Array
    walkable: Mask
    obstacle_distance: F32
    radius: float = AGENT_RADIUS

    @classmethod
    def of(
        cls,
        scene: Scene,
        room: str,
        *,
        adjoining: Sequence[str] = (),
        triangles: F32 | None = None,
        caster: RayCaster | None = None,
        radius: float = AGENT_RADIUS,
        height: float = SENSOR_HEIGHT,
    ) -> FreeSpace:
        """Measure the free space of ``room`` and, with ``adjoining``, of those rooms and their doorways.

        Args:
            scene: any scene.
            room: name of the room.
            adjoining: names of further rooms.
            triangles: the triangles to measure, if the caller already has them (`triangles_near`).
            caster: the ray caster of the same triangles.
            radius: the agent's radius.
            height: the sensor's height above the floor; a ray from there looks for the floor.

        Raises:
            Avs3dError: if the room does not exist, its box is not valid, or the box holds no geometry.
        """
        rooms = [scene.room(room), *(scene.room(name) for name in adjoining)]
        for each in rooms:
            _check_box(scene, each)
        # Inner boxes end at the walls; two rooms meet in the middle of the wall between them.
        grow = 0.15 if adjoining else 0.0
        grown = np.array([grow, 0.0, grow])
        boxes = [(np.asarray(r.low) - grown, np.asarray(r.high) + grown) for r in rooms]
        if triangles is None:
            triangles = triangles_near(scene, boxes)
        if not len(triangles):
            raise Avs3dError(f"{scene.name}/{room}: no geometry in the room's box; correct its low and high corners")
        if caster is None:
            caster = RayCaster(triangles)
        floor = float(rooms[0].low[1])
        low = np.min([box[0] for box in boxes], axis=0)[[0, 2]] - _MARGIN
        high = np.max([box[1] for box in boxes], axis=0)[[0, 2]] + _MARGIN
        shape = tuple(int(n) for n in np.ceil((high - low) / CELL))
        fine = (shape[0] * FINE, shape[1] * FINE)
        solid = clip_to_band(triangles, floor + STEP_OVER, floor + height + radius)
        blocked = rasterise(*solid, low, fine, CELL / FINE)
        distance = _distance(blocked)
        space = cls(floor, low, np.ones(shape, dtype=bool), distance, radius)
        centres = space.cell_centres()
        inside = np.zeros(len(centres), dtype=bool)
        for box_low, box_high in boxes:
            inside |= ((centres >= box_low[[0, 2]]) & (centres <= box_high[[0, 2]])).all(axis=1)
        inside &= space.clearance(centres) >= radius
        inside[inside] &= _floor_below(caster, centres[inside], floor, height)
        return replace(space, walkable=inside.reshape(shape))

    def cell_centres(self) -> Array:
        """(NX·NZ, 2) x and z of all cell centres, in the order of ``walkable.reshape(-1)``."""
        nx, nz = self.walkable.shape
        x, z = np.meshgrid(np.arange(nx), np.arange(nz), indexing="ij")
        return self.origin + (np.stack([x.reshape(-1), z.reshape(-1)], axis=1) + 0.5) * CELL

    @cached_property
    def points(self) -> Array:
        """(N, 2) x and z of the walkable cells' centres."""
        return self.cell_centres()[self.walkable.reshape(-1)]

    def index(self, points: ArrayLike) -> NDArray[np.int64]:
        """(N, 2) cell indices of points (N, 2), clipped to the grid."""
        cells = np.floor((np.asarray(points, dtype=np.float64) - self.origin) / CELL).astype(np.int64)
        return np.clip(cells, 0, np.array(self.walkable.shape) - 1)

    def contains(self, points: ArrayLike) -> Mask:
        """(N,) whether points (N, 2) lie in walkable cells and are themselves at least the agent's radius away."""
        ij = self.index(points)
        return np.asarray(self.walkable[ij[:, 0], ij[:, 1]] & (self.clearance(points) >= self.radius))

    def clearance(self, points: ArrayLike) -> Array:
        """(N,) a lower bound of the horizontal distance from points (N, 2) to the nearest obstacle, metres."""
        position = (np.asarray(points, dtype=np.float64) - self.origin) / (CELL / FINE) - 0.5
        value = ndimage.map_coordinates(self.obstacle_distance, position.T, order=1, mode="nearest")
        return np.asarray(value, dtype=np.float64)

    @property
    def area(self) -> float:
        """Walkable area, m²."""
        return float(self.walkable.sum()) * CELL * CELL

    @cached_property
    def labels(self) -> NDArray[np.int32]:
        """(NX, NZ) connected components of the walkable cells (4-neighbour), 1 = the largest, 0 = not walkable."""
        raw, count = ndimage.label(self.walkable)
        sizes = np.bincount(raw.reshape(-1), minlength=count + 1)[1:]
        rank = np.zeros(count + 1, dtype=np.int32)
        rank[1 + np.argsort(-sizes, kind="stable")] = np.arange(1, count + 1)
        return np.asarray(rank[raw], dtype=np.int32)

    def largest(self) -> FreeSpace:
        """The largest connected component alone."""
        return self.component(1)

    def component(self, label: int) -> FreeSpace:
        """The component with ``label`` alone."""
        return replace(self, walkable=self.labels == label)

    def restricted(self, keep: Mask) -> FreeSpace:
        """The same space, restricted to the cells in which ``keep`` (NX, NZ) is true."""
        return replace(self, walkable=self.walkable & keep)

    def within(self, navigable: Navigable) -> FreeSpace:
        """The space restricted to the cells whose centre, at the floor's height, ``navigable`` accepts."""
        plan = self.points
        if not len(plan):
            return self
        keep = self.walkable.copy()
        keep[keep] = navigable(np.stack([plan[:, 0], np.full(len(plan), self.floor), plan[:, 1]], axis=1))
        return self.restricted(keep)

    def without(self, rectangles: Sequence[Array], distance: float | None = None) -> FreeSpace:
        """The space without the points nearer than ``distance`` to convex outlines (4, 2: x and z, in order).

        The default distance is the agent's radius.
        """
        limit = self.radius if distance is None else distance
        keep = self.walkable.copy()
        for rectangle in rectangles:
            # Farther than this from the outline's bounding box is farther than ``limit`` from the outline.
            low, high = rectangle.min(axis=0) - limit - CELL, rectangle.max(axis=0) + limit + CELL
            (x0, z0), (x1, z1) = self.index([low, high])
            near = np.zeros_like(keep)
            near[x0 : x1 + 1, z0 : z1 + 1] = keep[x0 : x1 + 1, z0 : z1 + 1]
            keep[near] = distance_to_polygon(self.origin + (np.argwhere(near) + 0.5) * CELL, rectangle) >= limit
        return self.restricted(keep)

    @cached_property
    def graph(self) -> tuple[sparse.csr_matrix, NDArray[np.int64], NDArray[np.int64]]:
        """The 8-neighbour graph of walkable cells: weights, (N, 2) cell indices, (NX, NZ) node numbers (−1: none).

        A step costs its length, times up to 1.5 close to obstacles, so that paths prefer the middle of a passage.
        """
        cells = np.argwhere(self.walkable)
        number = np.full(self.walkable.shape, -1, dtype=np.int64)
        number[cells[:, 0], cells[:, 1]] = np.arange(len(cells))
        spare = np.clip(self.clearance(self.points) - self.radius, 0.0, 0.3)
        cost = 1.5 - spare / 0.6
        rows, columns, weights = [], [], []
        for di, dj in ((1, 0), (0, 1), (1, 1), (1, -1)):
            near = cells + np.array([di, dj])
            valid = ((near >= 0) & (near < self.walkable.shape)).all(axis=1)
            target = np.full(len(cells), -1, dtype=np.int64)
            target[valid] = number[near[valid, 0], near[valid, 1]]
            if di and dj:
                # A diagonal step must not cut the corner of a blocked cell.
                side_a, side_b = number[near[:, 0] * valid, cells[:, 1]], number[cells[:, 0], near[:, 1] * valid]
                target[(side_a < 0) | (side_b < 0)] = -1
            keep = np.flatnonzero(target >= 0)
            rows.append(keep)
            columns.append(target[keep])
            weights.append(CELL * np.hypot(di, dj) * (cost[keep] + cost[target[keep]]) / 2)
        size = len(cells)
        entries = (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns)))
        half = sparse.csr_matrix(entries, shape=(size, size))
        return (half + half.T).tocsr(), cells, number

    def nearest(self, point: ArrayLike) -> Array:
        """(2,) the walkable cell centre nearest to ``point`` (2,).

        Raises:
            Avs3dError: if nothing is walkable.
        """
        if not len(self.points):
            raise Avs3dError("no free floor: the agent cannot stand anywhere in the room; remove furniture")
        return np.asarray(self.points[int(np.argmin(((self.points - np.asarray(point)) ** 2).sum(axis=1)))])

    def paths(self, waypoints: ArrayLike) -> list[Array]:
        """Geodesic paths (M, 2) between successive waypoints (K, 2), which are moved to the nearest walkable cells.

        Raises:
            Avs3dError: if two waypoints are not connected.
        """
        weights, cells, number = self.graph
        ij = self.index([self.nearest(point) for point in np.asarray(waypoints, dtype=np.float64)])
        nodes = number[ij[:, 0], ij[:, 1]]
        _, before = csgraph.dijkstra(weights, directed=False, indices=nodes[:-1], return_predecessors=True)
        out = []
        for row, (first, last) in enumerate(itertools.pairwise(nodes)):
            chain = [int(last)]
            while chain[-1] != first:
                step = int(before[row, chain[-1]])
                if step < 0:
                    raise Avs3dError("no path between two places in the room: its free floor is in separate pieces")
                chain.append(step)
            out.append(self.origin + (cells[chain[::-1]] + 0.5) * CELL)
        return out


def distance_to_polygon(points: ArrayLike, polygon: ArrayLike) -> Array:
    """(N,) distance from points (N, 2) to a convex polygon (M, 2, corners in order, clockwise or not); 0 inside."""
    p, corners = np.asarray(points, dtype=np.float64), np.asarray(polygon, dtype=np.float64)
    best = np.full(len(p), np.inf)
    left, right = np.ones(len(p), dtype=bool), np.ones(len(p), dtype=bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = b - a
        t = np.clip((p - a) @ edge / max(float(edge @ edge), 1e-18), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(p - a - t[:, None] * edge, axis=1))
        side = edge[0] * (p[:, 1] - a[1]) - edge[1] * (p[:, 0] - a[0])
        left &= side >= 0
        right &= side <= 0
    return np.where(left | right, 0.0, best)


def _check_box(scene: Scene, room: Room) -> None:
    size = np.asarray(room.high, dtype=np.float64) - np.asarray(room.low, dtype=np.float64)
    if not np.isfinite(size).all() or (size <= 0.2).any() or (size > 100).any():
        raise Avs3dError(
            f"{scene.name}: room {room.name!r} measures {np.round(size, 2).tolist()} m, expected 0.2 to 100 m along"
            " each axis; correct its low and high corners"
        )


def _distance(blocked: Mask) -> F32:
    if not blocked.any():
        return np.full(blocked.shape, 100.0, dtype=np.float32)
    distance = ndimage.distance_transform_edt(~blocked) * (CELL / FINE)
    return np.maximum(distance - _RASTER_ERROR, 0.0).astype(np.float32)


def _floor_below(caster: RayCaster, points: Array, floor: float, height: float) -> Mask:
    """Whether the first thing straight below the sensor is the floor (or a rug on it)."""
    origins = np.stack([points[:, 0], np.full(len(points), floor + height), points[:, 1]], axis=1)
    down = np.broadcast_to([0.0, -1.0, 0.0], origins.shape)
    distance, _ = caster.closest(origins, down)
    return np.asarray(np.abs(distance - height) <= STEP_OVER)
