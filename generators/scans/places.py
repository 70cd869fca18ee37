"""What the surfaces of a scan without annotations are: floor, wall, window, shelves, something soft or another.

A face is judged by where it is, by the slopes of the surface within 15 cm around it, and by its texture:

1. *floor*: level, within 12 cm of the room's floor; *ceiling*: level, in the highest quarter of the room.
2. *wall*: upright and flat, within 12 cm of a side of the room's box, or part of something that reaches up to 1.9 m.
   *window*: a part of a wall of 0.25–6 m² where the texture is clipped (white in all channels) and around it is not:
   cameras expose for the room.
3. *furniture*: every other flat surface. A level one 0.2–0.75 m high and larger than a table is a bed: *soft*.
4. Where slopes are mixed: within 45 cm of a side, *curtain* if the surface is upright, corrugated in one direction and
   at least 1.2 m high, *shelves* if its texture is busy (the spines of books); else *soft* up to 1.3 m (sofas,
   cushions, clothes, heaps); *other* above.

"Flat" is the share of the area around a face whose normals lie within an angle of one of three perpendicular
directions (those of the room and of the things that stand along its walls), or of one plane. The angle is 18°, or more
where the scan is so noisy that its floor would not be flat.

These are guesses: `generators.scans.sound` prints them, and the manifest corrects them (``surfaces``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from generators.core.scene import Mesh, Room
from generators.scans.looks import FaceLooks, face_looks

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Cells = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]

#: What a face can be; the keys of a manifest's ``surfaces``. ``other``: also all that lies outside the rooms.
PLACES = ("floor", "wall", "ceiling", "window", "soft", "shelves", "curtain", "furniture", "other")
#: Why a face is thought to be there, for the table.
REASONS = {
    "floor": "level, at the height of the floor",
    "wall": "upright and flat, at a side of the room or as high as a door",
    "ceiling": "level, high above the floor",
    "window": "a clipped white area of a wall",
    "soft": "mixed slopes below 1.3 m, or level, low and larger than a table",
    "shelves": "mixed slopes and a busy texture near a wall",
    "curtain": "upright and corrugated near a wall",
    "furniture": "flat, away from the sides",
    "other": "mixed slopes above 1.3 m, or outside the rooms",
}
#: Side of a cell (m); what is averaged over is three cells wide.
CELL = 0.1
#: A room's faces may lie this far outside its box (m).
AROUND = 0.35
#: |cosine| of a level and of an upright surface's slope.
_LEVEL, _UPRIGHT = 0.8, 0.35
#: Distance from the floor's height or the side's plane (m).
_NEAR = 0.12
#: Share of the room's height from which on level faces are ceiling; height that walls and door frames reach (m).
_HIGH, _WALL_TOP = 0.75, 1.9
#: Least angle within which normals agree (degrees), and the multiple of the floor's own scatter.
_ANGLE, _SCATTER = 18.0, 2.5
#: Share of the area around a flat face that is flat with it.
_FLAT = 0.8
#: Heights of a bed (m), and its least area (m²).
_BED, _BED_AREA = (0.2, 0.75), 1.5
#: Greatest height of soft things, depth of shelves and curtains from a side, least height and width of a curtain (m).
_SOFT_TOP, _DEPTH, _CURTAIN, _CURTAIN_WIDTH = 1.3, 0.45, 1.2, 0.4
#: Standard deviation of the luminance (0–1, sRGB) within a cell of a busy texture.
_BUSY = 0.11
#: sRGB value (0–1) of clipped texels; range of a window's area (m²); luminance around it.
_CLIPPED, _WINDOW, _FRAME = 0.97, (0.25, 6.0), 0.85


@dataclass(frozen=True, eq=False)
class _Faces:
    """The faces of one room.

    Attributes:
        middle: (N, 3) centres, metres.
        top: (N,) highest corner, metres.
        normal: (N, 3) unit normals.
        area: (N,) m².
        looks: of these faces.
    """

    middle: Array
    top: Array
    normal: Array
    area: Array
    looks: FaceLooks


def places_of(mesh: Mesh, rooms: Sequence[tuple[Room, float]]) -> NDArray[np.str_]:
    """(A,) the place (`PLACES`) of every acoustic face of ``mesh``; where rooms overlap, the first counts.

    Args:
        mesh: of a scan, before its acoustic twin is decimated.
        rooms: each room with the height of its floor.
    """
    triangles = mesh.acoustic_positions.astype(np.float64)
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(cross, axis=1)
    normal = cross / np.maximum(length, 1e-20)[:, None]
    middle, top = triangles.mean(axis=1), triangles[..., 1].max(axis=1)
    looks = face_looks(mesh)
    places = np.full(len(triangles), "other", dtype="<U9")
    left = np.ones(len(triangles), dtype=bool)
    for room, floor in rooms:
        inside = left & near_room(middle, room, AROUND)
        own = _Faces(middle[inside], top[inside], normal[inside], length[inside] / 2, looks.of(inside))
        places[inside] = _places_in(own, room, floor)
        left &= ~inside
    return places


def near_room(points: Array, room: Room, margin: float) -> Mask:
    """(N,) whether points (N, 3) lie in the room's box or within ``margin`` metres of it."""
    low, high = np.asarray(room.low) - margin, np.asarray(room.high) + margin
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def _places_in(faces: _Faces, room: Room, floor: float) -> NDArray[np.str_]:
    places = np.full(len(faces.area), "other", dtype="<U9")
    if not len(faces.area):
        return places
    low, high = np.asarray(room.low), np.asarray(room.high)
    above, slope = faces.middle[:, 1] - floor, np.abs(faces.normal[:, 1])
    ground = (np.abs(above) <= _NEAR) & (slope >= _LEVEL)
    cells, shape = _cells(faces.middle, low - AROUND - CELL, high + AROUND + CELL)
    flat = _flat(faces, cells, shape, _angle(slope, ground))
    aside = np.minimum(
        np.abs(faces.middle[:, [0, 2]] - low[[0, 2]]), np.abs(faces.middle[:, [0, 2]] - high[[0, 2]])
    ).min(axis=1)
    aside[((faces.middle < low) | (faces.middle > high))[:, [0, 2]].any(axis=1)] = 0.0
    wall = flat & (slope <= _UPRIGHT) & ((aside <= _NEAR) | (_reach(faces, flat, cells, shape) - floor >= _WALL_TOP))
    places[flat] = "furniture"
    places[~flat & (above <= _SOFT_TOP)] = "soft"
    places[flat & _beds(faces.area, (slope >= _LEVEL) & (above > _BED[0]) & (above < _BED[1]), cells, shape)] = "soft"
    rough = ~flat & (above > _NEAR) & (aside <= _DEPTH)
    places[rough & _busy(faces, cells, shape)] = "shelves"
    places[_curtains(faces, rough, cells, shape)] = "curtain"
    places[wall] = "wall"
    places[wall & _windows(faces, wall, cells, shape)] = "window"
    places[ground] = "floor"
    # Where furniture hides the floor its lowest faces are no floor; what is below it is.
    places[above < -_NEAR] = "floor"
    places[(above >= _HIGH * (high[1] - floor)) & (slope >= _LEVEL)] = "ceiling"
    places[(above >= high[1] - floor - _NEAR) & ~wall] = "ceiling"
    return places


