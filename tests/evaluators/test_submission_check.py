"""`avs3d check`: the message of each fault, valid submissions, archives and links."""

from __future__ import annotations

import errno
import io
import json
import os
import shutil
import stat
import struct
import subprocess
import time
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.commands.report import print_report
from avs3d_bench.contract import layout
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media, predictions
from avs3d_bench.formats.predictions import read_mask, read_points
from avs3d_bench.validate import validate
from evaluators.reading import archive
from evaluators.reading.checks import check_submission
from evaluators.reading.records import InvalidSubmission
from evaluators.reading.submission import open_submission
from evaluators.score import evaluate
from tests.evaluators.test_score import shifted, submit, true_mask
from tests.support import mutants, tiny
from tests.support.shared import SharedDataset

FRAMES = 17
FIRST = f"{tiny.SINGLE}/masks/frame_000.png"


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=FRAMES)


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


@pytest.mark.slow
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
    monkeypatch.setattr(layout, "MAX_POINTS", 10)
    with pytest.raises(Avs3dError, match="11 points, expected at most 10"):
        read_points(path)
    media.write_ply_points(path, [[0, 1, 2], [0, 3400, 0]])
    with pytest.raises(Avs3dError, match=r"points 3.4e\+03 m from the origin, expected world coordinates in metres"):
        read_points(path)
    monkeypatch.setattr(predictions, "MAX_POINTS_BYTES", 100)
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
    assert "and 60 more errors" in said


def test_an_endless_tree_is_not_walked(data: Path, submission: Path, monkeypatch: pytest.MonkeyPatch):
    """What is there is not called missing because the walk ended before it."""
    monkeypatch.setattr("evaluators.reading.structure._SURPLUS", 50)
    for number in range(500):
        (submission / "part_1" / f"junk_{number}").mkdir()
    (submission / FIRST).unlink()
    found = findings(submission, data)
    assert found.pop("part_1").startswith("more than 50 surplus files and folders")
    assert found == {FIRST: "missing; expected a mask"}


def test_clutter_at_the_top_does_not_hide_the_masks(data: Path, submission: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("evaluators.reading.structure._SURPLUS", 50)
    for number in range(200):
        (submission / ".git" / f"{number}").mkdir(parents=True)
    report = check_submission(submission, data, workers=1)
    assert report.valid
    assert [(p.severity, p.path) for p in report.problems] == [("warning", "."), ("warning", ".git")]


def test_links_out_of_folders_at_the_top_are_found(data: Path, submission: Path, tmp_path: Path):
    (submission / "extra").mkdir()
    (submission / "extra" / "passwords").symlink_to(tmp_path)
    assert findings(submission, data) == {"extra/passwords": "a link out of the submission; expected a file"}


def test_folders_nested_beyond_what_paths_can_hold(data: Path, submission: Path):
    masks_folder = os.open(submission / tiny.SINGLE / "masks", os.O_RDONLY)
    for _ in range(1000):
        os.mkdir("deeper", dir_fd=masks_folder)
        below = os.open("deeper", os.O_RDONLY, dir_fd=masks_folder)
        os.close(masks_folder)
        masks_folder = below
    os.close(masks_folder)
    (submission / FIRST).unlink()
    found = findings(submission, data)
    assert found[FIRST] == "missing; expected a mask"
    deepest = max(found, key=len)
    assert deepest.count("/") == 11
    assert found[deepest].startswith(("surplus folder", "a folder nested 12 deep"))
    # Python's own rmtree, which clears the tests' folder later, cannot go so deep.
    subprocess.run(["rm", "-rf", str(submission / tiny.SINGLE / "masks")], check=True)


def test_a_folder_that_may_not_be_read(data: Path, submission: Path, monkeypatch: pytest.MonkeyPatch):
    """Simulated: the tests may run as root, whom no permission stops."""
    scandir = os.scandir

    def guarded(path: str | os.PathLike[str] = ".") -> object:
        if Path(path).name == "masks" and "part_2" in Path(path).parts:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), os.fspath(path))
        return scandir(path)

    (submission / FIRST).unlink()
    monkeypatch.setattr(os, "scandir", guarded)
    found = findings(submission, data)
    assert found[f"{tiny.MULTI}/masks"] == "cannot be looked into (Permission denied); change its permissions"
    assert found[FIRST] == "missing; expected a mask"


