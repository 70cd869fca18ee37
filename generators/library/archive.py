"""Checks downloaded zip archives before it unpacks them, and writes bundles with reproducible bytes."""

from __future__ import annotations

import contextlib
import io
import lzma
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files
from avs3d_bench.formats.archive import Fault, announced, faults, plain_name
from avs3d_bench.formats.archive import ZipLimits as ZipLimits

#: Exceptions of the decoders for a damaged member.
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, EOFError, OSError, ValueError, NotImplementedError,
    RuntimeError,
)  # fmt: skip
MODEL_LIMITS = ZipLimits()
#: Limits for a library of hundreds of models (an .sh3f), which is larger than one model.
LIBRARY_LIMITS = ZipLimits(members=50_000, total=4_000_000_000)


def opened(file: Path | IO[bytes], what: str, limits: ZipLimits) -> zipfile.ZipFile:
    """Open an archive if its list of members is short enough to be read.

    Raises:
        Avs3dError: if the list is too long.
        OSError: if it cannot be read.
        zipfile.BadZipFile: if it is not an archive.
    """
    with file.open("rb") if isinstance(file, Path) else contextlib.nullcontext(file) as stream:
        fault = announced(stream, limits)
    if fault:
        raise _refusal(what, fault)
    return zipfile.ZipFile(file)


def vetted(archive: zipfile.ZipFile, what: str, limits: ZipLimits = MODEL_LIMITS) -> tuple[zipfile.ZipInfo, ...]:
    """The file members of an archive whose directory has passed all checks.

    Raises:
        Avs3dError: for any of the faults of `avs3d_bench.formats.archive`; nothing is unpacked then.
    """
    for fault in faults(archive, limits):
        raise _refusal(what, fault)
    kept = tuple(member for member in archive.infolist() if not member.is_dir())
    if not kept:
        raise Avs3dError(f"{what}: refused, the archive is empty{_CURE}")
    return kept


_CURE = "; it is broken or hostile, take it from another place"


def _refusal(what: str, fault: Fault) -> Avs3dError:
    found, limit = fault.found, fault.limit
    shown = repr(fault.member.orig_filename[:80]) if fault.member else ""
    times = f"{found / max(1, limit):.0f} times"
    causes = {
        "members": f"holds {found} members (at most {limit})",
        "list": f"has a list of members of {found} bytes (at most {limit})",
        "total": f"unpacks to {found / 1e6:.0f} MB (at most {limit / 1e6:.0f} MB)",
        "overlap": f"claims {found} packed bytes and holds {limit}",
        "total ratio": f"unpacks to {times} its size",
        "broken": f"has a member with a broken name {shown}",
        "absolute": f"has a member {shown} that points outside of it",
        "separator": f"has a member {shown} with a backslash in its path",
        "elsewhere": f"has a member {shown} that points outside of it",
        "long path": f"has a member whose path is too long, {shown}",
        "long name": f"has a member whose name is too long, {shown}",
        "second name": f"has a member {shown} with a second name in an extra field",
        "special": f"has a member {shown} that is a link or a device",
        "encrypted": f"has an encrypted member {shown}",
        "large": f"has a member {shown} of {found} bytes (at most {limit})",
        "ratio": f"has a member {shown} that unpacks to {times} its size",
        "twice": f"has two members named {shown}",
    }
    return Avs3dError(f"{what}: refused, the archive {causes[fault.kind]}{_CURE}")


def read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo, what: str) -> bytes:
    """The bytes of a member, checked against the size in its entry.

    Raises:
        Avs3dError: if it is damaged.
    """
    try:
        with archive.open(member) as stream:
            data = stream.read(member.file_size + 1)
    except _DAMAGE as error:
        raise Avs3dError(f"{what}: {member.filename!r} in the archive is damaged ({error}); fetch it again") from None
    if len(data) != member.file_size:
        raise Avs3dError(
            f"{what}: {member.filename!r} in the archive has another length than its entry says; fetch it again"
        )
    return data


def read_zip(path: Path, what: str, limits: ZipLimits = MODEL_LIMITS) -> dict[str, bytes]:
    """Member name (with ``/``) → bytes of a vetted archive.

    Raises:
        Avs3dError: see `vetted` and `read_member`; or if ``path`` is not a zip archive.
    """
    try:
        with opened(path, what, limits) as archive:
            members = vetted(archive, what, limits)
            return {plain_name(m.filename): read_member(archive, m, what) for m in members}
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise Avs3dError(
            f"{what}: {path.name} is not a zip archive, or a broken one ({error}); fetch it again"
        ) from None
    except OSError as error:
        raise Avs3dError(files.os_error_line(error, path, "read")) from error


def unpack(path: Path, folder: Path, what: str, limits: ZipLimits = MODEL_LIMITS) -> tuple[Path, ...]:
    """Unpack a vetted archive below ``folder`` and return the written paths, sorted.

    Raises:
        Avs3dError: see `read_zip`.
    """
    written = []
    for name, data in sorted(read_zip(path, what, limits).items()):
        target = folder / name
        files.write_bytes(target, data)
        written.append(target)
    return tuple(written)


def bundle(members: Mapping[str, bytes]) -> bytes:
    """A zip archive whose bytes depend only on ``members``: sorted, stored, one date, no attributes.

    For assets of several files (an OBJ with its MTL and textures), so that one hash pins them all. Not compressed,
    because the bytes of a compressor may change with its version.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(members):
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.create_system = 3
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, members[name])
    return buffer.getvalue()
