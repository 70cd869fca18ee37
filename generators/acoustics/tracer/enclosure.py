"""Whether source or listener lies in a closed body that the other is not in: a wall, a pillar, a wardrobe.

The faces of a mesh do not say which of their sides is the inside (its normals may be turned either way), and a mesh of
furniture has thousands of small gaps. So the space round the point is explored as sound would explore it: walkers
leave the point in all directions, are reflected after Lambert's law at whatever they meet, and go on. Where an opening
has the share p of a body's surface, 1 − (1 − p)^n of the walkers have left after n reflections. The body counts as
closed if less than a tenth has: openings below 1/600 of its surface, which let out less than its walls absorb.

A closed space is a room, and no body, if it is `ROOM_HEIGHT` high and has a place for a ball of `ROOM_WIDTH`: somebody
could stand there. To hear a source through the walls of a room is nothing unusual.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.acoustics.tracer.surfaces import AcousticSurfaces
from generators.core.low_discrepancy import fibonacci_directions
from generators.core.scene import Room

F64 = NDArray[np.float64]

#: Least diameter of a ball that fits into a room, and a room's least height (m): those of a shower.
ROOM_WIDTH, ROOM_HEIGHT = 0.75, 1.8
#: Walkers, reflections of each, share of the walkers that must leave a body with an opening.
_WALKERS, _REFLECTIONS, _LEAVE = 128, 64, 0.1
_MOST_STAY = round((1.0 - _LEAVE) * _WALKERS)
#: Flights after which a ball is tried; the places in which it is, and moves of the ball in each.
_TRIES, _PLACES, _MOVES = frozenset((0, 1, 3, *range(7, _REFLECTIONS, 8))), 8, 4
#: Directions in which the free space round a place is measured, each with its opposite: 8 % too wide at most.
_HALF = fibonacci_directions(32)
_AROUND = np.concatenate([_HALF, -_HALF])
#: Distance before a surface at which a reflected walker goes on (m), on the way it came: it passes no other surface.
_OFF = 1e-3
#: Points of a body to which a line of sight is tried.
_POINTS = 512
_SEED = 37
#: Directions in which a source looks for holes, and the share of them from which a mesh counts as open on purpose.
_VIEWS, _OPEN = fibonacci_directions(200), 0.5


@dataclass(frozen=True, eq=False)
class ClosedBody:
    """A closed space in which nobody could stand.

    Attributes:
        size: (3,) extent in m along the axes.
        points: (P, 3) free points in it.
    """

    size: F64
    points: F64


@dataclass(frozen=True, eq=False)
class Enclosure:
    """The space that a source is in.

    Attributes:
        scene: its name, for messages.
        room: in which the source stands.
        surfaces: of the scene.
        source: (3,) metres.
        body: the closed body that it is in, if any.
    """

    scene: str
    room: Room
    surfaces: AcousticSurfaces
    source: F64
    body: ClosedBody | None

    @classmethod
    def of(cls, scene: str, room: Room, surfaces: AcousticSurfaces, source: F64) -> Enclosure:
        """That of ``source`` (3,); warns if a whole mesh has holes that it sees."""
        if room.is_whole_mesh:
            _warn_of_holes(scene, surfaces, source)
        return cls(scene, room, surfaces, source, closed_body(surfaces, source))

    def check_listener(self, listener: F64) -> None:
        """Refuse a closed body that holds either the source or ``listener`` (3,).

        Raises:
            Avs3dError: naming the scene, which of them is in the body, where, the body's size, and what to do.
        """
        if self.body is not None:
            if not _sees_any(self.surfaces, listener, self.body.points):
                raise self._refusal("source", self.source, self.body)
        elif not _sees_any(self.surfaces, listener, self.source[None]):
            body = closed_body(self.surfaces, listener)
            if body is not None and not _sees_any(self.surfaces, self.source, body.points):
                raise self._refusal("listener", listener, body)

    def _refusal(self, what: str, point: F64, body: ClosedBody) -> Avs3dError:
        other = "listener" if what == "source" else "source"
        size = " × ".join(f"{edge:.2f}" for edge in body.size)
        hint = (
            f"to hear {'it' if what == 'source' else 'sound'} through the body, give its material a transmission"
            if self.room.is_whole_mesh
            else "give the object that it belongs to an instance id above 0"
        )
        return Avs3dError(
            f"{self.scene}: the {what} at {_place(point)} is in a wall or another closed body of {size} m (x, y, z), "
            f"the {other} is not; move it out of the body, or, {hint}"
        )


def _place(point: F64) -> tuple[float, ...]:
    return tuple(np.round(point, 3).tolist())


def _warn_of_holes(scene: str, surfaces: AcousticSurfaces, source: F64) -> None:
    """Warn if a few of the directions from ``source`` (3,) leave the mesh: it has holes."""
    escaped = float(np.mean(np.isinf(surfaces.first_hits(np.repeat(source[None], len(_VIEWS), axis=0), _VIEWS))))
    if 0 < escaped < _OPEN:
        warnings.warn(
            f"{scene}: {100 * escaped:.1f} % of the directions from the source at {_place(source)} leave the mesh "
            "through holes; sound that leaves is lost, as through an open window: close them if there are none",
            stacklevel=4,
        )


def closed_body(surfaces: AcousticSurfaces, point: F64) -> ClosedBody | None:
    """The closed body that ``point`` (3,) is in; None in a room, in the open, and in a body that lets sound through.

    The last is one of whose surfaces a material has a transmission coefficient of its own.
    """
    rng = np.random.default_rng(_SEED)
    at, way = np.repeat(point[None], _WALKERS, axis=0), fibonacci_directions(_WALKERS)
    reach, low, high = np.zeros(_WALKERS), at.copy(), at.copy()
    passed, met = np.empty((_REFLECTIONS, _WALKERS, 3)), np.empty((_REFLECTIONS, _WALKERS), dtype=np.int32)
    stay = np.ones(_WALKERS, dtype=np.bool_)
    for step in range(_REFLECTIONS):
        distance, met[step] = surfaces.closest(at, way)
        gone = met[step] < 0
        reach[gone] = np.inf
        distance = np.where(gone, 0.0, np.maximum(distance - _OFF, 0.5 * distance))
        passed[step], at = at + 0.5 * distance[:, None] * way, at + distance[:, None] * way
        low, high = np.minimum(low, at), np.maximum(high, at)
        reach = np.maximum(reach, np.linalg.norm(at - point, axis=1))
        stay = reach <= np.partition(reach, _MOST_STAY)[_MOST_STAY]
        if np.isinf(reach[stay]).any():
            return None
        size = high[stay].max(axis=0) - low[stay].min(axis=0)
        if step in _TRIES and size[1] >= ROOM_HEIGHT:
            longest = np.argsort(-distance[stay], kind="stable")[:_PLACES]
            if _ball_fits(surfaces, passed[step, stay][longest]):
                return None
        way = _scattered(way, surfaces.mesh.normals[met[step]], rng)
    if surfaces.transmits[surfaces.mesh.material[met[:, stay]]].any():
        return None
    points = passed[:, stay].reshape(-1, 3)
    return ClosedBody(size, points[np.linspace(0, len(points) - 1, _POINTS).astype(np.int64)])


def _scattered(way: F64, normals: F64, rng: np.random.Generator) -> F64:
    """(R, 3) unit directions after reflection by Lambert's law: the normal plus a point on the unit sphere."""
    ball = rng.normal(size=way.shape)
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    new = ball - np.sign((way * normals).sum(axis=1, keepdims=True)) * normals
    return np.asarray(new / np.maximum(np.linalg.norm(new, axis=1, keepdims=True), 1e-12))