@pytest.mark.parametrize("json_file", [True, False])
def test_links_in_circles_are_not_followed(data: Path, submission: Path, json_file: bool):
    """Four levels of a thousand links to where they stand would be 10¹² folders."""
    for number in range(1000):
        (submission / "part_1" / f"again_{number}").symlink_to(".")
    if not json_file:
        (submission / "submission.json").unlink()
    before = time.monotonic()
    found = findings(submission, data)
    assert time.monotonic() - before < 10
    assert sum(path.startswith("part_1/again_") for path in found) == 1000
    assert ("submission.json" in found) != json_file


def test_hostile_text_is_printed_on_one_line(data: Path, submission: Path, capsys: pytest.CaptureFixture[str]):
    said = {"method": "m", "dataset": "tiny", "dataset_version": "1", "two\nlines\x1b[31m": 1}
    tiny.replace(submission / "submission.json", json.dumps(said).encode())
    root = submission.rename(submission.with_name("a\nb\x1b[2J"))
    print_report(check_submission(root, data, workers=1))
    printed = capsys.readouterr().out
    assert "two\\nlines\\x1b[31m: Extra inputs are not permitted" in printed
    assert "a\\nb\\x1b[2J: 1 error" in printed
    assert all(line.isprintable() for line in printed.split("\n"))


# Pictures that programs read in more than one way


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d + b"\0", "1 bytes after the end of the picture; expected one plain picture"),
        (lambda d: d + d, "bytes after the end of the picture"),
        (lambda d: inserted(d, b"tRNS", b"\0\0"), "a PNG with transparency; expected one plain picture"),
        (lambda d: inserted(d, b"acTL", bytes(8)), "a PNG with an animation; expected one plain picture"),
        (lambda d: d[: d.rfind(b"IEND") - 4], "truncated after"),
    ],
)
def test_masks_that_are_more_than_one_picture(
    submission: Path, data: Path, change: Callable[[bytes], bytes], says: str
):
    tiny.replace(submission / FIRST, change((submission / FIRST).read_bytes()))
    assert says in findings(submission, data)[FIRST]
    with pytest.raises(InvalidSubmission):
        evaluate(submission, data)


def inserted(data: bytes, kind: bytes, body: bytes) -> bytes:
    header, *rest = mutants.chunks(data)
    return mutants.png([header, (kind, body), *rest])


def test_interlaced_masks_and_comments_pass(submission: Path, data: Path):
    """Adam7 of a picture of one value: every pass is its own small picture of rows that begin with a filter byte."""
    passes = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)]
    rows = b"".join((b"\0" + b"\xff" * len(range(x, 64, dx))) * len(range(y, 64, dy)) for x, y, dx, dy in passes)
    header = struct.pack(">IIBBBBB", 64, 64, 8, 0, 0, 0, 1)
    text = (b"tEXt", b"Software\0a program")
    tiny.replace(
        submission / FIRST, mutants.png([(b"IHDR", header), text, (b"IDAT", zlib.compress(rows)), (b"IEND", b"")])
    )
    assert findings(submission, data) == {}
    assert (read_mask(submission / FIRST, 64, 64, released=False) == 255).all()


def picture(data: bytes, split: int = 0) -> bytes:
    """A PNG of 64×64 pixels of eight bits with that stream."""
    header = struct.pack(">IIBBBBB", 64, 64, 8, 0, 0, 0, 0)
    return mutants.png([(b"IHDR", header), (b"IDAT", data[:split]), (b"IDAT", data[split:]), (b"IEND", b"")])


ROWS = bytes(64 * 65)
STREAM = zlib.compress(ROWS)


@pytest.mark.parametrize(
    ("stream", "says"),
    [
        (zlib.compress(ROWS + b"\0"), "more than the 4,160 of its size"),
        (zlib.compress(ROWS + bytes(2**24)), "more than the 4,160 of its size"),
        (zlib.compress(ROWS[:-1]), "4,159 bytes of pixels, not the 4,160 of its size"),
        (STREAM[:-4], "damaged PNG"),
        (STREAM[:-1] + bytes([STREAM[-1] ^ 1]), "incorrect data check"),
        (STREAM + b"\0", "data after the end of its pixels"),
        (STREAM + STREAM, "data after the end of its pixels"),
    ],
)
@pytest.mark.parametrize("split", [0, 1, -1])
def test_pixels_are_as_many_as_the_rows_and_pass_their_checksum(submission: Path, stream: bytes, says: str, split: int):
    tiny.replace(submission / FIRST, picture(stream, split=split % len(stream)))
    with pytest.raises(Avs3dError, match=says):
        read_mask(submission / FIRST, 64, 64, released=False)
    with pytest.raises(Avs3dError, match=says):
        media.check_png(submission / FIRST)


