"""Progress along a given path that never collides with a moving object.

The path is given; only the progress along it is chosen (path-velocity decomposition: K. Kant, S. W. Zucker, "Toward
Efficient Trajectory Planning: The Path-Velocity Decomposition", IJRR 5(3), 1986), here exactly, by dynamic programming
over (second, centimetre of the path).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Extra cost of a step backwards, and of standing still, compared with a step forwards of another length.
_BACK, _STILL = 2.0, 1.0


def pace(
    free: NDArray[np.bool_], wanted: Array, spacing: float, *, most: float, back: float
) -> NDArray[np.int64] | None:
    """Find progress along a path, one step per second, on free points only.

    Args:
        free: (2n − 1, M) whether point m of the path may be occupied at half second k.
        wanted: (n − 1,) wanted steps, metres.
        spacing: between the points of the path, metres.
        most: longest step, metres.
        back: longest step backwards, metres.

    Returns:
        (n,) indices of the path's points; None if there is no solution.
    """
    points = free.shape[1]
    steps = range(-round(back / spacing), round(most / spacing) + 1)
    # The walk may begin at any free point of the first quarter.
    cost = np.where(free[0] & (np.arange(points) <= max(points // 4, 1)), 0.0, np.inf)
    came: list[NDArray[np.int64]] = []
    for frame, want in enumerate(wanted):
        best, choice = np.full(points, np.inf), np.zeros(points, dtype=np.int64)
        for step in steps:
            target = np.arange(max(0, step), min(points, points + step))
            start = target - step
            price = ((step * spacing - want) / max(want, 0.05)) ** 2 + _BACK * (step < 0) + _STILL * (step == 0)
            total = cost[start] + price
            total[~free[2 * frame + 1, (start + target) // 2]] = np.inf
            better = total < best[target]
            best[target[better]] = total[better]
            choice[target[better]] = start[better]
        best[~free[2 * frame + 2]] = np.inf
        cost = best
        came.append(choice)
    if not np.isfinite(cost).any():
        return None
    at = [int(np.argmin(cost))]
    for choice in reversed(came):
        at.append(int(choice[at[-1]]))
    return np.array(at[::-1])
