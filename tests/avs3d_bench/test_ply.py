"""Untrusted PLY files: the header is checked against the file's size, text is read strictly, memory is bounded."""

from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import ply_reader, predictions
from avs3d_bench.formats.ply import read_ply, write_ply_points
from avs3d_bench.formats.ply_reader import read_header
from avs3d_bench.formats.predictions import read_points
from evaluators.reading.checks import check_submission
from evaluators.reading.records import InvalidSubmission
from evaluators.score import evaluate
from tests.evaluators.test_score import submit, true_mask
from tests.support import tiny

XYZ = "property float x\nproperty float y\nproperty float z\n"
LISTS = XYZ.replace("float", "list uchar float")


def header(count: int, properties: str = XYZ, form: str = "ascii", more: str = "") -> bytes:
    return f"ply\nformat {form} 1.0\nelement vertex {count}\n{properties}{more}end_header\n".encode()


def cloud(folder: Path, data: bytes) -> Path:
    (folder / "points.ply").write_bytes(data)
    return folder / "points.ply"


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (b"1 2 3\n4 5 six\n", "vertex holds 'six'; expected a number"),
        (b"1 2 3\n4 5 1_000\n", "vertex holds '1_000'"),
        (b"1 2 3\n4 5 +6\n", r"vertex holds '\+6'"),
        (b"1 2 3\n4 5 6+6\n", r"vertex holds '6\+6'"),
        (b"1 2 3\n4 5\r6\n", r"a line of 2 numbers in vertex, expected 3"),
        (b"1 2 3\n4 5 6\r7\n", r"vertex holds '6.*7'"),
        (b"1 2 3\n4 5 0x10\n", "vertex holds '0x10'"),
        (b"1 2 3\n4 5 \xd9\xa3\n", "vertex holds 'Ù£'"),
        (b"1 2 3\n4 5 " + b"6" * 5000 + b"\n", "vertex holds '6{40}'"),
        (b"1 2 3 4 5 6\n", "a line of 6 numbers in vertex, expected 3"),
        (b"1 2 3\n\n4 5 6\n", "a line of 0 numbers in vertex, expected 3"),
        (b"1 2 3\n4 5 6\njunk\n", "text after its last row"),
        (b"1 2 3\n4 5 6\n7 8 9\n", "text after its last row"),
        (b"1 2 3\n\n\n\n\n\n\n", "a line of 0 numbers"),
        (b"1 2 3\n4 5", "truncated: 9 bytes of numbers, expected 11 or more"),
        (b"1 2 nan\n4 5 6\n", "NaN or infinite"),
        (b"1 2 3\n4 5 -Infinity\n", "NaN or infinite"),
        (b"1 2 3\n4 5 1e39\n", "NaN or infinite"),
        (b"1 2 3\n" + b" " * 600_000, "a line of more than 262,144 bytes"),
    ],
)  # fmt: skip
def test_text_is_read_strictly(tmp_path: Path, body: bytes, says: str):
    path = cloud(tmp_path, header(2) + body)
    with pytest.raises(Avs3dError, match=says) as caught:
        read_points(path)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "body",
    [
        b"1 -2.5 3e-1\n4 5. .5\n",
        b"1 -2.5 3e-1\r\n4 5. .5\r\n",
        b"  1\t-2.5  0.3 \n4 +5 .5\n".replace(b"+5", b"5E+00"),
        b"1 -2.5 .3\n4 5 .5",
        b"1 -2.5 .3\n4 5 .5\n\n \n",
    ],
)
def test_text_as_programs_write_it(tmp_path: Path, body: bytes):
    expected = np.array([[1, -2.5, 0.3], [4, 5, 0.5]], np.float32)
    np.testing.assert_array_equal(read_points(cloud(tmp_path, header(2) + body)), expected)


