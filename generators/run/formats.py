"""The forms of a dataset that a run writes: a folder of files for each observation, or tar files of samples.

A form says where an observation lies, whether an earlier run has made it, and what is written over all of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from avs3d_bench.commands.outputs import Signature
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import DatasetRecord, ObservationRecord
from avs3d_bench.contract.taxonomy import PARTS
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import observation_tar
from avs3d_bench.exports.observation_index import describe_shard, describe_shards
from avs3d_bench.exports.shards import SHARDS_JSON, ShardIndex
from avs3d_bench.formats import files
from avs3d_bench.runtime.parallel import available_cores
from avs3d_bench.runtime.provenance import Provenance
from generators.manifest.reading import ManifestFile
from generators.manifest.schema import Manifest
from generators.observation.output import FolderOutput, ObservationOutput
from generators.observation.tar_output import TarOutput, tar_plan_digest
from generators.plan import ObservationPlan
from generators.run.dataset_record import describe_dataset, read_observation
from generators.run.differences import describe_mismatch
from generators.run.finished import discard, find_damage

#: The name of a shard.
_SHARD = re.compile(r"(train|test)-[0-9]{6,}\.tar")


class DatasetFormat(Protocol):
    """A form of a dataset.

    Attributes:
        index: name of the file that is written last, over all observations.
        signature: what that file says about itself.
    """

    index: str
    signature: Signature

    def name_of(self, index: Any) -> Any:
        """The name of the dataset in an index with the signature (JSON)."""

    def owns(self, name: str) -> bool:
        """Whether a file or folder of this name in the dataset's folder belongs to a dataset of this form."""

    def limited_to(self, keys: Collection[str]) -> DatasetFormat:
        """The form as far as observations of these keys need it: it is sent to workers."""

    def output(self, root: Path, place: Path, *, replaces: bool = False) -> ObservationOutput:
        """The output of the files of an observation whose folder is, or would be, ``place``.

        Args:
            root: the dataset's folder.
            place: the folder.
            replaces: whether it takes the place of a finished observation, which stays until the new one is whole.
        """

    def path(self, root: Path, key: str) -> Path:
        """The folder or file that is there when an observation is."""

    def discard(self, root: Path, key: str) -> None:
        """Remove a damaged observation, so that it can be made again, or the rest of one that is not there.

        Raises:
            Avs3dError: if the system refuses, or a file is that of something else.
        """

    def plan_digest(self, plan: ObservationPlan) -> str:
        """sha256 of all that the bytes of an observation in this form depend on."""

    def read(self, root: Path, key: str) -> tuple[ObservationRecord, str]:
        """The record of a finished observation, and the sha256 of its JSON.

        Raises:
            Avs3dError: if it cannot be read.
        """

    def find_damage(self, root: Path, record: ObservationRecord) -> str:
        """The damage of a finished observation; empty if there is none."""

    def seal(
        self,
        source: ManifestFile,
        root: Path,
        software: Provenance,
        without: Collection[str] = frozenset(),
        see: Callable[[ObservationRecord], object] = lambda _: None,
    ) -> None:
        """Write the index over every observation of the manifest that is there; none if there is no observation.

        Args:
            source: the manifest.
            root: the dataset's folder.
            software: what made the observations.
            without: keys of observations that are there, but from another manifest or by other software.
            see: called with the record of each.

        Raises:
            Avs3dError: if an observation cannot be read, or the folder not be written.
        """

    def read_index(self, root: Path) -> DatasetRecord:
        """The dataset's record in the index.

        Raises:
            Avs3dError: if it cannot be read.
        """


