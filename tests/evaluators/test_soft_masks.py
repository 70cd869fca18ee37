"""`avs3d-eval --soft-masks`: average precision beside the figures of the protocols, which stay as they are."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from avs3d_bench.contract.scores import Scores
from avs3d_bench.dataset import Dataset
from avs3d_bench.formats import files
from evaluators.cli import main
from evaluators.metrics.soft import average_precision
from evaluators.protocols.soft_masks import soft_mask_path
from evaluators.verify import verify
from tests.evaluators.test_score import submit
from tests.support.shared import SharedDataset


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=17)


@pytest.fixture(scope="module")
def given(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a submission ``sub`` of empty masks and soft masks ``soft``: noise, brighter on the truth."""
    folder = tmp_path_factory.mktemp("given")
    submit(folder / "sub", data, lambda frame: np.zeros(frame.mask().shape, np.bool_))
    rng = np.random.default_rng(1)
    for observation in Dataset(data):
        for frame in observation.test:
            grey = rng.integers(0, 200, frame.mask().shape) + 55 * frame.mask()
            path = soft_mask_path(folder / "soft", frame)
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), grey.astype(np.uint8))
    return folder


def run(given: Path, data: Path, output: Path, *extra: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(
            [
                str(given / "sub"),
                "--dataset",
                str(data),
                "--workers",
                "1",
                "--json",
                str(output / "scores.json"),
                *extra,
            ]
        )
    code = end.value.code
    assert isinstance(code, int)
    return code


def test_the_figure_is_a_mean_over_frames_that_show_the_object_and_changes_no_other(
    given: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "plain").mkdir()
    assert run(given, data, tmp_path / "plain") == 0
    page = tmp_path / "report.html"
    capsys.readouterr()
    assert run(given, data, tmp_path, "--soft-masks", str(given / "soft"), "--html", str(page)) == 0
    assert "average precision of soft masks: part_1 (" in capsys.readouterr().out
    assert "Average precision of soft masks" in page.read_text("utf-8")
    scores, plain = (files.read_record(place / "scores.json", Scores) for place in (tmp_path, tmp_path / "plain"))
    assert scores.soft is not None
    assert plain.soft is None
    assert '"soft"' not in (tmp_path / "plain/scores.json").read_text()
    ignored = {"soft": None, "report": None}
    assert scores.model_copy(update=ignored) == plain.model_copy(update=ignored)
    for observation in Dataset(data):
        values = [
            average_precision(frame.mask(), cv2.imread(str(soft_mask_path(given / "soft", frame)), 0) / np.float32(255))
            for frame in observation.test
            if frame.mask().any()
        ]
        expected = float(np.mean(values)) if values else None
        assert scores.soft.observations[observation.key] == pytest.approx(expected, abs=1e-8)
    known = [value for key, value in scores.soft.observations.items() if key.startswith("part_1") and value is not None]
    assert pytest.approx(np.mean(known), abs=1e-8) == scores.soft.parts["part_1"].AP
    assert scores.soft.parts["part_1"].count == len(known)


def test_verifying_says_that_soft_masks_are_not_compared(given: Path, data: Path, tmp_path: Path) -> None:
    assert run(given, data, tmp_path, "--soft-masks", str(given / "soft")) == 0
    found = verify(tmp_path / "scores.json", given / "sub", data)
    assert found.same
    assert any("soft masks is not compared" in note for note in found.notes)


def test_what_is_wrong_with_a_folder_is_one_line(
    given: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path(shutil.copytree(given / "soft", tmp_path / "soft"))
    frame = Dataset(data)[Dataset(data).keys[0]].test[0]
    path = soft_mask_path(folder, frame)

    def message(named: Path) -> str:
        capsys.readouterr()
        assert run(given, data, tmp_path, "--soft-masks", str(named)) != 0
        assert not (tmp_path / "scores.json").exists()
        (line,) = capsys.readouterr().err.splitlines()
        return line

    assert "no such folder; expected soft masks, KEY/masks/frame_000.png" in message(tmp_path / "none")
    cv2.imwrite(str(path), np.zeros((5, 7), np.uint8))
    height, width = frame.mask().shape
    assert f"{path}: 7×5 pixels, expected {width}×{height}, those of its frame" in message(folder)
    cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 255, (height, width, 3)).astype(np.uint8))
    assert f"{path}: a coloured picture, expected a grey one" in message(folder)
    path.write_bytes(path.read_bytes()[:60])
    assert str(path) in message(folder)
    path.unlink()
    assert "soft masks are missing, the first: " in message(folder)
