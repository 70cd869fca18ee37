"""From the frames of an observation to its scores, and from observations to means with intervals.

A protocol is a pair of pure functions: one over the frames of an observation, one over observations. Their versions
are in `avs3d_bench.contract.scores.PROTOCOLS`: change the version whenever a figure changes. Here are ``official`` and
``strict``; `evaluators.protocols.listen` has ``listen``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from avs3d_bench.contract.scores import (
    PROTOCOL_PARTS,
    PROTOCOLS,
    GroupScores,
    ObservationScores,
    OfficialObservation,
    OfficialSummary,
    Protocol,
    Scores,
    SiblingScores,
    StrictObservation,
    StrictSummary,
    metrics_of,
)
from avs3d_bench.errors import UsageError
from evaluators.metrics.frames import FrameFigures, visible_only
from evaluators.metrics.masks import f_measure, iou, mean, official_f, official_miou
from evaluators.metrics.volume import VolumeScore
from evaluators.protocols.listen import listen_summary
from evaluators.statistics.bootstrap import interval

_MASK_FIGURES = ("IoU", "F", "boundary_F")
_ABSENT_FIGURES = ("FP_rate", "FP_area")
_VOLUME_FIGURES = ("IoU_3D", "centroid_error")

NEVER_VISIBLE = "the object is visible in no test frame"
ALWAYS_VISIBLE = "the object is visible in every test frame"
ONE_INSTANCE = "single-instance part: there is no twin"
NO_INSTANCE_MASKS = "the dataset has no instance masks"
NO_TWIN_SEEN = "no test frame shows a silent twin"
NO_POINTS = "the submission has no points.ply"
NO_MESH = "the dataset has no mesh of the object"
MOVING = "the object moves: it is in no one place in 3D"
EMPTY_CLOUD = "the predicted cloud is empty"


def fitting(parts: Collection[str], asked: Sequence[Protocol] | None, where: str) -> tuple[Protocol, ...]:
    """The protocols to compute, in the order of `PROTOCOLS`.

    Args:
        parts: those that the observations belong to.
        asked: protocols that were asked for; None: those that fit.
        where: what messages name.

    Raises:
        UsageError: if one was asked for that scores none of the parts, or none fits.
    """
    fit = [name for name in PROTOCOLS if not {*PROTOCOL_PARTS[name]}.isdisjoint(parts)]
    for name in asked or ():
        if name not in fit:
            scored = " and ".join(PROTOCOL_PARTS[name])
            raise UsageError(
                f"{where}: protocol {name} scores {scored}; found only {' and '.join(sorted(parts))}, which "
                f"{' and '.join(fit)} score{'s' if len(fit) == 1 else ''}: leave out --protocol"
            )
    return tuple(name for name in fit if asked is None or name in asked)


def official_observation(frames: Sequence[FrameFigures]) -> OfficialObservation:
    """Protocol ``official`` on the test frames of one observation."""
    counts = [frame.counts for frame in frames]
    return OfficialObservation(mIoU=official_miou(counts), F=official_f(counts))


def strict_observation(
    frames: Sequence[FrameFigures], volume: VolumeScore | None, unavailable: Mapping[str, str]
) -> StrictObservation:
    """Protocol ``strict`` on the test frames of one observation.

    Args:
        frames: all of them.
        volume: the 3D figures, None where there are none.
        unavailable: why figures cannot be had that need more than frames (``wrong_instance_rate``, the 3D ones).
    """
    visible = visible_only(frames)
    absent = [frame for frame in frames if not frame.counts.truth]
    known = all(frame.twins is not None for frame in frames)
    with_twins = [frame for frame in frames if frame.twins]
    why = dict(unavailable)
    if not visible:
        why |= dict.fromkeys(_MASK_FIGURES, NEVER_VISIBLE)
    if not absent:
        why |= dict.fromkeys(_ABSENT_FIGURES, ALWAYS_VISIBLE)
    if "wrong_instance_rate" not in why and not with_twins:
        why["wrong_instance_rate"] = NO_TWIN_SEEN
    if volume is not None and volume.centroid_error is None:
        why["centroid_error"] = EMPTY_CLOUD
    return StrictObservation(
        IoU=mean(iou(frame.counts) for frame in visible),
        F=mean(f_measure(frame.counts) for frame in visible),
        boundary_F=mean(frame.boundary_f for frame in visible if frame.boundary_f is not None),
        FP_rate=mean(float(frame.counts.predicted > 0) for frame in absent),
        FP_area=mean(frame.counts.predicted / frame.counts.pixels for frame in absent),
        wrong_instance_rate=mean(float(frame.twins_marked > 0) for frame in with_twins),
        IoU_3D=None if volume is None else volume.iou,
        centroid_error=None if volume is None else volume.centroid_error,
        visible_frames=len(visible),
        absent_frames=len(absent),
        twin_frames=len(with_twins) if known else None,
        unavailable={name: why[name] for name in sorted(why)},
    )


def summarise(
    observations: Sequence[ObservationScores], siblings: Sequence[SiblingScores] = (), *, intervals: bool = True
) -> GroupScores:
    """Plain means over observations, each counting once, with bootstrap intervals.

    Args:
        observations: of one group, at least one; their order changes nothing.
        siblings: the groups of part_3; a pair counts if it involves one of the observations.
        intervals: without them the records are the same but for their ``intervals``.
    """
    officials = [scores.official for scores in observations if scores.official]
    stricts = [scores.strict for scores in observations if scores.strict]
    official = strict = None
    if officials:
        columns = {m.name: [float(getattr(o, m.name)) for o in officials] for m in metrics_of("official")}
        official = OfficialSummary.model_validate(
            {name: mean(values) for name, values in columns.items()} | {"intervals": _intervals(columns, intervals)}
        )
    if stricts:
        columns = {
            m.name: [float(value) for s in stricts if (value := getattr(s, m.name)) is not None]
            for m in metrics_of("strict")
        }
        why = {name: _reason(name, stricts) for name, values in sorted(columns.items()) if not values}
        strict = StrictSummary.model_validate(
            {name: mean(values) for name, values in columns.items()}
            | {
                "intervals": _intervals(columns, intervals),
                "counts": {name: len(values) for name, values in columns.items()},
                "unavailable": why,
            }
        )
    return GroupScores(
        observations=len(observations),
        frames=sum(o.frames for o in observations),
        official=official,
        strict=strict,
        listen=listen_summary(observations, siblings, intervals=intervals),
    )


def _intervals(columns: Mapping[str, Sequence[float]], wanted: bool) -> dict[str, tuple[float, float]]:
    found = {name: interval(values) for name, values in columns.items()} if wanted else {}
    return {name: pair for name, pair in found.items() if pair is not None}


def _reason(name: str, stricts: Sequence[StrictObservation]) -> str:
    reasons = sorted({strict.unavailable[name] for strict in stricts if name in strict.unavailable})
    return "; ".join(reasons)


def unseen_note(scores: Scores) -> str | None:
    """Which figures leave out the observations whose object no test frame shows; None if there is none.

    Under ``listen`` such observations belong to the task: a sibling may be silent.
    """
    rows = [row.strict for row in scores.observations if row.strict is not None]
    unseen = sum(row.visible_frames == 0 for row in rows)
    if not unseen:
        return None
    left = len(rows) - unseen
    means = f"are means over the other {left}" if left else "have no value"
    official = "; official mIoU counts an empty mask as 1 there, and official F is 0" if scores.overall.official else ""
    shows = "shows" if unseen == 1 else "show"
    return (
        f"{unseen} of {len(rows)} observations never {shows} the object in a test frame: strict IoU, F and boundary F "
        f"{means}{official}; every eighth frame is a test frame: longer observations show it more often "
        "(avs3d generate --frames)"
    )
