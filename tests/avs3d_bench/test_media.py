"""Files: the same bytes on every run, readable by other libraries, never partial; broken ones are named."""

from __future__ import annotations

import errno
import itertools
import json
import os
import socket
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files, media
from tests.support import mutants

rng = np.random.default_rng(0)
RGB = rng.integers(0, 256, (24, 32, 3)).astype(np.uint8)
MASK = rng.random((24, 32)) > 0.5
CLIP = (0.1 * rng.normal(size=(2, 4410))).astype(np.float32)
TRIANGLE = (np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]]), np.array([[0, 1, 2]]))

WRITERS: dict[str, Callable[[Path], None]] = {
    "rgb.png": lambda p: media.write_png_rgb(p, RGB),
    "mask.png": lambda p: media.write_png_mask(p, MASK),
    "ids.png": lambda p: media.write_png_ids(p, MASK * 300),
    "depth.png": lambda p: media.write_png_depth_mm(p, MASK * 1.5),
    "clip.wav": lambda p: media.write_wav(p, CLIP),
    "pcm.wav": lambda p: media.write_wav(p, CLIP, subtype="pcm16"),
    "rir.npz": lambda p: media.write_rir(p, CLIP),
    "mesh.ply": lambda p: media.write_ply_mesh(p, *TRIANGLE),
    "points.ply": lambda p: media.write_ply_points(p, TRIANGLE[0], np.eye(3, dtype=np.uint8)),
    "data.json": lambda p: media.write_json(p, {"b": [1 / 3, -0.0], "a": np.float32(0.1)}),
}
READERS: dict[str, Callable[[Path], Any]] = {
    "rgb.png": media.read_png_rgb,
    "mask.png": media.read_png_mask,
    "ids.png": media.read_png_ids,
    "depth.png": media.read_png_depth,
    "clip.wav": media.read_wav,
    "pcm.wav": media.read_wav,
    "rir.npz": media.read_rir,
    "mesh.ply": media.read_ply,
    "points.ply": media.read_ply,
    "data.json": media.read_json,
}


@pytest.mark.parametrize("name", WRITERS)
def test_same_bytes_at_another_time(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch):
    WRITERS[name](tmp_path / "a" / name)
    moment = time.time() + 1e6
    monkeypatch.setattr(time, "time", lambda: moment)
    if name.endswith(".wav"):
        time.sleep(1.1)  # libsndfile's PEAK chunk, were there one, would take the time from C, in seconds
    WRITERS[name](tmp_path / "b" / name)
    assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert [p.name for p in (tmp_path / "a").iterdir()] == [name]  # no temporary file stays


@settings(max_examples=30)
@given(hnp.arrays(np.uint8, st.tuples(st.integers(1, 40), st.integers(1, 40), st.just(3))))
def test_rgb_round_trip(tmp_path_factory: pytest.TempPathFactory, pixels: Any):
    path = tmp_path_factory.getbasetemp() / "rgb.png"
    media.write_png_rgb(path, pixels)
    np.testing.assert_array_equal(media.read_png_rgb(path), pixels)


@settings(max_examples=30)
@given(hnp.arrays(np.uint16, st.tuples(st.integers(1, 40), st.integers(1, 40))))
def test_ids_round_trip_in_the_fewest_bits(tmp_path_factory: pytest.TempPathFactory, ids: Any):
    path = tmp_path_factory.getbasetemp() / "ids.png"
    media.write_png_ids(path, ids)
    np.testing.assert_array_equal(media.read_png_ids(path), ids)
    assert media.png_header(path).bits == (8 if ids.max() < 256 else 16)


def test_pictures_are_what_another_library_reads(tmp_path: Path):
    image = pytest.importorskip("PIL.Image", reason="pillow comes with the extra 'generate'")
    for name in ("rgb.png", "mask.png", "depth.png"):
        WRITERS[name](tmp_path / name)
    with image.open(tmp_path / "rgb.png") as picture:
        assert picture.mode == "RGB"
        np.testing.assert_array_equal(np.asarray(picture), RGB)
    with image.open(tmp_path / "mask.png") as picture:
        assert picture.mode == "L"
        np.testing.assert_array_equal(np.asarray(picture), MASK * 255)
    with image.open(tmp_path / "depth.png") as picture:
        np.testing.assert_array_equal(np.asarray(picture), MASK * 1500)


