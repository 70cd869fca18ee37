"""Acoustic energy maps: from where how much energy arrives, every 100 ms.

The steered-response power of ambisonics: for each direction of a grid, the energy of a beam of greatest directivity
that looks there (plane-wave decomposition; B. Rafaely, Fundamentals of Spherical Array Processing, 2015, chapter 5),

    e(Ω) = mean over time of ( Σ_l (2l + 1) Σ_m Y_lm(Ω) b_lm / (N + 1)² )²,

with Y_lm the SN3D harmonics and b the channels. All orders N that the dataset has are used: order 3 resolves three to
four times finer than the first order of the WAV files, which is the super-resolution that DCASE 2026 task 3 asks for.
The grid is equirectangular, as the panoramas are: columns from azimuth +180° (left edge) to −180°, rows from +90°.
"""

from __future__ import annotations

import io
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Observation
from avs3d_bench.exports.seld.events import LABELS_PER_SECOND, TurningHead
from avs3d_bench.exports.seld.sound import check_ambisonics, read_second
from avs3d_bench.formats.files import write_bytes
from avs3d_bench.geometry import ambisonic_axes, spherical_harmonics

Array = NDArray[np.float64]

#: Degrees between two directions of the grid.
GRID_DEGREES = 5


def grid() -> tuple[Array, Array]:
    """Azimuths (72,), descending, and elevations (36,), descending, of the middles of the cells, degrees."""
    half = GRID_DEGREES / 2
    return np.arange(180 - half, -180, -GRID_DEGREES), np.arange(90 - half, -90, -GRID_DEGREES)


@lru_cache(maxsize=1)
def _directions() -> Array:
    """(36 · 72, 3) unit vectors of the grid, row by row; x forward, y left, z up."""
    azimuth, elevation = (np.radians(angles) for angles in grid())
    el, az = np.meshgrid(elevation, azimuth, indexing="ij")
    return np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], axis=-1).reshape(-1, 3)


def steering(directions: Array, order: int) -> Array:
    """(n, (order + 1)²) weights of the channels of beams that look in unit vectors (n, 3); 1 for a wave from there."""
    degrees = np.array([degree for degree in range(order + 1) for _ in range(2 * degree + 1)])
    return np.asarray(spherical_harmonics(directions, order) * (2 * degrees + 1) / (order + 1) ** 2)


def energy_maps(observation: Observation, seconds: int, head: TurningHead) -> NDArray[np.float32]:
    """(10 · seconds, 36, 72) energy from each direction of the head's grid, every 100 ms: mean square of a beam.

    Raises:
        UsageError: if the dataset has no ambisonics.
        Avs3dError: if a clip is missing or damaged.
    """
    channels = check_ambisonics(observation)
    order = round(np.sqrt(channels)) - 1
    to_head = ambisonic_axes(np.eye(3))  # rows: axes of the camera, in those of AmbiX
    rows, columns = (len(angles) for angles in reversed(grid()))
    maps = np.zeros((LABELS_PER_SECOND * seconds, rows, columns), dtype=np.float32)
    still = steering(_directions(), order)
    for second, frame in enumerate(observation.frames[:seconds]):
        clip = read_second(frame, layout.AMBISONICS, channels).astype(np.float64)
        for part, piece in enumerate(np.split(clip, LABELS_PER_SECOND, axis=1)):
            beams = still
            if head.turn(second).any():
                turned = to_head.T @ head.turned_since(second, (part + 0.5) / LABELS_PER_SECOND) @ to_head
                beams = steering(_directions() @ turned, order)
            covariance = piece @ piece.T / piece.shape[1]
            energy = np.sum((beams @ covariance) * beams, axis=1)
            maps[second * LABELS_PER_SECOND + part] = energy.reshape(rows, columns)
    return maps


def write_maps(path: Path, maps: NDArray[np.float32]) -> None:
    """Write maps with their axes as a compressed NPZ: energy, azimuth, elevation (degrees, positive left and up).

    Raises:
        Avs3dError: if the system refuses.
    """
    azimuth, elevation = grid()
    stream = io.BytesIO()
    np.savez_compressed(stream, energy=maps, azimuth=azimuth, elevation=elevation)
    write_bytes(path, stream.getvalue())
