"""The forms of a dataset that a run writes: a folder of files for each observation, or a tar file of samples.

A form says where an observation lies, whether an earlier run has made it, and what is written over all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from avs3d_bench import files, layout
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import observation_tar
from avs3d_bench.exports.observation_index import FORMAT, ObservationShardIndex, describe_shards
from avs3d_bench.exports.shards import SHARDS_JSON
from avs3d_bench.outputs import Signature
from avs3d_bench.parallel import available_cores
from avs3d_bench.provenance import Provenance
from avs3d_bench.schema import DatasetRecord, ObservationRecord
from generators.manifest import ManifestFile
from generators.observation.output import FolderOutput, ObservationOutput
from generators.observation.tar_output import TarOutput, tar_plan_digest
from generators.plan import ObservationPlan
from generators.run.dataset_record import describe_dataset, read_observation
from generators.run.differences import describe_mismatch
from generators.run.finished import find_damage


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

    def output(self, place: Path, *, replaces: bool = False) -> ObservationOutput:
        """The output of the files of an observation whose folder is, or would be, ``place``.

        Args:
            place: the folder.
            replaces: whether it takes the place of a finished observation, which stays until the new one is whole.
        """

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
    """A folder of files for each observation, and dataset.json over all: see `avs3d_bench.layout`."""

    index = layout.DATASET_JSON
    signature = Signature(keys=("name", "toolkit_version", "observations"), exactly=False)

    def name_of(self, index: Any) -> Any:
        """As the index has it."""
        return index["name"]

    def output(self, place: Path, *, replaces: bool = False) -> ObservationOutput:
        """A folder."""
        return FolderOutput(place, replaces=replaces)

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


class TarFormat:
    """A tar file of samples for each observation, and shards.json over all: see `observation_tar`."""

    index = SHARDS_JSON
    signature = Signature(values=(("format", FORMAT),), keys=("dataset",), exactly=False)

    def name_of(self, index: Any) -> Any:
        """As the dataset's record in the index has it."""
        return index["dataset"]["name"]

    def output(self, place: Path, *, replaces: bool = False) -> ObservationOutput:
        """A tar."""
        return TarOutput(place)  # a rename replaces a file

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
        if dataset is not None:
            records = [record for record, _ in found]
            with ThreadPoolExecutor(available_cores()) as pool:
                digests = pool.map(files.sha256_file, [self.path(root, record.key) for record in records])
                files.write_json(root / self.index, describe_shards(root, dataset, zip(records, digests, strict=True)))
        else:
            (root / self.index).unlink(missing_ok=True)

    def read_index(self, root: Path) -> DatasetRecord:
        """That in shards.json."""
        return files.read_record(root / self.index, ObservationShardIndex).dataset


#: Name on the command line → form.
FORMATS: dict[str, DatasetFormat] = {"folders": FolderFormat(), "tar": TarFormat()}


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


def refuse_other_form(form: DatasetFormat, root: Path, key: str) -> None:
    """Refuse an observation that was made in another form.

    Raises:
        UsageError: naming its folder or tar.
    """
    for other in FORMATS.values():
        if other is not form and other.path(root, key).exists():
            raise UsageError(
                f"{other.path(root, key)}: was generated with another --format; choose another folder with -o"
            )


def find_finished(form: DatasetFormat, root: Path, plan: ObservationPlan) -> ObservationRecord | None:
    """The record of the plan's observation below ``root``; None where it has not been made.

    Raises:
        UsageError: if it was made from another plan or by other software, or in another form.
        Avs3dError: if its record is missing or damaged.
    """
    path = form.path(root, plan.key)
    refuse_other_form(form, root, plan.key)
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
