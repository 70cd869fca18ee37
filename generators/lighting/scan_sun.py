"""The sun in a scanned room, found from the bright patches that it makes on what faces up.

The beam through a window makes a patch with sharp edges. Where it comes from is the direction towards which what lies
in the patch sees out of a window, and what lies beside it does not. A ray sees out of a window if it leaves the scan,
because scanners do not see glass, or meets an upright texel that clips.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.core.scene import F32, Room, ScanLight, ScanSun
from generators.core.tone import LUMINANCE
from generators.lighting.lit_scene import LitScene, is_bright
from generators.lighting.sun import Sun, through_roof
from generators.lighting.surfaces import LitSurfaces, albedo_at

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Radiance of what is in the sun: so many times the median of what faces up in the room, and at least so much. It is
#: hardly less where it does not clip, for the phone exposes for the room.
_SUNLIT, _LEAST_LIGHT = 4.0, 0.7
#: Share of what faces up that is in the sun.
_SMALLEST, _LARGEST = 0.01, 0.4
#: Elevations of the sun that are tried (degrees), and the steps of the coarse and of the fine search.
_HEIGHTS, _COARSE, _FINE = (12.0, 68.0), 4.0, 1.0
#: Points in and beside the patches that are asked.
_IN, _BESIDE = 200, 300
#: By how much the share of the patches that sees the sun must exceed that of the rest, and the least overlap (Dice
#: coefficient) of the patches and of what sees it. Three scans with sun have 0.7 to 0.8 and 0.43 to 0.79; of two
#: without sun one reaches 0.6 and 0.44, and its patches are too small.
_EXPLAINED, _OVERLAP = 0.62, 0.4
#: Directions that explain nearly as much as the best one are averaged.
_NEARLY = 0.05
#: |cosine| of the slope of an upright face.
_UPRIGHT = 0.5
#: Rays pass what is nearer than this to where they begin, metres: a scan is rough, and its bumps shade nothing.
BUMPS = 0.05
#: Of what is in the patch and does not clip, the brightest shows all of the sun: which share is darker.
_FULL = 0.9
#: Albedo of what lies in the sun, and the colour of sunlight (luminance 1).
_ALBEDO = 0.3
_COLOUR = np.array([1.0, 0.86, 0.68]) / (np.array([1.0, 0.86, 0.68]) @ LUMINANCE)


@dataclass(frozen=True, eq=False)
class LevelPoints:
    """Points on what faces up.

    Attributes:
        position: (N, 3).
        radiance: (N, 3).
    """

    position: F32
    radiance: F32

    def thinned(self, most: int) -> LevelPoints:
        """At most so many of them, evenly."""
        index = _some(np.arange(len(self.position)), most)
        return LevelPoints(self.position[index], self.radiance[index])


def find_scan_sun(
    lit: LitScene, rooms: tuple[Room, ...], level: list[LevelPoints], bright: LevelPoints, limit: float
) -> ScanSun | None:
    """The sun of a scan; None where no patch shows it.

    Args:
        lit: the scan alone.
        rooms: of the scan.
        level: what faces up in each room, as the pictures show it.
        bright: what faces up and clips, with the radiance that balances the light of the rooms.
        limit: radiance from which texels are clipped.
    """
    window = Window(lit, limit, roofs_of(rooms))
    light = [room.radiance @ LUMINANCE for room in level]
    usual = [float(np.median(one)) if len(one) else 0.0 for one in light]
    inside = [one > max(_SUNLIT * mean, _LEAST_LIGHT) for one, mean in zip(light, usual, strict=True)]
    patch, beside = np.concatenate(inside), np.concatenate([~one for one in inside])
    if not _SMALLEST * len(patch) <= patch.sum() <= _LARGEST * len(patch) or not patch.any():
        return None
    position = np.concatenate([room.position for room in level])
    own, other = _some(np.flatnonzero(patch), _IN), _some(np.flatnonzero(beside), _BESIDE)
    origins = position[np.concatenate([own, other])]

    def explained(headings: Array, heights: Array) -> tuple[Array, Array]:
        """Directions (D, 3), and how well each explains the patches (D, 2).

        The first is how much more of the patches than of the rest sees out there, the second the Dice coefficient of
        what sees out and the patches.
        """
        a, b = (np.radians(g.reshape(-1)) for g in np.meshgrid(headings, heights, indexing="ij"))
        towards = np.stack([np.cos(b) * np.sin(a), np.sin(b), np.cos(b) * np.cos(a)], axis=1)
        rays = np.repeat(towards, len(origins), axis=0).astype(np.float32)
        out = window.seen(np.tile(origins, (len(towards), 1)), rays).reshape(len(towards), -1)
        right, wrong = out[:, : len(own)].mean(axis=1), out[:, len(own) :].mean(axis=1)
        seen = patch.sum() * right + (~patch).sum() * wrong
        return towards, np.stack([right - wrong, 2 * patch.sum() * right / (patch.sum() + seen)], axis=1)

    towards, share = explained(np.arange(-180.0, 180.0, _COARSE), np.arange(*_HEIGHTS, _COARSE))
    x, y, z = towards[int(np.argmax(share[:, 0]))]
    step = np.arange(-_COARSE, _COARSE + 0.5 * _FINE, _FINE)
    towards, share = explained(np.degrees(np.arctan2(x, z)) + step, np.degrees(np.arcsin(y)) + step)
    more, overlap = share[int(np.argmax(share[:, 0]))]
    if more < _EXPLAINED or overlap < _OVERLAP:
        return None
    direction = towards[share[:, 0] >= more - _NEARLY].mean(axis=0)
    direction /= np.linalg.norm(direction)
    patch_light = float(np.quantile(np.concatenate(light)[patch], _FULL))
    clipped = bright.thinned(_IN)
    rays = np.tile(direction.astype(np.float32), (len(clipped.position), 1))
    lit_by_it = window.seen(clipped.position, rays)
    if lit_by_it.any():
        patch_light = max(patch_light, float(np.median(clipped.radiance[lit_by_it] @ LUMINANCE)))
    reflected = patch_light - float(np.median(np.concatenate(light)[~patch]))
    return ScanSun(direction, (reflected / (_ALBEDO * direction[1]) * _COLOUR).astype(np.float32))


def beam_of(light: ScanLight, rooms: tuple[Room, ...], surfaces: LitSurfaces, scanned: Mask) -> Sun | None:
    """The sun's beam through the windows of a scan; None without a sun.

    Args:
        light: of the scan.
        rooms: of the scan.
        surfaces: of the scan and what else is in the room.
        scanned: (F,) which faces show pictures.
    """
    sun = light.sun
    if sun is None:
        return None
    upright = np.flatnonzero(scanned & (np.abs(surfaces.face_normal[:, 1]) < _UPRIGHT)).astype(np.int32)
    middle = np.full(len(upright), 1 / 3, dtype=np.float32)
    pane = np.zeros(len(scanned), dtype=bool)
    pane[upright] = is_bright(albedo_at(surfaces, upright, middle, middle), light.limit)
    return Sun(sun.direction, sun.radiance, pane, roofs_of(rooms), BUMPS)


def roofs_of(rooms: tuple[Room, ...]) -> F32:
    """(R, 2, 3) the boxes of rooms."""
    return np.array([[room.low, room.high] for room in rooms], dtype=np.float32).reshape(-1, 2, 3)


@dataclass(frozen=True, eq=False)
class Window:
    """Where one sees out of a scan: where rays leave it, but not through a missing ceiling, or meet what clips.

    Attributes:
        lit: the scan alone.
        limit: radiance from which texels are clipped.
        roofs: (R, 2, 3) the boxes of the rooms.
    """

    lit: LitScene
    limit: float
    roofs: F32

    def seen(self, origins: F32, directions: F32) -> Mask:
        """(N,) whether rays see out."""
        hits = self.lit.tracer.intersect(origins + np.float32(BUMPS) * directions, directions)
        face = hits["primID"]
        out = np.zeros(len(face), dtype=bool)
        left, met = np.flatnonzero(face < 0), np.flatnonzero(face >= 0)
        out[left] = ~through_roof(origins[left], directions[left], self.roofs)
        surfaces = self.lit.surfaces
        met = met[np.abs(surfaces.face_normal[face[met], 1]) < _UPRIGHT]
        out[met] = is_bright(albedo_at(surfaces, face[met], hits["u"][met], hits["v"][met]), self.limit)
        return out


def _some(index: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """At most so many of them, evenly."""
    return index[np.linspace(0, len(index) - 1, min(most, len(index))).astype(np.int64)]
