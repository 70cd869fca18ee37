"""Sounds from Freesound, by id.

Facts (https://freesound.org/docs/api/resources_apiv2.html, authentication.html): ``GET /apiv2/sounds/{id}/?fields=…``
with ``Authorization: Token …`` describes a sound; its ``previews`` (OGG and MP3 of about 192 and 128 kbit/s) need no
token. The original, ``/apiv2/sounds/{id}/download/``, needs OAuth2: ``Authorization: Bearer …``. The answer to too many
requests is 429. ``license`` is an address at creativecommons.org.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

from avs3d_bench.errors import Avs3dError
from generators.library.download import Delivered, download
from generators.library.http import Request, get_json
from generators.library.licences import spdx
from generators.library.lock import AssetEntry
from generators.library.session import Offer, Session, address, look, pick, reference, take, token

SERVICE = "Freesound"
PAGE = "https://freesound.org/apiv2/apply"
FIELDS = "id,url,name,username,license,type,filesize,md5,previews"
#: Formats of originals that libsndfile decodes.
_DECODED = ("wav", "flac", "ogg", "mp3", "aif", "aiff")
_ADVICE = {
    401: f"FREESOUND_TOKEN is not valid: copy the API key from {PAGE}",
    403: "your key does not allow this: see its limits on your page of API keys",
    404: "check the id: it is the number in the sound's address",
    429: "wait a minute (60 requests) or until tomorrow (2000 a day)",
}


def fetch(ref: str, category: str, session: Session, form: str | None = None) -> AssetEntry:
    """Describe and fetch a sound.

    Args:
        ref: its number, or its page's address.
        category: its category.
        session: options of this call of `avs3d assets`.
        form: ``preview`` (OGG) or ``original`` (as uploaded; needs FREESOUND_OAUTH_TOKEN); default: the original if
            that token is set, else the preview.

    Raises:
        Avs3dError: one line: token, licence, any network error, a file that is not a sound.
    """
    number = reference(ref, r"\d{1,9}", "id of Freesound", "1234")
    what = f"freesound/{number}"
    about = _about(number, what, session)
    kind = look(about, "type").lower()
    if form is None:
        form = "original" if os.environ.get("FREESOUND_OAUTH_TOKEN") and kind in _DECODED else "preview"
    if form == "original" and kind not in _DECODED:
        raise Avs3dError(
            f"{what}: its original is {kind or 'of no known kind'}, which cannot be decoded; use --format preview"
        )
    offer = Offer(
        id=what, kind="sound", category=category, source="freesound", ref=number,
        url=look(about, "url") or f"https://freesound.org/s/{number}/",
        title=pick(about, "name", what, SERVICE), author=pick(about, "username", what, SERVICE),
        licence=spdx(pick(about, "license", what, SERVICE)),
        file="preview.ogg" if form == "preview" else f"original.{kind}",
    )  # fmt: skip
    return take(offer, session, lambda path: _download(number, about, offer.file, what, path, session))


def fetch_pinned(entry: AssetEntry, target: Path, session: Session) -> Delivered:
    """Fetch the pinned file of an entry to ``target``."""
    return _download(entry.ref, _about(entry.ref, entry.id, session), entry.file, entry.id, target, session, entry)


def _about(number: str, what: str, session: Session) -> dict[str, Any]:
    key = token("FREESOUND_TOKEN", what, SERVICE, PAGE)
    url = f"{_base()}/sounds/{number}/?fields={FIELDS}"
    answer = get_json(Request(url, what, SERVICE, token=f"Token {key}", advice=_ADVICE), session.limits, session.say)
    if not isinstance(answer, dict):
        raise Avs3dError(f"{what}: unexpected answer from Freesound; report it")
    return answer


def _download(
    number: str,
    about: dict[str, Any],
    file: str,
    what: str,
    target: Path,
    session: Session,
    pinned: AssetEntry | None = None,
) -> Delivered:
    if file.startswith("original."):
        key = token(
            "FREESOUND_OAUTH_TOKEN",
            what,
            "Freesound's download of originals",
            "https://freesound.org/docs/api/authentication.html",
        )
        advice = {
            **_ADVICE,
            401: "FREESOUND_OAUTH_TOKEN is not valid or has expired: request a new one (or use --format preview)",
        }
        request = Request(f"{_base()}/sounds/{number}/download/", what, SERVICE, token=f"Bearer {key}", advice=advice)
    else:
        url = pick(about, "previews.preview-hq-ogg", what, SERVICE)
        # Previews are public and on another host, which must not get the token.
        request = Request(url, what, SERVICE, advice=_ADVICE)
    found = download(
        request,
        target,
        session.limits,
        sha256=pinned.sha256 if pinned else None,
        size=pinned.bytes if pinned else None,
        say=session.say,
        progress=session.progress_of(what),
    )
    md5 = about.get("md5")
    if file.startswith("original.") and md5:
        with target.open("rb") as stream:
            digest = hashlib.file_digest(stream, "md5").hexdigest()
        if digest != md5:
            target.unlink()
            raise Avs3dError(
                f"{what}: the received file is not the one that Freesound describes (md5 {digest[:12]}…); try again"
            )
    return found


def _base() -> str:
    return address("AVS3D_FREESOUND_URL", "https://freesound.org/apiv2")
