"""An observation as one tar file of samples: the output of `avs3d generate --format tar`."""

from __future__ import annotations

import os
from pathlib import Path

from avs3d_bench import files
from avs3d_bench.errors import Avs3dError
from avs3d_bench.exports import observation_tar
from avs3d_bench.provenance import provenance
from avs3d_bench.schema import ObservationRecord
from generators.observation.output import hidden_name, remove, shared_files


def tar_plan_digest(plan: str) -> str:
    """sha256 of all that the bytes of a tar depend on: the plan of the observation, and what writes the tar.

    Args:
        plan: digest of the plan.
    """
    return files.sha256_bytes(f"{plan} {provenance('tar').digest}".encode())


class TarOutput:
    """An observation as one tar file of samples: its files are in memory until it is whole.

    The tar holds what training needs: see `avs3d_bench.exports.observation_tar`. An observation costs a
    shared file system two entries of a folder (a file is made and renamed), and one for each folder that is missing.

    Args:
        place: the tar's path without its suffix.
    """

    def __init__(self, place: Path) -> None:
        self._final = observation_tar.tar_path(place)
        self._files: dict[str, bytes] = {}

    def open(self) -> None:
        """Nothing is written before `finish`."""

    def close(self) -> None:
        """Forget the files."""
        self._files.clear()

    def keeps(self, name: str) -> bool:
        """Files that become members of samples."""
        return observation_tar.is_member(name)

    def where(self, name: str) -> Path:
        """A path below the tar, for messages."""
        return self._final / name

    def put(self, name: str, data: bytes) -> None:
        """Keep the bytes."""
        self._files[name] = data

    def get(self, name: str) -> bytes:
        """The bytes."""
        return self._files[name]

    def repeat(self, name: str, copy: str) -> None:
        """Keep the same bytes twice."""
        self._files[copy] = self._files[name]

    def share(self, sibling: Path) -> dict[str, str]:
        """Read the members that siblings share from the finished tar."""
        found = observation_tar.read_tar(observation_tar.tar_path(sibling))
        shared = shared_files(found.record.files)
        for name in shared:
            self._files[name] = found.files[name]
        return shared

    def size(self, name: str) -> int:
        """Their number."""
        return len(self._files[name])

    def digest(self, name: str) -> str:
        """sha256 of the bytes."""
        return files.sha256_bytes(self._files[name])

    def finish(self, record: ObservationRecord) -> None:
        """Write the tar under a temporary name and rename it."""
        assert record.plan_sha256 is not None
        own = record.model_copy(update={"plan_sha256": tar_plan_digest(record.plan_sha256)})
        partial = hidden_name(self._final, "new")
        try:
            if not self._final.parent.is_dir():
                self._final.parent.mkdir(parents=True, exist_ok=True)
            with open(partial, "wb", buffering=0) as stream:
                observation_tar.write_tar(stream, own, self._files)
            os.replace(partial, self._final)
        except OSError as error:
            raise Avs3dError(files.os_error_line(error, self._final, "write")) from error
        finally:
            if partial.exists():
                remove(partial)
