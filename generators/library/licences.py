"""Licences: names in one spelling (SPDX if there is one), and the decision to accept or refuse an asset.

A generated benchmark publishes pictures, sounds and meshes in which the assets can be recognised, i.e. adaptations, and
it may be used for every purpose that its own licence permits. So an asset is accepted if it may be adapted and shared
for any purpose:

- public domain and attribution licences: accepted; dataset.json attributes them;
- share-alike licences (CC BY-SA, Free Art, GPL): accepted, with a note that the published data must keep their terms;
- non-commercial, no-derivatives, sampling, editorial and store licences, and all unknown ones: refused, unless the
  user, who may have a permission, allows them by name.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Literal

from avs3d_bench.errors import Avs3dError

Verdict = Literal["free", "share-alike", "refused"]

#: BBC Sound Effects: https://sound-effects.bbcrewind.co.uk/licensing
REMARC = "LicenseRef-RemArc"
PUBLIC_DOMAIN = "LicenseRef-PublicDomain"
SAMPLING_PLUS = "CC-Sampling-Plus-1.0"
#: https://pixabay.com/service/license-summary/
PIXABAY = "LicenseRef-Pixabay"

_FREE = {
    "CC0-1.0", "CC-PDDC", PUBLIC_DOMAIN, "PDDL-1.0", "Unlicense", "0BSD", "MIT", "ISC", "Zlib", "Apache-2.0",
    "BSD-2-Clause", "BSD-3-Clause", "ODC-By-1.0", "OGL-UK-3.0",
}  # fmt: skip
_SHARE_ALIKE = re.compile(r"LAL-1\.[23]|(A|L)?GPL-[123]\.[01](-only|-or-later)?|ODbL-1\.0|MPL-[12]\.[01]|OFL-1\.1")
_CC = re.compile(r"CC-BY(?P<nc>-NC)?(?P<nd>-ND)?(?P<sa>-SA)?(-\d\.\d)?(-[A-Z]{2,3})?")
_REASONS = {
    REMARC: "is for personal, educational and research use only",
    SAMPLING_PLUS: "forbids sharing the whole work commercially",
    PIXABAY: "forbids sharing the sound or model on its own",
    "LicenseRef-Sketchfab-Standard": "is Sketchfab's store licence, which forbids sharing the model",
    "LicenseRef-Sketchfab-Free-Standard": "is Sketchfab's store licence, which forbids sharing the model",
    "LicenseRef-Sketchfab-Editorial": "allows editorial use only",
}
#: Sketchfab's slugs (https://sketchfab.com/developers/data-api/v3, `license.slug`); its Creative Commons are 4.0.
_SKETCHFAB = {
    "cc0": "CC0-1.0",
    "by": "CC-BY-4.0",
    "by-sa": "CC-BY-SA-4.0",
    "by-nd": "CC-BY-ND-4.0",
    "by-nc": "CC-BY-NC-4.0",
    "by-nc-sa": "CC-BY-NC-SA-4.0",
    "by-nc-nd": "CC-BY-NC-ND-4.0",
    "st": "LicenseRef-Sketchfab-Standard",
    "free-st": "LicenseRef-Sketchfab-Free-Standard",
    "ed": "LicenseRef-Sketchfab-Editorial",
}
_CC_ADDRESS = re.compile(
    r"(?:https?://)?(?:www\.)?creativecommons\.org/(?:licenses|publicdomain)/([a-z+-]+)(?:/(\d\.\d))?[^\s()<>\[\]]*",
    re.I,
)
#: Patterns of the words in a Creative Commons licence's name, and their meanings.
_WORDS = tuple(
    (mark, re.compile(rf"(?:{words})(?![a-z0-9.])"))
    for mark, words in (
        ("0", r"cc[ -]?0|cc[ -]?zero|zero|creative commons 0"),
        ("PD", r"public[ -]domain"),
        ("BY", r"cc[ -]?by|by|attribution"),
        ("NC", r"nc|non[ -]?commercial"),
        ("ND", r"nd|no[ -]?deriv(?:s|atives?|ative works)?"),
        ("SA", r"sa|share[ -]?alike"),
        ("version", r"v?(\d\.\d)"),
        ("", r"creative commons|cc|(?:public )?licen[cs]e|the|in the|version|international|unported|generic|universal"),
        ("", r"deed|dedication|mark|united states|us"),
    )
)


@dataclass(frozen=True)
class LicenceTerms:
    """Assessment of a licence: its name, the verdict, and for all verdicts except ``free`` the reason in words."""

    name: str
    verdict: Verdict
    reason: str = ""


def terms(name: str) -> LicenceTerms:
    """The terms of a licence; the strictest of ``A AND B``, the mildest of ``A OR B`` (SPDX, without brackets)."""
    rank: tuple[Verdict, ...] = ("free", "share-alike", "refused")

    def strictness(one: LicenceTerms) -> int:
        return rank.index(one.verdict)

    if " OR " in name:
        best = min((terms(part) for part in name.split(" OR ")), key=strictness)
        return LicenceTerms(name, best.verdict, best.reason)
    if " AND " in name:
        worst = max((terms(part) for part in name.split(" AND ")), key=strictness)
        return LicenceTerms(name, worst.verdict, worst.reason)
    name = name.strip()
    if name in _FREE:
        return LicenceTerms(name, "free")
    if _SHARE_ALIKE.fullmatch(name):
        return LicenceTerms(name, "share-alike", "asks that what is made from it is shared under the same terms")
    found = _CC.fullmatch(name)
    if found:
        if found["nc"]:
            return LicenceTerms(name, "refused", "forbids commercial use")
        if found["nd"]:
            return LicenceTerms(name, "refused", "forbids adaptations, and a rendered or mixed asset is one")
        if found["sa"]:
            return LicenceTerms(name, "share-alike", "asks that what is made from it is shared under the same terms")
        return LicenceTerms(name, "free")
    return LicenceTerms(name, "refused", _REASONS.get(name, "is not known to allow adaptation and sharing"))


def check_licence(asset: str, name: str, allowed: Collection[str] = ()) -> str:
    """Refuse an asset whose licence forbids the use, unless it is ``allowed`` by name.

    Returns:
        A note for the user (share-alike, or allowed by name), empty for a free licence.

    Raises:
        Avs3dError: naming the asset, its licence, what is wrong with it and how to allow it.
    """
    found = terms(spdx(name))
    if found.verdict == "free":
        return ""
    if found.verdict == "share-alike":
        return f"{asset}: {name} {found.reason}"
    if name.lower() in {spdx(one).lower() for one in allowed} | {one.lower() for one in allowed}:
        return f"{asset}: {name} {found.reason}; taken because it was allowed by name"
    raise Avs3dError(
        f"{asset}: refused, its licence {name} {found.reason}; if your use is permitted, add --allow-licence '{name}'"
    )


def conditions(assets: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Notes for a dataset: one line per licence that is not free, sorted by the licence's name.

    Args:
        assets: pairs of an asset and the name of its licence. The note names the first asset under the licence, in
            alphabetical order, and the number of others.

    Examples:
        >>> conditions([("a bell", "CC0-1.0"), ("a hall", "CC-BY-NC-4.0"), ("a room", "CC-BY-NC-4.0")])
        ('a hall and 1 more: licence CC-BY-NC-4.0 forbids commercial use',)
    """
    under: dict[str, list[str]] = {}
    for asset, name in sorted(set(assets)):
        under.setdefault(name, []).append(asset)
    notes = []
    for name, (first, *others) in sorted(under.items()):
        found = terms(spdx(name))
        if found.verdict != "free":
            more = f" and {len(others)} more" if others else ""
            notes.append(f"{first}{more}: licence {name} {found.reason}")
    return tuple(notes)