def test_depth_is_millimetres_and_zero_where_nothing_was_met(tmp_path: Path):
    depth = np.array([[0.0, 1.2344, 1.2346, np.nan, np.inf, -1.0, 65.535, 65.6, 4e-4]])
    media.write_png_depth_mm(tmp_path / "d.png", depth)
    expected = np.array([[0, 1.234, 1.235, 0, 0, 0, 65.535, 0, 0]], dtype=np.float32)
    np.testing.assert_allclose(media.read_png_depth(tmp_path / "d.png"), expected, rtol=1e-6)


def test_sound_keeps_every_bit_and_channel_0_is_left(tmp_path: Path):
    WRITERS["clip.wav"](tmp_path / "clip.wav")
    samples, rate = soundfile.read(tmp_path / "clip.wav", dtype="float32")
    assert rate == 44100
    np.testing.assert_array_equal(samples[:, 0], CLIP[0])
    np.testing.assert_array_equal(media.read_wav(tmp_path / "clip.wav").samples, CLIP)
    header = media.wav_header(tmp_path / "clip.wav")
    assert (header.rate, header.channels, header.samples, header.subtype) == (44100, 2, 4410, "FLOAT")
    assert b"PEAK" not in (tmp_path / "clip.wav").read_bytes()[:100]


def test_16_bit_sound_is_rounded_to_half_a_step(tmp_path: Path):
    WRITERS["pcm.wav"](tmp_path / "pcm.wav")
    clip = media.read_wav(tmp_path / "pcm.wav")
    assert np.abs(clip.samples - CLIP).max() <= 0.5 / 32768 + 1e-7
    with pytest.raises(Avs3dError, match=r"peak 1\.500 clips in 16 bits"):
        media.write_wav(tmp_path / "loud.wav", [[1.5, 0.0]], subtype="pcm16")
    assert not (tmp_path / "loud.wav").exists()


def test_mono_may_be_a_plain_row(tmp_path: Path):
    media.write_wav(tmp_path / "m.wav", CLIP[0])
    assert media.read_wav(tmp_path / "m.wav").samples.shape == (1, 4410)


def test_meshes_are_what_another_library_reads(tmp_path: Path):
    trimesh = pytest.importorskip("trimesh", reason="trimesh comes with the extra 'generate'")
    vertices, faces = rng.normal(size=(50, 3)), rng.integers(0, 50, (80, 3))
    media.write_ply_mesh(tmp_path / "m.ply", vertices, faces, rng.integers(0, 256, (50, 3)).astype(np.uint8))
    there = trimesh.load(tmp_path / "m.ply", process=False)
    np.testing.assert_array_equal(there.faces, faces)
    np.testing.assert_array_equal(there.vertices, vertices.astype(np.float32))
    for encoding in ("ascii", "binary"):
        there.export(tmp_path / "there.ply", encoding=encoding)
        back = media.read_ply(tmp_path / "there.ply")
        np.testing.assert_array_equal(back.faces, faces)
        np.testing.assert_allclose(back.vertices, vertices, atol=1e-6)
        assert back.colours is not None


def test_ply_of_either_byte_order_with_foreign_properties(tmp_path: Path):
    names = ["x", "y", "z", "opacity"]
    table = np.array([(1, 2, 3, 0.5), (4, 5, 6, 0.25)], dtype=[(n, ">f8") for n in names])
    head = "ply\nformat binary_big_endian 1.0\ncomment by hand\nelement vertex 2\n"
    head += "".join(f"property double {n}\n" for n in names) + "end_header\n"
    (tmp_path / "p.ply").write_bytes(head.encode() + table.tobytes())
    ply = media.read_ply(tmp_path / "p.ply")
    assert ply.vertices.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert ply.faces.shape == (0, 3)
    assert ply.colours is None


