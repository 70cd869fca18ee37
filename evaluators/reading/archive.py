"""A submission in a .zip: every member is vetted before the first is written anywhere."""

from __future__ import annotations

import os
import re
import shutil
import stat
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.report import Problem
from avs3d_bench.report import printable as printable

#: More than any submission needs (3,000 observations have 45,000 masks): members, bytes of one member, bytes of all.
MAX_MEMBERS = 50_000
MAX_MEMBER_BYTES = 64 * 2**20
MAX_BYTES = 64 * 2**30
#: Bytes of the list of members: 200 each. Python holds some ten times this in memory before one can be looked at.
MAX_DIRECTORY_BYTES = 10 * 2**20
#: Bytes of the records that close an archive (APPNOTE.TXT 4.3.14 to 4.3.16).
_RECORD_BYTES, _LOCATOR_BYTES, _END_BYTES = 56, 20, 22
_ALONE = "pack the submission alone, or name its folder"
#: Extra field with another name for the member (APPNOTE.TXT 4.6.9): some programs unpack it under this one.
_UNICODE_PATH = 0x7075
#: PNG and PLY files do not shrink much further; what does is a bomb.
_MAX_RATIO = 200
_SMALL = 2**20
#: Below this an archive as a whole may shrink as it likes.
_SMALL_ARCHIVE = 256 * 2**20
#: What file systems take: bytes of a path (some room is needed for where it is unpacked to) and of a name in it.
_MAX_NAME = 2048
_MAX_PART = 255
_DEEPEST = 64
_DRIVE = re.compile(r"^[A-Za-z]:")


def check_directory(path: Path) -> None:
    """Refuse an archive whose directory, the list of its members at its end, is too long to be read.

    Only the records that close the archive are looked at; zipfile parses the whole list as soon as it opens one.

    Raises:
        UsageError: naming the number of members or the size found.
    """
    members, length = _announced(path)
    if members > MAX_MEMBERS:
        raise UsageError(f"{path}: {members:,} members, expected at most {MAX_MEMBERS:,}; {_ALONE}")
    if length > MAX_DIRECTORY_BYTES:
        raise UsageError(
            f"{path}: a list of members of {length:,} bytes, expected at most {MAX_DIRECTORY_BYTES:,}; {_ALONE}"
        )


def _announced(path: Path) -> tuple[int, int]:
    """Members and bytes of the directory: the most that any of the closing records says.

    The closing record is 22 bytes and a comment of up to 65,535 (APPNOTE.TXT 4.3.16); zip64 puts its locator (4.3.15,
    20 bytes) before it, which says where the record with the large numbers begins (4.3.14, 56 bytes). Readers differ in
    which signature they take for the record when there are several, so that all of them count.
    """
    members, length = 0, 0
    with path.open("rb") as stream:
        size = stream.seek(0, os.SEEK_END)
        start = max(0, size - _END_BYTES - 65_535 - _LOCATOR_BYTES)
        stream.seek(start)
        tail = stream.read()
        at = tail.find(b"PK\5\6")
        while 0 <= at <= len(tail) - _END_BYTES:
            *counts, said = struct.unpack_from("<HHI", tail, at + 8)
            # All bits set: zip64 has the number.
            members = max(members, *(0 if count == 2**16 - 1 else count for count in counts))
            length = max(length, 0 if said == 2**32 - 1 else said)
            if at >= _LOCATOR_BYTES and tail.startswith(b"PK\6\7", at - _LOCATOR_BYTES):
                (where,) = struct.unpack_from("<Q", tail, at - _LOCATOR_BYTES + 8)
                # Something may stand before the archive, as in one that unpacks itself; zipfile looks here then.
                for place in (where, start + at - _LOCATOR_BYTES - _RECORD_BYTES):
                    stream.seek(min(max(place, 0), size))
                    record = stream.read(_RECORD_BYTES)
                    if len(record) == _RECORD_BYTES and record.startswith(b"PK\6\6"):
                        members = max(members, *struct.unpack_from("<QQ", record, 24))
                        length = max(length, *struct.unpack_from("<Q", record, 40))
            at = tail.find(b"PK\5\6", at + 1)
    return members, length


def vet(archive: zipfile.ZipFile) -> Iterator[Problem]:
    """Everything that speaks against unpacking an archive, by member."""
    members = archive.infolist()
    if len(members) > MAX_MEMBERS:  # more than its end says
        yield Problem("error", ".", f"{len(members):,} members, expected at most {MAX_MEMBERS:,}")
        return
    unpacked = sum(member.file_size for member in members)
    if unpacked > MAX_BYTES:
        yield Problem("error", ".", f"unpacks to more than {MAX_BYTES // 2**30} GiB")
        return
    packed = os.stat(archive.filename).st_size if archive.filename else 0
    # Members may share their bytes, so that what counts is the archive's own size.
    if unpacked > _SMALL_ARCHIVE and unpacked > _MAX_RATIO * packed:
        yield Problem("error", ".", f"unpacks from {packed:,} to {unpacked:,} bytes: an archive bomb")
        return
    seen: set[str] = set()
    for member in members:
        message = _fault(member, seen)
        if message:
            yield Problem("error", printable(member.filename), message)


def _fault(member: zipfile.ZipInfo, seen: set[str]) -> str | None:
    # zipfile cuts names at a NUL, turns backslashes on Windows and, in later versions, takes another name from an extra
    # field: the name in the archive and the one it would be written under must both do, and be the same.
    name = member.orig_filename
    fault = _name_fault(name) or _name_fault(member.filename)
    if fault:
        return fault
    if name != member.filename or _UNICODE_PATH in _extra_fields(member.extra):
        return "has a second name in an extra field; pack it anew, with plain names"
    kind = stat.S_IFMT(member.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "a symlink or device; expected files and folders only"
    if member.flag_bits & 1:
        return "encrypted; expected a plain archive"
    if member.file_size > MAX_MEMBER_BYTES:
        return f"unpacks to {member.file_size:,} bytes, expected at most {MAX_MEMBER_BYTES:,}"
    if member.file_size > _SMALL and member.file_size > _MAX_RATIO * member.compress_size:
        return f"unpacks from {member.compress_size:,} to {member.file_size:,} bytes: an archive bomb"
    lower = member.filename.removesuffix("/").lower()
    if lower in seen:
        return "stands twice in the archive (upper and lower case do not tell files apart everywhere)"
    seen.add(lower)
    return None


def _extra_fields(extra: bytes) -> Iterator[int]:
    """The ids of a member's extra fields."""
    at = 0
    while at + 4 <= len(extra):
        kind, length = struct.unpack_from("<HH", extra, at)
        yield kind
        at += 4 + length


def _name_fault(name: str) -> str | None:
    parts = name.removesuffix("/").split("/")
    if name.startswith("/") or _DRIVE.match(name):
        return "an absolute path; expected one inside the archive"
    if "\\" in name or "\0" in name:
        return "a backslash or NUL in its path; expected forward slashes"
    if any(part in ("", ".", "..") for part in parts):
        return "a path that leads elsewhere ('..', '.' or '//'); expected a plain one"
    if len(name.encode("utf-8", "surrogatepass")) > _MAX_NAME or len(parts) > _DEEPEST:
        return f"a path of more than {_MAX_NAME} bytes or {_DEEPEST} folders; expected a mask's"
    if any(len(part.encode("utf-8", "surrogatepass")) > _MAX_PART for part in parts):
        return f"a name of more than {_MAX_PART} bytes; expected a mask's"
    return None


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
