"""dataset.json: against its own digest, the manifest in it, and the records of the observations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import yaml

from avs3d_bench.commands.report import Problem
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import DatasetEntry, DatasetRecord, LicenceRecord, ObservationRecord

#: Characters of a manifest that is read here; a larger one is not compared.
MOST_MANIFEST = 1_000_000
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
#: Acoustic engines whose output may not be used commercially, and what the dataset's licence must say then.
NON_COMMERCIAL = {"soundspaces": "CC-BY-NC"}


@dataclass(frozen=True)
class ManifestFacts:
    """Plain scalars of a manifest.

    Attributes:
        scalars: its top-level entries, e.g. name, version, seed.
        categories: key of each observation → category; empty in part_3.
        like: key of each variant or sibling → key of its original.
        own: the categories that it adds, in its order.
    """

    scalars: Mapping[str, str] = field(default_factory=dict)
    categories: Mapping[str, str] = field(default_factory=dict)
    like: Mapping[str, str] = field(default_factory=dict)
    own: tuple[str, ...] = ()


def read_facts(text: str) -> ManifestFacts | None:
    """The facts of a manifest; None if it is no YAML, too large, or uses aliases.

    It is read as a stream of events and never built: what a hostile text could do with depth, aliases and merge keys
    does not happen, and the generator's schema is not needed.
    """
    if len(text) > MOST_MANIFEST:
        return None
    scalars: dict[str, str] = {}
    observations: list[dict[str, str]] = []
    own: list[str] = []
    # For every open collection: the key under which it stands, and the key inside it that waits for its value.
    opened: list[str | None] = []
    waiting: list[str | None] = []
    try:
        for event in yaml.parse(text, Loader=_LOADER):
            depth = len(opened)
            listed = opened[1:2] == ["observations"]
            named = depth == 2 and opened[1:2] == ["categories"]
            if isinstance(event, yaml.AliasEvent):
                return None
            if isinstance(event, yaml.CollectionStartEvent):
                if depth == 2 and listed and isinstance(event, yaml.MappingStartEvent):
                    observations.append({})
                opened.append(waiting[-1] if waiting else None)
                waiting[-1:] = [None]
                waiting.append(None)
            elif isinstance(event, yaml.CollectionEndEvent):
                opened.pop()
                waiting.pop()
            elif isinstance(event, yaml.ScalarEvent) and (
                named or depth == 1 or (depth == 3 and listed and observations)
            ):
                key = waiting[-1]
                if named and key is None:
                    own.append(event.value)
                elif not named and key is not None:
                    (scalars if depth == 1 else observations[-1])[key] = event.value
                waiting[-1] = event.value if key is None else None
    except yaml.YAMLError:
        return None
    categories: dict[str, str] = {}
    originals: dict[str, str] = {}
    for entry in observations:
        like = entry.get("like", "") or entry.get("variant_of", "")
        head = like.rpartition("/")[0] if like else "/".join(entry.get(name, "") for name in ("part", "scan", "room"))
        key = f"{head}/{entry.get('index', '')}"
        categories[key] = categories.get(like, "") if like else entry.get("category", "")
        if like:
            originals[key] = like
    # A variant of a sibling has the pictures of the first of its group.
    originals = {key: originals.get(like, like) for key, like in originals.items()}
    return ManifestFacts(scalars, categories, originals, tuple(own))


def check_catalogue(record: DatasetRecord, records: Mapping[str, ObservationRecord]) -> Iterator[Problem]:
    """Yield the problems of dataset.json that show inside the dataset.

    Args:
        record: dataset.json.
        records: the observation.json of every observation that has one that can be read, by key.
    """
    if record.digest is None:
        yield Problem("note", layout.DATASET_JSON, "has no digest of its own: an edited name or licence cannot be seen")
    elif record.digest != record.contents_digest():
        text = "digest is not that of the other fields: the file was changed after it was written"
        yield Problem("error", layout.DATASET_JSON, text)
    for text in (
        *_against_manifest(record, records),
        *_backends(record, records),
        *_categories_of(record, records),
        *_licences(record, records),
        *_sounds(record, records),
    ):
        yield Problem("error", layout.DATASET_JSON, text)
    for key, found in sorted(records.items()):
        original = records.get(found.variant_of or "")
        if original is not None:
            for text in _variant(found, original):
                yield Problem("error", f"{key}/{layout.OBSERVATION_JSON}", text)


def _against_manifest(record: DatasetRecord, records: Mapping[str, ObservationRecord]) -> Iterator[str]:
    facts = read_facts(record.manifest)
    if facts is None:
        return
    for name, found in (("name", record.name), ("version", record.version)):
        wanted = facts.scalars.get(name)
        if wanted is not None and wanted != found:
            yield f"{name} is {found!r}, the manifest in it says {wanted!r}"
    seed = facts.scalars.get("seed", "")
    if seed.isdigit():
        other = sorted(key for key, found in records.items() if found.seed != int(seed))
        if other:
            yield f"the seed of the manifest in it is {seed}, that of {other[0]} is {records[other[0]].seed}"
    if facts.own != (record.categories or ()):
        own, listed = (", ".join(names or ("none",)) for names in (facts.own, record.categories))
        yield f"categories of the manifest's own are {listed}, the manifest in it adds {own}"
    for key, one in sorted(records.items()):
        original = facts.like.get(key, key)
        if one.group is not None and facts.categories and one.group != original:
            yield f"{key} is in the group {one.group}, in the manifest in it in that of {original}"
    if not facts.categories:
        return
    for entry in record.observations:
        category = facts.categories.get(entry.key)
        if category is None:
            yield f"{entry.key} is not in the manifest in it"
        elif category and category != entry.category:
            yield f"{entry.key} is {category} in the manifest in it, {entry.category} here"


def _categories_of(record: DatasetRecord, records: Mapping[str, ObservationRecord]) -> Iterator[str]:
    """The manifest's own categories decide the class ids: all files of a dataset list the same ones."""
    others: dict[tuple[str, ...], list[str]] = {}
    for key, found in sorted(records.items()):
        if found.categories != record.categories:
            others.setdefault(found.categories or (), []).append(key)
    mine = ", ".join(record.categories or ("none",))
    for names, keys in others.items():
        where = keys[0] if len(keys) == 1 else f"{keys[0]} and {len(keys) - 1} more"
        theirs = ", ".join(names or ("none",))
        yield f"categories of the manifest's own are {mine}, in {where} {theirs}; expected the same, in this order"


