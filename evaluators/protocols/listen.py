"""Protocol ``listen``: whether a method listens, on the part_3 observations.

As in `evaluators.protocols.official`, one function over the frames of an observation and one over observations.
What is new are pairs of siblings (`evaluators.metrics.pairs`): their figure is a mean over groups, and all intervals
resample homes and then groups, because siblings share their pictures.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from avs3d_bench.contract.scores import (
    PAIR_FIGURES,
    PAIR_KINDS,
    ListenObservation,
    ListenSummary,
    ObservationScores,
    SiblingScores,
    metrics_of,
)
from evaluators.metrics.classes import Confusion, class_ious
from evaluators.metrics.masks import FrameCounts, mask_figures, mean
from evaluators.metrics.pairs import ALL_PAIRS, group_accuracies, pair_accuracy, pairs_of
from evaluators.statistics.bootstrap import clustered_interval

NOTHING_VISIBLE = "nothing audible is visible in any test frame"
ALWAYS_AUDIBLE = "something audible is visible in every test frame"
NO_SIBLING = "no sibling was scored"
SAME_TRUTHS = "no test frame in which the truth of a sibling differs"
NO_SUCH_PAIR = "no pair of this kind with such a frame"
NO_KINDS = "no observation.json: the kinds of pairs are not known"
NO_CATEGORIES = "the submission has no categories/"
NO_CLASS = "no category in truth or prediction"
_CLASSES = "class_mIoU"


def listen_observation(
    key: str,
    frames: Sequence[FrameCounts],
    siblings: SiblingScores,
    classes: Confusion | None = None,
    names: Mapping[int, str] | None = None,
) -> ListenObservation:
    """Protocol ``listen`` on the test frames of one observation.

    Args:
        key: the observation's.
        frames: the counts of all of them.
        siblings: the pairs of its group.
        classes: pixels by true and predicted class, summed over the frames; None without categories/.
        names: class id → category.
    """
    visible = [frame for frame in frames if frame.truth]
    absent = [frame for frame in frames if not frame.truth]
    accuracies = {name: pair_accuracy(pairs_of(siblings, [key], name)) for name in PAIR_FIGURES}
    ious = {} if classes is None else {(names or {})[n]: value for n, value in class_ious(classes).items()}
    found = mask_figures(frames)
    why = {}
    if not visible:
        why["IoU"] = NOTHING_VISIBLE
    if not absent:
        why |= dict.fromkeys(("FP_rate", "FP_area"), ALWAYS_AUDIBLE)
    why |= {name: _no_pair(name, siblings, key) for name, (value, _) in accuracies.items() if value is None}
    if not ious:
        why[_CLASSES] = NO_CATEGORIES if classes is None else NO_CLASS
    return ListenObservation(
        **{name: value for name, (value, _) in accuracies.items()},
        IoU=found["IoU"],
        FP_rate=found["FP_rate"],
        FP_area=found["FP_area"],
        class_mIoU=mean(ious.values()),
        visible_frames=len(visible),
        absent_frames=len(absent),
        pair_frames=accuracies[ALL_PAIRS][1],
        class_IoU=ious,
        unavailable={name: why[name] for name in sorted(why)},
    )


def _no_pair(figure: str, siblings: SiblingScores, key: str) -> str:
    """Why an observation has no pair accuracy, over all pairs or over those of a kind."""
    pairs = pairs_of(siblings, [key])
    if not pairs:
        return NO_SIBLING
    if figure in PAIR_KINDS and all(pair.kind is None for pair in pairs):
        return NO_KINDS
    return NO_SUCH_PAIR if figure in PAIR_KINDS and any(pair.frames for pair in pairs) else SAME_TRUTHS


def listen_summary(
    observations: Sequence[ObservationScores], siblings: Iterable[SiblingScores], *, intervals: bool = True
) -> ListenSummary | None:
    """Means over observations, each counting once; pair accuracies are means over groups, each counting once.

    Args:
        observations: of a part, a category, a room, or all; their order changes nothing.
        siblings: the groups; a pair counts if it involves one of the observations.
        intervals: whether to compute them.

    Returns:
        None if none of the observations was scored under ``listen``.
    """
    scored = [(one.group or one.key, one, one.listen) for one in observations if one.listen]
    if not scored:
        return None
    homes = {group: row.scan for group, row, _ in scored}
    # Figure → group → its values: one per observation, or one for the group's pairs.
    values: dict[str, dict[str, list[float]]] = {metric.name: {} for metric in metrics_of("listen")}
    for group, _, listen in scored:
        for name in values.keys() - {*PAIR_FIGURES}:
            if (value := getattr(listen, name)) is not None:
                values[name].setdefault(group, []).append(float(value))
    keys, known = [row.key for _, row, _ in scored], tuple(siblings)
    for name in PAIR_FIGURES:
        values[name] = {group: [value] for group, value in group_accuracies(known, keys, name).items()}
    found = {
        name: clustered_interval(list(groups.values()), homes=[homes[group] for group in groups])
        for name, groups in (values.items() if intervals else ())
    }
    why = {name: _reason(name, [listen for _, _, listen in scored]) for name in sorted(values) if not values[name]}
    return ListenSummary.model_validate(
        {name: mean(value for some in groups.values() for value in some) for name, groups in values.items()}
        | {
            "intervals": {name: pair for name, pair in found.items() if pair is not None},
            "counts": {name: sum(map(len, groups.values())) for name, groups in values.items()},
            "groups": len({group for group, _, _ in scored}),
            "unavailable": why,
        }
    )


def _reason(name: str, scored: Iterable[ListenObservation]) -> str:
    return "; ".join(sorted({one.unavailable[name] for one in scored if name in one.unavailable}))
