"""Scoring whole submissions: ours, the released pipeline's, on our data and on the official release."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.contract import layout
from avs3d_bench.contract.scores import BLIND_REFERENCES, DEAF_REFERENCES, PROTOCOL_PARTS, REFERENCES, Scores
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import UsageError
from avs3d_bench.formats import files, media
from evaluators.cli import main
from evaluators.protocols import strict as protocols
from evaluators.reading.checks import check
from evaluators.reporting.compare import compare
from evaluators.score import evaluate
from evaluators.verify import verify
from tests.support import tiny
from tests.support.shared import SharedDataset

FRAMES = 17  # three test frames: 0, 8 and 16
#: Those of part_1 and part_2; tests/evaluators/test_listen.py is about the third.
PROTOCOLS = [name for name, parts in PROTOCOL_PARTS.items() if "part_1" in parts]


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=FRAMES)


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.write_release(tmp_path_factory.mktemp("data") / "release", frames=FRAMES)


def submit(folder: Path, root: Path, predict: Any, *, masks: str = "masks", points: Any = None) -> Path:
    """A submission of what ``predict(frame)`` gives; submission.json only in our layout."""
    dataset = Dataset(root)
    if masks == layout.SUBMISSION_MASKS:
        version = dataset.record.version if dataset.record else "release"
        said = {"method": "test", "dataset": dataset.name, "dataset_version": version}
        media.write_json(folder / layout.SUBMISSION_JSON, said)
    for observation in dataset:
        for frame in observation.test:
            media.write_png_mask(folder / observation.key / masks / f"{frame.name}.png", predict(frame))
        if points is not None:
            media.write_ply_points(folder / observation.key / layout.SUBMISSION_POINTS, points(observation))
    return folder


def true_mask(frame: Frame) -> np.ndarray:
    return frame.mask()


def shifted(frame: Frame) -> np.ndarray:
    return np.roll(frame.mask(), 2, axis=1)


def twin(frame: Frame) -> np.ndarray:
    """The silent instance of the category, where there is one."""
    silent = [i.id for i in frame.observation.record.instances if not i.sounding]
    return np.isin(frame.instance_ids(), silent)


def run(capsys: pytest.CaptureFixture[str], *arguments: Any) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


def test_the_truth_is_perfect(data: Path, tmp_path: Path):
    scores = evaluate(submit(tmp_path / "s", data, true_mask), data).scores
    for group in (scores.overall, *scores.parts.values(), *scores.categories.values(), *scores.rooms.values()):
        assert group.official.mIoU == pytest.approx(1, abs=1e-6)
        assert group.official.F == group.strict.IoU == group.strict.boundary_F == 1
        assert group.strict.FP_rate in (0, None)
    assert scores.parts["part_2"].strict.wrong_instance_rate == 0
    assert scores.parts["part_1"].strict.unavailable["wrong_instance_rate"] == protocols.ONE_INSTANCE
    assert scores.overall.strict.unavailable["IoU_3D"] == protocols.NO_POINTS


def test_figures_are_those_of_the_masks_counted_by_hand(data: Path, tmp_path: Path):
    scores = evaluate(submit(tmp_path / "s", data, shifted), data).scores
    for observation in Dataset(data):
        pairs = [(frame.mask(), shifted(frame)) for frame in observation.test]
        ious = [(g & p).sum() / (g | p).sum() for g, p in pairs if g.any()]
        found = next(o for o in scores.observations if o.key == observation.key)
        assert found.strict.IoU == pytest.approx(np.mean(ious), rel=1e-12)
        assert found.strict.visible_frames == len(ious) < found.frames == len(pairs)
        assert found.official.mIoU == pytest.approx(np.mean([*ious, *[1.0] * (len(pairs) - len(ious))]), abs=1e-6)
        assert found.strict.FP_rate == found.strict.FP_area == 0


def test_marking_the_twin_is_found_out_in_part_2_only(data: Path, tmp_path: Path):
    scores = evaluate(submit(tmp_path / "s", data, twin), data).scores
    assert scores.parts["part_2"].strict.wrong_instance_rate == 1
    assert scores.parts["part_2"].strict.IoU == 0
    assert scores.parts["part_1"].strict.wrong_instance_rate is None


def same_category(observation: Observation) -> list[int]:
    """Ids of the instances of the sounding category, ascending."""
    record = observation.record
    return sorted(i.id for i in record.instances if i.category == record.category)


@pytest.mark.parametrize("name", REFERENCES)
def test_reference_rows_are_the_scores_of_such_submissions(data: Path, tmp_path: Path, name: str):
    def predict(frame: Frame) -> np.ndarray:
        if name.startswith("deaf"):
            numbers = same_category(frame.observation)
            seen = [sum(int((f.instance_ids() == n).sum()) for f in frame.observation.test) for n in numbers]
            chosen = numbers if name == "deaf_category" else [numbers[int(np.argmax(seen))]]
            return np.isin(frame.instance_ids(), chosen)
        out = np.full((tiny.SIZE, tiny.SIZE), name == "all_white")
        if name == "centre_box":
            out[16:48, 16:48] = True
        return out

    scores = evaluate(submit(tmp_path / "s", data, predict), data).scores
    for part, group in {**scores.parts, "overall": scores.overall}.items():
        beside = scores.references[name][part]
        assert beside.official.model_copy(update={"intervals": {}}) == group.official.model_copy(
            update={"intervals": {}}
        )
        assert beside.strict.model_copy(update={"intervals": {}}) == group.strict.model_copy(update={"intervals": {}})


def test_deaf_rows_need_the_instance_masks_of_test_frames_in_part_2_and_no_other(data: Path, tmp_path: Path):
    submission = submit(tmp_path / "s", data, shifted)
    scores = evaluate(submission, data).scores
    assert scores.references["deaf_category"]["part_1"].strict.IoU == 1
    assert scores.references["deaf_category"]["part_2"].strict.IoU < 1
    assert scores.references["deaf_category"]["part_2"].strict.wrong_instance_rate == 1
    assert scores.references_unavailable == {}
    root = tiny.clone(data, tmp_path / "fewer")
    for observation in Dataset(root):
        for frame in observation.frames:
            if observation.key == tiny.SINGLE or frame.split == "train":
                frame.path(layout.INSTANCE_MASKS).unlink()
    assert evaluate(submission, root).scores.references == scores.references


@pytest.mark.slow
def test_without_instance_masks_the_deaf_rows_are_left_out_and_that_is_said(
    release: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    submission = submit(tmp_path / "s", release, true_mask)
    scores = evaluate(submission, release).scores
    assert set(scores.references) == set(BLIND_REFERENCES)
    assert scores.references_unavailable == dict.fromkeys(DEAF_REFERENCES, protocols.NO_INSTANCE_MASKS)
    code, out, _ = run(capsys, submission, "--dataset", release)
    assert code == 0
    assert "deaf most seen: no such row (the dataset has no instance masks)" in out
    alone = evaluate(submission, release, protocols=("official",)).scores
    assert alone.references_unavailable == {}


@pytest.mark.slow
def test_the_table_shows_the_deaf_rows_of_every_part(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    code, out, _ = run(capsys, submit(tmp_path / "s", data, true_mask), "--dataset", data)
    assert code == 0
    lines = [line.strip() for line in out.splitlines()]
    assert sum(line.startswith("deaf category") for line in lines) == 3  # part_1, part_2, overall
    assert sum(line.startswith("deaf most seen") for line in lines) == 3
    assert "deaf: true masks, chosen without the sound" in lines
    assert "category: every instance of the sounding category" in lines
    assert any(line.startswith("most seen: ") for line in lines)
    assert not any(line.startswith("all: ") for line in lines), "the dataset has no part_3 observations"
    assert "no such row" not in out


def test_the_official_protocol_has_no_deaf_rows(data: Path, tmp_path: Path):
    """It needs no instance mask, so it reads none."""
    submission = submit(tmp_path / "s", data, shifted)
    root = tiny.clone(data, tmp_path / "none")
    for key in (tiny.SINGLE, tiny.MULTI):
        shutil.rmtree(root / key / layout.INSTANCE_MASKS)
    scores = evaluate(submission, root, protocols=("official",)).scores
    assert set(scores.references) == set(BLIND_REFERENCES)


def test_a_cloud_on_the_mesh_scores_in_3d(data: Path, tmp_path: Path):
    def cloud(observation: Any) -> np.ndarray:
        mesh = observation.mesh()
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        a, b = np.mgrid[0:1:40j, 0:1:40j].reshape(2, -1)
        a, b = a[a + b <= 1], b[a + b <= 1]
        return np.concatenate([(1 - a - b)[:, None] * t[0] + a[:, None] * t[1] + b[:, None] * t[2] for t in corners])

    scores = evaluate(submit(tmp_path / "s", data, true_mask, points=cloud), data).scores
    assert scores.submission.points
    assert scores.overall.strict.IoU_3D > 0.9
    assert scores.overall.strict.centroid_error < 0.02
    away = evaluate(submit(tmp_path / "t", data, true_mask, points=lambda o: cloud(o) + 5), data).scores
    assert away.overall.strict.IoU_3D == 0
    assert away.overall.strict.centroid_error == pytest.approx(np.sqrt(75), abs=0.05)
    assert away.references["all_black"]["overall"].strict.unavailable["IoU_3D"] == protocols.NO_POINTS


@pytest.mark.slow
def test_processes_change_nothing_to_the_last_bit(data: Path, tmp_path: Path):
    submission = submit(tmp_path / "s", data, shifted)
    serial, parallel = (evaluate(submission, data, workers=workers) for workers in (1, 2))
    assert serial == parallel
    assert files.dump_json(serial.scores) == files.dump_json(parallel.scores)


def test_the_official_release_as_it_is(release: Path, tmp_path: Path):
    scores = evaluate(submit(tmp_path / "s", release, true_mask), release).scores
    assert scores.overall.strict.IoU == scores.overall.official.F == 1
    assert scores.parts["part_2"].strict.unavailable["wrong_instance_rate"] == protocols.NO_INSTANCE_MASKS
    assert scores.dataset.version is scores.dataset.sha256 is None
    assert scores.categories == {}
    assert all(o.category is None and o.strict.twin_frames is None for o in scores.observations)


def test_3d_against_the_official_release_is_not_available(release: Path, tmp_path: Path):
    cloud = np.zeros((5, 3), np.float32)
    scores = evaluate(submit(tmp_path / "s", release, true_mask, points=lambda o: cloud), release).scores
    assert scores.overall.strict.IoU_3D is None
    assert scores.overall.strict.unavailable["IoU_3D"] == protocols.NO_MESH


@pytest.mark.parametrize("masks", layout.RELEASED_MASKS)
def test_the_released_pipelines_own_folders(data: Path, tmp_path: Path, masks: str):
    ours = evaluate(submit(tmp_path / "ours", data, shifted), data).scores
    theirs = evaluate(submit(tmp_path / "theirs", data, shifted, masks=masks), data).scores
    assert theirs.submission.layout == "official"
    assert [o.model_copy(update={"digests": None}) for o in theirs.observations] == [
        o.model_copy(update={"digests": None}) for o in ours.observations
    ]
    assert theirs.dataset.truth_digest == ours.dataset.truth_digest
    assert theirs.submission.digest != ours.submission.digest  # other paths


@pytest.mark.slow
@pytest.mark.parametrize(("option", "folder"), [(None, 0), ("True", 0), ("False", 1)])
def test_the_official_folder_is_chosen_and_said(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str | None, folder: int
):
    """The released pipeline always writes both; here the refined masks are right and the others are two pixels off."""
    root = tmp_path / "theirs"
    for masks, predict in zip(layout.RELEASED_MASKS, (true_mask, shifted), strict=True):
        submit(root, data, predict, masks=masks)
    arguments = () if option is None else ("--official-folder", option)
    code, out, _ = run(capsys, root, "--dataset", data, "--json", tmp_path / "scores.json", *arguments)
    assert code == 0
    assert f"official folder: {layout.RELEASED_MASKS[folder]}" in out
    found = json.loads((tmp_path / "scores.json").read_text())
    assert found["submission"]["masks"] == layout.RELEASED_MASKS[folder]
    assert (found["overall"]["strict"]["IoU"] == 1) == (folder == 0)


def test_an_official_folder_that_is_not_there_is_named(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    theirs = submit(tmp_path / "theirs", data, true_mask, masks=layout.RELEASED_MASKS[1])
    code, _, said = run(capsys, theirs, "--dataset", data, "--official-folder", "True")
    assert code == 2
    assert "no 3d_segmentation_use_aisrm_True/masks/test/ in any observation; found 3d_segmentation_use_aisrm_F" in said
    ours = submit(tmp_path / "ours", data, true_mask)
    code, _, said = run(capsys, ours, "--dataset", data, "--official-folder", "False")
    assert code == 2
    assert "found no folder of the released pipeline" in said
    assert len(said.strip().splitlines()) == 1


def test_the_released_pipeline_wrote_into_the_dataset_itself(release: Path, tmp_path: Path):
    root = tiny.clone(release, tmp_path / "work")
    submit(root, root, true_mask, masks=layout.RELEASED_MASKS[0])
    assert evaluate(root, root).scores.overall.strict.IoU == 1


def test_one_frame_observations(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "one", frames=1)
    scores = evaluate(submit(tmp_path / "s", root, true_mask), root).scores
    assert [o.frames for o in scores.observations] == [1, 1]
    assert scores.overall.strict.IoU == 1
    assert scores.parts["part_1"].strict.intervals == {}


@pytest.mark.slow
def test_names_of_observations_do_not_matter(data: Path, tmp_path: Path):
    """The same observations under other keys, in another order, with another number of workers: the same means."""
    submission = submit(tmp_path / "s", data, shifted)
    scores = evaluate(submission, data).scores
    for root, target in ((data, tmp_path / "d2"), (submission, tmp_path / "s2")):
        for number, key in enumerate((tiny.SINGLE, tiny.MULTI)):
            there = target / key.replace("/tiny/", f"/z{number}/")
            tiny.clone(root / key, there)
            (there / layout.OBSERVATION_JSON).unlink(missing_ok=True)
    said = {"method": "test", "dataset": "d2", "dataset_version": "1"}
    media.write_json(tmp_path / "s2" / layout.SUBMISSION_JSON, said)
    renamed = evaluate(tmp_path / "s2", tmp_path / "d2", workers=2).scores
    assert renamed.overall.official == scores.overall.official
    assert renamed.overall.strict.intervals == scores.overall.strict.intervals


def test_only_some_observations(data: Path, tmp_path: Path):
    submission = submit(tmp_path / "s", data, true_mask)
    shutil.rmtree(submission / tiny.SINGLE)
    scores = evaluate(submission, data, only=["part_2/*"]).scores
    assert [o.key for o in scores.observations] == [tiny.MULTI]
    assert (scores.dataset.observations, scores.dataset.scored) == (2, 1)


def test_worst_and_best_frames(data: Path, tmp_path: Path):
    evaluation = evaluate(submit(tmp_path / "s", data, twin), data)
    assert all(frame.iou == 0 or not frame.visible for frame in evaluation.worst)
    assert not set(evaluation.worst) & set(evaluation.best)
    assert all(frame.iou for frame in evaluation.best), "a frame without a hit is none of the best"
    black = evaluate(submit(tmp_path / "b", data, lambda frame: np.zeros_like(frame.mask())), data)
    assert black.best == ()
    perfect = evaluate(submit(tmp_path / "p", data, true_mask), data)
    assert perfect.worst == ()
    assert [frame.iou for frame in perfect.best] == [1.0] * len(perfect.best) != []


# The command line


@pytest.mark.slow
def test_the_command_prints_a_table_and_writes_the_pinned_keys(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("COLUMNS", "100")
    out = tmp_path / "scores.json"
    code, said, _ = run(capsys, submit(tmp_path / "s", data, shifted), "--dataset", data, "--json", out)
    assert code == 0
    for word in ("part_1", "part_2", "overall", "all black", "all white", "centre box", "microwave", "kitchen", "mIoU"):
        assert word in said
    found = json.loads(out.read_text())
    assert list(found["avs3d_eval"]["protocols"].items()) == [("official", "1.0"), ("strict", "1.0")]
    assert found["submission"]["method"] == "test"
    assert found["dataset"]["name"] == "tiny"
    first = found["observations"][0]
    assert (first["key"], first["category"], first["frames"]) == (tiny.SINGLE, "microwave", 3)
    assert {"mIoU", "F"} <= set(first["official"])
    assert set(found["parts"]) == {"part_1", "part_2"}
    assert {"mIoU", "F"} <= set(found["parts"]["part_1"]["official"])
    assert "IoU" in found["parts"]["part_2"]["strict"]
    assert set(found["references"]) == {"all_black", "all_white", "centre_box", "deaf_category", "deaf_most_seen"}
    assert Scores.model_validate_json(out.read_text()).overall.observations == 2


@pytest.mark.slow
def test_the_table_fits_eighty_columns(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("COLUMNS", "80")
    code, said, _ = run(capsys, submit(tmp_path / "s", data, shifted), "--dataset", data)
    assert code == 0
    assert "…" not in said
    assert max(map(len, said.splitlines())) <= 80


@pytest.mark.slow
def test_one_protocol_alone(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    submission = submit(tmp_path / "s", data, shifted)
    for protocol in PROTOCOLS:
        out = tmp_path / f"{protocol}.json"
        assert run(capsys, submission, "--dataset", data, "--protocol", protocol, "--json", out)[0] == 0
        found = Scores.model_validate_json(out.read_text())
        assert set(found.avs3d_eval.protocols) == {protocol}
        for group in (found.overall, found.observations[0], found.references["all_white"]["part_1"]):
            assert [name for name in PROTOCOL_PARTS if getattr(group, name) is not None] == [protocol]


@pytest.mark.slow
def test_the_report_is_named_beside_the_scores(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    submission = submit(tmp_path / "s", data, shifted)
    json_file, html = tmp_path / "out" / "a.json", tmp_path / "out" / "reports" / "a.html"
    html.parent.mkdir(parents=True)
    assert run(capsys, submission, "--dataset", data, "--json", json_file, "--html", html)[0] == 0
    assert json.loads(json_file.read_text())["report"] == "reports/a.html"
    assert html.read_text().startswith("<!doctype html>")
    first = json_file.read_bytes(), html.read_bytes()
    assert run(capsys, submission, "--dataset", data, "--json", json_file, "--html", html, "--workers", "2")[0] == 0
    assert (json_file.read_bytes(), html.read_bytes()) == first


@pytest.mark.slow
def test_a_broken_submission_gets_no_score_and_every_bad_file_named(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    submission = submit(tmp_path / "s", data, true_mask)
    grey = submission / tiny.MULTI / "masks" / "frame_008.png"
    tiny.replace(grey, b"")
    missing = submission / tiny.SINGLE / "masks" / "frame_016.png"
    missing.unlink()
    code, said, error = run(capsys, submission, "--dataset", data, "--json", tmp_path / "scores.json")
    assert code == 1
    assert not (tmp_path / "scores.json").exists()
    assert "frame_008.png" in said
    assert "frame_016.png" in said
    assert "Traceback" not in said + error


def test_usage_errors(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    submission = submit(tmp_path / "s", data, true_mask)
    for arguments in (
        (tmp_path / "nowhere", "--dataset", data),
        (submission, "--dataset", tmp_path / "nowhere"),
        (submission,),
        (submission, "--dataset", data, "--only", "part_3/*"),
        (submission, "--dataset", data, "--protocol", "lenient"),
    ):
        code, said, error = run(capsys, *arguments)
        assert code == 2, arguments
        assert said == ""
        assert error.count("\n") == 1
        assert error.startswith("avs3d-eval: error: ")


@pytest.mark.slow
def test_a_damaged_truth_is_the_datasets_fault(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    root = tiny.clone(data, tmp_path / "data")
    submission = submit(tmp_path / "s", root, true_mask)
    tiny.replace(root / tiny.SINGLE / "semantic_masks" / "frame_008.png", b"no picture")
    code, _, error = run(capsys, submission, "--dataset", root)
    assert code == 1
    assert "semantic_masks/frame_008.png" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    "target",
    [
        "s",
        "s/submission.json",
        f"s/{tiny.SINGLE}/masks/frame_000.png",
        f"s/{tiny.SINGLE}/new",
        "data/dataset.json",
        "z",
    ],
)
def test_a_result_never_takes_the_place_of_what_it_is_about(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], target: str
):
    root, submission = tiny.clone(data, tmp_path / "data"), submit(tmp_path / "s", data, true_mask)
    (tmp_path / "z").symlink_to(tmp_path / "s" / layout.SUBMISSION_JSON)
    before = tiny.hashes(tmp_path)
    for option in ("--json", "--html"):
        code, said, error = run(capsys, submission, "--dataset", root, option, tmp_path / target)
        assert (code, said, error.count("\n")) == (2, "", 1), option
    assert tiny.hashes(tmp_path) == before


def test_nor_an_archives_or_one_another(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    archive = Path(shutil.make_archive(str(tmp_path / "s"), "zip", submit(tmp_path / "s", data, true_mask)))
    before = archive.read_bytes()
    assert run(capsys, archive, "--dataset", data, "--json", archive)[0] == 2
    assert archive.read_bytes() == before
    same = tmp_path / "scores"
    assert run(capsys, archive, "--dataset", data, "--json", same, "--html", tmp_path / "s" / ".." / "scores")[0] == 2
    assert not same.exists()


@pytest.mark.slow
def test_scores_that_cannot_be_written_are_printed_all_the_same(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    submission = submit(tmp_path / "s", data, true_mask)
    # What can be known beforehand is said before anything is scored.
    code, said, error = run(capsys, submission, "--dataset", data, "--json", "/proc/a/b")
    assert (code, said) == (1, "")
    assert error.startswith("avs3d-eval: error: /proc/a/b: cannot write")
    # A disk that is full is noticed only when the scores are written.
    code, said, error = run(capsys, submission, "--dataset", data, "--json", "/dev/full")
    assert code == 1
    assert "overall (2)" in said
    assert error.startswith("avs3d-eval: error: /dev/full: cannot write")


@pytest.mark.slow
@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("mesh", [True, False])
def test_a_broken_cloud_gets_no_score_even_where_nobody_asks_for_it(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], protocol: str, mesh: bool
):
    root = tiny.clone(data, tmp_path / "data")
    submission = submit(tmp_path / "s", root, true_mask, points=lambda o: np.ones((2, 3)))
    cloud = submission / tiny.SINGLE / layout.SUBMISSION_POINTS
    tiny.replace(cloud, cloud.read_bytes()[:-4] + np.float32(np.nan).tobytes())
    if not mesh:
        (root / tiny.SINGLE / layout.SOUNDING_OBJECT).unlink()
    code, said, _ = run(capsys, submission, "--dataset", root, "--protocol", protocol)
    assert code == 1
    assert "points.ply" in said
    assert "overall" not in said


def test_the_released_pipelines_other_files_are_no_prediction(data: Path, tmp_path: Path):
    submission = submit(tmp_path / "s", data, true_mask, masks=layout.RELEASED_MASKS[0])
    (submission / tiny.SINGLE / layout.SUBMISSION_POINTS).write_text("no cloud of ours")
    scores = evaluate(submission, data).scores
    assert not scores.submission.points
    assert scores.overall.strict.unavailable["IoU_3D"] == protocols.NO_POINTS


@pytest.mark.slow
def test_a_methods_name_cannot_steer_the_terminal(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    submission = submit(tmp_path / "s", data, true_mask)
    for name, code in (("tiny", 0), ("\x1b]0;other", 1)):
        said = {"method": "evil\x1b[31m \u202etxt.exe\n[bold]", "dataset": name, "dataset_version": "1"}
        media.write_json(submission / layout.SUBMISSION_JSON, said)
        found, out, _ = run(capsys, submission, "--dataset", data)
        assert found == code
        assert not set(out) & set("\x1b\u202e")
        assert "\\x1b" in out


def shell(submission: Path, root: Path, *arguments: str, **environment: str) -> subprocess.Popen[str]:
    """The program in a process of its own."""
    call = [sys.executable, "-c", "from evaluators.cli import main; main()", str(submission), "--dataset", str(root)]
    pipe = subprocess.PIPE
    return subprocess.Popen([*call, *arguments], stdout=pipe, stderr=pipe, text=True, env=os.environ | environment)


@pytest.mark.slow
@pytest.mark.parametrize("broken", [False, True])
def test_a_reader_that_goes_away_changes_no_verdict(data: Path, tmp_path: Path, broken: bool):
    submission = submit(tmp_path / "s", data, true_mask)
    if broken:
        (submission / tiny.SINGLE / "masks" / "frame_000.png").unlink()
    program = shell(submission, data, "--json", str(tmp_path / "scores.json"))
    assert program.stdout
    program.stdout.close()
    assert (program.wait(), program.stderr.read()) == (int(broken), "")
    assert (tmp_path / "scores.json").exists() != broken


@pytest.mark.slow
def test_a_terminal_that_knows_ascii_only(data: Path, tmp_path: Path):
    out, error = shell(submit(tmp_path / "s", data, true_mask), data, PYTHONIOENCODING="ascii").communicate()
    assert "overall (2)" in out
    assert error == ""


@pytest.mark.slow
def test_a_narrow_terminal_loses_no_figure(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    submission = submit(tmp_path / "s", data, shifted)
    said = {}
    for columns in (120, 40):
        monkeypatch.setenv("COLUMNS", str(columns))
        said[columns] = run(capsys, submission, "--dataset", data)[1]
    wide, narrow = said[120], said[40]
    assert len(wide.splitlines()) < len(narrow.splitlines())
    assert "…" not in narrow
    assert narrow.split() == wide.split()


@pytest.mark.slow
def test_a_name_that_is_no_text(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    odd = os.fsdecode(b"caf\xe9")
    submission = submit(tmp_path / odd, data, true_mask, masks=layout.RELEASED_MASKS[0])
    json_file, html = tmp_path / "scores.json", tmp_path / f"{odd}.html"
    assert run(capsys, submission, "--dataset", data, "--json", json_file, "--html", html)[0] == 0
    found = Scores.model_validate_json(json_file.read_bytes())
    assert (found.submission.method, found.report) == ("caf\\udce9", None)


def test_terminated_it_cleans_up(data: Path, tmp_path: Path):
    """`timeout` and job schedulers send SIGTERM: the unpacked archive goes, and the workers with it."""
    archive = shutil.make_archive(str(tmp_path / "s"), "zip", submit(tmp_path / "s", data, true_mask))
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    program = shell(Path(archive), data, "--workers", "2", TMPDIR=str(scratch))
    while not list(scratch.glob("avs3d-submission-*")):
        assert program.poll() is None, program.communicate()
        time.sleep(0.002)
    program.send_signal(signal.SIGTERM)
    _, error = program.communicate(timeout=60)  # ends only when no worker holds the pipe any more
    assert program.returncode == 128 + signal.SIGTERM
    assert "Traceback" not in error
    assert not list(scratch.iterdir())


def test_workers_end_with_a_killed_parent():
    code = (
        "import os, signal\n"
        "from avs3d_bench.runtime.parallel import process_each\n"
        "if __name__ == '__main__':\n"
        "    next(iter(process_each(abs, [1, 2, 3], workers=2)))\n"
        "    for _ in process_each(abs, [1, 2, 3], workers=2):\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    # The pipes are inherited: communicate() returns only when the last worker has ended.
    program = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    program.communicate(timeout=60)
    assert program.returncode == -signal.SIGKILL


# The weight of the package


def test_importing_the_evaluator_pulls_in_nothing_heavy():
    code = (
        "import sys, evaluators, evaluators.score, evaluators.cli, evaluators.reporting.terminal_table\n"
        "heavy = {'torch', 'trimesh', 'generators', 'baselines', 'embreex', 'numba', 'matplotlib', 'pycolmap', "
        "'pandas'}\n"
        "print(*sorted({m.split('.')[0] for m in sys.modules} & heavy))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_help_names_the_protocols(capsys: pytest.CaptureFixture[str]):
    code, out, _ = run(capsys, "--help")
    assert (code, "--protocol" in out) == (0, True)


@pytest.mark.slow
def test_objects_out_of_sight_are_a_warning(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Eight frames have one test frame, in which the object of one of the two observations is not to be seen."""
    root = tiny.write_dataset(tmp_path / "eight", frames=8, size=32)
    code, out, _ = run(
        capsys, submit(tmp_path / "s", root, true_mask), "--dataset", root, "--html", tmp_path / "r.html"
    )
    said = "1 of 2 observations never shows the object in a test frame: strict IoU, F and boundary F are means over"
    assert code == 0
    assert f"warning: {said} the other 1; official mIoU counts an empty mask as 1 there" in out
    assert said in (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "never show" not in run(capsys, submit(tmp_path / "t", data, true_mask), "--dataset", data)[1]


def test_an_opened_dataset_scores_as_its_path_does(data: Path, tmp_path: Path):
    submission = submit(tmp_path / "s", data, shifted)
    assert evaluate(str(submission), Dataset(data)).scores == evaluate(submission, str(data)).scores
    one = Dataset(data).keys[0]
    assert [row.key for row in evaluate(submission, data, only=one).scores.observations] == [one]


@pytest.mark.parametrize("wrong", [{"dataset": None}, {"dataset": 3}, {"submission": 3}, {"truth": 3}])
def test_an_argument_of_another_type_is_named(data: Path, tmp_path: Path, wrong: dict[str, Any]):
    arguments = {"submission": tmp_path, "dataset": data} | wrong
    (name,) = wrong
    with pytest.raises(UsageError, match=rf"{name}: a \w+; expected the path"):
        evaluate(**arguments)


def test_public_records_have_a_short_repr(data: Path, tmp_path: Path):
    submission = submit(tmp_path / "s", data, shifted)
    found = evaluate(submission, data)
    assert f"{found.scores.overall.strict.IoU:.3f}" in repr(found)
    assert "2 observations" in repr(found.scores)
    media.write_json(tmp_path / "s.json", found.scores)
    media.write_json(tmp_path / "t.json", evaluate(submit(tmp_path / "t", data, true_mask), data).scores)
    verified = verify(tmp_path / "s.json", submission, data)
    compared = compare([tmp_path / "s.json", tmp_path / "t.json"])
    for record in (found, found.scores, verified, verified.record(), compared, check(submission, data)):
        assert len(repr(record)) < 300
        assert "\n" not in repr(record)
