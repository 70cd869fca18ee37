"""Downloads a file: resumed after an interruption, with limits and a hash; only a complete file gets its final name.

RFC 9110: Range and If-Range (§14.2, §13.1.5: strong validators only). A file grows as ``<name>.part``; beside it,
``<name>.part.json`` holds the validator that decides whether a later run may continue it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import requests

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files
from avs3d_bench.runtime.file_lock import open_locked
from generators.library.http import (
    MEGABYTE,
    CutError,
    FetchLimits,
    HttpError,
    Request,
    Say,
    attempts,
    content_length,
    interrupted,
    open_answer,
    read_block,
)

__all__ = ["Delivered", "download"]

#: Number of attempts to lock a part file that another process renames or deletes.
_TRIES = 100


@dataclass(frozen=True)
class Delivered:
    """A completely downloaded file: its sha256 and size (bytes)."""

    sha256: str
    bytes: int


def download(
    request: Request,
    target: Path,
    limits: FetchLimits,
    *,
    sha256: str | None = None,
    size: int | None = None,
    say: Say = lambda _: None,
    progress: Callable[[int, int | None], None] = lambda _done, _total: None,
) -> Delivered:
    """Fetch a file to ``target``; it gets that name only when it is complete and its hash is right.

    Args:
        request: the address and the texts for messages.
        target: final path; its folder is made.
        limits: limits of time and size.
        sha256: expected hash, if it is known.
        size: expected size in bytes, if it is known.
        say: called with a line per pause or new attempt.
        progress: called with the number of bytes so far and, if known, the total.

    Raises:
        HttpError: for a refusal.
        CutError: if the connection failed more often than `FetchLimits.attempts`; the part file is kept, and the next
            call continues it.
        Avs3dError: for a wrong hash or size, a file that is too large, a second process at the same file, a full disk.
    """
    if size is not None and size > limits.max_bytes:
        raise _too_large(request, size, limits)
    part = target.with_name(target.name + ".part")
    note = target.with_name(target.name + ".part.json")
    deadline = time.monotonic() + limits.total
    try:
        with _hold(part, request) as stream:
            ledger = _Ledger(stream, note)
            try:
                for attempt in attempts(request, limits, say, deadline):
                    with attempt:
                        _transfer(request, ledger, limits, size, progress, deadline)
                        break
                found = Delivered(ledger.digest(), ledger.length)
                _check(request, found, sha256, size)
            except (CutError, HttpError):
                # The validator shows the next run, or the next signed address, whether the file has changed.
                if not ledger.length or not ledger.validator:
                    ledger.remove(part)
                raise
            except BaseException as error:
                if not isinstance(error, KeyboardInterrupt) or not ledger.validator:
                    ledger.remove(part)
                raise
            os.replace(part, target)
            note.unlink(missing_ok=True)
            return found
    except OSError as error:
        raise Avs3dError(f"{request.what}: {files.os_error_line(error, error.filename or target, 'write')}") from error


class _Ledger:
    """The part file with its length and its validator (strong ETag or date)."""

    def __init__(self, stream: IO[bytes], note: Path) -> None:
        self.stream, self.note = stream, note
        self.length = stream.seek(0, os.SEEK_END)
        self.validator = ""
        if self.length:
            with contextlib.suppress(OSError, ValueError, AttributeError):
                self.validator = str(json.loads(note.read_text()).get("validator") or "")
            if not self.validator:
                self.restart("")

    def restart(self, validator: str) -> None:
        self.stream.seek(0)
        self.stream.truncate()
        self.length, self.validator = 0, validator
        if validator:
            files.write_bytes(self.note, json.dumps({"validator": validator}).encode())
        else:
            self.note.unlink(missing_ok=True)

    def write(self, block: bytes) -> None:
        view = memoryview(block)
        while view:
            view = view[self.stream.write(view) :]
        self.length += len(block)

    def digest(self) -> str:
        self.stream.seek(0)
        return hashlib.file_digest(self.stream, "sha256").hexdigest()  # type: ignore[arg-type]  # unbuffered is fine

    def remove(self, part: Path) -> None:
        for path in (part, self.note):
            with contextlib.suppress(OSError):
                path.unlink()


def _transfer(
    request: Request,
    ledger: _Ledger,
    limits: FetchLimits,
    size: int | None,
    progress: Callable[[int, int | None], None],
    deadline: float,
) -> None:
    """Get the file, or its missing rest."""
    headers = {}
    if ledger.length and not ledger.validator:
        ledger.restart("")
    if ledger.length:
        headers = {"Range": f"bytes={ledger.length}-", "If-Range": ledger.validator}
    with open_answer(request, headers, limits, deadline, passed=(416,) if ledger.length else ()) as answer:
        total = _expect(request, answer, ledger, limits)
        if size is not None and total is not None and total != size:
            raise _changed(request, f"the server offers {total} bytes, the lock file says {size}")
        progress(ledger.length, total)
        bound = limits.max_bytes if size is None else size
        while block := read_block(answer, request, deadline):
            if ledger.length + len(block) > bound:
                if size is not None:
                    raise _changed(request, f"the server sent more than the {size} bytes in the lock file")
                raise _too_large(request, None, limits)
            ledger.write(block)
            progress(ledger.length, total)
        if total is not None and ledger.length != total:
            raise interrupted(request, f"the connection was cut after {ledger.length} of {total} bytes")
        progress(ledger.length, ledger.length)


def _expect(request: Request, answer: requests.Response, ledger: _Ledger, limits: FetchLimits) -> int | None:
    """The file's total size, if the answer contains it; prepares the ledger for the body."""
    encoding = answer.headers.get("Content-Encoding", "identity").lower()
    if encoding != "identity":
        raise Avs3dError(
            f"{request.what}: {request.service} sent the file with content encoding {encoding}, which was not requested"
        )
    if answer.status_code == 206:
        span = re.fullmatch(
            r"bytes ([0-9]{1,18})-([0-9]{1,18})/([0-9]{1,18}|\*)", answer.headers.get("Content-Range", "")
        )
        if span is None or int(span[1]) != ledger.length:
            ledger.restart("")
            raise interrupted(request, f"{request.service} resumed at another place than requested")
        return int(span[3]) if span[3] != "*" else int(span[2]) + 1
    if answer.status_code == 416:  # the file is not longer than the part file: begin again
        ledger.restart("")
        raise interrupted(request, f"{request.service} could not continue where the connection was cut")
    total = content_length(answer)
    if total is not None and total > limits.max_bytes:
        raise _too_large(request, total, limits)
    tag = answer.headers.get("ETag", "")
    strong = tag if tag.startswith('"') else ""
    ledger.restart(strong or answer.headers.get("Last-Modified", ""))
    return total


