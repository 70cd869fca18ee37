"""`assets.lock.yaml`: one record per asset that a manifest may use, with its source, licence and hash.

The file is data, read by people and compared by diff tools: entries sorted by id, fields in one order, nothing that
depends on when or where it was written.
"""

from __future__ import annotations

import os
import re
import time
import unicodedata
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from avs3d_bench.contract.schema import AttributionRecord
from avs3d_bench.contract.taxonomy import check_category_name
from avs3d_bench.errors import Avs3dError, excerpt
from avs3d_bench.formats import files
from avs3d_bench.formats.yamlfile import parse_yaml, read_data, step
from avs3d_bench.runtime.file_lock import lock_now
from generators.core.limits import SoundSplit
from generators.core.scene import Licence

LOCK_NAME = "assets.lock.yaml"
#: Longest wait for another process that writes the lock file (s).
PATIENCE = 60.0
#: Interval between two checks during that wait (s).
_PAUSE = 0.02
_HEADER = (
    "# Written by `avs3d assets`. Every asset that is not made here: source, author, licence, hash, how it stands.\n"
)
#: A recording, or what is used of it, is at least this long: a shorter one cannot be looped (s).
SHORTEST = 0.5
_STEP = r"[A-Za-z0-9][A-Za-z0-9._+-]*"

Kind = Literal["object", "sound", "scan"]
Source = Literal["sketchfab", "freesound", "bbc", "esc50", "sh3d", "github", "folder"]
#: Who may hear a recording; see `generators.assets.sounds.Voice.split`.
Line = Annotated[str, Field(min_length=1, max_length=1000, pattern=r"^[^\x00-\x1f\x7f]*$")]
Axis = Annotated[str, Field(pattern=r"^[+-]?[xyz]$")]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Moment = Annotated[Finite, Field(ge=0.0)]


