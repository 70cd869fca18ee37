"""`avs3d get`: download a release, check it, unpack it.

`release.json` is read first; it names the archives with their sizes and sha256. pooch downloads them into
``.NAME.download`` beside the dataset's folder, where an interrupted download continues, in the middle of an archive if
the server can (HTTP ranges). When all are there, they are unpacked under a temporary name: the folder appears whole.
"""

from __future__ import annotations

import logging
import os
import re
import shutil
import tarfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any
from urllib.parse import unquote, urlsplit

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import parse_record
from avs3d_bench.contract.taxonomy import PARTS
from avs3d_bench.errors import Avs3dError, UsageError, did_you_mean, excerpt
from avs3d_bench.exports.release.record import RELEASE_JSON, ReleaseArchive, ReleaseRecord
from avs3d_bench.formats.archive import MAX_NAME, MAX_PATH
from avs3d_bench.formats.files import link_or_copy, open_regular, os_error_line, sha256_bytes, sha256_file
from avs3d_bench.formats.staging import hold, staged_folder
from avs3d_bench.runtime.imports import needing


@dataclass(frozen=True)
class HostedRelease:
    """Where a release is, and what vouches for it.

    Attributes:
        url: the folder of its files: http, https or file.
        sha256: of its release.json; None: what the host has is believed.
    """

    url: str
    sha256: str | None = None


#: Releases that are known by name. None has been uploaded yet: each upload adds its line here, with its sha256.
KNOWN: dict[str, HostedRelease] = {}
#: Most bytes of a release.json.
_MOST_RECORD = 64 * 2**20
#: Attempts beside the first one.
_RETRIES = 2
#: Seconds without a byte after which a server is given up.
_TIMEOUT = 30
#: Ending of a download that is not whole.
_PART = ".part"
#: Names at the top of an archive.
_TOP = (layout.DATASET_JSON, layout.SEAL_JSON, *PARTS)
#: Bytes copied at a time.
_BLOCK = 2**18
_SHA256 = re.compile(r"[0-9a-f]{64}")


def find_release(name: str, url: str | None, sha256: str | None = None) -> HostedRelease:
    """The address of a release: ``url``, or what the package knows of its name; ``sha256`` of its release.json.

    Raises:
        UsageError: if the name is unknown, or the address or the digest cannot be one.

    Examples:
        >>> find_release("demo", "https://example.org/demo").url
        'https://example.org/demo/'
    """
    if sha256 is not None and not _SHA256.fullmatch(sha256):
        raise UsageError(f"--sha256 {excerpt(sha256)}: expected the 64 digits that `avs3d release` printed")
    if url is None:
        known = KNOWN.get(name)
        if known is None:
            listed = f"the package knows {', '.join(sorted(KNOWN))}" if KNOWN else "the package knows none yet"
            raise UsageError(
                f"no release {excerpt(name)}: {listed}{did_you_mean(name, KNOWN)}; give its address: --from URL"
            )
        return known if sha256 is None else replace(known, sha256=sha256)
    if os.path.isdir(url):
        url = Path(os.path.abspath(url)).as_uri()
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https", "file") or not (parts.netloc or parts.scheme == "file"):
        raise UsageError(f"--from {excerpt(url)}: expected a folder, or the address of one: https://…/")
    if parts.query or parts.fragment:
        raise UsageError(f"--from {excerpt(url)}: has a query; expected the address of a folder, without ? and #")
    return HostedRelease(url.rstrip("/") + "/", sha256)


def get_release(name: str, hosted: HostedRelease, folder: str | Path, *, progress: bool = False) -> ReleaseRecord:
    """Download a release, check it and unpack it into a new folder.

    Args:
        name: of the release, as its release.json has it.
        hosted: of `find_release`.
        folder: must not exist, or be empty.
        progress: show a bar on stderr.

    Raises:
        UsageError: if ``folder`` is there, or the release has another name.
        Avs3dError: if the host does not have it, or what it has is not what release.json says; if an archive holds what
            no dataset has; if the system refuses.

    Examples:
        >>> from pathlib import Path
        >>> _ = write_release("data/demo", Path("hosted").absolute(), workers=1)
        >>> release = get_release("demo", find_release("demo", "hosted"), "data/got")  # or the address of a host
        >>> release.version, release.observations, Path("data/got/dataset.json").exists()
        ('1', 2, True)
    """
    with needing("avs3d get", "pip install 'avs3d-bench[get]'"):
        import pooch
    target = Path(os.path.abspath(folder))
    _refuse_existing(target)
    pooch.get_logger().setLevel(logging.ERROR)
    with _downloads(target) as downloads:
        release = _read_release(hosted, downloads)
        if release.name != name:
            raise UsageError(f"{hosted.url}: has the release {release.name}, not {excerpt(name)}; ask for that name")
        _clear(downloads, release)
        _check_disk(target, downloads, release)
        registry = {archive.file: f"sha256:{archive.sha256}" for archive in release.archives}
        store = pooch.create(downloads, hosted.url, registry=registry, retry_if_failed=_RETRIES)
        with _bar("download", release.bytes, progress) as show:
            for archive in release.archives:
                _fetch(store, archive, show)
        with staged_folder(target, _refuse_existing) as fresh, _bar("unpack", release.unpacked, progress) as show:
            for archive in release.archives:
                _unpack(downloads / archive.file, fresh, archive, show)
            if sha256_file(fresh / layout.DATASET_JSON) != release.dataset_sha256:
                raise Avs3dError(f"{hosted.url}: {layout.DATASET_JSON} is not the one that {RELEASE_JSON} names")
        _clear(downloads)
    return release


