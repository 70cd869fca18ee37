"""Objects from Sketchfab, by uid.

Facts (https://sketchfab.com/developers/data-api/v3 and /developers/download-api/downloading-models): ``GET
/v3/models/{uid}`` describes a model (name, user.displayName, license.slug, viewerUrl, isDownloadable); ``GET
/v3/models/{uid}/download`` with ``Authorization: Token …`` gives addresses per format, ``{"gltf": {"url", "size",
"expires"}, "glb": …}``. They are signed, valid for some minutes, and on another host, which must not get the token.
``glb`` is one file, ``gltf`` a zip of scene.gltf, scene.bin and textures/.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from avs3d_bench.errors import Avs3dError
from generators.library.download import Delivered, download
from generators.library.http import HttpError, Request, get_json
from generators.library.licences import from_sketchfab
from generators.library.lock import AssetEntry
from generators.library.session import Offer, Session, Stance, address, admit, look, pick, reference, take, token

SERVICE = "Sketchfab"
PAGE = "https://sketchfab.com/settings/password"
#: Format → the file's name in the store, best first.
FORMATS = {"glb": "model.glb", "gltf": "model.zip"}
_ADVICE = {
    401: f"SKETCHFAB_TOKEN is not valid: copy it from {PAGE}",
    403: "your account may not download this model: see its page, or choose another",
    404: "check the uid: it is at the end of the model's address",
}
#: Statuses with which the storage answers an address whose signature has expired.
_EXPIRED = (400, 401, 403, 410)


def fetch(ref: str, category: str, stance: Stance, session: Session, form: str | None = None) -> AssetEntry:
    """Describe and fetch a model.

    Args:
        ref: its uid, or its page's address.
        category: its category.
        stance: orientation, height and mount, if they differ from glTF's convention (Y up, front +Z).
        session: options of this call of `avs3d assets`.
        form: ``glb`` or ``gltf``; default: the one that is offered.

    Raises:
        Avs3dError: one line: token, licence, not downloadable, any network error, an unusable mesh.
    """
    uid = reference(ref, "[0-9a-f]{32}", "uid of Sketchfab", "7f2c…: 32 digits and letters a to f")
    what = f"sketchfab/{uid}"
    key = token("SKETCHFAB_TOKEN", what, SERVICE, PAGE)
    about = _ask(f"/v3/models/{uid}", what, key, session)
    if not about.get("isDownloadable"):
        raise Avs3dError(f"{what}: its author does not offer it for download on Sketchfab; choose another model")
    offer = Offer(
        id=what, kind="object", category=category, source="sketchfab", ref=uid,
        url=look(about, "viewerUrl") or f"https://sketchfab.com/3d-models/{uid}",
        title=pick(about, "name", what, SERVICE),
        author=look(about, "user.displayName") or pick(about, "user.username", what, SERVICE),
        licence=from_sketchfab(look(about, "license.slug"), look(about, "license.label") or "unknown"),
        file=FORMATS[form or "glb"],
    )  # fmt: skip
    if form is None:
        admit(offer, session)  # before a download counts against the account's quota
        offered = _ask(f"/v3/models/{uid}/download", what, key, session)
        form = next((name for name in FORMATS if isinstance(offered.get(name), dict)), None)
        if form is None:
            raise Avs3dError(
                f"{what}: Sketchfab offers it as {', '.join(sorted(offered)) or 'nothing'}; expected glb or gltf"
            )
        offer = replace(offer, file=FORMATS[form])
    chosen = form
    return take(offer, session, lambda path: _download(uid, chosen, path, session), stance)


def fetch_pinned(entry: AssetEntry, target: Path, session: Session) -> Delivered:
    """Fetch the pinned file of an entry to ``target``."""
    form = next((name for name, file in FORMATS.items() if file == entry.file), "glb")
    return _download(entry.ref, form, target, session, entry)


def _download(uid: str, form: str, target: Path, session: Session, pinned: AssetEntry | None = None) -> Delivered:
    what = f"sketchfab/{uid}"
    key = token("SKETCHFAB_TOKEN", what, SERVICE, PAGE)
    for last in (False, True):
        offered = _ask(f"/v3/models/{uid}/download", what, key, session)
        if not isinstance(offered.get(form), dict):
            raise Avs3dError(f"{what}: Sketchfab does not offer it as {form}; try another --format")
        request = Request(
            pick(offered, f"{form}.url", what, SERVICE), what, "Sketchfab's storage",
            advice=dict.fromkeys(_EXPIRED, "its address has expired already: check this machine's clock, try again"),
        )  # fmt: skip
        try:
            return download(
                request,
                target,
                session.limits,
                sha256=pinned.sha256 if pinned else None,
                size=pinned.bytes if pinned else None,
                say=session.say,
                progress=session.progress_of(what),
            )
        except HttpError as error:
            if last or error.status not in _EXPIRED:
                raise
            session.say(f"{what}: the signed address has expired, requesting a new one")
    raise AssertionError("the second try returns or raises")


def _ask(path: str, what: str, key: str, session: Session) -> dict[str, Any]:
    base = address("AVS3D_SKETCHFAB_URL", "https://api.sketchfab.com")
    request = Request(base + path, what, SERVICE, token=f"Token {key}", advice=_ADVICE)
    answer = get_json(request, session.limits, session.say)
    if not isinstance(answer, dict):
        raise Avs3dError(f"{what}: unexpected answer from Sketchfab; report it")
    return answer
