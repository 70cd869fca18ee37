"""Files that list the microphones of an array, YAML or JSON.

::

    microphones:
      - {name: front, position: [0.0, 0.0, -0.05]}
      - {name: right, position: [0.05, 0.0, 0.0]}
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError, model_validator

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ArrayRecord, MicrophoneRecord, Record, describe
from avs3d_bench.errors import Avs3dError, excerpt
from avs3d_bench.formats.yamlfile import YamlLimits, read_yaml
from generators.acoustics.tracer.receivers.microphones import FARTHEST

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
