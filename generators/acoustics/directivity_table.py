"""Directivities as tables in files: CSV, one direction a row, or NPZ, arrays of numpy.

CSV: the header is ``azimuth,elevation`` and the centres of the octaves in Hz; each row is a direction in degrees and
its amplitude (pressure, not in dB) in every octave. The directions are all pairs of some azimuths and some elevations,
in any order. Lines that begin with ``#`` are comments.

NPZ: the arguments of `Directivity.table` as arrays ``amplitudes`` (frequencies, azimuths, elevations), ``azimuths``,
``elevations`` and, unless they are 125 Hz to 4 kHz, ``frequencies``.
"""

from __future__ import annotations

import csv
import io
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_bytes, sha256_bytes
from generators.acoustics.tracer.arrivals import BANDS

F64 = NDArray[np.float64]

#: Endings of files that hold a table.
TABLE_ENDINGS = (".csv", ".npz")
#: Largest file (bytes): eight octaves of every degree of the sphere take 4 MB as an array, 10 MB as text.
_MOST_BYTES = 64 * 2**20
#: Most numbers of an array: a compressed file may claim any size.
_MOST_NUMBERS = 8_000_000
#: What numpy and zipfile raise at files that are cut, damaged, encrypted, packed in another way, or claim any size.
_BROKEN = (OSError, ValueError, TypeError, EOFError, RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error)
_ARRAYS = ("amplitudes", "azimuths", "elevations")


def read_table(path: str | Path) -> dict[str, Any]:
    """The arguments of `Directivity.table` that a file holds; ``name`` has the beginning of the file's sha256.

    Raises:
        Avs3dError: one line, if the file is missing or too large, has another ending or layout, or cells that are no
            numbers.
    """
    path = Path(path)
    if path.suffix.lower() not in TABLE_ENDINGS:
        raise Avs3dError(f"{path}: unknown ending {path.suffix!r}; expected {' or '.join(TABLE_ENDINGS)}")
    data = read_bytes(path, _MOST_BYTES)
    found = _of_csv(path, data) if path.suffix.lower() == ".csv" else _of_npz(path, data)
    return found | {"name": f"table {path.name}, sha256 {sha256_bytes(data)[:12]}"}


def _of_csv(path: Path, data: bytes) -> dict[str, Any]:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Avs3dError(f"{path}: no UTF-8 text at byte {error.start}; expected a table as CSV") from None
    numbered = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"]
    try:
        rows = [(n, row) for (n, _), row in zip(numbered, csv.reader(line for _, line in numbered), strict=False)]
    except csv.Error as error:
        raise Avs3dError(f"{path}: no CSV ({error}); expected azimuth,elevation,125,250,… and numbers") from None
    header = [cell.strip() for cell in rows[0][1]] if rows else []
    if header[:2] != ["azimuth", "elevation"] or len(header) < 3:
        raise Avs3dError(f"{path}: the header is {','.join(header)[:80]!r}, expected azimuth,elevation,125,250,…")
    frequencies = _centres(_number(path, rows[0][0], cell) for cell in header[2:])
    table = np.empty((len(rows) - 1, len(header)))
    for place, (line, row) in enumerate(rows[1:]):
        if len(row) != len(header):
            raise Avs3dError(f"{path}: line {line} has {len(row)} cells, expected {len(header)}")
        table[place] = [_number(path, line, cell) for cell in row]
    if not len(table):
        raise Avs3dError(f"{path}: has no rows; expected each pair of the azimuths and elevations once")
    azimuths, elevations = np.unique(table[:, 0]), np.unique(table[:, 1])
    directions, times = np.unique(table[:, :2], axis=0, return_counts=True)
    if len(directions) != len(azimuths) * len(elevations) or times.max() > 1:
        raise Avs3dError(
            f"{path}: {_misfit(directions, times)}; expected each pair of the azimuths and elevations once"
        )
    at = np.searchsorted(azimuths, table[:, 0]) * len(elevations) + np.searchsorted(elevations, table[:, 1])
    amplitudes = np.empty((len(frequencies), len(table)))
    amplitudes[:, at] = table[:, 2:].T
    shaped = amplitudes.reshape(len(frequencies), len(azimuths), len(elevations))
    return {"amplitudes": shaped, "azimuths": azimuths, "elevations": elevations, "frequencies": frequencies}


def _misfit(directions: F64, times: NDArray[np.int64]) -> str:
    """The first direction that is listed twice, or an azimuth that has fewer elevations than another."""
    if times.max() > 1:
        azimuth, elevation = directions[times.argmax()]
        return f"azimuth {azimuth:g}°, elevation {elevation:g}° is listed {times.max()} times"
    azimuths, counts = np.unique(directions[:, 0], return_counts=True)
    few, many = int(counts.argmin()), int(counts.argmax())
    return f"azimuth {azimuths[few]:g}° has {counts[few]} elevations, {azimuths[many]:g}° has {counts[many]}"


def _number(path: Path, line: int, cell: str) -> float:
    try:
        found = float(cell)
    except ValueError:
        found = np.nan
    if not np.isfinite(found):
        raise Avs3dError(f"{path}: line {line} has {cell.strip()[:40]!r}, expected a finite number")
    return found


def _of_npz(path: Path, data: bytes) -> dict[str, Any]:
    found: dict[str, Any] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            large = [entry.filename for entry in archive.infolist() if entry.file_size > 8 * _MOST_NUMBERS]
        if large:
            raise Avs3dError(f"{path}: {large[0]} is larger than {_MOST_NUMBERS:,} numbers, expected a table")
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            for name in (*_ARRAYS, "frequencies"):
                if name in arrays:
                    found[name] = np.asarray(arrays[name], dtype=np.float64)
    except _BROKEN as error:
        raise Avs3dError(f"{path}: no NPZ file of numbers ({error}); expected one of numpy.savez") from None
    missing = [name for name in _ARRAYS if name not in found]
    if missing:
        raise Avs3dError(f"{path}: has no array {missing[0]}; expected {', '.join(_ARRAYS)} and frequencies")
    frequencies = found.get("frequencies", np.array(BANDS[1:-1], dtype=np.float64)).reshape(-1)
    if not np.isfinite(frequencies).all():
        raise Avs3dError(f"{path}: frequencies have NaN or infinite values, expected the centres of octaves in Hz")
    return found | {"frequencies": _centres(frequencies.tolist())}


def _centres(frequencies: Iterable[float]) -> list[float]:
    """Frequencies (Hz), whole ones as whole numbers: messages name them."""
    return [int(each) if each == int(each) else each for each in frequencies]