def test_quads_are_refused(tmp_path: Path):
    head = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "q.ply").write_bytes(head + b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n")
    with pytest.raises(Avs3dError, match="triangulate"):
        media.read_ply(tmp_path / "q.ply")


def test_json_is_stable_and_finite(tmp_path: Path):
    WRITERS["data.json"](tmp_path / "data.json")
    assert (tmp_path / "data.json").read_text() == '{"a": 0.100000001, "b": [0.333333333, 0.0]}\n'
    for bad in (float("nan"), [float("inf")], {"x": {1, 2}}):
        with pytest.raises(Avs3dError, match="JSON cannot hold"):
            media.dump_json(bad)


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.text(max_size=30),
        lambda inner: st.lists(inner, max_size=30) | st.dictionaries(st.text(max_size=9), inner, max_size=9),
    )
)
def test_json_holds_what_went_in(value: Any):
    text = media.dump_json(value)
    assert json.loads(text) == value
    assert media.dump_json(json.loads(text)) == text


@pytest.mark.parametrize("name", READERS)
def test_missing_and_truncated_files_are_named(tmp_path: Path, name: str):
    path = tmp_path / name
    with pytest.raises(Avs3dError, match=f"{name}: missing"):
        READERS[name](path)
    WRITERS[name](path)
    whole = path.read_bytes()
    for size in (0, 5, len(whole) // 2, len(whole) - 2):
        path.write_bytes(whole[:size])
        with pytest.raises(Avs3dError) as caught:
            READERS[name](path)
        assert str(caught.value).startswith(f"{path}: ")
        assert "\n" not in str(caught.value)


def test_a_flipped_bit_in_a_picture_is_found(tmp_path: Path):
    path = tmp_path / "rgb.png"
    WRITERS["rgb.png"](path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)
    with pytest.raises(Avs3dError, match="checksum"):
        media.read_png_rgb(path)


@pytest.mark.parametrize(
    ("written", "read", "says"),
    [
        ("mask.png", media.read_png_rgb, "grey, 8 bit, expected RGB"),
        ("rgb.png", media.read_png_mask, "coloured"),
        ("depth.png", media.read_png_mask, "expected a mask"),
        ("rgb.png", media.read_png_ids, "RGB, 8 bit, expected instance ids"),
        ("mask.png", media.read_png_depth, "expected depth"),
        ("rgb.png", media.read_wav, "not a WAV"),
        ("clip.wav", media.read_png_rgb, "not a PNG"),
        ("clip.wav", media.read_ply, "not a PLY"),
    ],
)
def test_a_wrong_kind_of_file_is_named(tmp_path: Path, written: str, read: Any, says: str):
    WRITERS[written](tmp_path / written)
    with pytest.raises(Avs3dError, match=says):
        read(tmp_path / written)


def test_masks_hold_0_and_255_only(tmp_path: Path):
    path = tmp_path / "m.png"
    cv2.imwrite(str(path), np.array([[0, 255, 128, 1]], dtype=np.uint8))
    with pytest.raises(Avs3dError, match=r"2 mask pixels are neither 0 nor 255 \(found 1, 128\)"):
        media.read_png_mask(path)
    cv2.imwrite(str(path), np.repeat(np.array([[[0], [255]]], dtype=np.uint8), 3, axis=2))
    assert media.read_png_mask(path).tolist() == [[False, True]]  # some tools save masks as RGB


@pytest.mark.parametrize(
    ("write", "says"),
    [
        (lambda p: media.write_png_rgb(p, RGB.astype(float)), "float64, expected uint8"),
        (lambda p: media.write_png_rgb(p, RGB[..., :2]), "expected"),
        (lambda p: media.write_png_ids(p, np.array([[-1]])), "0 to 65535"),
        (lambda p: media.write_png_ids(p, np.array([[70000]])), "0 to 65535"),
        (lambda p: media.write_wav(p, [[np.nan, 0]]), "1 samples are NaN"),
        (lambda p: media.write_wav(p, np.zeros((2, 0))), "shape"),
        (lambda p: media.write_rir(p, np.full((2, 3), np.inf)), "finite"),
        (lambda p: media.write_ply_mesh(p, [[0, 0, np.nan]], [[0, 0, 0]]), "NaN"),
        (lambda p: media.write_ply_mesh(p, [[0, 0, 0]], [[0, 0, 1]]), "vertex 1 of 1"),
    ],
)
def test_bad_data_is_refused_and_leaves_nothing(tmp_path: Path, write: Any, says: str):
    with pytest.raises(Avs3dError, match=says):
        write(tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("code", "says"),
    [
        (errno.ENOSPC, "cannot write: no space left on device; free some space"),
        (errno.EROFS, "read-only file system; choose a folder"),
        (errno.EACCES, "permission denied; choose another folder"),
    ],
)
def test_what_the_system_refuses_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, says: str
):
    path = tmp_path / "clip.wav"
    path.write_bytes(b"old")

    def refuse(*_: object, **__: object) -> None:
        raise OSError(code, __import__("os").strerror(code))

    monkeypatch.setattr(files.os, "replace", refuse)
    with pytest.raises(Avs3dError, match=says) as caught:
        WRITERS["clip.wav"](path)
    assert str(caught.value).startswith(f"{path}: ")
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["clip.wav"]