def from_sketchfab(slug: str, label: str) -> str:
    """SPDX name (or ``LicenseRef-…``) of Sketchfab's ``license.slug``; an unknown one keeps its label."""
    return _SKETCHFAB.get(slug.lower(), f"LicenseRef-Sketchfab-{re.sub(r'[^A-Za-z0-9.]+', '-', label or slug)}")


def spdx(text: str) -> str:
    """Convert a licence's name, as people and web services write it, to SPDX's spelling; unknown names are unchanged.

    Understands Creative Commons' addresses (``https://creativecommons.org/licenses/by-nc/3.0/``), short names
    (``CC BY-SA 4.0``) and long ones (``Creative Commons Attribution-ShareAlike``). A missing version is not guessed:
    ``CC-BY``. A text with more than a licence's name (``attribution, no commercial use``) stays unchanged and so counts
    as an unknown licence.
    """
    plain = " ".join(str(text).split())
    expression = re.split(r" (AND|OR) ", plain)
    if len(expression) > 1:
        return " ".join(part if part in ("AND", "OR") else spdx(part) for part in expression)
    if _CC.fullmatch(plain) or plain in _FREE or _SHARE_ALIKE.fullmatch(plain):
        return plain
    for known in (*_FREE, *_REASONS):
        if plain.lower() == known.lower():
            return known
    address = _CC_ADDRESS.search(plain)
    if address:
        name = _at_address(address[1].lower(), address[2])
        rest = f"{plain[: address.start()]} {plain[address.end() :]}".strip(" ()<>[].,;:\"'")
        said = _spoken(rest) if rest else name
        agreed = said is not None and re.sub(r"-\d.*", "", said) == re.sub(r"-\d.*", "", name)
        return name if agreed else plain
    return _spoken(plain) or plain


def _at_address(kind: str, version: str | None) -> str:
    """The name of a licence at creativecommons.org/licenses/``kind``/``version``."""
    named = {"zero": "CC0-1.0", "mark": PUBLIC_DOMAIN, "sampling+": SAMPLING_PLUS}
    return named.get(kind) or f"CC-{kind.upper()}" + (f"-{version}" if version else "")


def _spoken(text: str) -> str | None:
    """The licence that a text names; empty if the text has any further words, which may be a condition."""
    lower = re.sub("[\u2010-\u2015\u2212_]", "-", text.lower())
    if re.search(r"sampling[ -]?(\+|plus)", lower):
        return SAMPLING_PLUS
    if "remarc" in lower:
        return REMARC
    if re.fullmatch(r"(the )?pixabay( content)? licen[cs]e", lower):
        return PIXABAY
    art = re.fullmatch(r"(?:the )?(?:free art(?: licen[cs]e)?|(?:licen[cs]e )?art libre)(?: v?(\d\.\d))?", lower)
    if art:
        return f"LAL-{art[1] or '1.3'}"
    marks: set[str] = set()
    versions: set[str] = set()
    while lower := lower.lstrip(" -,()"):
        mark, found = next(((mark, hit) for mark, word in _WORDS if (hit := word.match(lower))), ("", None))
        if found is None:
            return None
        if mark == "version":
            versions.add(found[1])
        else:
            marks.add(mark)
        lower = lower[found.end() :]
    marks.discard("")
    if len(versions) > 1:
        return None
    if "BY" in marks and marks <= {"BY", "NC", "ND", "SA"}:
        return "-".join(["CC-BY", *(mark for mark in ("NC", "ND", "SA") if mark in marks), *versions])
    if "0" in marks and marks <= {"0", "PD"}:
        return "CC0-1.0"
    return PUBLIC_DOMAIN if marks == {"PD"} else None
