"""The oracles on part_3 observations: several instances, silence, class ids, errors, and the two deaf ones."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.cli import main
from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from baselines.deaf import choose_single, write_deaf
from baselines.oracle import oracle_mask, oracle_points, oracle_prediction, write_oracle
from baselines.oracle_errors import ErrorModel
from baselines.trivial import TRIVIAL, write_trivial
from evaluators.score import evaluate
from tests.support import tiny
from tests.support.shared import SharedDataset
from tests.support.tiny_scenes import AWAY, BOTH, FIRST, GROUP, SECOND, SILENT

FRAMES = 17
MICROWAVE, TELEPHONE = 4, 7


@pytest.fixture(scope="module")
def data(shared_part_3: SharedDataset) -> Path:
    return shared_part_3(frames=FRAMES)


def frame(data: Path, key: str, index: int = 0) -> Frame:
    return Dataset(data)[key].frames[index]


def test_the_perfect_oracle_is_perfect(data: Path, tmp_path: Path):
    write_oracle(Dataset(data), tmp_path / "s", instance="sounding", points=True)
    found = evaluate(tmp_path / "s", data).scores.overall.listen
    assert found is not None
    assert (found.pair_accuracy, found.IoU, found.FP_rate, found.FP_area, found.class_mIoU) == (1, 1, 0, 0, 1)
    for observation in Dataset(data):
        for one in observation.test:
            written = media.read_png_categories(tmp_path / "s" / observation.key / "categories" / f"{one.name}.png")
            np.testing.assert_array_equal(written, one.category_mask())
    for key, silent in ((SILENT, True), (AWAY, True), (FIRST, False)):
        assert (len(oracle_points(Dataset(data)[key])) == 0) == silent


def test_the_category_oracle_marks_all_of_the_audible_categories(data: Path):
    for key, kinds in ((FIRST, (1, 3)), (SILENT, ()), (AWAY, (2,)), (BOTH, (1, 2, 3))):
        one = frame(data, key)
        expected = np.isin(one.instance_ids(), kinds)
        np.testing.assert_array_equal(oracle_mask(one, instance="category"), expected)
        found = oracle_prediction(one, instance="category", errors=ErrorModel())
        ids = one.instance_ids()
        classes = np.where(np.isin(ids, (1, 3)), MICROWAVE, np.where(ids == 2, TELEPHONE, 0)) * expected
        np.testing.assert_array_equal(found.categories, classes)


def test_the_category_oracle_cannot_tell_twins_apart(data: Path, tmp_path: Path):
    write_oracle(Dataset(data), tmp_path / "s", instance="category")
    scores = evaluate(tmp_path / "s", data, only=[FIRST, SECOND]).scores
    assert scores.overall.listen is not None
    assert scores.overall.listen.pair_accuracy == 0


def test_a_swap_takes_a_silent_twin_and_names_its_class(data: Path):
    one = frame(data, FIRST)
    found = oracle_prediction(one, instance="sounding", errors=ErrorModel(swap=1))
    np.testing.assert_array_equal(found.mask, one.instance_ids() == 3)
    np.testing.assert_array_equal(found.categories, (one.instance_ids() == 3) * MICROWAVE)
    # In BOTH the two microwaves sound by turns: there is no silent twin. Under silence there is nothing to swap.
    for key in (BOTH, SILENT, AWAY):
        np.testing.assert_array_equal(
            oracle_mask(frame(data, key), instance="sounding", errors=ErrorModel(swap=1)), frame(data, key).mask()
        )


def test_a_confused_neighbour_is_marked_while_something_sounds_and_named_as_what_it_is_taken_for(data: Path):
    errors = ErrorModel(confuse=1)
    one = frame(data, FIRST)
    found = oracle_prediction(one, instance="sounding", errors=errors)
    ids = one.instance_ids()
    np.testing.assert_array_equal(found.mask, np.isin(ids, (1, 2)))
    np.testing.assert_array_equal(found.categories, np.isin(ids, (1, 2)) * MICROWAVE)
    for key in (SILENT, AWAY):
        assert not oracle_mask(frame(data, key), instance="sounding", errors=errors).any()


def test_a_dropped_frame_is_empty_in_both(data: Path):
    found = oracle_prediction(frame(data, BOTH), instance="sounding", errors=ErrorModel(drop=1))
    assert not np.any(found.mask)
    assert found.categories is not None
    assert not np.any(found.categories)


@pytest.mark.parametrize("pixels", [30, -30])  # 30 at 1008 pixels are 1.9 at 64
def test_outlines_of_classes_move_with_the_mask(data: Path, pixels: int):
    one = frame(data, BOTH, 3)
    true, kinds = one.mask(), one.category_mask()
    found = oracle_prediction(one, instance="sounding", errors=ErrorModel(dilate=pixels))
    mask, classes = np.asarray(found.mask), np.asarray(found.categories)
    assert mask.sum() > true.sum() if pixels > 0 else mask.sum() < true.sum()
    np.testing.assert_array_equal(mask, classes > 0)
    both = mask & true
    np.testing.assert_array_equal(classes[both], kinds[both])
    assert set(np.unique(classes)) <= set(np.unique(kinds))


@pytest.mark.parametrize("which", ["all", "single"])
def test_a_deaf_oracle_is_its_reference_row(data: Path, tmp_path: Path, which: str, capsys: pytest.CaptureFixture[str]):
    call = ["baseline", "oracle", "--dataset", str(data), "-o", str(tmp_path / "s"), "--deaf", which, "--workers", "1"]
    with pytest.raises(SystemExit) as end:
        main(call)
    assert not end.value.code
    assert f"deaf oracle ({which})" in capsys.readouterr().out
    evaluation = evaluate(tmp_path / "s", data)
    scores = evaluation.scores
    assert scores.overall.listen is not None
    assert scores.overall.listen == scores.references[f"deaf_{which}"]["overall"].listen
    assert scores.overall.listen.pair_accuracy == 0
    assert scores.overall.listen.class_mIoU is not None
    assert "masks of test frames" in (scores.submission.truth or "")
    masks = [(tmp_path / "s" / key / "masks" / "frame_000.png").read_bytes() for key in GROUP]
    assert len(set(masks)) == 1, "the same for all siblings"


def test_deaf_without_a_value_means_all(data: Path, tmp_path: Path):
    with pytest.raises(SystemExit) as end:
        main(["baseline", "oracle", "--deaf", "--dataset", str(data), "-o", str(tmp_path / "s"), "--workers", "1"])
    assert not end.value.code
    mask = media.read_png_mask(tmp_path / "s" / SILENT / "masks" / "frame_000.png")
    np.testing.assert_array_equal(mask, frame(data, SILENT).instance_ids() > 0)


def test_the_single_instance_is_chosen_among_the_siblings_asked_for(data: Path, tmp_path: Path):
    assert choose_single(data, (SECOND, SILENT)) == 3
    assert choose_single(data, (FIRST,)) == 1
    assert choose_single(data, (SILENT, AWAY)) is None
    write_deaf(Dataset(data), tmp_path / "s", "single", only=[SECOND, SILENT])
    mask = media.read_png_mask(tmp_path / "s" / SILENT / "masks" / "frame_000.png")
    np.testing.assert_array_equal(mask, frame(data, SILENT).instance_ids() == 3)


def test_the_single_instance_of_a_damaged_dataset(data: Path, tmp_path: Path):
    """Siblings with other test frames, or instance masks of another size: one line that names the file."""
    root = tiny.clone(data, tmp_path / "data")
    splits = {"train": [f"frame_{i:03d}" for i in range(1, FRAMES)], "test": ["frame_000"]}
    tiny.replace(root / SECOND / layout.SPLITS_JSON, json.dumps(splits).encode())
    with pytest.raises(Avs3dError, match=f"{SECOND}/camera_splits.json: other test frames than {FIRST}"):
        write_deaf(Dataset(root), tmp_path / "s", "single")
    ids = root / FIRST / layout.INSTANCE_MASKS / "frame_000.png"
    ids.unlink()
    media.write_png_ids(ids, np.zeros((8, 8), int))
    with pytest.raises(Avs3dError, match=rf"{FIRST}/instance_masks/frame_000.png: shape \(8, 8\), expected that of"):
        write_deaf(Dataset(root), tmp_path / "s", "single", only=[FIRST])


def test_processes_change_nothing(data: Path, tmp_path: Path):
    for workers in (1, 2):
        write_deaf(Dataset(data), tmp_path / str(workers), "single", workers=workers)
    one, two = (
        {p.relative_to(root): p.read_bytes() for p in root.rglob("*") if p.is_file()}
        for root in (tmp_path / "1", tmp_path / "2")
    )
    assert one == two


def test_deaf_oracles_need_siblings(tmp_path: Path, data: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=9)
    with pytest.raises(UsageError, match="part_1/tiny/kitchen/1: --deaf compares siblings, which only part_3 has"):
        write_deaf(Dataset(root), tmp_path / "s")
    bare = tiny.clone(data, tmp_path / "bare")
    (bare / FIRST / layout.OBSERVATION_JSON).unlink()
    with pytest.raises(UsageError, match=r"--deaf needs observation.json and instance_masks/"):
        write_deaf(Dataset(bare), tmp_path / "s")


@pytest.mark.parametrize("option", [["--swap", "0.5"], ["--points"], ["--instance", "sounding"]])
def test_deaf_with_an_error_is_refused(
    data: Path, tmp_path: Path, option: list[str], capsys: pytest.CaptureFixture[str]
):
    with pytest.raises(SystemExit) as end:
        main(["baseline", "oracle", "--deaf", "all", *option, "--dataset", str(data), "-o", str(tmp_path / "s")])
    assert end.value.code == 2
    error = capsys.readouterr().err
    assert f"--deaf cannot be had with {option[0]}" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("name", TRIVIAL)
def test_trivial_baselines_are_their_reference_rows(data: Path, tmp_path: Path, name: str):
    write_trivial(name, Dataset(data), tmp_path / "s")
    scores = evaluate(tmp_path / "s", data).scores
    assert scores.overall.listen == scores.references[name.replace("-", "_")]["overall"].listen
