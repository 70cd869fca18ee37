"""Variants and siblings in a manifest: the entries that take fields from another one (``like``, ``variant_of``)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from avs3d_bench.contract.taxonomy import PART_3
from avs3d_bench.errors import excerpt
from avs3d_bench.formats.yamlfile import step
from generators.manifest.messages import Fault, listed

#: The fields that an entry with ``like`` may have, and those that it may have in part_3 only.
_LIKE_FIELDS, _SIBLING_FIELDS = ("like", "index", "acoustics"), ("sources", "background")
#: The fields that an entry with ``variant_of`` may have.
_VARIANT_OF_FIELDS = ("variant_of", "index", "acoustics", "background")


def resolve_variants(observations: Sequence[Any], shared: dict[str, Any]) -> tuple[list[Any], list[Fault]]:
    """Fill in the fields that entries take from the manifest, and variants from their original.

    Nothing is validated yet: an entry that is no mapping stays as it is.

    Args:
        observations: the entries as the file has them.
        shared: fields that the manifest gives to all entries.

    Returns:
        The entries, and the problems of those that take fields from no entry that they may take them from.
    """
    entries = [shared | entry if isinstance(entry, dict) else entry for entry in observations]
    originals = {_raw_key(entry): entry for entry in entries if isinstance(entry, dict) and "like" not in entry}
    faults: list[Fault] = []
    for number, entry in enumerate(observations):
        if isinstance(entry, dict) and "like" in entry:
            try:
                entries[number] = _sibling_base(entry, originals) | entry
            except ValueError as error:
                faults.append((("observations", number), str(error)))
    bases = {_raw_key(one): one for one in entries if isinstance(one, dict) and "variant_of" not in one}
    for number, entry in enumerate(observations):
        if isinstance(entry, dict) and "variant_of" in entry and "like" not in entry:
            try:
                entries[number] = _variant_base(entry, bases) | entry
            except ValueError as error:
                faults.append((("observations", number), str(error)))
        if isinstance(entry, dict) and entries[number].get("part") == PART_3 and "source_motion" not in entry:
            entries[number] = {name: value for name, value in entries[number].items() if name != "source_motion"}
    return entries, faults


def _raw_key(entry: dict[str, Any]) -> str:
    return "/".join(str(entry.get(name)) for name in ("part", "scan", "room", "index"))


def _sibling_base(entry: dict[str, Any], originals: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Find the entry of which ``entry`` is a variant.

    Raises:
        ValueError: if there is none, or ``entry`` has fields that a variant may not have.
    """
    original = originals.get(str(entry["like"]))
    if original is None:
        raise ValueError(
            f"like {excerpt(entry['like'])} names no observation of this manifest that is not a "
            f"variant itself; expected a key like {excerpt(next(iter(originals), 'part_1/scan/kitchen/1'))}"
        )
    in_part_3 = original.get("part") == PART_3
    own = (*_LIKE_FIELDS, *_SIBLING_FIELDS) if in_part_3 else _LIKE_FIELDS
    surplus = sorted(step(name) for name in set(entry) - set(own))
    if surplus:
        what = "index, acoustics, sources and background" if in_part_3 else "index and acoustics"
        raise ValueError(
            f"an entry with like cannot have {listed(surplus)}; a variant takes "
            f"everything except {what} from its original; leave them out"
        )
    left = {"index", "background"} if "sources" in entry else {"index"}
    return {name: value for name, value in original.items() if name not in left}


def _variant_base(entry: dict[str, Any], originals: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The fields that an entry with ``variant_of`` takes from its original.

    Raises:
        ValueError: if there is no original in part_3, or ``entry`` has fields that such an entry may not have.
    """
    key = str(entry["variant_of"])
    original = originals.get(key)
    if original is None or original.get("part") != PART_3:
        raise ValueError(
            f"variant_of {excerpt(key)} names no observation of part_3 of this manifest that "
            "has no variant_of itself; in part_1 and part_2 write like"
        )
    surplus = sorted(step(name) for name in set(entry) - set(_VARIANT_OF_FIELDS))
    if surplus:
        raise ValueError(
            f"an entry with variant_of cannot have {listed(surplus)}; it takes everything "
            "except index, acoustics and background from its original; leave them out"
        )
    return {name: value for name, value in original.items() if name != "index"} | {"like": original.get("like", key)}
