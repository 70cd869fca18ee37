"""How fine the light map of each part is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.core.scene import Mesh, Part, Room, Support
from generators.lighting.texels import Sheet, Texels
from generators.lighting.unwrap import LightMapLayout, unwrap

#: A part gets about this many texels before its texels grow to the preset's size.
_PART_TEXELS = 4500
#: A part whose longest side is less than this (m) is small: it has coarser texels.
SMALL = 0.3
#: In a part whose longest side is less than this (m) texels take their light from those beside them where their own
#: middle lies beyond the face. Leaves and slats have mostly such texels.
_RIMLESS = 1.0
#: The finest texel of small parts, over that of the others: some four texels along ten centimetres.
_SMALL_COARSER = 1.7
#: Faces within this distance of the level of a floor or a support belong to it (m).
_LEVEL = 0.02


@dataclass(frozen=True)
class Fineness:
    """Sizes of texels.

    Attributes:
        texel: side of the texels of large surfaces, metres; small parts get finer ones.
        finest: the smallest texel, metres. That of surfaces on which objects stand: contact shadows lie there.
        floor: how many times finer than ``texel`` floors are, for the same reason.
    """

    texel: float
    finest: float
    floor: float


def lay_out(part: Part, rooms: Sequence[Room], supports: Sequence[Support], fineness: Fineness) -> LightMapLayout:
    """Unwrap one part, or take the light map that it has."""
    if part.light is not None:
        height, width = part.light.texels.shape[:2]
        size = np.array([width, height], dtype=np.float32)
        return LightMapLayout(part.light.uv * size, np.zeros(len(part.light.uv), dtype=np.int32), width, height)
    positions = part.mesh.positions.astype(np.float64)
    cross = np.cross(positions[:, 1] - positions[:, 0], positions[:, 2] - positions[:, 0])
    length = np.linalg.norm(cross, axis=1)
    finest = fineness.finest * (_SMALL_COARSER if is_small(part.mesh) else 1.0)
    texel = float(np.clip(np.sqrt(length.sum() / 2 / _PART_TEXELS), finest, fineness.texel))
    level = positions.mean(axis=1)[:, 1]
    up = cross[:, 1] > 0.99 * length
    finer = np.ones(len(positions), dtype=np.float32)
    carries = up & _near(level, [support.origin[1] for support in supports if _stands_on(part.mesh, support)])
    finer[carries] = max(texel / finest, 1.0)
    if texel >= fineness.texel:
        finer[up & _near(level, [room.low[1] for room in rooms])] = fineness.floor
    return unwrap(part.mesh.positions, texel, finer, part.mesh.normals)


def is_small(mesh: Mesh) -> bool:
    """Whether the mesh is smaller than `SMALL`."""
    return _longest(mesh) < SMALL


def _longest(mesh: Mesh) -> float:
    return float(np.ptp(mesh.bounds, axis=0).max())


def _near(level: NDArray[np.float64], levels: Sequence[float]) -> NDArray[np.bool_]:
    """(F,) whether a height is that of one of ``levels``."""
    return np.asarray((np.abs(level[:, None] - np.array(levels)[None]) < _LEVEL).any(axis=1))


def _stands_on(mesh: Mesh, support: Support) -> bool:
    """Whether the middle of a horizontal support above the floor lies in the box round a mesh."""
    if support.kind in ("floor", "wall"):
        return False
    middle = np.array(support.origin) + (np.array(support.u) + np.array(support.v)) / 2
    return bool(np.all((mesh.bounds[0] - _LEVEL <= middle) & (middle <= mesh.bounds[1] + _LEVEL)))


def rims(parts: Sequence[Part], sheet: Sheet, texels: Texels, part: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(N,) the texels that take their light from those beside them: their middle is beyond the face; see `_RIMLESS`.

    Charts that have no others keep them.

    Args:
        parts: all parts.
        sheet: their light maps.
        texels: the texels.
        part: (N,) part of each texel.
    """
    small = np.array([_longest(each.mesh) < _RIMLESS for each in parts])[part]
    chart = sheet.chart[texels.face]
    inside = np.bincount(chart, texels.area > 0) > 0
    return np.asarray(small & (texels.area <= 0) & inside[chart])
