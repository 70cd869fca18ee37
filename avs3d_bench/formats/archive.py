"""Zip archives from others: everything that speaks against unpacking one, found before a byte of it is written.

`announced` reads the records that close an archive, before zipfile parses the list of its members; `faults` looks at
that list. What a fault is called and whether the first one ends it all is left to the callers: submissions
(`evaluators.reading.archive`) and assets (`generators.library.archive`). APPNOTE.TXT is PKWARE's specification.
"""

from __future__ import annotations

import os
import re
import stat
import struct
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import IO, Literal

#: Faults of a whole archive.
Whole = Literal["members", "list", "total", "overlap", "total ratio"]
#: Faults of one member.
Single = Literal[
    "broken", "absolute", "separator", "elsewhere", "long path", "long name", "second name", "special", "encrypted",
    "large", "ratio", "twice",
]  # fmt: skip

#: What file systems take: bytes of a path (some room is needed for where it is unpacked to), of a name in it, folders.
MAX_PATH = 2048
MAX_NAME = 255
MAX_FOLDERS = 64
#: Bytes of the records that close an archive (APPNOTE.TXT 4.3.14 to 4.3.16).
_RECORD_BYTES, _LOCATOR_BYTES, _END_BYTES = 56, 20, 22
#: Extra field with another name for the member (APPNOTE.TXT 4.6.9): some programs unpack it under this one.
_UNICODE_PATH = 0x7075
_DRIVE = re.compile(r"^.:")


@dataclass(frozen=True)
class ZipLimits:
    """Limits that an honest archive stays below. The defaults are for one model.

    Attributes:
        members: number of members.
        total: bytes of all members, unpacked.
        member: bytes of one member, unpacked; None: as many as ``total``.
        ratio: unpacked bytes per packed byte, of the whole and of each member (text of an OBJ packs 1:10; a picture of
            one colour 1:200).
        small: a member below so many bytes may shrink as it likes.
        small_total: an archive below so many bytes, unpacked, may shrink as it likes.
        directory: bytes of the list of members. Python holds some ten times this in memory before one can be looked at.
        plain: whether names must have forward slashes alone and no ``.`` or empty part. Else a backslash counts as a
            slash, as in archives from Windows, and control characters are refused.
    """

    members: int = 2000
    total: int = 1_000_000_000
    member: int | None = None
    ratio: float = 250.0
    small: int = 1_000_000
    small_total: int = 10_000_000
    directory: int = 10 * 2**20
    plain: bool = False


@dataclass(frozen=True)
class Fault:
    """One finding.

    Attributes:
        kind: what is wrong.
        member: of which member; None: of the archive as a whole.
        found: the number or the bytes found, where there is a limit (for ratios: unpacked bytes).
        limit: the limit (for ratios: packed bytes).
    """

    kind: Whole | Single
    member: zipfile.ZipInfo | None = None
    found: int = 0
    limit: int = 0


def announced(stream: IO[bytes], limits: ZipLimits) -> Fault | None:
    """The fault of an archive whose list of members is too long to be read, by the records at its end alone.

    zipfile parses the whole list as soon as it opens an archive.
    """
    members, length = _closing_records(stream)
    if members > limits.members:
        return Fault("members", None, members, limits.members)
    if length > limits.directory:
        return Fault("list", None, length, limits.directory)
    return None


def _closing_records(stream: IO[bytes]) -> tuple[int, int]:
    """Members and bytes of the directory: the most that any of the closing records says.

    The closing record is 22 bytes and a comment of up to 65,535 (APPNOTE.TXT 4.3.16); zip64 puts its locator (4.3.15,
    20 bytes) before it, which says where the record with the large numbers begins (4.3.14, 56 bytes). Readers differ in
    which signature they take for the record when there are several, so that all of them count.
    """
    members, length = 0, 0
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


def faults(archive: zipfile.ZipFile, limits: ZipLimits) -> Iterator[Fault]:
    """Everything that speaks against unpacking an archive: a fault of the whole alone, else those of its members."""
    members = archive.infolist()
    whole = _fault_of_all(archive, members, limits)
    if whole:
        yield whole
        return
    seen: set[str] = set()
    for member in members:
        fault = _fault(member, seen, limits)
        if fault:
            yield fault


def _fault_of_all(archive: zipfile.ZipFile, members: list[zipfile.ZipInfo], limits: ZipLimits) -> Fault | None:
    if len(members) > limits.members:  # more than the end of the archive says
        return Fault("members", None, len(members), limits.members)
    unpacked, packed = sum(m.file_size for m in members), sum(m.compress_size for m in members)
    if unpacked > limits.total:
        return Fault("total", None, unpacked, limits.total)
    # What lies before the list of members is all there is: members share their bytes, or the list lies.
    if packed > archive.start_dir:
        return Fault("overlap", None, packed, archive.start_dir)
    if unpacked > limits.small_total and unpacked > limits.ratio * max(1, packed):
        return Fault("total ratio", None, unpacked, packed)
    return None


def _fault(member: zipfile.ZipInfo, seen: set[str], limits: ZipLimits) -> Fault | None:
    # zipfile cuts names at a NUL, turns backslashes on Windows and, in later versions, takes another name from an extra
    # field: the name in the archive and the one it would be written under must both do, and be the same.
    name, second = member.orig_filename, member.filename
    kind = _name_fault(name, limits)
    if kind is None and (plain_name(name) != plain_name(second) or _UNICODE_PATH in _extra_fields(member.extra)):
        kind = "second name"
    kind = kind or _name_fault(second, limits)
    if kind:
        return Fault(kind, member)
    if stat.S_IFMT(member.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
        return Fault("special", member)
    if member.flag_bits & 1:
        return Fault("encrypted", member)
    if limits.member is not None and member.file_size > limits.member:
        return Fault("large", member, member.file_size, limits.member)
    if member.file_size > limits.small and member.file_size > limits.ratio * max(1, member.compress_size):
        return Fault("ratio", member, member.file_size, member.compress_size)
    if limits.plain or not member.is_dir():
        lower = plain_name(second).lower()
        if lower in seen:
            return Fault("twice", member)
        seen.add(lower)
    return None


def plain_name(name: str) -> str:
    """The name of a member with forward slashes and no superfluous part, the same on every system."""
    return PurePosixPath(name.replace("\\", "/")).as_posix()


def _name_fault(name: str, limits: ZipLimits) -> Single | None:
    if not limits.plain:
        if not name or any(ord(letter) < 32 or letter == "\x7f" for letter in name):
            return "broken"
        name = name.replace("\\", "/")
    parts = name.removesuffix("/").split("/")
    if name.startswith("/") or _DRIVE.match(name):
        return "absolute"
    if "\\" in name or "\0" in name:
        return "separator"
    if ".." in parts or (limits.plain and ("" in parts or "." in parts)):
        return "elsewhere"
    if len(name.encode("utf-8", "surrogatepass")) > MAX_PATH or len(parts) > MAX_FOLDERS:
        return "long path"
    if any(len(part.encode("utf-8", "surrogatepass")) > MAX_NAME for part in parts):
        return "long name"
    return None


def _extra_fields(extra: bytes) -> Iterator[int]:
    """The ids of a member's extra fields."""
    at = 0
    while at + 4 <= len(extra):
        kind, length = struct.unpack_from("<HH", extra, at)
        yield kind
        at += 4 + length
