"""`avs3d export acoustics`: what an export of impulse responses holds, and how it is read.

    acoustics.json                  this record; it is written last
    responses.csv                   a row per response: where it is, positions, splits, T60, T30, EDT, C50
    HOME/mesh.ply, materials.json   what sound meets: triangles (metres, Y up), the material of each
    HOME/ROOM/MATERIAL/rir-*.tar    WebDataset shards: NUMBER.npy (channels, n) float32 and NUMBER.json
    HOME/ROOM/pictures/*.png, transforms.json    pictures with their cameras, as NeRF tools read them

Response number s · L + l of a room is that from its source s to its listener l, of L listeners. The generator makes the
responses (`generators.responses`); it is found through an entry point, and this module needs the core install only.
"""

from __future__ import annotations

import io
import tarfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from avs3d_bench.contract.schema import AttributionRecord, Record, RelativePath, Sha256, Text, Vector3
from avs3d_bench.errors import Avs3dError, UsageError, did_you_mean, excerpt
from avs3d_bench.formats.files import open_regular, read_record
from avs3d_bench.runtime.imports import needing

ACOUSTICS_JSON, RESPONSES_CSV = "acoustics.json", "responses.csv"
#: Entry points that write an export: called with (source, folder, settings), they give its record.
GROUP = "avs3d.acoustics"
Receiver = Literal["omni", "binaural", "foa"]
RECEIVERS: tuple[Receiver, ...] = ("omni", "binaural", "foa")
SplitBy = Literal["position", "home", "material"]
SPLITS_BY: tuple[SplitBy, ...] = ("position", "home", "material")
ResponseSplit = Literal["train", "test"]
_INSTALL = "pip install 'avs3d-bench[generate]'"


@dataclass(frozen=True, kw_only=True)
class AcousticsSettings:
    """What is exported.

    Attributes:
        only: shell patterns of observation keys, whose rooms are taken; none: all rooms of the manifest.
        spacing: distance of the listeners on the grid (m).
        sources: sources in each room.
        absorption: factors of every material's Eyring exponent; each makes a room of other materials.
        receiver: one omnidirectional microphone, two ears (a spherical head) or first-order ambisonics (ACN, SN3D).
        sample_rate: Hz.
        pictures: pictures in each room.
        size: their side (pixels).
        device: what traces: ``cpu`` or ``cuda``.
        manifest: the manifest's file, if a dataset's manifest names files beside it.
        workers: processes; None: one per core.
        progress: show bars on stderr.
    """

    only: tuple[str, ...] = ()
    spacing: float = 0.5
    sources: int = 4
    absorption: tuple[float, ...] = (1.0, 2.0)
    receiver: Receiver = "omni"
    sample_rate: int = 16_000
    pictures: int = 12
    size: int = 512
    device: Literal["cpu", "cuda"] = "cpu"
    manifest: Path | None = None
    workers: int | None = None
    progress: bool = False

    def check(self) -> None:
        """Refuse what no export could be.

        Raises:
            UsageError: naming the option.
        """
        ranges = {"spacing": (0.1, 10.0), "sources": (1, 1000), "sample-rate": (8000, 192_000),
                  "pictures": (0, 10_000), "size": (16, 4096)}  # fmt: skip
        for name, (low, high) in ranges.items():
            value = getattr(self, name.replace("-", "_"))
            if not low <= value <= high:
                raise UsageError(f"--{name} {value:g}: expected {low:g} to {high:g}")
        if len(set(self.absorption)) < len(self.absorption) or not self.absorption:
            raise UsageError(f"--absorption {excerpt(self.absorption)}: expected different factors, at least one")
        for scale in self.absorption:
            if not 0.05 <= scale <= 20:
                raise UsageError(f"--absorption {scale:g}: expected 0.05 to 20")


class AcousticSpace(Record):
    """A room with its materials: responses from each source to each listener."""

    home: Text
    room: Text
    material: Text
    absorption: float = Field(description="factor of every material's Eyring exponent; 1: as built")
    sources: tuple[Vector3, ...]
    listeners: tuple[Vector3, ...]
    headings: tuple[float, ...] = Field(description="of the listeners, degrees to the left of −Z; of two ears, else 0")
    test_listeners: tuple[int, ...] = Field(description="listeners whose responses are for testing, by position")
    home_split: ResponseSplit
    material_split: ResponseSplit
    shards: tuple[RelativePath, ...]
    pictures: RelativePath | None = Field(description="folder of the pictures")

    def split(self, by: SplitBy, listener: int) -> ResponseSplit:
        """The split of the responses at a listener."""
        if by == "position":
            return "test" if listener in self.test_listeners else "train"
        return self.home_split if by == "home" else self.material_split


