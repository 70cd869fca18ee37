"""`avs3d release`: a dataset as files that a host of data takes, with all that a reader needs to check them.

    NAME-VERSION-000.tar …    the dataset, cut into archives of at most 2 GB; no observation in two, unless it is larger
    release.json              what it consists of; its sha256 vouches for everything
    registry.txt, SHA256SUMS  the sha256 of every file, for pooch and for sha256sum
    croissant.json            Croissant description of the archives
    README.md, LICENCES.md    the dataset card, with how to get the data; licence and author of every asset

Times, owners and order in the archives are fixed, and they are not compressed (bytes of compressors differ by version;
pictures and sound hardly shrink): the same dataset gives the same bytes. Files of equal content in an archive, such as
the pictures of siblings, are hard links to the first.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from avs3d_bench import __version__
from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import croissant
from avs3d_bench.exports.card import card_text, gather, table
from avs3d_bench.exports.release.files import PlannedArchive, check_releasable, cut, released_files
from avs3d_bench.exports.release.record import (
    ARCHIVE_MB,
    CROISSANT,
    LICENCES,
    NO_DOI,
    README,
    REGISTRY,
    RELEASE_JSON,
    SUMS,
    ReleaseArchive,
    ReleaseRecord,
)
from avs3d_bench.exports.tar_format import closing, header, link, padding
from avs3d_bench.formats.files import open_regular, os_error_line, read_record, sha256_file, write_bytes, write_json
from avs3d_bench.formats.staging import refuse_strange, staged_folder
from avs3d_bench.runtime.parallel import advance, process_each

#: Least size of an archive (MB).
_LEAST_MB = 0.01
_DOI = re.compile(r"10\.[0-9]{4,9}/\S+")
#: Bytes read at a time.
_BLOCK = 2**20


@dataclass(frozen=True)
class ReleaseSettings:
    """Facts about a release that the dataset does not know.

    Attributes:
        archive_mb: most size of an archive, in 10⁶ bytes.
        doi: its DOI; None: a placeholder.
        url: address of the folder that will hold the files, for the README.
        home: the dataset's page, for Croissant.
        published: date, YYYY-MM-DD, for Croissant.

    Examples:
        >>> ReleaseSettings(archive_mb=500, url="https://example.org/demo", published="2026-01-31")
        ReleaseSettings(archive_mb=500, doi=None, url='https://example.org/demo', home=None, published='2026-01-31')
    """

    archive_mb: float = ARCHIVE_MB
    doi: str | None = None
    url: str | None = None
    home: str | None = None
    published: str | None = None

    def check(self) -> None:
        """Refuse what no host would take.

        Raises:
            UsageError: naming the option.
        """
        if not _LEAST_MB <= self.archive_mb < 10**6:
            raise UsageError(f"--archive-size {self.archive_mb:g}: expected megabytes, {_LEAST_MB:g} to 999999")
        if self.doi is not None and not _DOI.fullmatch(self.doi):
            raise UsageError(f"--doi {self.doi!r}: expected a DOI without an address, such as 10.5281/zenodo.1234567")
        if self.url is not None and not re.fullmatch(r"(https?|file)://\S+", self.url):
            raise UsageError(f"--url {self.url!r}: expected http://… or https://…")


def write_release(
    root: str | Path,
    folder: str | Path,
    settings: ReleaseSettings | None = None,
    *,
    workers: int | None = None,
    progress: bool = False,
) -> ReleaseRecord:
    """Write the release of a dataset, whole or not at all; an earlier release of the same dataset is replaced.

    Args:
        root: a dataset of this toolkit; of a sealed test, its public side.
        folder: where to.
        settings: see `ReleaseSettings`.
        workers: processes; None: one per core.
        progress: show a bar on stderr.

    Raises:
        UsageError: if there is nothing that may be released, or ``folder`` holds something else.
        Avs3dError: if a file is not what its record says, or the system refuses.

    Examples:
        >>> from pathlib import Path
        >>> release = write_release("data/demo", "release", ReleaseSettings(url="https://example.org/demo"), workers=1)
        >>> len(release.archives), release.licence
        (1, 'CC0-1.0')
        >>> sorted(path.name for path in Path("release").iterdir())
        ['LICENCES.md', 'README.md', 'SHA256SUMS', 'croissant.json', 'demo-1-000.tar', 'registry.txt', 'release.json']
    """
    settings = settings or ReleaseSettings()
    settings.check()
    dataset = Dataset(root)
    check_releasable(dataset)
    target = Path(folder).resolve()
    if target.is_relative_to(dataset.root.resolve()):
        raise UsageError(f"{folder}: lies inside the dataset; choose a folder outside of {dataset.root}")
    record = dataset.record
    assert record is not None
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", record.name).strip("-.") or "dataset"
    stem = f"{name}-{re.sub(r'[^A-Za-z0-9._-]+', '-', record.version)}"
    planned = cut(released_files(dataset), round(settings.archive_mb * 1e6))
    named = {f"{stem}-{number:03d}.tar": archive for number, archive in enumerate(planned)}
    with staged_folder(folder, partial(_check_folder, name=name)) as fresh:
        work = partial(_write_archive, dataset.root, fresh)
        sizes = [archive.size for archive in planned]
        items = list(named.items())
        made = process_each(work, items, workers=workers, label="release", progress=progress, sizes=sizes)
        archives = {item[0]: archive for item, archive in made}
        release = ReleaseRecord(
            name=name, dataset=record.name, version=record.version, toolkit_version=__version__,
            dataset_sha256=sha256_file(dataset.root / layout.DATASET_JSON), observations=len(dataset.keys),
            licence=record.licence, attributions=record.attributions, doi=settings.doi,
            archives=tuple(archives[file] for file in named),
        )  # fmt: skip
        _write_beside(fresh, dataset, release, settings)
    return release


def _check_folder(folder: Path, name: str) -> None:
    """Refuse to replace what is no earlier release of the dataset."""
    if not os.path.lexists(folder):
        return
    if not folder.is_dir():
        raise UsageError(f"{folder}: a file; expected a folder for the release")
    there = {path.name for path in folder.iterdir()}
    if not there:
        return
    if RELEASE_JSON not in there:
        raise UsageError(f"{folder}: not empty and no release; choose another folder")
    found = read_record(folder / RELEASE_JSON, ReleaseRecord)
    if found.name != name:
        raise UsageError(f"{folder}: holds the release of {found.name}; choose another folder")
    own = {README, LICENCES, CROISSANT, REGISTRY, SUMS, RELEASE_JSON, *(archive.file for archive in found.archives)}
    refuse_strange(folder, own)


def _write_archive(root: Path, folder: Path, item: tuple[str, PlannedArchive]) -> ReleaseArchive:
    """Write an archive and compare each file with its sha256."""
    name, planned = item
    path, digest, written = folder / name, hashlib.sha256(), 0
    try:
        with open(path, "wb") as stream:

            def put(data: bytes) -> None:
                nonlocal written
                stream.write(data)
                digest.update(data)
                written += len(data)

            for number, file in enumerate(planned.files):
                same = planned.known[file.sha256]
                if same != file.path:
                    put(link(file.path, same))
                    continue
                put(header(file.path, file.size))
                found, size = hashlib.sha256(), 0
                with open_regular(root / file.path) as source:
                    while block := source.read(_BLOCK):
                        put(block)
                        found.update(block)
                        size += len(block)
                if size != file.size or found.hexdigest() != file.sha256:
                    raise Avs3dError(
                        f"{root / file.path}: not the file that the dataset's records name (its sha256 differs); "
                        "restore it, or generate the observation again"
                    )
                put(padding(size))
                advance(number + 1, len(planned.files))
            put(closing(written))
    except OSError as error:
        raise Avs3dError(os_error_line(error, path, "write")) from error
    return ReleaseArchive(
        file=name, bytes=written, sha256=digest.hexdigest(), unpacked=planned.unpacked, files=len(planned.files),
        first=planned.files[0].path, last=planned.files[-1].path,
    )  # fmt: skip


def _write_beside(folder: Path, dataset: Dataset, release: ReleaseRecord, settings: ReleaseSettings) -> None:
    """Write what stands beside the archives."""
    keys = list(dataset.keys)
    described = croissant.description(dataset, keys, url=settings.home, published=settings.published)
    text = json.dumps(_in_archives(described, release), indent=1, ensure_ascii=False)
    write_bytes(folder / CROISSANT, f"{text}\n".encode())
    # The Hub would take the tar files for WebDataset shards.
    card = card_text(gather(dataset, keys)).replace("\n---\n", "\nviewer: false\n---\n", 1)
    write_bytes(folder / README, f"{card.rstrip()}\n\n{_download(release, settings)}".encode())
    write_bytes(folder / LICENCES, _licences(release).encode())
    write_json(folder / RELEASE_JSON, release)
    sums = {archive.file: archive.sha256 for archive in release.archives}
    sums |= {name: sha256_file(folder / name) for name in (CROISSANT, LICENCES, README, RELEASE_JSON)}
    write_bytes(folder / REGISTRY, "".join(f"{name} sha256:{sums[name]}\n" for name in sorted(sums)).encode())
    write_bytes(folder / SUMS, "".join(f"{sums[name]}  {name}\n" for name in sorted(sums)).encode())


def _in_archives(described: Mapping[str, Any], release: ReleaseRecord) -> dict[str, Any]:
    """A Croissant description whose files are in the archives of a release."""
    archives = [
        {
            "@type": "cr:FileObject",
            "@id": archive.file,
            "name": archive.file,
            "description": f"{archive.files:,} files, {archive.first} to {archive.last}",
            "contentUrl": archive.file,
            "contentSize": f"{archive.bytes} B",
            "encodingFormat": "application/x-tar",
            "sha256": archive.sha256,
        }
        for archive in release.archives
    ]
    ids = [{"@id": archive.file} for archive in release.archives]
    inside = [
        {**one, "containedIn": ids[0] if one["@type"] == "cr:FileObject" or len(ids) == 1 else ids}
        for one in described["distribution"]
    ]
    context = {**described["@context"], "containedIn": "cr:containedIn"}
    out = {**described, "@context": dict(sorted(context.items())), "distribution": [*archives, *inside]}
    return out | ({"identifier": f"https://doi.org/{release.doi}"} if release.doi else {})


def _licences(release: ReleaseRecord) -> str:
    rows = [(one.asset, one.name, one.author, one.source) for one in release.attributions]
    head = ("asset", "licence", "author", "source")
    assets = table(head, rows).replace("---:", "---") if rows else "No asset was made by others."
    return (
        f"# Licences of {release.dataset} {release.version}\n\n{release.licence}\n\n"
        f"Assets in the pictures, the sound and the meshes:\n\n{assets}\n"
    )


def _download(release: ReleaseRecord, settings: ReleaseSettings) -> str:
    archives: Sequence[tuple[object, ...]] = [(one.file, f"{one.bytes:,}", one.files) for one in release.archives]
    url = settings.url or "URL"
    return (
        "## Download\n\n"
        f"`avs3d get {release.name} --from {url}` downloads, checks and unpacks it "
        "(`pip install 'avs3d-bench[get]'`); an interrupted download continues. By hand:\n\n"
        "```text\nsha256sum -c SHA256SUMS\n"
        f"mkdir {release.name} && for archive in *.tar; do tar -xf $archive -C {release.name}; done\n```\n\n"
        f"{table(('archive', 'bytes', 'files'), archives)}\n\n"
        f"DOI: {release.doi or NO_DOI}. Licences of the assets: [{LICENCES}]({LICENCES}).\n"
    )