def _cells(points: Array, low: Array, high: Array) -> tuple[Cells, tuple[int, int, int]]:
    """The cell of each point, and the number of cells along each axis."""
    x, y, z = np.ceil((high - low) / CELL).astype(np.int64)
    index = np.clip(np.floor((points - low) / CELL).astype(np.int64), 0, np.array([x, y, z]) - 1)
    return (index[:, 0], index[:, 1], index[:, 2]), (int(x), int(y), int(z))


def _sums(values: Array, cells: Cells, shape: tuple[int, int, int]) -> Array:
    """Sums of ``values`` (N,) over each cell and its neighbours, at each point (N,)."""
    flat = np.ravel_multi_index(cells, shape)
    total = np.bincount(flat, values, int(np.prod(shape))).reshape(shape)
    for axis in range(3):
        total = ndimage.convolve1d(total, np.ones(3), axis=axis, mode="constant")
    return np.asarray(total[cells])


def _angle(slope: Array, ground: Mask) -> float:
    """Angle in degrees within which normals agree: the floor is flat."""
    if not ground.any():
        return _ANGLE
    scatter = float(np.median(np.degrees(np.arccos(np.clip(slope[ground], 0.0, 1.0)))))
    return float(np.clip(_SCATTER * scatter, _ANGLE, 2 * _ANGLE))


def _flat(faces: _Faces, cells: Cells, shape: tuple[int, int, int], angle: float) -> Mask:
    """Whether the surface around each face lies in one plane, or in planes along the axes."""
    n, area = faces.normal, faces.area
    whole = np.maximum(_sums(area, cells, shape), 1e-12)
    along = (np.abs(n) >= np.cos(np.radians(angle))).any(axis=1)
    aligned = _sums(area * along, cells, shape) / whole
    tensor = np.zeros((len(n), 3, 3))
    for i in range(3):
        for j in range(i, 3):
            tensor[:, i, j] = tensor[:, j, i] = _sums(area * n[:, i] * n[:, j], cells, shape) / whole
    largest = np.linalg.eigvalsh(tensor)[:, 2]
    # A plane whose normals scatter by the angle has cos² of it.
    return np.asarray((aligned >= _FLAT) | (largest >= 1 - (1 - _FLAT) / 2 - np.sin(np.radians(angle)) ** 2 / 4))


