"""What a scan's mesh holds: how it lies, how large it is, where its rooms are, and how sure that is.

Start reading at `survey`. It looks at the geometry alone; generators/surveying/fitting.py then tries what fits into the
rooms, document.py writes the manifest, page.py the page by which a user checks both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.taxonomy import ROOMS
from avs3d_bench.errors import Avs3dError, UsageError
from generators.assets.modelframe import upright
from generators.core.boxes import yaw_matrix
from generators.core.scene import F32
from generators.surveying.cloud import SurfaceCloud, main_part
from generators.surveying.frame import (
    CEILING,
    FRONT,
    UNITS,
    Levels,
    faces_down,
    find_levels,
    find_scale,
    find_tilt,
    find_turn,
    find_up,
)
from generators.surveying.room_boxes import RoomBox, WallPlan, draw_plan, find_boxes

Array = NDArray[np.float64]

#: Names of rooms in the order of their size.
BY_SIZE = ("living_room", "kitchen", "bathroom")
#: Distance of the points in which a room is surveyed (m).
SPACING = 0.04
#: Points along the diagonal of a mesh whose unit is not known yet.
_COARSE = 150
#: Smallest floor of a room or flat (m²).
LEAST_FLOOR = 2.0
#: A floor that is tilted by more is not used; one that is tilted by more than the first is mentioned (degrees).
TILT_MENTIONED, MOST_TILT = 1.0, 3.0
#: Share of the upright surface parallel to the axes below which the walls are called askew.
_ASKEW = 0.45
#: A height that rooms have, for the message that names a scale; and what no room reaches (m).
_USUAL_HEIGHT, _TOO_HIGH = 2.5, 15.0


@dataclass(frozen=True)
class RoomChoice:
    """What the user says about rooms, in a ``text``: room names with numbers by size from 1, or how many there are."""

    names: tuple[tuple[str, int], ...] = ()
    count: int | None = None
    text: str = ""


@dataclass(frozen=True)
class KnownFrame:
    """What the user says about the file; None: to be found."""

    up: str | None = None
    front: str | None = None
    scale: float | None = None
    rooms: RoomChoice = RoomChoice()


@dataclass(frozen=True)
class Guess:
    """A value that was found: its name, the value as text, how it was found, and how to correct it."""

    name: str
    value: str
    how: str
    correct: str


@dataclass(frozen=True, eq=False)
class Survey:
    """A surveyed scan.

    Attributes:
        up, front: axes of the file that become +Y and +Z.
        turn: degrees about +Y after that.
        scale: metres in a unit of the file.
        levels: floor and ceiling, metres.
        plan: of the walls.
        boxes: all rooms that were found, the largest first.
        rooms: room name → its number in ``boxes``, from 0.
        guesses: what was found, and how.
        warnings: what may be wrong.
    """

    up: str
    front: str
    turn: float
    scale: float
    levels: Levels
    plan: WallPlan
    boxes: tuple[RoomBox, ...]
    rooms: dict[str, int]
    guesses: tuple[Guess, ...]
    warnings: tuple[str, ...]


def survey(name: str, triangles: F32, known: KnownFrame = KnownFrame(), *, gltf: bool = False) -> Survey:
    """Survey a mesh.

    Args:
        name: of the file, for messages.
        triangles: (F, 3, 3) in the file's axes and unit.
        known: what need not be found.
        gltf: whether the file's format says that Y is up.

    Raises:
        Avs3dError: one line, if this is no room: no floor, too small, too tall, two storeys.
        UsageError: if the user names a room that is not there.
    """
    guesses: list[Guess] = []
    warnings: list[str] = []
    extent = float(np.linalg.norm(np.ptp(triangles.reshape(-1, 3).astype(np.float64), axis=0)))
    # One point on each face: a stray face far away does not make the rest small.
    extent = SurfaceCloud.of(triangles, np.inf).diagonal or extent
    rough = SurfaceCloud.of(triangles, max(extent, 1e-9) / _COARSE)
    keep = main_part(rough)
    rough = rough.where(keep)
    up, front = _axes(rough, known, gltf, guesses, warnings)
    rotation = upright(up, front)
    rough = rough.moved(rotation)
    turn, share = find_turn(rough)
    how = f"{share:.0%} of the upright surface is then parallel to the axes"
    guesses.append(Guess("turn", f"{turn:g}°", how, "edit turn: in the manifest"))
    if share < _ASKEW:
        warnings.append(f"only {share:.0%} of the upright surface is at right angles: boxes fit such rooms badly")
    levels = find_levels(rough)
    if levels.height <= 0:
        raise Avs3dError(f"{name}: its surface lies in one plane; expected a room: a floor and walls around it")
    scale = _scale(name, levels, known, guesses)
    _check_levels(name, levels, scale, find_tilt(rough, levels), warnings)
    rotation = yaw_matrix(np.radians(turn)) @ rotation
    cloud = SurfaceCloud.of(triangles, SPACING / scale).moved(rotation, scale)
    junk = _junk(rough.moved(yaw_matrix(np.radians(turn)), scale), cloud)
    if not keep.all() and junk.any():
        share = float(cloud.area[junk].sum() / cloud.area.sum())
        warnings.append(f"floating pieces away from the rest are left out of the survey ({share:.1%} of the surface)")
        cloud = cloud.where(~junk)
    levels = find_levels(cloud)
    if faces_down(cloud, levels):
        cloud = cloud.turned_out()
    plan = draw_plan(cloud, levels)
    boxes = find_boxes(cloud, levels, plan, known.rooms.count)
    if not boxes:
        raise Avs3dError(
            f"{name}: no room found: no floor of at least {LEAST_FLOOR:g} m² between walls; is it the scan of an "
            "object? Otherwise check --scale and --up, or write the manifest by hand (docs/scans.md)"
        )
    rooms = _named(boxes, known.rooms, guesses, warnings)
    if not levels.has_ceiling:
        warnings.append("the scan has no ceiling: rooms end at the top of their walls, and pictures are black there")
    return Survey(up, front, turn, scale, levels, plan, boxes, rooms, tuple(guesses), tuple(warnings))


def _axes(
    cloud: SurfaceCloud, known: KnownFrame, gltf: bool, guesses: list[Guess], warnings: list[str]
) -> tuple[str, str]:
    if known.up is not None:
        up = known.up.removeprefix("+")
        guesses.append(Guess("up", up, "given", "--up AXIS"))
    else:
        found = find_up(cloud, gltf=gltf)
        up = found.axis
        how = "floor and ceiling are the largest planes, and furniture stands on the floor"
        guesses.append(Guess("up", up, how, "--up AXIS"))
        if found.doubt:
            warnings.append(f"the axis {found.doubt} may be up instead of {up}: see the pictures; --up {found.doubt}")
    front = known.front or FRONT[up]
    upright(up, front)  # refuses two parallel axes
    return up, front


def _scale(name: str, levels: Levels, known: KnownFrame, guesses: list[Guess]) -> float:
    """Metres in a unit of the file.

    Raises:
        Avs3dError: if no usual unit makes a room of it.
        UsageError: if the one that is given does not.
    """
    if known.scale is not None:
        if levels.height * known.scale > _TOO_HIGH:
            raise UsageError(
                f"--scale {known.scale:g}: from floor to ceiling there are then {levels.height * known.scale:.3g} m, "
                f"expected at most {_TOO_HIGH:g}: --scale {_USUAL_HEIGHT / levels.height:.3g} makes {_USUAL_HEIGHT:g}"
            )
        guesses.append(Guess("scale", f"{known.scale:g}", "given", "--scale METRES"))
        return known.scale
    found = find_scale(levels.height)
    if levels.storeys > 1:
        found = find_scale(levels.height / 2)
    if found is None:
        raise Avs3dError(
            f"{name}: from floor to ceiling there are {levels.height:.3g} units of the file; expected "
            f"{CEILING[0]:g} to {CEILING[1]:g} m in {', '.join(UNITS)}: is it an object, or a part of a room? Give the "
            f"metres in a unit: --scale {_USUAL_HEIGHT / levels.height:.3g} makes it {_USUAL_HEIGHT:g} m"
        )
    metres, unit = found
    how = f"in {unit} the ceiling is {levels.height * metres:.2f} m high"
    guesses.append(Guess("scale", f"{metres:g}", how, "--scale METRES"))
    return metres


def _check_levels(name: str, levels: Levels, scale: float, tilt: float, warnings: list[str]) -> None:
    """Refuse what is no single storey with a level floor."""
    floor, height = levels.floor_area * scale**2, levels.height * scale
    if levels.storeys > 1:
        raise Avs3dError(
            f"{name}: two floors one above the other, {height:.1f} m from the lowest to the highest level; expected "
            "one storey: cut the scan into one file per storey"
        )
    if floor < LEAST_FLOOR:
        raise Avs3dError(
            f"{name}: its largest level surface near the bottom has {floor:.2g} m²; expected a floor of at least "
            f"{LEAST_FLOOR:g} m²: is it the scan of an object? Otherwise check --scale and --up"
        )
    if tilt > MOST_TILT:
        raise Avs3dError(
            f"{name}: its floor is tilted by {tilt:.1f}°; expected at most {MOST_TILT:g}°: level the scan in the app "
            "that made it, or name the axis that points up with --up"
        )
    if tilt > TILT_MENTIONED:
        warnings.append(f"the floor is tilted by {tilt:.1f}°: objects stand level, a little above or below it")
    if not CEILING[0] <= height <= CEILING[1]:
        warnings.append(f"the ceiling is {height:.2f} m high, which is unusual: check --scale")


def _junk(kept: SurfaceCloud, cloud: SurfaceCloud) -> NDArray[np.bool_]:
    """(P,) which points lie outside the box around the points that were kept."""
    low, high = kept.points.min(axis=0) - SPACING, kept.points.max(axis=0) + SPACING
    return np.asarray(((cloud.points < low) | (cloud.points > high)).any(axis=1))


def _named(boxes: Sequence[RoomBox], choice: RoomChoice, guesses: list[Guess], warnings: list[str]) -> dict[str, int]:
    """Room name → index of its box.

    Raises:
        UsageError: if a number is too high.
    """
    found = len(boxes)
    how = "by size: the scan does not tell what a room is used for"
    if choice.names:
        for name, number in choice.names:
            if number > found:
                sizes = ", ".join(f"{k} ({box.area:.0f} m²)" for k, box in enumerate(boxes, start=1))
                raise UsageError(f"--rooms {name}={number}: found {found} rooms by size: {sizes}")
        named, how = {name: number - 1 for name, number in choice.names}, "given"
    else:
        named = {name: number for number, name in enumerate(BY_SIZE[:found])}
    if choice.count is not None and found != choice.count:
        warnings.append(f"--rooms {choice.count}: found {found}; doors closed or walls missing? See the plan")
    if found > len(ROOMS) and not choice.names:
        warnings.append(
            f"{found} rooms found, and the benchmark has {len(ROOMS)} kinds: choose with --rooms NAME=NUMBER"
        )
    text = ", ".join(f"{name}={number + 1}" for name, number in named.items())
    guesses.append(Guess("rooms", f"{found} found: {text}", how, "--rooms N, or --rooms kitchen=2,bathroom=3"))
    return named
