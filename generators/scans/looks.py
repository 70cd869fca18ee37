"""How bright the acoustic faces of a scan look, by a few samples of its textures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.core.scene import Material, Mesh
from generators.core.tone import LUMINANCE, srgb_encode

Array = NDArray[np.float64]

#: Where a face is looked at: barycentric coordinates.
_SAMPLES = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / np.array([[3], [6], [6], [6]])
#: All channels of a clipped sample are at least this (0–1).
CLIPPED = 0.97


@dataclass(frozen=True, eq=False)
class FaceLooks:
    """Means over the samples of each face, (N,) each.

    Attributes:
        luminance: sRGB, 0 to 1.
        square: of the luminance.
        clipped: share of the samples that are clipped.
    """

    luminance: Array
    square: Array
    clipped: Array

    def of(self, chosen: NDArray[np.bool_]) -> FaceLooks:
        """The looks of the faces that are ``chosen`` (N,)."""
        return FaceLooks(self.luminance[chosen], self.square[chosen], self.clipped[chosen])


def face_looks(mesh: Mesh) -> FaceLooks:
    """The looks of every acoustic face of a scan; those of the nearest face if its twin has other faces."""
    count = len(mesh.positions)
    sums = np.zeros((3, count))
    for number, material in enumerate(mesh.materials):
        own = np.flatnonzero(mesh.face_material == number)
        for weights in _SAMPLES:
            uv = np.einsum("k,fkc->fc", weights, mesh.uv[own].astype(np.float64))
            colour = _colours(material, uv)
            # Of sRGB values, which are near to what the eye tells apart.
            luminance = (colour * LUMINANCE).sum(axis=-1)
            sums[:, own] += [luminance, luminance**2, (colour >= CLIPPED).all(axis=-1)]
    means = sums / len(_SAMPLES)
    if len(mesh.acoustic_positions) != count:
        from scipy.spatial import cKDTree

        nearest = cKDTree(mesh.positions.mean(axis=1)).query(mesh.acoustic_positions.mean(axis=1))[1]
        means = means[:, nearest]
    return FaceLooks(*means)


def _colours(material: Material, uv: Array) -> Array:
    """(N, 3) sRGB values in [0, 1] at texture coordinates (N, 2)."""
    tint = np.asarray(material.colour)
    if material.texture is None:
        return np.broadcast_to(srgb_encode(tint), (len(uv), 3))
    pixels = material.texture.pixels
    rows, columns = pixels.shape[:2]
    row = np.floor((1.0 - uv[:, 1]) * rows).astype(np.int64) % rows
    column = np.floor(uv[:, 0] * columns).astype(np.int64) % columns
    return np.asarray(pixels[row, column] / 255.0 * srgb_encode(tint))
