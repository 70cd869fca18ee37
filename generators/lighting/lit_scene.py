"""A scene that has its light: what a ray sees where it meets it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from generators.core.rays import Tracer
from generators.core.scene import F32, I32, Part
from generators.core.tone import LUMINANCE, inverse_tone_curve
from generators.lighting.gather import cells_at
from generators.lighting.surfaces import TEXTURE_LIMIT, LitSurfaces, albedo_at
from generators.lighting.texels import Sheet
from generators.lighting.unwrap import LightMapLayout

#: The texture of a scan is its light: it is kept finer than textures whose mean matters.
_LIT_TEXTURE_LIMIT = 1024
#: Where a ray leaves the scene, in place of a face (-1: it meets something else).
OUTSIDE = -2
#: The dimmest luminance of a texel that shines, relative to the limit of its brightest channel: a red thing may clip in
#: one channel and not shine.
_WHITISH = 0.35


@dataclass(frozen=True, eq=False)
class Unseen:
    """Light in a scan that its pictures do not show.

    Attributes:
        scanned: (F,) which faces show pictures.
        limit: radiance from which an emitter stands for what they show, and they reflect nothing (see `is_bright`).
        glow: (F, 3) float32 radiance in addition to what is shown.
        beyond: (3,) float32 radiance from where rays leave the scan.
    """

    scanned: NDArray[np.bool_]
    limit: float
    glow: F32
    beyond: F32


@dataclass(frozen=True, eq=False)
class LitScene:
    """Faces, light maps and ray tracer of lit parts.

    Attributes:
        surfaces: all faces.
        sheet: the light maps as they are; a part without one has a single white cell (its texture holds the light).
        light: (cells, 3) float32.
        tracer: over all faces.
        unseen: in a scan, the light that its pictures do not show.
    """

    surfaces: LitSurfaces
    sheet: Sheet
    light: F32
    tracer: Tracer
    unseen: Unseen | None = None

    @staticmethod
    def of(parts: tuple[Part, ...], scanned: Sequence[bool] | None = None) -> LitScene:
        """Load ``parts``.

        Args:
            parts: with light maps or without.
            scanned: which of them show the pictures of a scan, whose radiance is computed from their colours; if
                missing: all, where none has a light map or is a placed object.
        """
        bare = any(part.light is None for part in parts)
        if scanned is None:
            scanned = [all(part.light is None and part.instance_id == 0 for part in parts)] * len(parts)
        surfaces = LitSurfaces.of(parts, _LIT_TEXTURE_LIMIT if bare or any(scanned) else TEXTURE_LIMIT)
        if any(scanned):
            surfaces = _undeveloped(surfaces, np.array(scanned))
        layouts, light = [], []
        for part in parts:
            count = len(part.mesh.positions)
            chart = np.zeros(count, dtype=np.int32)
            if part.light is None:
                layouts.append(LightMapLayout(np.zeros((count, 3, 2), dtype=np.float32), chart, 1, 1))
                light.append(np.ones((1, 3), dtype=np.float32))
                continue
            height, width = part.light.texels.shape[:2]
            size = np.array([width, height], dtype=np.float32)
            layouts.append(LightMapLayout(part.light.uv * size, chart, width, height))
            light.append(part.light.texels.reshape(-1, 3).astype(np.float32))
        return LitScene(surfaces, Sheet.of(layouts), np.concatenate(light), Tracer(surfaces.triangles))

    def reflected(self, face: I32, v: F32, w: F32) -> F32:
        """(N, 3) radiance without emission at points of faces; black where ``face`` is negative.

        In a scan, `OUTSIDE` gives the radiance from there.
        """
        cells = cells_at(self.surfaces, self.sheet, face, v, w)
        radiance: F32 = albedo_at(self.surfaces, face, v, w)
        unseen = self.unseen
        if unseen is not None:
            met = np.maximum(face, 0)
            shines = unseen.scanned[met] & is_bright(radiance, unseen.limit)
            radiance = np.where(shines[:, None], np.float32(0.0), radiance * self.light[np.maximum(cells, 0)])
            radiance += np.where((face >= 0)[:, None], unseen.glow[met], np.float32(0.0))
            radiance[face == OUTSIDE] = unseen.beyond
            return radiance
        return radiance * self.light[np.maximum(cells, 0)]

    def emitted(self, hits: dict[str, Any]) -> F32:
        """(N, 3) emission where rays met the scene."""
        face = hits["primID"]
        emission = self.surfaces.emission[self.surfaces.material[np.maximum(face, 0)]]
        return np.where((face >= 0)[:, None], emission, np.float32(0.0))

    def front(self, hits: dict[str, Any], directions: F32) -> NDArray[np.bool_]:
        """(N,) whether a ray met the front of a face."""
        face = hits["primID"]
        facing = np.einsum("ij,ij->i", self.surfaces.face_normal[np.maximum(face, 0)], directions) < 0
        return np.asarray((face >= 0) & facing)


def is_bright(radiance: F32, limit: float) -> NDArray[np.bool_]:
    """(N,) whether texels of a scan, of radiance (N, 3), reach ``limit`` in a channel and are whitish."""
    return np.asarray((radiance.max(axis=1) >= limit) & (radiance @ LUMINANCE >= _WHITISH * limit))


def _undeveloped(surfaces: LitSurfaces, scanned: NDArray[np.bool_]) -> LitSurfaces:
    """The surfaces, those of the parts ``scanned`` (P,) with the radiance that their pictures were developed from.

    A camera's tone curve squeezed it into [0, 1]; ours stands for it, so that what lies under that light and goes
    through the curve again is as bright as the scan around it.
    """
    return _changed(surfaces, scanned, inverse_tone_curve)


def without_black(lit: LitScene, scanned: NDArray[np.bool_], black: F32) -> LitScene:
    """``lit``, whose parts ``scanned`` (P,) show pictures, without the radiance ``black`` (3,) that lies over these."""
    if not black.any():
        return lit
    return replace(lit, surfaces=_changed(lit.surfaces, scanned, lambda light: np.maximum(light - black, 0.0)))


def _changed(surfaces: LitSurfaces, scanned: NDArray[np.bool_], change: Callable[[F32], ArrayLike]) -> LitSurfaces:
    """The surfaces with other colours (N, 3) of the parts ``scanned`` (P,)."""
    own = np.zeros(len(surfaces.colour), dtype=bool)
    own[surfaces.material[scanned[surfaces.part]]] = True
    textured = surfaces.image[:, 0] > 0
    pixels, colour = surfaces.pixels.copy(), surfaces.colour.copy()
    for first, rows, columns in np.unique(surfaces.image[own & textured], axis=0):
        texture = slice(first, first + rows * columns)
        pixels[texture] = change(pixels[texture])
    colour[own & ~textured] = change(colour[own & ~textured])
    return replace(surfaces, pixels=pixels, colour=colour)
