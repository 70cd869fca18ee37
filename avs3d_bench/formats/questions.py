"""Reading the questions of `avs3d export qa`."""

from __future__ import annotations

from pathlib import Path

from avs3d_bench.contract.questions import QUESTIONS_JSONL, QuestionLine
from avs3d_bench.contract.schema.base import parse_record
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import read_bytes


def parse_questions(data: bytes, where: str | Path) -> tuple[QuestionLine, ...]:
    """The lines of a file of questions.

    Raises:
        Avs3dError: naming the line and the first wrong field.
    """
    lines = tuple(
        parse_record(text, QuestionLine, f"{where}:{number}")
        for number, text in enumerate(data.splitlines(), start=1)
        if text.strip()
    )
    if not lines:
        raise Avs3dError(f"{where}: empty; expected the lines of `avs3d export qa`")
    if len({line.id for line in lines}) != len(lines):
        raise Avs3dError(
            f"{where}: an id is listed twice; expected a question a line, as `avs3d export qa` writes them"
        )
    return lines


def read_questions(folder: str | Path) -> tuple[QuestionLine, ...]:
    """The questions of a folder that `avs3d export qa` wrote.

    Raises:
        UsageError: if the folder holds none.
        Avs3dError: if a line is damaged; the line and the first wrong field are named.
    """
    path = questions_file(folder)
    return parse_questions(read_bytes(path), path)


def questions_file(folder: str | Path) -> Path:
    """The file of lines in a folder that `avs3d export qa` wrote.

    Raises:
        UsageError: if there is none.
    """
    path = Path(folder) / QUESTIONS_JSONL
    if not path.is_file():
        raise UsageError(f"{folder}: no {QUESTIONS_JSONL}; expected a folder that `avs3d export qa` wrote")
    return path
