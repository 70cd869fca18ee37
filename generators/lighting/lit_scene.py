"""A scene that has its light: what a ray sees where it meets it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.core.rays import Tracer
from generators.core.scene import F32, I32, Part
from generators.core.tone import inverse_tone_curve
from generators.lighting.gather import cells_at
from generators.lighting.surfaces import TEXTURE_LIMIT, LitSurfaces, albedo_at
from generators.lighting.texels import Sheet
from generators.lighting.unwrap import LightMapLayout

#: The texture of a scan is its light: it is kept finer than textures whose mean matters.
_LIT_TEXTURE_LIMIT = 1024


@dataclass(frozen=True, eq=False)
class LitScene:
    """Faces, light maps and ray tracer of lit parts.

    Attributes:
        surfaces: all faces.
        sheet: the light maps as they are; a part without one has a single white cell (its texture holds the light).
        light: (cells, 3) float32.
        tracer: over all faces.
    """

    surfaces: LitSurfaces
    sheet: Sheet
    light: F32
    tracer: Tracer

    @staticmethod
    def of(parts: tuple[Part, ...]) -> LitScene:
        """Load ``parts``."""
        scanned = any(part.light is None for part in parts)
        surfaces = LitSurfaces.of(parts, _LIT_TEXTURE_LIMIT if scanned else TEXTURE_LIMIT)
        if parts and all(part.light is None and part.instance_id == 0 for part in parts):
            surfaces = _undeveloped(surfaces)
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
        """(N, 3) radiance without emission at points of faces; black where ``face`` is negative."""
        cells = cells_at(self.surfaces, self.sheet, face, v, w)
        return albedo_at(self.surfaces, face, v, w) * self.light[np.maximum(cells, 0)]

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


def _undeveloped(surfaces: LitSurfaces) -> LitSurfaces:
    """A scan's surfaces with the radiance that its pictures were developed from.

    A camera's tone curve squeezed it into [0, 1]; ours stands for it, so that what lies under that light and goes
    through the curve again is as bright as the scan around it.
    """
    textured = surfaces.image[:, 0] > 0
    pixels, colour = surfaces.pixels.copy(), surfaces.colour.copy()
    pixels[1:] = inverse_tone_curve(pixels[1:])
    colour[~textured] = inverse_tone_curve(colour[~textured])
    return replace(surfaces, pixels=pixels, colour=colour)
