"""What all records share: their base, the types of their fields, licence and provenance; and how they are read."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Literal, Self, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from avs3d_bench import __version__
from avs3d_bench.contract import layout
from avs3d_bench.contract.taxonomy import CATEGORY_PATTERN
from avs3d_bench.errors import Avs3dError
from avs3d_bench.text.printable import printable

if TYPE_CHECKING:
    from avs3d_bench.runtime.provenance import Provenance

#: Versions of the file formats: 1.1 adds part_3 and categories of one's own; files without either are still 1.0.
SCHEMA_VERSION: Final = "1.0"
PART_3_VERSION: Final = "1.1"

Part = Literal["part_1", "part_2", "part_3"]
Room = Literal["bathroom", "kitchen", "living_room"]
#: A category of the taxonomy, or one that the manifest adds (`ObservationRecord.categories`); of an instance, also one
#: that is always silent.
Category = Annotated[str, Field(pattern=CATEGORY_PATTERN)]
SourceId = Annotated[str, Field(pattern=r"^source_[1-9][0-9]*$")]
Scalar = bool | int | float | str | None
Text = Annotated[str, Field(min_length=1)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Scan = Annotated[str, Field(pattern=layout.SCAN_PATTERN)]
FrameName = Annotated[str, Field(pattern=layout.FRAME_PATTERN)]
Vector3 = tuple[float, float, float]
NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]


def _unit(q: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    norm = math.sqrt(sum(c * c for c in q))
    if abs(norm - 1.0) > 1e-4:
        raise ValueError(f"norm {norm:.6f}, expected a unit quaternion (w, x, y, z)")
    return q


def _relative(path: str) -> str:
    if not path or path.startswith("/") or "\\" in path or any(p in ("", ".", "..") for p in path.split("/")):
        raise ValueError(f"{path!r} is not a relative path with forward slashes")
    if any(ord(character) < ord(" ") for character in path):
        raise ValueError(f"{path!r} holds a control character; expected a relative path")
    return path


Quaternion = Annotated[tuple[float, float, float, float], AfterValidator(_unit)]
RelativePath = Annotated[str, AfterValidator(_relative)]


class Record(BaseModel):
    """Base of all records.

    Fields named in ``left_out`` are not written if they are None, so that files of older versions keep their bytes.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    left_out: ClassVar[frozenset[str]] = frozenset()

    def omitted(self) -> frozenset[str]:
        """The fields that are not written if they are None."""
        return self.left_out


class LicenceRecord(Record):
    """Licence, author and source of an asset."""

    name: Text = Field(description="licence: SPDX identifier if there is one")
    author: Text
    source: Text = Field(description="URL, collection and id, or 'procedural'")


class AttributionRecord(LicenceRecord):
    """One asset in the dataset, with its licence."""

    asset: Text


class ProvenanceRecord(Record):
    """The software that made a file; see `avs3d_bench.runtime.provenance`."""

    digest: Sha256 = Field(description="digest of the sources, libraries and Python on which the result depends")
    toolkit_version: Text
    python: Text = Field(description="minor version, e.g. 3.11")
    libraries: dict[str, Text] = Field(
        default_factory=dict, description="distribution → version; 'none' if not installed"
    )

    @classmethod
    def of(cls, software: Provenance) -> Self:
        """The record of what `avs3d_bench.runtime.provenance.provenance` found."""
        return cls(
            digest=software.digest,
            toolkit_version=__version__,
            python=software.python,
            libraries=dict(software.libraries),
        )


_R = TypeVar("_R", bound=Record)
#: Longest message about a finding (characters); without a limit, a wrong value may be as long as the file.
_LONGEST_LINE = 1000


def describe(error: ValidationError) -> list[str]:
    """One line per finding of pydantic: ``frames.3.rotation: …``."""
    lines = []
    for finding in error.errors(include_url=False):
        where = ".".join(str(step) for step in finding["loc"])
        message = finding["msg"].removeprefix("Value error, ")
        value = repr(finding.get("input"))
        found = f" (found {value})" if len(value) <= 60 and finding["type"] != "missing" else ""
        line = printable(f"{where}: {message}{found}" if where else f"{message}")
        lines.append(line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]}…")
    return lines


def parse_record(text: str | bytes, record: type[_R], where: str | Path, *, strict: bool = False) -> _R:
    """Parse the JSON ``text`` of the file ``where``.

    With ``strict``, true or a number in quotes is no number.

    Raises:
        Avs3dError: naming the file, the first wrong field and the number of further errors.
    """
    try:
        return record.model_validate_json(text, strict=strict)
    except ValidationError as error:
        first, *rest = describe(error)
        more = f" (and {len(rest)} more)" if rest else ""
        raise Avs3dError(f"{where}: {first}{more}; expected a {record.__name__} (see `avs3d schema`)") from None


def unique_attributions(attributions: Iterable[AttributionRecord]) -> tuple[AttributionRecord, ...]:
    """The attributions sorted by asset, without repetitions."""
    found = {(a.asset, a.name, a.author, a.source): a for a in attributions}
    return tuple(found[key] for key in sorted(found))
