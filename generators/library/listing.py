"""HTML listing of a lock file: every asset with a picture or a waveform, its licence, and the findings.

The page is one file and needs no network; the recordings are beside it, because players read files.
"""

from __future__ import annotations

import base64
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from avs3d_bench.commands.outputs import Signature, check_replaceable
from avs3d_bench.contract.taxonomy import CATEGORIES, DISTRACTORS, OFF_SCREEN_CATEGORIES
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from avs3d_bench.text.templates import template_environment
from generators.library.licences import terms
from generators.library.lock import AssetEntry
from generators.library.store import Store

if TYPE_CHECKING:
    from jinja2 import Environment

#: Version of the thumbnails; increase it when the same GLB gives another picture.
_PICTURES = 1
#: Number of bars of a waveform.
_BARS = 120


@dataclass(frozen=True)
class AssetCard:
    """The contents of the page about one asset.

    Attributes:
        entry: its record in the lock file.
        verdict: of its licence: free, share-alike or refused.
        reason: in words, for all verdicts except free.
        findings: severity and text of each finding of its mesh cleaning.
        problem: the reason why it cannot be shown or played; empty if it can.
        picture: data URL of its thumbnail, if it is an object.
        size: width, height, depth in metres, if it is an object.
        faces: number of faces of the clean mesh.
        waveform: SVG path of its peaks, x from 0 to `_BARS` and y from −1 to 1, if it is a sound.
        seconds: its length, if it is a sound.
        sound: name of its file beside the page.
    """

    entry: AssetEntry
    verdict: str
    reason: str
    findings: tuple[tuple[str, str], ...] = ()
    problem: str = ""
    picture: str = ""
    size: tuple[float, float, float] | None = None
    faces: int = 0
    waveform: str = ""
    seconds: float = 0.0
    sound: str = ""


#: What the page says about itself.
_PAGE = Signature(start=b"<!doctype html>", marks=("<title>Assets · avs3d-bench</title>".encode(),))


def write_listing(entries: Sequence[AssetEntry], store: Store, folder: Path) -> Path:
    """Write ``folder``/index.html and the recordings it plays; the same assets give the same bytes.

    A missing or broken asset is listed with its problem.

    Args:
        entries: the lock file's entries.
        store: the store with their files.
        folder: the folder to write to; it is made if it does not exist.

    Returns:
        The page.

    Raises:
        UsageError: if the folder has another page or another file of a recording's name.
        Avs3dError: if the folder cannot be written.
    """
    if folder.exists() and not folder.is_dir():
        raise Avs3dError(f"{folder}: is a file; expected a folder for the listing")
    page = folder / "index.html"
    check_replaceable(page, (_PAGE,))
    cards = [_card(entry, store, folder) for entry in sorted(entries, key=lambda entry: entry.id)]
    own = sorted({card.entry.category for card in cards})
    order = dict.fromkeys((*CATEGORIES, *DISTRACTORS, *OFF_SCREEN_CATEGORIES, *own))
    sections = [
        (category or "scan", [card for card in cards if card.entry.category == category])
        for category in order
        if any(card.entry.category == category for card in cards)
    ]
    html = _environment().get_template("assets.html.j2").render(sections=sections, cards=cards, bars=_BARS)
    files.write_bytes(page, html.encode())
    return page


def _card(entry: AssetEntry, store: Store, folder: Path) -> AssetCard:
    licence = terms(entry.licence)
    problem = store.problem(entry)
    if problem:
        return AssetCard(entry, licence.verdict, licence.reason, problem=problem)
    try:
        if entry.kind == "sound":
            return _sound_card(entry, store, folder)
        if entry.kind == "scan":
            return _scan_card(entry, store)
        return _object_card(entry, store)
    except UsageError:
        raise
    except Avs3dError as error:
        return AssetCard(entry, licence.verdict, licence.reason, problem=str(error))


def _object_card(entry: AssetEntry, store: Store) -> AssetCard:
    from generators.assets.meshfile import load_mesh
    from generators.library.thumbnails import thumbnail

    mesh_file = store.mesh(entry)
    mesh = load_mesh(mesh_file)
    picture = mesh_file.with_name(f"{mesh_file.stem}-view{_PICTURES}.png")
    if not picture.is_file():
        files.write_bytes(picture, thumbnail(mesh_file))
    x, y, z = (float(v) for v in np.ptp(mesh.bounds.astype(np.float64), axis=0))
    licence = terms(entry.licence)
    return AssetCard(
        entry,
        licence.verdict,
        licence.reason,
        findings=tuple(_split(line) for line in store.findings(entry)),
        picture="data:image/png;base64," + base64.b64encode(picture.read_bytes()).decode(),
        size=(x, y, z),
        faces=len(mesh.positions),
    )


def _scan_card(entry: AssetEntry, store: Store) -> AssetCard:
    from generators.assets.meshfile import load_mesh

    mesh = load_mesh(store.path(entry), twin="surface", max_acoustic_faces=sys.maxsize, textures=False)
    x, y, z = (float(v) for v in np.ptp(mesh.bounds.astype(np.float64), axis=0))
    licence = terms(entry.licence)
    return AssetCard(entry, licence.verdict, licence.reason, size=(x, y, z), faces=len(mesh.positions))


def _sound_card(entry: AssetEntry, store: Store, folder: Path) -> AssetCard:
    import soundfile

    source = store.path(entry)
    try:
        samples, rate = soundfile.read(source, dtype="float32", always_2d=True)
    except (OSError, RuntimeError) as error:
        raise Avs3dError(f"{entry.id}: cannot be decoded ({error}); fetch it again") from error
    name = f"{entry.id.replace('/', '_')}-{entry.sha256[:8]}{source.suffix.lower()}"
    target = folder / "sounds" / name
    if not (target.is_file() and target.stat().st_size == entry.bytes):
        check_replaceable(target, ())
        files.link_or_copy(source, target)
    licence = terms(entry.licence)
    return AssetCard(
        entry,
        licence.verdict,
        licence.reason,
        waveform=_waveform(samples),
        seconds=len(samples) / rate,
        sound=f"sounds/{name}",
    )


def _waveform(samples: np.ndarray) -> str:
    """SVG path of the peaks of a recording, scaled to its loudest sample."""
    if not len(samples):
        return ""
    peaks = np.abs(np.nan_to_num(samples)).max(axis=1)
    edges = np.linspace(0, len(peaks), _BARS + 1).astype(int)[:-1]
    heights = np.maximum.reduceat(peaks, np.minimum(edges, len(peaks) - 1))
    heights = heights / max(float(heights.max()), 1e-9)
    return "".join(f"M{k + 0.5:g} {-h:.2f}V{h:.2f}" for k, h in enumerate(np.maximum(heights, 0.02)))


def _split(line: str) -> tuple[str, str]:
    """Severity and text of a finding's line."""
    severity, _, text = line.partition(": ")
    return (severity, text) if severity in ("note", "mended", "warning") and text else ("note", line)


def _address(url: str) -> str:
    """An http or https address, which is safe as a link; empty for any other scheme."""
    return url if url.startswith(("https://", "http://")) else ""


def _environment() -> Environment:
    environment = template_environment("generators.library")
    environment.filters["address"] = _address
    environment.filters["words"] = lambda name: str(name).replace("_", " ")
    return environment