def _reach(faces: _Faces, flat: Mask, cells: Cells, shape: tuple[int, int, int]) -> Array:
    """(N,) height in m that flat upright surfaces have within a cell of each face in plan."""
    tops = np.full(shape[::2], -np.inf)
    upright = flat & (np.abs(faces.normal[:, 1]) <= _UPRIGHT)
    np.maximum.at(tops, (cells[0][upright], cells[2][upright]), faces.top[upright])
    return np.asarray(ndimage.maximum_filter(tops, 3, mode="constant", cval=-np.inf)[cells[0], cells[2]])


def _beds(area: Array, level: Mask, cells: Cells, shape: tuple[int, int, int]) -> Mask:
    """Whether each face belongs to a ``level`` area in plan that is larger than a table."""
    plan = np.zeros(shape[::2])
    np.add.at(plan, (cells[0][level], cells[2][level]), area[level])
    parts, count = ndimage.label(plan > 0)
    sizes = np.bincount(parts.reshape(-1), plan.reshape(-1), count + 1)
    sizes[0] = 0.0
    return np.asarray(level & (sizes[parts[cells[0], cells[2]]] >= _BED_AREA))


def _busy(faces: _Faces, cells: Cells, shape: tuple[int, int, int]) -> Mask:
    """Whether the luminance within cells varies much, in the mean over those up to two cells from each face.

    Within cells: where a dark sofa stands before a light wall, only few cells have both.
    """
    flat = np.ravel_multi_index(cells, shape)
    size, first, second = (
        np.bincount(flat, faces.area * values, int(np.prod(shape))).reshape(shape)
        for values in (np.ones(len(flat)), faces.looks.luminance, faces.looks.square)
    )
    within = np.maximum(second - first**2 / np.maximum(size, 1e-12), 0.0)
    for axis in range(3):
        size, within = (ndimage.convolve1d(grid, np.ones(5), axis=axis, mode="constant") for grid in (size, within))
    return np.asarray((within >= _BUSY**2 * size)[cells])


def _curtains(faces: _Faces, rough: Mask, cells: Cells, shape: tuple[int, int, int]) -> Mask:
    """Whether each face belongs to a ``rough`` upright surface that waves along the wall and is high and wide."""
    upright = np.abs(faces.normal[:, 1]) <= _UPRIGHT
    whole = np.maximum(_sums(faces.area, cells, shape), 1e-12)
    waves = rough & upright & (_sums(faces.area * upright, cells, shape) / whole >= 0.9)
    grid = np.zeros(shape, dtype=bool)
    grid[tuple(axis[waves] for axis in cells)] = True
    parts, count = ndimage.label(grid, np.ones((3, 3, 3)))
    found = np.zeros(count + 1, dtype=bool)
    for number, box in enumerate(ndimage.find_objects(parts), start=1):
        extent = [(side.stop - side.start) * CELL for side in box]
        found[number] = extent[1] >= _CURTAIN and max(extent[0], extent[2]) >= _CURTAIN_WIDTH
    return np.asarray(waves & found[parts[cells]])


def _windows(faces: _Faces, wall: Mask, cells: Cells, shape: tuple[int, int, int]) -> Mask:
    """Whether each face belongs to a bright area of a wall with the size of a window and darker surroundings."""
    bright, size, light = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    own = tuple(axis[wall] for axis in cells)
    np.add.at(size, own, faces.area[wall])
    np.add.at(bright, own, faces.area[wall] * faces.looks.clipped[wall])
    np.add.at(light, own, faces.area[wall] * faces.looks.luminance[wall])
    pane = (size > 0) & (bright >= 0.6 * size)
    parts, count = ndimage.label(pane, np.ones((3, 3, 3)))
    found = np.zeros(count + 1, dtype=bool)
    for number, box in enumerate(ndimage.find_objects(parts), start=1):
        part = parts[box] == number
        if not _WINDOW[0] <= float(size[box][part].sum()) <= _WINDOW[1]:
            continue
        ring = (
            ndimage.binary_dilation(parts == number, np.ones((3, 3, 3), dtype=bool), iterations=2) & ~pane & (size > 0)
        )
        found[number] = bool(ring.any()) and float(light[ring].sum() / size[ring].sum()) <= _FRAME
    return np.asarray(found[parts[cells]])
