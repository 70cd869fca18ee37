"""Common code of the fetchers of all collections: store, limits, allowed licences, and offers as entries."""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import soundfile

from avs3d_bench.contract.taxonomy import check_category_name
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from generators.assets.meshcheck import check_file
from generators.assets.meshfile import load_mesh
from generators.core.limits import SoundSplit
from generators.library.download import Delivered
from generators.library.http import FetchLimits, Say
from generators.library.licences import check_licence
from generators.library.lock import SHORTEST, AssetEntry, Kind, Source
from generators.library.store import Store

#: A recording whose peak is below this is silent (−80 dBFS). A note names a larger share of clipped samples, and a
#: lower sampling rate (Hz).
_SILENT, _CLIPPED, _LOW_RATE = 1e-4, 1e-4, 16_000


@dataclass(frozen=True)
class Session:
    """Options of one call of `avs3d assets`.

    Attributes:
        store: the store to write to.
        limits: limits of time and size of a download.
        allowed: licences that the user allows by name.
        say: called with one line per note, pause or new attempt.
        progress: called with the asset, the number of bytes so far and, if known, the total.
    """

    store: Store
    limits: FetchLimits = field(default_factory=FetchLimits)
    allowed: tuple[str, ...] = ()
    say: Say = lambda _: None
    progress: Callable[[str, int, int | None], None] = lambda _what, _done, _total: None

    def progress_of(self, what: str) -> Callable[[int, int | None], None]:
        """`progress` of one asset."""
        return lambda done, total: self.progress(what, done, total)


@dataclass(frozen=True)
class Stance:
    """Orientation, height and mount of an object: see the fields of the same names in `AssetEntry`."""

    up: str = "y"
    front: str = "+z"
    height: float | None = None
    mount: str | None = None
    yaw: float | None = None


@dataclass(frozen=True)
class Offer:
    """A collection's description of an asset before its download; the fields are those of `AssetEntry`."""

    id: str
    kind: Kind
    category: str
    source: Source
    ref: str
    url: str
    title: str
    author: str
    licence: str
    file: str
    trim: tuple[float, float] | None = None
    split: SoundSplit | None = None

    def entry(self, sha256: str, size: int, stance: Stance = Stance()) -> AssetEntry:  # frozen
        """The entry that pins the bytes.

        Raises:
            Avs3dError: if a field is not valid (a title of a thousand characters, a height of 80 m, …).
        """
        fields: dict[str, Any] = {
            "id": self.id, "kind": self.kind, "category": self.category,
            "source": self.source, "ref": self.ref, "url": self.url, "title": _line(self.title) or self.ref,
            "author": _line(self.author) or "unknown", "licence": _line(self.licence) or "unknown",
            "file": self.file, "sha256": sha256, "bytes": size, "trim": self.trim, "split": self.split,
        }  # fmt: skip
        if self.kind == "object":
            fields |= {
                "up": stance.up, "front": stance.front, "height": stance.height, "mount": stance.mount,
                "yaw": stance.yaw,
            }  # fmt: skip
        try:
            return AssetEntry.model_validate(fields)
        except ValueError as error:
            first = error.errors(include_url=False)[0]  # type: ignore[attr-defined]  # pydantic's is a ValueError
            where = ".".join(str(step) for step in first["loc"]) or "entry"
            raise UsageError(f"{self.id}: {where}: {first['msg'].removeprefix('Value error, ')}") from None


def take(offer: Offer, session: Session, get: Callable[[Path], Delivered], stance: Stance = Stance()) -> AssetEntry:
    """Fetch an offered asset into the store: check the licence, download the bytes, check that they can be used.

    Args:
        offer: the collection's description.
        session: options of this call of `avs3d assets`.
        get: fetches the file to a path.
        stance: orientation, height and mount of an object.

    Raises:
        Avs3dError: for a licence that forbids the use, a failed download or a file that cannot be used; the store is
            then unchanged.
    """
    admit(offer, session)
    staged = session.store.incoming(offer.id, offer.file)
    offer.entry("0" * 64, 1, stance)  # reports an invalid field before the download
    try:
        # Errors of this cleanup are ignored; another process may own the file by now.
        delivered = get(staged)
    except BaseException:
        session.store.tidy(offer.id)
        raise
    entry = offer.entry(delivered.sha256, delivered.bytes, stance)
    known = session.store.path(entry).exists()
    session.store.adopt(offer.id, staged, delivered.sha256)
    return _kept_if_usable(entry, session, known)


def keep(offer: Offer, session: Session, data: bytes, stance: Stance = Stance()) -> AssetEntry:
    """As `take`, for bytes that are already on this machine."""
    admit(offer, session)
    if not data:
        raise Avs3dError(f"{offer.id}: {offer.ref} is an empty file; replace it")
    entry = offer.entry(files.sha256_bytes(data), len(data), stance)
    known = session.store.path(entry).exists()
    try:
        session.store.put(offer.id, offer.file, data)
    except BaseException:
        if not known:
            session.store.drop(entry)
        raise
    return _kept_if_usable(entry, session, known)


