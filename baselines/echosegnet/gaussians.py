"""3D Gaussians as tensors, their start from a point cloud, and their PLY files.

The parameters are those of 3D-GS (Kerbl et al. 2023) before activation: scales as logarithms, opacities as logits,
rotations as quaternions (w, x, y, z) of any norm, colour as real spherical harmonics with the mean colour at 0.5.

The files have the layout of `avs3d_bench.formats.gaussian_ply`, and ``audio_intensity`` as well where it is known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.gaussian_ply import GaussianTable, table_of, write_gaussians
from avs3d_bench.formats.ply_reader import read_tables

#: The constant spherical harmonic, ½·√(1/π).
SH_C0 = 0.28209479177387814
#: Opacity of a Gaussian made from a point.
INITIAL_OPACITY = 0.1
_NEIGHBOURS = 3
_INTENSITY = "audio_intensity"
_EXPECTED = (
    "expected Gaussians as a binary little-endian PLY with one element, vertex, of float properties only; regenerate it"
)


@dataclass(frozen=True, eq=False)
class Gaussians:
    """N Gaussians; all tensors share device and dtype (float32; float64 in tests).

    Attributes:
        means: (N, 3) centres, metres, Y-down world.
        log_scales: (N, 3) natural logarithm of the standard deviations in metres.
        rotations: (N, 4) quaternions (w, x, y, z), local to world, not normalised.
        opacities: (N,) logits.
        sh: (N, K, 3) spherical harmonics, K = (degree + 1)², RGB.
    """

    means: Tensor
    log_scales: Tensor
    rotations: Tensor
    opacities: Tensor
    sh: Tensor

    def __post_init__(self) -> None:
        """Refuse tensors that do not fit together.

        Raises:
            Avs3dError: naming the attribute, its shape and the expected one.
        """
        count, bands = len(self.means), self.sh.shape[1] if self.sh.ndim == 3 else 0
        expected = {"means": (count, 3), "log_scales": (count, 3), "rotations": (count, 4), "opacities": (count,)}
        for name, shape in {**expected, "sh": (count, bands, 3)}.items():
            found = tuple(getattr(self, name).shape)
            if found != shape:
                raise Avs3dError(f"Gaussians: {name} has shape {found}, expected {shape}")
        if bands not in (1, 4, 9, 16):
            raise Avs3dError(f"Gaussians: {bands} spherical harmonics, expected 1, 4, 9 or 16")

    def __len__(self) -> int:
        return len(self.means)

    @property
    def scales(self) -> Tensor:
        """(N, 3) standard deviations along the own axes, metres."""
        return self.log_scales.exp()

    @property
    def alphas(self) -> Tensor:
        """(N,) opacity at the centre, in (0, 1)."""
        return self.opacities.sigmoid()

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics."""
        return int(self.sh.shape[1] ** 0.5) - 1

    @property
    def device(self) -> torch.device:
        """Where the tensors are."""
        return self.means.device

    def select(self, mask: Tensor | NDArray[Any]) -> Gaussians:
        """Those where ``mask`` (N,) is true, or those at the given indices, in that order."""
        index = torch.as_tensor(mask, device=self.device)
        return Gaussians(*(getattr(self, field.name)[index] for field in fields(self)))

    def to(self, device: torch.device | str) -> Gaussians:
        """The same on another device."""
        return Gaussians(*(getattr(self, field.name).to(device) for field in fields(self)))