def _backends(record: DatasetRecord, records: Mapping[str, ObservationRecord]) -> Iterator[str]:
    used: dict[str, set[str]] = {}
    for found in records.values():
        for name, version in found.made_with:
            used.setdefault(name, set()).add(version)
    for name, versions in sorted(used.items()):
        if versions != {record.backends.get(name)}:
            said = record.backends.get(name, "absent")
            yield f"backend {name} is {said}, in the observations {' and '.join(sorted(versions))}"
    if records:
        for name in sorted(set(record.backends) - set(used)):
            yield f"backend {name} is listed, but no observation used it"
    for name, words in NON_COMMERCIAL.items():
        if name in used and words not in record.licence:
            yield f"licence does not say {words}, but the sound was computed with {name}"


def _licences(record: DatasetRecord, records: Mapping[str, ObservationRecord]) -> Iterator[str]:
    listed: dict[str, set[tuple[str, str, str]]] = {}
    for one in record.attributions:
        listed.setdefault(one.asset, set()).add((one.name, one.author, one.source))
    used: dict[str, set[tuple[str, str, str]]] = {}

    def use(asset: str, licence: LicenceRecord) -> None:
        used.setdefault(asset, set()).add((licence.name, licence.author, licence.source))

    for found in records.values():
        for instance in found.instances:
            use(instance.asset, instance.licence)
        if found.sound is not None:
            use(found.sound.asset, found.sound.licence)
        for source in found.sources or ():
            use(source.asset, source.licence)
        if found.acoustics.hrtf is not None:
            use(found.acoustics.hrtf.asset, found.acoustics.hrtf)
    for asset in sorted(used):
        if asset not in listed:
            yield f"attributions lack {asset}"
        elif listed[asset] != used[asset]:
            yield f"attribution of {asset} differs from what the observations say"
    if records:
        scans = {f"scan:{found.scan}" for found in records.values()}
        for asset in sorted(set(listed) - set(used)):
            if not asset.startswith("scan:"):
                yield f"attributions name {asset}, which no observation uses"
        if any(asset.startswith("scan:") for asset in listed):
            for asset in sorted(scans - set(listed)):
                yield f"attributions lack {asset}"


def _sounds(record: DatasetRecord, records: Mapping[str, ObservationRecord]) -> Iterator[str]:
    """Datasets of older versions do not say what their sources play."""
    for entry in record.observations:
        found = records.get(entry.key)
        if found is None or entry.sounds is None:
            continue
        played = DatasetEntry.of(found, entry.digest).sounds
        if entry.sounds != played:
            here, there = (", ".join(some or ("nothing",)) for some in (entry.sounds, played))
            yield f"{entry.key} plays {here} here, {there} in its {layout.OBSERVATION_JSON}"


def _variant(record: ObservationRecord, original: ObservationRecord) -> Iterator[str]:
    """A variant differs from its original in sound alone; in part_3 the masks show what is audible, and may differ."""
    of_original = f"those of {original.key}, whose variant this is"
    if record.instances != original.instances or record.source_position != original.source_position:
        yield f"instances differ from {of_original}"
    if record.sources != original.sources:
        yield f"sources differ from {of_original}"
    poses = [[(frame.position, frame.rotation) for frame in one.frames] for one in (record, original)]
    if poses[0] != poses[1]:
        yield f"poses differ from {of_original}"
    masks = () if record.is_part_3 else (layout.SEMANTIC_MASKS,)
    pictures = (layout.INPUT, layout.INSTANCE_MASKS, *masks)
    common = [path for path in record.files if path.startswith(pictures) and path in original.files]
    other = [path for path in common if record.files[path] != original.files[path]]
    if other:
        yield f"{len(other)} pictures differ from {of_original}: {other[0]}"
