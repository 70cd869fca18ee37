"""Splats as a capture of a textured mesh would give them: flat discs on its surface with the colours of its texels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from avs3d_bench.formats.gaussian_ply import GaussianTable, write_gaussians
from generators.core.scene import Mesh
from generators.core.tone import srgb_encode

C0 = 0.28209479177387814


def gaussians(
    means: object,
    scales: object,
    opacities: object,
    *,
    rotations: object = None,
    colours: object = None,
    sh: object = None,
) -> GaussianTable:
    """A table of N Gaussians from activated values: scales in metres, opacities and colours 0 to 1."""
    centres = np.asarray(means, dtype=np.float64).reshape(-1, 3)
    count = len(centres)
    alpha = np.broadcast_to(np.asarray(opacities, dtype=np.float64), count)
    turns = np.tile([1.0, 0, 0, 0], (count, 1)) if rotations is None else np.asarray(rotations)
    rgb = np.full((count, 3), 0.5) if colours is None else np.broadcast_to(colours, (count, 3))
    harmonics = ((rgb - 0.5) / C0)[:, None] if sh is None else np.asarray(sh)
    sizes = np.broadcast_to(np.asarray(scales, dtype=np.float64), (count, 3))
    with np.errstate(divide="ignore"):
        logits = np.log(alpha / (1 - alpha))
        parts = (centres, np.log(sizes), turns, logits, harmonics)
    return GaussianTable(*(np.ascontiguousarray(part, dtype=np.float32) for part in parts))


def captured(mesh: Mesh, count: int, rng: np.random.Generator, *, spread: float = 0.5) -> GaussianTable:
    """Discs evenly over a mesh.

    Args:
        mesh: with textures or plain colours that are displayed as they are.
        count: of the discs.
        rng: of their places.
        spread: standard deviation of a disc over the side of the square that it stands for.
    """
    corners = mesh.positions.astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(across, axis=1)
    place = (np.arange(count) + rng.random(count)) / count * area.sum()
    face = np.minimum(np.searchsorted(np.cumsum(area), place, side="right"), len(area) - 1)
    weights = np.sort(rng.random((count, 2)), axis=1)
    b, c = weights[:, 0], weights[:, 1] - weights[:, 0]

    def inside(values: np.ndarray) -> np.ndarray:
        first = values[face, 0]
        return first + b[:, None] * (values[face, 1] - first) + c[:, None] * (values[face, 2] - first)

    normal = across[face] / np.linalg.norm(across[face], axis=1)[:, None]
    side = np.cross(np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]]), normal)
    side /= np.linalg.norm(side, axis=1)[:, None]
    frames = np.stack([side, np.cross(normal, side), normal], axis=2)
    disc = spread * np.sqrt(area.sum() / count)
    return gaussians(
        inside(corners),
        np.tile([disc, disc, 1e-4], (count, 1)),
        0.99,
        rotations=np.roll(Rotation.from_matrix(frames).as_quat(), 1, axis=1),
        colours=_colours(mesh, face, inside(mesh.uv.astype(np.float64))),
    )


def _colours(mesh: Mesh, face: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(N, 3) sRGB values, 0 to 1."""
    out = np.empty((len(face), 3))
    for number, material in enumerate(mesh.materials):
        own = mesh.face_material[face] == number
        if material.texture is None:
            out[own] = srgb_encode(material.colour)
            continue
        height, width = material.texture.pixels.shape[:2]
        column = np.floor(uv[own, 0] * width).astype(int) % width
        row = np.floor((1.0 - uv[own, 1]) * height).astype(int) % height
        out[own] = material.texture.pixels[row, column] / 255.0
    return out


def write_captured(path: Path, mesh: Mesh, count: int) -> Path:
    """Write such splats."""
    write_gaussians(path, captured(mesh, count, np.random.default_rng(7)))
    return path
