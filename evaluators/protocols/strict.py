"""Protocol ``strict``: masks where the object is visible, false alarms where it is not, twins, and the place in 3D.

As in `evaluators.protocols.official`, one function over the frames of an observation and one over observations.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from avs3d_bench.contract.scores import ObservationScores, Scores, StrictObservation, StrictSummary, metrics_of
from evaluators.metrics.frames import FrameFigures, visible_only
from evaluators.metrics.masks import mask_figures, mean
from evaluators.metrics.volume import VolumeScore
from evaluators.statistics.bootstrap import column_intervals

_MASK_FIGURES = ("IoU", "F", "boundary_F")
_ABSENT_FIGURES = ("FP_rate", "FP_area")

NEVER_VISIBLE = "the object is visible in no test frame"
ALWAYS_VISIBLE = "the object is visible in every test frame"
ONE_INSTANCE = "single-instance part: there is no twin"
NO_INSTANCE_MASKS = "the dataset has no instance masks"
NO_TWIN_SEEN = "no test frame shows a silent twin"
NO_POINTS = "the submission has no points.ply"
NO_MESH = "the dataset has no mesh of the object"
MOVING = "the object moves: it is in no one place in 3D"
EMPTY_CLOUD = "the predicted cloud is empty"


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
        **mask_figures(frame.counts for frame in frames),
        boundary_F=mean(frame.boundary_f for frame in visible if frame.boundary_f is not None),
        wrong_instance_rate=mean(float(frame.twins_marked > 0) for frame in with_twins),
        IoU_3D=None if volume is None else volume.iou,
        centroid_error=None if volume is None else volume.centroid_error,
        visible_frames=len(visible),
        absent_frames=len(absent),
        twin_frames=len(with_twins) if known else None,
        unavailable={name: why[name] for name in sorted(why)},
    )


def strict_summary(observations: Sequence[ObservationScores], *, intervals: bool = True) -> StrictSummary | None:
    """Means over observations, each counting once; None if none was scored under ``strict``.

    Args:
        observations: of a part, a category, a room, or all; their order changes nothing.
        intervals: whether to compute them.
    """
    found = [(scores.strict, scores.scan) for scores in observations if scores.strict]
    if not found:
        return None
    scored = [one for one, _ in found]
    known = {
        m.name: [(float(value), home) for one, home in found if (value := getattr(one, m.name)) is not None]
        for m in metrics_of("strict")
    }
    columns = {name: [value for value, _ in pairs] for name, pairs in known.items()}
    homes = {name: [home for _, home in pairs] for name, pairs in known.items()}
    why = {name: _reason(name, scored) for name, values in sorted(columns.items()) if not values}
    return StrictSummary.model_validate(
        {name: mean(values) for name, values in columns.items()}
        | {
            "intervals": column_intervals(columns, homes) if intervals else {},
            "counts": {name: len(values) for name, values in columns.items()},
            "unavailable": why,
        }
    )


def _reason(name: str, scored: Iterable[StrictObservation]) -> str:
    reasons = sorted({one.unavailable[name] for one in scored if name in one.unavailable})
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
