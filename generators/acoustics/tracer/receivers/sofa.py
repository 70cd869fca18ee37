"""Head-related impulse responses from SOFA files (AES69), read with h5py.

h5py needs nothing but numpy. The readers for SOFA on PyPI bring netCDF4 and more, and sofar's wheels install a
top-level package ``tests``, which hides that of any project in the same environment.

Read are files of the convention SimpleFreeFieldHRIR: impulse responses of two ears in the free field. The file's axes
are x forward, y left, z up, turned by its ListenerView and ListenerUp; here directions are in the head's frame of this
project: x right, y up, −z ahead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import open_regular, sha256_file
from avs3d_bench.runtime.imports import needing
from avs3d_bench.text.printable import readable

F64 = NDArray[np.float64]

CONVENTION = "SimpleFreeFieldHRIR"
#: Longest impulse response (s): more is the response of a room, which the tracer adds itself.
LONGEST = 0.1
LEAST_RATE, MOST_RATE = 8000, 384_000
#: Shortest impulse response (samples): fewer hold no delay between the ears.
LEAST_SAMPLES = 16
#: Most numbers of a file: 12,000 directions and two ears of 8192 samples.
_MOST_NUMBERS = 200_000_000
#: Larger numbers are none: netCDF writes 9.97e36 for a missing value.
_FILL = 1e30
#: Longest text of an attribute that is kept (characters).
_LONGEST_TEXT = 200
_VARIABLES = (
    "Data.IR",
    "Data.SamplingRate",
    "Data.Delay",
    "SourcePosition",
    "ReceiverPosition",
    "ListenerPosition",
    "ListenerView",
    "ListenerUp",
)
#: Directions nearer to one another (rad) are the same direction, measured more than once.
_SAME = np.radians(0.02)


@dataclass(frozen=True, eq=False)
class HrirSet:
    """Head-related impulse responses.

    Attributes:
        directions: (M, 3) unit vectors in the head's frame towards the sources; no two are the same.
        impulses: (M, 2, N) left and right ear.
        delays: (M, 2) s to be added to the impulse responses' own.
        sample_rate: Hz.
        name: title, database and subject, as far as the file has them; "not stated in the file" without any.
        licence: the file's own words; may be empty.
        author: the organisation that made it, or whom to contact; may be empty.
        origin: where it came from, in the file's words; may be empty.
        sha256: of the file.
    """

    directions: F64
    impulses: F64
    delays: F64
    sample_rate: float
    name: str
    licence: str
    author: str
    origin: str
    sha256: str


def read_hrirs(path: str | Path) -> HrirSet:
    """Read the two ears' responses of a SOFA file.

    Raises:
        Avs3dError: one line, if h5py is missing, or the file is missing, no SOFA file, of another convention, without
            two ears, or has numbers that are not finite or out of range.
    """
    path = Path(path)
    file = _opened(path)
    convention = file.attributes.get("SOFAConventions", "none")
    if convention != CONVENTION:
        raise Avs3dError(f"{path}: its SOFA convention is {convention}, expected {CONVENTION}")
    impulses = file.numbers("Data.IR", 3)
    count, ears, length = impulses.shape
    if ears != 2:
        raise Avs3dError(f"{path}: Data.IR has {ears} receiver{'s' * (ears != 1)}, expected two ears")
    rate = file.numbers("Data.SamplingRate", 0).ravel()
    if rate.size != 1 or not LEAST_RATE <= rate[0] <= MOST_RATE:
        raise Avs3dError(
            f"{path}: Data.SamplingRate is {rate.tolist()}, expected one rate from {LEAST_RATE} to {MOST_RATE} Hz"
        )
    if length < LEAST_SAMPLES:
        raise Avs3dError(f"{path}: Data.IR has {length} samples, expected at least {LEAST_SAMPLES}")
    if length > LONGEST * rate[0]:
        raise Avs3dError(
            f"{path}: its responses are {length / rate[0] * 1000:.0f} ms long, "
            f"expected at most {LONGEST * 1000:.0f} ms of a free field"
        )
    silent = np.argwhere(~impulses.any(axis=2))
    if len(silent):
        row, ear = silent[0]
        raise Avs3dError(f"{path}: Data.IR of measurement {row}, receiver {ear} is silent, expected a response")
    delays = _broadcast(file.numbers("Data.Delay", 2, 0.0), (count, 2), "Data.Delay", path)
    if delays.min() < 0 or delays.max() > LONGEST * rate[0]:
        raise Avs3dError(f"{path}: Data.Delay spans {delays.min():g} to {delays.max():g} samples, expected 0 to 100 ms")
    if _right_comes_first(file):
        impulses, delays = impulses[:, ::-1], delays[:, ::-1]
    directions, distances = _directions(file, count)
    keep = _distinct(directions, distances)
    return HrirSet(
        directions[keep],
        impulses[keep],
        delays[keep] / rate[0],
        float(rate[0]),
        _title(file) or "not stated in the file",
        file.attributes.get("License", "")[:_LONGEST_TEXT],
        (file.attributes.get("Organization") or file.attributes.get("AuthorContact", ""))[:_LONGEST_TEXT],
        (file.attributes.get("Origin") or file.attributes.get("References", ""))[:_LONGEST_TEXT],
        sha256_file(path),
    )


@dataclass(frozen=True, eq=False)
class _SofaFile:
    """Contents of a SOFA file.

    Attributes:
        path: of the file.
        variables: by their names in the file.
        types: of coordinates, by the variable's name: ``cartesian`` or ``spherical``.
        attributes: of the file, as text.
    """

    path: Path
    variables: dict[str, NDArray[Any]]
    types: dict[str, str]
    attributes: dict[str, str]

    def numbers(self, name: str, dimensions: int, default: float | None = None) -> F64:
        """A variable as float64 with so many dimensions; missing ones, and more of them, have size 1."""
        found = self.variables.get(name, None if default is None else np.float64(default))
        if found is None:
            raise Avs3dError(f"{self.path}: has no {name}, expected a SOFA file with {CONVENTION}")
        try:
            values = np.asarray(found, dtype=np.float64)
        except (TypeError, ValueError):
            raise Avs3dError(f"{self.path}: {name} is no array of numbers") from None
        if not values.size:
            raise Avs3dError(f"{self.path}: {name} is empty, expected numbers")
        if not np.isfinite(values).all() or np.abs(values).max() > _FILL:
            raise Avs3dError(f"{self.path}: {name} has NaN, infinite or missing values, expected finite numbers")
        shape = (*values.shape[:dimensions], *(1,) * (dimensions - values.ndim))
        if values.size != math.prod(shape):
            raise Avs3dError(f"{self.path}: {name} has shape {values.shape}, expected {dimensions} dimensions")
        return values.reshape(shape)


def _opened(path: Path) -> _SofaFile:
    """The variables and attributes that are needed, read with h5py: a SOFA file is netCDF-4, which is HDF5."""
    with open_regular(path) as stream:
        stream.read(1)
    with needing(f"{path}: reading SOFA files", "pip install 'avs3d-bench[sofa]'"):
        import h5py
    try:
        with h5py.File(path, "r", locking=False) as file:
            present = [name for name in _VARIABLES if isinstance(file.get(name), h5py.Dataset)]
            many = sum(file[name].size for name in present)
            if many > _MOST_NUMBERS:
                raise Avs3dError(f"{path}: {many:,} numbers, expected a SOFA file of at most {_MOST_NUMBERS:,}")
            return _SofaFile(
                path,
                {name: file[name][()] for name in present},
                {name: _text(file[name].attrs.get("Type", "cartesian")).lower() for name in present},
                {name: _text(value) for name, value in file.attrs.items()},
            )
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:160]
        raise Avs3dError(f"{path}: cannot be read as a SOFA file ({reason}); expected {CONVENTION}") from None


def _text(value: object) -> str:
    """An attribute as one line of text; bytes that are no UTF-8 become the replacement character."""
    if getattr(value, "shape", ()) is None:  # an empty attribute
        return ""
    if isinstance(value, np.ndarray):
        value = value.ravel()[0] if value.size else ""
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return " ".join(readable(text).split())


def _broadcast(values: F64, shape: tuple[int, ...], what: str, path: Path) -> F64:
    try:
        return np.broadcast_to(values, shape)
    except ValueError:
        raise Avs3dError(f"{path}: {what} has shape {values.shape}, expected {shape} or one row for all") from None


def _cartesian(file: _SofaFile, name: str, default: tuple[float, float, float] | None = None) -> F64:
    """(n, 3) points or vectors of a variable in the file's axes, from Cartesian or spherical coordinates."""
    if default is not None and name not in file.variables:
        return np.array([default], dtype=np.float64)
    values = file.numbers(name, 2)
    if values.shape[1] != 3:
        raise Avs3dError(f"{file.path}: {name} has shape {values.shape}, expected (n, 3)")
    kind = file.types[name]
    if kind == "cartesian":
        return values
    if kind != "spherical":
        raise Avs3dError(f"{file.path}: the Type of {name} is {kind!r}, expected spherical or cartesian")
    azimuth, elevation, radius = np.radians(values[:, 0]), np.radians(values[:, 1]), values[:, 2]
    flat = radius * np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), radius * np.sin(elevation)], axis=1)