def test_text_is_read_in_blocks_without_much_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    points = np.random.default_rng(0).normal(size=(30_000, 3)).astype(np.float32)
    path = cloud(tmp_path, header(30_000) + "".join(f"{x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in points).encode())
    monkeypatch.setattr(ply_reader, "_BLOCK", 2**14)
    tracemalloc.start()
    found = read_points(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_array_equal(found, points)
    assert peak < 3 * path.stat().st_size, "the words of a whole file are some twenty times its size"


def test_integers_are_of_their_type(tmp_path: Path):
    properties = XYZ + "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    assert read_ply(cloud(tmp_path, header(1, properties) + b"1 2 3 255 0 7\n")).colours.tolist() == [[255, 0, 7]]
    for value in (b"256", b"-1", b"0.5", b"nan"):
        with pytest.raises(Avs3dError, match=r"vertex\.blue holds .*; expected integers from 0 to 255"):
            read_ply(cloud(tmp_path, header(1, properties) + b"1 2 3 255 0 " + value + b"\n"))


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (header(10**6) + b"1 2 3\n", "truncated: 6 bytes of numbers, expected 5,999,999 or more"),
        (header(10**6, form="binary_little_endian") + bytes(12), "truncated: .* bytes, expected 12,000,1"),
        (header(1, form="binary_little_endian") + bytes(13), "more than its header announces"),
        (header(1, more="element big 99999999999\n") + b"1 2 3\n", "PLY element big without properties"),
        (header(1, more="element big 9999999999\nproperty float a\n") + b"1 2 3\n", "truncated: 6 bytes of numbers"),
        (header(1, more="element vertex 1\n") + b"1 2 3\n", "'element vertex 1' is not understood"),
        (header(1).replace(b"vertex 1", b"vertex 1_0"), "'element vertex 1_0' is not understood"),
        (header(1).replace(b"vertex 1", b"vertex +1"), r"'element vertex \+1' is not understood"),
        (header(1).replace(b"float x", b"float x y"), "'property float x y' is not understood"),
        (header(1).replace(b"element", b"property float a\nelement", 1), "'property float a' is not understood"),
        (header(1, "property list float float x\nproperty float y\nproperty float z\n"), "list float float x' is not"),
    ],
)  # fmt: skip
def test_the_header_is_held_against_the_size_before_anything_is_read(
    tmp_path: Path, data: bytes, says: str, monkeypatch: pytest.MonkeyPatch
):
    path = cloud(tmp_path, data)

    def refuse(*_: object) -> None:
        raise AssertionError("the body was read")

    monkeypatch.setattr(ply_reader, "_ascii", refuse)
    monkeypatch.setattr(ply_reader, "_binary", refuse)
    with pytest.raises(Avs3dError, match=says):
        read_points(path)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_faces_are_lists_of_integers(tmp_path: Path, form: str):
    for declared in ("property int vertex_indices", "property list uchar float vertex_indices"):
        data = header(1, form=form, more=f"element face 1\n{declared}\n") + b"1 2 3\n1 0 0 0\n" + bytes(40)
        with pytest.raises(Avs3dError, match=r"face\.vertex_indices is no list of integers"):
            read_ply(cloud(tmp_path, data))


@pytest.mark.parametrize("line", ["comment end_header", "obj_info end_header", "comment  end_header ", "comment ascii"])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_a_comment_may_say_end_header(tmp_path: Path, line: str, form: str):
    body = b"1 2 3\n" if form == "ascii" else struct.pack("<3f", 1, 2, 3)
    data = header(1, form=form).replace(b"element", f"{line}\nelement".encode(), 1) + body
    assert read_points(cloud(tmp_path, data)).tolist() == [[1, 2, 3]]
    assert read_header(tmp_path / "points.ply").form == form


def test_a_large_binary_file_with_the_word_ascii_is_no_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(predictions, "MAX_ASCII_BYTES", 10)
    write_ply_points(tmp_path / "b.ply", [[1, 2, 3]])
    data = (tmp_path / "b.ply").read_bytes().replace(b"element", b"comment not ascii\nelement", 1)
    assert len(read_points(cloud(tmp_path, data))) == 1


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_coordinates_as_lists_are_refused_by_check_and_score_alike(tmp_path: Path, form: str):
    data = tiny.write_dataset(tmp_path / "tiny", frames=9)
    root = submit(tmp_path / "s", data, true_mask, points=lambda observation: observation.mesh().vertices)
    body = b"3 1 2 3 3 1 2 3 3 1 2 3\n" if form == "ascii" else (b"\3" + struct.pack("<3f", 1, 2, 3)) * 3
    path = f"{tiny.SINGLE}/points.ply"
    (root / path).write_bytes(header(1, LISTS, form) + body)
    said = [p for p in check_submission(root, data, workers=1).problems if p.severity == "error"]
    with pytest.raises(InvalidSubmission) as caught:
        evaluate(root, data, workers=1)
    assert [(p.path, p.message) for p in said] == [(path, "vertex.x is a list; expected a number per vertex")]
    assert [p for p in caught.value.report.problems if p.severity == "error"] == said
