"""Procedural apartments: a floor plan, its shell and its furniture, from a seed."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from generators.apartments.floorplan import SIDES
from generators.apartments.furnish import furnish
from generators.apartments.interior.arrange import Arranger
from generators.apartments.interior.clutter import add_clutter
from generators.apartments.interior.pieces import Placed
from generators.apartments.planning import make_floor_plan
from generators.apartments.shell import build_shell
from generators.assets.materials import Palette
from generators.assets.shapes import rotation
from generators.assets.styles import STYLES
from generators.core.rays import RayCaster
from generators.core.scene import Part, Room, Scene, Support

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

#: Height range of a wall that must be free for a clock (m).
WALL_BAND = (1.4, 2.0)
#: Depth that must be free before such a wall (m).
WALL_CLEARANCE = 0.25
#: Distance of a wall support from the wall's ends (m), and its least length (m).
_WALL_END, _WALL_LENGTH = 0.1, 0.4
#: Horizontal supports with less free height than this are of no use (m).
LOWEST_CLEARANCE = 0.2
#: A piece is above a support if it begins at most this much below it (m) and overlaps it by at least this much (m).
_BELOW, _OVERLAP = 1e-3, 0.01


def _vector(values: Array) -> Vector:
    x, y, z = (round(float(v), 4) for v in values)
    return (x, y, z)


def _part(piece: Placed, name: str) -> Part:
    return Part(name, piece.furniture.mesh.transformed(rotation("y", piece.yaw), piece.position))


def _furniture_supports(a: Arranger) -> list[Support]:
    """The furniture's own supports in the world, with the height that the room leaves free above them."""
    out = []
    for piece in a.placed:
        turn = rotation("y", piece.yaw)
        for support in piece.furniture.supports:
            origin = turn @ np.array(support.origin) + piece.position
            u, v = turn @ np.array(support.u), turn @ np.array(support.v)
            corners = np.stack([origin, origin + u, origin + v, origin + u + v])
            low, high = corners.min(axis=0), corners.max(axis=0)
            above = [
                float(p.low[1] - low[1])
                for p in a.placed
                if p is not piece
                and p.low[1] >= low[1] - _BELOW
                and (p.low[[0, 2]] < high[[0, 2]] - _OVERLAP).all()
                and (p.high[[0, 2]] > low[[0, 2]] + _OVERLAP).all()
            ]
            clearance = min([support.clearance, a.plan.height - float(low[1]), *above])
            if clearance >= LOWEST_CLEARANCE:
                out.append(
                    Support(
                        support.kind,
                        a.room.name,
                        _vector(origin),
                        _vector(u),
                        _vector(v),
                        (0.0, 1.0, 0.0),
                        _vector(turn @ np.array(support.front)),
                        round(clearance, 4),
                    )
                )
    return out


def _room_supports(a: Arranger) -> list[Support]:
    """The floor, and the free stretches of the walls at a clock's height."""
    r = a.room
    out = [
        Support(
            "floor",
            r.name,
            (r.x0, 0.0, r.z0),
            (0.0, 0.0, round(r.z1 - r.z0, 4)),
            (round(r.x1 - r.x0, 4), 0.0, 0.0),
            (0.0, 1.0, 0.0),
            (0.0, 0.0, 1.0),
            a.plan.height,
        )
    ]
    low, high = WALL_BAND
    for side in SIDES:
        wall = r.wall(side)
        for start, stop in a.stretches(wall, WALL_BAND, WALL_CLEARANCE):
            start, stop = max(start, _WALL_END), min(stop, wall.length - _WALL_END)
            if stop - start >= _WALL_LENGTH:
                normal = _vector(wall.normal)
                out.append(
                    Support(
                        "wall",
                        r.name,
                        _vector(wall.point(start, low)),
                        _vector(wall.u * (stop - start)),
                        (0.0, high - low, 0.0),
                        normal,
                        normal,
                        WALL_CLEARANCE,
                    )
                )
    return out


def _furnished(arranged: Arranger) -> tuple[list[Part], list[Support]]:
    """The parts in a room, and what things may stand on there."""
    room = arranged.room
    parts: list[Part] = []
    count: Counter[str] = Counter()
    for piece in arranged.placed:
        kind = piece.furniture.kind
        parts.append(_part(piece, f"{room.name}/{kind}_{count[kind]}"))
        count[kind] += 1
    parts += [Part(f"{room.name}/{extra.name}", extra.mesh) for extra in arranged.extras]
    return parts, _room_supports(arranged) + _furniture_supports(arranged)


def build_apartment(name: str, seed: int, workers: int = 1) -> Scene:
    """Build a furnished flat without its light.

    Args:
        name: the scene's name; it does not influence the flat.
        seed: decides everything, 0 or more; consecutive seeds differ in layout and style.
        workers: threads; the flat does not depend on them.

    Returns:
        A scene of one part per room's shell (``shell_<room>``), one per piece of furniture and small
        thing (``<room>/<kind>_<n>``), all with instance id 0.
    """
    plan_rng, palette_rng, shell_rng, furniture_rng = (
        np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(4)
    )
    plan = make_floor_plan(seed, plan_rng)
    palette = Palette.from_seed(palette_rng, tuple(STYLES)[seed % len(STYLES)])
    pool = ThreadPoolExecutor(workers) if workers > 1 else None
    try:
        # Textures take longest: other threads draw them while this one builds the meshes.
        if pool is not None:
            palette.prepare(pool)
        arranged = [
            furnish(plan, room, palette, seed, rng)
            for room, rng in zip(plan.rooms, furniture_rng.spawn(len(plan.rooms)), strict=True)
        ]
        parts = list(build_shell(plan, palette, shell_rng))
    finally:
        if pool is not None:
            pool.shutdown(cancel_futures=True)
    supports: list[Support] = []
    for own, places in map(_furnished, arranged):
        parts += own
        supports += places
    caster = RayCaster(np.concatenate([part.mesh.positions for part in parts]))
    for room in arranged:
        parts += add_clutter(room, caster, [place for place in supports if place.room == room.room.name])
    rooms = tuple(Room(r.name, (r.x0, 0.0, r.z0), (r.x1, plan.height, r.z1)) for r in plan.rooms)
    return Scene(name, tuple(parts), rooms, tuple(supports))
