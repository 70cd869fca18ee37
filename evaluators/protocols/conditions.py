"""Conditions: the acoustics and the background of observations that are variants of one another.

Variants have the same pictures, path and source signals (`avs3d sweep`). A file of scores says which observations are
variants of which, and in what they differ, so that their scores can be compared without the dataset.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Literal

from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.contract.scores import ConditionField, ConditionRecord, Scores
from avs3d_bench.dataset import Observation


def condition_of(record: ObservationRecord) -> ConditionRecord:
    """The condition that observation.json states."""
    scale = record.acoustics.settings.get("absorption_scale", 1.0)
    values: dict[ConditionField, float | Literal["room_tone", "noise"] | None] = {
        "acoustics.absorption_scale": float(scale) if isinstance(scale, int | float) else 1.0
    }
    if record.is_part_3:
        background = record.background
        values["background.snr_db"] = background.snr_db if background else None
        values["background.kind"] = background.kind if background else None
    return ConditionRecord(variant_of=record.variant_of or record.key, values=values, t30=record.acoustics.t30)


def with_conditions(scores: Scores, observations: Sequence[Observation]) -> Scores:
    """The scores with the conditions of observations that are variants of one another; others have none.

    Args:
        scores: of the observations.
        observations: all that were scored, in the same order.
    """
    # Variants share part, scan and room: an observation that is alone there need not be read.
    places = Counter((o.place.part, o.place.scan, o.place.room) for o in observations)
    records = {
        o.key: o.record for o in observations if places[o.place.part, o.place.scan, o.place.room] > 1 and o.record
    }
    variants = Counter(record.variant_of or key for key, record in records.items())
    conditions = {
        key: condition_of(record) for key, record in records.items() if variants[record.variant_of or key] > 1
    }
    if not conditions:
        return scores
    rows = tuple(row.model_copy(update={"condition": conditions.get(row.key)}) for row in scores.observations)
    return scores.model_copy(update={"observations": rows})