def test_a_write_cut_short_leaves_nothing(tmp_path: Path):
    """A real limit of the system (RLIMIT_FSIZE) ends the write in the middle."""
    code = (
        "import resource, sys; from avs3d_bench import media; from avs3d_bench.errors import Avs3dError\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "try: media.write_bytes(sys.argv[1], bytes(5000))\n"
        "except Avs3dError as error: print(error)\n"
    )
    path = tmp_path / "big.bin"
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True)
    assert done.stdout.startswith(f"{path}: cannot write: file too large")
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_way_of_a_folder_is_named(tmp_path: Path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(Avs3dError, match="cannot write"):
        media.write_bytes(tmp_path / "file" / "below.bin", b"x")


def test_hard_links_share_their_bytes(tmp_path: Path):
    WRITERS["rgb.png"](tmp_path / "input" / "a.png")
    media.link_or_copy(tmp_path / "input" / "a.png", tmp_path / "images" / "a.png")
    assert (tmp_path / "images" / "a.png").samefile(tmp_path / "input" / "a.png")


def test_the_writers_follow_the_umask(tmp_path: Path):
    (tmp_path / "plain").write_text("")
    media.write_bytes(tmp_path / "ours", b"")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_only_regular_files_are_opened(tmp_path: Path) -> None:
    """A FIFO would wait for a writer for ever."""
    os.mkfifo(tmp_path / "fifo")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket"))
        for path, what in (
            (tmp_path / "fifo", "a FIFO"),
            (tmp_path / "socket", "a socket"),
            (tmp_path, "a folder"),
            (Path("/dev/zero"), "a device"),
        ):
            for read in (media.read_bytes, media.sha256_file, media.png_header):
                with pytest.raises(Avs3dError, match=f"{what}; expected a regular file"):
                    read(path)
    with pytest.raises(Avs3dError, match="null"):
        media.read_bytes("a\0b")


def filtered(pixels: np.ndarray, kinds: list[int], pieces: int = 1) -> bytes:
    """A PNG of 8-bit grey pixels whose rows have these filters, written as the recommendation (9.2) has it."""
    height, width = pixels.shape
    rows = bytearray()
    above = [0] * width
    for row, kind in zip(pixels.tolist(), kinds, strict=True):
        rows.append(kind)
        for x, value in enumerate(row):
            a, b, c = (row[x - 1] if x else 0), above[x], (above[x - 1] if x else 0)
            nearest = min((a, b, c), key=lambda one: abs(a + b - c - one))  # of equals the first
            rows.append((value - (0, a, b, (a + b) // 2, nearest)[kind]) % 256)
        above = row
    data = zlib.compress(bytes(rows))
    at = [len(data) * piece // pieces for piece in range(pieces + 1)]
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    body = [(b"IDAT", data[low:high]) for low, high in itertools.pairwise(at)]
    return mutants.png([(b"IHDR", header), *body, (b"IEND", b"")])


@pytest.mark.parametrize("values", ["mask", "class ids", "grey"])
@pytest.mark.parametrize("kind", [0, 1, 2, 3, 4, None], ids=["none", "sub", "up", "average", "paeth", "mixed"])
def test_a_submitted_picture_is_what_opencv_decodes(
    tmp_path: Path, values: str, kind: int | None, monkeypatch: pytest.MonkeyPatch
):
    """Its data is inflated once, for the integrity check, and its filters are undone here; OpenCV is the witness."""
    monkeypatch.setattr(media, "_INFLATED", 500)  # several blocks
    draws = np.random.default_rng(3)
    for number in range(10):
        height, width = (int(n) for n in draws.integers(1, 60, 2))
        if values == "grey":
            pixels = draws.integers(0, 256, (height, width))
        else:
            smooth = cv2.GaussianBlur(draws.normal(size=(height, width)), (0, 0), 1 + number)
            pixels = (smooth > 0) * (255 if values == "mask" else 7)
        kinds = [int(draws.integers(0, 5)) if kind is None else kind for _ in range(height)]
        path = tmp_path / f"{number}.png"
        path.write_bytes(filtered(pixels, kinds, pieces=1 + number % 3))
        found = media.decode_png(path, cv2.IMREAD_UNCHANGED, plain=True)
        np.testing.assert_array_equal(found, pixels)
        np.testing.assert_array_equal(found, cv2.imread(str(path), cv2.IMREAD_UNCHANGED))


def test_rows_with_an_unknown_filter_are_refused(tmp_path: Path):
    good = filtered(np.zeros((4, 5), int), [0] * 4)
    rows = bytearray(zlib.decompress(good[41:-16]))
    rows[6] = 5
    header = struct.pack(">IIBBBBB", 5, 4, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(bytes(rows))), (b"IEND", b"")]
    (tmp_path / "p.png").write_bytes(mutants.png(chunks))
    with pytest.raises(Avs3dError, match="damaged PNG"):
        media.decode_png(tmp_path / "p.png", cv2.IMREAD_UNCHANGED, plain=True)


def test_a_header_larger_than_its_file_takes_no_memory(tmp_path: Path):
    header = struct.pack(">IIBBBBB", 2**31 - 1, 2**31 - 1, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(bytes(100))), (b"IEND", b"")]
    (tmp_path / "p.png").write_bytes(mutants.png(chunks))
    with pytest.raises(Avs3dError, match="100 bytes of pixels, not the"):
        media.decode_png(tmp_path / "p.png", cv2.IMREAD_UNCHANGED, plain=True)


def _header(**changes: int) -> bytes:
    fields = {"width": 5, "height": 4, "bits": 8, "colour": 0, "compression": 0, "filtering": 0, "interlace": 0}
    return struct.pack(">IIBBBBB", *(fields | changes).values())


PIXELS = zlib.compress(bytes(4 * 6))
ODD: dict[str, list[tuple[bytes, bytes]]] = {
    "compression": [(b"IHDR", _header(compression=1)), (b"IDAT", PIXELS)],
    "filtering": [(b"IHDR", _header(filtering=1)), (b"IDAT", PIXELS)],
    "long header": [(b"IHDR", _header() + b"\0"), (b"IDAT", PIXELS)],
    "two headers": [(b"IHDR", _header()), (b"IHDR", _header()), (b"IDAT", PIXELS)],
    "critical": [(b"IHDR", _header()), (b"ABCD", b""), (b"IDAT", PIXELS)],
    "critical after": [(b"IHDR", _header()), (b"IDAT", PIXELS), (b"ABCD", b"")],
    "no name": [(b"IHDR", _header()), (b"a1b2", b""), (b"IDAT", PIXELS)],
    "apart": [(b"IHDR", _header()), (b"IDAT", PIXELS[:5]), (b"tEXt", b"a\0b"), (b"IDAT", PIXELS[5:])],
    "palette": [(b"IHDR", _header()), (b"PLTE", bytes(6)), (b"IDAT", PIXELS)],
    "text": [(b"IHDR", _header()), (b"tEXt", b"a\0b"), (b"IDAT", PIXELS), (b"tEXt", b"a\0b")],
    "gamma": [(b"IHDR", _header()), (b"gAMA", struct.pack(">I", 10_000)), (b"IDAT", PIXELS)],
}


@pytest.mark.parametrize("kind", ODD)
def test_what_opencv_refuses_is_refused(tmp_path: Path, kind: str):
    path = tmp_path / "p.png"
    path.write_bytes(mutants.png([*ODD[kind], (b"IEND", b"")]))
    expected = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert expected is not None or kind not in ("palette", "text", "gamma")
    if expected is None:
        with pytest.raises(Avs3dError, match="damaged PNG"):
            media.decode_png(path, cv2.IMREAD_UNCHANGED, plain=True)
    else:
        np.testing.assert_array_equal(media.decode_png(path, cv2.IMREAD_UNCHANGED, plain=True), expected)
