"""From the scores of observations to the record that a file of scores holds: means, groups, reference rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from avs3d_bench import __version__
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ProvenanceRecord
from avs3d_bench.contract.scores import (
    ALL_REFERENCES,
    BLIND_REFERENCES,
    DEAF_ORACLES,
    PROTOCOLS,
    Evaluator,
    GroupScores,
    ObservationScores,
    Protocol,
    ScoredDataset,
    ScoredSubmission,
    Scores,
    SiblingScores,
)
from avs3d_bench.contract.taxonomy import PARTS, ROOMS, class_ids
from avs3d_bench.dataset import Dataset
from avs3d_bench.formats.files import sha256_file
from evaluators.metrics.volume import VOXEL_SIZE
from evaluators.protocols.listen import listen_summary
from evaluators.protocols.official import official_summary
from evaluators.protocols.strict import NO_INSTANCE_MASKS, strict_summary
from evaluators.reading.origin import this_machine, totals
from evaluators.reading.records import GroupOutcome, ScoredObservation, Submission
from evaluators.statistics import bootstrap


def score_record(
    submission: Submission,
    dataset: Dataset,
    wanted: Sequence[Protocol],
    points: bool,
    outcomes: Sequence[ScoredObservation],
    groups: Sequence[GroupOutcome],
    software: ProvenanceRecord,
) -> Scores:
    """The record of scores: observations, and their means over parts, categories and rooms.

    Args:
        submission: that was scored.
        dataset: that it was compared with.
        wanted: the protocols.
        points: whether the submission has 3D predictions.
        outcomes: of the observations, in their order; none of them bad.
        groups: of the observations that were scored together, in their order.
        software: that computed the figures.
    """
    scored = [outcome.scores for outcome in outcomes if outcome.scores is not None]
    siblings = [group.siblings for group in groups if group.siblings is not None]
    record = dataset.record
    digest, truth = totals(scored)
    known, missing = _references(outcomes)
    known_categories = class_ids(record.categories or () if record else ())
    others = {scores.category for scores in scored if scores.category is not None} - known_categories.keys()
    categories = [*known_categories, *sorted(others)]
    return Scores(
        avs3d_eval=Evaluator(
            version=__version__,
            protocols={name: version for name, version in PROTOCOLS.items() if name in wanted},
            bootstrap_resamples=bootstrap.RESAMPLES,
            bootstrap_seed=bootstrap.SEED,
            bootstrap_unit="home",
            voxel_size=VOXEL_SIZE,
            provenance=software,
            machine=this_machine(),
        ),
        submission=ScoredSubmission(
            **submission.record.model_dump(),
            layout=submission.layout,
            masks=submission.masks,
            points=points,
            digest=digest,
        ),
        dataset=ScoredDataset(
            name=dataset.name,
            version=dataset.version,
            sha256=sha256_file(dataset.root / layout.DATASET_JSON) if record else None,
            observations=len(dataset),
            scored=len(scored),
            provenance=record.provenance if record else None,
            truth_digest=truth,
        ),
        observations=tuple(scored),
        siblings=tuple(siblings) if "listen" in wanted else None,
        overall=summarise(scored, siblings),
        parts=_grouped(scored, siblings, PARTS, "part"),
        categories=_grouped(scored, siblings, categories, "category"),
        rooms=_grouped(scored, siblings, ROOMS, "room"),
        references={
            name: _reference(
                [outcome.references[name] for outcome in outcomes if name in outcome.references],
                [group.references[name] for group in groups if name in group.references],
            )
            for name in known
        },
        references_unavailable=dict.fromkeys(missing, NO_INSTANCE_MASKS) if {"strict", "listen"} & {*wanted} else {},
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
    return GroupScores(
        observations=len(observations),
        frames=sum(o.frames for o in observations),
        official=official_summary(observations, intervals=intervals),
        strict=strict_summary(observations, intervals=intervals),
        listen=listen_summary(observations, siblings, intervals=intervals),
    )


def _references(outcomes: Sequence[ScoredObservation]) -> tuple[list[str], list[str]]:
    """Names of the reference rows, and of those that some observation lacks.

    A row covers all observations of its protocol or is left out, because it is printed beside means over all of them.
    """
    known: list[str] = []
    missing: list[str] = []
    for name in ALL_REFERENCES:
        concerned = [
            outcome.references
            for outcome in outcomes
            if outcome.scores is not None
            and (name in BLIND_REFERENCES or (name in DEAF_ORACLES) == (outcome.scores.listen is not None))
        ]
        if concerned:
            (known if all(name in beside for beside in concerned) else missing).append(name)
    return known, missing


def _grouped(
    scored: Sequence[ObservationScores], siblings: Sequence[SiblingScores], names: Iterable[str], field: str
) -> dict[Any, GroupScores]:
    """Group → its means, in the order of ``names``, without those that have no observation."""
    groups = {name: [scores for scores in scored if getattr(scores, field) == name] for name in names}
    return {name: summarise(group, siblings) for name, group in groups.items() if group}


def _reference(scored: Sequence[ObservationScores], siblings: Sequence[SiblingScores]) -> dict[str, GroupScores]:
    """A reference's means; without intervals, because no reference is compared by them."""
    groups = {part: [scores for scores in scored if scores.part == part] for part in PARTS}
    parts = {part: summarise(group, siblings, intervals=False) for part, group in groups.items() if group}
    return parts | {"overall": summarise(scored, siblings, intervals=False)}
