"""How a scan's file lies in the world: the axis that points up, its tilt, the turn of its walls, its unit.

All by areas of the surface (`SurfaceCloud`), with no names and no labels:

- up: of the three lines, the vertical has the largest planes at its ends; tables and seats face up, and below half the
  height there is more surface than above (furniture);
- tilt: the mean plane of the floor;
- turn: walls meet at right angles, so that the directions of upright faces repeat every 90°;
- unit: a ceiling is 2.0 to 4.5 m high, in one of the units that scanners use.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from generators.surveying.cloud import SurfaceCloud, quantiles

Array = NDArray[np.float64]

#: The axis that becomes +Z for each that points up; any would do, because the turn follows.
FRONT = {"y": "+z", "-y": "+z", "z": "-y", "-z": "+y", "x": "+z", "-x": "+z"}
#: |cosine| of the slope of a level face, and of an upright one.
LEVEL, UPRIGHT = 0.9, 0.3
#: Bins of height over the whole mesh.
_BINS = 120
#: What the usual axes get ahead of the others: glTF says that Y is up; in other files Y or Z is.
_USUAL = {"y": 0.05, "z": 0.05}
_USUAL_GLTF = {"y": 0.15, "z": 0.02}
#: So many points are enough for the axis.
_FEW = 100_000
#: An axis is in doubt if another one is this near to it, in shares of the area.
DOUBT = 0.02
#: A level plane is a floor or a ceiling if it has this share of the area of the largest one.
_LARGE = 0.3
#: Share of the floor's area that a second floor above it has at least.
_STOREY = 0.4
#: Where between floor and ceiling that floor is (shares of the height): worktops end lower.
_SECOND_FLOOR = (0.44, 0.7)
#: Without a ceiling, walls end where less than this share of their usual surface lies (their upper edge is ragged).
_WALL_TOP = 0.4
#: Units of files by their metres, and the heights of ceilings by which they are told (m).
UNITS = {"metres": 1.0, "millimetres": 0.001, "centimetres": 0.01, "feet": 0.3048, "inches": 0.0254}
CEILING = (1.9, 4.5)
#: Angles closer than this to the axes count as parallel (degrees).
_PARALLEL = 0.25


@dataclass(frozen=True)
class UpAxis:
    """The file's axis that points up; ``doubt``: another one that may, or ""."""

    axis: str
    doubt: str = ""


def find_up(cloud: SurfaceCloud, *, gltf: bool = False) -> UpAxis:
    """The axis of the file that points up; ``gltf``: whether the file's format says that Y does.

    Which of the three lines is the vertical is told by the planes at both of its ends (floor and ceiling), which of its
    directions is up by what lies between them.
    """
    few = cloud.thinned(_FEW)
    usual = _USUAL_GLTF if gltf else _USUAL
    ends = {axis: _evidence(few, axis) for axis in FRONT}
    planes = {line: ends[line][0] + ends[f"-{line}"][0] + usual.get(line, 0.0) for line in "xyz"}
    best, second = sorted(planes, key=lambda line: -planes[line])[:2]
    upward = ends[best][1] - ends[f"-{best}"][1] + usual.get(best, 0.0)
    axis, turned = (best, f"-{best}") if upward >= 0 else (f"-{best}", best)
    if planes[best] - planes[second] < DOUBT:
        return UpAxis(axis, second)
    return UpAxis(axis, turned if abs(upward) < DOUBT else "")