def _right_comes_first(file: _SofaFile) -> bool:
    """Whether receiver 0 is the right ear; files without positions have the left ear first, as the convention says."""
    positions = _cartesian(file, "ReceiverPosition", (0.0, 0.0, 0.0))
    return len(positions) == 2 and bool(positions[0, 1] < positions[1, 1])


def _directions(file: _SofaFile, count: int) -> tuple[F64, F64]:
    """(M, 3) directions in the head's frame and (M,) distances of the sources."""
    path = file.path
    sources = _broadcast(_cartesian(file, "SourcePosition"), (count, 3), "SourcePosition", path)
    listener = _broadcast(_cartesian(file, "ListenerPosition", (0, 0, 0)), (count, 3), "ListenerPosition", path)
    view = _broadcast(_cartesian(file, "ListenerView", (1, 0, 0)), (count, 3), "ListenerView", path)
    up = _broadcast(_cartesian(file, "ListenerUp", (0, 0, 1)), (count, 3), "ListenerUp", path)
    left = np.cross(up, view)
    axes = np.stack([-left, np.cross(view, left), -view], axis=1)  # right, up, backward; (M, 3 axes, 3)
    length = np.linalg.norm(axes, axis=2)
    if length.min() < 1e-6:
        raise Avs3dError(f"{path}: ListenerView and ListenerUp are parallel or zero, expected two axes of the head")
    offset = sources - listener
    distance = np.linalg.norm(offset, axis=1)
    if distance.min() < 1e-6:
        raise Avs3dError(f"{path}: SourcePosition of measurement {int(distance.argmin())} is at the listener")
    directions = np.einsum("mij,mj->mi", axes / length[..., None], offset)
    return directions / distance[:, None], distance


def _distinct(directions: F64, distances: F64) -> NDArray[np.intp]:
    """Indices of measurements of different directions, in order; of several of one direction the farthest counts."""
    order = np.lexsort((np.arange(len(directions)), -np.round(distances, 3)))
    _, first = np.unique(np.round(directions[order] / _SAME).astype(np.int64), axis=0, return_index=True)
    return np.sort(order[first])


def _title(file: _SofaFile) -> str:
    parts = (file.attributes.get(name, "") for name in ("Title", "DatabaseName", "ListenerShortName"))
    return " ".join(dict.fromkeys(word for part in parts for word in part.split()))[:_LONGEST_TEXT]
