"""Writing a submission: complete or not at all, no other files, the same bytes on every run."""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import SubmissionRecord
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.formats.mask_values import as_mask
from avs3d_bench.submission import SubmissionWriter, frame_size
from tests.support import tiny
from tests.support.homes import tree_digest
from tests.support.shared import SharedDataset

SHAPE = (tiny.SIZE, tiny.SIZE)


@pytest.fixture(scope="module")
def dataset(shared_dataset: SharedDataset) -> Dataset:
    return Dataset(shared_dataset())


def mask_of(frame: Frame) -> np.ndarray:
    mask = np.zeros(SHAPE, bool)
    mask[frame.index : frame.index + 3, 5:20] = True
    return mask


def frames_to_mark(dataset: Dataset) -> list[Frame]:
    return [frame for observation in dataset for frame in observation.test]


def write(dataset: Dataset, path: Path, **options: object) -> Path:
    with SubmissionWriter(path, dataset, method="mine", **options) as writer:  # type: ignore[arg-type]
        for observation in writer.observations:
            for frame in observation.test:
                writer.write_mask(frame, mask_of(frame))
    return path


@contextmanager
def refused(kind: type[Avs3dError], *words: str) -> Iterator[None]:
    """One line that holds the words."""
    with pytest.raises(kind) as caught:
        yield
    assert caught.type is kind
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


# What is written


def test_a_submission_is_a_record_and_one_mask_per_test_frame(dataset: Dataset, tmp_path: Path):
    path = write(dataset, tmp_path / "deep" / "mine", url="https://example.org", authors=("A", "B"), notes="n = 3")
    expected = {"submission.json"} | {f"{f.observation.key}/masks/{f.name}.png" for f in frames_to_mark(dataset)}
    assert set(tree_digest(path)) == expected
    assert len(expected) == 1 + 2 * 2
    for frame in frames_to_mark(dataset):
        file = path / frame.observation.key / "masks" / f"{frame.name}.png"
        assert media.png_header(file).mode == "grey, 8 bit"
        np.testing.assert_array_equal(media.read_png_mask(file), mask_of(frame))
    assert media.read_record(path / "submission.json", SubmissionRecord) == SubmissionRecord(
        method="mine", dataset="tiny", dataset_version="1", url="https://example.org", authors=("A", "B"), notes="n = 3"
    )
    assert os.listdir(path.parent) == ["mine"]


def test_the_official_release_has_no_version(tmp_path: Path):
    release = Dataset(tiny.write_release(tmp_path / "release"))
    record = media.read_record(write(release, tmp_path / "mine") / "submission.json", SubmissionRecord)
    assert (record.dataset, record.dataset_version) == ("release", "unversioned")


def test_the_bytes_do_not_depend_on_run_order_or_threads(dataset: Dataset, tmp_path: Path):
    first = write(dataset, tmp_path / "first")
    with SubmissionWriter(tmp_path / "second", dataset, method="mine") as writer:
        # A worker has nothing but what it was sent.
        folder = pickle.loads(pickle.dumps(writer.folder))
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(lambda f: folder.write_mask(f, mask_of(f)), reversed(frames_to_mark(dataset) * 5)))
    assert tree_digest(tmp_path / "second") == tree_digest(first)


def test_points_and_runtime(dataset: Dataset, tmp_path: Path):
    cloud = np.array([[1.0, 2.0, 3.0], [-1.0, 0.5, 0.25]])
    with SubmissionWriter(tmp_path / "mine", dataset, method="mine") as writer:
        for frame in frames_to_mark(dataset):
            writer.write_mask(frame, mask_of(frame))
        one, other = writer.observations
        writer.write_points(one, cloud)
        writer.write_points(other, np.zeros((0, 3)))
        writer.set_runtime({"seconds": 1.5, "device": "CPU"})
    np.testing.assert_array_equal(media.read_ply(tmp_path / "mine" / one.key / "points.ply").vertices, cloud)
    assert len(media.read_ply(tmp_path / "mine" / other.key / "points.ply").vertices) == 0
    record = media.read_record(tmp_path / "mine" / "submission.json", SubmissionRecord)
    assert record.runtime == {"seconds": 1.5, "device": "CPU"}