class FolderFormat:
    """A folder of files for each observation, and dataset.json over all: see `avs3d_bench.contract.layout`."""

    index = layout.DATASET_JSON
    signature = Signature(keys=("name", "toolkit_version", "observations"), exactly=False)

    def name_of(self, index: Any) -> Any:
        """As the index has it."""
        return index["name"]

    def owns(self, name: str) -> bool:
        """dataset.json, and the parts."""
        return name == self.index or name in PARTS

    def limited_to(self, keys: Collection[str]) -> FolderFormat:
        """Itself."""
        return self

    def output(self, root: Path, place: Path, *, replaces: bool = False) -> ObservationOutput:
        """A folder."""
        return FolderOutput(place, replaces=replaces)

    def path(self, root: Path, key: str) -> Path:
        """The folder."""
        return root / key

    def discard(self, root: Path, key: str) -> None:
        """Remove the folder."""
        if (root / key).exists():
            discard(root / key)

    def plan_digest(self, plan: ObservationPlan) -> str:
        """That of the plan: writers of files belong to it."""
        return plan.digest

    def read(self, root: Path, key: str) -> tuple[ObservationRecord, str]:
        """From observation.json."""
        record = read_observation(root / key)
        return record, files.sha256_file(root / key / layout.OBSERVATION_JSON)

    def find_damage(self, root: Path, record: ObservationRecord) -> str:
        """The file that is missing, or has another size; contents are not read."""
        return find_damage(root / record.key, record)

    def seal(
        self,
        source: ManifestFile,
        root: Path,
        software: Provenance,
        without: Collection[str] = frozenset(),
        see: Callable[[ObservationRecord], object] = lambda _: None,
    ) -> None:
        """Write dataset.json."""
        record = describe_dataset(source, _found(self, source, root, without, see), software)
        if record is not None:
            files.write_json(root / self.index, record)
        else:
            (root / self.index).unlink(missing_ok=True)

    def read_index(self, root: Path) -> DatasetRecord:
        """dataset.json."""
        return files.read_record(root / self.index, DatasetRecord)


FOLDERS = FolderFormat()


