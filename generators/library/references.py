"""Checks before generation: a manifest's assets must be in the lock file, in the store and of the right kind."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from avs3d_bench.errors import Avs3dError, UsageError
from generators.library.lock import AssetEntry, Kind, read_lock
from generators.library.store import Store, find_entry


class Named(Protocol):
    """An entry of a manifest's ``objects``, ``sounds`` or ``scans`` (`ObjectSpec`, `SoundSpec`, `ScanSpec`)."""

    @property
    def asset(self) -> str | None:
        """Id in the lock file, or None if the entry names a file."""


Table = Mapping[str, Sequence[Named]]


def named_assets(objects: Table, sounds: Table, scans: Iterable[Named] = ()) -> tuple[str, ...]:
    """Ids of all assets that a manifest names, sorted, without repetition."""
    items = [*scans, *(item for table in (objects, sounds) for entries in table.values() for item in entries)]
    return tuple(sorted({item.asset for item in items if item.asset is not None}))


def check_assets(
    lock: Path, objects: Table, sounds: Table, categories: Iterable[str], scans: Mapping[str, Named] = {}
) -> None:
    """Refuse a manifest with assets that are missing from the lock file or the store, or of another kind.

    Args:
        lock: the lock file beside the manifest.
        objects: the field of the manifest.
        sounds: the field of the manifest.
        categories: the categories that will be generated; the others are not looked at.
        scans: those that will be used, by their names.

    Raises:
        UsageError: if the lock file lacks one, or it is of another kind or category than the manifest says.
        Avs3dError: if files are missing in the store, with the command that fetches them.
    """
    wanted, store, missing = set(categories), Store.default(), []
    tables: tuple[tuple[Kind, Table], ...] = (("object", objects), ("sound", sounds))
    for kind, table in tables:
        for category, items in table.items():
            for item in items if category in wanted else ():
                if item.asset is None:
                    continue
                entry = find_entry(lock, item.asset)
                if (entry.kind, entry.category) != (kind, category):
                    raise UsageError(
                        f"{lock}: {entry.id} is {_what(entry)}, but the manifest needs the "
                        f"{kind} of a {category}; name another asset, or correct its entry"
                    )
                if not store.path(entry).is_file():
                    missing.append(entry.id)
    for name, scan in scans.items():
        if scan.asset is None:
            continue
        entry = find_entry(lock, scan.asset)
        if entry.kind != "scan":
            raise UsageError(
                f"{lock}: {entry.id} is the {entry.kind} of a {entry.category}, but scans.{name} needs a scan; name "
                "another asset"
            )
        if not store.path(entry).is_file():
            missing.append(entry.id)
    if missing:
        more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        raise Avs3dError(
            f"{store.root}: {', '.join(missing[:3])}{more} not in the store; run: avs3d assets fetch --lock {lock}"
        )


def _what(entry: AssetEntry) -> str:
    return f"the {entry.kind} of a {entry.category}" if entry.category else "a scan"


def asset_digests(lock: Path, assets: Iterable[str]) -> dict[str, str]:
    """``asset:<id>`` → sha256 of all that an asset's appearance, sound and attribution depend on.

    An asset that is missing from the lock file has none; this is reported when the asset is opened.
    """
    from generators.library import mesh_cleaning

    table = read_lock(lock)
    found = {}
    for name in sorted(set(assets)):
        entry = table.find(name)
        if entry is not None:
            # A split changes nothing that is heard, and nor does a trim that is not there.
            unheard = {"split"} if entry.trim is not None else {"split", "trim"}
            document = [entry.model_dump(exclude=unheard), mesh_cleaning.version() if entry.kind == "object" else ""]
            found[f"asset:{name}"] = hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()
    return found
