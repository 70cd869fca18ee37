"""Pair accuracy: whether predictions follow the sound where the picture is the same.

Two siblings of a group share the picture of a frame and differ in sound. Where their truths differ, the frame of the
pair is right only if both predictions are right and each agrees better with its own truth than with the other's. A
prediction that is the same for both cannot do that: IoU(P, A) > IoU(P, B) and IoU(P, B) > IoU(P, A) exclude each other.

All comparisons are made with whole numbers. docs/protocol-listen.md has the definition with worked examples.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations

from avs3d_bench.contract.scores import PairKind, PairScores, SiblingScores
from evaluators.metrics.masks import FrameCounts

#: Counts of every prediction against every truth of a frame: row a, column b is prediction a against truth b.
CrossCounts = Sequence[Sequence[FrameCounts]]
#: The figure over pairs of every kind.
ALL_PAIRS = "pair_accuracy"


def differ(truths: FrameCounts) -> bool:
    """Whether two truths differ: IoU below 0.5; two empty ones do not, an empty and another one do.

    Args:
        truths: the counts of one truth as the prediction of the other.
    """
    return 2 * truths.overlap < truths.union


def is_right(own: FrameCounts) -> bool:
    """Whether a prediction is right by itself: IoU above 0.5, or empty where the truth is."""
    return 2 * own.overlap > own.union if own.truth else own.predicted == 0


def agrees_better(own: FrameCounts, other: FrameCounts) -> bool:
    """Whether a prediction has a higher IoU with its own truth than with the other's (1 where both are empty)."""
    a, whole_a = (own.overlap, own.union) if own.union else (1, 1)
    b, whole_b = (other.overlap, other.union) if other.union else (1, 1)
    return a * whole_b > b * whole_a


def right_pair(counts: CrossCounts, first: int, second: int) -> bool:
    """Whether both predictions of a frame are right, each for its own truth.

    Args:
        counts: of the frame.
        first: row of one sibling.
        second: row of the other.
    """
    return all(
        is_right(counts[a][a]) and agrees_better(counts[a][a], counts[a][b])
        for a, b in ((first, second), (second, first))
    )


def sibling_scores(
    group: str,
    keys: Sequence[str],
    differing: Iterable[Iterable[tuple[int, int]]],
    frames: Iterable[CrossCounts],
    kinds: Mapping[tuple[int, int], PairKind] | None = None,
) -> SiblingScores:
    """The pairs of the siblings of a group.

    Args:
        group: its key.
        keys: of the siblings.
        differing: for each frame the pairs (rows) whose truths differ.
        frames: the counts of each frame, in the same order.
        kinds: pair (rows) → its kind (`avs3d_bench.measures.pair_kinds`); None: not known.
    """
    found = {pair: [0, 0] for pair in combinations(range(len(keys)), 2)}
    for pairs, counts in zip(differing, frames, strict=True):
        for pair in pairs:
            found[pair][0] += 1
            found[pair][1] += right_pair(counts, *pair)
    named = kinds or {}
    pairs_ = tuple(
        PairScores(first=keys[a], second=keys[b], kind=named.get((a, b)), frames=total, right=right)
        for (a, b), (total, right) in found.items()
    )
    return SiblingScores(group=group, observations=tuple(keys), pairs=pairs_)


def pair_accuracy(pairs: Iterable[PairScores]) -> tuple[float | None, int]:
    """(share of right frames of pairs, number of frames); the share is None where there is no frame."""
    some = list(pairs)
    frames = sum(pair.frames for pair in some)
    return (sum(pair.right for pair in some) / frames if frames else None), frames


def pairs_of(siblings: SiblingScores, keys: Iterable[str], figure: str = ALL_PAIRS) -> list[PairScores]:
    """The pairs of a figure that involve at least one of some observations.

    Args:
        siblings: of a group.
        keys: of the observations.
        figure: one of `PAIR_FIGURES`: ``pair_accuracy`` is about all pairs, a kind about those of the kind.
    """
    wanted = set(keys)
    return [
        pair
        for pair in siblings.pairs
        if figure in (ALL_PAIRS, pair.kind) and (pair.first in wanted or pair.second in wanted)
    ]


def group_accuracies(
    siblings: Iterable[SiblingScores], keys: Iterable[str], figure: str = ALL_PAIRS
) -> Mapping[str, float]:
    """Group → pair accuracy over its pairs that involve one of ``keys``; groups without a frame are left out.

    Args:
        siblings: the groups.
        keys: of the observations.
        figure: as for `pairs_of`.
    """
    wanted = frozenset(keys)
    found = {one.group: pair_accuracy(pairs_of(one, wanted, figure))[0] for one in siblings}
    return {group: value for group, value in found.items() if value is not None}
