"""Names of shards, and the bytes around the files of a tar archive.

Owner, group and times are 0, so that equal files give equal bytes.
"""

from __future__ import annotations

import tarfile

_BLOCK = tarfile.BLOCKSIZE


def header(name: str, size: int) -> bytes:
    """The tar header of a regular file (with a PAX header before it where the name asks for one)."""
    info = tarfile.TarInfo(name)
    info.size, info.mode, info.mtime, info.uid, info.gid = size, 0o644, 0, 0, 0
    return info.tobuf(tarfile.PAX_FORMAT, encoding="utf-8", errors="surrogateescape")


def link(name: str, target: str) -> bytes:
    """The tar header of a hard link to an earlier file of the archive."""
    info = tarfile.TarInfo(name)
    info.type, info.linkname, info.mode, info.mtime, info.uid, info.gid = tarfile.LNKTYPE, target, 0o644, 0, 0, 0
    return info.tobuf(tarfile.PAX_FORMAT, encoding="utf-8", errors="surrogateescape")


def padding(size: int) -> bytes:
    """Zeros up to the next block."""
    return bytes(-size % _BLOCK)


def pieces(name: str, data: bytes) -> tuple[bytes, bytes, bytes]:
    """The bytes of a file in an archive."""
    return header(name, len(data)), data, padding(len(data))


def closing(written: int) -> bytes:
    """The end of an archive of which ``written`` bytes have been written: zeros up to a whole record."""
    end = 2 * _BLOCK
    return bytes(end + -(written + end) % tarfile.RECORDSIZE)


def shard_name(split: str, number: int, _count: int = 0) -> str:
    """``train-000000.tar``: brace expansion (``train-{000000..000011}.tar``) finds them."""
    return f"{split}-{number:06d}.tar"