@contextmanager
def _downloads(target: Path) -> Iterator[Path]:
    """The locked folder of what has been downloaded; it vanishes with the last download in it."""
    folder = target.with_name(f".{target.name}.download")
    try:
        lock = hold(folder, target)
    except OSError as error:
        raise Avs3dError(os_error_line(error, target, "write")) from error
    try:
        yield folder
    finally:
        if not any(path.name != "lock" for path in folder.glob("*")):
            shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def _clear(downloads: Path, release: ReleaseRecord | None = None) -> None:
    """Remove all downloads but those of archives of ``release``."""
    wanted = {archive.file for archive in release.archives} if release else set()
    for path in downloads.iterdir():
        if path.name != "lock" and path.name.removesuffix(_PART) not in wanted:
            path.unlink()


def _refuse_existing(folder: Path) -> None:
    if os.path.lexists(folder) and not (folder.is_dir() and not any(folder.iterdir())):
        raise UsageError(f"{folder}: exists; choose another folder with -o, or remove it")


def _check_disk(target: Path, downloads: Path, release: ReleaseRecord) -> None:
    there = sum(path.stat().st_size for path in downloads.glob("*.tar*"))
    needed, free = release.bytes + release.unpacked - there, shutil.disk_usage(downloads).free
    if needed > free:
        raise Avs3dError(
            f"{target}: needs {needed / 1e9:,.1f} GB for the archives and what is in them, {free / 1e9:,.1f} GB are "
            "free; choose a folder on another disk with -o"
        )


def _read_release(hosted: HostedRelease, downloads: Path) -> ReleaseRecord:
    url, path = hosted.url + RELEASE_JSON, downloads / RELEASE_JSON
    path.unlink(missing_ok=True)
    try:
        with _one_line(url):
            _download(url, path, _MOST_RECORD, lambda _: None)
        data = path.read_bytes()
    except ValueError:
        raise Avs3dError(f"{url}: more than {_MOST_RECORD:,} bytes; expected the record of a release") from None
    finally:
        path.unlink(missing_ok=True)
    if hosted.sha256 is not None and sha256_bytes(data) != hosted.sha256:
        raise Avs3dError(
            f"{url}: sha256 {sha256_bytes(data)}, expected {hosted.sha256}; this is another release, or it was changed"
        )
    return parse_record(data, ReleaseRecord, url)


def _fetch(store: Any, archive: ReleaseArchive, show: Callable[[int], None]) -> None:
    """Have pooch download an archive, unless it is there, and compare its sha256."""
    part = Path(store.path) / f"{archive.file}{_PART}"
    done = 0

    def count(received: int) -> None:
        nonlocal done
        show(received - done)
        done = received

    def downloader(url: str, output: str, _: Any) -> None:
        _download(url, part, archive.bytes, count)
        os.replace(part, output)

    url = store.base_url + archive.file
    with _one_line(url):
        try:
            store.fetch(archive.file, downloader=downloader)
        except ValueError:  # pooch: the hash
            raise Avs3dError(
                f"{url}: not the archive that {RELEASE_JSON} names (its sha256 differs); it was changed, or the upload "
                "is damaged: tell its publisher"
            ) from None
    count(archive.bytes)


class _Limited:
    """A file that pooch appends to; more bytes than expected end the download.

    A server that knows no ranges sends the whole file behind what was there: then it is fetched again from its start.
    """

    def __init__(self, stream: IO[bytes], most: int, show: Callable[[int], None]) -> None:
        self._stream, self._most, self._show = stream, most, show
        self._size = stream.tell()

    def write(self, data: bytes) -> None:
        """Append."""
        self._size += len(data)
        if self._size > self._most:
            self._stream.truncate(0)
            raise ValueError("more bytes than expected")
        self._stream.write(data)
        self._show(self._size)

    def flush(self) -> None:
        """Leave it to the system."""


