"""Arrays of omnidirectional microphones that move with the listener.

Positions are metres in the frame of the listener's head: x to the right, y up, −z ahead; the origin is the centre of
the head. There is no head in the sound field. Each arrival is a plane wave, which is exact enough for an array that is
small beside the distances to sources and walls.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.contract.layout import MOST_CHANNELS
from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.imports import import_by_name
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracer.receivers.synthesis import (
    ReceiverPort,
    checked,
    grids_of_length,
    response_length,
    synthesise,
)

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import ArrayRecord, Scalar

#: Farthest microphone from the centre of the head (m): beyond, plane waves and the checks of the path say nothing.
FARTHEST = 1.0


class Array:
    """Omnidirectional microphones at given places.

    Args:
        source: (microphones, 3) positions in the head's frame, metres; or the file that lists them; or its record.

    Raises:
        Avs3dError: if positions are not of that shape, not finite or farther than `FARTHEST`; as `read_array`.

    Examples:
        >>> Array([(-0.1, 0.0, 0.0), (0.1, 0.0, 0.0)]).channel_names
        ('mic_1', 'mic_2')
    """

    def __init__(self, source: ArrayLike | ArrayRecord | str | Path) -> None:
        if isinstance(source, str | Path):
            record: ArrayRecord = import_by_name("generators.acoustics.tracer.receivers.array_file:read_array")(source)
            source = record
        listed: Any = source  # a record: pydantic, which makes it, is imported by those who have one
        if hasattr(listed, "microphones"):
            self.positions = np.array([one.position for one in listed.microphones])
            self.channel_names: tuple[str, ...] = listed.channel_names
            return
        self.positions = _checked_positions(listed)
        self.channel_names = tuple(f"mic_{number}" for number in range(1, len(self.positions) + 1))

    @property
    def channels(self) -> int:
        """Number of microphones."""
        return len(self.positions)

    def response(self, arrivals: Arrivals, rotation: NDArray[np.float64], sample_rate: int) -> NDArray[np.float32]:
        """Response (microphones, m) float32 in the order of the file; see `Receiver`."""
        directions = checked(arrivals, rotation, sample_rate)
        reach = float(np.linalg.norm(self.positions, axis=1).max()) / SPEED_OF_SOUND
        samples = response_length(arrivals, sample_rate, reach)
        index = np.zeros(len(arrivals), dtype=np.int32)
        rows = np.ones((1, 1), dtype=np.float32)
        # A microphone on the side of the source hears it earlier.
        delays = [-np.sum(directions * position, axis=1) / SPEED_OF_SOUND for position in self.positions]
        ports = [ReceiverPort(delay, index, rows, ((0, 1),) * len(BANDS)) for delay in delays]
        return synthesise(arrivals, ports, grids_of_length(samples, sample_rate), samples)

    def diffuse_covariance(self, frequency: NDArray[np.floating]) -> NDArray[np.float64]:
        """See `FreeFieldReceiver`: sin(kd)/(kd) of two microphones at a distance d (Cook et al., JASA 27, 1955)."""
        apart = np.linalg.norm(self.positions[:, None] - self.positions[None], axis=-1)
        return np.asarray(np.sinc(2 * np.asarray(frequency)[:, None, None] * apart / SPEED_OF_SOUND))

    def describe(self) -> dict[str, Scalar]:
        """The settings that go into observation.json."""
        return {"receiver": "array", "microphones": self.channels}


class Omni(Array):
    """One omnidirectional microphone at the listener's position: 1/r in the free field.

    Examples:
        >>> Omni().channels
        1
    """

    def __init__(self) -> None:
        super().__init__([(0.0, 0.0, 0.0)])
        self.channel_names = ("omni",)

    def describe(self) -> dict[str, Scalar]:
        """The settings that go into the provenance of a response."""
        return {"receiver": "omni"}


def _checked_positions(source: ArrayLike) -> NDArray[np.float64]:
    expected = f"expected (microphones, 3) metres within {FARTHEST:g} m of the centre, at most {MOST_CHANNELS}"
    try:
        positions = np.array(source, dtype=np.float64)
    except (TypeError, ValueError):
        raise Avs3dError(f"array: positions {source!r:.60} are no numbers; {expected}") from None
    if positions.ndim != 2 or positions.shape[1:] != (3,) or not 1 <= len(positions) <= MOST_CHANNELS:
        raise Avs3dError(f"array: positions have shape {positions.shape}; {expected}")
    if not (np.abs(positions) <= FARTHEST).all():  # NaN too
        raise Avs3dError(f"array: positions {positions.tolist()!r:.80} are out of range; {expected}")
    return positions
