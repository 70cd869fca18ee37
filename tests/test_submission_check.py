"""`avs3d check`: what each fault is called, what passes, archives and links."""

from __future__ import annotations

import io
import os
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import tiny
from test_score import shifted, submit, true_mask

from avs3d_bench import layout, media
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.report import print_report
from evaluators import archive, masks
from evaluators.checks import check_submission
from evaluators.masks import read_mask, read_points
from evaluators.records import InvalidSubmission
from evaluators.score import evaluate
from evaluators.submission import open_submission

FRAMES = 17
FIRST = f"{tiny.SINGLE}/masks/frame_000.png"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.write_dataset(tmp_path_factory.mktemp("data") / "tiny", frames=FRAMES)


@pytest.fixture(scope="module")
def good(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return submit(tmp_path_factory.mktemp("good") / "s", data, shifted)


@pytest.fixture
def submission(good: Path, tmp_path: Path) -> Path:
    return tiny.clone(good, tmp_path / "s")


def findings(submission: Path, data: Path, **options: object) -> dict[str, str]:
    """Path → message, errors only."""
    report = check_submission(submission, data, workers=1, **options)
    return {p.path: p.message for p in report.problems if p.severity == "error"}


def encode(pixels: np.ndarray) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()


def test_a_good_submission_is_valid(good: Path, data: Path):
    report = check_submission(good, data, workers=1)
    assert report.valid
    assert report.problems == ()
    assert report.files == 1 + 2 * 3  # submission.json, three test frames of two observations


@pytest.mark.parametrize(
    ("pixels", "says"),
    [
        (np.zeros((32, 64), np.uint8), "64×32 pixels, expected 64×64"),
        (np.zeros((64, 64, 3), np.uint8), "RGB, 8 bit; expected a mask: grey, 8 bit, 0 or 255"),
        (np.zeros((64, 64, 4), np.uint8), "RGBA, 8 bit; expected a mask"),
        (np.zeros((64, 64), np.uint16), "grey, 16 bit; expected a mask"),
        (np.eye(64, dtype=np.uint8), "holds 0 and 1; expected 0 and 255: multiply by 255"),
        (np.eye(64, dtype=np.uint8) * 128, "holds grey values (128); expected 0 and 255 only: threshold"),
        (np.arange(64 * 64, dtype=np.uint8).reshape(64, 64), "holds grey values (1, 2, 3, 4, …)"),
    ],
)
def test_what_is_wrong_with_a_mask(submission: Path, data: Path, pixels: np.ndarray, says: str):
    tiny.replace(submission / FIRST, encode(pixels))
    assert says in findings(submission, data)[FIRST]


def test_one_bit_masks_pass(submission: Path, data: Path):
    path = submission / FIRST
    tiny.replace(
        path, cv2.imencode(".png", np.eye(64, dtype=np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])[1].tobytes()
    )
    assert media.png_header(path).bits == 1
    assert findings(submission, data) == {}
    assert read_mask(path, 64, 64, released=False).tolist() == (np.eye(64) * 255).tolist()


def test_a_gigantic_header_is_refused_before_anything_is_decoded(
    submission: Path, data: Path, monkeypatch: pytest.MonkeyPatch
):
    header = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\x7f\xff\xff\xff\x7f\xff\xff\xff\x08\0\0\0\0"
    tiny.replace(submission / FIRST, header + bytes(100))

    def refuse(*_: object) -> None:
        raise AssertionError("decoded")

    with monkeypatch.context() as patched:
        patched.setattr(cv2, "imdecode", refuse)
        with pytest.raises(Avs3dError, match="2147483647×2147483647 pixels, expected 64×64"):
            read_mask(submission / FIRST, 64, 64, released=False)
    assert "2147483647×2147483647" in findings(submission, data)[FIRST]


def test_the_released_pipelines_masks_may_be_rgb_with_equal_channels(data: Path, tmp_path: Path):
    root = submit(tmp_path / "s", data, true_mask, masks=layout.RELEASED_MASKS[0])
    for path in root.rglob("*.png"):
        tiny.replace(path, encode(cv2.cvtColor(cv2.imread(str(path), 0), cv2.COLOR_GRAY2BGR)))
    (root / tiny.SINGLE / "point_cloud.ply").write_text("the pipeline's own files do not matter")
    assert findings(root, data) == {}
    assert evaluate(root, data).scores.overall.strict.IoU == 1
    coloured = np.zeros((64, 64, 3), np.uint8)
    coloured[3, 4, 1] = 255
    path = f"{tiny.SINGLE}/{layout.RELEASED_MASKS[0]}/frame_008.png"
    tiny.replace(root / path, encode(coloured))
    assert "a coloured picture" in findings(root, data)[path]


def test_missing_surplus_and_train_frames(submission: Path, data: Path):
    (submission / FIRST).rename(submission / tiny.SINGLE / "masks" / "frame_001.png")
    (submission / tiny.SINGLE / "masks" / "frame_900.png").write_bytes(b"")
    (submission / tiny.MULTI / "notes.txt").write_text("hello")
    (submission / tiny.MULTI / "logs").mkdir()
    (submission / "part_1/tiny/kitchen/2/masks").mkdir(parents=True)
    found = findings(submission, data)
    assert found.pop(FIRST) == "missing; expected a mask"
    assert found.pop(f"{tiny.SINGLE}/masks/frame_001.png") == "a mask of a train frame; expected test frames only"
    assert found.pop(f"{tiny.SINGLE}/masks/frame_900.png").startswith("surplus file; expected one mask per test frame")
    assert found.pop(f"{tiny.MULTI}/notes.txt").startswith("surplus file")
    assert found.pop(f"{tiny.MULTI}/logs").startswith("surplus folder")
    assert found.pop("part_1/tiny/kitchen/2") == "no such observation in the dataset"
    assert found == {}


def test_things_at_the_top_are_warnings(submission: Path, data: Path):
    for name in ("README.md", "LICENSE", "CITATION.cff", "scores.json"):
        (submission / name).write_text("x")
    report = check_submission(submission, data, workers=1)
    assert report.valid
    assert [(p.severity, p.path) for p in report.problems] == [("warning", "scores.json")]


def test_only_some_observations_are_asked_for(submission: Path, data: Path):
    (submission / FIRST).unlink()
    assert findings(submission, data, only=["part_2/*"]) == {}
    with pytest.raises(UsageError, match="no observation matches part_3"):
        check_submission(submission, data, only=["part_3/*"])


def test_links_inside_are_fine_and_links_out_are_not(submission: Path, data: Path, tmp_path: Path):
    inside = submission / tiny.SINGLE / "masks" / "frame_016.png"
    inside.unlink()
    inside.symlink_to("frame_008.png")
    assert findings(submission, data) == {}
    outside = tmp_path / "outside.png"
    outside.write_bytes((submission / FIRST).read_bytes())
    inside.unlink()
    inside.symlink_to(outside)
    assert findings(submission, data)[f"{tiny.SINGLE}/masks/frame_016.png"].startswith("a link out of the submission")


def test_a_link_to_the_whole_submission_is_fine(good: Path, data: Path, tmp_path: Path):
    (tmp_path / "link").symlink_to(good)
    assert findings(tmp_path / "link", data) == {}


def test_released_masks_behind_a_link_out_are_refused(data: Path, tmp_path: Path):
    root = submit(tmp_path / "s", data, true_mask, masks=layout.RELEASED_MASKS[0])
    folder = root / tiny.SINGLE / layout.RELEASED_MASKS[0]
    folder.rename(tmp_path / "elsewhere")
    folder.symlink_to(tmp_path / "elsewhere")
    assert "a link out of the submission" in findings(root, data)[folder.relative_to(root).as_posix()]


def test_submission_json_for_another_dataset(submission: Path, data: Path):
    said = {"method": "m", "dataset": "tiny", "dataset_version": "2"}
    tiny.replace(submission / "submission.json", media.dump_json(said).encode())
    assert findings(submission, data)["submission.json"] == "made for tiny 2, expected tiny 1, this dataset"


def test_against_the_official_release_the_dataset_cannot_be_checked(good: Path, tmp_path: Path):
    release = tiny.write_release(tmp_path / "release", frames=FRAMES)
    report = check_submission(good, release, workers=1)
    assert report.valid
    assert [p.severity for p in report.problems] == ["note"]


def test_clouds_in_all_or_in_none(data: Path, tmp_path: Path):
    root = submit(tmp_path / "s", data, true_mask, points=lambda o: np.zeros((0, 3)))
    assert findings(root, data) == {}
    (root / tiny.MULTI / "points.ply").unlink()
    assert "expected one in all" in findings(root, data)[f"{tiny.MULTI}/points.ply"]


def test_clouds_have_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "points.ply"
    media.write_ply_points(path, np.zeros((11, 3)))
    monkeypatch.setattr(masks, "MAX_POINTS", 10)
    with pytest.raises(Avs3dError, match="11 points, expected at most 10"):
        read_points(path)
    media.write_ply_points(path, [[0, 1, 2], [0, 3400, 0]])
    with pytest.raises(Avs3dError, match=r"points 3.4e\+03 m from the origin, expected world coordinates in metres"):
        read_points(path)
    monkeypatch.setattr(masks, "MAX_POINTS_BYTES", 100)
    with pytest.raises(Avs3dError, match="expected at most 100"):
        read_points(path)


def test_a_screenful_and_then_a_count(data: Path, submission: Path, capsys: pytest.CaptureFixture[str]):
    for number in range(100):
        (submission / tiny.SINGLE / "masks" / f"more_{number}.png").write_bytes(b"")
    report = check_submission(submission, data, workers=1)
    assert report.count("error") == 100
    print_report(report, shown=40)
    said = capsys.readouterr().out
    assert said.count("surplus file") == 40
    assert "and 60 errors more" in said


def test_an_endless_tree_is_not_walked(data: Path, submission: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("evaluators.checks._SURPLUS", 50)
    for number in range(200):
        (submission / f"junk_{number}").mkdir()
    assert any("more than 50 surplus" in message for message in findings(submission, data).values())


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda path: None, "no such folder or archive"),
        (lambda path: path.mkdir(), "no submission; expected submission.json and part_1"),
        (lambda path: path.write_text("hello"), "neither a folder nor a .zip"),
        (lambda path: path.write_bytes(b"PK\x03\x04"), "neither a folder nor a .zip"),
        (lambda path: os.mkfifo(path), "neither a folder nor a .zip"),
    ],
)
def test_what_is_no_submission(data: Path, tmp_path: Path, make: Callable[[Path], None], says: str):
    path = tmp_path / "s"
    make(path)
    with pytest.raises(UsageError, match=says):
        check_submission(path, data)


