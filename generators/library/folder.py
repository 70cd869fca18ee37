"""Objects and sounds from a folder of the user's own: GLB, glTF, OBJ; WAV, FLAC, OGG, MP3, AIFF.

A mesh of several files (an OBJ with its MTL and textures, a glTF with its buffers) is stored as one archive whose bytes
depend only on those files, so that one hash pins them all.
"""

from __future__ import annotations

import csv
import json
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast, get_args
from urllib.parse import unquote

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from generators.core.limits import SoundSplit
from generators.library.archive import bundle
from generators.library.licences import spdx
from generators.library.lock import AssetEntry, Kind, slug
from generators.library.session import Offer, Session, Stance, keep
from generators.library.store import MESH_SUFFIXES, SOUND_SUFFIXES


def candidates(path: Path, kind: Kind | None = None) -> tuple[tuple[Kind, Path], ...]:
    """Every mesh and sound at or below ``path``, sorted by name, without hidden files.

    Raises:
        UsageError: if there is no such file or folder, or it has no file of a known type.
    """
    if not path.exists():
        raise UsageError(f"{path}: no such folder or file")
    found: list[tuple[Kind, Path]] = []
    for file in [path] if path.is_file() else sorted(path.rglob("*")):
        if not file.is_file() or any(step.startswith(".") for step in file.relative_to(path).parts):
            continue
        suffix = file.suffix.lower()
        if suffix in MESH_SUFFIXES and kind in (None, "object"):
            found.append(("object", file))
        elif suffix in SOUND_SUFFIXES and kind in (None, "sound"):
            found.append(("sound", file))
    if not found:
        what = {"object": MESH_SUFFIXES, "sound": SOUND_SUFFIXES}.get(kind or "", (*MESH_SUFFIXES, *SOUND_SUFFIXES))
        raise UsageError(f"{path}: nothing to import; expected {', '.join(what)}")
    return tuple(found)


def asset_ids(root: Path, paths: Iterable[Path], name: str | None = None) -> dict[Path, str]:
    """A unique id for each file of an import.

    For example ``folder/models/clock``. If several files would get the same id, each gets its suffix (``clock-wav``);
    if they are still equal (names with letters that are not allowed in ids), each gets digits of its name's hash.
    """
    base = root if root.is_dir() else root.parent
    paths = tuple(paths)

    def named(end: Callable[[Path], str]) -> dict[Path, str]:
        table = {}
        for path in paths:
            relative = path.relative_to(base)
            steps = [slug(name or base.resolve().name), *(slug(step) for step in relative.with_suffix("").parts)]
            table[path] = "/".join(["folder", *steps]) + end(relative)
        return table

    def digits(relative: Path) -> str:
        return "-" + files.sha256_bytes(os.fsencode(relative))[:8]

    plain, typed, hashed = named(lambda _: ""), named(lambda path: f"-{slug(path.suffix)}"), named(digits)
    # Ids are folders of the store, and not all file systems distinguish capitals.
    uses = Counter(one.lower() for one in (*plain.values(), *typed.values()))
    return {
        path: next((table[path] for table in (plain, typed) if uses[table[path].lower()] == 1), hashed[path])
        for path in paths
    }


def nearby(folder: Path, entries: Sequence[AssetEntry]) -> dict[str, Path]:
    """sha256 → file below ``folder`` that is the pinned one of an entry, under whatever name.

    Raises:
        UsageError: if there is no such folder.
    """
    if not folder.is_dir():
        raise UsageError(f"--from {folder}: no such folder; name one that holds pinned files")
    wanted = {entry.sha256 for entry in entries}
    sizes = {entry.bytes for entry in entries}
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.stat().st_size in sizes and (digest := files.sha256_file(path)) in wanted:
            found[digest] = path
    return found


@dataclass(frozen=True)
class Told:
    """The user's description of files whose source says nothing about them.

    Attributes:
        category: their category.
        licence: in SPDX's spelling.
        author: their author.
        url: address of their source.
        title: of a single file; empty: its name.
        trim, split: of a recording, see `AssetEntry`.
    """

    category: str
    licence: str = ""
    author: str = ""
    url: str = ""
    title: str = ""
    trim: tuple[float, float] | None = None
    split: SoundSplit | None = None


#: Columns of an index of a folder.
NEEDED, OPTIONAL = ("file", "category", "licence", "author"), ("title", "url", "split", "begin", "end")


def read_index(index: Path, folder: Path) -> dict[Path, Told]:
    """What a table (CSV) says about the files of a folder, one row each.

    Args:
        index: the table; its first row names the columns: `NEEDED`, and any of `OPTIONAL`; others are ignored.
        folder: the names in column ``file`` are relative to it.

    Raises:
        Avs3dError: one line that names the row and the column.
    """
    told: dict[Path, Told] = {}
    try:
        with index.open(newline="", encoding="utf-8-sig") as stream:  # tables of Excel begin with a mark
            table = csv.DictReader(stream)
            missing = [name for name in NEEDED if name not in (table.fieldnames or ())]
            if missing:
                raise Avs3dError(
                    f"{index}: has no column {missing[0]!r}; expected {', '.join(NEEDED)}, and if wanted "
                    f"{', '.join(OPTIONAL)}"
                )
            for row in table:
                path = folder / (row["file"] or "")
                told[path] = _told(row, path, f"{index}: line {table.line_num}")
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise Avs3dError(f"{index}: cannot be read as a table ({error}); expected CSV in UTF-8") from None
    return told


