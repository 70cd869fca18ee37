"""A task of inspect_ai: a model sees the pictures, hears the clips, and chooses an option.

    inspect eval evaluators/sound_questions -T folder=qa --model …

Needs the extra ``[qa]``. What a model gets of a line is `messages_of`: question, options, pictures and sound, and
nothing by which lines or files are known. https://inspect.aisi.org.uk
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from inspect_ai import Task, task
from inspect_ai.dataset import MemoryDataset, Sample
from inspect_ai.model import ChatMessageUser, ContentAudio, ContentImage, ContentText
from inspect_ai.scorer import Score, Target, mean, metric, scorer
from inspect_ai.solver import TaskState, generate

from avs3d_bench.contract.questions import QUESTION_KINDS, QuestionLine
from avs3d_bench.errors import UsageError
from avs3d_bench.formats.questions import read_questions
from evaluators.questions.score import is_right, score_answers

Sound = Literal["binaural", "ambisonics", "none"]


@task  # type: ignore[untyped-decorator]
def sound_questions(folder: str, kinds: str | list[str] = "", sound: Sound = "binaural", pictures: bool = True) -> Any:
    """The questions of a folder that `avs3d export qa` wrote.

    Args:
        folder: it.
        kinds: some of the kinds, as a list or with commas between them; all if empty.
        sound: what is heard: ``binaural``, ``ambisonics``, or ``none`` (a deaf control).
        pictures: whether the pictures are shown; False is a blind control.
    """
    # The command line of inspect makes a list of what has commas.
    wanted = tuple(kinds.split(",") if isinstance(kinds, str) else kinds) if kinds else QUESTION_KINDS
    lines = tuple(line for line in read_questions(folder) if line.kind in wanted)
    if not lines or not {*wanted} <= {*QUESTION_KINDS}:
        named = ", ".join(wanted)
        raise UsageError(f"{folder}: no questions of kind {named}; expected some of {', '.join(QUESTION_KINDS)}")
    if sound == "ambisonics" and any(line.ambisonics is None for line in lines):
        raise UsageError(f"{folder}: no ambisonics; export a dataset that was generated --with ambisonics")
    samples = [
        Sample(
            id=line.id, input=messages_of(line, Path(folder), sound=sound, pictures=pictures), target=line.answer,
            choices=None, metadata={"line": line.model_dump(mode="json"), "folder": str(Path(folder).resolve())},
        )
        for line in lines
    ]  # fmt: skip
    return Task(dataset=MemoryDataset(samples, name="avs3d-qa"), solver=generate(), scorer=exact_option())


def messages_of(line: QuestionLine, folder: Path, *, sound: Sound = "binaural", pictures: bool = True) -> list[Any]:
    """What a model is given of a line.

    Args:
        line: the question.
        folder: where its pictures and clips are.
        sound: which clips, or none.
        pictures: whether pictures are shown.
    """
    base = folder.resolve()
    content: list[Any] = [ContentImage(image=str(base / name)) for name in line.pictures if pictures]
    clips = {"binaural": line.audio, "ambisonics": line.ambisonics or (), "none": ()}[sound]
    content += [ContentAudio(audio=str(base / name), format="wav") for name in clips]
    heard = {
        "binaural": "You hear one second with two ears: the first channel is the left ear, the second the right ear.",
        "ambisonics": "You hear one second of ambisonics (ACN, SN3D; x ahead, y left, z up).",
        "none": "You cannot hear anything.",
    }[sound]
    if len(clips) > 1:
        heard = heard.replace("one second", "two recordings of one second, one after the other,")
    options = "\n".join(line.options)
    content.append(
        ContentText(
            text=f"{heard}\n\n{line.question}\n\nAnswer with one of these options, word for word, and nothing else:\n"
            f"{options}"
        )
    )
    return [ChatMessageUser(content=content)]


def _lines_of(scores: list[Any]) -> tuple[list[QuestionLine], dict[str, str]]:
    lines = [QuestionLine.model_validate(one.score.metadata["line"]) for one in scores]
    return lines, {line.id: str(one.score.answer or "") for line, one in zip(lines, scores, strict=True)}


@metric  # type: ignore[untyped-decorator]
def pair_accuracy() -> Any:
    """Share of pairs of a set that are both right: mean over kinds and groups, as `avs3d qa-score` has it."""

    def compute(scores: list[Any]) -> float:
        return score_answers(*_lines_of(scores))[0].pair_accuracy if scores else 0.0

    return compute


@metric  # type: ignore[untyped-decorator]
def by_kind() -> Any:
    """Accuracy and chance of each kind, as `avs3d qa-score` has them."""

    def compute(scores: list[Any]) -> dict[str, float]:
        if not scores:
            return {}
        overall, kinds = score_answers(*_lines_of(scores))
        figures = [*kinds.items(), ("all", overall)]
        return {f"{name}{end}": value for name, one in figures
                for end, value in (("", one.accuracy), ("_chance", one.chance))}  # fmt: skip

    return compute


@scorer(metrics=[mean(), pair_accuracy(), by_kind()])  # type: ignore[untyped-decorator]
def exact_option() -> Any:
    """1 if the answer is the right option word for word, else 0."""

    async def score(state: TaskState, target: Target) -> Score:
        line = state.metadata["line"]
        answer = state.output.completion
        right = is_right(QuestionLine.model_validate(line), answer)
        return Score(value=int(right), answer=answer, metadata={"line": line})

    return score