def test_the_dataset_itself_is_no_submission(data: Path):
    with pytest.raises(UsageError, match="no submission"):
        check_submission(data, data)


# Archives


def pack(folder: Path, path: Path, prefix: str = "", method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as out:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                out.write(file, prefix + file.relative_to(folder).as_posix())
    return path


@pytest.mark.parametrize("prefix", ["", "mine/"])
def test_a_zip_scores_as_its_folder_does(good: Path, data: Path, tmp_path: Path, prefix: str):
    path = pack(good, tmp_path / "s.zip", prefix)
    assert findings(path, data) == {}
    assert evaluate(path, data).scores == evaluate(good, data).scores


def test_the_unpacked_files_are_removed(good: Path, tmp_path: Path):
    with open_submission(pack(good, tmp_path / "s.zip")) as opened:
        root = opened.root
        assert root.is_dir()
        assert opened.named == tmp_path / "s.zip"
    assert not root.exists()


def link(name: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    return info


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("/etc/passwd", "an absolute path"),
        ("C:/windows/win.ini", "an absolute path"),
        ("../escape.png", "a path that leads elsewhere"),
        ("part_1/../../escape.png", "a path that leads elsewhere"),
        ("part_1//x.png", "a path that leads elsewhere"),
        ("part_1\\x.png", "a backslash"),
        (link("part_1/x.png"), "a symlink or device"),
    ],
)
def test_path_tricks_in_archives(good: Path, data: Path, tmp_path: Path, name: str | zipfile.ZipInfo, says: str):
    path = pack(good, tmp_path / "inner" / "s.zip") if (tmp_path / "inner").mkdir() is None else None
    with zipfile.ZipFile(path, "a") as out:
        out.writestr(name, b"surprise")
    shown = name if isinstance(name, str) else name.filename
    found = findings(path, data)
    assert says in found[shown.replace("\\", "\\")]
    with pytest.raises(InvalidSubmission, match=says):
        evaluate(path, data)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["inner", "s.zip"]


