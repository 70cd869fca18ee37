"""How a model rests on a scanned surface: it touches it, and does not cut into it.

A scanned surface ripples, and is seldom quite level. A model is lowered onto the very triangles that are seen until it
rests on three points around the middle of its underside, as a real thing does, tilted by up to `LEAN`. The pose is the
solution of a linear program: the lowest plane, through the middle, below which no point of the surface reaches into the
model. Then the gaps below its feet are measured, and a place where it would float is refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from generators.core.boxes import yaw_matrix
from generators.core.rays import RayCaster
from generators.core.scene import Mesh
from generators.placement.site import Site
from generators.placement.spots import CONTACT, HOLES, Spot

Array = NDArray[np.float64]

#: Largest tilt (degrees): more is seen beside a wall or a door frame.
LEAN = 2.0
#: Largest median of the gaps below the feet (m); the scan's noise is added to it.
FLOAT = 0.003
#: What reaches this far above the lowest point of the underside can touch the support, and what is a foot (m).
SOLE, FOOT = 0.02, 0.003
#: Spacing of the points of the underside (m), and their least and largest number along a side.
SPACING, FEWEST, MOST = 0.01, 6, 48
#: The surface is looked for from this far before the model to twice as far behind (m).
REACH = 0.05


@dataclass(frozen=True, eq=False)
class Sole:
    """Points at which a model can touch its support.

    Attributes:
        points: (K, 3) on the model's underside, or on its back, model coordinates.
        away: (3,) the model's axis that points away from the support.
        feet: (K,) which of them, on a regular grid, are as low as its feet.
    """

    points: Array
    away: Array
    feet: NDArray[np.bool_]

    @classmethod
    def of(cls, mesh: Mesh, *, wall: bool) -> Sole:
        """The back of a model that hangs on a wall, or its underside."""
        axis, others = (2, [0, 1]) if wall else (1, [0, 2])
        corners = mesh.positions.reshape(-1, 3).astype(np.float64)
        lowest = float(corners[:, axis].min())
        touching = corners[corners[:, axis] <= lowest + SOLE][:, others]
        low, high = touching.min(axis=0), touching.max(axis=0)
        inset = np.minimum(0.001, (high - low) / 4)
        counts = np.clip(np.ceil((high - low) / SPACING), FEWEST, MOST).astype(int)
        a, b = (np.linspace(p, q, n) for p, q, n in zip(low + inset, high - inset, counts, strict=True))
        grid = np.stack([g.reshape(-1) for g in np.meshgrid(a, b, indexing="ij")], axis=1)
        starts = np.full((len(grid), 3), lowest - REACH)
        starts[:, others] = grid
        away = np.eye(3)[axis]
        distance, _ = RayCaster(mesh.positions).closest(starts, np.broadcast_to(away, starts.shape))
        depth = np.maximum(np.minimum(distance.astype(np.float64), 1e3) - REACH, 0.0)
        sole = depth <= SOLE
        starts[:, axis] = lowest + depth
        # The rim lies between the points of the grid: corners of the mesh, thinned to half the spacing.
        rim = corners[corners[:, axis] <= lowest + SOLE]
        rim = rim[np.unique(np.round(rim / (SPACING / 2)).astype(np.int64), axis=0, return_index=True)[1]]
        points = np.concatenate([starts[sole], rim])
        return cls(points, away, np.concatenate([depth[sole] <= FOOT, np.zeros(len(rim), dtype=bool)]))


def settle(site: Site, sole: Sole, spot: Spot) -> Spot | str:
    """Bring a model from a spot, where it nearly touches its support, into contact with it.

    Args:
        site: a scanned room.
        sole: of the model.
        spot: where it is, upright.

    Returns:
        The spot in contact, tilted; or the reason why it does not rest there, a verb phrase in the plural.
    """
    upright = yaw_matrix(spot.yaw)
    arms = sole.points @ upright.T
    normal = upright @ sole.away
    pivot = arms[sole.feet].mean(axis=0)
    height, known = _surface(site, arms + spot.position, normal)
    if known.mean() < 1 - HOLES:
        return "lie over a hole of the scan"
    side = upright[:, 0]
    across = np.cross(normal, side)
    slope = _supporting_plane((arms - pivot)[known] @ np.stack([side, across], axis=1), height[known])
    if slope is None:
        return "rest on nothing"
    turn = Rotation.align_vectors([normal - slope[0] * side - slope[1] * across], [normal])[0] if slope.any() else None
    tilt = np.zeros(3) if turn is None else turn.as_rotvec()
    turned = arms if turn is None else arms @ turn.as_matrix().T
    position = spot.position + pivot - turned[sole.feet].mean(axis=0)
    # The rays again, now that the model is turned: what is left is a shift along the normal.
    height, known = _surface(site, turned + position, normal)
    if not (known & sole.feet).any():
        return "rest on nothing"
    rise = float(height[known].max()) + CONTACT
    gap = rise - height[known & sole.feet]
    if float(np.median(gap)) > FLOAT + site.noise:
        return "float above a surface that is not flat"
    x, y, z = (float(angle) for angle in tilt)
    return replace(spot, position=position + rise * normal, tilt=(x, y, z))


def _surface(site: Site, points: Array, normal: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Height (K,) of the scan above ``points`` (K, 3) along ``normal``, metres, and where it is known."""
    distance, _ = site.caster.closest(points + REACH * normal, np.broadcast_to(-normal, points.shape))
    height = REACH - np.minimum(distance.astype(np.float64), 1e3)
    return height, np.isfinite(distance) & (height >= float(np.median(height)) - REACH)


def _supporting_plane(places: Array, height: Array) -> Array | None:
    """(2,) slopes of the plane that lies on or above points (N, 2) of ``height`` (N,) and is lowest at the origin.

    It touches the three points on which a body whose weight acts at the origin rests: the face of the upper convex hull
    above it. Each slope is limited so that the tilt is at most `LEAN`.
    """
    limit = math.tan(math.radians(LEAN)) / math.sqrt(2)
    rows = np.column_stack([places, np.ones(len(places))])
    found = linprog([0.0, 0.0, 1.0], A_ub=-rows, b_ub=-height, bounds=[(-limit, limit), (-limit, limit), (None, None)])
    return np.array([found.x[0], found.x[1]]) if found.x is not None else None
