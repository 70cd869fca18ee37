"""The record of a dataset over the observations that are there, and whether it can be written, told before the first.

The record holds texts that come from the manifest and the lock file (name, version, licences): one that does not fit
would end a run of days at its last step. `check` builds the same record from the manifest alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pydantic import ValidationError

from avs3d_bench import __version__
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import (
    PART_3_VERSION,
    SCHEMA_VERSION,
    AttributionRecord,
    DatasetEntry,
    DatasetRecord,
    LicenceRecord,
    ObservationRecord,
    ProvenanceRecord,
    describe,
    parse_record,
    unique_attributions,
)
from avs3d_bench.contract.taxonomy import PART_3
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from avs3d_bench.runtime.provenance import Provenance
from generators.library.licences import conditions
from generators.library.lock import LOCK_NAME, read_lock
from generators.library.store import find_entry
from generators.manifest.reading import ManifestFile
from generators.manifest.schema import AssetSpec, ScanSpec


def check(source: ManifestFile) -> None:
    """See whether dataset.json can be written with everything that ``source`` brings into it.

    Raises:
        UsageError: if the manifest, or its lock file, holds a text that the record cannot.
    """
    try:
        record = _record(source, (), manifest_attributions(source), {"soundspaces": "any"})
        files.dump_json(record).encode()
    except ValidationError as error:
        raise UsageError(
            f"{source.path}: dataset.json cannot hold {describe(error)[0]}; correct the manifest"
        ) from None
    except UnicodeEncodeError:
        raise UsageError(f"{source.path}: holds characters that are no UTF-8; correct the manifest") from None


def manifest_attributions(source: ManifestFile) -> list[AttributionRecord]:
    """The attributions of everything that observations of a manifest may use, but for what is procedural."""
    attributions = _of_scans(source)
    for table in (source.manifest.objects, source.manifest.sounds):
        for items in table.values():
            attributions += [found for item in items if (found := _of_asset(item, source.base)) is not None]
    return attributions


def _of_asset(item: AssetSpec, base: Path) -> AttributionRecord | None:
    """The attribution of a file or an asset; None for one that the lock file lacks."""
    if item.file is not None and item.licence is not None:
        terms = item.licence
        return AttributionRecord(
            asset=item.file, name=terms.name, author=terms.author, source=terms.source or item.file
        )
    entry = read_lock(base / LOCK_NAME).find(item.asset or "")
    if entry is None:
        return None
    return entry.attribution_record


def describe_dataset(
    source: ManifestFile, found: Iterable[tuple[ObservationRecord, str]], software: Provenance
) -> DatasetRecord | None:
    """The record of a dataset over some of the manifest's observations; None if there are none.

    Args:
        source: the manifest.
        found: of each observation that is there its record and the sha256 of its observation.json, sorted by key.
        software: what made the observations.
    """
    entries: list[DatasetEntry] = []
    attributions: list[AttributionRecord] = []
    backends: dict[str, str] = {}
    for record, digest in found:
        entries.append(DatasetEntry.of(record, digest))
        backends |= dict(record.made_with)
        attributions += record.attributions
    if not entries:
        return None
    return _record(source, entries, [*attributions, *_of_scans(source)], backends, software)


def read_observation(folder: Path) -> ObservationRecord:
    """The record of a finished observation.

    Raises:
        Avs3dError: if it cannot be read.
    """
    path = folder / layout.OBSERVATION_JSON
    try:
        data = files.read_bytes(path)
    except Avs3dError as error:
        raise Avs3dError(f"{error}; delete {folder} to have it regenerated") from error
    return parse_record(data, ObservationRecord, path)


def _record(
    source: ManifestFile,
    entries: Iterable[DatasetEntry],
    attributions: list[AttributionRecord],
    backends: dict[str, str],
    software: Provenance | None = None,
) -> DatasetRecord:
    entries = tuple(entries)
    newer = bool(source.manifest.categories) or any(entry.part == PART_3 for entry in entries)
    return DatasetRecord(
        schema_version=PART_3_VERSION if newer else SCHEMA_VERSION,
        name=source.manifest.name,
        version=source.manifest.version,
        toolkit_version=__version__,
        manifest=source.text,
        manifest_sha256=source.sha256,
        backends=dict(sorted(backends.items())),
        licence=licence_of(backends, attributions),
        attributions=unique_attributions(attributions),
        provenance=None if software is None else ProvenanceRecord.of(software),
        categories=tuple(source.manifest.categories) or None,
        observations=entries,
    ).sealed()


def licence_of(backends: Iterable[str], attributions: Iterable[AttributionRecord]) -> str:
    """The licence of a dataset made with these backends and assets."""
    terms = [
        "CC-BY-NC-4.0 (the sound was computed with RLRAudioPropagation, whose licence is non-commercial)"
        if "soundspaces" in backends
        else "Apache-2.0",
        # What is not made here keeps its own terms; those that only ask for attribution find it beside.
        *conditions((attribution.asset, attribution.name) for attribution in attributions),
    ]
    return "; ".join(terms)


def _of_scans(source: ManifestFile) -> list[AttributionRecord]:
    return [
        AttributionRecord(asset=f"scan:{name}", **_terms(source, name, scan).model_dump())
        for name, scan in source.manifest.scans.items()
    ]


def _terms(manifest: ManifestFile, name: str, scan: ScanSpec) -> LicenceRecord:
    """Licence of a home: what the manifest or the lock file says, or what is known without them."""
    if scan.asset:
        terms = find_entry(manifest.base / LOCK_NAME, scan.asset).terms
        return LicenceRecord(name=terms.name, author=terms.author, source=terms.source)
    where = scan.file or name
    if scan.licence is not None:
        own = scan.licence
        return LicenceRecord(
            name=own.name, author=own.author, source=own.source or (where if scan.source == "scan" else "procedural")
        )
    if scan.source == "scan":
        return LicenceRecord(name="unknown", author="unknown", source=where)
    return LicenceRecord(name="Apache-2.0", author="avs3d-bench", source="procedural")
