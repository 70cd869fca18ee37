"""What random changes, homes and voices are worth: the data of the trainings, how they are scored and collected."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.formats.files import write_json
from baselines.listener.batches import split_homes
from baselines.listener.masks import Answer
from benchmarks import listener_ablation as ablation

pytest.importorskip("torch", reason="torch is not installed: the listener cannot run")

SIDE, CELLS = 252, 126


# ---- data


@pytest.mark.parametrize("count", [2, 9, 48, 200])
def test_a_run_on_half_of_the_homes_learns_from_the_same_ones_as_one_that_leaves_half_out(count: int) -> None:
    homes = [f"home_{number}" for number in range(count)]
    training, kept = split_homes(sorted(ablation.half_of(homes)))
    assert training == split_homes(homes, max(1, round(len(split_homes(homes)[0]) / 2)))[0]
    assert kept
    assert kept <= split_homes(homes)[1]


def test_a_training_manifest_has_some_homes_and_a_share_of_the_voices() -> None:
    first = {"part": "part_3", "scan": "b", "room": "kitchen", "index": 1}
    document = {
        "name": "train", "light": "standard", "scans": {"a": 1, "b": 2, "c": 3},
        "voices": {"clock": list("pqrstuvw"), "toilet": ["x", "y"], "dog": ["bark", "howl"]},
        "observations": [{"scan": "a"}, first, {"like": "part_3/b/kitchen/1", "index": 2}, {"like": "part_3/c/hall/1"}],
    }  # fmt: skip
    found = ablation.training_manifest(document, ["b", "z"], 0.25)
    assert found["scans"] == {"b": 2}
    assert found["observations"] == document["observations"][1:3]
    # At least one of each category; sounds of no class, which are not what is learnt, stay.
    assert found["voices"] == {"clock": ["p", "q"], "toilet": ["x"], "dog": ["bark", "howl"]}


def test_recordings_take_the_place_of_voices_where_there_are_some(tmp_path: Path) -> None:
    (tmp_path / "clock").mkdir()
    (tmp_path / "clock" / "tick.wav").touch()
    document = {
        "voices": {"clock": ["sweep_quartz"], "toilet": ["washout_shelf"]},
        "observations": [{"category": "clock", "silent": ["toilet"]}, {"category": "toilet"}],
    }
    found = ablation.recorded_manifest(document, tmp_path)
    assert [each["file"] for each in found["sounds"]["clock"]] == [str(tmp_path / "clock" / "tick.wav")]
    assert (list(found["sounds"]), list(found["voices"])) == (["clock"], ["toilet"])
    assert found["observations"] == document["observations"][:1]


# ---- scores


def store(audible: list[list[str]], columns: list[slice | None]) -> Any:
    """Frames of one observation in each of which some columns sound."""
    masks = np.zeros((len(columns), SIDE, SIDE), bool)
    for mask, where in zip(masks, columns, strict=True):
        if where is not None:
            mask[:, where] = True
    count = len(columns)
    table = SimpleNamespace(
        keys=[f"part_1/home/kitchen/1/frame_{number:03d}" for number in range(count)], view=list(range(count)),
        cameras=[[0.5, 0.5, 0.5, 0.5]] * count, audible=audible,
    )  # fmt: skip
    return SimpleNamespace(
        table=table, pictures=np.zeros((count, SIDE, SIDE, 3), np.uint8), masks=np.packbits(masks, axis=-1),
        sounds=np.zeros((count, 2, 8), np.float16),
    )  # fmt: skip


def scored(monkeypatch: pytest.MonkeyPatch, frames: Any, marked: list[slice | None], says: list[str]) -> dict[str, Any]:
    """The scores of a network that marks some columns and hears some category."""
    answers = []
    for where, name in zip(marked, says, strict=True):
        mask = np.full((CELLS, CELLS), -6.0, np.float32)
        if where is not None:
            mask[:, where.start // 2 : where.stop // 2] = 6.0
        heard = np.eye(len(CATEGORIES), dtype=np.float32)[CATEGORIES.index(name)]
        answers.append(Answer(mask, np.zeros((8, CELLS, CELLS), np.float32), heard))
    monkeypatch.setattr("baselines.listener.predict.ListenerMethod.answers", lambda *_: answers)
    return ablation.scores(None, SimpleNamespace(threshold=0.5), frames, "cpu")


def test_scores_are_those_of_strict_of_the_surest_pixel_and_of_the_loudest_category(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    frames = store([["clock"], ["clock"], ["clock", "toilet"], []], [slice(0, 64), slice(0, 64), slice(0, 64), None])
    right: list[slice | None] = [slice(0, 64), slice(0, 128), slice(188, 252), None]
    found = scored(monkeypatch, frames, right, ["clock", "toilet", "toilet", "clock"])
    # Right; twice as wide, its surest pixel within the object; elsewhere. Marked where nothing is: never.
    assert found["strict_IoU"] == pytest.approx((1 + 0.5 + 0) / 3, abs=0.01)
    assert found["direction"] == pytest.approx(2 / 3, abs=1e-4)
    assert (found["FP_rate"], found["category"]) == (0.0, 0.5)
    wrong = scored(monkeypatch, frames, [slice(188, 252)] * 4, ["toilet"] * 4)
    assert wrong == {"strict_IoU": 0.0, "FP_rate": 1.0, "direction": 0.0, "category": 0.0}


def test_the_surest_pixel_may_lie_a_little_beside_what_sounds(monkeypatch: pytest.MonkeyPatch) -> None:
    # A pixel of 252 over 90 degrees is half of a degree in the middle.
    frames = store([["clock"], ["clock"]], [slice(126, 160), slice(126, 160)])
    found = scored(monkeypatch, frames, [slice(118, 120), slice(90, 92)], ["clock", "clock"])
    assert found["direction"] == 0.5


# ---- figures


def test_changes_are_those_of_the_same_seeds(tmp_path: Path) -> None:
    def trained(title: str, seed: int, iou: float | None) -> None:
        row = {"strict_IoU": iou, "direction": 0.5, "category": 0.6, "FP_rate": 0.1}
        figures = dict.fromkeys(ablation.TESTS, row)
        data = {"homes": 44, "pictures": 1000, "sounds": 4000}
        write_json(tmp_path / ablation.result_name(title, seed), {"figures": figures, "data": data})

    trained("nothing", 0, 0.30)
    trained("nothing", 1, 0.40)
    trained("gain, noise", 1, 0.35)
    trained("gain, noise", 2, 0.90)
    trained("decay", 0, None)  # no frame shows what sounds
    found = ablation.collected(tmp_path)
    assert list(found) == ["nothing", "gain, noise", "decay"]
    assert (found["decay"]["validation"]["strict_IoU"], found["decay"]["validation"]["change"]) == (None, None)
    assert found["gain, noise"]["validation"]["strict_IoU"]["values"] == [0.35, 0.9]
    assert found["gain, noise"]["validation"]["change"]["values"] == [-0.05]
    rows = ablation.table_rows(dict(sorted(found.items())))
    assert [row[0] for row in rows] == ["nothing", "gain, noise", "decay"]
    assert rows[1][:5] == ["gain, noise", "44, 4,000", ".625 (.350–.900)", "−.050 (−.050 to −.050)", ".500 (.500–.500)"]


def test_every_change_is_left_out_by_itself_or_with_others_of_its_kind() -> None:
    from baselines.listener.augment import CHANGES

    alone = [arm.without for title, arm in ablation.ARMS.items() if arm.without and title != "all changes"]
    assert sorted(name for names in alone for name in names) == sorted(CHANGES)
    assert ablation.ARMS["all changes"].without == tuple(sorted(CHANGES))
