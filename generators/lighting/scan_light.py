"""The light of a scanned room, guessed from its pictures: what shines in it, and how much.

A picture tells the radiance B of a surface up to where it clips: windows and lamps are brighter by a factor that it
does not show. The other surfaces tell it, because they are lit by them (inverse global illumination: Yu, Debevec,
Malik, Hawkins, SIGGRAPH 1999; for the lamps of scanned rooms: Zhang, Cohen, Curless, "Emptying, Refurnishing, and
Relighting Indoor Spaces", SIGGRAPH Asia 2016). At a matte surface with albedo ρ::

    B = ρ (E + Σ s_r F_r)

with E the light (irradiance / π) from all that is seen there as the pictures show it, F_r the form factor of the
clipped region r with what is in its way, and s_r ≥ 0 the radiance that it has beyond the clipping. Two more sources may
be missing in a scan: what shines through its holes, and lamps below the ceiling that the scanner left out; the first is
a region of all directions in which rays leave the scan, the second one of all the ceiling. The s_r are those with which
the albedos are most plausible, in least squares over the logarithms: surfaces that are alike (side, colour) have like
albedos, and these scatter about the values that are usual indoors (EN 12464-1:2021 recommends 0.7–0.9 for ceilings,
0.5–0.8 for walls, 0.2–0.6 for floors; with furniture they are lower). So the brightness falls off along the walls as it
does in the pictures, and the energy balance of the room is right even where nothing clips.

The light of the regions is neutral: a phone balances white for it. The sun is found apart (scan_sun.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.optimize import least_squares

from generators.core.low_discrepancy import PATTERNS, cosine_directions, net
from generators.core.scene import F32, I32, Mesh, Room, ScanLight, Scene
from generators.core.tone import LUMINANCE, inverse_tone_curve, srgb_decode
from generators.lighting.direct import direct_light
from generators.lighting.emitters import Emitters, bright_patches, face_areas
from generators.lighting.gather import hemisphere_rays
from generators.lighting.lit_scene import LitScene, Unseen, is_bright, without_black
from generators.lighting.scan_sun import LevelPoints, find_scan_sun
from generators.lighting.surfaces import LitSurfaces, albedo_at

#: Radiance from which a texel may be clipped: sRGB 250 of 255, for JPEG and resampling blur the end of the range.
CLIPPED = float(inverse_tone_curve(srgb_decode(250 / 255)))
#: Where less than this part of the surfaces clips, the brightest ones down to this radiance (sRGB 225) may shine:
#: pictures of several exposures were blended.
_SHINING, _LEAST = 0.005, float(inverse_tone_curve(srgb_decode(225 / 255)))
#: Cells of the walls (m) that may be holes, and the smallest hole that may be a window (m²).
_CELL, _WINDOW = 0.15, 0.1
#: Part of the surface that is darkest in a room, and the radiance that it has in pictures without flare, in that of the
#: median (0 to 3 % in a scanned room and three simulated phone scans, 4.7 % in a white bathroom).
_DARKEST, _DARK = 0.002, 0.03
#: A black level below this radiance (7 of 255) counts as none.
_LEAST_BLACK = 0.005
#: Share of the median above which the darkest points are no shadows. Fog of .05, which is much, leaves .2 in our rooms.
_NOTHING_DARK = 0.3
#: Distance of the points that look for clipped texels, metres, and the most points.
_SPACING, _MOST_POINTS = 0.02, 400_000
#: What lies this far round the rooms counts, metres.
_AROUND = 1.0
#: Bright points in voxels of this side (m) that touch are one region. The radiance of the largest ones is sought.
_REGION, _MOST_REGIONS = 0.15, 24
#: Sides of the patches on which light is balanced (m), and how many at most.
_PATCH, _MOST_PATCHES = 0.3, 600
#: Places on a patch where its light is measured, and the rays of each.
_PLACES, _RAYS = 4, 64
#: Usual albedos of what faces down, sideways and up, and the spreads of a kind's mean and of patches about it (natural
#: logarithms).
_ALBEDO = (0.7, 0.5, 0.3)
_KINDS, _WITHIN = 0.4, 0.5
#: By how much a clipped region is usually brighter than the end of the range, and the spread of that (natural
#: logarithms).
_BRIGHTER, _BRIGHTNESS = 1.6, 1.2
#: The same of what faces up: it is lit, by the sun perhaps, and does not shine itself.
_LIT_BRIGHTER, _LIT_BRIGHTNESS = 0.5, 0.4
#: Colours (logarithm of red and blue over green) within steps of this size are of one kind.
_COLOUR = 0.35
#: Which part of the way from floor to ceiling is below the ceiling's height.
_CEILING = 0.8
#: Eyes per room, and rays from each, that find the surfaces seen in it.
_EYES, _LOOKS = 16, 2048
#: Clipped regions that are sampled as emitters near an object.
_EMITTERS = 16


_NONE = np.zeros((0, 3), dtype=np.float32)

#: What was estimated for the scans that are in memory, with their rooms.
_known: WeakKeyDictionary[Mesh, tuple[tuple[Room, ...], ScanLight]] = WeakKeyDictionary()


def with_scan_light(scene: Scene) -> Scene:
    """A scan with the light that its pictures do not show; any other scene as it is."""
    home = tuple(part for part in scene.parts if scene.is_scan(part))
    if scene.scan_light is not None or not home:
        return scene
    known = _known.get(home[0].mesh)
    if known is None or known[0] != scene.rooms:
        lit = LitScene.of(tuple(replace(part, light=None) for part in home), [True] * len(home))
        known = _known[home[0].mesh] = scene.rooms, estimate(lit, scene.rooms)
    return replace(scene, scan_light=known[1])


def emitters_of(light: ScanLight, samples: int, boxes: Sequence[F32]) -> Emitters:
    """What shines as emitters with ``samples`` targets; of many, those that matter to ``boxes`` (2, 3)."""
    away = np.full(len(light.position), np.inf)
    for box in boxes:
        away = np.minimum(away, np.sum((light.position - box.mean(axis=0)) ** 2, axis=1))
    worth = (1.0 / (away + 0.1)).astype(np.float32)
    spread = (light.position, light.normal, light.area, light.radiance)
    return bright_patches(*spread, samples, importance=worth, most=_EMITTERS)[0]


def without_emitters(light: ScanLight, lit: LitScene, scanned: NDArray[np.bool_]) -> LitScene:
    """``lit``, of which the parts ``scanned`` (P,) are a scan, with its light apart from what shines."""
    own = scanned[lit.surfaces.part]
    glow = np.where((own & _is_ceiling(lit.surfaces, light.ceiling))[:, None], light.glow, np.float32(0.0))
    return replace(lit, unseen=Unseen(own, light.limit, glow.astype(np.float32), light.beyond))


def estimate(lit: LitScene, rooms: tuple[Room, ...]) -> ScanLight:
    """Estimate the light of a scan.

    Args:
        lit: the scan alone.
        rooms: the rooms whose surfaces tell; without any, all of the scan.
    """
    surfaces = lit.surfaces
    if not rooms:
        corners = surfaces.triangles.reshape(-1, 3)
        low, high = (tuple(float(c) for c in end) for end in (corners.min(axis=0), corners.max(axis=0)))
        rooms = (Room("scan", low, high),)  # type: ignore[arg-type]
    lift = black_level(surfaces, rooms)
    lit = without_black(lit, np.ones(int(surfaces.part.max()) + 1, dtype=bool), lift)
    surfaces = lit.surfaces
    looks = _look_around(lit, rooms)
    limit, shining = _bright_points(surfaces, rooms)
    # In a flat, small things that clip would otherwise take the places of the windows.
    regions = sorted([*shining, *_openings(looks, rooms)], key=lambda region: -float(region.area.sum()))
    regions = regions[:_MOST_REGIONS]
    position, normal = (
        np.concatenate([getattr(r, name) for r in regions] or [_NONE]) for name in ("position", "normal")
    )
    area = np.concatenate([r.area for r in regions] or [_NONE[:, 0]])
    ceiling = max(r.low[1] + _CEILING * (r.high[1] - r.low[1]) for r in rooms)
    black, nothing = np.zeros_like(surfaces.face_normal), np.zeros(3, dtype=np.float32)
    patches = _seen_patches(lit, looks, limit)
    power = np.zeros(len(regions) + 2)
    shown = np.array([r.shown for r in regions] + [0.0, 0.0])
    if len(patches.position):
        dark = Unseen(np.ones(len(black), dtype=bool), limit, black, nothing)
        around, overhead, outside = _gathered(replace(lit, unseen=dark), patches, ceiling)
        shares = np.stack([*(_form_factors(lit, patches, r) for r in regions), overhead, outside], axis=1)
        level = np.array([r.normal[:, 1].mean() > 0.7 for r in regions], dtype=bool)
        power = _balanced(patches, around + shares @ shown, shares, level)
    total = (power + shown)[: len(regions)]
    radiance = np.repeat(total, [len(r.position) for r in regions])[:, None] * np.ones(3)
    glow, beyond = (np.full(3, power[k], dtype=np.float32) for k in (-2, -1))
    up = normal[:, 1] > 0.7
    clipped = LevelPoints(position[up], radiance[up].astype(np.float32))
    sun = find_scan_sun(lit, rooms, _level_points(lit, looks, rooms), clipped, limit)
    return ScanLight(position, normal, area, radiance.astype(np.float32), limit, beyond, ceiling, glow, sun, lift)


def _level_points(lit: LitScene, looks: _Looks, rooms: tuple[Room, ...]) -> list[LevelPoints]:
    """What faces up in the lower half of each room and is seen there."""
    face = looks.hits["primID"]
    level = lit.front(looks.hits, looks.directions) & (lit.surfaces.face_normal[np.maximum(face, 0), 1] > 0.7)
    found = []
    for number, room in enumerate(rooms):
        own = np.flatnonzero(level & (looks.room == number))
        position = looks.origins[own] + looks.directions[own] * looks.hits["tfar"][own, None]
        low = position[:, 1] < (room.low[1] + room.high[1]) / 2
        own, position = own[low], position[low]
        found.append(
            LevelPoints(position, albedo_at(lit.surfaces, face[own], looks.hits["u"][own], looks.hits["v"][own]))
        )
    return found


@dataclass(frozen=True, eq=False)
class _Region:
    """Something that shines: points spread over it.

    Attributes:
        position: (n, 3).
        normal: (n, 3).
        area: (n,) that each stands for, square metres.
        shown: radiance that the pictures show of it.
    """

    position: F32
    normal: F32
    area: F32
    shown: float


@dataclass(frozen=True, eq=False)
class _Looks:
    """Rays from eyes in the rooms.

    Attributes:
        room: (N,) the room of each.
        origins: (N, 3).
        directions: (N, 3).
        hits: what they meet.
    """

    room: NDArray[np.int64]
    origins: F32
    directions: F32
    hits: dict[str, Any]


def _look_around(lit: LitScene, rooms: tuple[Room, ...]) -> _Looks:
    around = cosine_directions(_LOOKS // PATTERNS // 2).reshape(-1, 3)
    sphere = np.concatenate([around, -around])
    share = 0.1 + 0.8 * net(_EYES)
    height = 0.2 + 0.6 * (np.arange(_EYES) + 0.5) / _EYES
    share = np.stack([share[:, 0], height, share[:, 1]], axis=1)
    eyes = np.concatenate([np.array(r.low) + share * (np.array(r.high) - np.array(r.low)) for r in rooms])
    origins = np.repeat(eyes, len(sphere), axis=0).astype(np.float32)
    directions = np.tile(sphere, (len(eyes), 1)).astype(np.float32)
    room = np.repeat(np.arange(len(rooms)), _EYES * len(sphere))
    return _Looks(room, origins, directions, lit.tracer.intersect(origins, directions))


def _openings(looks: _Looks, rooms: tuple[Room, ...]) -> list[_Region]:
    """Holes in the walls of the rooms through which one looks out of the scan: windows, as far as they shine."""
    found: list[_Region] = []
    for number, room in enumerate(rooms):
        own = looks.room == number
        origins, directions = looks.origins[own].astype(np.float64), looks.directions[own].astype(np.float64)
        leaves = looks.hits["primID"][own] < 0
        low, high = np.array(room.low), np.array(room.high)
        ahead = np.where(directions > 0, high - origins, low - origins) / np.where(directions == 0, 1e-12, directions)
        axis = np.argmin(ahead, axis=1)
        wall = axis * 2 + (np.take_along_axis(directions, axis[:, None], axis=1)[:, 0] > 0)
        at = origins + directions * ahead.min(axis=1)[:, None]
        for which in (0, 1, 4, 5):
            here = wall == which
            found += _openings_in(room, which, at[here], leaves[here])
    return sorted(found, key=lambda region: -len(region.position))


def _openings_in(room: Room, wall: int, at: NDArray[np.float64], leaves: NDArray[np.bool_]) -> list[_Region]:
    """Holes in one wall (2 · axis + 1 for the far one), which rays cross at points (N, 3) and some of them leave."""
    low, high = np.array(room.low), np.array(room.high)
    axis, far = divmod(wall, 2)
    along = [2 - axis, 1]
    size = np.maximum(np.ceil((high - low)[along] / _CELL).astype(np.int64), 1)
    cell = np.clip(((at[:, along] - low[along]) / _CELL).astype(np.int64), 0, size - 1)
    flat = cell[:, 0] * size[1] + cell[:, 1]
    every = np.bincount(flat, minlength=int(size.prod()))
    out = np.bincount(flat, leaves, minlength=int(size.prod()))
    pieces, count = label(((out > 0.5 * every) & (every > 2)).reshape(size))
    found = []
    for piece in range(1, count + 1):
        cells = np.argwhere(pieces == piece)
        if len(cells) * _CELL**2 < _WINDOW:
            continue
        inner = (cells[:, None] + np.array([[0.25, 0.25], [0.25, 0.75], [0.75, 0.25], [0.75, 0.75]])) * _CELL
        position = np.empty((4 * len(cells), 3), dtype=np.float32)
        position[:, along] = inner.reshape(-1, 2) + low[along]
        position[:, axis] = (low, high)[far][axis]
        normal = np.zeros_like(position)
        normal[:, axis] = 1 - 2 * far
        found.append(_Region(position, normal, np.full(len(position), _CELL**2 / 4, dtype=np.float32), 0.0))
    return found


def _is_ceiling(surfaces: LitSurfaces, height: float) -> NDArray[np.bool_]:
    """(F,) which faces look down and lie above ``height``."""
    return np.asarray((surfaces.face_normal[:, 1] < -0.7) & (surfaces.triangles[:, :, 1].min(axis=1) > height))


def _near_rooms(points: F32, rooms: tuple[Room, ...], margin: float) -> NDArray[np.bool_]:
    """(N,) which points lie in a room or ``margin`` around it."""
    near = np.zeros(len(points), dtype=bool)
    for room in rooms:
        near |= np.all((points > np.array(room.low) - margin) & (points < np.array(room.high) + margin), axis=1)
    return near


def black_level(surfaces: LitSurfaces, rooms: tuple[Room, ...]) -> F32:
    """(3,) radiance that the pictures show where no light comes from.

    It is told by the darkest points in and around the rooms: what they show beyond the part of the median that they
    have in pictures without flare. A room whose darkest points have more than `_NOTHING_DARK` of the median has nothing
    dark in it, which would tell a level: 0.
    """
    points = _spread_points(surfaces, rooms)
    if points is None:
        return np.zeros(3, dtype=np.float32)
    radiance = albedo_at(surfaces, points.face, points.v, points.w)
    darkest, median = np.quantile(radiance, [_DARKEST, 0.5], axis=0)
    if darkest.mean() > _NOTHING_DARK * median.mean():
        return np.zeros(3, dtype=np.float32)
    level = (darkest - _DARK * median) / (1.0 - _DARK)
    return np.where(level >= _LEAST_BLACK, level, 0.0).astype(np.float32)


@dataclass(frozen=True, eq=False)
class _Points:
    """Points spread evenly over surfaces: face and barycentric places (n,), and the area of each (m²)."""

    face: I32
    v: F32
    w: F32
    area: float


def _spread_points(surfaces: LitSurfaces, rooms: tuple[Room, ...]) -> _Points | None:
    """Points on the surfaces in and around the rooms; None if there are none."""
    corners = surfaces.triangles
    near = np.flatnonzero(_near_rooms(corners.mean(axis=1), rooms, _AROUND))
    share = np.cumsum(face_areas(corners[near]))
    whole = float(share[-1]) if len(near) else 0.0
    count = int(min(whole / _SPACING**2, _MOST_POINTS))
    if count == 0:
        return None
    at = (np.arange(count) + 0.5) / count * whole
    face = near[np.minimum(np.searchsorted(share, at), len(near) - 1)].astype(np.int32)
    s, t = net(count).T
    root = np.sqrt(s)
    v, w = (root * (1 - t)).astype(np.float32), (root * t).astype(np.float32)
    return _Points(face, v, w, whole / count)


def _bright_points(surfaces: LitSurfaces, rooms: tuple[Room, ...]) -> tuple[float, list[_Region]]:
    """The limit from which texels in and around the rooms shine, and the regions of those, the largest first."""
    points = _spread_points(surfaces, rooms)
    if points is None:
        return CLIPPED, []
    corners, face, v, w = surfaces.triangles, points.face, points.v, points.w
    radiance = albedo_at(surfaces, face, v, w)
    limit = float(np.clip(np.quantile(radiance.max(axis=1), 1 - _SHINING), _LEAST, CLIPPED))
    kept = is_bright(radiance, limit)
    face, v, w = face[kept], v[kept, None], w[kept, None]
    position = (1 - v - w) * corners[face, 0] + v * corners[face, 1] + w * corners[face, 2]
    area = np.full(len(face), points.area, dtype=np.float32)
    region = _regions(position)
    return limit, [
        _Region(position[own], surfaces.face_normal[face[own]], area[own], limit)
        for own in (region == number for number in range(int(region.max(initial=-1)) + 1))
    ]


def _regions(position: F32) -> NDArray[np.int64]:
    """(N,) the region of each point, the largest first."""
    if not len(position):
        return np.zeros(0, dtype=np.int64)
    voxel = np.floor(position / _REGION).astype(np.int64)
    voxel -= voxel.min(axis=0)
    grid = np.zeros(voxel.max(axis=0) + 1, dtype=bool)
    grid[tuple(voxel.T)] = True
    region = label(grid, structure=np.ones((3, 3, 3)))[0][tuple(voxel.T)] - 1
    order = np.argsort(-np.bincount(region), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return np.asarray(rank[region], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class _Patches:
    """Pieces of surface with places on each.

    Attributes:
        position: (P, n, 3) places, a little above the surface.
        normal: (P, n, 3).
        radiance: (P, 3) mean.
        weight: (P,) how many rays met it.
    """

    position: F32
    normal: F32
    radiance: F32
    weight: NDArray[np.float64]


def _seen_patches(lit: LitScene, looks: _Looks, limit: float) -> _Patches:
    """Surfaces that are seen in the rooms and do not shine."""
    face: I32 = looks.hits["primID"]
    radiance = albedo_at(lit.surfaces, face, looks.hits["u"], looks.hits["v"])
    position = looks.origins + looks.directions * looks.hits["tfar"][:, None]
    kept = lit.front(looks.hits, looks.directions) & ~is_bright(radiance, limit) & (radiance @ LUMINANCE > 0)
    position, normal, radiance = position[kept], lit.surfaces.face_normal[face[kept]], radiance[kept]
    axis = np.argmax(np.abs(normal), axis=1)
    facing = axis * 2 + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] > 0)
    key = np.column_stack([np.floor(position / _PATCH).astype(np.int64), facing])
    _, patch, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    patch = patch.reshape(-1)
    largest = np.sort(np.argsort(-count, kind="stable")[:_MOST_PATCHES])
    order = np.argsort(patch, kind="stable")
    start = np.concatenate([[0], np.cumsum(count)])
    pick = np.linspace(0.0, 1.0, _PLACES, endpoint=False)[None] + 0.5 / _PLACES
    place = order[start[largest][:, None] + (pick * count[largest][:, None]).astype(np.int64)]
    mean = np.stack([np.bincount(patch, radiance[:, c]) for c in range(3)], axis=1) / count[:, None]
    above = position[place] + np.float32(0.01) * normal[place]
    return _Patches(above, normal[place], mean[largest].astype(np.float32), count[largest].astype(np.float64))


def _gathered(lit: LitScene, patches: _Patches, ceiling: float) -> tuple[NDArray[np.float64], ...]:
    """Of each patch: its light (luminance), and the shares of its view that the ceiling and the outside have."""
    position, normal = patches.position.reshape(-1, 3), patches.normal.reshape(-1, 3)
    pattern = (np.arange(len(position)) % PATTERNS).astype(np.int32)
    origins, directions = hemisphere_rays(position, normal, normal, pattern, cosine_directions(_RAYS))
    hits = lit.tracer.intersect(origins, directions)
    face: I32 = hits["primID"]
    radiance = lit.reflected(face, hits["u"], hits["v"]) @ LUMINANCE
    overhead = _is_ceiling(lit.surfaces, ceiling)[np.maximum(face, 0)] & (face >= 0)
    of_patch = (len(patches.position), -1)
    return tuple(values.reshape(of_patch).mean(axis=1, dtype=np.float64) for values in (radiance, overhead, face < 0))


def _form_factors(lit: LitScene, patches: _Patches, region: _Region) -> NDArray[np.float64]:
    """(P,) mean visible form factor of a region at each patch."""
    count = len(patches.position)
    white = np.ones_like(region.position)
    emitters, _ = bright_patches(region.position, region.normal, region.area, white, 16)
    places, facing = patches.position.reshape(-1, 3), patches.normal.reshape(-1, 3)
    pattern = (np.arange(len(places)) % PATTERNS).astype(np.int32)
    reach = np.ones((len(places), len(emitters)), dtype=bool)
    light, _ = direct_light(emitters, reach, pattern, places, facing, lit.tracer.occluded)
    return np.asarray(light[:, 0].reshape(count, -1).mean(axis=1, dtype=np.float64))


def _kinds(patches: _Patches) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(P,) the kind of each patch (side and colour), and its side: 0 faces down, 1 sideways, 2 up."""
    height = patches.normal[:, 0, 1]
    side = np.where(height < -0.7, 0, np.where(height > 0.7, 2, 1))
    ratio = np.log(np.maximum(patches.radiance, 1e-4))
    tint = np.round((ratio[:, [0, 2]] - ratio[:, [1]]) / _COLOUR).astype(np.int64)
    kind = np.unique(np.column_stack([side, tint]), axis=0, return_inverse=True)[1]
    return np.asarray(kind.reshape(-1), dtype=np.int64), side