def test_only_a_part(dataset: Dataset, tmp_path: Path):
    path = write(dataset, tmp_path / "mine", only=["part_2/*"])
    assert {name.split("/")[0] for name in tree_digest(path)} == {"submission.json", "part_2"}
    with refused(UsageError, "part_3/*"):
        SubmissionWriter(tmp_path / "none", dataset, method="mine", only=["part_3/*"])


# What a mask may be


@given(hnp.arrays(bool, hnp.array_shapes(min_dims=2, max_dims=2, max_side=9)), st.sampled_from([1, 255]),
       st.sampled_from(["u1", "u2", "i4", "i8"]))  # fmt: skip
def test_masks_of_whole_numbers_mean_what_booleans_mean(mask: np.ndarray, top: int, kind: str):
    numbers = mask.astype(kind) * np.array(top, kind)
    np.testing.assert_array_equal(as_mask(numbers, mask.shape, "x"), mask)
    np.testing.assert_array_equal(as_mask(numbers.tolist(), mask.shape, "x"), mask)


@given(st.integers(-300, 300), st.sampled_from([0, 1, 255]))
def test_any_other_value_is_refused(value: int, beside: int):
    numbers = np.full((3, 4), beside, np.int32)
    numbers[1, 2] = value
    if {value, beside} <= {0, 1} or {value, beside} <= {0, 255}:
        assert as_mask(numbers, (3, 4), "x")[1, 2] == (value != 0)
    else:
        with refused(Avs3dError, "x: ", str(value), "0 and 255"):
            as_mask(numbers, (3, 4), "x")


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (np.zeros((64, 63), bool), ("(64, 63)", "(64, 64)")),
        (np.zeros((64, 64, 3), np.uint8), ("(64, 64, 3)",)),
        (np.zeros((1, 64, 64), bool), ("(1, 64, 64)",)),
        (np.full(SHAPE, 0.7, np.float32), ("float32", "threshold")),
        (np.full(SHAPE, "white"), ("<U5",)),
        ([[True], [True, False]], ("no array",)),
    ],
)
def test_what_is_no_mask_of_this_frame_is_refused(dataset: Dataset, tmp_path: Path, mask: object, words: tuple):
    frame = frames_to_mark(dataset)[0]
    with refused(Avs3dError, f"{frame.observation.key}/{frame.name}", *words), \
            SubmissionWriter(tmp_path / "mine", dataset, method="mine") as writer:  # fmt: skip
        writer.write_mask(frame, mask)  # type: ignore[arg-type]
    assert os.listdir(tmp_path) == []


def test_the_size_is_that_of_each_picture(dataset: Dataset, tmp_path: Path):
    root = tiny.clone(dataset.root, tmp_path / "data")
    frame = Dataset(root)[tiny.SINGLE].test[0]
    frame.path("input").unlink()
    media.write_png_rgb(frame.path("input"), np.zeros((20, 30, 3), np.uint8))
    assert frame_size(frame) == (20, 30)
    with refused(Avs3dError, "(20, 30)"), SubmissionWriter(tmp_path / "mine", root, method="mine") as writer:
        writer.write_mask(frame, np.zeros((30, 20), bool))


def test_only_test_frames_of_the_observations_covered(dataset: Dataset, tmp_path: Path):
    with SubmissionWriter(tmp_path / "mine", dataset, method="mine", only=[tiny.SINGLE]) as writer:
        with refused(UsageError, "frame_001", "train"):
            writer.write_mask(dataset[tiny.SINGLE].train[0], np.zeros(SHAPE, bool))
        with refused(UsageError, tiny.MULTI):
            writer.write_mask(dataset[tiny.MULTI].test[0], np.zeros(SHAPE, bool))
        with refused(UsageError, tiny.MULTI):
            writer.write_points(dataset[tiny.MULTI], np.zeros((1, 3)))
        for frame in writer.missing():
            writer.write_mask(frame, mask_of(frame))


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.zeros((4, 2)), ("(4, 2)", "(N, 3)")),
        (np.zeros(3), ("(3,)",)),
        ([[0.0, np.nan, 0.0]], ("NaN",)),
        ([[0.0, 1e300, 0.0]], ("infinite",)),
        ([["a", "b", "c"]], ("no numbers",)),
        (np.broadcast_to(np.float32(0), (layout.MAX_POINTS + 1, 3)), ("2,000,001", "2,000,000")),
    ],
)
def test_what_is_no_cloud_is_refused(dataset: Dataset, tmp_path: Path, points: object, words: tuple):
    with refused(Avs3dError, tiny.SINGLE, *words), SubmissionWriter(tmp_path / "m", dataset, method="m") as writer:
        writer.write_points(writer.observations[0], points)  # type: ignore[arg-type]


