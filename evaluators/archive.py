"""A submission in a .zip: every member is vetted before the first is written anywhere."""

from __future__ import annotations

import re
import stat
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from avs3d_bench.errors import Avs3dError
from avs3d_bench.report import Problem

#: More than any submission needs: members, bytes of one member, bytes of all.
MAX_MEMBERS = 4_000_000
MAX_MEMBER_BYTES = 64 * 2**20
MAX_BYTES = 64 * 2**30
#: PNG and PLY files do not shrink much further; what does is a bomb.
_MAX_RATIO = 200
_SMALL = 2**20
_DRIVE = re.compile(r"^[A-Za-z]:")


def vet(archive: zipfile.ZipFile) -> Iterator[Problem]:
    """Everything that speaks against unpacking an archive, by member."""
    members = archive.infolist()
    if len(members) > MAX_MEMBERS:
        yield Problem("error", ".", f"{len(members):,} members, expected at most {MAX_MEMBERS:,}")
        return
    if sum(member.file_size for member in members) > MAX_BYTES:
        yield Problem("error", ".", f"unpacks to more than {MAX_BYTES // 2**30} GiB")
        return
    seen: set[str] = set()
    for member in members:
        message = _fault(member, seen)
        if message:
            yield Problem("error", printable(member.filename), message)


def _fault(member: zipfile.ZipInfo, seen: set[str]) -> str | None:
    # zipfile cuts names at a NUL and turns backslashes on Windows: the name as it stands in the archive counts.
    name = member.orig_filename
    parts = name.removesuffix("/").split("/")
    if name.startswith("/") or _DRIVE.match(name):
        return "an absolute path; expected one inside the archive"
    if "\\" in name or "\0" in name:
        return "a backslash or NUL in its path; expected forward slashes"
    if any(part in ("", ".", "..") for part in parts):
        return "a path that leads elsewhere ('..', '.' or '//'); expected a plain one"
    kind = stat.S_IFMT(member.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "a symlink or device; expected files and folders only"
    if member.flag_bits & 1:
        return "encrypted; expected a plain archive"
    if member.file_size > MAX_MEMBER_BYTES:
        return f"unpacks to {member.file_size:,} bytes, expected at most {MAX_MEMBER_BYTES:,}"
    if member.file_size > _SMALL and member.file_size > _MAX_RATIO * member.compress_size:
        return f"unpacks from {member.compress_size:,} to {member.file_size:,} bytes: an archive bomb"
    lower = name.lower()
    if lower in seen:
        return "stands twice in the archive (upper and lower case do not tell files apart everywhere)"
    seen.add(lower)
    return None


def unpack(archive: zipfile.ZipFile, folder: Path) -> Iterator[Problem]:
    """Write the members of a vetted archive below ``folder``; yield those that are damaged.

    Raises:
        Avs3dError: if the system refuses (disk full).
    """
    for member in archive.infolist():
        try:
            archive.extract(member, folder)
        except (zipfile.BadZipFile, NotImplementedError, EOFError, ValueError, RuntimeError) as error:
            yield Problem("error", printable(member.filename), f"damaged in the archive ({error}); pack it anew")
        except FileExistsError:
            yield Problem("error", printable(member.filename), "both a file and a folder in the archive; pack it anew")
        except NotADirectoryError:
            yield Problem("error", printable(member.filename), "lies below a file in the archive; pack it anew")
        except OSError as error:
            raise Avs3dError(f"{folder}: cannot unpack the submission there ({error.strerror})") from None
        except Exception as error:  # a damaged deflate stream raises zlib.error, lzma and bz2 their own
            yield Problem("error", printable(member.filename), f"damaged in the archive ({error}); pack it anew")


def top_folder(folder: Path) -> Path:
    """The one folder that an archive of a folder holds, else ``folder`` itself."""
    entries = [path for path in folder.iterdir() if path.name != "__MACOSX"]
    single = len(entries) == 1 and entries[0].is_dir() and not entries[0].name.startswith("part_")
    return entries[0] if single else folder


def printable(name: str) -> str:
    """A file name that can be printed in one line, whatever bytes it holds."""
    text = name.encode("utf-8", "backslashreplace").decode()
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text) or str(
        PurePosixPath(".")
    )
