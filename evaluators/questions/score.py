"""From answers to scores: accuracy and pair accuracy by kind, means over groups.

    score_answers(questions, {"q00001": "left", …})

An answer is right if it is the option that is right, word for word; case, space around it, quotation marks and a full
stop at its end are no matter. A pair is two lines of one set under different sounds: whoever does not hear gives both
the same answer, and is never right in both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.contract.questions import QUESTION_KINDS, KindScore, QuestionKind, QuestionLine, by_set
from avs3d_bench.errors import Avs3dError
from evaluators.statistics.bootstrap import interval

#: Ids that a message lists.
_NAMED = 3


def normalise(answer: str) -> str:
    """An answer without what is no part of it.

    Examples:
        >>> normalise(' "Left". ')
        'left'
    """
    return answer.strip().strip(".*\"'`").strip().casefold()


def is_right(line: QuestionLine, answer: str) -> bool:
    """Whether an answer is the right option of a line."""
    return normalise(answer) == normalise(line.answer)


@dataclass(frozen=True)
class _GroupFigures:
    """The figures of a group: its home, accuracy, chance, and pair accuracy; None without a pair."""

    home: str
    accuracy: float
    chance: float
    pairs: float | None


def score_answers(
    lines: Sequence[QuestionLine], answers: Mapping[str, str]
) -> tuple[KindScore, dict[QuestionKind, KindScore]]:
    """The scores of all kinds together, and of each.

    Args:
        lines: the questions.
        answers: id → answer, one for each line.

    Raises:
        Avs3dError: if a line has no answer, or an answer belongs to no line.
    """
    known = {line.id for line in lines}
    for what, names in (("questions without an answer", known - answers.keys()),
                        ("answers to no question", answers.keys() - known)):  # fmt: skip
        if names:
            first = ", ".join(sorted(names)[:_NAMED])
            raise Avs3dError(f"{len(names):,} {what}: {first}{' …' if len(names) > _NAMED else ''}; expected one for "
                             "each line of questions.jsonl")  # fmt: skip
    groups = {
        kind: _by_group([line for line in lines if line.kind == kind], answers)
        for kind in QUESTION_KINDS
        if any(line.kind == kind for line in lines)
    }
    kinds = {
        kind: _summary([line for line in lines if line.kind == kind], answers, found) for kind, found in groups.items()
    }
    together: dict[str, list[_GroupFigures]] = {}
    for found in groups.values():
        for group, figures in found.items():
            together.setdefault(group, []).append(figures)
    return _summary(lines, answers, {group: _mean(some) for group, some in sorted(together.items())}), kinds


def pairs_of(lines: Sequence[QuestionLine]) -> list[tuple[QuestionLine, QuestionLine]]:
    """The pairs of a set: of its lines that sound; with silence if only one sounds."""
    sounding = [line for line in lines if line.played != "silence"]
    return list(combinations(sounding if len(sounding) > 1 else lines, 2))


def _by_group(lines: Sequence[QuestionLine], answers: Mapping[str, str]) -> dict[str, _GroupFigures]:
    found = {}
    for group in sorted({line.group for line in lines}):
        mine = [line for line in lines if line.group == group]
        right = {line.id: is_right(line, answers[line.id]) for line in mine}
        both = [right[a.id] and right[b.id] for some in by_set(tuple(mine)) for a, b in pairs_of(some)]
        found[group] = _GroupFigures(
            layout.parse_key(group).scan, float(np.mean(list(right.values()))),
            float(np.mean([1 / len(line.options) for line in mine])), float(np.mean(both)) if both else None,
        )  # fmt: skip
    return found


def _mean(some: Sequence[_GroupFigures]) -> _GroupFigures:
    """One group over several kinds."""
    pairs = [one.pairs for one in some if one.pairs is not None]
    return _GroupFigures(
        some[0].home, float(np.mean([one.accuracy for one in some])), float(np.mean([one.chance for one in some])),
        float(np.mean(pairs)) if pairs else None,
    )  # fmt: skip


def _summary(
    lines: Sequence[QuestionLine], answers: Mapping[str, str], groups: Mapping[str, _GroupFigures]
) -> KindScore:
    paired = [one for one in groups.values() if one.pairs is not None]
    return KindScore(
        lines=len(lines),
        groups=len(groups),
        accuracy=float(np.mean([one.accuracy for one in groups.values()])),
        chance=float(np.mean([one.chance for one in groups.values()])),
        pair_accuracy=float(np.mean([one.pairs for one in paired])) if paired else 0.0,
        pairs=sum(len(pairs_of(some)) for some in by_set(tuple(lines))),
        outside=sum(normalise(answers[line.id]) not in map(normalise, line.options) for line in lines),
        accuracy_interval=interval(
            [one.accuracy for one in groups.values()], homes=[one.home for one in groups.values()]
        ),
        pair_interval=interval([one.pairs or 0.0 for one in paired], homes=[one.home for one in paired]),
    )