def test_whole_pictures_pass(submission: Path, tmp_path: Path):
    for split in (0, 1, len(STREAM) - 1, len(STREAM)):
        tiny.replace(submission / FIRST, picture(STREAM, split=split))
        assert not read_mask(submission / FIRST, 64, 64, released=False).any()
    image = pytest.importorskip("PIL.Image", reason="pillow comes with the extra 'generate'")
    rng = np.random.default_rng(0)
    for mode, shape in [("1", (5, 7)), ("L", (1, 1)), ("RGB", (9, 13)), ("RGBA", (3, 2)), ("P", (8, 8))]:
        channels = len(mode) if mode.startswith("RGB") else 1
        pixels = rng.integers(0, 256, (*shape, channels)).astype(np.uint8)
        picture_of = image.fromarray(pixels if channels > 1 else pixels[..., 0]).convert(mode)
        picture_of.save(tmp_path / "p.png")
        media.check_png(tmp_path / "p.png")


@pytest.mark.parametrize(("width", "height"), [(1, 1), (2, 3), (5, 4), (8, 8), (9, 17)])
def test_interlaced_pictures_pass(tmp_path: Path, width: int, height: int):
    """Adam7, row by row as the recommendation draws it: a pixel's pass by its place in squares of 8 × 8."""
    square = np.array(
        [[1, 6, 4, 6, 2, 6, 4, 6], [7] * 8, [5, 6] * 4, [7] * 8, [3, 6, 4, 6] * 2, [7] * 8, [5, 6] * 4, [7] * 8]
    )
    passes = np.tile(square, (3, 2))[:height, :width]
    rows = b"".join(
        b"\0" + bytes(int((row == number).sum())) for number in range(1, 8) for row in passes if (row == number).any()
    )
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 1)
    for data, good in ((rows, True), (rows + b"\0", False), (rows[:-1], False)):
        (tmp_path / "p.png").write_bytes(
            mutants.png([(b"IHDR", header), (b"IDAT", zlib.compress(data)), (b"IEND", b"")])
        )
        if good:
            media.check_png(tmp_path / "p.png")
            assert cv2.imread(str(tmp_path / "p.png"), cv2.IMREAD_UNCHANGED).shape == (height, width)
        else:
            with pytest.raises(Avs3dError, match="of its size"):
                media.check_png(tmp_path / "p.png")


def test_deep_validation_looks_at_the_pixels_of_pictures(tmp_path: Path):
    root = tiny.write_release(tmp_path / "release")
    path = next(iter(sorted(root.rglob("input/frame_003.png"))))
    parts = mutants.chunks(path.read_bytes())
    stream = zlib.decompress(b"".join(body for kind, body in parts if kind == b"IDAT"))
    tiny.replace(path, mutants.png([parts[0], (b"IDAT", zlib.compress(stream + b"more")), (b"IEND", b"")]))
    found = validate(root, deep=True, workers=1).problems
    said = [p.message for p in found if p.path.endswith("input/frame_003.png") and p.severity == "error"]
    assert any("more than the" in message for message in said), found


# Clouds whose header is not to be trusted


HEADER = "ply\nformat {}\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEADER.format("binary_little_endian 1.0", 10**9), "1,000,000,000 points, expected at most 2,000,000"),
        (HEADER.format("ascii 1.0", 10**12), "1,000,000,000,000 points, expected at most 2,000,000"),
        (
            HEADER.format("binary_little_endian 1.0", 1).replace("float y", "float x"),
            "'property float x' is not understood",
        ),
        (HEADER.format("binary_little_endian 1.0", 1).replace("float x", "list uchar float x"), r"vertex\.x is a list"),
        (
            HEADER.format("binary_little_endian 1.0", 1).replace("element", f"element none {10**30}\nelement", 1),
            "PLY header line .* is not understood",
        ),
        (HEADER.format("binary_little_endian 1.0", 1) + "comment " + "x" * 70_000 + "\n", "no end_header in its first"),
    ],
)
def test_headers_that_promise_the_impossible(tmp_path: Path, text: str, says: str):
    path = tmp_path / "points.ply"
    path.write_bytes(f"{text}end_header\n".encode() + b"\3" + bytes(40))
    with pytest.raises(Avs3dError, match=says):
        read_points(path)


def test_a_large_cloud_is_written_as_binary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """One point announced, and millions of words behind it, each of which costs an object."""
    path = tmp_path / "points.ply"
    path.write_bytes(f"{HEADER.format('ascii 1.0', 1)}end_header\n".encode() + b"11 " * 3_000_000)

    def refuse(*_: object) -> None:
        raise AssertionError("read")

    monkeypatch.setattr(predictions, "read_ply", refuse)
    with pytest.raises(Avs3dError, match="bytes of ASCII PLY, expected at most 8,388,608: write it as binary"):
        read_points(path)


