"""Sounds of ESC-50 (Piczak, "ESC: Dataset for Environmental Sound Classification", 2015), from a clone of it.

Facts (https://github.com/karolpiczak/ESC-50): ``meta/esc50.csv`` has a row per clip (filename
``fold-source-take-target.wav``, category, esc10, src_file: the recording's number at Freesound …); ``audio/`` has clips
of 5 s at 44.1 kHz; according to ``LICENSE`` the whole is CC BY-NC 3.0 and the subset ESC-10 is CC BY 3.0. It also names
the recording of every clip, with its author and its own licence:
``- [1-100032-A.ogg]: clip derived from TITLE (ADDRESS) by AUTHOR [CC0]``.

The lock file gets the stricter of the clip's own licence and that of its subset, and the clip's author.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from generators.library.download import Delivered, download
from generators.library.http import Request
from generators.library.licences import spdx, terms
from generators.library.lock import AssetEntry
from generators.library.session import Offer, Session, address, keep

REPOSITORY = "https://github.com/karolpiczak/ESC-50"
#: ESC-50's class → the benchmark's category; sounds of the other classes get their class as a category of their own.
CATEGORIES = {
    "washing_machine": "washing_machine",
    "vacuum_cleaner": "vacuum_cleaner",
    "toilet_flush": "toilet",
    "clock_tick": "clock",
    "clock_alarm": "clock",
}
_FIELDS = ("filename", "fold", "category", "esc10", "src_file", "take")
_CREDIT = re.compile(r"- \[([\w-]+)\.\w+\]:\s+clip derived from (.*) \((https?://\S+)\) by (.*) \[([^\]]+)\]\s*")


@dataclass(frozen=True)
class Credit:
    """The record of a clip in LICENSE."""

    title: str
    url: str
    author: str
    licence: str


def offers(clone: Path, category: str | None = None) -> tuple[tuple[Offer, Path], ...]:
    """Every clip of the benchmark's categories with its file, sorted by name.

    ``category`` restricts them to one category of the benchmark, or to one class of ESC-50. Clips of a class that is
    none of the benchmark's categories get the name of the class as their category, which manifests must declare.

    Raises:
        UsageError: if ``category`` is neither.
        Avs3dError: if ``clone`` is not a clone of ESC-50.
    """
    rows = list(_rows(clone))
    classes = {row["category"] for row in rows}
    known = {*CATEGORIES, *CATEGORIES.values(), *classes}
    if category is not None and category not in known:
        raise UsageError(f"ESC-50 has no sound of {category!r}; expected one of {', '.join(sorted(known))}")
    table = CATEGORIES if category is None or category not in classes else {category: category} | CATEGORIES
    credits = _credits(clone)
    found = []
    for row in rows:
        ours = table.get(row["category"])
        if ours is None or category not in (None, ours, row["category"]):
            continue
        name = Path(row["filename"]).name
        stem = name.rpartition(".")[0]
        recording = f"{row['fold']}-{row['src_file']}"
        credit = credits.get(f"{recording}-{row['take']}") or credits.get(recording)
        if credit is None:
            raise Avs3dError(f"{clone / 'LICENSE'}: has no entry for {name}; expected the LICENSE of {REPOSITORY}")
        subset = "CC-BY-3.0" if row["esc10"].strip().lower() == "true" else "CC-BY-NC-3.0"
        own = spdx(credit.licence)
        offer = Offer(
            id=f"esc50/{stem}", kind="sound", category=ours, source="esc50", ref=name, url=credit.url,
            title=credit.title, author=credit.author,
            licence=own if terms(own).verdict == "refused" and terms(subset).verdict != "refused" else subset,
            file=name,
        )  # fmt: skip
        found.append((offer, clone / "audio" / name))
    if not found:
        raise Avs3dError(
            f"{clone / 'meta' / 'esc50.csv'}: has no clip of {category or 'the categories of the benchmark'}"
        )
    return tuple(sorted(found, key=lambda pair: pair[0].id))


def take_clip(offer: Offer, path: Path, session: Session) -> AssetEntry:
    """Copy a clip into the store.

    Raises:
        Avs3dError: for a licence that forbids the use, or a file that is missing or not a sound.
    """
    return keep(offer, session, files.read_bytes(path))


def fetch_pinned(entry: AssetEntry, target: Path, session: Session) -> Delivered:
    """Fetch the pinned clip of an entry from the repository to ``target``."""
    base = address("AVS3D_ESC50_URL", "https://raw.githubusercontent.com/karolpiczak/ESC-50/master")
    return download(
        Request(
            f"{base}/audio/{entry.ref}", entry.id, "ESC-50's repository", advice={404: f"look for it at {REPOSITORY}"}
        ),
        target,
        session.limits,
        sha256=entry.sha256,
        size=entry.bytes,
        say=session.say,
        progress=session.progress_of(entry.id),
    )


def _rows(clone: Path) -> Iterator[dict[str, str]]:
    path = clone / "meta" / "esc50.csv"
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            table = csv.DictReader(stream)
            missing = [name for name in _FIELDS if name not in (table.fieldnames or ())]
            if missing:
                raise Avs3dError(f"{path}: has no column {missing[0]!r}; expected the table of {REPOSITORY}")
            for row in table:
                if any(row[name] is None for name in _FIELDS):
                    raise Avs3dError(f"{path}: line {table.line_num} is cut off; update the clone")
                yield row
    except FileNotFoundError:
        raise Avs3dError(f"{path}: missing; expected a clone of {REPOSITORY}") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise Avs3dError(f"{path}: cannot be read ({error}); expected the table of {REPOSITORY}") from None


def _credits(clone: Path) -> dict[str, Credit]:
    """Map of clip (``fold-source-take``) to credit.

    The recording (``fold-source``) is a key, too, because LICENSE gives some takes other letters.
    """
    try:
        text = (clone / "LICENSE").read_text(encoding="utf-8", errors="replace")
    except OSError:
        raise Avs3dError(f"{clone / 'LICENSE'}: missing; expected a clone of {REPOSITORY}") from None
    table = {}
    for line in text.splitlines():
        found = _CREDIT.fullmatch(line)
        if found:
            credit = Credit(found[2].strip(), found[3], found[4].strip(), found[5])
            table[found[1]] = table[found[1].rpartition("-")[0]] = credit
    return table
