"""The trivial baselines: valid submissions with masks that depend only on the size of the pictures."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from avs3d_bench.cli import avs3d
from avs3d_bench.contract.schema import SubmissionRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.measures.centre_box import centre_box as reference_box
from avs3d_bench.submission import SubmissionWriter
from baselines.trivial import TRIVIAL, all_black, all_white, centre_box, write_trivial
from tests.support import tiny
from tests.support.homes import tree_digest
from tests.support.shared import SharedDataset

SIDES = st.integers(1, 40)


@pytest.fixture(scope="module")
def dataset(shared_dataset: SharedDataset) -> Dataset:
    return Dataset(shared_dataset())


def run(*arguments: object) -> str:
    result = CliRunner().invoke(avs3d, ["baseline", *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


# The masks


@given(SIDES, SIDES)
def test_black_and_white_are_each_other_inverted(height: int, width: int):
    assert all_black(height, width).shape == (height, width)
    assert not all_black(height, width).any()
    np.testing.assert_array_equal(all_white(height, width), ~all_black(height, width))


@given(SIDES, SIDES)
def test_the_box_is_centred_and_rounds_outwards(height: int, width: int):
    box = centre_box(height, width)
    np.testing.assert_array_equal(box, box[::-1, ::-1])
    rows, columns = box.any(axis=1).sum(), box.any(axis=0).sum()
    assert box.sum() == rows * columns
    assert 0 <= rows - height / 2 < 2
    assert 0 <= columns - width / 2 < 2


def test_the_box_is_a_quarter_of_the_benchmark_s_pictures():
    box = centre_box(1008, 1008)
    assert box.mean() == 0.25
    assert box[252:756, 252:756].all()


@given(SIDES, SIDES)
def test_the_box_is_the_evaluator_s(height: int, width: int):
    reference = np.zeros((height, width), bool)
    reference[reference_box(height, width)] = True
    np.testing.assert_array_equal(centre_box(height, width), reference)


# The submissions


@pytest.mark.parametrize("name", sorted(TRIVIAL))
def test_each_writes_a_whole_submission(dataset: Dataset, tmp_path: Path, name: str):
    path = tmp_path / name
    assert run(name, "--dataset", dataset.root, "-o", path) == f"{path}: 4 masks of 2 observations: {name}\n"
    for observation in dataset:
        for frame in observation.test:
            mask = media.read_png_mask(path / observation.key / "masks" / f"{frame.name}.png")
            np.testing.assert_array_equal(mask, TRIVIAL[name](tiny.SIZE, tiny.SIZE))
    record = media.read_record(path / "submission.json", SubmissionRecord)
    assert (record.method, record.dataset, record.dataset_version) == (name, "tiny", "1")
    assert "looks at nothing" in (record.notes or "")
    assert len(tree_digest(path)) == 5


@pytest.mark.parametrize("name", sorted(TRIVIAL))
def test_no_truth_is_read(dataset: Dataset, tmp_path: Path, name: str):
    """What is left of the dataset are the pictures and the split, and the bytes are the same."""
    blind = tmp_path / "tiny"
    for key in dataset.keys:
        shutil.copytree(dataset.root / key / "input", blind / key / "input")
        shutil.copy(dataset.root / key / "camera_splits.json", blind / key)
    shutil.copy(dataset.root / "dataset.json", blind)
    write_trivial(name, Dataset(blind), tmp_path / "blind")
    write_trivial(name, dataset, tmp_path / "seeing")
    assert tree_digest(tmp_path / "blind") == tree_digest(tmp_path / "seeing")


def test_every_picture_has_its_own_size(dataset: Dataset, tmp_path: Path):
    root = tiny.clone(dataset.root, tmp_path / "data")
    picture = Dataset(root)[tiny.SINGLE].test[0].path("input")
    picture.unlink()
    media.write_png_rgb(picture, np.zeros((7, 30, 3), np.uint8))
    write_trivial("centre-box", Dataset(root), tmp_path / "mine")
    mask = media.read_png_mask(tmp_path / "mine" / tiny.SINGLE / "masks" / picture.name)
    assert mask.shape == (7, 30)
    assert mask.any(axis=1).tolist() == [False, True, True, True, True, True, False]


def test_a_damaged_picture_is_named_and_nothing_is_written(dataset: Dataset, tmp_path: Path):
    root = tiny.clone(dataset.root, tmp_path / "data")
    picture = Dataset(root)[tiny.MULTI].test[0].path("input")
    tiny.replace(picture, b"\x89PNG\r\n\x1a\n")
    with pytest.raises(Avs3dError, match=f"{picture.name}: truncated after 8 bytes"):
        write_trivial("all-white", Dataset(root), tmp_path / "mine")
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def test_the_official_release_will_do(tmp_path: Path):
    release = tiny.write_release(tmp_path / "release", style="files")
    assert "4 masks" in run("all-white", "--dataset", release, "-o", tmp_path / "white")


def test_options_that_all_share(dataset: Dataset, tmp_path: Path):
    path = tmp_path / "mine"
    run("all-black", "--dataset", dataset.root, "-o", path)
    again = run("all-white", "--dataset", dataset.root, "-o", path, "--overwrite", "--only", "part_1/*")
    assert again == f"{path}: 2 masks of 1 observation: all-white\n"
    assert "only part_1/*" in (media.read_record(path / "submission.json", SubmissionRecord).notes or "")
    with pytest.raises(UsageError, match="--overwrite"):
        run("all-white", "--dataset", dataset.root, "-o", path)


def test_a_writer_of_ones_own_writes_the_same_masks(dataset: Dataset, tmp_path: Path):
    write_trivial("all-white", dataset, tmp_path / "trivial")
    with SubmissionWriter(tmp_path / "own", dataset, method="own") as writer:
        for frame in writer.missing():
            writer.write_mask(frame, np.full((tiny.SIZE, tiny.SIZE), 255, np.uint8))
    own, trivial = tree_digest(tmp_path / "own"), tree_digest(tmp_path / "trivial")
    assert {name for name in own if own[name] != trivial[name]} == {"submission.json"}


# The command


def test_the_group_lists_the_baselines_and_knows_the_nearest_name():
    help_text = run("--help")
    assert all(name in help_text for name in (*TRIVIAL, "oracle"))
    with pytest.raises(UsageError, match="did you mean 'centre-box'"):
        run("center-box")


def test_help_imports_neither_arrays_nor_a_baseline():
    code = (
        "import sys; from click.testing import CliRunner; from baselines.cli import baseline;"
        "CliRunner().invoke(baseline, ['oracle', '--help'], catch_exceptions=False);"
        "print(sorted({'numpy', 'cv2', 'scipy', 'pydantic', 'baselines.oracle'} & set(sys.modules)))"
    )
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert output.strip() == "[]"
