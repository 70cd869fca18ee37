"""Report, leaderboard and tables of part_3 observations (protocol listen)."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.formats import media
from baselines.deaf import write_deaf
from evaluators.reading.records import FrameScore, SiblingFrame
from evaluators.reading.submission import open_submission
from evaluators.reporting.leaderboard import read_entries, write_leaderboard
from evaluators.reporting.pictures import draw_triple
from evaluators.reporting.ranking import leaderboard_values
from evaluators.reporting.report_check import read_report
from evaluators.reporting.siblings import draw_siblings
from evaluators.reporting.sounds import silent_twins, sounds_in
from evaluators.reporting.tables import write_tables
from evaluators.score import evaluate
from tests.evaluators.test_score import run, submit, true_mask
from tests.support import tiny, tiny_scenes
from tests.support.shared import SharedDataset
from tests.support.tiny_scenes import AWAY, BOTH, FIRST, SECOND, SILENT


@pytest.fixture(scope="module")
def data(shared_part_3: SharedDataset) -> Path:
    return shared_part_3(frames=17)


def confused(frame: Frame) -> np.ndarray:
    """The truth, but under the sound of the first twin the second is marked, and something under silence."""
    ids = frame.instance_ids()
    if frame.observation.key in (FIRST, SILENT):
        return np.asarray(ids == 3)
    return frame.mask()


@pytest.fixture(scope="module")
def written(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of scores and reports: the truth, a confused method, a deaf oracle."""
    folder = tmp_path_factory.mktemp("written")
    submit(folder / "perfect", data, true_mask)
    submit(folder / "confused", data, confused)
    write_deaf(Dataset(data), folder / "deaf")
    for name in ("perfect", "confused"):
        record = media.read_json(folder / name / layout.SUBMISSION_JSON)
        (folder / name / layout.SUBMISSION_JSON).unlink()
        media.write_json(folder / name / layout.SUBMISSION_JSON, {**record, "method": name})
    from evaluators.cli import main

    for name in ("perfect", "confused", "deaf"):
        outputs = ["--json", str(folder / f"{name}.json"), "--html", str(folder / f"{name}.html")]
        with pytest.raises(SystemExit) as end:
            main([str(folder / name), "--dataset", str(data), "--workers", "1", *outputs])
        assert not end.value.code
    return folder


def text_of(page: str) -> str:
    """A page without its elements."""
    body = page.split("<main", 1)[1]
    return " ".join(re.sub(r"<[^>]+>", " ", body).split())


# --- The report -------------------------------------------------------------------------------------------------------


def test_what_sounds_in_words(data: Path):
    dataset = Dataset(data)
    assert sounds_in(dataset[FIRST].frames[0]) == "microwave"
    assert sounds_in(dataset[SILENT].frames[0]) == "silence"
    assert sounds_in(dataset[AWAY].frames[0]) == "telephone in the living room and background (noise)"
    assert sounds_in(dataset[BOTH].frames[0]) == "microwave, telephone and background (noise)"


def test_silent_twins_are_those_of_what_is_audible_in_the_frame(data: Path):
    dataset = Dataset(data)
    # In BOTH the two microwaves (1 and 3) take turns, in AWAY a telephone sounds in the next room.
    found = [
        silent_twins(dataset[key].frames[i]) for key, i in ((FIRST, 0), (SILENT, 0), (AWAY, 0), (BOTH, 0), (BOTH, 3))
    ]
    assert found == [(3,), (), (2,), (3,), (1,)]


def test_a_frame_of_a_part_3_says_what_sounds(data: Path, written: Path):
    with open_submission(written / "confused") as opened:
        both = draw_triple(FrameScore(BOTH, "frame_000", True, 1.0, 0.1), Dataset(data), opened)
        silent = draw_triple(FrameScore(SILENT, "frame_000", False, None, 0.1), Dataset(data), opened)
    assert both.sounds == "microwave, telephone and background (noise)"
    assert "what is audible (microwave, telephone and background (noise)) covers" in both.truth.alt
    assert silent.truth.alt == f"Truth in frame_000 of {SILENT}: nothing to mark (silence)"
    assert "sound: silence" in text_of((written / "confused.html").read_text())