def from_points(xyz: ArrayLike, rgb: ArrayLike, *, sh_degree: int = 3) -> Gaussians:
    """Isotropic Gaussians at points, as 3D-GS starts.

    Scale = root mean square distance to the three nearest other points; opacity 0.1; constant colour.

    Args:
        xyz: (N, 3) metres.
        rgb: (N, 3), uint8 or floats in [0, 1].
        sh_degree: room for spherical harmonics up to this degree; those above 0 start at zero.

    Returns:
        float32, on the CPU.

    Raises:
        Avs3dError: if there are fewer than two points, or numbers are not finite.
    """
    points, colours = np.asarray(xyz, dtype=np.float64), np.asarray(rgb)
    if points.ndim != 2 or points.shape[1] != 3 or colours.shape != points.shape:
        raise Avs3dError(f"initial points have shape {points.shape}, colours {colours.shape}; expected (N, 3) both")
    if len(points) < 2:
        raise Avs3dError(f"{len(points)} initial points, expected at least 2: sparse/0 holds too little")
    if colours.dtype == np.uint8:
        colours = colours / 255.0
    if not (np.isfinite(points).all() and np.isfinite(colours).all()):
        raise Avs3dError("initial points or colours hold NaN or infinite numbers; repair sparse/0/points3D.bin")
    near, _ = cKDTree(points).query(points, k=range(2, min(_NEIGHBOURS, len(points) - 1) + 2))
    # The floor keeps coincident points from becoming Gaussians of no size.
    scale = np.sqrt(np.maximum(np.mean(near**2, axis=1), 1e-7))
    sh = np.zeros((len(points), (sh_degree + 1) ** 2, 3))
    sh[:, 0] = (colours - 0.5) / SH_C0
    rotations = np.tile([1.0, 0.0, 0.0, 0.0], (len(points), 1))
    logit = np.log(INITIAL_OPACITY / (1.0 - INITIAL_OPACITY))
    parts = (points, np.repeat(np.log(scale)[:, None], 3, axis=1), rotations, np.full(len(points), logit), sh)
    return Gaussians(*(torch.from_numpy(np.ascontiguousarray(part, dtype=np.float32)) for part in parts))


def write_ply(path: str | Path, gaussians: Gaussians, audio_intensity: ArrayLike | Tensor | None = None) -> None:
    """Write a PLY in the reference layout, atomically.

    Args:
        path: the file.
        gaussians: on any device.
        audio_intensity: (N,), written as one more property.

    Raises:
        Avs3dError: if a number is not finite, lengths differ, or the system refuses.
    """
    further = {}
    if audio_intensity is not None:
        further[_INTENSITY] = _numpy(audio_intensity)
        if further[_INTENSITY].shape != (len(gaussians),):
            raise Avs3dError(
                f"{path}: audio_intensity has shape {further[_INTENSITY].shape}, expected ({len(gaussians)},)"
            )
    table = GaussianTable(*(_numpy(getattr(gaussians, field.name)) for field in fields(Gaussians)))
    write_gaussians(path, table, further, "; the training diverged")


def _numpy(values: ArrayLike | Tensor) -> NDArray[Any]:
    return np.asarray(values.detach().cpu() if isinstance(values, Tensor) else values)


def _read_table(path: str | Path) -> Mapping[str, NDArray[np.float32]]:
    try:
        header, tables = read_tables(path)
    except Avs3dError as error:
        raise Avs3dError(f"{error} ({_EXPECTED})") from None
    names = [column.name for element in header.elements for column in element.properties]
    simple = all(column.kind == "f4" and not column.count for e in header.elements for column in e.properties)
    if header.form != "binary_little_endian" or len(header.elements) != 1 or not simple:
        raise Avs3dError(f"{path}: {_EXPECTED}")
    table = tables.get("vertex", np.empty(0, dtype=[(name, "<f4") for name in names]))
    if not all(np.isfinite(table[name]).all() for name in names):
        raise Avs3dError(f"{path}: holds NaN or infinite numbers; regenerate it")
    return {name: table[name] for name in names}


def read_ply(path: str | Path) -> Gaussians:
    """Read Gaussians that any implementation of 3D-GS wrote (binary little endian).

    Raises:
        Avs3dError: if the file is missing, truncated, or lacks a property.
    """
    table = table_of(_read_table(path), path)
    return Gaussians(*(torch.from_numpy(getattr(table, field.name)) for field in fields(Gaussians)))


def read_audio_intensity(path: str | Path) -> NDArray[np.float32] | None:
    """The property ``audio_intensity`` (N,) of such a file; None where it has none.

    Raises:
        Avs3dError: if the file is missing or truncated.
    """
    table = _read_table(path)
    return table[_INTENSITY].copy() if _INTENSITY in table else None
