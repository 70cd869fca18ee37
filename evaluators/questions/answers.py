"""Reading answers: JSON lines, or the log of `inspect eval`; and the file of scores."""

from __future__ import annotations

from pathlib import Path

from avs3d_bench import __version__
from avs3d_bench.contract.questions import (
    QA_JSON,
    AnswerLine,
    QaScores,
    QuestionSource,
    QuestionsRecord,
)
from avs3d_bench.contract.schema.base import parse_record
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_bytes, read_record, sha256_bytes
from avs3d_bench.formats.questions import parse_questions, questions_file
from avs3d_bench.runtime.imports import needing
from evaluators.questions.score import score_answers

#: Largest file of answers (bytes): a thousand for each of a hundred thousand questions.
_MOST_BYTES = 100_000_000


def score_file(path: str | Path, questions: str | Path, method: str | None = None) -> QaScores:
    """Score a file of answers.

    Args:
        path: JSON lines with ``id`` and ``answer``, or a log of `inspect eval` (``.eval``, ``.json``).
        questions: the folder that `avs3d export qa` wrote.
        method: its name; None: the model and solver of the log, or the file's name.

    Raises:
        UsageError: if the folder holds no questions.
        Avs3dError: if a line is damaged, answers are missing or do not belong to these questions.
    """
    file = questions_file(questions)
    text = read_bytes(file)
    record = read_record(file.with_name(QA_JSON), QuestionsRecord)
    if sha256_bytes(text) != record.questions_sha256:
        raise Avs3dError(f"{file}: not what {QA_JSON} names; export the questions again")
    lines = parse_questions(text, file)
    name, answers = read_answers(Path(path))
    try:
        overall, kinds = score_answers(lines, answers)
    except Avs3dError as error:
        raise Avs3dError(f"{path}: {error}") from None
    source = QuestionSource(
        dataset=record.dataset, dataset_version=record.dataset_version, sha256=record.questions_sha256
    )
    return QaScores(
        toolkit_version=__version__, method=method or name, questions=source, overall=overall, kinds=kinds
    )  # fmt: skip


def read_answers(path: Path) -> tuple[str, dict[str, str]]:
    """The name of a method, and its answers by id.

    Raises:
        Avs3dError: if the file is missing or damaged, or answers a question twice.
    """
    return _from_log(path) if path.suffix in (".eval", ".json") else _from_lines(path)


def _from_lines(path: Path) -> tuple[str, dict[str, str]]:
    found: dict[str, str] = {}
    for number, text in enumerate(read_bytes(path, _MOST_BYTES).splitlines(), start=1):
        if text.strip():
            line = parse_record(text, AnswerLine, f"{path}:{number}")
            if line.id in found:
                raise Avs3dError(f"{path}:{number}: {line.id} is answered twice; expected one answer to each question")
            found[line.id] = line.answer
    return path.stem, found


def _from_log(path: Path) -> tuple[str, dict[str, str]]:
    with needing("a log of inspect eval", "pip install 'avs3d-bench[qa]'"):
        from inspect_ai.log import read_eval_log
    try:
        log = read_eval_log(str(path))
    except Exception as error:  # whatever its readers raise
        raise Avs3dError(
            f"{path}: no log of inspect eval ({type(error).__name__}); expected one, or JSON lines in a .jsonl file"
        ) from None
    if log.status != "success":
        raise Avs3dError(f"{path}: the evaluation ended with {log.status}; expected success: see `inspect eval-retry`")
    steps = [step.solver for step in log.plan.steps] if log.plan else []
    name = " ".join([log.eval.model, *(step for step in steps if step != "generate")])
    found: dict[str, str] = {}
    for sample in log.samples or ():
        if sample.epoch > 1:
            raise Avs3dError(f"{path}: {sample.epoch} epochs; expected one answer to each question")
        found[str(sample.id)] = sample.output.completion
    return name, found