class ResponsesRecord(Record):
    """`acoustics.json`."""

    format: Literal["avs3d acoustics 1.0"] = "avs3d acoustics 1.0"
    dataset: Text
    version: Text
    toolkit_version: Text
    manifest_sha256: Sha256
    sample_rate: Annotated[int, Field(gt=0)]
    channels: tuple[Text, ...]
    engine: dict[str, bool | int | float | str | None]
    attributions: tuple[AttributionRecord, ...]
    meshes: dict[str, RelativePath] = Field(description="home → its mesh")
    spaces: tuple[AcousticSpace, ...]

    @property
    def count(self) -> int:
        """Number of responses."""
        return sum(len(space.sources) * len(space.listeners) for space in self.spaces)


class AcousticResponse(NamedTuple):
    """One response.

    Attributes:
        samples: (channels, n) float32; amplitude 1 at 1 m in the free field, time 0 is the emission.
        source: (3,) metres.
        listener: (3,) metres.
        space: the room.
    """

    samples: NDArray[np.float32]
    source: NDArray[np.float64]
    listener: NDArray[np.float64]
    space: AcousticSpace


def write_acoustics(source: Path, folder: Path, settings: AcousticsSettings) -> ResponsesRecord:
    """Export the rooms of a dataset or of a manifest; see `generators.responses.write`.

    Raises:
        UsageError: if the generator is not installed.
    """
    for point in metadata.entry_points(group=GROUP):
        with needing("avs3d export acoustics", _INSTALL, kind=UsageError):
            writer: Callable[[Path, Path, AcousticsSettings], ResponsesRecord] = point.load()
        return writer(source, folder, settings)
    raise UsageError(f"avs3d export acoustics needs the generator: {_INSTALL}")


def read_acoustics(folder: str | Path) -> ResponsesRecord:
    """The record of an export.

    Raises:
        UsageError: if there is none.
        Avs3dError: if it is damaged.
    """
    path = Path(folder) / ACOUSTICS_JSON
    if not path.exists():
        raise UsageError(f"{path}: missing; expected a folder that `avs3d export acoustics` wrote")
    return read_record(path, ResponsesRecord)


def read_responses(
    folder: str | Path, split: ResponseSplit | None = None, by: SplitBy = "position"
) -> Iterator[AcousticResponse]:
    """The responses of an export in order, one in memory at a time; any WebDataset reader can read the tars, too.

    Args:
        folder: of the export.
        split: ``train`` or ``test``; None: both.
        by: what the split holds out: positions of listeners, homes, or materials.

    Raises:
        UsageError: if there is no export, or no such split.
        Avs3dError: if a shard is missing or damaged.
    """
    for name, value, known in (("split", split, ("train", "test", None)), ("by", by, SPLITS_BY)):
        if value not in known:
            raise UsageError(f"{name}: {excerpt(value)}, expected {known}{did_you_mean(str(value), map(str, known))}")
    for space in read_acoustics(folder).spaces:
        count = len(space.listeners)
        for number, samples in _arrays(Path(folder), space):
            listener = number % count
            if split in (None, space.split(by, listener)):
                source = np.asarray(space.sources[number // count])
                yield AcousticResponse(samples, source, np.asarray(space.listeners[listener]), space)


def _arrays(folder: Path, space: AcousticSpace) -> Iterator[tuple[int, NDArray[np.float32]]]:
    expected = len(space.sources) * len(space.listeners)
    found = 0
    for name in space.shards:
        with open_regular(folder / name) as stream:
            try:
                with tarfile.open(fileobj=stream, mode="r:") as archive:
                    for info in archive:
                        data = archive.extractfile(info)
                        if info.name.endswith(".npy") and data is not None:
                            number = int(info.name.removesuffix(".npy"))
                            if not 0 <= number < expected:
                                raise ValueError(f"response {number} of {expected:,}")
                            yield number, np.load(io.BytesIO(data.read()), allow_pickle=False)
                            found += 1
            except (tarfile.TarError, ValueError) as error:
                raise Avs3dError(f"{folder / name}: cannot be read as a shard ({error}); export again") from None
    if found != expected:
        raise Avs3dError(f"{folder / space.shards[0]}: {found:,} responses, expected {expected:,}; export again")


def describe(record: ResponsesRecord) -> str:
    """Counts of responses by split, for the terminal."""
    lines = []
    for by in SPLITS_BY:
        tests = sum(
            len(space.sources) * sum(space.split(by, number) == "test" for number in range(len(space.listeners)))
            for space in record.spaces
        )
        lines.append(f"by {by}: {record.count - tests:,} train, {tests:,} test")
    return "\n".join(lines)
