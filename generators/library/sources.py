"""Common interface of all collections: fetch a new asset by its id, or the pinned file of an entry."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from generators.library import bbc, esc50, freesound, github, sh3d, sketchfab
from generators.library.download import Delivered
from generators.library.folder import Told
from generators.library.licences import check_licence
from generators.library.lock import AssetEntry
from generators.library.session import Session, Stance, check_usable

#: Collections that `fetch` asks over HTTP, with the formats each offers.
FETCHED = {
    "sketchfab": tuple(sketchfab.FORMATS),
    "freesound": ("preview", "original"),
    "bbc": bbc.FORMATS,
    "github": (),
}


def fetch_new(source: str, ref: str, told: Told, stance: Stance, session: Session, form: str | None) -> AssetEntry:
    """Describe and fetch an asset by its collection's own id.

    Args:
        source: one of `FETCHED`.
        ref: the collection's own id.
        told: its category; where the collection does not say it, also its licence and its author.
        stance: orientation, height and mount of an object.
        session: options of this call of `avs3d assets`.
        form: one of the collection's formats; None: the collection's usual one.

    Raises:
        UsageError: if the collection does not offer the format.
        Avs3dError: for any other failure, in one line.
    """
    if form is not None and form not in FETCHED[source]:
        offered = " and ".join(FETCHED[source]) or "each file in its own format only: leave the option out"
        raise UsageError(f"--format {form}: {source} offers {offered}")
    if source == "github":
        return github.fetch(ref, told, session)
    if source == "sketchfab":
        return sketchfab.fetch(ref, told.category, stance, session, form)
    if source == "freesound":
        return freesound.fetch(ref, told.category, session, form)
    return bbc.fetch(ref, told.category, session, form)


def fetch_pinned(entry: AssetEntry, session: Session, nearby: Mapping[str, Path] = {}) -> bool:  # not written to
    """Fetch the pinned file of an entry into the store; False if it is there already.

    Args:
        entry: of the lock file.
        session: options of this call of `avs3d assets`.
        nearby: sha256 → a file on this machine that has it; see `generators.library.folder.nearby`.

    Raises:
        Avs3dError: for a licence that the user has not allowed, a failed download, a file that is not the pinned one.
    """
    store = session.store
    if not store.problem(entry):
        return False
    note = check_licence(entry.id, entry.licence, session.allowed)
    if note:
        session.say(note)
    if entry.sha256 in nearby:
        store.put(entry.id, entry.file, files.read_bytes(nearby[entry.sha256]))
        check_usable(entry, session)
        return True
    if entry.source == "folder":
        raise Avs3dError(
            f"{entry.id}: came from a folder ({entry.ref}) and has no address; run: avs3d assets fetch --from DIR "
            f"--id {entry.id}, with a folder that holds the file under whatever name"
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
    if entry.source == "github":
        return github.fetch_pinned(entry, staged, session)
    return sh3d.fetch_pinned(entry, staged)
