"""All faces of a set of parts as flat arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from generators.core.albedos import dielectric_albedo
from generators.core.jit import njit
from generators.core.scene import F32, I32, Part, Texture

#: Textures are looked up at this many texels at most: indirect light blurs all that is finer.
TEXTURE_LIMIT = 64
#: Rows per piece of work of `rows_in_chunks`.
_ROWS = 1 << 15


def srgb_to_linear(values: NDArray[np.uint8]) -> F32:
    """Linear light of 8-bit sRGB values (IEC 61966-2-1)."""
    v = np.arange(256) / 255.0
    table = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4).astype(np.float32)
    # OpenCV's look-up leaves Python's other threads running; numpy's does not, and takes ten times as long.
    return np.asarray(cv2.LUT(np.ascontiguousarray(values), table), dtype=np.float32).reshape(values.shape)


@dataclass(frozen=True, eq=False)
class LitSurfaces:
    """Faces of several parts, one after the other.

    Attributes:
        triangles: (F, 3, 3) float32 corners, metres.
        normals: (F, 3, 3) float32 shading normals.
        face_normal: (F, 3) float32 unit geometric normals (zero for a degenerate face).
        uv: (F, 3, 2) float32 texture coordinates.
        part: (F,) int32 index of the part.
        material: (F,) int32 index into the six following.
        colour: (M, 3) float32 albedo factor.
        specular: (M,) float32 share of a uniform light that a dielectric's surface reflects besides; 0 of metals, whose
            colour is all that they reflect. In the bake, this light goes on diffusely, too.
        roughness: (M,) float32, the mean of a map of it.
        emission: (M, 3) float32 radiance.
        glass: (M,) bool, whether it sounds like glass: the panes of windows do.
        image: (M, 3) int64: offset into ``pixels``, rows, columns of the material's texture.
        pixels: (T, 3) float32 linear-light texture values.
    """

    triangles: F32
    normals: F32
    face_normal: F32
    uv: F32
    part: I32
    material: I32
    colour: F32
    specular: F32
    roughness: F32
    emission: F32
    glass: NDArray[np.bool_]
    image: NDArray[np.int64]
    pixels: F32

    @staticmethod
    def of(parts: Sequence[Part], limit: int = TEXTURE_LIMIT) -> LitSurfaces:
        """Gather the faces of ``parts``, with textures of at most ``limit`` texels to a side."""
        meshes = [part.mesh for part in parts]
        triangles = np.concatenate([m.positions for m in meshes]).astype(np.float32)
        cross = np.cross(
            (triangles[:, 1] - triangles[:, 0]).astype(np.float64),
            (triangles[:, 2] - triangles[:, 0]).astype(np.float64),
        )
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        face_normal = np.where(length > 0, cross / np.where(length > 0, length, 1.0), 0.0).astype(np.float32)
        colour: list[tuple[float, float, float]] = []
        specular: list[float] = []
        roughness: list[float] = []
        emission: list[tuple[float, float, float]] = []
        glass: list[bool] = []
        image: list[tuple[int, int, int]] = []
        pixels = [np.ones((1, 3), dtype=np.float32)]
        size = 1
        known: dict[int, tuple[int, int, int]] = {}
        material = []
        for part in parts:
            material.append(part.mesh.face_material + len(colour))
            for m in part.mesh.materials:
                colour.append(m.colour)
                specular.append((1.0 - m.metallic) * dielectric_albedo(m.roughness))
                roughness.append(m.roughness * _mean_roughness(m.roughness_map))
                emission.append(m.emission)
                glass.append(m.acoustic == "glass")
                if m.texture is None:
                    image.append((0, 1, 1))
                    continue
                key = id(m.texture)
                if key not in known:
                    small = _reduced(m.texture, limit)
                    known[key] = (size, small.shape[0], small.shape[1])
                    pixels.append(small.reshape(-1, 3))
                    size += small.shape[0] * small.shape[1]
                image.append(known[key])
        return LitSurfaces(
            triangles=triangles,
            normals=np.concatenate([m.normals for m in meshes]).astype(np.float32),
            face_normal=face_normal,
            uv=np.concatenate([m.uv for m in meshes]).astype(np.float32),
            part=np.repeat(np.arange(len(parts), dtype=np.int32), [len(m.positions) for m in meshes]),
            material=np.concatenate(material).astype(np.int32),
            colour=np.array(colour, dtype=np.float32),
            specular=np.array(specular, dtype=np.float32),
            roughness=np.array(roughness, dtype=np.float32),
            emission=np.array(emission, dtype=np.float32),
            glass=np.array(glass, dtype=bool),
            image=np.array(image, dtype=np.int64),
            pixels=np.concatenate(pixels),
        )


@lru_cache(maxsize=256)
def _mean_roughness(texture: Texture | None) -> float:
    """Mean of the roughness in a map of it, 1 without one."""
    return 1.0 if texture is None else float(texture.pixels[..., 1].mean()) / 255.0


def _reduced(texture: Texture, limit: int) -> F32:
    linear = srgb_to_linear(texture.pixels[..., :3])
    height, width = linear.shape[:2]
    scale = min(1.0, limit / max(height, width))
    if scale < 1.0:
        shape = (max(1, round(width * scale)), max(1, round(height * scale)))
        linear = np.asarray(cv2.resize(linear, shape, interpolation=cv2.INTER_AREA), dtype=np.float32)
    return np.ascontiguousarray(linear.reshape(linear.shape[0], linear.shape[1], 3))


@njit
def _albedo(
    face: I32,
    v: F32,
    w: F32,
    uv: F32,
    material: I32,
    colour: F32,
    specular: F32,
    image: NDArray[np.int64],
    pixels: F32,
    out: F32,
) -> None:
    for i in range(len(face)):
        f = face[i]
        if f < 0:
            out[i, 0] = out[i, 1] = out[i, 2] = 0.0
            continue
        m = material[f]
        a = 1.0 - v[i] - w[i]
        s = a * uv[f, 0, 0] + v[i] * uv[f, 1, 0] + w[i] * uv[f, 2, 0]
        t = a * uv[f, 0, 1] + v[i] * uv[f, 1, 1] + w[i] * uv[f, 2, 1]
        rows, columns = image[m, 1], image[m, 2]
        column = min(int((s - np.floor(s)) * columns), columns - 1)
        row = min(int((1.0 - (t - np.floor(t))) * rows), rows - 1)
        pixel = image[m, 0] + row * columns + column
        for c in range(3):
            diffuse = colour[m, c] * pixels[pixel, c]
            # What has no specular share may be the radiance of a scan's picture, which exceeds 1.
            out[i, c] = diffuse if specular[m] <= 0.0 else min(diffuse + specular[m], 1.0)


def albedo_at(surfaces: LitSurfaces, face: I32, v: F32, w: F32) -> F32:
    """(N, 3) float32 albedo at points of faces, given by the weights of their second and third corner.

    Black where ``face`` is negative. The nearest texel is taken: textures are kept at `TEXTURE_LIMIT`.
    """
    out = np.empty((len(face), 3), dtype=np.float32)
    looks = surfaces.material, surfaces.colour, surfaces.specular, surfaces.image, surfaces.pixels
    _albedo(face, v, w, surfaces.uv, *looks, out)
    return out


def in_chunks(work: Callable[[int, int], None], count: int, chunk: int, workers: int) -> None:
    """Call ``work(first, last)`` for consecutive pieces of ``range(count)`` on ``workers`` threads.

    The pieces do not depend on ``workers``, and every piece writes to its own place: so do the results not.
    """
    starts = range(0, count, chunk)
    if workers <= 1 or len(starts) <= 1:
        for first in starts:
            work(first, min(first + chunk, count))
        return
    with ThreadPoolExecutor(workers) as pool:
        for done in [pool.submit(work, first, min(first + chunk, count)) for first in starts]:
            done.result()


def rows_in_chunks(compute: Callable[[slice], NDArray[Any]], count: int, workers: int) -> NDArray[Any]:
    """``compute(rows)`` for consecutive slices of ``range(count)`` on ``workers`` threads, joined along the first axis.

    For array operations that compute every row by itself: the result is that of ``compute(slice(0, count))``.
    """
    if workers <= 1 or count <= _ROWS:
        return compute(slice(0, count))
    slices = [slice(first, min(first + _ROWS, count)) for first in range(0, count, _ROWS)]
    with ThreadPoolExecutor(workers) as pool:
        return np.concatenate(list(pool.map(compute, slices)))
