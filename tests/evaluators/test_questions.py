"""Scores of answers to questions: accuracy and pair accuracy by hand, and every bad file named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from avs3d_bench.contract.questions import QuestionLine
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.qa.write import QaOptions, write_qa
from avs3d_bench.formats.questions import read_questions
from evaluators.questions.answers import read_answers, score_file
from evaluators.questions.cli import qa_score
from evaluators.questions.score import is_right, score_answers
from tests.support.shared import SharedDataset

#: Group, set, played, answer of lines; the options of a set are its answers.
ROWS = [
    ("a", "s1", "own", "left"), ("a", "s1", "swapped", "right"), ("a", "s1", "silence", "nothing sounds"),
    ("a", "s2", "own", "left"), ("a", "s2", "own", "right"), ("a", "s2", "silence", "nothing sounds"),
    ("b", "s3", "own", "yes"), ("b", "s3", "silence", "no"),
]  # fmt: skip


def lines() -> list[QuestionLine]:
    options = {s: tuple(answer for _, other, _, answer in ROWS if other == s) for _, s, _, _ in ROWS}
    return [
        QuestionLine(
            id=f"q{n}", set=s, kind="anything" if s == "s3" else "side", group=f"part_3/{group}/kitchen/1",
            frame="frame_000", question="?", options=options[s], answer=answer, observation=f"part_3/{group}/kitchen/1",
            played=played, pictures=("p.png",), audio=("a.wav",),
        )  # type: ignore[arg-type]
        for n, (group, s, played, answer) in enumerate(ROWS)
    ]  # fmt: skip


def test_pairs_are_lines_that_sound_or_where_that_is_asked_sound_and_silence() -> None:
    answers = {line.id: line.answer for line in lines()} | {"q1": "left", "q5": "left", "q7": "yes"}
    overall, kinds = score_answers(lines(), answers)
    side, anything = kinds["side"], kinds["anything"]
    assert (side.accuracy, side.chance, side.pairs) == (pytest.approx(4 / 6), pytest.approx(1 / 3), 2)
    assert side.pair_accuracy == 0.5  # s1: one of the two; s2: both, silence is no matter
    assert (anything.accuracy, anything.chance, anything.pair_accuracy, anything.pairs) == (0.5, 0.5, 0.0, 1)
    # Groups count alike: a has 4/6, b has 1/2.
    assert overall.accuracy == pytest.approx((4 / 6 + 1 / 2) / 2)
    assert overall.pair_accuracy == pytest.approx((0.5 + 0) / 2)
    assert (overall.lines, overall.groups, overall.accuracy_interval) == (8, 2, None)


def test_the_same_answer_to_all_lines_is_at_chance_and_never_right_in_a_pair() -> None:
    for choice in range(2):
        overall, _ = score_answers(lines(), {line.id: line.options[choice] for line in lines()})
        assert overall.accuracy == pytest.approx(overall.chance)
        assert overall.pair_accuracy == 0


def test_an_answer_is_the_option_word_for_word() -> None:
    line = lines()[2]
    assert all(is_right(line, text) for text in ("nothing sounds", " Nothing sounds.\n", '"nothing sounds"'))
    assert not any(is_right(line, text) for text in ("nothing", "I think nothing sounds", "", "left"))
    overall, _ = score_answers(lines(), {line.id: "I do not know" for line in lines()})
    assert (overall.accuracy, overall.outside) == (0, 8)


def test_missing_and_surplus_answers_are_named() -> None:
    complete = {line.id: line.answer for line in lines()}
    with pytest.raises(Avs3dError, match=r"2 questions without an answer: q3, q4; expected one for each line"):
        score_answers(lines(), {name: text for name, text in complete.items() if name not in ("q3", "q4")})
    with pytest.raises(Avs3dError, match="1 answers to no question: q99"):
        score_answers(lines(), complete | {"q99": "left"})


@pytest.fixture(scope="module")
def questions(shared_part_3: SharedDataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("qa") / "qa"
    write_qa(shared_part_3(frames=9), folder, QaOptions(split="all", per_group=2))
    return folder


def write_truth(questions: Path, path: Path, **changes: str) -> Path:
    found = {line.id: line.answer for line in read_questions(questions)} | changes
    path.write_text("".join(json.dumps({"id": name, "answer": text}) + "\n" for name, text in found.items()))
    return path


def test_a_file_of_answers_becomes_a_row(questions: Path, tmp_path: Path) -> None:
    answers, out = write_truth(questions, tmp_path / "perfect.jsonl"), tmp_path / "row.json"
    arguments = [str(answers), "--questions", str(questions), "--json", str(out)]
    result = CliRunner().invoke(qa_score, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert result.output.startswith("perfect on questions about tiny-scenes 1\n")
    row = json.loads(out.read_text())
    assert (row["method"], row["format"], row["overall"]["accuracy"]) == ("perfect", "avs3d qa scores 1", 1.0)
    assert row["questions"]["sha256"] == json.loads((questions / "qa.json").read_text())["questions_sha256"]
    again = CliRunner().invoke(qa_score, arguments, catch_exceptions=False)
    assert (again.exit_code, json.loads(out.read_text())) == (0, row)
    out.write_text("mine")
    assert "this command has not written it" in str(CliRunner().invoke(qa_score, arguments).exception)


def test_bad_files_of_answers_are_named(questions: Path, tmp_path: Path) -> None:
    good = write_truth(questions, tmp_path / "answers.jsonl")

    def fails(text: str, message: str, folder: Path = questions) -> None:
        (tmp_path / "bad.jsonl").write_text(text)
        with pytest.raises(Avs3dError, match=message):
            score_file(tmp_path / "bad.jsonl", folder)

    first = good.read_text().splitlines()[0]
    fails("", r"bad\.jsonl: \d+ questions without an answer: q00001, q00002, q00003 …")
    fails("no JSON", r"bad\.jsonl:1: Invalid JSON")
    fails(f"{first}\n{first}", r"bad\.jsonl:2: q00001 is answered twice")
    fails('{"id": "q00001", "answer": 7}', r"bad\.jsonl:1: answer")
    fails(first, "no questions.jsonl; expected a folder", folder=tmp_path)
    with pytest.raises(Avs3dError, match=r"gone\.jsonl: missing"):
        score_file(tmp_path / "gone.jsonl", questions)
    edited = tmp_path / "edited"
    edited.mkdir()
    for name in ("qa.json", "questions.jsonl"):
        (edited / name).write_bytes((questions / name).read_bytes())
    (edited / "questions.jsonl").write_bytes((questions / "questions.jsonl").read_bytes() + b"\n")
    with pytest.raises(Avs3dError, match=r"questions\.jsonl: not what qa\.json names"):
        score_file(good, edited)


# inspect_ai


@pytest.fixture(scope="module")
def inspect_ai() -> Any:
    return pytest.importorskip("inspect_ai", reason="inspect_ai is in the [qa] extra, which the tested set leaves out")


def answer_first(messages: list[Any], *_: object) -> Any:
    """A mock model that takes the first option of its prompt."""
    from inspect_ai.model import ModelOutput, ModelUsage

    output = ModelOutput.from_content("mockllm/model", messages[-1].text.rpartition("else:\n")[2].splitlines()[0])
    output.usage = ModelUsage()  # else inspect counts tokens, with a file from the network
    return output


@pytest.mark.slow
def test_a_mock_model_is_at_chance_end_to_end(inspect_ai: Any, questions: Path, tmp_path: Path) -> None:
    from inspect_ai.model import get_model

    from evaluators.questions.inspect_task import sound_questions

    model = get_model("mockllm/model", custom_outputs=answer_first)
    (log,) = inspect_ai.eval(
        sound_questions(str(questions)), model=model, display="none", log_dir=str(tmp_path), log_images=False
    )
    assert log.status == "success"
    metrics = {name.rpartition("/")[2]: metric.value for name, metric in log.results.scores[0].metrics.items()}
    assert metrics["pair_accuracy"] == 0
    assert metrics["all"] == pytest.approx(metrics["all_chance"])
    name, answers = read_answers(Path(log.location.removeprefix("file://")))
    assert name == "mockllm/model"
    assert answers.keys() == {line.id for line in read_questions(questions)}
    scores = score_file(log.location.removeprefix("file://"), questions)
    assert scores.overall.accuracy == pytest.approx(metrics["all"])


@pytest.mark.slow
def test_a_model_gets_nothing_that_tells_the_answer(inspect_ai: Any, questions: Path) -> None:
    from evaluators.questions.inspect_task import messages_of

    for line in read_questions(questions):
        (message,) = messages_of(line, questions)
        *_, text = message.content
        shown = text.text
        assert shown.count(line.answer) >= 1
        assert all(option in shown for option in line.options)
        assert not [word for word in (line.id, line.set, line.observation, line.group) if word in shown]
        kinds = [each.type for each in message.content]
        assert kinds == ["image", *["audio"] * len(line.audio), "text"]
        (deaf,) = messages_of(line, questions, sound="none", pictures=False)
        assert [each.type for each in deaf.content] == ["text"]


@pytest.mark.slow
def test_the_solver_that_listens_runs_in_place_of_a_model(inspect_ai: Any, questions: Path, tmp_path: Path) -> None:
    from baselines.questions import answer_one
    from baselines.questions_inspect import listening
    from evaluators.questions.inspect_task import sound_questions

    (log,) = inspect_ai.eval(
        sound_questions(str(questions), kinds=["side", "which"]), solver=listening(), model="none", display="none",
        log_dir=str(tmp_path), log_images=False,
    )  # fmt: skip
    assert log.status == "success"
    _, answers = read_answers(Path(log.location.removeprefix("file://")))
    asked = {line.id: line for line in read_questions(questions) if line.kind in ("side", "which")}
    assert answers == {name: answer_one("spatial", line, questions) for name, line in asked.items()}
    with pytest.raises(UsageError, match="no questions of kind colour"):
        sound_questions(str(questions), kinds="colour")
    with pytest.raises(UsageError, match="no ambisonics; export a dataset that was generated --with ambisonics"):
        sound_questions(str(questions), sound="ambisonics")
