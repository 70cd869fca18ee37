"""Protocol ``official``: the scoring of the released code.

A protocol is a pair of pure functions: one over the frames of an observation, one over observations. Their versions
are in `avs3d_bench.contract.scores.PROTOCOLS`: change the version whenever a figure changes. `evaluators.summary` takes
the means of all protocols together.
"""

from __future__ import annotations

from collections.abc import Sequence

from avs3d_bench.contract.scores import ObservationScores, OfficialObservation, OfficialSummary, metrics_of
from evaluators.metrics.frames import FrameFigures
from evaluators.metrics.masks import mean, official_f, official_miou
from evaluators.statistics.bootstrap import column_intervals


def official_observation(frames: Sequence[FrameFigures]) -> OfficialObservation:
    """Protocol ``official`` on the test frames of one observation."""
    counts = [frame.counts for frame in frames]
    return OfficialObservation(mIoU=official_miou(counts), F=official_f(counts))


def official_summary(observations: Sequence[ObservationScores], *, intervals: bool = True) -> OfficialSummary | None:
    """Means over observations, each counting once; None if none was scored under ``official``.

    Args:
        observations: of a part, a category, a room, or all; their order changes nothing.
        intervals: whether to compute them.
    """
    scored = [(scores.official, scores.scan) for scores in observations if scores.official]
    if not scored:
        return None
    columns = {m.name: [float(getattr(one, m.name)) for one, _ in scored] for m in metrics_of("official")}
    homes = {name: [home for _, home in scored] for name in columns}
    return OfficialSummary.model_validate(
        {name: mean(values) for name, values in columns.items()}
        | {"intervals": column_intervals(columns, homes) if intervals else {}}
    )
