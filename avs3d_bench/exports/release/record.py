"""`release.json`: what a release consists of, and the names of its files."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from avs3d_bench.contract.schema import AttributionRecord, Record, Sha256, Text

RELEASE_JSON = "release.json"
#: Lines ``FILE sha256:…``, as `pooch.Pooch.load_registry` reads them.
REGISTRY = "registry.txt"
#: Lines ``sha256  FILE``, as ``sha256sum -c`` reads them.
SUMS = "SHA256SUMS"
README, LICENCES, CROISSANT = "README.md", "LICENCES.md", "croissant.json"
#: Stands where the DOI goes until there is one.
NO_DOI = "10.5281/zenodo.XXXXXXX (a placeholder: none has been assigned yet)"
#: Most bytes of an archive, unless another limit is asked for: hosts and old file systems take 2 GB.
ARCHIVE_MB = 2000.0

#: Name of a file of a release. It is a part of an address and of a path, so that it has no character with a meaning.
FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,199}$")]
ArchiveName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,199}\.tar$")]
Size = Annotated[int, Field(ge=0)]


class ReleaseArchive(Record):
    """One tar file."""

    file: ArchiveName
    bytes: Size
    sha256: Sha256
    unpacked: Size = Field(description="bytes of its files; one that occurs several times counts once")
    files: Size = Field(description="members, hard links included")
    first: Text = Field(description="first member")
    last: Text = Field(description="last member")


class ReleaseRecord(Record):
    """`release.json`; it is written last, and whoever has its sha256 can check all the rest."""

    format: Literal["avs3d release 1.0"] = "avs3d release 1.0"
    name: FileName = Field(description="name of the dataset, as a name of a file")
    dataset: Text
    version: Text
    toolkit_version: Text
    dataset_sha256: Sha256 = Field(description="sha256 of dataset.json")
    observations: Size
    licence: Text
    attributions: tuple[AttributionRecord, ...]
    doi: Text | None
    archives: Annotated[tuple[ReleaseArchive, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _check(self) -> Self:
        names = [archive.file for archive in self.archives]
        if len({name.lower() for name in names}) < len(names):
            raise ValueError("an archive is listed twice")
        return self

    @property
    def bytes(self) -> int:
        """Bytes of all archives."""
        return sum(archive.bytes for archive in self.archives)

    @property
    def unpacked(self) -> int:
        """Bytes of all archives, unpacked."""
        return sum(archive.unpacked for archive in self.archives)
