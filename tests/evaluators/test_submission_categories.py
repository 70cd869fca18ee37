"""Submissions to part_3: class ids beside the masks, written and checked; submissions for the wrong layout."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.commands.report import Report
from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.method import Method, write_submission
from avs3d_bench.submission import Prediction, SubmissionWriter
from evaluators.reading.checks import check_submission
from evaluators.score import evaluate
from tests.evaluators.test_score import run, submit, true_mask
from tests.support import tiny
from tests.support.shared import SharedDataset
from tests.support.tiny_scenes import BOTH, FIRST, GROUP, SILENT


@pytest.fixture(scope="module")
def data(shared_part_3: SharedDataset) -> Path:
    return shared_part_3(frames=9)


@pytest.fixture(scope="module")
def good(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The truth with its class ids, through the writer."""
    path = tmp_path_factory.mktemp("good") / "s"
    with SubmissionWriter(path, data, method="truth") as writer:
        for observation in writer.observations:
            for frame in observation.test:
                writer.write_mask(frame, frame.mask(), categories=frame.category_mask())
    return path


@pytest.fixture
def submission(good: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(good, tmp_path / "s"))


def checked(submission: Path, data: Path) -> Report:
    return check_submission(submission, data, workers=1)


def errors(submission: Path, data: Path) -> dict[str, str]:
    """Path → message of every error."""
    return {p.path: p.message for p in checked(submission, data).problems if p.severity == "error"}


def ids(frame: str = "frame_000", key: str = FIRST) -> str:
    return f"{key}/{layout.SUBMISSION_CATEGORIES}/{frame}.png"


# --- Writing ----------------------------------------------------------------------------------------------------------


def test_class_ids_are_written_and_fit_to_be_scored(good: Path, data: Path):
    assert checked(good, data).problems == ()
    for observation in Dataset(data):
        for frame in observation.test:
            written = media.read_png_categories(good / ids(frame.name, observation.key))
            np.testing.assert_array_equal(written, frame.category_mask())


def test_a_method_may_predict_class_ids(data: Path, tmp_path: Path):
    def predict(frames: tuple[Frame, ...]) -> list[Prediction]:
        return [Prediction(frame.mask(), frame.category_mask()) for frame in frames]

    write_submission(Dataset(data), tmp_path / "s", Method("truth", predict))
    listen = evaluate(tmp_path / "s", data).scores.overall.listen
    assert listen is not None
    assert listen.class_mIoU == 1


def test_a_submission_with_class_ids_can_be_overwritten(submission: Path, data: Path):
    with SubmissionWriter(submission, data, method="black", overwrite=True) as writer:
        for observation in writer.observations:
            for frame in observation.test:
                writer.write_mask(frame, np.zeros((tiny.SIZE, tiny.SIZE), bool))
    assert not list(submission.rglob(layout.SUBMISSION_CATEGORIES))


@pytest.mark.parametrize(
    ("categories", "message"),
    [
        (np.zeros((3, 4), int), r"the class ids have shape \(3, 4\), expected \(64, 64\)"),
        (np.zeros((64, 64)), "the class ids are float64, expected integers"),
        (np.full((64, 64), 8), "the class id 8 is unknown; expected 0, or one of 1 washing_machine, .* 7 telephone"),
        (np.full((64, 64), -1), "the class id -1 is unknown"),
    ],
)
def test_class_ids_that_are_none(data: Path, tmp_path: Path, categories: np.ndarray, message: str):
    frame = Dataset(data)[FIRST].test[0]
    writer = SubmissionWriter(tmp_path / "s", data, method="m")
    with pytest.raises(Avs3dError, match=f"{FIRST}/frame_000: {message}"), writer:
        writer.write_mask(frame, frame.mask(), categories=categories)
    assert not (tmp_path / "s").exists()


def test_class_ids_for_some_frames_only_are_not_written(data: Path, tmp_path: Path):
    def predict(frames: tuple[Frame, ...]) -> list[Prediction]:
        return [Prediction(f.mask(), f.category_mask() if f.name == "frame_000" else None) for f in frames]

    with pytest.raises(Avs3dError, match=f"no class ids for {FIRST}/frame_008, .*for every test frame"):
        write_submission(Dataset(data), tmp_path / "s", Method("m", predict))


def test_a_second_mask_without_class_ids_takes_those_of_the_first_away(data: Path, tmp_path: Path):
    with SubmissionWriter(tmp_path / "s", data, method="m") as writer:
        for frame in (frame for observation in writer.observations for frame in observation.test):
            writer.write_mask(frame, frame.mask(), categories=frame.category_mask())
            writer.write_mask(frame, ~frame.mask())
    assert not list((tmp_path / "s").rglob(f"{layout.SUBMISSION_CATEGORIES}/*"))


def test_class_ids_belong_to_part_3(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=9)
    frame = Dataset(root)[tiny.SINGLE].test[0]
    writer = SubmissionWriter(tmp_path / "s", root, method="m")
    with pytest.raises(UsageError, match="frame_000: class ids belong to part_3; leave out categories"), writer:
        writer.write_mask(frame, frame.mask(), categories=frame.mask().astype(int))


# --- Checking ---------------------------------------------------------------------------------------------------------