def test_the_frame_with_the_most_wrong_pairs_is_shown(data: Path, written: Path):
    evaluation = evaluate(written / "confused", data)
    (shown,) = evaluation.groups
    (siblings,) = evaluation.scores.siblings or ()
    assert shown.group == FIRST
    assert shown.keys == siblings.observations
    assert shown.pairs > shown.right
    # No other frame has more wrong pairs: frame 16 looks away, so that all truths are empty there.
    wrong = sum(pair.frames - pair.right for pair in siblings.pairs)
    assert wrong / 2 <= shown.pairs - shown.right <= wrong


def test_siblings_are_drawn_side_by_side(data: Path, written: Path):
    shown = SiblingFrame(FIRST, (FIRST, SECOND, SILENT), "frame_008", 3, 0)
    with open_submission(written / "confused") as opened:
        found = draw_siblings(shown, Dataset(data), opened)
    assert [one.right for one in found.siblings] == [False, True, False]
    first, second, silent = found.siblings
    assert (first.sounds, first.note) == ("microwave", "IoU 0.00")
    assert second.note == "IoU 1.00"
    marked = int((Dataset(data)[SILENT].frames[8].instance_ids() == 3).sum())
    assert silent.note == f"nothing to mark, {marked} pixels marked"
    assert found.frame.data != first.picture.data != second.picture.data


def test_a_report_of_part_3(written: Path):
    page = (written / "confused.html").read_text()
    said = text_of(page)
    assert "The same picture under other sounds" in said
    assert "telephone in the living room and background (noise)" in said
    assert "listen pair accuracy" in said
    assert "deaf oracle: best one" in said
    assert "official mIoU" not in said, "that protocol does not score part_3"
    assert "no interval: fewer than 6 groups" in said
    assert read_report(written / "confused.html"), "a leaderboard may copy it"


