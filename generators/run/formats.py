"""The forms of a dataset that a run writes: a folder of files for each observation, or a tar file of samples.

A form says where an observation lies, whether an earlier run has made it, and what is written over all of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Protocol

from avs3d_bench import files, layout
from avs3d_bench.errors import UsageError
from avs3d_bench.exports import observation_tar
from avs3d_bench.exports.observation_index import FORMAT, describe_shards
from avs3d_bench.exports.shards import SHARDS_JSON
from avs3d_bench.outputs import Signature
from avs3d_bench.parallel import available_cores
from avs3d_bench.provenance import Provenance
from avs3d_bench.schema import ObservationRecord
from generators.manifest import ManifestFile
from generators.plan import ObservationPlan
from generators.recording.output import FolderOutput, Output
from generators.recording.tar_output import TarOutput, tar_plan_digest
from generators.run.dataset_record import describe_dataset, read_observation
from generators.run.finished import check_plan, find_damage


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

    def output(self, place: Path) -> Output:
        """The output of the files of an observation whose folder is, or would be, ``place``."""

    def path(self, root: Path, key: str) -> Path:
        """The folder or file of an observation."""

    def plan_digest(self, plan: ObservationPlan) -> str:
        """sha256 of all that the bytes of an observation in this form depend on."""

    def read(self, root: Path, key: str) -> tuple[ObservationRecord, str]:
        """The record of a finished observation, and the sha256 of its JSON.

        Raises:
            Avs3dError: if it cannot be read.
        """

    def find_damage(self, root: Path, record: ObservationRecord) -> str:
        """What is wrong with a finished observation; empty if nothing is."""

    def seal(self, source: ManifestFile, root: Path, software: Provenance) -> None:
        """Write the index over every observation of the manifest that is there; nothing if there is none.

        Raises:
            Avs3dError: if an observation cannot be read, or the folder not be written.
        """


class FolderFormat:
    """A folder of files for each observation, and dataset.json over all: see `avs3d_bench.layout`."""

    index = layout.DATASET_JSON
    signature = Signature(keys=("name", "toolkit_version", "observations"), exactly=False)

    def name_of(self, index: Any) -> Any:
        """As the index has it."""
        return index["name"]

    def output(self, place: Path) -> Output:
        """A folder."""
        return FolderOutput(place)

    def path(self, root: Path, key: str) -> Path:
        """The folder."""
        return root / key

    def plan_digest(self, plan: ObservationPlan) -> str:
        """That of the plan: writers of files belong to it."""
        return plan.digest

    def read(self, root: Path, key: str) -> tuple[ObservationRecord, str]:
        """From observation.json."""
        record = read_observation(root / key)
        return record, files.sha256_file(root / key / layout.OBSERVATION_JSON)

    def find_damage(self, root: Path, record: ObservationRecord) -> str:
        """What is missing, or of another size: contents are not read."""
        return find_damage(root / record.key, record)

    def seal(self, source: ManifestFile, root: Path, software: Provenance) -> None:
        """Write dataset.json."""
        record = describe_dataset(source, _found(self, source, root), software)
        if record is not None:
            files.write_json(root / self.index, record)


class TarFormat:
    """A tar file of samples for each observation, and shards.json over all: see `observation_tar`."""

    index = SHARDS_JSON
    signature = Signature(values=(("format", FORMAT),), keys=("dataset",), exactly=False)

    def name_of(self, index: Any) -> Any:
        """As the dataset's record in the index has it."""
        return index["dataset"]["name"]

    def output(self, place: Path) -> Output:
        """A tar."""
        return TarOutput(place)

    def path(self, root: Path, key: str) -> Path:
        """The tar."""
        return observation_tar.tar_path(root / key)

    def plan_digest(self, plan: ObservationPlan) -> str:
        """That of the plan with what writes tars."""
        return tar_plan_digest(plan.digest)

    def read(self, root: Path, key: str) -> tuple[ObservationRecord, str]:
        """From the first member."""
        return observation_tar.read_head(self.path(root, key))

    def find_damage(self, root: Path, record: ObservationRecord) -> str:
        """Whether the tar's bytes are those of its digest."""
        return observation_tar.find_fault(self.path(root, record.key))

    def seal(self, source: ManifestFile, root: Path, software: Provenance) -> None:
        """Write shards.json."""
        found = list(_found(self, source, root))
        dataset = describe_dataset(source, found, software)
        if dataset is not None:
            records = [record for record, _ in found]
            with ThreadPoolExecutor(available_cores()) as pool:
                digests = pool.map(files.sha256_file, [self.path(root, record.key) for record in records])
                files.write_json(root / self.index, describe_shards(root, dataset, zip(records, digests, strict=True)))


#: Name on the command line → form.
FORMATS: dict[str, DatasetFormat] = {"folders": FolderFormat(), "tar": TarFormat()}


def _found(form: DatasetFormat, source: ManifestFile, root: Path) -> Iterator[tuple[ObservationRecord, str]]:
    """Record and digest of every observation of the manifest that is there, sorted by key."""
    for spec in sorted(source.manifest.observations, key=lambda spec: spec.key):
        if form.path(root, spec.key).exists():
            yield form.read(root, spec.key)


def find_finished(form: DatasetFormat, root: Path, plan: ObservationPlan) -> ObservationRecord | None:
    """The record of the plan's observation below ``root``; None where it has not been made.

    Raises:
        UsageError: if it was made from another plan or by other software, or in another form.
        Avs3dError: if its record is missing or damaged.
    """
    path = form.path(root, plan.key)
    for other in FORMATS.values():
        if other is not form and other.path(root, plan.key).exists():
            raise UsageError(
                f"{other.path(root, plan.key)}: was generated with another --format; choose another folder with -o"
            )
    if not path.exists():
        return None
    record, _ = form.read(root, plan.key)
    check_plan(path, record, plan, form.plan_digest(plan))
    return record
