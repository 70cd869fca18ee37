"""Head-related impulse responses from SOFA files (AES69).

Read are files of the convention SimpleFreeFieldHRIR: impulse responses of two ears in the free field. The file's axes
are x forward, y left, z up, turned by its ListenerView and ListenerUp; here directions are in the head's frame of this
project: x right, y up, −z ahead.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import sha256_file
from generators.acoustics.sofafile import LONGEST_TEXT, SofaFile, broadcast, cartesian, opened

F64 = NDArray[np.float64]

CONVENTION = "SimpleFreeFieldHRIR"
#: Longest impulse response (s): more is the response of a room, which the tracer adds itself.
LONGEST = 0.1
LEAST_RATE, MOST_RATE = 8000, 384_000
#: Shortest impulse response (samples): fewer hold no delay between the ears.
LEAST_SAMPLES = 16
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
    file = opened(path, CONVENTION, _VARIABLES)
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
    delays = broadcast(file.numbers("Data.Delay", 2, 0.0), (count, 2), "Data.Delay", path)
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
        file.attributes.get("License", "")[:LONGEST_TEXT],
        (file.attributes.get("Organization") or file.attributes.get("AuthorContact", ""))[:LONGEST_TEXT],
        (file.attributes.get("Origin") or file.attributes.get("References", ""))[:LONGEST_TEXT],
        sha256_file(path),
    )


def _right_comes_first(file: SofaFile) -> bool:
    """Whether receiver 0 is the right ear; files without positions have the left ear first, as the convention says."""
    positions = cartesian(file, "ReceiverPosition", (0.0, 0.0, 0.0))
    return len(positions) == 2 and bool(positions[0, 1] < positions[1, 1])


def _directions(file: SofaFile, count: int) -> tuple[F64, F64]:
    """(M, 3) directions in the head's frame and (M,) distances of the sources."""
    path = file.path
    sources = broadcast(cartesian(file, "SourcePosition"), (count, 3), "SourcePosition", path)
    listener = broadcast(cartesian(file, "ListenerPosition", (0, 0, 0)), (count, 3), "ListenerPosition", path)
    view = broadcast(cartesian(file, "ListenerView", (1, 0, 0)), (count, 3), "ListenerView", path)
    up = broadcast(cartesian(file, "ListenerUp", (0, 0, 1)), (count, 3), "ListenerUp", path)
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


def _title(file: SofaFile) -> str:
    parts = (file.attributes.get(name, "") for name in ("Title", "DatabaseName", "ListenerShortName"))
    return " ".join(dict.fromkeys(word for part in parts for word in part.split()))[:LONGEST_TEXT]
