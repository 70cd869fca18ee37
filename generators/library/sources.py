"""Common interface of all collections: fetch a new asset by its id, or the pinned file of an entry."""

from __future__ import annotations

from pathlib import Path

from avs3d_bench.errors import Avs3dError, UsageError
from generators.library import bbc, esc50, freesound, sh3d, sketchfab
from generators.library.download import Delivered
from generators.library.licences import check_licence
from generators.library.lock import AssetEntry
from generators.library.session import Session, Stance, check_usable

#: Collections that `fetch` asks over HTTP, with the formats each offers.
FETCHED = {"sketchfab": tuple(sketchfab.FORMATS), "freesound": ("preview", "original"), "bbc": bbc.FORMATS}


def fetch_new(source: str, ref: str, category: str, stance: Stance, session: Session, form: str | None) -> AssetEntry:
    """Describe and fetch an asset by its collection's own id.

    Raises:
        UsageError: if the collection does not offer the format.
        Avs3dError: for any other failure, in one line.
    """
    if form is not None and form not in FETCHED[source]:
        raise UsageError(f"--format {form}: {source} offers {' and '.join(FETCHED[source])}")
    if source == "sketchfab":
        return sketchfab.fetch(ref, category, stance, session, form)
    if source == "freesound":
        return freesound.fetch(ref, category, session, form)
    return bbc.fetch(ref, category, session, form)


def fetch_pinned(entry: AssetEntry, session: Session) -> bool:
    """Fetch the pinned file of an entry into the store; False if it is there already.

    Raises:
        Avs3dError: for a licence that the user has not allowed, a failed download, a file that is not the pinned one.
    """
    store = session.store
    if not store.problem(entry):
        return False
    note = check_licence(entry.id, entry.licence, session.allowed)
    if note:
        session.say(note)
    if entry.source == "folder":
        raise Avs3dError(
            f"{entry.id}: came from a folder ({entry.ref}) and has no address; run: avs3d assets import folder DIR "
            f"--licence {entry.licence!r} --author {entry.author!r} --category {entry.category}"
        )
    staged = store.incoming(entry.id, entry.file)
    try:
        delivered = _bring(entry, staged, session)
    except BaseException:
        store.tidy(entry.id)
        raise
    store.adopt(entry.id, staged, delivered.sha256)
    check_usable(entry, session)
    return True


def _bring(entry: AssetEntry, staged: Path, session: Session) -> Delivered:
    if entry.source == "sketchfab":
        return sketchfab.fetch_pinned(entry, staged, session)
    if entry.source == "freesound":
        return freesound.fetch_pinned(entry, staged, session)
    if entry.source == "bbc":
        return bbc.fetch_pinned(entry, staged, session)
    if entry.source == "esc50":
        return esc50.fetch_pinned(entry, staged, session)
    return sh3d.fetch_pinned(entry, staged)
