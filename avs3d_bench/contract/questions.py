"""Files of `avs3d export qa`: questions about what is heard, with exact answers.

    DIR/questions.jsonl    one `QuestionLine` a line
    DIR/qa.json            `QuestionsRecord`: where they come from, and counts of each kind
    DIR/scenes.json        `ScenesRecord`: what each picture shows, for solvers that cannot see
    DIR/pictures/, audio/, ambisonics/

Lines with the same ``set`` are one question, asked under several sounds. Each of its options is right under exactly one
of them: whoever gives the same answer under all is right in one.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, Self, get_args

from pydantic import Field, model_validator

from avs3d_bench.contract.schema.base import FrameName, NonNegative, Record, RelativePath, Sha256, Text

QUESTIONS_JSONL = "questions.jsonl"
QA_JSON = "qa.json"
SCENES_JSON = "scenes.json"

QuestionKind = Literal["which", "side", "azimuth", "distance", "count", "anything", "room", "moved"]
QUESTION_KINDS: tuple[QuestionKind, ...] = get_args(QuestionKind)
#: What is played: a sibling's own sound, that with left and right exchanged, or nothing.
Played = Literal["own", "swapped", "silence"]
Rate = Annotated[float, Field(ge=0, le=1)]


class QuestionLine(Record):
    """One question under one sound.

    A method gets `question`, `options`, `pictures` and the sound (`audio` or `ambisonics`). The other fields are for
    scoring: ``observation`` leads to the truth, ``played`` and ``answer`` are part of it.
    """

    left_out: ClassVar[frozenset[str]] = frozenset({"ambisonics"})

    id: Text = Field(description="q00001, …: numbers in a drawn order, which tells nothing")
    set: Text = Field(description="the lines with the same question, pictures and options under other sounds")
    kind: QuestionKind
    group: Text = Field(description="group of siblings: key of the observation whose pictures they share")
    frame: FrameName
    question: Text
    options: Annotated[tuple[Text, ...], Field(min_length=2)] = Field(description="in a drawn order, the set's own")
    answer: Text = Field(description="one of the options")
    observation: Text = Field(description="key of the sibling that sounds (first); of one of the set's in silence")
    played: Played
    pictures: tuple[RelativePath, ...]
    audio: Annotated[tuple[RelativePath, ...], Field(min_length=1)] = Field(description="binaural WAV, channel 0 left")
    ambisonics: tuple[RelativePath, ...] | None = Field(default=None, description="the same clips, ACN, SN3D")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.answer not in self.options or len({*self.options}) != len(self.options):
            raise ValueError(f"answer {self.answer!r}, options {self.options}: expected one of the options, each once")
        return self


class KindCounts(Record):
    """The lines of one kind. Every rule that does not hear reaches ``chance``, whatever it prefers."""

    sets: int
    lines: int
    groups: int
    chance: Rate = Field(description="mean of 1 / number of options over the lines")
    prior_excess: float = Field(description="how much the best answer that ignores the sound exceeds chance: of every "
                                "text and of every position among the options")  # fmt: skip
    answers: dict[str, int] = Field(description="answer → lines")
    positions: tuple[int, ...] = Field(description="lines whose answer is the first option, the second, …")


class QuestionsRecord(Record):
    """`qa.json`."""

    format: Literal["avs3d qa 1"] = "avs3d qa 1"
    toolkit_version: Text
    dataset: Text
    dataset_version: Text
    dataset_sha256: Sha256 | None = Field(description="of dataset.json; null where there is none")
    licence: Text | None
    seed: int
    split: Literal["train", "test", "all"]
    questions_sha256: Sha256 = Field(description="of questions.jsonl")
    kinds: dict[QuestionKind, KindCounts]


class ShownObject(Record):
    """One object in a picture. Angles are from the camera, degrees; azimuth is positive to the right."""

    mark: Text | None = Field(description="the letter that the picture marks it with")
    category: Text
    azimuth: float
    elevation: float
    distance: NonNegative = Field(description="metres")


class ScenesRecord(Record):
    """`scenes.json`: picture → the objects in it that could sound, from left to right."""

    scenes: dict[str, tuple[ShownObject, ...]]


def by_set(lines: tuple[QuestionLine, ...]) -> Iterator[tuple[QuestionLine, ...]]:
    """The lines of each set, in the order in which sets first occur."""
    found: dict[str, list[QuestionLine]] = {}
    for line in lines:
        found.setdefault(line.set, []).append(line)
    yield from map(tuple, found.values())


def count_kinds(lines: tuple[QuestionLine, ...]) -> dict[QuestionKind, KindCounts]:
    """The counts of each kind that occurs."""
    return {
        kind: _counts(mine) for kind in QUESTION_KINDS if (mine := tuple(line for line in lines if line.kind == kind))
    }


def _counts(lines: tuple[QuestionLine, ...]) -> KindCounts:
    chance = sum(1 / len(line.options) for line in lines) / len(lines)
    answers: dict[str, int] = {}
    positions = [0] * max(len(line.options) for line in lines)
    for line in lines:
        answers[line.answer] = answers.get(line.answer, 0) + 1
        positions[line.options.index(line.answer)] += 1
    texts = [[line.answer == text for line in lines if text in line.options] for text in answers]
    places = [
        [line.options.index(line.answer) == place for line in lines if place < len(line.options)]
        for place in range(len(positions))
    ]
    bases = [[1 / len(line.options) for line in lines if text in line.options] for text in answers]
    bases += [[1 / len(line.options) for line in lines if place < len(line.options)] for place in range(len(positions))]
    excess = [
        (sum(right) - sum(base)) / len(base) for right, base in zip([*texts, *places], bases, strict=True) if base
    ]
    return KindCounts(
        sets=len({line.set for line in lines}), lines=len(lines), groups=len({line.group for line in lines}),
        chance=chance, prior_excess=max(excess), answers=dict(sorted(answers.items())), positions=tuple(positions),
    )  # fmt: skip


class AnswerLine(Record):
    """One line of a file of answers."""

    id: Text = Field(description="of a line of questions.jsonl")
    answer: str


class KindScore(Record):
    """The figures of one kind of question, or of all.

    Means over groups, each of which counts alike; ``chance`` is weighted in the same way.
    """

    lines: int
    groups: int
    accuracy: Rate
    chance: Rate = Field(description="of every rule that does not hear")
    pair_accuracy: Rate = Field(
        description="share of pairs of lines of a set that are both right; lines of silence are left out, unless a set "
        "has one other line only"
    )
    pairs: int
    outside: int = Field(description="answers that are none of the options: wrong")
    accuracy_interval: tuple[float, float] | None = Field(description="95 %, over homes, then groups")
    pair_interval: tuple[float, float] | None


class QuestionSource(Record):
    """The questions that were answered."""

    dataset: Text
    dataset_version: Text
    sha256: Sha256 = Field(description="of questions.jsonl")


class QaScores(Record):
    """The file of `avs3d qa-score --json`: a row of a leaderboard."""

    format: Literal["avs3d qa scores 1"] = "avs3d qa scores 1"
    toolkit_version: Text
    method: Text
    questions: QuestionSource
    overall: KindScore = Field(description="of all kinds; in each group every kind counts alike")
    kinds: dict[QuestionKind, KindScore]