class AssetEntry(BaseModel):
    """One asset.

    Attributes:
        id: ``source/…/name``; its name in manifests and its folder in the store.
        kind: an object (mesh), a sound, or a scan (the mesh of a home).
        category: its category: one of `avs3d_bench.contract.taxonomy`, or one that manifests add; empty for a scan.
        source: the collection from which it comes.
        ref: the collection's own id.
        url: its web page.
        title, author: as given by the collection.
        licence: SPDX identifier where there is one.
        file: name of the original file in the asset's folder of the store.
        sha256, bytes: hash and size of the original file.
        up, front: its axes that point up and to the front (``y``, ``+z``, …); objects only.
        height: height to which it is scaled, metres; without it, the file's own units are used.
        mount: kind of surface on which it stands or hangs; default: that of its category.
        yaw: degrees by which it is turned about its up axis afterwards, positive to the left.
        trim: begin and end of what is used of a recording, seconds; without it, all of it.
        split: who may hear a recording: networks in training, those who choose settings, or tests alone.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: Annotated[str, Field(pattern=rf"^{_STEP}(/{_STEP})+$", max_length=200)]
    kind: Kind
    category: str = ""
    source: Source
    ref: Line
    url: Annotated[str, Field(max_length=1000, pattern=r"^[^\x00-\x1f\x7f]*$")] = ""
    title: Line
    author: Line
    licence: Line
    file: Annotated[str, Field(pattern=rf"^{_STEP}$", max_length=200)]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    bytes: Annotated[int, Field(ge=1)]
    up: Axis | None = None
    front: Axis | None = None
    height: Annotated[Finite, Field(gt=0.01, le=5.0)] | None = None
    mount: Literal["floor", "surface", "wall", "wall_or_surface"] | None = None
    yaw: Annotated[Finite, Field(ge=-360, le=360)] | None = None
    trim: tuple[Moment, Moment] | None = None
    split: SoundSplit | None = None

    @field_validator("category")
    @classmethod
    def _category(cls, value: str) -> str:
        try:
            return check_category_name(value) if value else ""
        except Avs3dError as error:
            raise ValueError(str(error)) from None

    @model_validator(mode="after")
    def _fits_its_kind(self) -> AssetEntry:
        if (self.kind == "scan") == bool(self.category):
            what = "belongs to objects and sounds only; leave it out for a scan" if self.category else "is missing"
            raise ValueError(f"category {what}")
        given = [name for name in ("up", "front", "height", "mount", "yaw") if getattr(self, name) is not None]
        if self.kind != "object" and given:
            raise ValueError(f"{given[0]} is given, but belongs to objects only; leave it out for a {self.kind}")
        if self.trim is not None and self.trim[1] - self.trim[0] < SHORTEST:
            raise ValueError(
                f"trim is [{self.trim[0]:g}, {self.trim[1]:g}]; expected [begin, end], {SHORTEST} s or more"
            )
        heard = [name for name in ("trim", "split") if getattr(self, name) is not None]
        if self.kind != "sound" and heard:
            article = "an" if self.kind == "object" else "a"
            raise ValueError(f"{heard[0]} is given, but belongs to sounds only; leave it out for {article} {self.kind}")
        if self.kind == "object" and (self.up is None or self.front is None):
            raise ValueError("an object needs up and front, e.g. up: y, front: +z")
        return self

    @property
    def terms(self) -> Licence:
        """Its licence, author and source."""
        return Licence(self.licence, self.author, self.url or self.ref)

    @property
    def attribution_record(self) -> AttributionRecord:
        """The same for a dataset or a model card that uses it."""
        terms = self.terms
        return AttributionRecord(asset=self.id, name=terms.name, author=terms.author, source=terms.source)

    @property
    def attribution(self) -> str:
        """Title, author, licence and address in one line, as attribution licences ask for."""
        return f"“{self.title}” by {self.author}, {self.licence}" + (f", {self.url}" if self.url else "")


class Lock(BaseModel):
    """All entries of a lock file, sorted by id."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    version: Literal[1] = 1
    assets: tuple[AssetEntry, ...] = ()

    @model_validator(mode="after")
    def _unique(self) -> Lock:
        ids = [entry.id for entry in self.assets]
        for first, second in zip(sorted(ids), sorted(ids)[1:], strict=False):
            if first == second:
                raise ValueError(f"{first} is listed twice")
        return self

    def find(self, asset: str) -> AssetEntry | None:
        """The entry of that id."""
        return next((entry for entry in self.assets if entry.id == asset), None)

    def merged(self, entries: Iterable[AssetEntry]) -> Lock:
        """A copy of this lock with ``entries`` added; an entry of the same id is replaced.

        A recording of the same bytes keeps its ``trim`` and ``split`` where the new entry names none.
        """
        table = {entry.id: entry for entry in self.assets}
        for entry in entries:
            known = table.get(entry.id)
            if known is not None and known.sha256 == entry.sha256:
                kept = {name: getattr(known, name) for name in ("trim", "split") if getattr(entry, name) is None}
                entry = entry.model_copy(update=kept)
            table[entry.id] = entry
        return Lock(assets=tuple(table[name] for name in sorted(table)))


def dump_lock(lock: Lock) -> bytes:
    """The bytes of a lock file; the same entries give the same bytes, in whatever order they came."""
    entries = [
        entry.model_dump(exclude_none=True, exclude=set() if entry.category else {"category"})
        for entry in sorted(lock.assets, key=lambda entry: entry.id)
    ]
    text = yaml.dump(
        {"version": lock.version, "assets": entries}, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=4096
    )
    return (_HEADER + text).encode()


class _Dumper(yaml.SafeDumper):
    """Writes floats in their shortest form; everything else as YAML does."""


def _float(dumper: yaml.SafeDumper, value: float) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:float", f"{value:.9g}" if value % 1 else f"{value:.1f}")


def _pair(dumper: yaml.SafeDumper, value: tuple[float, ...]) -> yaml.SequenceNode:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=True)


_Dumper.add_representer(float, _float)
_Dumper.add_representer(tuple, _pair)


def parse_lock(data: bytes, where: Path | str) -> Lock:
    """Parse the bytes of the lock file ``where``.

    Raises:
        Avs3dError: one line with the file, the entry, the field and what was expected.
    """
    return _parse(data, str(where))