def _ball_fits(surfaces: AcousticSurfaces, places: F64) -> bool:
    """Whether a ball of `ROOM_WIDTH` fits near one of ``places`` (P, 3): it is pushed off the nearest surface."""
    radius, row = 0.5 * ROOM_WIDTH, np.arange(len(places))
    opposite = np.roll(np.arange(len(_AROUND)), len(_HALF))
    for _ in range(_MOVES):
        ways = np.tile(_AROUND, (len(places), 1))
        free = surfaces.closest(np.repeat(places, len(_AROUND), axis=0), ways)[0].reshape(len(places), -1)
        nearest = free.argmin(axis=1)
        room = free[row, nearest]
        if (room >= radius).any():
            return True
        push = np.minimum(radius - room, 0.5 * free[row, opposite[nearest]])
        places = places - push[:, None] * _AROUND[nearest]
    return False


def _sees_any(surfaces: AcousticSurfaces, point: F64, others: F64) -> bool:
    """Whether a line from ``point`` (3,) to one of ``others`` (P, 3) is free."""
    ways = others - point
    length = np.linalg.norm(ways, axis=1)
    if (length <= _OFF).any():
        return True
    hit, _ = surfaces.closest(np.broadcast_to(point, ways.shape), ways / length[:, None])
    return bool((hit > length - _OFF).any())
