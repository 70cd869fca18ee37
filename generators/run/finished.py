"""Observations of an earlier run: are they whole?"""

from __future__ import annotations

import stat
from pathlib import Path

from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files
from generators.observation.output import hidden_name, remove


def find_damage(folder: Path, record: ObservationRecord) -> str:
    """The file that is missing in a finished observation, or has another size than recorded; empty if there is none.

    Contents are not read: `avs3d validate --deep` compares hashes. Records of older versions have no sizes; of their
    files only existence is checked, and that they are not empty.
    """
    wrong = []
    for name in sorted(record.files):
        expected = None if record.sizes is None else record.sizes[name]
        try:
            found = (folder / name).stat()
        except OSError as error:
            wrong.append(f"{name} is missing" if isinstance(error, FileNotFoundError) else f"{name}: {error.strerror}")
            continue
        if not stat.S_ISREG(found.st_mode):
            wrong.append(f"{name} is no regular file")
        elif expected is not None and found.st_size != expected:
            wrong.append(f"{name} has {found.st_size:,} bytes, expected {expected:,}")
        elif expected is None and not found.st_size:
            wrong.append(f"{name} is empty")
    more = f" (and {len(wrong) - 1} more files)" if len(wrong) > 1 else ""
    return wrong[0] + more if wrong else ""


def discard(path: Path) -> None:
    """Remove a damaged observation, so that it can be regenerated.

    It is renamed first: a folder that is half gone never has an observation's name.

    Raises:
        Avs3dError: if the system refuses.
    """
    doomed = hidden_name(path, "damaged")
    try:
        path.rename(doomed)
    except OSError as error:
        raise Avs3dError(files.os_error_line(error, path, "remove")) from error
    remove(doomed)