def test_a_record_that_submission_json_cannot_hold_is_refused_before_the_work(dataset: Dataset, tmp_path: Path):
    with refused(UsageError, "submission.json", "method"):
        SubmissionWriter(tmp_path / "mine", dataset, method="")
    writer = SubmissionWriter(tmp_path / "mine", dataset, method="mine")
    with refused(UsageError, "submission.json", "runtime"):
        writer.set_runtime(float("nan"))
    with refused(UsageError, "not open", "with"):
        writer.write_mask(frames_to_mark(dataset)[0], np.zeros(SHAPE, bool))


# Whole or not at all


def test_missing_masks_are_named_and_nothing_is_written(dataset: Dataset, tmp_path: Path):
    first, *rest = frames_to_mark(dataset)
    names = [f"{f.observation.key}/{f.name}" for f in rest]
    with refused(Avs3dError, "3 of 4", *names), SubmissionWriter(tmp_path / "mine", dataset, method="mine") as writer:
        writer.write_mask(first, mask_of(first))
        assert [f"{f.observation.key}/{f.name}" for f in writer.missing()] == names
    assert os.listdir(tmp_path) == []


def test_points_for_every_observation_or_none(dataset: Dataset, tmp_path: Path):
    with refused(Avs3dError, "no points", tiny.MULTI, "empty cloud"), \
            SubmissionWriter(tmp_path / "mine", dataset, method="mine") as writer:  # fmt: skip
        for frame in frames_to_mark(dataset):
            writer.write_mask(frame, mask_of(frame))
        writer.write_points(dataset[tiny.SINGLE], np.zeros((1, 3)))
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("error", [KeyboardInterrupt(), FileNotFoundError("my model"), SystemExit(3)])
def test_an_interrupted_writer_leaves_nothing_and_what_stood_there_stands(
    dataset: Dataset, tmp_path: Path, error: BaseException
):
    before = tree_digest(write(dataset, tmp_path / "mine"))

    def fail() -> None:
        with SubmissionWriter(tmp_path / "mine", dataset, method="other", overwrite=True) as writer:
            writer.write_mask(frames_to_mark(dataset)[0], np.ones(SHAPE, bool))
            raise error

    with pytest.raises(type(error)) as caught:
        fail()
    assert caught.value is error  # the method's own error, not one about the submission's folder
    assert tree_digest(tmp_path / "mine") == before
    assert os.listdir(tmp_path) == ["mine"]


_HANG = """
import sys, time
from avs3d_bench.submission import SubmissionWriter
with SubmissionWriter(sys.argv[2], sys.argv[1], method="mine") as writer:
    writer.write_mask(writer.observations[0].test[0], [[0] * 64] * 64)
    print("open", flush=True)
    time.sleep(60)
"""