def _check(request: Request, found: Delivered, sha256: str | None, size: int | None) -> None:
    if found.bytes == 0:
        raise Avs3dError(f"{request.what}: {request.service} sent an empty file; try again later")
    if size is not None and found.bytes != size:
        raise _changed(request, f"it has {found.bytes} bytes, the lock file says {size}")
    if sha256 is not None and found.sha256 != sha256:
        raise _changed(request, f"its sha256 is {found.sha256[:12]}…, the lock file says {sha256[:12]}…")


def _changed(request: Request, found: str) -> Avs3dError:
    return Avs3dError(
        f"{request.what}: not the file that was pinned: {found}; it changed at {request.service}: inspect it there and "
        "fetch it again by its id, which pins the new file"
    )


def _too_large(request: Request, found: int | None, limits: FetchLimits) -> Avs3dError:
    size = f"{found / MEGABYTE:.1f} MB" if found is not None else "more than promised"
    return Avs3dError(
        f"{request.what}: too large ({size}, the limit is {limits.max_bytes / MEGABYTE:g} MB); raise it with --max-size"
    )


@contextlib.contextmanager
def _hold(part: Path, request: Request) -> Iterator[IO[bytes]]:
    """The part file, open and locked against a second process that fetches the same file."""

    def refuse(_: int, locked: bool | None) -> None:
        if locked is False:
            raise Avs3dError(f"{request.what}: another avs3d is fetching it; wait for that one")

    handle = open_locked(part, refuse, tries=_TRIES)
    if handle is None:
        raise Avs3dError(f"{request.what}: another avs3d keeps fetching it; wait for that one")
    # Unbuffered: a buffer would hide a full disk until the file is closed.
    with open(handle, "r+b", buffering=0) as stream:
        yield stream
