"""Sunlight that shiny surfaces throw on others: a sunny floor of tiles or varnished boards lights the wall beyond it.

What a dielectric's surface reflects is handed on diffusely in the bake (see `LitSurfaces`), which is right in the mean
for light that comes from everywhere. The sun comes from one direction, is far brighter than all else, and goes on into
one direction, too: handed on diffusely, the patch of it on a dark tiled floor lights the ceiling instead of the wall.
So its share is traced: photons leave the sunny texels, mirrored at normals of the GGX lobe, and land on blocks of
texels (H. W. Jensen, "Global illumination using photon maps", Rendering Techniques 1996).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from generators.core.albedos import DIELECTRIC, grazing, smith_lambda, visible_normals
from generators.core.arrays import dot_rows
from generators.core.low_discrepancy import square_points
from generators.core.rays import Tracer
from generators.core.scene import F32
from generators.lighting.blocks import Blocks
from generators.lighting.gather import cells_at
from generators.lighting.sun import Sun
from generators.lighting.surfaces import LitSurfaces
from generators.lighting.texels import Sheet, Texels

#: About how many photons are traced in a home, and the least and most of a texel (powers of two).
_PHOTONS, _LEAST, _MOST = 1 << 19, 16, 256
#: From this roughness on a lobe is so wide that the diffuse share stands for it.
_ROUGH = 0.6
#: Photons start this far off the surface (m).
_LIFT = 1e-3
#: Variance, in units of the squared light, of what a block is given, besides that of the photons: its texels differ.
_WITHIN = 0.02
#: Texels whose photons are traced at once.
_CHUNK = 512


def glints(
    surfaces: LitSurfaces, sheet: Sheet, texels: Texels, blocks: Blocks, sunlight: F32, sun: Sun, tracer: Tracer
) -> tuple[F32, F32, NDArray[np.bool_]]:
    """Trace what dielectrics in the sun reflect.

    Args:
        surfaces: the faces.
        sheet: their light maps.
        texels: of the light maps.
        blocks: the texels that are lit.
        sunlight: (N, 3) light of the sun on the texels.
        sun: the sun.
        tracer: over the faces.

    Returns:
        (N, 3) light that arrives, (N,) its variance, and (N,) bool, which texels it comes from.
    """
    material = surfaces.material[texels.face]
    toward = sun.direction.astype(np.float32)
    cosine = dot_rows(texels.normal, toward)
    sends = (sunlight.max(axis=1) > 0) & (texels.area > 0) & (cosine > 1e-3)
    sends &= (surfaces.specular[material] > 0) & (surfaces.roughness[material] < _ROUGH)
    rows = np.flatnonzero(sends)
    count = len(blocks)
    flux, number = np.zeros((count, 3)), np.zeros(count)
    if len(rows):
        share = np.log2(max(_PHOTONS / len(rows), 1.0))
        samples = int(np.clip(1 << int(share), _LEAST, _MOST))
        points = square_points(samples, (0x2545F491, 0x9E3779B1)).astype(np.float64)
        for first in range(0, len(rows), _CHUNK):
            own = rows[first : first + _CHUNK]
            alpha = np.maximum(surfaces.roughness[material[own]].astype(np.float64) ** 2, 1e-3)
            direction, weight = _mirrored(texels.normal[own], toward, alpha, points[texels.pattern[own]])
            start = np.repeat(texels.position[own] + np.float32(_LIFT) * texels.normal[own], samples, axis=0)
            hit = tracer.intersect(np.ascontiguousarray(start), direction.reshape(-1, 3))
            cell = cells_at(surfaces, sheet, hit["primID"], hit["u"], hit["v"])
            texel = np.where(cell >= 0, texels.index[np.maximum(cell, 0)], -1)
            block = np.where(texel >= 0, blocks.of[np.maximum(texel, 0)], -1)
            power = (sunlight[own] * texels.area[own, None]).astype(np.float64)[:, None] * weight[..., None] / samples
            met = block >= 0
            for channel in range(3):
                flux[:, channel] += np.bincount(block[met], power[..., channel].reshape(-1)[met], minlength=count)
            number += np.bincount(block[met], minlength=count)
    area = np.bincount(blocks.of[blocks.members], texels.area[blocks.members].astype(np.float64), minlength=count)
    light = np.where(area[:, None] > 0, flux / np.maximum(area, 1e-12)[:, None], 0.0)
    variance = light.mean(axis=1) ** 2 * (1.0 / np.maximum(number, 1.0) + _WITHIN)
    arrived, spread = np.zeros((len(texels), 3), dtype=np.float32), np.zeros(len(texels), dtype=np.float32)
    arrived[blocks.members] = light[blocks.of[blocks.members]]
    spread[blocks.members] = variance[blocks.of[blocks.members]]
    return arrived, spread, sends


def _mirrored(
    normal: F32, toward: F32, alpha: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[F32, NDArray[np.float64]]:
    """Directions (n, S, 3) of light from ``toward`` (3,) off surfaces, and the share (n, S) of it that each stands for.

    Args:
        normal: (n, 3) of the surfaces, on the side of the light.
        toward: unit vector to the light.
        alpha: (n,) of the GGX lobe.
        points: (n, S, 2) in the unit square.
    """
    cosine = np.clip(normal.astype(np.float64) @ toward, 1e-3, 1.0)
    ahead = toward - cosine[:, None] * normal
    sine = np.linalg.norm(ahead, axis=1, keepdims=True)
    other = np.cross(normal, [1.0, 0.0, 0.0]) + 1e-9
    other /= np.linalg.norm(other, axis=1, keepdims=True)
    ahead = np.where(sine > 1e-4, ahead / np.maximum(sine, 1e-9), other)
    aside = np.cross(normal, ahead)
    view = np.stack([np.sqrt(1.0 - cosine**2), 0.0 * cosine, cosine], axis=-1)[:, None]
    half = visible_normals(view, alpha[:, None], points)
    along = np.einsum("ijk,ijk->ij", np.broadcast_to(view, half.shape), half)
    out = 2.0 * along[..., None] * half - view
    seen, lit = (
        smith_lambda(cosine[:, None], alpha[:, None]),
        smith_lambda(np.clip(out[..., 2], 1e-6, 1.0), alpha[:, None]),
    )
    fresnel = DIELECTRIC + (1.0 - DIELECTRIC) * grazing(along)
    weight = np.where(out[..., 2] > 0.0, fresnel * (1.0 + seen) / (1.0 + seen + lit), 0.0)
    world = out[..., :1] * ahead[:, None] + out[..., 1:2] * aside[:, None] + out[..., 2:] * normal[:, None]
    return np.ascontiguousarray(world, dtype=np.float32), weight
