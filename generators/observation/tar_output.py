"""An observation as two tar files of samples: the output of `avs3d generate --format webdataset`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.errors import Avs3dError
from avs3d_bench.exports import observation_tar
from avs3d_bench.formats import files
from avs3d_bench.runtime.provenance import provenance
from generators.observation.output import MemoryOutput, hidden_name, remove, shared_files


def tar_plan_digest(plan: str) -> str:
    """sha256 of all that the bytes of shards depend on: the plan of the observation, and what writes the shards.

    Args:
        plan: digest of the plan.
    """
    return files.sha256_bytes(f"{plan} {provenance('tar').digest}".encode())


class TarOutput(MemoryOutput):
    """An observation as a shard of train and one of test frames: its files are in memory until it is whole.

    The shards hold what training needs: see `avs3d_bench.exports.observation_tar`. An observation costs a shared file
    system four entries of a folder (two files are made and renamed).

    Args:
        root: the dataset's folder.
        numbers: by key, that of the observation and of its sibling.
        key: of the observation.
    """

    def __init__(self, root: Path, numbers: Mapping[str, int], key: str) -> None:
        super().__init__()
        self._root, self._numbers = root, numbers
        self._final = observation_tar.observation_shards(root, numbers[key])

    def keeps(self, name: str) -> bool:
        """Files that become members of samples."""
        return observation_tar.is_member(name)

    def where(self, name: str) -> Path:
        """A path below the test shard, for messages."""
        return self._final["test"] / name

    def share(self, sibling: Path) -> dict[str, str]:
        """Read the members that siblings share from the finished shards."""
        number = self._numbers[sibling.relative_to(self._root).as_posix()]
        paths = observation_tar.observation_shards(self._root, number)
        record, _ = observation_tar.read_head(paths["test"])
        shared = shared_files(record.files)
        for split in observation_tar.count_frames(record):
            found = observation_tar.read_tar(paths[split]).files
            self._files |= {name: found[name] for name in shared.keys() & found.keys()}
        return shared

    def finish(self, record: ObservationRecord) -> None:
        """Write the shards under temporary names and rename them, the test shard last: see `observation_tar.SPLITS`."""
        assert record.plan_sha256 is not None
        own = record.model_copy(update={"plan_sha256": tar_plan_digest(record.plan_sha256)})
        chosen = {split: self._final[split] for split in observation_tar.count_frames(own)}
        partial = {split: hidden_name(final, "new") for split, final in chosen.items()}
        try:
            for split, path in partial.items():
                with open(path, "wb", buffering=0) as stream:
                    observation_tar.write_tar(stream, own, split, self._files)
            for split, path in partial.items():
                os.replace(path, chosen[split])
            for split in self._final.keys() - chosen.keys():
                self._final[split].unlink(missing_ok=True)
        except OSError as error:
            raise Avs3dError(files.os_error_line(error, self._final["test"], "write")) from error
        finally:
            for path in partial.values():
                if path.exists():
                    remove(path)
