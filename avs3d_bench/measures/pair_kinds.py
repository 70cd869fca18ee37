"""What a pair of siblings of part_3 asks a method for: the kind of the pair, from the sources of both.

    several     one of the two has more than one source: how many sound, and which of them
    silence     one of the two has no source, or both have the same one, at other times: whether it sounds now
    off_screen  the source of one of the two is in another room: whether what sounds is here
    twins       the sources are two instances of one category: which of them sounds
    category    the sources are instances of two categories: what sounds

The first kind that fits is the pair's. Every pair of siblings has exactly one. docs/protocol-listen.md has an example
of each.
"""

from __future__ import annotations

from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.contract.scores import PairKind


def pair_kind(first: ObservationRecord, second: ObservationRecord) -> PairKind:
    """The kind of a pair of siblings; the order of the two makes no difference.

    Args:
        first: one sibling.
        second: another one of its group.
    """
    both = (first.sound_sources, second.sound_sources)
    if any(len(sources) > 1 for sources in both):
        return "several"
    if any(not sources for sources in both):
        return "silence"
    (one,), (other,) = both
    if one.instance is None or other.instance is None:
        return "off_screen"
    if one.instance == other.instance:
        return "silence"
    return "twins" if one.category == other.category else "category"