@settings(max_examples=300)
@given(
    edits=st.lists(
        st.tuples(
            st.integers(0, 400),
            st.integers(0, 12),
            st.sampled_from([b"", b"x", b"0", b"-1", b"99999999999", b"nan", b"list ", b"\n", b"\xff", b"double"]),
        ),
        max_size=6,
    ),
    ascii_=st.booleans(),
)
def test_any_damage_to_a_cloud_is_one_line(tmp_path_factory: pytest.TempPathFactory, edits: Any, ascii_: bool):
    path = tmp_path_factory.getbasetemp() / "damaged.ply"
    text = HEADER.format("ascii 1.0" if ascii_ else "binary_little_endian 1.0", 2)
    body = b"1 2 3\n4 5 6\n" if ascii_ else struct.pack("<6f", *range(6))
    data = f"{text}end_header\n".encode() + body
    for at, length, new in edits:
        at %= len(data) + 1
        data = data[:at] + new + data[at + length :]
    path.write_bytes(data)
    said = ""
    try:
        points = read_points(path)
    except Avs3dError as error:
        said, points = str(error), np.zeros((0, 3), np.float32)
    assert said == "" or (said.startswith(f"{path}: ") and said.isprintable())
    assert points.ndim == 2
    assert points.shape[1] == 3
    assert np.isfinite(points).all()


# What a submission is not


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
        ("part_1/" + "x" * 256, "a name of more than 255 bytes"),
        ("a/" * 1100 + "x", "a path of more than 2048 bytes"),
        ("a/" * 64 + "x", "or 64 folders"),
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


def test_many_small_members_are_a_bomb_as_well(good: Path, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(archive, "LIMITS", replace(archive.LIMITS, small_total=2**20))
    path = pack(good, tmp_path / "s.zip")
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as out:
        for number in range(20):
            out.writestr(f"part_1/bomb_{number}.png", bytes(2**20))
    assert "an archive bomb" in findings(path, data)["."]


def test_an_archive_for_which_there_is_no_room(good: Path, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = pack(good, tmp_path / "s.zip")
    needed = sum(file.stat().st_size for file in good.rglob("*") if file.is_file())
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=100))
    with pytest.raises(Avs3dError, match=f"100 bytes free, the submission unpacks to {needed:,}; free some space"):
        check_submission(path, data, workers=1)


@pytest.mark.parametrize("zip64", [False, True])
def test_an_archive_with_an_endless_list_of_members(
    good: Path, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, zip64: bool
):
    """It is refused before Python makes an object of every member."""
    path = pack(good, tmp_path / "s.zip")
    if zip64:
        with monkeypatch.context() as patched:
            patched.setattr(zipfile, "ZIP_FILECOUNT_LIMIT", 1)
            pack(good, path)
        assert b"PK\6\6" in path.read_bytes()
    assert findings(path, data) == {}
    monkeypatch.setattr(archive, "LIMITS", replace(archive.LIMITS, directory=300))

    def refuse(*_: object) -> None:
        raise AssertionError("opened")

    monkeypatch.setattr(zipfile, "ZipFile", refuse)
    with pytest.raises(UsageError, match=r"a list of members of [0-9,]+ bytes, expected at most 300"):
        check_submission(path, data, workers=1)


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
    assert "is listed twice" in findings(path, data)[FIRST.upper()]


def test_a_damaged_member_is_named(good: Path, data: Path, tmp_path: Path):
    path = pack(good, tmp_path / "s.zip", method=zipfile.ZIP_STORED)
    raw = bytearray(path.read_bytes())
    at = raw.find((good / FIRST).read_bytes())
    raw[at + 50] ^= 0xFF
    path.write_bytes(bytes(raw))
    assert "damaged in the archive" in findings(path, data)[FIRST]


