"""Arrays of omnidirectional microphones that move with the listener, from a small YAML or JSON file.

::

    microphones:
      - {name: front, position: [0.0, 0.0, -0.05]}
      - {name: right, position: [0.05, 0.0, 0.0]}

Positions are metres in the frame of the listener's head: x to the right, y up, −z ahead; the origin is the centre of
the head. There is no head in the sound field. Each arrival is a plane wave, which is exact enough for an array that is
small beside the distances to sources and walls.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ArrayRecord, MicrophoneRecord, Record, Scalar, describe
from avs3d_bench.errors import Avs3dError, excerpt
from avs3d_bench.formats.yamlfile import YamlLimits, read_yaml
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracer.receivers.synthesis import (
    ReceiverPort,
    checked,
    grids_of_length,
    response_length,
    synthesise,
)

#: Farthest microphone from the centre of the head (m): beyond, plane waves and the checks of the path say nothing.
FARTHEST = 1.0
_EXPECTED = "expected microphones: [{name: TEXT, position: [x, y, z]}, …] in metres"

_Coordinate = Annotated[float, Field(strict=True, ge=-FARTHEST, le=FARTHEST)]


class _Microphone(Record):
    """One microphone: its place in the head's frame in metres, and a name."""

    position: tuple[_Coordinate, _Coordinate, _Coordinate]
    name: Annotated[str, Field(min_length=1, max_length=60)] | None = None


class _ArrayFile(Record):
    """The file of an array."""

    microphones: Annotated[tuple[_Microphone, ...], Field(min_length=1, max_length=layout.MOST_CHANNELS)]

    @model_validator(mode="after")
    def _named_once(self) -> _ArrayFile:
        names = self.names
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"the name {twice[0]!r} is given to more than one microphone")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """One name per microphone: ``mic_1``, ``mic_2``, … where the file gives none."""
        return tuple(one.name or f"mic_{number}" for number, one in enumerate(self.microphones, 1))


def read_array(path: str | Path) -> ArrayRecord:
    """The microphones of a file.

    Raises:
        Avs3dError: one line with the file, the field, what was found and what was expected.
    """
    document, _ = read_yaml(path, YamlLimits(bytes=1_000_000, nodes=20_000))
    if not isinstance(document, dict):
        raise Avs3dError(f"{path}: is {excerpt(document)}; {_EXPECTED}")
    try:
        file = _ArrayFile.model_validate(document)
    except ValidationError as error:
        raise Avs3dError(f"{path}: {describe(error)[0]}; {_EXPECTED}") from None
    places = zip(file.names, file.microphones, strict=True)
    return ArrayRecord(microphones=tuple(MicrophoneRecord(name=name, position=one.position) for name, one in places))


class Array:
    """Omnidirectional microphones at given places.

    Args:
        source: the microphones, or the file that lists them.

    Raises:
        Avs3dError: as `read_array`.
    """

    def __init__(self, source: ArrayRecord | str | Path) -> None:
        self.record = source if isinstance(source, ArrayRecord) else read_array(source)
        self.positions = np.array([one.position for one in self.record.microphones])
        self.channel_names = self.record.channel_names

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