def _download(url: str, part: Path, most: int, show: Callable[[int], None]) -> None:
    """Continue the download of a file of at most ``most`` bytes into ``part``.

    Raises:
        ValueError: if there are more bytes.
    """
    import pooch

    had = part.stat().st_size if part.exists() else 0
    if had >= most:
        return
    with open(part, "ab") as stream:
        limited = _Limited(stream, most, show)
        if urlsplit(url).scheme == "file":
            with open_regular(unquote(urlsplit(url).path)) as source:
                source.seek(had)
                while block := source.read(_BLOCK):
                    limited.write(block)
            return
        headers = {"Accept-Encoding": "identity", **({"Range": f"bytes={had}-"} if had else {})}
        pooch.HTTPDownloader(chunk_size=_BLOCK, headers=headers, timeout=_TIMEOUT)(url, limited, None)


def _unpack(path: Path, root: Path, announced: ReleaseArchive, show: Callable[[int], None]) -> None:
    """Unpack an archive below ``root``: regular files, and hard links to files of the same archive.

    Raises:
        Avs3dError: if there is anything else in it, or more than ``announced``.
    """
    seen: dict[str, Path] = {}
    done = 0
    try:
        with tarfile.open(path, mode="r:") as archive:
            for info in archive:
                place = root / _checked_name(info, path)
                if len(seen) >= announced.files or os.path.lexists(place):
                    raise Avs3dError(f"{path.name}: {excerpt(info.name)} is in the release twice, or not announced")
                place.parent.mkdir(parents=True, exist_ok=True)
                if info.islnk():
                    if info.linkname not in seen:
                        raise Avs3dError(f"{path.name}: {excerpt(info.name)} links to no earlier file of the archive")
                    link_or_copy(seen[info.linkname], place)
                else:
                    done += info.size
                    source = archive.extractfile(info)
                    if done > announced.unpacked or source is None:
                        raise Avs3dError(f"{path.name}: holds more than the {announced.unpacked:,} bytes announced")
                    with source, open(place, "xb") as stream:
                        shutil.copyfileobj(source, stream, _BLOCK)
                    show(info.size)
                seen[info.name] = place
    except tarfile.TarError as error:
        raise Avs3dError(f"{path.name}: cannot be read as a tar file ({error}); tell its publisher") from None
    except OSError as error:
        raise Avs3dError(os_error_line(error, root, "write")) from error


def _checked_name(info: tarfile.TarInfo, path: Path) -> str:
    """The name of a member that a dataset may have."""
    parts = info.name.split("/")
    plain = not any(part in ("", ".", "..") or "\\" in part or ":" in part or "\0" in part for part in parts)
    short = len(info.name.encode("utf-8", "surrogateescape")) <= MAX_PATH and all(len(p) <= MAX_NAME for p in parts)
    if not (plain and short and parts[0] in _TOP):
        raise Avs3dError(f"{path.name}: holds {excerpt(info.name)}, expected {', '.join(_TOP)} and files below parts")
    # Of a sparse file, a few bytes of the archive would become any number on the disk.
    if info.type not in (tarfile.REGTYPE, tarfile.AREGTYPE, tarfile.LNKTYPE) or info.issparse() or info.size < 0:
        raise Avs3dError(
            f"{path.name}: {excerpt(info.name)} is a link, folder, device or sparse file; expected files alone"
        )
    return info.name


@contextmanager
def _one_line(url: str) -> Iterator[None]:
    """Errors of the network as one line."""
    import requests

    try:
        yield
    except requests.HTTPError as error:
        found = error.response
        code, reason = (found.status_code, found.reason) if found is not None else (0, "nothing")
        hint = "; expected a folder that holds a release" if code == 404 else "; try again later"
        raise Avs3dError(f"{url}: the server answers {code} {reason}{hint}") from None
    except requests.Timeout:
        raise Avs3dError(f"{url}: no answer for {_TIMEOUT} s; run the same command again, it continues") from None
    except requests.RequestException as error:
        cause = type(error).__name__
        raise Avs3dError(f"{url}: no connection ({cause}); run the same command again, it continues") from None
    except OSError as error:
        raise Avs3dError(os_error_line(error, action="write")) from error


@contextmanager
def _bar(label: str, total: int, shown: bool) -> Iterator[Callable[[int], None]]:
    """A progress bar on stderr in bytes; a function that adds to it."""
    if not shown:
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        DownloadColumn(),
        TransferSpeedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(label, total=total)
        yield lambda count: progress.update(task, advance=count)