def test_too_many_members(good: Path, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = pack(good, tmp_path / "s.zip")
    monkeypatch.setattr(archive, "LIMITS", replace(archive.LIMITS, members=3))
    with pytest.raises(UsageError, match=r"s\.zip: 7 members, expected at most 3"):
        check_submission(path, data, workers=1)
    raw = bytearray(path.read_bytes())
    at = raw.rfind(b"PK\5\6")
    raw[at + 8 : at + 12] = b"\1\0\1\0"  # zipfile reads the whole list, whatever its end says
    path.write_bytes(raw)
    assert "7 members, expected at most 3" in findings(path, data)["."]


def closed(members: int, length: int, *, zip64: bool, comment: bytes = b"") -> bytes:
    """The records that close an archive."""
    end = struct.pack(
        "<4s4H2IH", b"PK\5\6", 0, 0, *([0xFFFF] * 2 if zip64 else [min(members, 0xFFFF)] * 2),
        0xFFFFFFFF if zip64 else length, 0, len(comment)
    )  # fmt: skip
    if not zip64:
        return end + comment
    record = struct.pack("<4sQ2H2I4Q", b"PK\6\6", 44, 45, 45, 0, 0, members, members, length, 0)
    return record + struct.pack("<4sIQI", b"PK\6\7", 0, 0, 1) + end + comment


@pytest.mark.parametrize(
    ("end", "says"),
    [
        (closed(500_000, 30_000_000, zip64=True), "500,000 members, expected at most 50,000"),
        (closed(60_000, 3_000_000, zip64=False), "60,000 members, expected at most 50,000"),
        (closed(10, 60 * 2**20, zip64=False), "a list of members of 62,914,560 bytes, expected at most 10,485,760"),
        (closed(10, 60 * 2**20, zip64=True), "a list of members of 62,914,560 bytes"),
        (closed(10, 60 * 2**20, zip64=True, comment=b"a comment" * 1000), "a list of members of 62,914,560 bytes"),
        # The signature stands again inside the record, in the offset of the list.
        (closed(10, 60 * 2**20, zip64=False)[:16] + b"PK\5\6\0\0", "a list of members of 62,914,560 bytes"),
    ],
)  # fmt: skip
def test_the_end_of_an_archive_is_enough_to_refuse_it(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: bytes, says: str
):
    path = tmp_path / "s.zip"
    path.write_bytes(end)

    def refuse(*_: object) -> None:
        raise AssertionError("opened")

    monkeypatch.setattr(zipfile, "ZipFile", refuse)
    monkeypatch.setattr(zipfile, "is_zipfile", lambda _: True)
    with pytest.raises(UsageError, match=says):
        check_submission(path, data, workers=1)


def test_zip64_of_a_few_members_is_read(good: Path, data: Path, tmp_path: Path):
    """Writers may put zip64 records at the end of a small archive, with every count of the old one all ones."""
    path = pack(good, tmp_path / "s.zip")
    raw = path.read_bytes()
    at = raw.rfind(b"PK\5\6")
    members, length, start = struct.unpack_from("<HII", raw, at + 10)
    record = struct.pack("<4sQ2H2I4Q", b"PK\6\6", 44, 45, 45, 0, 0, members, members, length, start)
    locator = struct.pack("<4sIQI", b"PK\6\7", 0, at, 1)
    end = struct.pack("<4s4H2IH", b"PK\5\6", 0, 0, 0xFFFF, 0xFFFF, 0xFFFFFFFF, 0xFFFFFFFF, 0)
    path.write_bytes(raw[:at] + record + locator + end)
    assert findings(path, data) == {}


def test_members_that_share_their_bytes(good: Path, data: Path, tmp_path: Path):
    path = pack(good, tmp_path / "s.zip", method=zipfile.ZIP_STORED)
    raw = bytearray(path.read_bytes())
    for offset in (20, 24):  # packed and unpacked bytes of the last member in the list
        struct.pack_into("<I", raw, raw.rfind(b"PK\1\2") + offset, len(raw))
    path.write_bytes(raw)
    assert "an archive bomb" in findings(path, data)["."]


def test_a_second_name_in_an_extra_field(good: Path, data: Path, tmp_path: Path):
    """Info-ZIP's unicode path: later versions of zipfile, and other programs, unpack the member under that name."""
    path = tmp_path / "s.zip"
    with zipfile.ZipFile(path, "w") as out:
        for file in sorted(good.rglob("*.*")):
            member = zipfile.ZipInfo(file.relative_to(good).as_posix())
            if member.filename == FIRST:
                new = FIRST.replace("frame_000", "frame_900").encode()
                body = struct.pack("<BI", 1, zlib.crc32(FIRST.encode())) + new
                member.extra = struct.pack("<HHI", 0x5455, 4, 0) + struct.pack("<HH", 0x7075, len(body)) + body
            out.writestr(member, file.read_bytes())
    assert findings(path, data) == {FIRST: "has a second name in an extra field; pack it again, with plain names"}


def test_names_are_printable():
    assert archive.printable("a\nb\x1b[0m") == "a\\nb\\x1b[0m"
    assert archive.printable("caf\udce9") == "caf\\udce9"
    assert archive.printable("frame_000.png") == "frame_000.png"