@dataclass(frozen=True)
class WebdatasetFormat:
    """Two shards for each observation, and shards.json over all: see `observation_tar`.

    Attributes:
        numbers: key of an observation → its place in the manifest, from 0.
    """

    numbers: Mapping[str, int]
    index = SHARDS_JSON
    signature = Signature(values=(("format", "webdataset"),), keys=("generated",), exactly=False)

    def name_of(self, index: Any) -> Any:
        """As the index has it."""
        return index["dataset"]

    def owns(self, name: str) -> bool:
        """shards.json, and the shards."""
        return name == self.index or _SHARD.fullmatch(name) is not None

    def limited_to(self, keys: Collection[str]) -> WebdatasetFormat:
        """Without the numbers of other observations."""
        return WebdatasetFormat({key: self.numbers[key] for key in keys})

    def output(self, root: Path, place: Path, *, replaces: bool = False) -> ObservationOutput:
        """The shards."""
        return TarOutput(root, self.numbers, place.relative_to(root).as_posix())  # a rename replaces a file

    def path(self, root: Path, key: str) -> Path:
        """The test shard, which gets its name last."""
        return self._shards(root, key)["test"]

    def _shards(self, root: Path, key: str) -> dict[str, Path]:
        return observation_tar.observation_shards(root, self.numbers[key])

    def discard(self, root: Path, key: str) -> None:
        """Remove the shards, the test shard first: without it, the other one is the rest of an attempt."""
        shards = self._shards(root, key)
        if shards["train"].exists() and not shards["test"].exists():
            observation_tar.read_head(shards["train"])  # a file of something else is an error
        for path in reversed(shards.values()):
            if path.exists():
                discard(path)

    def plan_digest(self, plan: ObservationPlan) -> str:
        """That of the plan with what writes shards."""
        return tar_plan_digest(plan.digest)

    def read(self, root: Path, key: str) -> tuple[ObservationRecord, str]:
        """From the first member of the test shard.

        Raises:
            UsageError: if the shard is that of another observation.
        """
        path = self.path(root, key)
        record, digest = observation_tar.read_head(path)
        if record.key != key:
            raise UsageError(
                f"{path}: holds {record.key}, but {key} has this number in the manifest, which may grow at its end "
                "alone; choose another folder with -o"
            )
        return record, digest

    def find_damage(self, root: Path, record: ObservationRecord) -> str:
        """Whether the bytes of both shards are those of their digests, and both are of one attempt."""
        shards = self._shards(root, record.key)
        for split in observation_tar.count_frames(record):
            path = shards[split]
            if not path.is_file():
                return f"{path.name} is missing"
            if fault := observation_tar.find_fault(path):
                return f"{path.name} is {fault}" if fault.startswith("cut") else f"{path.name}: {fault}"
            if observation_tar.read_head(path)[0] != record:
                return f"{path.name} is of another attempt than {shards['test'].name}"
        return ""

    def seal(
        self,
        source: ManifestFile,
        root: Path,
        software: Provenance,
        without: Collection[str] = frozenset(),
        see: Callable[[ObservationRecord], object] = lambda _: None,
    ) -> None:
        """Write shards.json."""
        found = list(_found(self, source, root, without, see))
        dataset = describe_dataset(source, found, software)
        if dataset is None:
            (root / self.index).unlink(missing_ok=True)
            return
        shards = [
            (split, self._shards(root, record.key)[split], record)
            for split in observation_tar.SPLITS
            for record, _ in sorted(found, key=lambda pair: self.numbers[pair[0].key])
            if split in observation_tar.count_frames(record)
        ]
        with ThreadPoolExecutor(available_cores()) as pool:
            digests = pool.map(files.sha256_file, [path for _, path, _ in shards])
            described = (describe_shard(*one, digest) for one, digest in zip(shards, digests, strict=True))
            files.write_json(root / self.index, describe_shards(dataset, [record for record, _ in found], described))

    def read_index(self, root: Path) -> DatasetRecord:
        """That in shards.json."""
        found = files.read_record(root / self.index, ShardIndex).generated
        if found is None:
            raise Avs3dError(f"{root / self.index}: the index of an export, not of `avs3d generate`")
        return found


#: Names on the command line → forms of the dataset of a manifest.
FORMATS: dict[str, Callable[[Manifest], DatasetFormat]] = {
    "folders": lambda _: FOLDERS,
    "webdataset": lambda manifest: WebdatasetFormat(
        {spec.key: number for number, spec in enumerate(manifest.observations)}
    ),
}


def _found(
    form: DatasetFormat,
    source: ManifestFile,
    root: Path,
    without: Collection[str],
    see: Callable[[ObservationRecord], object],
) -> Iterator[tuple[ObservationRecord, str]]:
    """Record and digest of every observation of the manifest that is there, sorted by key."""
    for spec in sorted(source.manifest.observations, key=lambda spec: spec.key):
        if spec.key not in without and form.path(root, spec.key).exists():
            record, digest = form.read(root, spec.key)
            see(record)
            yield record, digest


def find_finished(form: DatasetFormat, root: Path, plan: ObservationPlan) -> ObservationRecord | None:
    """The record of the plan's observation below ``root``; None where it has not been made.

    Raises:
        UsageError: if it was made from another plan or by other software.
        Avs3dError: if its record is missing or damaged.
    """
    path = form.path(root, plan.key)
    if not path.exists():
        return None
    record, _ = form.read(root, plan.key)
    if record.plan_sha256 != form.plan_digest(plan):
        raise UsageError(f"{path}: {describe_mismatch(plan, record, partial(form.read_index, root))}")
    return record


def is_of_plan(form: DatasetFormat, root: Path, plan: ObservationPlan) -> bool:
    """Whether the observation that is there, if there is one, is what the plan would make."""
    try:
        return form.read(root, plan.key)[0].plan_sha256 == form.plan_digest(plan)
    except Avs3dError:
        return False