def _told(row: Mapping[str, str | None], path: Path, where: str) -> Told:
    """A row of an index."""
    said = {name: (row.get(name) or "").strip() for name in (*NEEDED, *OPTIONAL)}
    empty = next((name for name in NEEDED if not said[name]), None)
    if empty is not None:
        raise Avs3dError(f"{where}: column {empty!r} is empty; every file needs {', '.join(NEEDED)}")
    if not path.is_file():
        raise Avs3dError(f"{where}: no file {said['file']!r} in {path.parent}")
    if said["split"] not in ("", *get_args(SoundSplit)):
        raise Avs3dError(f"{where}: split {said['split']!r}; expected {', '.join(get_args(SoundSplit))}, or nothing")
    trim = None
    if said["begin"] or said["end"]:
        try:
            trim = float(said["begin"] or 0), float(said["end"])
        except ValueError:
            raise Avs3dError(f"{where}: begin {said['begin']!r}, end {said['end']!r}; expected seconds") from None
    split = cast("SoundSplit | None", said["split"] or None)
    credit = spdx(said["licence"]), said["author"], said["url"], said["title"]
    return Told(said["category"], *credit, trim=trim, split=split)


def take_file(
    root: Path, path: Path, kind: Kind, session: Session, *, asset: str, told: Told, stance: Stance
) -> AssetEntry:
    """Copy a mesh or a sound into the store.

    Args:
        root: the folder that is imported (or the file itself).
        path: a file at or below it.
        kind: see `candidates`.
        session: options of this call of `avs3d assets`.
        asset: its id, from `asset_ids`.
        told: category, licence, author, source.
        stance: orientation, height and mount of an object.

    Raises:
        Avs3dError: for a licence that forbids the use, or a file that cannot be used.
    """
    base = root if root.is_dir() else root.parent
    relative = path.relative_to(base).as_posix()
    if not relative.isprintable():
        raise Avs3dError(f"{asset}: the name {relative!a} is not valid UTF-8; rename the file")
    size, most = path.stat().st_size, session.limits.max_bytes
    if size > most:
        raise Avs3dError(f"{asset}: {relative} has {size / 1e6:.0f} MB, expected {most / 1e6:.0f} at most; cut it")
    file, data = f"{'model' if kind == 'object' else 'sound'}{path.suffix.lower()}", files.read_bytes(path)
    members = mesh_files(path, base) if kind == "object" else {}
    if len(members) > 1:
        file, data = "model.zip", bundle(members)
    offer = Offer(
        id=asset, kind=kind, category=told.category, source="folder", ref=relative,
        url=told.url, title=told.title or path.stem, author=told.author, licence=told.licence, file=file,
        trim=told.trim, split=told.split,
    )  # fmt: skip
    return keep(offer, session, data, stance)


def mesh_files(path: Path, root: Path) -> dict[str, bytes]:
    """A mesh and the files inside ``root`` that it refers to: name relative to their common folder → bytes.

    References to missing files, or out of ``root``, are left out; the cleaning reports them.
    """
    inside = root.resolve()
    wanted = {path.resolve()}
    for reference in _references(path, path.suffix.lower()):
        target = _inside(path.parent, reference, inside)
        if target is not None:
            wanted.add(target)
            if target.suffix.lower() == ".mtl":
                textures = (_inside(target.parent, name, inside) for name in _references(target, ".mtl"))
                wanted |= {file for file in textures if file is not None}
    common = path.resolve().parent
    while not all(file.is_relative_to(common) for file in wanted):
        common = common.parent
    return {file.relative_to(common).as_posix(): files.read_bytes(file) for file in sorted(wanted)}


def _inside(folder: Path, reference: str, root: Path) -> Path | None:
    """The file below ``root`` to which a reference from ``folder`` points, if there is one."""
    plain = reference.strip().strip('"').replace("\\", "/")
    try:
        plain.encode()
        for wanted in (plain, plain.rsplit("/", 1)[-1]):  # some programs write absolute paths of their own machine
            target = (folder / wanted).resolve()
            if target.is_relative_to(root) and not target.is_file() and target.parent.is_dir():
                same = [path for path in sorted(target.parent.iterdir()) if path.name.lower() == target.name.lower()]
                target = same[0].resolve() if same else target
            if target.is_relative_to(root) and target.is_file():
                return target
    except (OSError, ValueError, RuntimeError):  # a name that is too long, a zero byte, circular links
        return None
    return None


def _references(path: Path, suffix: str) -> Iterator[str]:
    """Files that an OBJ, MTL, glTF or GLB names."""
    data = files.read_bytes(path)
    if suffix == ".obj":
        for found in re.finditer(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t]*\r?$", data, re.M):
            yield found[1].decode("utf-8", "replace")
    elif suffix == ".mtl":
        for found in re.finditer(rb"^[ \t]*(?:map_\w+|bump|disp|norm)[ \t]+(.+?)[ \t]*\r?$", data, re.M | re.I):
            value = found[1].decode("utf-8", "replace").replace("\\", "/")
            yield value.split()[-1] if value.startswith("-") else value
    elif suffix == ".dae":
        for found in re.finditer(rb"<init_from>\s*(?:file://)?([^<>]+?)\s*</init_from>", data):
            yield unquote(found[1].decode("utf-8", "replace"))
    elif suffix == ".ply":
        for found in re.finditer(rb"^comment TextureFile[ \t]+(.+?)[ \t]*\r?$", data[:4096], re.M):
            yield found[1].decode("utf-8", "replace")
    elif suffix not in (".glb", ".gltf"):
        return
    else:
        if suffix == ".glb":
            data = data[20 : 20 + int.from_bytes(data[12:16], "little")]
        try:
            tree = json.loads(data)
            items = [item for kind in ("buffers", "images") for item in tree.get(kind, [])]
            names = [item.get("uri", "data:") for item in items]
        except (ValueError, AttributeError, TypeError, RecursionError):
            return  # the cleaning reports the fault
        yield from (unquote(name) for name in names if isinstance(name, str) and not name.startswith("data:"))