def test_class_ids_are_all_there_or_none(submission: Path, data: Path):
    (submission / ids()).unlink()
    message = errors(submission, data)[ids()]
    assert message.startswith("missing, but 9 other frames have class ids; expected class ids of every test frame of")
    (submission / ids("frame_008")).unlink()
    folder = f"{FIRST}/{layout.SUBMISSION_CATEGORIES}"
    for _ in ("empty", "missing"):
        (path,) = errors(submission, data)
        assert path == folder
        assert errors(submission, data)[path].startswith(
            "missing or empty, but 8 other frames have class ids; expected"
        )
        if (submission / folder).is_dir():
            (submission / folder).rmdir()
    (submission / folder).write_bytes(b"")
    assert {path: m.split(";")[0] for path, m in errors(submission, data).items()} == {folder: "surplus file"}
    (submission / folder).unlink()
    for folder in submission.rglob(layout.SUBMISSION_CATEGORIES):
        shutil.rmtree(folder)
    assert checked(submission, data).valid


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda path: media.write_png_ids(path, np.full((64, 64), 300)), "grey, 16 bit; expected class ids: grey"),
        (lambda path: media.write_png_rgb(path, np.zeros((64, 64, 3), np.uint8)), "RGB, 8 bit; expected class ids"),
        (lambda path: media.write_png_ids(path, np.zeros((64, 32), int)), "32×64 pixels, expected 64×64"),
        (lambda path: media.write_png_ids(path, np.full((64, 64), 8)), "holds the value 8; expected class ids, 0 for "),
        (lambda path: media.write_png_mask(path, np.ones((64, 64), bool)), "holds the value 255; expected class ids"),
        (lambda path: path.write_bytes(b"no picture"), ""),
    ],
)
def test_broken_class_ids_are_named(submission: Path, data: Path, write: object, message: str):
    assert callable(write)
    write(submission / ids())
    found = errors(submission, data)
    assert set(found) == {ids()}
    assert message in found[ids()]
    with pytest.raises(Avs3dError, match=ids()):
        evaluate(submission, data)


def test_known_class_ids_are_those_of_the_dataset(good: Path, data: Path, tmp_path: Path):
    """A category of the manifest's own has the id after the seven."""
    root = tiny.clone(data, tmp_path / "data")
    for key in GROUP:
        path = root / key / layout.OBSERVATION_JSON
        text = path.read_text().replace('"category":', '"categories": ["hair_dryer"],\n "category":', 1)
        tiny.replace(path, text.encode())
    submission = Path(shutil.copytree(good, tmp_path / "s"))
    media.write_png_categories(submission / ids(), np.full((64, 64), 8))
    assert errors(submission, data)
    assert not errors(submission, root)
    listen = next(o for o in evaluate(submission, root).scores.observations if o.key == FIRST).listen
    assert listen is not None
    assert listen.class_IoU["hair_dryer"] == 0


def test_class_ids_outside_of_the_mask_are_counted_and_no_error(
    submission: Path, data: Path, capsys: pytest.CaptureFixture[str]
):
    for name, pixels in (("frame_000", 3), ("frame_008", 2)):
        values = media.read_png_categories(submission / ids(name, BOTH))
        free = np.flatnonzero(values == 0)[:pixels]
        values.flat[free] = 7
        media.write_png_categories(submission / ids(name, BOTH), values)
    report = checked(submission, data)
    assert report.valid
    (warning,) = report.problems
    assert (warning.severity, warning.path) == ("warning", f"{BOTH}/categories")
    assert warning.message == "5 pixels in 2 frames (frame_000, …) have a category but are not marked in masks/"
    code, _, error = run(capsys, submission, "--dataset", data, "--workers", 1)
    assert code == 0
    assert f"note: {BOTH}/categories: 5 pixels" in error


def test_class_ids_in_part_1_are_one_line_per_observation(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    root = tiny.write_dataset(tmp_path / "data", frames=9)
    submission = submit(tmp_path / "s", root, true_mask)
    for name in ("frame_000", "frame_008"):
        media.write_png_ids(submission / ids(name, tiny.SINGLE), np.zeros((64, 64), int))
    assert errors(submission, root) == {
        f"{tiny.SINGLE}/categories": "class ids belong to part_3; expected masks/ only in part_1"
    }


def test_other_folders_of_part_3_are_surplus(submission: Path, data: Path):
    (submission / FIRST / "classes").mkdir()
    (submission / FIRST / "categories" / "frame_001.png").write_bytes(b"")
    (submission / FIRST / "categories" / "notes.txt").write_bytes(b"")
    found = errors(submission, data)
    assert found[f"{FIRST}/classes"] == "surplus folder; expected masks/ and categories/ only"
    assert found[ids("frame_001")] == "class ids of a train frame; expected test frames only"
    expected = "surplus file; expected masks/frame_000.png, categories/frame_000.png and points.ply only"
    assert found[f"{FIRST}/categories/notes.txt"] == expected


# --- The wrong layout -------------------------------------------------------------------------------------------------


def test_masks_of_part_1_for_part_3(data: Path, tmp_path: Path):
    submission = submit(tmp_path / "s", tiny.write_dataset(tmp_path / "other", frames=9), true_mask)
    assert {path: m for path, m in errors(submission, data).items() if path != "submission.json"} == {
        "part_1": "masks of part_1, but the dataset has only part_3",
        "part_2": "masks of part_2, but the dataset has only part_3",
        "part_3": "missing; expected 10 masks of 5 observations",
    }


def test_masks_of_part_3_for_parts_1_and_2(good: Path, tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "other", frames=9)
    assert {path: m for path, m in errors(good, root).items() if path != "submission.json"} == {
        "part_1": "missing; expected 2 masks of 1 observation",
        "part_2": "missing; expected 2 masks of 1 observation",
        "part_3": "masks of part_3, but the dataset has only part_1 and part_2",
    }


def test_a_dataset_with_all_parts_takes_all(submission: Path, data: Path, tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=9)
    for key in GROUP:
        tiny.clone(data / key, root / key)
    (root / layout.DATASET_JSON).unlink()
    found = errors(submission, root)
    assert set(found) == {f"{key}/masks/frame_00{n}.png" for key in (tiny.SINGLE, tiny.MULTI) for n in (0, 8)}
    assert SILENT not in found