@lru_cache(maxsize=8)
def _parse(data: bytes, where: str) -> Lock:
    document = parse_yaml(data, where)
    if not isinstance(document, dict):
        raise Avs3dError(f"{where}: expected a mapping with version and assets, found {excerpt(document)}")
    try:
        return Lock.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        message = first["msg"].removeprefix("Value error, ")
        if first["type"] == "extra_forbidden":
            message = "unknown field; correct its name or update avs3d-bench"
        raise Avs3dError(f"{where}: {_line(_place(document, first['loc']))}: {_line(message)}{more}") from None


def _line(text: object) -> str:
    return " ".join(str(text).split())[:300]


def _place(document: dict[str, Any], loc: tuple[int | str, ...]) -> str:
    """The place of an error, with the entry's id if it has one: ``assets.3 (sh3d/scopia/phone).licence``."""
    steps = [step(key) for key in loc]
    if len(loc) >= 2 and loc[0] == "assets" and isinstance(loc[1], int):
        table = document["assets"]
        entry = table[loc[1]] if isinstance(table, list) else None
        name = entry.get("id") if isinstance(entry, dict) else None
        if isinstance(name, str):
            steps[1] += f" ({step(name)})"
    return ".".join(steps) or "the file"


def read_lock(path: Path) -> Lock:
    """Read the lock file at ``path``; without such a file the lock is empty.

    Raises:
        Avs3dError: if it cannot be read or is not valid.
    """
    try:
        path.lstat()
    except FileNotFoundError:
        return Lock()
    except OSError as error:
        raise Avs3dError(files.os_error_line(error, path, "read")) from error
    return parse_lock(read_data(path), path)


def update_lock(path: Path, entries: Iterable[AssetEntry]) -> Lock:
    """Add ``entries`` to the lock file, or replace those of the same id; concurrent processes take turns.

    Raises:
        Avs3dError: if the file is not valid, cannot be written, or another process locks it for a minute.
    """
    with _turn(path):
        lock = read_lock(path).merged(entries)
        data = dump_lock(lock)
        try:
            unchanged = path.read_bytes() == data
        except OSError:
            unchanged = False
        if not unchanged:
            files.write_bytes(path, data)
        return lock


@contextmanager
def _turn(path: Path) -> Iterator[None]:
    """Lock the folder of ``path``; this leaves no file, and the lock ends with the process.

    NFS can lock only a file that is open for writing: there, a file beside ``path`` is locked, and it stays.
    """
    beside = path.with_name(f".{path.name}.turn")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(path.parent, os.O_RDONLY)
    except OSError as error:
        raise Avs3dError(files.os_error_line(error, path, "write")) from error
    try:
        end = time.monotonic() + PATIENCE
        folder = True
        while True:
            try:
                locked = lock_now(handle)
            except OSError as error:
                if not folder:
                    raise Avs3dError(files.os_error_line(error, beside, "hold")) from error
                folder = False
                other = _opened(beside, path)
                os.close(handle)
                handle = other
                continue
            if locked:
                break
            if time.monotonic() > end:
                raise Avs3dError(
                    f"{path}: another avs3d is writing there for {PATIENCE:.0f} s; wait for it and run again"
                )
            time.sleep(_PAUSE)
        yield
    finally:
        os.close(handle)


def _opened(beside: Path, path: Path) -> int:
    try:
        return os.open(beside, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        raise Avs3dError(files.os_error_line(error, path, "write")) from error


def slug(text: str) -> str:
    """``text`` as one step of an id: ASCII letters, digits, ``.``, ``_``, ``+`` and ``-``."""
    # é → e; a text without ASCII letters (時計) gets digits of its hash instead.
    plain = "".join(letter for letter in unicodedata.normalize("NFKD", text) if not unicodedata.combining(letter))
    words = re.sub(r"[^A-Za-z0-9._+-]+", "-", plain).strip("-._+")[:80] or "asset"
    if plain.isascii():
        return words
    return f"{words}-{files.sha256_bytes(text.encode('utf-8', 'surrogatepass'))[:8]}"
