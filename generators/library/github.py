"""Sounds and scans in public repositories at GitHub, pinned by their commit.

A file is named ``OWNER/REPOSITORY@COMMIT:PATH``. Facts
(https://docs.github.com/repositories/working-with-files/using-files/viewing-and-understanding-files): a commit's bytes
never change, and ``https://raw.githubusercontent.com/OWNER/REPOSITORY/COMMIT/PATH`` has them, without a token. Which
licence a file has, and who made it, stands in the repository in words; so the user says both.
"""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import quote

from avs3d_bench.errors import UsageError
from generators.library.download import Delivered, download
from generators.library.folder import Told
from generators.library.http import Request
from generators.library.lock import AssetEntry, Kind, slug
from generators.library.session import Offer, Session, address, take
from generators.library.store import SCAN_SUFFIXES, SOUND_SUFFIXES

SERVICE = "GitHub"
_REF = re.compile(
    r"(?P<owner>[A-Za-z0-9-]{1,39})/(?P<name>[\w.-]{1,100})@(?P<commit>[0-9a-f]{40}):(?P<path>[^\x00-\x1f]{1,500})"
)
_EXAMPLE = "OWNER/REPOSITORY@COMMIT:PATH with all 40 digits of the commit"


def is_scan(ref: str) -> bool:
    """Whether the file that a reference names is a scan, by its suffix."""
    return ref.lower().endswith(SCAN_SUFFIXES)


def fetch(ref: str, told: Told, session: Session) -> AssetEntry:
    """Fetch a sound or a scan.

    Args:
        ref: ``OWNER/REPOSITORY@COMMIT:PATH``.
        told: its category (empty for a scan), licence and author, and the address of its source where that is not the
            repository.
        session: options of this call of `avs3d assets`.

    Raises:
        UsageError: for a reference of another form, a file that is neither, or without licence or author.
        Avs3dError: one line: licence, any network error, a file that cannot be decoded.
    """
    found = _REF.fullmatch(ref)
    if found is None:
        raise UsageError(f"{ref!r:.120} names no file of a commit; expected {_EXAMPLE}")
    path = Path(found["path"])
    kind: Kind = "scan" if is_scan(ref) else "sound"
    if kind == "sound" and path.suffix.lower() not in SOUND_SUFFIXES:
        raise UsageError(
            f"{ref!r:.120} is no sound and no scan; expected {', '.join((*SOUND_SUFFIXES, *SCAN_SUFFIXES))}"
        )
    if not told.licence or not told.author:
        raise UsageError(f"{ref!r:.120}: {SERVICE} does not say who made a file; name --licence and --author")
    steps = [found["owner"], found["name"], *(slug(step) for step in path.with_suffix("").parts)]
    offer = Offer(
        id="/".join(["github", *steps]), kind=kind, category=told.category, source="github", ref=ref,
        url=told.url or f"https://github.com/{found['owner']}/{found['name']}", title=path.stem, author=told.author,
        licence=told.licence, file=f"{kind}{path.suffix.lower()}",
    )  # fmt: skip
    return take(offer, session, lambda target: _download(ref, offer.id, target, session))


def fetch_pinned(entry: AssetEntry, target: Path, session: Session) -> Delivered:
    """Fetch the pinned file of an entry to ``target``."""
    return _download(entry.ref, entry.id, target, session, entry)


def _download(ref: str, what: str, target: Path, session: Session, pinned: AssetEntry | None = None) -> Delivered:
    found = _REF.fullmatch(ref)
    if found is None:
        raise UsageError(f"{what}: ref {ref!r:.120} in the lock file; expected {_EXAMPLE}")
    base = address("AVS3D_GITHUB_URL", "https://raw.githubusercontent.com")
    url = f"{base}/{found['owner']}/{found['name']}/{found['commit']}/{quote(found['path'])}"
    advice = {404: "look for the commit and the path at https://github.com; a repository may have gone"}
    return download(
        Request(url, what, SERVICE, advice=advice),
        target,
        session.limits,
        sha256=pinned.sha256 if pinned else None,
        size=pinned.bytes if pinned else None,
        say=session.say,
        progress=session.progress_of(what),
    )