def test_a_report_of_the_other_parts_says_nothing_of_siblings(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    root = tiny.write_dataset(tmp_path / "data", frames=9)
    page = tmp_path / "r.html"
    run(capsys, submit(tmp_path / "s", root, true_mask), "--dataset", root, "--html", page, "--workers", 1)
    said = text_of(page.read_text())
    assert "sibling" not in said
    assert "listen" not in said


def test_a_report_of_all_parts_leads_each_part_with_its_own_figure(data: Path, tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=17)
    for key in tiny_scenes.GROUP:
        tiny.clone(data / key, root / key)
    (root / layout.DATASET_JSON).unlink()
    from evaluators.reporting.report import report_values

    values = report_values(evaluate(submit(tmp_path / "s", root, true_mask), root).scores)
    heads = {card.title: f"{card.metric.protocol} {card.metric.name}" for card in values["cards"]}
    assert heads == {
        "Overall": "listen twins", "Part 1": "strict IoU", "Part 2": "strict IoU",
        "Part 3": "listen twins",
    }  # fmt: skip
    deaf = {card.title: card.deaf and card.deaf[0] for card in values["cards"]}
    assert deaf["Part 3"] == "deaf oracle: all"
    assert deaf["Part 2"] == "deaf: most seen" or deaf["Part 2"] == "deaf: every instance"


# --- The leaderboard --------------------------------------------------------------------------------------------------


def tables_of(values: dict[str, Any], part: str, protocol: str) -> Any:
    (section,) = values["sections"]
    (view,) = [view for view in section.views if view.part == part and view.ruler.protocol == protocol]
    return view.tables


def test_part_3_are_ranked_by_twins(written: Path):
    files = [written / f"{name}.json" for name in ("confused", "deaf", "perfect")]
    (table,) = tables_of(leaderboard_values(read_entries(files)), "part_3", "listen")
    assert table.ranking.name == "twins"
    assert [metric.name for metric in table.metrics[:2]] == ["twins", "pair_accuracy"]
    # One group separates nothing: the order is that of the means, and the rank is shared.
    assert [(row.rank, row.title) for row in table.rows if row.entry and row.rank] == [(1, "perfect"), (1, "confused")]
    assert table.standings.units == 1
    unranked = {row.title for row in table.rows if row.rank is None}
    assert unranked == {
        "deaf oracle (all)", "all black", "all white", "centre box", "deaf oracle: all", "deaf oracle: best one",
    }  # fmt: skip


def test_the_page_of_a_leaderboard(written: Path, tmp_path: Path):
    notes = write_leaderboard(tmp_path / "board", [written / "confused.json", written / "perfect.json"])
    assert not notes
    said = text_of((tmp_path / "board" / "index.html").read_text())
    assert "part_3 observations by the pair accuracy over twins, beside that over all pairs" in said
    assert "ranked by twins" in said
    assert (tmp_path / "board" / "reports" / "perfect.html").exists()


def test_parts_that_a_protocol_does_not_score_have_no_rows(data: Path, tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=9)
    for key in tiny_scenes.GROUP:
        tiny.clone(data / key, root / key)
    (root / layout.DATASET_JSON).unlink()
    media.write_json(tmp_path / "all.json", evaluate(submit(tmp_path / "s", root, true_mask), root).scores)
    values = leaderboard_values(read_entries([tmp_path / "all.json"]))
    assert [ruler.split("-")[0] for ruler, _ in values["rulers"]] == ["listen", "strict", "official"]
    assert tables_of(values, "part_3", "strict") == tables_of(values, "part_1", "listen") == ()
    (table,) = tables_of(values, "overall", "strict")
    assert {row.title for row in table.rows if row.entry is None} == {
        "all black", "all white", "centre box", "deaf: every instance", "deaf: most seen",
    }  # fmt: skip


def test_part_3_without_siblings_are_ranked_by_iou(data: Path, tmp_path: Path):
    """Without observation.json no observation has a sibling, so that nobody has a pair accuracy."""
    root = tiny.clone(data, tmp_path / "data")
    for key in tiny_scenes.GROUP:
        (root / key / layout.OBSERVATION_JSON).unlink()
    (root / layout.DATASET_JSON).unlink()
    files = []
    for name, predict in (("better", true_mask), ("alike", true_mask), ("worse", lambda frame: ~frame.mask())):
        folder = submit(tmp_path / name, root, predict)
        record = media.read_json(folder / layout.SUBMISSION_JSON)
        (folder / layout.SUBMISSION_JSON).unlink()
        media.write_json(folder / layout.SUBMISSION_JSON, {**record, "method": name})
        files.append(tmp_path / f"{name}.json")
        media.write_json(files[-1], evaluate(folder, root).scores)
    (table,) = tables_of(leaderboard_values(read_entries(files)), "part_3", "listen")
    assert table.ranking.name == "IoU"
    assert "pair_accuracy" not in {metric.name for metric in table.metrics}
    assert [(row.rank, row.title) for row in table.rows if row.rank] == [(1, "alike"), (1, "better"), (1, "worse")]
    write_tables(tmp_path / "t", files, plot=False)
    with (tmp_path / "t" / "table2.csv").open() as stream:
        methods = [row["method"] for row in csv.DictReader(stream) if row["kind"] == "method"]
    assert methods == ["alike", "better", "worse"]


# --- The tables -------------------------------------------------------------------------------------------------------


def test_tables_of_part_3(written: Path, tmp_path: Path):
    write_tables(tmp_path / "t", [written / "perfect.json", written / "confused.json"], plot=True)
    with (tmp_path / "t" / "table2.csv").open() as stream:
        rows = {row["method"]: row for row in csv.DictReader(stream)}
    assert float(rows["perfect"]["listen_pair_accuracy"]) == 1
    assert 0 < float(rows["confused"]["listen_pair_accuracy"]) < 1
    assert float(rows["deaf oracle: all"]["listen_pair_accuracy"]) == 0
    assert rows["perfect"]["part"] == "part_3"
    text = (tmp_path / "t" / "table2.md").read_text()
    assert "### Part 3, several sources (n = 5)" in text
    assert "listen pair accuracy" in text or "pair accuracy" in text
    assert "In the paper, and not among these files" not in text
    assert "No row of the paper" not in text
    assert (tmp_path / "t" / "table2.svg").exists()


def test_tables_of_the_other_parts_have_no_new_columns(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=9)
    media.write_json(tmp_path / "a.json", evaluate(submit(tmp_path / "s", root, true_mask), root).scores)
    write_tables(tmp_path / "t", [tmp_path / "a.json"], plot=False)
    header = (tmp_path / "t" / "table2.csv").read_text().splitlines()[0]
    assert "listen" not in header
