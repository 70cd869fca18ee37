"""`evaluate()` for users of Python: predictions in memory, words of the command line, tables of scores."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench import Dataset, SubmissionWriter
from avs3d_bench.commands.click_options import WORKERS
from avs3d_bench.dataset import Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.method import Method
from avs3d_bench.submission import Prediction
from evaluators import evaluate
from evaluators.reading.records import Evaluation
from evaluators.score import MOST_WORKERS
from tests.support import tiny
from tests.support.shared import SharedDataset


def predict(frames: Sequence[Frame]) -> list[np.ndarray]:
    return [np.roll(frame.mask(), 1, axis=1) for frame in frames]


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Dataset:
    return Dataset(shared_dataset(frames=17))


@pytest.fixture(scope="module")
def masks(data: Dataset) -> dict[str, list[np.ndarray]]:
    return {observation.key: predict(observation.test) for observation in data}


@pytest.fixture(scope="module")
def found(data: Dataset, masks: dict[str, list[np.ndarray]]) -> Evaluation:
    return evaluate(masks, data)


def test_masks_in_memory_score_as_those_of_a_folder(data: Dataset, found: Evaluation, tmp_path: Path):
    with SubmissionWriter(tmp_path / "s", data, method="in memory") as writer:
        for observation in writer.observations:
            for frame, mask in zip(observation.test, predict(observation.test), strict=True):
                writer.write_mask(frame, mask)
    assert evaluate(tmp_path / "s", data).scores == found.scores


def test_predictions_come_in_several_forms(data: Dataset, masks: dict[str, list[np.ndarray]], found: Evaluation):
    stacks = {key: np.stack(some) * np.uint8(255) for key, some in masks.items()}
    named = {o.key: {f.name: m for f, m in zip(o.test, masks[o.key], strict=True)} for o in data}
    records = {key: [Prediction(mask) for mask in some] for key, some in masks.items()}
    for given in (stacks, named, records):
        assert evaluate(given, data.root).scores == found.scores
    method = evaluate(Method("rolled", predict), data).scores
    assert method.submission.method == "rolled"
    assert method.overall == found.scores.overall


def test_a_part_is_scored_with_only(data: Dataset, masks: dict[str, list[np.ndarray]], found: Evaluation):
    one = evaluate({tiny.MULTI: masks[tiny.MULTI]}, data, only="part_2/*").scores
    assert [row.key for row in one.observations] == [tiny.MULTI]
    assert one.observations[0] == found.scores.observations[1]


def change(masks: dict[str, Any], key: str, value: Any) -> dict[str, Any]:
    return {**masks, key: value}


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (lambda m: {tiny.SINGLE: m[tiny.SINGLE]}, rf"no predictions of 1 of 2 observations: {tiny.MULTI}; only="),
        (
            lambda m: change(m, "part_1/tiny/kitchen/9", []),
            r"'part_1/tiny/kitchen/9', no observation .*did you",
        ),
        (lambda m: change(m, tiny.SINGLE, m[tiny.SINGLE][:2]), r"kitchen/1: 2 masks, expected one for each of 3 test"),
        (lambda m: change(m, tiny.SINGLE, m[tiny.SINGLE] * 2), r"kitchen/1: more than 3 masks"),
        (lambda m: change(m, tiny.SINGLE, {"frame_000": m[tiny.SINGLE][0]}), "no mask of frame_008"),
        (lambda m: change(m, tiny.SINGLE, {"frame_001": 0}), r"a mask of 'frame_001', no test frame; did you mean"),
        (lambda m: change(m, tiny.SINGLE, 3), "a int, expected masks"),
        (lambda m: change(m, tiny.SINGLE, [a[1:] for a in m[tiny.SINGLE]]), r"frame_000: the mask has shape"),
        (lambda m: change(m, tiny.SINGLE, [a * 0.5 for a in m[tiny.SINGLE]]), "float64, expected bool.*threshold it"),
    ],
)
def test_bad_predictions_are_one_line(data: Dataset, masks: dict[str, list[np.ndarray]], spoil: Any, line: str):
    with pytest.raises(Avs3dError, match=line) as caught:
        evaluate(spoil(masks), data)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (
            {"protocols": "stict"},
            r"protocols: 'stict', expected official, strict, listen, all; did you mean 'strict'",
        ),
        ({"protocols": ["strict", 3]}, "protocols: 3, expected official"),
        ({"protocols": []}, r"protocols: \[\], expected one or more of"),
        ({"workers": 0}, "workers: 0, expected 1 to 256, or None"),
        ({"workers": True}, "workers: True, expected 1 to 256"),
        ({"aisrm": "True"}, "aisrm: 'True', expected True, False or None"),
        ({"aisrm": True}, "aisrm: chooses a folder of the released pipeline"),
        ({"only": [3]}, "only: 3, expected shell patterns"),
        ({"only": "part_9/*"}, r"no observation matches part_9/\*"),
    ],
)
def test_options_are_checked_with_the_words_of_the_command_line(
    data: Dataset, masks: dict[str, list[np.ndarray]], options: dict[str, Any], line: str
):
    with pytest.raises(UsageError, match=line):
        evaluate(masks, data, **options)


def test_words_of_the_command_line_are_taken(data: Dataset, masks: dict[str, list[np.ndarray]], found: Evaluation):
    assert WORKERS.max == MOST_WORKERS
    assert evaluate(masks, data, protocols="all").scores == found.scores
    assert set(evaluate(masks, data, protocols="strict").scores.avs3d_eval.protocols) == {"strict"}


def test_scores_are_a_frame_of_pandas(found: Evaluation):
    pytest.importorskip("pandas")
    frame = found.scores.to_frame()
    assert list(frame.index) == [tiny.SINGLE, tiny.MULTI]
    for row in found.scores.observations:
        assert row.strict is not None
        assert frame.loc[row.key, "strict.IoU"] == row.strict.IoU
    assert frame["strict.IoU_3D"].dtype == float
    assert frame["strict.IoU_3D"].isna().all()
    parts = found.scores.to_frame("parts")
    assert list(parts.index) == ["part_1", "part_2", "overall"]
    assert parts.loc["overall", "official.F"] == found.scores.overall.official.F  # type: ignore[union-attr]
    assert frame.groupby("part")["strict.IoU"].mean().to_dict() == pytest.approx(parts["strict.IoU"][:2].to_dict())
    with pytest.raises(UsageError, match=r"rows: 'part', expected .*did you mean 'parts'"):
        found.scores.to_frame("part")  # type: ignore[arg-type]


def test_a_frame_of_groups_has_their_intervals(found: Evaluation):
    pytest.importorskip("pandas")
    overall = found.scores.overall
    assert overall.strict is not None
    known = overall.model_copy(update={"strict": overall.strict.model_copy(update={"intervals": {"IoU": (0.1, 0.9)}})})
    frame = found.scores.model_copy(update={"overall": known}).to_frame("parts")
    assert tuple(frame.loc["overall", ["strict.IoU.low", "strict.IoU.high"]]) == (0.1, 0.9)
    assert frame.loc["part_1", ["strict.IoU.low"]].isna().all()


def test_printed_scores_have_a_table(found: Evaluation):
    head, *rows = str(found).splitlines()
    assert head == found.scores.headline()
    assert rows[0].split() == ["part_1", "(1)", "part_2", "(1)", "overall", "(2)"]
    strict = found.scores.overall.strict
    assert strict is not None
    (row,) = [row.split() for row in rows if row.startswith("strict.IoU ")]
    assert row[-1] == f"{strict.IoU:.3f}"
    assert not any("IoU_3D" in row for row in rows)  # no submission with points
    html = found._repr_html_()
    assert f"<td>{row[-1]}</td>" in html
    assert (
        "<script"
        not in found.scores.model_copy(
            update={"submission": found.scores.submission.model_copy(update={"method": "<script>"})}
        )._repr_html_()
    )


def test_a_dataset_says_its_name_and_version_and_a_submission_is_none(data: Dataset, tmp_path: Path):
    assert (data.name, data.version) == ("tiny", "1")
    assert Dataset(tiny.write_release(tmp_path / "release", frames=9)).version is None
    with SubmissionWriter(tmp_path / "s", data, method="m") as writer:
        for observation in writer.observations:
            for frame in observation.test:
                writer.write_mask(frame, frame.mask())
    for _ in range(2):
        with pytest.raises(UsageError, match=r"s: a submission, no dataset; expected .*root: evaluate\(submission, d"):
            Dataset(tmp_path / "s")
        (tmp_path / "s/submission.json").unlink(missing_ok=True)  # masks alone tell
