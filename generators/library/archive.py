"""Zip archives from others, looked at before anything of them is unpacked; and bundles of our own with stable bytes."""

from __future__ import annotations

import io
import lzma
import stat
import struct
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from avs3d_bench import files
from avs3d_bench.errors import Avs3dError


@dataclass(frozen=True)
class ZipLimits:
    """What an honest archive of one model stays below.

    Attributes:
        members: number of members.
        total: bytes of all members, unpacked.
        ratio: unpacked bytes per packed byte, of the whole and of each member above a megabyte (text of an OBJ packs
            1:10; a picture of one colour 1:200).
    """

    members: int = 2000
    total: int = 1_000_000_000
    ratio: float = 250.0


#: What the decoders say of a damaged member.
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, EOFError, OSError, ValueError, NotImplementedError,
    RuntimeError,
)  # fmt: skip
#: A library of hundreds of models (an .sh3f) is larger than one model.
LIBRARY_LIMITS = ZipLimits(members=50_000, total=4_000_000_000)


def vetted(
    archive: zipfile.ZipFile, what: str, limits: ZipLimits = ZipLimits()
) -> tuple[zipfile.ZipInfo, ...]:  # frozen
    """The file members of an archive, after a look at all it says of itself.

    Raises:
        Avs3dError: for absolute names, ``..``, links, devices, encrypted or doubled members, absurd counts, sizes or
            ratios; nothing is unpacked then.
    """

    def refuse(cause: str) -> Avs3dError:
        return Avs3dError(f"{what}: refused, the archive {cause}; it is broken or hostile, take it from another place")

    members = archive.infolist()
    if len(members) > limits.members:
        raise refuse(f"holds {len(members)} members (at most {limits.members})")
    kept: list[zipfile.ZipInfo] = []
    seen: set[str] = set()
    total = packed = 0
    for member in members:
        # zipfile cuts names at a zero byte; what the archive really says is in orig_filename.
        name = member.orig_filename
        shown = repr(name[:80])
        if not name or any(ord(letter) < 32 or letter == "\x7f" for letter in name):
            raise refuse(f"has a member with a broken name {shown}")
        path = PurePosixPath(name.replace("\\", "/"))
        if path.is_absolute() or name[1:2] == ":" or ".." in path.parts:
            raise refuse(f"has a member {shown} that points outside of it")
        kind = stat.S_IFMT(member.external_attr >> 16)
        if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise refuse(f"has a member {shown} that is a link or a device")
        if member.is_dir():
            continue
        if member.flag_bits & 1:
            raise refuse(f"has an encrypted member {shown}")
        if path.as_posix().lower() in seen:
            raise refuse(f"has two members named {shown}")
        seen.add(path.as_posix().lower())
        if member.file_size > 1_000_000 and member.file_size > limits.ratio * max(1, member.compress_size):
            raise refuse(
                f"has a member {shown} that unpacks to {member.file_size / max(1, member.compress_size):.0f} times"
            )
        total += member.file_size
        packed += member.compress_size
        kept.append(member)
    if packed > archive.start_dir:  # what is before the directory is all there is: members overlap, or they lie
        raise refuse(f"claims {packed} packed bytes and holds {archive.start_dir}")
    if total > limits.total:
        raise refuse(f"unpacks to {total / 1e6:.0f} MB (at most {limits.total / 1e6:.0f} MB)")
    if total > 10_000_000 and total > limits.ratio * max(1, packed):
        raise refuse(f"unpacks to {total / max(1, packed):.0f} times its size (at most {limits.ratio:g})")
    if not kept:
        raise refuse("is empty")
    return tuple(kept)


def read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo, what: str) -> bytes:
    """The bytes of a member, never more than its entry says.

    Raises:
        Avs3dError: if it is damaged.
    """
    try:
        with archive.open(member) as stream:
            data = stream.read(member.file_size + 1)
    except _DAMAGE as error:
        raise Avs3dError(f"{what}: {member.filename!r} in the archive is damaged ({error}); fetch it again") from None
    if len(data) != member.file_size:
        raise Avs3dError(f"{what}: {member.filename!r} in the archive is not as long as it says; fetch it again")
    return data


def read_zip(path: Path, what: str, limits: ZipLimits = ZipLimits()) -> dict[str, bytes]:  # frozen
    """Member name (with ``/``) → bytes of a vetted archive.

    Raises:
        Avs3dError: see `vetted` and `read_member`; or if ``path`` is no zip archive.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = vetted(archive, what, limits)
            return {
                PurePosixPath(m.filename.replace("\\", "/")).as_posix(): read_member(archive, m, what) for m in members
            }
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise Avs3dError(f"{what}: {path.name} is no zip archive or a broken one ({error}); fetch it again") from None
    except OSError as error:
        raise Avs3dError(files.os_error_line(error, path, "read")) from error


def unpack(path: Path, folder: Path, what: str, limits: ZipLimits = ZipLimits()) -> tuple[Path, ...]:
    """Unpack a vetted archive below ``folder``; the paths written, sorted.

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
    """A zip archive of ``members`` whose bytes depend on nothing else: sorted, stored, one date, no attributes.

    For assets that are several files (an OBJ with its MTL and textures): one file to keep and one hash to pin. Not
    compressed, because the bytes of a compressor may change with its version.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(members):
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.create_system = 3
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, members[name])
    return buffer.getvalue()
