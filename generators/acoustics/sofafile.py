"""SOFA files (AES69) of any convention, read with h5py: their variables and attributes, checked.

h5py needs nothing but numpy. The readers for SOFA on PyPI bring netCDF4 and more, and sofar's wheels install a
top-level package ``tests``, which hides that of any project in the same environment.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import open_regular
from avs3d_bench.runtime.imports import needing
from avs3d_bench.text.printable import readable

F64 = NDArray[np.float64]

#: Most numbers of a file: 12,000 directions and two ears of 8192 samples.
_MOST_NUMBERS = 200_000_000
#: Larger numbers are none: netCDF writes 9.97e36 for a missing value.
_FILL = 1e30
#: Longest text of an attribute that is kept (characters).
LONGEST_TEXT = 200


@dataclass(frozen=True, eq=False)
class SofaFile:
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

    @property
    def convention(self) -> str:
        """The name of its SOFA convention."""
        return self.attributes.get("SOFAConventions", "none")

    def numbers(self, name: str, dimensions: int, default: float | None = None) -> F64:
        """A variable as float64 with so many dimensions; missing ones, and more of them, have size 1.

        Raises:
            Avs3dError: if it is missing without a default, empty, not finite or no array of numbers.
        """
        found = self.variables.get(name, None if default is None else np.float64(default))
        if found is None:
            raise Avs3dError(f"{self.path}: has no {name}, expected a SOFA file with {self.convention}")
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


def opened(path: Path, convention: str, variables: Sequence[str]) -> SofaFile:
    """Read ``variables`` and all attributes with h5py: a SOFA file is netCDF-4, which is HDF5.

    Raises:
        Avs3dError: one line, if h5py is missing, or the file is missing, no SOFA file or of another convention.
    """
    with open_regular(path) as stream:
        stream.read(1)
    with needing(f"{path}: reading SOFA files", "pip install 'avs3d-bench[sofa]'"):
        import h5py
    try:
        with h5py.File(path, "r", locking=False) as file:
            present = [name for name in variables if isinstance(file.get(name), h5py.Dataset)]
            many = sum(file[name].size for name in present)
            if many > _MOST_NUMBERS:
                raise Avs3dError(f"{path}: {many:,} numbers, expected a SOFA file of at most {_MOST_NUMBERS:,}")
            found = SofaFile(
                path,
                {name: file[name][()] for name in present},
                {name: _text(file[name].attrs.get("Type", "cartesian")).lower() for name in present},
                {name: _text(value) for name, value in file.attrs.items()},
            )
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:160]
        raise Avs3dError(f"{path}: cannot be read as a SOFA file ({reason}); expected {convention}") from None
    if found.convention != convention:
        raise Avs3dError(f"{path}: its SOFA convention is {found.convention}, expected {convention}")
    return found


def _text(value: object) -> str:
    """An attribute as one line of text; bytes that are no UTF-8 become the replacement character."""
    if getattr(value, "shape", ()) is None:  # an empty attribute
        return ""
    if isinstance(value, np.ndarray):
        value = value.ravel()[0] if value.size else ""
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return " ".join(readable(text).split())


def broadcast(values: F64, shape: tuple[int, ...], what: str, path: Path) -> F64:
    """``values`` in ``shape``: all rows are given, or one for all.

    Raises:
        Avs3dError: if neither is so; ``what`` is the variable's name.
    """
    try:
        return np.broadcast_to(values, shape)
    except ValueError:
        raise Avs3dError(f"{path}: {what} has shape {values.shape}, expected {shape} or one row for all") from None


def cartesian(file: SofaFile, name: str, default: tuple[float, float, float] | None = None) -> F64:
    """(n, 3) points or vectors of a variable in the file's axes, from Cartesian or spherical coordinates.

    Raises:
        Avs3dError: if the variable is missing without a default, or is no table of three coordinates.
    """
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
