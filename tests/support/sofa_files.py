"""SOFA files made from the closed form of a rigid sphere, as other programs write them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.hrtf import HEAD_RADIUS
from generators.acoustics.tracer.receivers.sphere import sphere_response

RATE = 44_100
#: When a sound passes the centre of the head in the files (s).
ZERO = 0.0015


def fibonacci(count: int) -> np.ndarray:
    """(count, 3) evenly spread unit vectors."""
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (3 - math.sqrt(5)) * np.arange(count)
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


def sphere_impulses(points: np.ndarray, rate: float, samples: int = 256, gain: float = 1.0) -> np.ndarray:
    """(M, 2, samples) responses of the rigid sphere for directions in SOFA's axes (forward, left, up)."""
    length = 1024
    omega = 2 * np.pi * np.fft.rfftfreq(length, 1 / rate)
    fade = 0.5 + 0.5 * np.cos(np.pi * np.clip(omega / omega[-1] * 10 - 9, 0, 1))
    ears = []
    for side in (1.0, -1.0):
        response = sphere_response(np.arccos(np.clip(side * points[:, 1], -1, 1)), omega * HEAD_RADIUS / SPEED_OF_SOUND)
        ears.append(np.fft.irfft(gain * response * fade * np.exp(-1j * omega * ZERO), length)[:, :samples])
    return np.stack(ears, axis=1)


def write(path: Path, points: np.ndarray, impulses: np.ndarray, rate: float = RATE, **fields: Any) -> Path:
    """A SOFA file: netCDF-4 is HDF5.

    Args:
        path: of the file.
        points: (M, 3) unit vectors: forward, left, up.
        impulses: (M, R, N).
        rate: Hz.
        **fields: other values of attributes (text) and of variables (Data_IR for Data.IR; None leaves it out; with
            its type as a pair).
    """
    azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360
    elevation = np.degrees(np.arcsin(np.clip(points[:, 2], -1, 1)))
    values: dict[str, Any] = {
        "Data_IR": impulses,
        "Data_SamplingRate": np.array([rate]),
        "Data_Delay": np.zeros((1, impulses.shape[1])),
        "SourcePosition": (np.stack([azimuth, elevation, np.full(len(points), 1.5)], axis=1), "spherical"),
        "ReceiverPosition": (np.array([[0, 0.09, 0], [0, -0.09, 0]])[: impulses.shape[1], :, None], "cartesian"),
        "ListenerPosition": (np.zeros((1, 3)), "cartesian"),
        "ListenerView": (np.array([[1.0, 0, 0]]), "cartesian"),
        "ListenerUp": np.array([[0.0, 0, 1]]),
        "Conventions": "SOFA",
        "SOFAConventions": "SimpleFreeFieldHRIR",
        "Title": "A rigid sphere",
        "License": "CC0",
        **fields,
    }
    import h5py

    with h5py.File(path, "w") as file:
        file.attrs["DatabaseName"] = h5py.Empty("S1")
        for name, value in values.items():
            if isinstance(value, str):
                # Other programs write bytes.
                file.attrs[name] = np.bytes_(value) if name == "License" else value
            elif value is not None:
                numbers, kind = value if isinstance(value, tuple) else (value, None)
                variable = file.create_dataset(name.replace("_", "."), data=numbers)
                if kind is not None:
                    variable.attrs["Type"] = kind
    return path


def write_sphere(path: Path, count: int = 900, **fields: Any) -> Path:
    """A file with ``count`` directions of the sphere; ``fields``: see `write`."""
    points = fibonacci(count)
    return write(path, points, sphere_impulses(points, RATE, gain=0.2), **fields)