def test_a_killed_writer_is_cleared_away_and_a_live_one_is_named(dataset: Dataset, tmp_path: Path):
    target = tmp_path / "mine"
    with subprocess.Popen(
        [sys.executable, "-c", _HANG, str(dataset.root), str(target)], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "open\n"
            with refused(Avs3dError, str(target), f"process {process.pid} "):
                write(dataset, target)
        finally:
            process.kill()
    assert os.listdir(tmp_path) == [".mine.partial"]
    write(dataset, target)
    assert os.listdir(tmp_path) == ["mine"]


def test_an_exchange_that_was_cut_short_is_undone(dataset: Dataset, tmp_path: Path):
    old = tree_digest(write(dataset, tmp_path / "mine"))
    (tmp_path / ".mine.partial").mkdir()
    (tmp_path / "mine").rename(tmp_path / ".mine.partial" / "previous")
    with refused(Avs3dError, "missing"), SubmissionWriter(tmp_path / "mine", dataset, method="m", overwrite=True):
        pass
    assert tree_digest(tmp_path / "mine") == old
    assert os.listdir(tmp_path) == ["mine"]


def test_a_full_disk_is_one_line(dataset: Dataset, tmp_path: Path):
    resource = pytest.importorskip("resource", reason="limits on file sizes need a POSIX system")
    size = max(file.stat().st_size for file in write(dataset, tmp_path / "whole").rglob("*.png")) // 2
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with refused(Avs3dError, "cannot write", "too large"), \
            SubmissionWriter(tmp_path / "mine", dataset, method="mine") as writer:  # fmt: skip
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
        try:
            writer.write_mask(frames_to_mark(dataset)[0], mask_of(frames_to_mark(dataset)[0]))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert os.listdir(tmp_path) == ["whole"]


# Where it may go


def test_a_submission_is_replaced_only_if_asked(dataset: Dataset, tmp_path: Path):
    path = write(dataset, tmp_path / "mine", notes="old")
    with refused(UsageError, "mine", "--overwrite"):
        write(dataset, path)
    write(dataset, path, overwrite=True, only=[tiny.MULTI])
    assert set(os.listdir(path)) == {"submission.json", "part_2"}
    assert media.read_record(path / "submission.json", SubmissionRecord).notes is None
    assert os.listdir(tmp_path) == ["mine"]


def test_an_empty_folder_is_as_good_as_none(dataset: Dataset, tmp_path: Path):
    (tmp_path / "mine").mkdir()
    assert len(tree_digest(write(dataset, tmp_path / "mine"))) == 5


@pytest.mark.parametrize("foreign", ["thesis.tex", "part_1/tiny/kitchen/1/masks/frame_000.psd", "part_1/notes"])
def test_nothing_is_deleted_that_no_writer_wrote(dataset: Dataset, tmp_path: Path, foreign: str):
    path = write(dataset, tmp_path / "mine")
    (path / foreign).write_text("precious")
    with refused(UsageError, foreign, "move it away"):
        write(dataset, path, overwrite=True)
    (path / "submission.json").unlink()
    with refused(UsageError, "no submission"):
        write(dataset, path, overwrite=True)
    assert (path / foreign).read_text() == "precious"


def test_targets_that_cannot_be(dataset: Dataset, tmp_path: Path):
    (tmp_path / "file").write_text("x")
    (tmp_path / "way").symlink_to(dataset.root, target_is_directory=True)
    before = tree_digest(dataset.root)
    for path, word in (
        (dataset.root, "inside"),
        (dataset.root / "part_1" / "mine", "inside"),
        (tmp_path / "way" / "mine", "inside"),
        (dataset.root.parent, "around"),
        (tmp_path / "file", "file"),
    ):
        with refused(UsageError, str(path), word):
            write(dataset, path, overwrite=True)
    with refused(Avs3dError, str(tmp_path / "file" / "mine"), "cannot write"):
        write(dataset, tmp_path / "file" / "mine")
    assert tree_digest(dataset.root) == before


def test_a_linked_folder_stays_a_link(dataset: Dataset, tmp_path: Path):
    (tmp_path / "scratch").mkdir()
    (tmp_path / "mine").symlink_to(tmp_path / "scratch", target_is_directory=True)
    write(dataset, tmp_path / "mine")
    assert (tmp_path / "mine").is_symlink()
    assert (tmp_path / "scratch" / "submission.json").is_file()


def test_the_example_of_the_module_runs(dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    import avs3d_bench.submission as module

    code = "\n".join(re.findall(r"^    (.*)$", (module.__doc__ or "").split("\n\n")[1], re.MULTILINE))
    monkeypatch.chdir(tmp_path)
    names = {"SubmissionWriter": SubmissionWriter, "Dataset": lambda _: dataset}
    exec(code, names | {"predict": lambda rgb, audio, pose: rgb[..., 0] > 127})
    assert len(tree_digest(tmp_path / "my-submission")) == 5
