"""Measured directivities from SOFA files of the convention FreeFieldDirectivityTF (AES69-2022): transfer functions.

Of every direction the energy of each octave is kept: the mean of |H|² over the file's frequencies in it and over all
measurements of that direction, such as the notes of an instrument. Octaves below and above the file's frequencies
repeat the nearest. Directions may be any set; amplitudes are interpolated between the nearest three of them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.acoustics.sofafile import SofaFile, broadcast, cartesian, opened
from generators.acoustics.tracer.arrivals import BANDS
from generators.acoustics.tracer.receivers.sphere_mesh import SphereMesh

F64 = NDArray[np.float64]

CONVENTION = "FreeFieldDirectivityTF"
#: Directions nearer to one another (rad) are the same direction, measured more than once.
_SAME = np.radians(0.02)
_AXES = ("ListenerPosition", "ListenerView", "ListenerUp", "SourcePosition", "SourceView", "SourceUp")
_VARIABLES = ("Data.Real", "Data.Imag", "N", "ReceiverPosition", *_AXES)


def read_directivity(path: str | Path, wanted: F64) -> tuple[F64, str]:
    """Read the directivity of a SOFA file.

    Args:
        path: of the file.
        wanted: (n, 3) unit vectors in the source's frame (see `generators.acoustics.directivity`).

    Returns:
        amplitudes (8, n) in the octaves of `BANDS`, and the file's title, or its name.

    Raises:
        Avs3dError: see `generators.acoustics.directivity.Directivity.sofa`.
    """
    path = Path(path)
    file = opened(path, CONVENTION, _VARIABLES)
    real, imaginary = file.numbers("Data.Real", 3), file.numbers("Data.Imag", 3)
    if real.shape != imaginary.shape:
        raise Avs3dError(f"{path}: Data.Real has shape {real.shape}, Data.Imag {imaginary.shape}; expected the same")
    directions = _directions(file, *real.shape[:2]).reshape(-1, 3)
    energy = _octaves(file, real**2 + imaginary**2).reshape(-1, len(BANDS))
    _, first, place = np.unique(
        np.round(directions / _SAME).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    total = np.zeros((len(first), len(BANDS)))
    np.add.at(total, place.reshape(-1), energy)
    amplitudes = np.sqrt(total / np.bincount(place.reshape(-1))[:, None])
    corners, weights = SphereMesh.of(directions[first], path).interpolation(wanted)
    return np.einsum("nk,nkb->bn", weights, amplitudes[corners]), file.attributes.get("Title") or path.name


def _octaves(file: SofaFile, energy: F64) -> F64:
    """(M, R, 8) mean over the frequencies of each octave of ``energy`` (M, R, N)."""
    frequency = broadcast(file.numbers("N", 1), energy.shape[2:], "N", file.path)
    inside = np.abs(np.log2(np.maximum(frequency, 1e-9)[None] / np.array(BANDS)[:, None])) <= 0.5
    known = np.flatnonzero(inside.any(axis=1))
    if not len(known) or len(known) != known[-1] - known[0] + 1:
        gap = BANDS[0] if not len(known) else next(BANDS[b] for b in range(known[0], known[-1]) if b not in known)
        raise Avs3dError(f"{file.path}: N has no frequency in the octave of {gap} Hz, expected all that it spans")
    octaves = [energy[..., inside[band]].mean(axis=-1) for band in known]
    return np.stack([octaves[int(np.clip(band - known[0], 0, len(known) - 1))] for band in range(len(BANDS))], axis=-1)


def _directions(file: SofaFile, measurements: int, receivers: int) -> F64:
    """(M, R, 3) unit vectors in the source's frame: left, up, front."""
    path, shape = file.path, (measurements, 3)
    defaults = {"View": (1.0, 0.0, 0.0), "Up": (0.0, 0.0, 1.0), "Position": (0.0, 0.0, 0.0)}
    origin, turn = [], []
    for who in ("Listener", "Source"):
        position, view, up = (
            broadcast(cartesian(file, f"{who}{what}", defaults[what]), shape, f"{who}{what}", path)
            for what in ("Position", "View", "Up")
        )
        left = np.cross(up, view)
        axes = np.stack([left, np.cross(view, left), view], axis=1)
        length = np.sqrt((axes**2).sum(axis=2, keepdims=True))
        if length.min() < 1e-6:
            raise Avs3dError(f"{path}: {who}View and {who}Up are parallel or zero, expected two axes")
        origin.append(position)
        turn.append(axes / length)
    around = broadcast(cartesian(file, "ReceiverPosition"), (receivers, 3), "ReceiverPosition", path)
    # The file's axes are forward, left, up; those of `turn` left, up, forward.
    world = origin[0][:, None] + np.einsum("mij,ri->mrj", turn[0], around[:, [1, 2, 0]])
    offset = np.einsum("mij,mrj->mri", turn[1], world - origin[1][:, None])
    distance = np.sqrt((offset**2).sum(axis=2, keepdims=True))
    if distance.min() < 1e-6:
        raise Avs3dError(f"{path}: ReceiverPosition of receiver {int(distance.argmin()) % receivers} is at the source")
    return np.asarray(offset / distance)