def test_a_bomb_is_not_unpacked(good: Path, data: Path, tmp_path: Path):
    path = pack(good, tmp_path / "s.zip")
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as out:
        out.writestr("part_1/bomb.png", bytes(50_000_000))
    assert "an archive bomb" in findings(path, data)["part_1/bomb.png"]


def test_an_archive_that_lies_about_sizes(good: Path, data: Path, tmp_path: Path):
    """A member's directory entry says one byte, its data is another length."""
    stored = io.BytesIO()
    with zipfile.ZipFile(stored, "w") as out:
        out.writestr("submission.json", b"x" * 1000)
    raw = stored.getvalue().replace((1000).to_bytes(4, "little"), (1).to_bytes(4, "little"))
    path = tmp_path / "s.zip"
    path.write_bytes(raw)
    assert list(findings(path, data)) == ["submission.json"]


def test_a_member_twice(good: Path, data: Path, tmp_path: Path):
    path = pack(good, tmp_path / "s.zip")
    with zipfile.ZipFile(path, "a") as out:
        out.writestr(FIRST.upper(), b"")
    assert "stands twice" in findings(path, data)[FIRST.upper()]


def test_a_damaged_member_is_named(good: Path, data: Path, tmp_path: Path):
    path = pack(good, tmp_path / "s.zip", method=zipfile.ZIP_STORED)
    raw = bytearray(path.read_bytes())
    at = raw.find((good / FIRST).read_bytes())
    raw[at + 50] ^= 0xFF
    path.write_bytes(bytes(raw))
    assert "damaged in the archive" in findings(path, data)[FIRST]


def test_too_many_members(good: Path, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(archive, "MAX_MEMBERS", 3)
    assert "7 members, expected at most 3" in findings(pack(good, tmp_path / "s.zip"), data)["."]


def test_names_are_printable():
    assert archive.printable("a\nb\x1b[0m") == "a\\nb\\x1b[0m"
    assert archive.printable("caf\udce9") == "caf\\udce9"
    assert archive.printable("frame_000.png") == "frame_000.png"
