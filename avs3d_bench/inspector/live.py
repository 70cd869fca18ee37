"""The files of a site, made when they are asked for."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import IO

from avs3d_bench.contract.layout import parse_key
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.inspector.cards import GalleryCard
from avs3d_bench.inspector.pages import PageOf, gallery_page, observation_page, problem_page, sibling_script
from avs3d_bench.inspector.site import (
    AMBISONICS,
    FLOOR,
    PAGE,
    SCENE,
    SOUND,
    THUMBNAIL,
    DamagedError,
    NotThereError,
    ObservationSite,
    static_asset,
)
from avs3d_bench.inspector.submissions import ShownSubmission

#: Slow to make, or asked for all at once.
_KEPT, _STEMS = (THUMBNAIL, FLOOR, SOUND, AMBISONICS), "stems/"


class KeptFiles:
    """Bytes by name, in one temporary file without a name: nothing remains of it, however the process ends.

    Where there is no room for it nothing is kept. Safe to use from several threads.
    """

    def __init__(self) -> None:
        """Open the file."""
        self._lock = threading.Lock()
        self._places: dict[str, tuple[int, int]] = {}
        self._file: IO[bytes] | None = None
        with suppress(OSError):
            # Made without a name or unlinked at once (on Windows: deleted with its last handle).
            self._file = tempfile.TemporaryFile(buffering=0, prefix="avs3d-view-")  # noqa: SIM115

    def get(self, name: str) -> bytes | None:
        """The bytes that were put under ``name``; None if none were, or they could not be kept."""
        with self._lock, suppress(OSError):
            if self._file is not None and name in self._places:
                start, length = self._places[name]
                self._file.seek(start)
                data = self._file.read(length)
                return data if len(data) == length else None
        return None

    def put(self, name: str, data: bytes) -> None:
        """Keep ``data`` under ``name``, if there is room."""
        with self._lock, suppress(OSError):
            if self._file is not None:
                start = self._file.seek(0, os.SEEK_END)
                # A full disk may take a part only.
                if self._file.write(data) == len(data):
                    self._places[name] = (start, len(data))

    def close(self) -> None:
        """Give the room back."""
        with self._lock, suppress(OSError):
            if self._file is not None:
                self._file.close()
                self._file = None


class LiveSite:
    """The files of a site, made when they are asked for; safe to use from several threads."""

    def __init__(self, dataset: Dataset, keys: Sequence[str], submissions: tuple[ShownSubmission, ...]) -> None:
        """Nothing is read yet."""
        self._dataset, self._keys, self._submissions = dataset, list(keys), submissions
        self._files = KeptFiles()
        self._sites: dict[str, ObservationSite] = {}
        self._gallery: bytes | None = None
        self._lock = threading.Lock()
        self._busy: dict[str, threading.Lock] = {}

    def read(self, address: str) -> bytes:
        """The file at ``address``, relative to the site.

        Raises:
            NotThereError: if there is none.
            DamagedError: if what it is made of is damaged, missing, or leads out of the dataset.
        """
        if address == PAGE:
            with self._one_at_a_time(PAGE):
                return self._read_gallery()
        folder, _, name = address.partition("/")
        if folder == "assets":
            return static_asset(name)
        pieces = address.split("/", 4)
        key, name = "/".join(pieces[:4]), pieces[4] if len(pieces) == 5 else ""
        if key not in self._keys or not name:
            raise NotThereError(f"the site has no {address}")
        try:
            site = self._site(key)
        except Avs3dError as error:  # the folder is gone
            raise self._damaged(key, name, str(error).replace(str(self._dataset.root / key), key)) from error
        try:
            with site.reading():
                return self._read(key, site, name)
        except DamagedError as error:
            # The damaged file may be repaired soon: the next request reads it again.
            with self._lock:
                self._sites.pop(key, None)
            raise self._damaged(key, name, site.without_paths(str(error))) from error

    def _read(self, key: str, site: ObservationSite, name: str) -> bytes:
        if name == PAGE or (name == SCENE and site.facts.lanes is not None):
            with self._one_at_a_time(key):
                shown = self._page_of(key, site)
                return observation_page(shown) if name == PAGE else sibling_script(shown)
        if name in _KEPT or (name.startswith(_STEMS) and name in site.stem_files):
            with self._one_at_a_time(f"{key}/{name}"):
                return self._kept(key, site, name)
        return site.make(name)

    def close(self) -> None:
        """Free the cached bytes."""
        self._files.close()

    def _one_at_a_time(self, what: str) -> threading.Lock:
        """Two that ask for the same thing at once must not both make it."""
        with self._lock:
            return self._busy.setdefault(what, threading.Lock())

    def _site(self, key: str) -> ObservationSite:
        with self._lock:
            if key not in self._sites:
                self._sites[key] = ObservationSite(self._dataset, key, self._submissions, self._keys)
            return self._sites[key]

    def _read_gallery(self) -> bytes:
        if self._gallery is not None:
            return self._gallery
        cards = [self._card(key) for key in self._keys]
        page = gallery_page(self._dataset, cards, [s.name for s in self._submissions])
        # Damaged files may be repaired while this runs.
        if all(card.problem is None for card in cards):
            self._gallery = page
        return page

    def _card(self, key: str) -> GalleryCard:
        try:
            card = self._site(key).card()
        except Avs3dError as error:
            return GalleryCard(parse_key(key), problem=str(error).replace(str(self._dataset.root / key), key))
        if card.problem is not None:
            with self._lock:
                self._sites.pop(key, None)
        return card

    def _neighbours(self, key: str) -> tuple[str | None, str | None]:
        at = self._keys.index(key)
        return self._keys[at - 1] if at else None, self._keys[at + 1] if at + 1 < len(self._keys) else None

    def _damaged(self, key: str, name: str, problem: str) -> DamagedError:
        before, after = self._neighbours(key)
        return DamagedError(problem, problem_page(key, problem, before=before, after=after) if name == PAGE else None)

    def _page_of(self, key: str, site: ObservationSite) -> PageOf:
        before, after = self._neighbours(key)
        _ = site.poster  # no page without a picture, as in the gallery
        problems = site.facts.problems
        if site.facts.has_sound:
            # The page names the gain of the track, so it has been read: the player's request finds it made.
            self._kept(key, site, SOUND)
            problems += site.track.problems
        return PageOf(site, before, after, linked=True, problems=problems)

    def _kept(self, key: str, site: ObservationSite, name: str) -> bytes:
        data = self._files.get(f"{key}/{name}")
        if data is None:
            data = site.make(name)
            self._files.put(f"{key}/{name}", data)
            if name == SOUND:
                site.forget_sound()
        return data
