"""Scores of questions about sound (`avs3d qa-score --json`) on a leaderboard: tables beside those of masks.

Rows are in the order of their pair accuracy, with intervals. They have no places: no test compares them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from avs3d_bench.commands.outputs import Signature
from avs3d_bench.contract.questions import QaScores, QuestionSource
from avs3d_bench.contract.schema import Record, Sha256, Text, parse_record
from avs3d_bench.formats.files import read_bytes, sha256_bytes

#: What a file of such scores says that it is; in a string of another file the quotation marks would be escaped.
_OF_QUESTIONS = Signature(marks=(f'"format": "{QaScores.model_fields["format"].default}"'.encode(),))


class QuestionRow(Record):
    """A file of scores of questions."""

    digest: Sha256 = Field(description="of the file")
    file: Text = Field(description="its name")
    scores: QaScores


class QuestionTable(Record):
    """The rows of one folder of questions, the greatest pair accuracy first."""

    questions: QuestionSource
    rows: tuple[QuestionRow, ...]


def split_questions(files: Sequence[Path]) -> tuple[list[Path], tuple[QuestionTable, ...]]:
    """The files of scores of masks among some, and the tables of the others; a file given twice counts once.

    Raises:
        Avs3dError: if a file is missing or damaged.
    """
    masks: list[Path] = []
    found: dict[QuestionSource, dict[str, QuestionRow]] = {}
    for path in sorted(map(Path, files)):
        if not _OF_QUESTIONS.matches(path):
            masks.append(path)
            continue
        data = read_bytes(path)
        row = QuestionRow(digest=sha256_bytes(data), file=path.name, scores=parse_record(data, QaScores, path))
        found.setdefault(row.scores.questions, {}).setdefault(row.digest, row)
    order = sorted(found, key=lambda one: (one.dataset, one.dataset_version, one.sha256))
    return masks, tuple(QuestionTable(questions=one, rows=_best_first(list(found[one].values()))) for one in order)


def _best_first(rows: Sequence[QuestionRow]) -> tuple[QuestionRow, ...]:
    def order(row: QuestionRow) -> tuple[float, float, str, str]:
        return -row.scores.overall.pair_accuracy, -row.scores.overall.accuracy, row.scores.method, row.digest

    return tuple(sorted(rows, key=order))