def admit(offer: Offer, session: Session) -> None:
    """Refuse an offer whose licence forbids the use; report the conditions of the licence."""
    if offer.kind != "scan":
        check_category_name(offer.category)
    note = check_licence(offer.id, offer.licence, session.allowed)
    if note:
        session.say(note)


def _kept_if_usable(entry: AssetEntry, session: Session, known: bool) -> AssetEntry:
    """The entry; an unusable file is deleted, unless it was in the store before (another entry may use it)."""
    try:
        check_usable(entry, session)
    except BaseException:
        if not known:
            session.store.drop(entry)
        raise
    return entry


def check_usable(entry: AssetEntry, session: Session) -> None:
    """Open the stored file in the same way as generation.

    Raises:
        Avs3dError: if it cannot be used, with the reason.
    """
    if entry.kind == "object":
        for line in session.store.findings(entry):
            if line.startswith("warning"):
                session.say(f"{entry.id}: {line}")
    elif entry.kind == "scan":
        path = session.store.path(entry)
        check_file(path)
        load_mesh(path, twin="surface", max_acoustic_faces=sys.maxsize, textures=False)
    else:
        check_sound(entry, session)


def check_sound(entry: AssetEntry, session: Session) -> None:
    """Refuse a sound that generation could not use, and note what is heard of a poor one.

    Raises:
        Avs3dError: naming the asset: not decodable, truncated, too short, also for its trim, silent, with samples that
            are no numbers.
    """
    from generators.assets.sounds import survey

    what, path = entry.id, session.store.path(entry)
    try:
        found = survey(path)
    except (soundfile.SoundFileError, RuntimeError) as error:
        reason = " ".join(str(error).replace(str(path), path.name).split())
        raise Avs3dError(f"{what}: {path.name} cannot be decoded as a sound ({reason}); try another format") from None
    if found.missing:
        raise Avs3dError(f"{what}: truncated, {found.missing} bytes of its samples are missing; fetch or copy it again")
    if found.seconds < SHORTEST:
        raise Avs3dError(
            f"{what}: lasts {found.seconds:.2f} s; expected at least {SHORTEST} s; choose another recording"
        )
    if entry.trim is not None and round((entry.trim[1] - found.seconds) * found.sample_rate) > 0:
        raise Avs3dError(
            f"{what}: lasts {found.seconds:.2f} s, but its trim ends at {entry.trim[1]:g} s; correct the trim"
        )
    if not math.isfinite(found.peak):
        raise Avs3dError(f"{what}: has samples that are NaN or infinite; repair it, or choose another recording")
    if found.peak < _SILENT:
        raise Avs3dError(
            f"{what}: is silent (peak {found.peak:.1g} in the mean of its channels); choose another recording"
        )
    if found.clipped > _CLIPPED:
        session.say(f"{what}: {found.clipped:.2%} of its samples are clipped, and will sound so")
    if found.sample_rate < _LOW_RATE:
        session.say(f"{what}: its {found.sample_rate} Hz hold nothing above {found.sample_rate / 2000:g} kHz")


def token(variable: str, what: str, service: str, page: str) -> str:
    """The user's token from the environment.

    Raises:
        Avs3dError: if it is not set, with the page that issues one; its value is never shown.
    """
    value = os.environ.get(variable, "").strip()
    if not value:
        raise Avs3dError(f"{what}: {service} needs a token and {variable} is not set; get one at {page} and export it")
    if not re.fullmatch(r"[\x21-\x7e]+", value):
        raise Avs3dError(f"{what}: {variable} contains spaces or other characters that no token has; copy it again")
    return value


def address(variable: str, default: str) -> str:
    """A service's base address: the environment's ``variable`` (for mirrors and tests), else the usual one."""
    return (os.environ.get(variable) or default).rstrip("/")


def pick(document: object, path: str, what: str, service: str) -> str:
    """The text at ``a.b.c`` of a JSON answer.

    Raises:
        Avs3dError: if the answer has another shape.
    """
    value = look(document, path)
    if not value:
        raise Avs3dError(f"{what}: {service} answered without {path!r}; its interface may have changed: report it")
    return value


def look(document: object, path: str) -> str:
    """The text at ``a.b.c`` of a JSON answer; empty if there is none."""
    value = document
    for step in path.split("."):
        value = value.get(step) if isinstance(value, Mapping) else None
    return value if isinstance(value, str) else ""


def reference(text: str, pattern: str, what: str, example: str) -> str:
    """The id in ``text`` (the id itself, or a page's address that ends with it).

    Raises:
        UsageError: if there is none.
    """
    found = re.fullmatch(rf"(?:https?://\S*?[/-])?({pattern})/?(?:[?#]\S*)?", text.strip())
    if found is None:
        raise UsageError(f"{text!r:.80} is no {what}; expected e.g. {example}, or the address of its page")
    return found[1]


def _line(text: str) -> str:
    """Text from a collection as one line without control characters."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in str(text)).split())[:300]
