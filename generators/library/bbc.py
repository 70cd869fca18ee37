"""Sounds of the BBC Sound Effects archive, by id.

Facts (https://sound-effects.bbcrewind.co.uk): ``POST /api/sfx/search`` with ``{"criteria": {"from", "size", "query"}}``
answers ``results`` with id, description and duration (ms); files lie at ``/wav/{id}.wav`` and ``/mp3/{id}.mp3`` of the
media host. No token is needed. The licence is RemArc (personal, educational and research use), so sounds are accepted
only with ``--allow-licence LicenseRef-RemArc``.
"""

from __future__ import annotations

from pathlib import Path

from avs3d_bench.errors import Avs3dError
from generators.library.download import Delivered, download
from generators.library.http import Request, get_json
from generators.library.licences import REMARC
from generators.library.lock import AssetEntry
from generators.library.session import Offer, Session, address, look, reference, take

SERVICE = "BBC Sound Effects"
FORMATS = ("wav", "mp3")
_ADVICE = {
    403: "its storage does not serve this file here; try --format mp3",
    404: "check the id (07005210, …); not every sound is available as WAV: try --format mp3",
}


def fetch(ref: str, category: str, session: Session, form: str | None = None) -> AssetEntry:
    """Describe and fetch a sound.

    Args:
        ref: its id, or its page's address.
        category: its category.
        session: options of this call of `avs3d assets`.
        form: ``wav`` (the default) or ``mp3``.

    Raises:
        Avs3dError: one line: licence, unknown id, any network error, a file that is not a sound.
    """
    number = reference(ref, r"[A-Za-z]*\d{4,}[A-Za-z0-9]*", "id of BBC Sound Effects", "07005210")
    what, form = f"bbc/{number}", form or "wav"
    offer = Offer(
        id=what, kind="sound", category=category, source="bbc", ref=number,
        url=f"https://sound-effects.bbcrewind.co.uk/search?q={number}",
        title=_title(number, what, session), author="BBC Sound Effects", licence=REMARC, file=f"sound.{form}",
    )  # fmt: skip
    return take(offer, session, lambda path: _download(number, what, form, path, session))


def fetch_pinned(entry: AssetEntry, target: Path, session: Session) -> Delivered:
    """Fetch the pinned file of an entry to ``target``."""
    return _download(entry.ref, entry.id, entry.file.rpartition(".")[2], target, session, entry)


def _title(number: str, what: str, session: Session) -> str:
    url = address("AVS3D_BBC_API_URL", "https://sound-effects-api.bbcrewind.co.uk") + "/api/sfx/search"
    body = {"criteria": {"from": 0, "size": 20, "query": number}}
    answer = get_json(Request(url, what, SERVICE, body=body, advice=_ADVICE), session.limits, session.say)
    results = answer.get("results") if isinstance(answer, dict) else None
    if not isinstance(results, list):
        raise Avs3dError(f"{what}: {SERVICE} answered without 'results'; its interface may have changed: report it")
    for found in results:
        if isinstance(found, dict) and str(found.get("id")) == number:
            return look(found, "description") or number
    raise Avs3dError(f"{what}: {SERVICE} has no sound of that id; search at https://sound-effects.bbcrewind.co.uk")


def _download(
    number: str, what: str, form: str, target: Path, session: Session, pinned: AssetEntry | None = None
) -> Delivered:
    base = address("AVS3D_BBC_MEDIA_URL", "https://sound-effects-media.bbcrewind.co.uk")
    return download(
        Request(f"{base}/{form}/{number}.{form}", what, SERVICE, advice=_ADVICE),
        target,
        session.limits,
        sha256=pinned.sha256 if pinned else None,
        size=pinned.bytes if pinned else None,
        say=session.say,
        progress=session.progress_of(what),
    )
