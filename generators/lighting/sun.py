"""The sun: a parallel beam through the windows, which makes bright patches on floors and walls."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.core.arrays import dot_rows
from generators.core.jit import njit
from generators.core.low_discrepancy import PATTERNS, net, square_points
from generators.core.rays import Tracer
from generators.core.scene import F32, I32
from generators.lighting.emitters import face_areas, face_groups
from generators.lighting.surfaces import LitSurfaces

#: Radiance of a white surface that faces the sun, over that of the brightest window pane.
_SUN_STRENGTH = 1.5
_SUN_COLOUR = np.array([1.0, 0.86, 0.68])
#: Radius of the sun's disc, radians: wider than the true 0.0047, so that a texel can resolve its soft edge.
SUN_RADIUS = 0.012
#: Texels over which the sun's rays of one texel start: interpolation then shows no steps along the beam's edge.
_SUN_BLUR = 2.0
#: Fewer rays per texel than this are shot all at once.
_LEAST_RAYS = 8
#: The least area of a window, square metres.
_LARGE_PANE = 0.3


@dataclass(frozen=True, eq=False)
class Sun:
    """A parallel beam that enters through window panes.

    Attributes:
        direction: (3,) float64 unit vector towards the sun.
        radiance: (3,) float32, reflected radiance of a white surface that faces the sun.
        pane: (F,) bool, the faces that let the beam in.
        roofs: (R, 2, 3) boxes of rooms: what leaves all faces arrives, too, unless it goes through the top of one, for
            scanners do not see glass, and may have left out the ceiling; None: it does not arrive.
        bumps: what is this near along a ray to it is not in its way, metres: the roughness of a scan.
    """

    direction: NDArray[np.float64]
    radiance: F32
    pane: NDArray[np.bool_]
    roofs: F32 | None = None
    bumps: float = 0.0


def through_roof(origins: F32, directions: F32, rooms: F32) -> NDArray[np.bool_]:
    """(N,) whether rays that go up leave one of the boxes ``rooms`` (R, 2, 3) through its top."""
    out = np.zeros(len(origins), dtype=bool)
    for low, high in rooms:
        way = (high[1] - origins[:, 1]) / np.maximum(directions[:, 1], 1e-6)
        at = origins[:, [0, 2]] + way[:, None] * directions[:, [0, 2]]
        out |= (way > 0) & ((at > low[[0, 2]]) & (at < high[[0, 2]])).all(axis=1)
    return out


def _outside(surfaces: LitSurfaces, tracer: Tracer, faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether nothing that looks towards the face lies behind it: a window, rather than a screen before a wall."""
    outward = np.ascontiguousarray(-surfaces.face_normal[faces])
    origin = surfaces.triangles[faces].mean(axis=1) + 0.005 * outward
    free = np.ones(len(faces), dtype=bool)
    ahead = np.arange(len(faces))
    for _ in range(8):
        hits = tracer.intersect(origin[ahead], outward[ahead])
        met = hits["primID"] >= 0
        ahead, face, distance = ahead[met], hits["primID"][met], hits["tfar"][met]
        facing = np.einsum("ij,ij->i", surfaces.face_normal[face], outward[ahead]) < 0
        free[ahead[facing]] = False
        origin[ahead] += (distance + 0.005)[:, None] * outward[ahead]
        ahead = ahead[~facing]
        if not len(ahead):
            break
    return free


def find_sun(name: str, surfaces: LitSurfaces, tracer: Tracer) -> Sun | None:
    """The sun of a flat: on one façade, its direction drawn from the scene's ``name``.

    A window is an upright emitter of glass, of 0.3 m² and more, with nothing of the scene behind it. The façade with
    the most glass gets the sun, at 28-42° above the horizon and 12-40° to a side, so that patches of light reach floor
    and walls.

    Returns:
        The sun, or None where the scene has no window.
    """
    area = face_areas(surfaces.triangles)
    glowing = surfaces.emission[surfaces.material].max(axis=1) > 0
    faces = np.flatnonzero(
        glowing & surfaces.glass[surfaces.material] & (np.abs(surfaces.face_normal[:, 1]) < 0.1) & (area > 1e-6)
    )
    if not len(faces):
        return None
    faces = faces[_outside(surfaces, tracer, faces)]
    if not len(faces):
        return None
    group = face_groups(surfaces, faces)
    faces = faces[np.bincount(group, weights=area[faces])[group] >= _LARGE_PANE]
    if not len(faces):
        return None
    heading = np.arctan2(-surfaces.face_normal[faces, 0], -surfaces.face_normal[faces, 2])
    quarter = np.round(heading / (np.pi / 2)).astype(int) % 4
    glass = np.bincount(quarter, weights=area[faces], minlength=4)
    side = float(np.argmax(np.round(glass, 3)) * np.pi / 2)
    digest = hashlib.sha256(f"sun of {name}".encode()).digest()
    turn, lift = (int.from_bytes(digest[k : k + 4], "little") / 2**32 for k in (0, 4))
    sign = 1.0 if digest[8] & 1 else -1.0
    azimuth = side + sign * np.radians(12.0 + 28.0 * turn)
    height = np.radians(28.0 + 14.0 * lift)
    direction = np.array([np.cos(height) * np.sin(azimuth), np.sin(height), np.cos(height) * np.cos(azimuth)])
    brightest = float(surfaces.emission[surfaces.material[faces]].max())
    pane = np.zeros(len(area), dtype=bool)
    pane[faces] = True
    return Sun(direction=direction, radiance=(_SUN_STRENGTH * brightest * _SUN_COLOUR).astype(np.float32), pane=pane)


