"""The manifest of a sealed test: a template's observations with seeds, homes and numbers that come from a secret.

A template may be public. So that it tells nothing of an observation but its part and room, four things are drawn
beside the seeds: which home an observation is in, among those with the same part, room and number of siblings; the
names of the homes (``home_1``, …); the numbers of the observations of a room; and in part_1, which of the objects
sounds. Draws are HMACs of the secret, so that they depend on no library.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.sealing.secret import derive
from generators.manifest.reading import ManifestFile
from generators.manifest.schema import Manifest

#: Bytes of a seed: too many values to try.
SEED_BYTES = 16
#: Times that the seed of a home is drawn until all its observations fit into it.
MOST_DRAWS = 200
_PURPOSE = "avs3d-bench sealed test 1.0"

Document = dict[str, Any]
#: Of some homes of a manifest, those whose observations do not all fit into their rooms.
Misfits = Callable[[Manifest, set[str]], set[str]]


def check_template(source: ManifestFile) -> None:
    """Refuse what cannot be sealed.

    Raises:
        UsageError: naming the field.
    """
    for spec in source.manifest.observations:
        if spec.source_motion == "path":
            raise UsageError(
                f"{source.path}: {spec.key}: source_motion: path: the object that moves is the one that sounds, so the "
                "pictures would tell it; leave it out of a sealed test"
            )
    for name, scan in source.manifest.scans.items():
        if scan.source == "scan" and not scan.file:
            instead = " instead of its asset" if scan.asset else ""
            raise UsageError(
                f"{source.path}: scans.{name}: a sealed test hides the names of scans; name the file of this one"
                f"{instead}: file: PATH"
            )


def draw_seed(secret: bytes, purpose: str) -> int:
    """A seed of 128 bits."""
    return int.from_bytes(derive(secret, f"{_PURPOSE}: seed: {purpose}")[:SEED_BYTES], "big")


def home_seed(secret: bytes, home: str, draw: int, taken: Mapping[int, str]) -> int:
    """The seed of a home at the given draw; a seed of another manifest (``taken``) is passed over."""
    number = 0
    while True:
        seed = draw_seed(secret, f"home {home} {draw} {number}")
        if seed not in taken:
            return seed
        number += 1


def draw_document(
    template: Document, secret: bytes, draws: Mapping[str, int], taken: Mapping[int, str] | None = None
) -> tuple[Document, dict[str, str]]:
    """The manifest of a sealed test.

    Args:
        template: a valid manifest, as YAML has it.
        secret: the working key of the secret, 32 bytes.
        draws: home of the template → which draw of its seed to take, from 1; 1 for homes that are not listed.
        taken: seeds of homes that may not be used.

    Returns:
        the manifest, and the new name of each home.
    """

    def shuffled(items: list[Any], purpose: str) -> list[Any]:
        tags = [derive(secret, f"{_PURPOSE}: order: {purpose}: {number}") for number in range(len(items))]
        return [item for _, item in sorted(zip(tags, items, strict=True), key=lambda pair: pair[0])]

    document = deepcopy(template)
    homes = {old: f"home_{n}" for n, old in enumerate(shuffled(sorted(template["scans"]), "homes"), start=1)}
    units = _units(document["observations"])
    variants = _variants(units)
    able = {*CATEGORIES, *((template.get("categories") or {}).keys() & (template.get("sounds") or {}).keys())}
    for number, (first, *_) in enumerate(units):
        tag = int.from_bytes(derive(secret, f"{_PURPOSE}: category: {number}"), "big")
        _draw_category(first, tag, able)
    kinds: defaultdict[tuple[Any, ...], list[list[Document]]] = defaultdict(list)
    for unit in units:
        kinds[unit[0]["part"], unit[0]["room"], len(unit)].append(unit)
    for kind, alike in kinds.items():
        places = [unit[0]["scan"] for unit in alike]
        for unit, place in zip(shuffled(alike, f"contents of {kind}"), places, strict=True):
            unit[0]["scan"] = homes[place]
    rooms: defaultdict[tuple[str, ...], list[tuple[Document, Document]]] = defaultdict(list)
    for unit in units:
        for entry in unit:
            rooms[unit[0]["part"], unit[0]["scan"], unit[0]["room"]].append((unit[0], entry))
    for room, entries in sorted(rooms.items()):
        for index, (_, entry) in enumerate(shuffled(entries, f"indices of {room}"), start=1):
            entry["index"] = index
    for first, *others in units:
        for other in others:
            if "like" in other:
                other["like"] = _key(first)
    for entry, original, first in variants:
        entry["variant_of"] = _key({**first, "index": original["index"]})
    document["observations"] = [entry for unit in sorted(units, key=lambda unit: _key(unit[0])) for entry in unit]
    document["scans"] = {}
    for old, new in sorted(homes.items(), key=lambda pair: int(pair[1].removeprefix("home_"))):
        scan = dict(template["scans"][old] or {})
        if scan.get("source", "apartment") == "apartment":
            scan["seed"] = home_seed(secret, old, draws.get(old, 1), taken or {})
        document["scans"][new] = scan
    document["seed"] = draw_seed(secret, "manifest")
    return document, homes


def fit_homes(
    template: Document, secret: bytes, misfits: Misfits, taken: Mapping[int, str]
) -> tuple[Document, dict[str, int]]:
    """As `draw_document`, with other homes for observations that do not fit.

    Returns:
        the manifest, and how often the seed of each home was drawn.

    Raises:
        Avs3dError: if a home was drawn `MOST_DRAWS` times.
    """
    draws = dict.fromkeys(sorted(template["scans"]), 1)
    document, homes = draw_document(template, secret, draws, taken)
    waiting = set(homes.values())
    while waiting := misfits(Manifest.model_validate(document), waiting):
        for old in (old for old, new in homes.items() if new in waiting):
            draws[old] += 1
            if draws[old] > MOST_DRAWS:
                raise Avs3dError(
                    f"none of {MOST_DRAWS} homes has room for the observations of one home of the template; "
                    "ask for fewer objects in a room"
                )
        document, _ = draw_document(template, secret, draws, taken)
    return document, draws


def _draw_category(entry: Document, tag: int, known: set[str]) -> None:
    """Draw which object of an observation of part_1 sounds, among those that could.

    The pictures show all objects. A known template has few entries with these objects, and says which of them sounds.
    A chosen variant would be visible, too.

    Args:
        entry: of the manifest; changed.
        tag: a random number of 256 bits.
        known: categories that have a sound.
    """
    objects = [entry.get("category"), *(entry.get("silent") or ())]
    able = sorted(name for name in known if objects.count(name) == 1)
    if entry["part"] != "part_1" or len(able) < 2:
        return
    entry["category"] = able[tag % len(able)]
    entry["silent"] = sorted(name for name in objects if name is not None and name != entry["category"])
    entry.pop("variant", None)


def _units(entries: list[Document]) -> list[list[Document]]:
    """Each observation with its variants or siblings, the original first."""
    units = {_key(entry): [entry] for entry in entries if not {"like", "variant_of"} & entry.keys()}
    likes = {f"{_place(entry['like'])}/{entry['index']}": entry["like"] for entry in entries if "like" in entry}
    for entry in entries:
        original = str(entry.get("like") or entry.get("variant_of") or "")
        if original:
            units[likes.get(original, original)].append(entry)
    return list(units.values())


def _variants(units: list[list[Document]]) -> list[tuple[Document, Document, Document]]:
    """Each variant of part_3 with its original, and the first of their group; keys are those of the template."""
    found = []
    for first, *others in units:
        place = _place(_key(first))
        named = {f"{place}/{entry['index']}": entry for entry in (first, *others)}
        found += [(one, named[one["variant_of"]], first) for one in others if "variant_of" in one]
    return found


def _place(key: str) -> str:
    return key.rpartition("/")[0]


def _key(entry: Document) -> str:
    return "/".join(str(entry[name]) for name in ("part", "scan", "room", "index"))