def _evidence(cloud: SurfaceCloud, axis: str) -> tuple[float, float]:
    """Of the whole area, the share of the plane at the lower end of ``axis``, and how much speaks for its being up."""
    number, sign = "xyz".index(axis[-1]), -1.0 if axis[0] == "-" else 1.0
    along, slope, area = sign * cloud.points[:, number], sign * cloud.normals[:, number], cloud.area
    low, high = quantiles(along, area, [0.005, 0.995])
    share = (along - low) / max(high - low, 1e-12)
    level = np.abs(slope) >= LEVEL
    bins = np.clip((share * _BINS).astype(np.int64), 0, _BINS - 1)
    per_bin = np.bincount(bins[level], weights=area[level], minlength=_BINS)
    wide = np.convolve(per_bin, np.ones(3), mode="same")
    floor = int(np.argmax(wide[: _BINS * 2 // 5]))
    facing = np.sign(slope) * area
    faces_up = float(facing[level & (np.abs(bins - floor) <= 1)].sum())
    tops = float(facing[level & (bins > floor + 4) & (share < 0.7)].sum())
    half = np.where(share < 0.5, area, -area)
    lower = float(half[level].sum())
    # Furniture has sides, too: below half the height there is more surface than above.
    clutter = float(half[(share > 0.08) & (share < 0.92)].sum())
    total = max(float(area.sum()), 1e-30)
    return float(wide[floor]) / total, (0.5 * faces_up + 0.5 * tops + 0.3 * lower + 0.5 * clutter) / total


@dataclass(frozen=True)
class Levels:
    """Heights along the up axis, in the unit of the mesh.

    Attributes:
        floor: of the floor.
        ceiling: of the ceiling, or of the top of the walls.
        has_ceiling: whether there is one.
        floor_area: level surface at the floor's height, square units.
        total_area: of the whole surface.
        storeys: floors, one above the other.
    """

    floor: float
    ceiling: float
    has_ceiling: bool
    floor_area: float
    total_area: float
    storeys: int = 1

    @property
    def height(self) -> float:
        """From floor to ceiling."""
        return self.ceiling - self.floor


def find_levels(cloud: SurfaceCloud) -> Levels:
    """Floor and ceiling of a mesh whose +Y is up: the lowest and highest of the large level planes."""
    low, high = quantiles(cloud.points[:, 1], cloud.area, [0.002, 0.998])
    width = max(high - low, 1e-12) / _BINS
    y = cloud.points[:, 1]
    level = np.abs(cloud.normals[:, 1]) >= LEVEL
    at = np.clip(((y - low) / width).astype(np.int64), 0, _BINS - 1)
    per_bin = np.bincount(at[level], weights=cloud.area[level], minlength=_BINS)
    wide = np.convolve(per_bin, np.ones(3), mode="same")
    large = np.flatnonzero(wide >= _LARGE * wide.max())
    floor, area = _plane(cloud, level, low + (large[0] + 1.0) * width, width)
    top = [index for index in large if low + index * width > floor + 0.65 * (high - floor)]
    if top:
        ceiling = _plane(cloud, level, low + (top[-1] + 0.5) * width, width)[0]
    else:
        per_bin = np.bincount(at[~level], weights=cloud.area[~level], minlength=_BINS)
        usual = float(np.median(per_bin[round(0.4 * _BINS) : round(0.7 * _BINS)]))
        ceiling = low + (float(np.flatnonzero(per_bin >= _WALL_TOP * usual)[-1]) + 1.0) * width
    facing_up = cloud.normals[:, 1] >= LEVEL
    up_per_bin = np.bincount(at[facing_up], weights=cloud.area[facing_up], minlength=_BINS)
    first, last = (round((floor + share * (ceiling - floor) - low) / width) for share in _SECOND_FLOOR)
    middle = np.convolve(up_per_bin, np.ones(3), mode="same")[first:last]
    storeys = 2 if area > 0 and middle.max(initial=0.0) >= _STOREY * area else 1
    return Levels(floor, ceiling, bool(top), area, float(cloud.area.sum()), storeys)


def _plane(cloud: SurfaceCloud, level: NDArray[np.bool_], middle: float, width: float) -> tuple[float, float]:
    """Height and area of the level surface around a bin; its middle and 0 if there is none."""
    own = level & (np.abs(cloud.points[:, 1] - middle) <= 2 * width)
    if not own.any():
        return middle, 0.0
    height, area = cloud.points[own, 1], cloud.area[own]
    return float(quantiles(height, area, [0.5])[0]), float(area.sum())


def faces_down(cloud: SurfaceCloud, levels: Levels) -> bool:
    """Whether most of the floor faces down: the faces of the file are wound the other way round."""
    own = (np.abs(cloud.normals[:, 1]) >= LEVEL) & (np.abs(cloud.points[:, 1] - levels.floor) <= 0.03 * levels.height)
    return float((np.sign(cloud.normals[own, 1]) * cloud.area[own]).sum()) < 0


def find_tilt(cloud: SurfaceCloud, levels: Levels) -> float:
    """Angle between the floor and the level, degrees: of the plane through the floor's points; 0 without a floor."""
    near = 0.03 * levels.height
    for _ in range(2):
        own = (np.abs(cloud.normals[:, 1]) >= LEVEL) & (np.abs(cloud.points[:, 1] - levels.floor) <= near)
        points, weight = cloud.points[own], cloud.area[own]
        if not len(points):
            return 0.0
        middle = (points * weight[:, None]).sum(axis=0) / weight.sum()
        around = (points - middle) * np.sqrt(weight)[:, None]
        normal = np.linalg.eigh(around.T @ around)[1][:, 0]
        near *= 0.7
    return float(np.degrees(np.arccos(min(abs(normal[1]), 1.0))))


def find_turn(cloud: SurfaceCloud) -> tuple[float, float]:
    """Degrees about +Y by which the walls become parallel to the axes, −45 to 45, and the share of them that does.

    A face looks along (sin a, 0, cos a); the histogram of a modulo 90° has its peak where most of the walls' area is.
    """
    upright_ones = np.abs(cloud.normals[:, 1]) <= UPRIGHT
    normals, area = cloud.normals[upright_ones], cloud.area[upright_ones]
    if not len(area):
        return 0.0, 0.0
    angle = np.degrees(np.arctan2(normals[:, 0], normals[:, 2])) % 90.0
    counts = np.bincount((angle * 2).astype(np.int64) % 180, weights=area, minlength=180)
    peak = (int(np.argmax(ndimage.gaussian_filter1d(counts, 2.0, mode="wrap"))) + 0.5) / 2
    for reach in (4.0, 2.0):
        off = (angle - peak + 45.0) % 90.0 - 45.0
        near = np.abs(off) <= reach
        peak += float((off * area)[near].sum() / area[near].sum())
    off = (angle - peak + 45.0) % 90.0 - 45.0
    share = float(area[np.abs(off) <= 5.0].sum() / area.sum())
    turn = -((peak + 45.0) % 90.0 - 45.0)
    return (0.0 if abs(turn) < _PARALLEL else round(turn, 2)), share


def find_scale(height: float) -> tuple[float, str] | None:
    """Metres in a unit of the file and the name of the unit, by the height of the ceiling in units; None if unclear."""
    for name, metres in UNITS.items():
        if CEILING[0] <= height * metres <= CEILING[1]:
            return metres, name
    return None