@njit
def _sun_rays(
    pattern: I32,
    position: F32,
    normal: F32,
    across: F32,
    direction: NDArray[np.float64],
    side: Any,
    top: Any,
    disc: NDArray[np.float64],
    jitter: F32,
    origins: F32,
    directions: F32,
) -> None:
    count = disc.shape[1]
    for i in range(len(position)):
        p = pattern[i]
        for k in range(count):
            row = i * count + k
            a, b = _SUN_BLUR * (jitter[p, k, 0] - 0.5), _SUN_BLUR * (jitter[p, k, 1] - 0.5)
            for c in range(3):
                origins[row, c] = position[i, c] + a * across[i, 0, c] + b * across[i, 1, c]
                directions[row, c] = direction[c] + disc[p, k, 0] * side[c] + disc[p, k, 1] * top[c]


@lru_cache(maxsize=4)
def _beam_points(samples: int) -> tuple[NDArray[np.float64], F32]:
    """Points (16, samples, 2) on the sun's disc, radians, and in the unit square, one set per pattern.

    Both come from one sequence. In the same order a ray's place on the disc would tell its place in the texel, and the
    light of narrow beams would be wrong by up to a fifth; so the second set is taken in bit-reversed order.
    """
    square = net(PATTERNS * samples, (0x7F4A7C15, 0x94D049BB))
    radius = SUN_RADIUS * np.sqrt(square[:, 0])
    disc = np.stack([radius * np.cos(2 * np.pi * square[:, 1]), radius * np.sin(2 * np.pi * square[:, 1])], axis=1)
    jitter = square_points(samples, (0xBF58476D, 0x1CE4E5B9))
    if samples & (samples - 1) == 0:
        bits = samples.bit_length() - 1
        number = np.arange(samples)
        reverse = sum((number >> bit & 1) << (bits - 1 - bit) for bit in range(bits)) + np.zeros_like(number)
        order = reverse ^ (np.arange(PATTERNS) % samples)[:, None]
        jitter = np.take_along_axis(jitter, order[..., None], axis=1)
    return disc.reshape(PATTERNS, samples, 2), jitter


def sun_light(
    sun: Sun,
    pattern: I32,
    position: F32,
    normal: F32,
    across: F32,
    tracer: Tracer,
    samples: int,
    *,
    objects: Tracer | None = None,
    lost: bool = False,
    block: NDArray[np.integer[Any]] | None = None,
) -> F32:
    """Light (N, 3) of the sun: the share of rays to it that leave through a window pane.

    Rays start all over a texel and beyond. Those whose start lies behind something, as seen from the texel's middle, do
    not count: on a narrow window frame they would start in the wall beside it.

    Args:
        sun: the sun; ``sun.pane`` refers to the faces of ``tracer``.
        pattern: (N,) int32.
        position: (N, 3) float32.
        normal: (N, 3) float32.
        across: (N, 2, 3) float32; the rays start all over the texel.
        tracer: the room.
        samples: rays per texel.
        objects: things that are in the way besides.
        lost: return the light that ``objects`` take away instead of what arrives.
        block: (N,) ascending numbers of groups of neighbouring texels; a group whose first rays all arrive, or all
            do not, shoots no more. Without groups all rays are shot.
    """
    light = np.zeros((len(position), 3), dtype=np.float32)
    cosine = dot_rows(normal, sun.direction.astype(np.float32))
    facing = np.flatnonzero(cosine > 1e-3)
    if not len(facing):
        return light
    side = np.cross(sun.direction, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    top = np.cross(side, sun.direction)
    disc, jitter = _beam_points(samples)

    def share_of(texel: NDArray[np.int64], count: int, *, roughly: bool) -> NDArray[np.float64]:
        """(n,) part of the first ``count`` rays of each texel that arrives (or is lost); ``roughly``: of all starts."""
        origins, directions = (np.empty((len(texel) * count, 3), dtype=np.float32) for _ in range(2))
        _sun_rays(
            pattern[texel],
            position[texel],
            normal[texel],
            across[texel],
            sun.direction,
            side,
            top,
            np.ascontiguousarray(disc[:, :count]),
            np.ascontiguousarray(jitter[:, :count]),
            origins,
            directions,
        )
        rays = np.arange(len(origins))
        if objects is not None:
            blocked = objects.occluded(origins, directions, np.full(len(origins), 1e4, dtype=np.float32))
            rays = np.flatnonzero(blocked == lost)
        starts = origins[rays] + np.float32(sun.bumps) * directions[rays] if sun.bumps else origins[rays]
        found = tracer.intersect(starts, directions[rays])["primID"]
        lit = np.zeros(len(origins), dtype=bool)
        lit[rays] = (found >= 0) & sun.pane[np.maximum(found, 0)]
        if sun.roofs is not None:
            left = rays[found < 0]
            lit[left] = ~through_roof(origins[left], directions[left], sun.roofs)
        valid = np.ones(len(origins), dtype=bool)
        if not (roughly or sun.bumps):
            middle = np.repeat(position[texel], count, axis=0)
            for solid in (tracer, None if lost else objects):
                if solid is not None:
                    valid &= ~solid.occluded(middle, origins - middle, np.ones(len(origins), dtype=np.float32))
        arrived, number = (each.reshape(len(texel), count).sum(axis=1) for each in (lit & valid, valid))
        return np.asarray(arrived / np.maximum(number, 1))

    if block is None or samples < _LEAST_RAYS:
        share = share_of(facing, samples, roughly=False)
    else:
        share = share_of(facing, max(samples // 8, 2), roughly=True)
        group = block[facing] - block[0]
        mean = np.bincount(group, share) / np.maximum(np.bincount(group), 1)
        mixed = ((mean > 0.0) & (mean < 1.0))[group]
        share[mixed] = share_of(facing[mixed], samples, roughly=False)
    light[facing] = (share * cosine[facing])[:, None] * sun.radiance
    return light
