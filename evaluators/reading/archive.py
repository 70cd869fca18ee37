"""A submission in a .zip: every member is vetted (`formats.archive`) before the first is written."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path

from avs3d_bench.commands.report import Problem
from avs3d_bench.commands.report import printable as printable
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.archive import MAX_FOLDERS, MAX_NAME, MAX_PATH, Fault, ZipLimits, announced, faults

#: More than any submission needs: 3,000 observations have 45,000 masks, and the list of members takes 200 bytes each.
#: PNG and PLY files do not shrink much further than 1:200.
LIMITS = ZipLimits(
    members=50_000,
    total=64 * 2**30,
    member=64 * 2**20,
    ratio=200.0,
    small=2**20,
    small_total=256 * 2**20,
    directory=10 * 2**20,
    plain=True,
)
_ALONE = "pack the submission alone, or name its folder"
#: Kind of a fault → what the report says; {found} and {limit} as in `Fault`.
_MESSAGES = {
    "members": "{found:,} members, expected at most {limit:,}",
    "list": "a list of members of {found:,} bytes, expected at most {limit:,}",
    "total": "unpacks to {found:,} bytes, expected at most {limit:,}",
    "overlap": "holds {limit:,} packed bytes and claims {found:,}: an archive bomb, or damaged",
    "total ratio": "unpacks from {limit:,} to {found:,} bytes: an archive bomb",
    "absolute": "an absolute path; expected one inside the archive",
    "separator": "a backslash or NUL in its path; expected forward slashes",
    "elsewhere": "a path that leads elsewhere ('..', '.' or '//'); expected a plain one",
    "long path": f"a path of more than {MAX_PATH} bytes or {MAX_FOLDERS} folders; expected a mask's",
    "long name": f"a name of more than {MAX_NAME} bytes; expected a mask's",
    "second name": "has a second name in an extra field; pack it again, with plain names",
    "special": "a symlink or device; expected files and folders only",
    "encrypted": "encrypted; expected a plain archive",
    "large": "unpacks to {found:,} bytes, expected at most {limit:,}",
    "ratio": "unpacks from {limit:,} to {found:,} bytes: an archive bomb",
    "twice": "is listed twice in the archive (upper and lower case do not tell files apart everywhere)",
}


def check_directory(path: Path) -> None:
    """Refuse an archive whose directory, the list of its members at its end, is too long to be read.

    Raises:
        UsageError: naming the number of members or the size found.
    """
    with path.open("rb") as stream:
        fault = announced(stream, LIMITS)
    if fault:
        raise UsageError(f"{path}: {_message(fault)}; {_ALONE}")


def vet(archive: zipfile.ZipFile) -> Iterator[Problem]:
    """Everything that speaks against unpacking an archive, by member."""
    for fault in faults(archive, LIMITS):
        yield Problem("error", printable(fault.member.orig_filename) if fault.member else ".", _message(fault))


def _message(fault: Fault) -> str:
    return _MESSAGES[fault.kind].format(found=fault.found, limit=fault.limit)


def unpack(archive: zipfile.ZipFile, folder: Path) -> Iterator[Problem]:
    """Write the members of a vetted archive below ``folder``; yield those that are damaged.

    Raises:
        Avs3dError: if there is no room, or the system refuses.
    """
    needed, free = sum(member.file_size for member in archive.infolist()), shutil.disk_usage(folder).free
    if needed > free:
        raise Avs3dError(
            f"{folder}: {free:,} bytes free, the submission unpacks to {needed:,}; free some space or set TMPDIR"
        )
    for member in archive.infolist():
        try:
            archive.extract(member, folder)
        except (zipfile.BadZipFile, NotImplementedError, EOFError, ValueError, RuntimeError) as error:
            yield Problem("error", printable(member.filename), f"damaged in the archive ({error}); pack it again")
        except FileExistsError:
            yield Problem("error", printable(member.filename), "both a file and a folder in the archive; pack it again")
        except NotADirectoryError:
            yield Problem("error", printable(member.filename), "lies below a file in the archive; pack it again")
        except OSError as error:
            raise Avs3dError(f"{folder}: cannot unpack the submission there ({error.strerror})") from None
        except Exception as error:  # a damaged deflate stream raises zlib.error, lzma and bz2 their own
            yield Problem("error", printable(member.filename), f"damaged in the archive ({error}); pack it again")


def top_folder(folder: Path) -> Path:
    """The one folder that an archive of a folder holds, else ``folder`` itself."""
    entries = [path for path in folder.iterdir() if path.name != "__MACOSX"]
    single = len(entries) == 1 and entries[0].is_dir() and not entries[0].name.startswith("part_")
    return entries[0] if single else folder