def _balanced(
    patches: _Patches, base: NDArray[np.float64], shares: NDArray[np.float64], level: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """(R,) radiance of what the pictures do not show, ≥ 0, with which the albedos are most plausible.

    Args:
        patches: the surfaces.
        base: (P,) their light from what is shown.
        shares: (P, R) form factors of the rest, the ceiling and the outside last.
        level: (R - 2,) which regions face up.
    """
    kind, side = _kinds(patches)
    seen = np.log(np.maximum(patches.radiance @ LUMINANCE, 1e-3))
    weight = patches.weight / patches.weight.mean() / _WITHIN**2
    usual = np.zeros(int(kind.max()) + 1)
    usual[kind] = np.log(np.array(_ALBEDO))[side]

    clips = len(level)
    brighter = np.where(level, _LIT_BRIGHTER, _BRIGHTER)

    def power_of(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([CLIPPED * np.expm1(unknown[:clips]), unknown[clips:]])

    def residuals(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        power = power_of(unknown)
        albedo = seen - np.log(np.maximum(base + shares @ power, 1e-4))
        # The best mean of each kind has a closed form (variable projection).
        mean = np.bincount(kind, weight * albedo) + usual / _KINDS**2
        mean /= np.bincount(kind, weight) + 1.0 / _KINDS**2
        off = (unknown[:clips] - brighter) / np.where(level, _LIT_BRIGHTNESS, _BRIGHTNESS)
        return np.concatenate([np.sqrt(weight) * (albedo - mean[kind]), (mean - usual) / _KINDS, off])

    first = np.concatenate([brighter, np.full(2, 0.1)])
    most = np.concatenate([np.full(clips, 8.0), np.full(2, np.inf)])
    found = least_squares(residuals, first, bounds=(0.0, most), loss="soft_l1")
    # The last digits depend on how many threads the linear algebra has.
    return np.array([float(f"{value:.3g}") if value > 1e-3 else 0.0 for value in power_of(found.x)])
