"""`avs3d view` with malicious files and requests: a page or line that names the file, bounded memory, a quick exit."""

from __future__ import annotations

import http.client
import os
import resource
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from avs3d_bench.cli import avs3d
from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.inspector.cli import view
from avs3d_bench.inspector.live import KeptFiles, LiveSite
from avs3d_bench.inspector.server import HEADERS, MOST_CONNECTIONS, ViewServer
from avs3d_bench.inspector.submissions import open_submissions
from avs3d_bench.submission import SubmissionWriter
from tests.support import tiny
from tests.support.browser import launch
from tests.support.shared import SharedDataset
from tests.support.viewing import served

KEY, OTHER = tiny.SINGLE, tiny.MULTI
#: Longest wait for an answer or an end before a test counts it as a hang (s).
HANGS = 20
posix = pytest.mark.skipif(os.name != "posix", reason="FIFOs and signals of POSIX")


@pytest.fixture(scope="module")
def source(shared_dataset: SharedDataset) -> Path:
    return shared_dataset()


@pytest.fixture
def root(source: Path, tmp_path: Path) -> Path:
    """A copy whose files may be replaced."""
    return tiny.clone(source, tmp_path / "copy")


def ask(server: ViewServer, path: str) -> tuple[int, dict[str, str], str]:
    connection = http.client.HTTPConnection("127.0.0.1", port_of(server), timeout=HANGS)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read().decode("utf-8", "replace")
    finally:
        connection.close()


def port_of(server: ViewServer) -> int:
    return int(server.server.server_address[1])


def fifo(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def empty(path: Path) -> None:
    tiny.replace(path, b"")


def submission(root: Path, folder: Path) -> Path:
    """The truth as a submission."""
    with SubmissionWriter(folder, Dataset(root), method="right") as writer:
        for observation in writer.observations:
            for frame in observation.test:
                writer.write_mask(frame, frame.mask())
    return folder


def bomb(side: int) -> bytes:
    """A black grey PNG of ``side``² pixels: small as a file, side² bytes when it is decoded."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packed = zlib.compressobj(1)
    rows = b"".join([packed.compress(bytes(side + 1)) for _ in range(side)] + [packed.flush()])
    head = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


# ---- files that are none, and damaged ones ---------------------------------------------------------------------


@posix
@pytest.mark.parametrize("spoil", [fifo, empty])
@pytest.mark.parametrize("name", ["observation.json", "camera_splits.json"])
def test_a_page_that_cannot_be_made_names_the_file_and_the_gallery_goes_on(
    root: Path, name: str, spoil: Callable[[Path], None]
) -> None:
    spoil(root / KEY / name)
    with served(root) as server:
        status, headers, page = ask(server, f"/{KEY}/")
        assert (status, headers["Content-Type"]) == (422, "text/html; charset=utf-8")
        assert f"<code>{name}</code>" in page
        assert "avs3d validate --deep" in page
        assert str(root) not in page
        status, _, gallery = ask(server, "/")
        assert status == 200
        assert "1 observation cannot be shown" in gallery
        assert f'<a href="{KEY}/index.html">{KEY}</a>: {name}: ' in gallery
        assert f"{OTHER}/thumbnail.webp" in gallery
        assert ask(server, f"/{OTHER}/")[0] == 200


def test_a_mended_observation_is_shown_when_its_page_is_loaded_again(root: Path) -> None:
    splits = (root / KEY / "camera_splits.json").read_bytes()
    tiny.replace(root / KEY / "camera_splits.json", b"[" * 100_000)  # deeper than Python's parser goes
    with served(root) as server:
        assert ask(server, f"/{KEY}/")[0] == 422
        assert "cannot be shown" in ask(server, "/")[2]
        tiny.replace(root / KEY / "camera_splits.json", splits)
        assert ask(server, f"/{KEY}/")[0] == 200
        assert "cannot be shown" not in ask(server, "/")[2]


@posix
def test_no_file_of_an_observation_can_hang_the_server_or_break_it(root: Path) -> None:
    """A FIFO in the place of one file of each kind."""
    pages = {
        f"{layout.COLMAP}/points3D.bin": "floor.png",
        f"{layout.INPUT}/frame_003.png": "frames/frame_003.webp",
        f"{layout.SEMANTIC_MASKS}/frame_003.png": "masks/frame_003.png",
        f"{layout.INSTANCE_MASKS}/frame_003.png": "instances/frame_003.png",
    }
    for name in (*pages, f"{layout.BINAURAL}/frame_3.wav"):
        fifo(root / KEY / name)
    with served(root) as server:
        status, _, page = ask(server, f"/{KEY}/")
        assert status == 200
        assert f"{layout.BINAURAL}/frame_3.wav: a FIFO" in page
        for name, address in pages.items():
            status, headers, line = ask(server, f"/{KEY}/{address}")
            assert (status, headers["Content-Type"]) == (422, "text/plain; charset=utf-8")
            assert line == f"{name}: a FIFO; expected a regular file\n"


def test_what_is_no_picture_is_not_served_as_one(root: Path) -> None:
    tiny.replace(root / KEY / "input/frame_003.png", b"root:x:0:0:")
    with served(root) as server:
        status, _, line = ask(server, f"/{KEY}/full/frame_003.png")
        assert (status, line) == (422, "input/frame_003.png: not a PNG file; expected a PNG picture\n")


@pytest.mark.parametrize("value", [1e300, -1e300])
def test_numbers_beyond_all_bounds_are_a_page_too(root: Path, value: float) -> None:
    def change(record: dict[str, Any]) -> None:
        for frame in record["frames"]:
            frame["rms_left"], frame["position"] = abs(value), [value, 0.0, value]

    tiny.edit_record(root, KEY, change, rehash=False)
    with served(root) as server:
        status, _, page = ask(server, f"/{KEY}/")
        assert status == 422
        assert "validate --deep" in page
        assert ask(server, "/")[0] == 200


def test_a_site_on_disk_has_a_page_for_what_it_cannot_show(root: Path, tmp_path: Path) -> None:
    tiny.replace(root / KEY / "observation.json", b"{")
    result = CliRunner().invoke(view, [str(root), "-o", str(tmp_path / "site"), "--workers", "1"])
    assert result.exit_code == 1
    page = (tmp_path / "site" / KEY / "index.html").read_text()
    assert "<code>observation.json</code>" in page
    assert str(root) not in page


@pytest.mark.slow
def test_the_page_of_a_damaged_observation_leads_on(root: Path) -> None:
    empty(root / KEY / "observation.json")
    with launch() as browser, served(root) as server:
        page = browser.new_page()
        failed: list[str] = []
        page.on("pageerror", lambda error: failed.append(str(error)))
        page.goto(server.url)
        page.click(f"text={KEY}")
        assert page.text_content("h1") == "Cannot be shown"
        assert "observation.json" in page.text_content("#problem")
        page.click("a[rel=next]")
        assert page.url == f"{server.url}{OTHER}/index.html"
        assert not failed


# ---- links out of the dataset ----------------------------------------------------------------------------------


@posix
def test_a_link_out_of_the_dataset_is_refused(root: Path, source: Path) -> None:
    secret = root.parent / "secret.png"
    secret.write_bytes((source / OTHER / "input/frame_001.png").read_bytes())
    frame = root / KEY / "input/frame_003.png"
    frame.unlink()
    frame.symlink_to(secret)
    with served(root) as server:
        for address in ("full/frame_003.png", "frames/frame_003.webp", "index.html", "thumbnail.webp"):
            status, _, body = ask(server, f"/{KEY}/{address}")
            assert status == 422
            assert "input/frame_003.png" in body
            assert "symbolic link that leads out of the dataset" in body
            assert str(root.parent) not in body
        assert "leads out of the dataset" in ask(server, "/")[2]


@posix
@pytest.mark.parametrize("folder", [KEY, f"{KEY}/input", f"{KEY}/sparse", "part_1/tiny"])
def test_so_is_a_folder_that_is_one(root: Path, folder: str) -> None:
    elsewhere = root.parent / "elsewhere"
    (root / folder).rename(elsewhere)
    (root / folder).symlink_to(elsewhere)
    with served(root) as server:
        status, _, page = ask(server, f"/{KEY}/")
        assert status == 422
        assert "leads out of the dataset" in page


@posix
def test_links_within_the_dataset_and_a_root_that_is_one_are_shown(root: Path) -> None:
    frame = root / KEY / "input/frame_003.png"
    frame.rename(root / KEY / "moved.png")
    frame.symlink_to("../moved.png")
    (root.parent / "link").symlink_to(root)
    with served(root.parent / "link") as server:
        assert ask(server, f"/{KEY}/")[0] == 200
        assert ask(server, f"/{KEY}/full/frame_003.png")[0] == 200


# ---- submissions -----------------------------------------------------------------------------------------------


def test_a_mask_of_another_size_is_refused_before_it_is_decoded(root: Path, tmp_path: Path) -> None:
    folder = submission(root, tmp_path / "right")
    # 16,000² bytes when decoded; what keeps the check for the file's size from being the one that finds it.
    side = 16_000
    data = bomb(side)
    mask = folder / KEY / "masks/frame_000.png"
    mask.write_bytes(data)
    shown = open_submissions(Dataset(root), [folder])
    limit = 4 * tiny.SIZE**2 + 65_536
    assert len(data) > limit
    with served(root, shown) as server:
        ask(server, f"/{OTHER}/")
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        status, _, page = ask(server, f"/{KEY}/")
        assert status == 200
        assert f"right: {KEY}/masks/frame_000.png: {len(data):,} bytes, expected at most {limit:,}" in page
        assert ask(server, f"/{KEY}/predictions/1/frame_000.png")[0] == 422
        mask.write_bytes(data[: limit - 100])  # no longer too large as a file
        status, _, line = ask(server, f"/{KEY}/predictions/1/frame_000.png")
        assert status == 422
        assert f"{side}×{side} pixels, expected 64×64, the size of the frame" in line
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < side * side / 1024 / 2


@posix
def test_a_mask_that_is_no_file_or_leads_elsewhere_is_named(root: Path, tmp_path: Path) -> None:
    folder = submission(root, tmp_path / "right")
    fifo(folder / KEY / "masks/frame_000.png")
    other = folder / KEY / "masks/frame_008.png"
    other.rename(tmp_path / "elsewhere.png")
    other.symlink_to(tmp_path / "elsewhere.png")
    with served(root, open_submissions(Dataset(root), [folder])) as server:
        status, _, page = ask(server, f"/{KEY}/")
        assert status == 200
        assert "masks/frame_000.png: no plain file" in page
        assert "masks/frame_008.png: a symbolic link that leads out of the submission" in page
        assert str(tmp_path) not in page


@posix
@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (fifo, "no plain file"),
        (lambda path: path.write_bytes(b" " * (2**20 + 1)), "expected at most 1,048,576"),
        (lambda path: path.write_bytes(b"["), "submission.json"),
    ],
)
def test_a_submission_json_that_is_none_is_one_line(
    root: Path, tmp_path: Path, spoil: Callable[[Path], Any], why: str
) -> None:
    folder = submission(root, tmp_path / "right")
    spoil(folder / layout.SUBMISSION_JSON)
    with pytest.raises(Avs3dError, match=why):
        open_submissions(Dataset(root), [folder])


# ---- requests --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        (b"GET /index.html HTTP/1.1\r\nHost: {host}\r\n\r\n", 200),
        (b"GET /nowhere HTTP/1.1\r\nHost: {host}\r\n\r\n", 404),
        (b"GET /%s/ HTTP/1.1\r\nHost: {host}\r\n\r\n" % OTHER.encode(), 422),
        (b"GET /%s/sound.flac HTTP/1.1\r\nHost: {host}\r\nRange: bytes=999999999-\r\n\r\n" % KEY.encode(), 416),
        (b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n", 403),
        (b"GET / HTTP/1.1\r\n\r\n", 403),
        (b"GET /\r\n\r\n", 403),
        (b"GET / HTTP/0.9\r\n\r\n", 403),
        (b"POST / HTTP/1.1\r\nHost: {host}\r\nContent-Length: 2\r\n\r\nab", 405),
        (b"OPTIONS * HTTP/1.1\r\nHost: {host}\r\n\r\n", 405),
        (b"BREW / HTTP/1.1\r\nHost: {host}\r\n\r\n", 405),
        (b"GET http://[/ HTTP/1.1\r\nHost: {host}\r\n\r\n", 400),
        (b"<img src=x> <b> HTTP/1.1 x\r\n\r\n", 400),
        (b"\x16\x03\x01\x02\r\n\r\n", 400),
        (b"GET / HTTP/9.1\r\n\r\n", 505),
        (b"GET /%s HTTP/1.1\r\n\r\n" % (b"x" * 70_000), 414),
        (b"GET / HTTP/1.1\r\n" + b"".join(b"x-%d: y\r\n" % i for i in range(200)) + b"\r\n", 431),
    ],
)
def test_every_answer_has_the_headers_that_protect_it(root: Path, request_: bytes, status: int) -> None:
    empty(root / OTHER / "observation.json")
    with served(root) as server, socket.create_connection(("127.0.0.1", port_of(server)), HANGS) as connection:
        connection.sendall(request_.replace(b"{host}", f"127.0.0.1:{port_of(server)}".encode()))
        with suppress(OSError):
            connection.shutdown(socket.SHUT_WR)
        answer = b""
        with suppress(ConnectionResetError):  # what was sent is not all read
            while piece := connection.recv(65_536):
                answer += piece
        head, _, body = answer.partition(b"\r\n\r\n")
        lines = head.decode().split("\r\n")
        assert lines[0].split()[1] == str(status)
        for name, value in HEADERS:
            assert f"{name}: {value}" in lines
        assert b"<img src=x>" not in body
        assert {"Content-Security-Policy", "X-Content-Type-Options", "Referrer-Policy", "X-Frame-Options"} <= {
            name for name, _ in HEADERS
        }


# ---- the end ---------------------------------------------------------------------------------------------------


@contextmanager
def running(root: Path, tmp: Path, before: str = "") -> Iterator[tuple[subprocess.Popen[str], int]]:
    """(process, port) of `avs3d view` with a temporary folder of its own, after the statements ``before``."""
    tmp.mkdir(exist_ok=True)
    code = f"{before}\nfrom avs3d_bench.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", code, "view", str(root), "--port", "0", "--no-browser"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1", "TMPDIR": str(tmp)},
    )  # fmt: skip
    try:
        assert process.stdout
        yield process, int(process.stdout.readline().split("127.0.0.1:")[1].split("/")[0])
    finally:
        process.kill()
        process.communicate()


def dial(port: int, data: bytes) -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", port), HANGS)
    connection.sendall(data)
    return connection


def get(port: int, path: str) -> bytes:
    return f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode()


#: A file that takes for ever to make, as one on a disk that does not answer.
STUCK = (
    "import time\nfrom avs3d_bench.inspector.site import ObservationSite\n"
    "ObservationSite.make = lambda self, name: (print('making', flush=True), time.sleep(600))"
)


@pytest.mark.slow
@posix
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_a_signal_ends_it_whatever_its_connections_do(
    source: Path, tmp_path: Path, number: signal.Signals, status: int
) -> None:
    with running(source, tmp_path / "tmp", STUCK) as (process, port):
        idle, half = dial(port, b""), dial(port, b"GET /index.html HTT")
        kept = dial(port, get(port, "/assets/style.css"))
        assert kept.recv(100)
        stuck = dial(port, get(port, f"/{KEY}/frames/frame_000.webp"))
        assert process.stdout
        assert process.stdout.readline() == "making\n"
        going = threading.Event()

        def knock() -> None:
            while not going.is_set():
                with suppress(OSError):
                    dial(port, b"GET ").close()

        knocking = [threading.Thread(target=knock) for _ in range(2)]
        for thread in knocking:
            thread.start()
        try:
            time.sleep(0.2)
            process.send_signal(number)
            process.send_signal(number)  # impatience changes nothing
            # The stuck answer alone would take ten minutes, an idle connection its 60 s.
            assert process.wait(timeout=HANGS) == status
        finally:
            going.set()
            for thread in knocking:
                thread.join()
        assert process.stderr
        assert process.stderr.read().strip() == ""
        for connection in (idle, half, kept, stuck):
            connection.close()
    assert list((tmp_path / "tmp").iterdir()) == []


@posix
def test_a_killed_one_leaves_nothing_behind(source: Path, tmp_path: Path) -> None:
    with running(source, tmp_path / "tmp") as (process, port):
        with dial(port, get(port, f"/{KEY}/thumbnail.webp")) as connection:
            assert connection.recv(100).startswith(b"HTTP/1.1 200")
        process.kill()
        process.wait()
    assert list((tmp_path / "tmp").iterdir()) == []


def test_what_is_kept_comes_back_and_a_full_disk_only_keeps_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = KeptFiles()
    kept.put("a", b"one")
    kept.put("b", b"")
    kept.put("c", b"three")
    assert [kept.get(name) for name in "abcd"] == [b"one", b"", b"three", None]
    kept.close()
    assert kept.get("a") is None

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    none = KeptFiles()
    none.put("a", b"one")
    assert none.get("a") is None


# ---- films and scenes ------------------------------------------------------------------------------------------


@pytest.mark.slow
@posix
@pytest.mark.parametrize("spoil", [fifo, empty])
@pytest.mark.parametrize(
    ("command", "name"),
    [
        *(("video", name) for name in ("observation.json", "camera_splits.json", "input/frame_003.png",
                                       "semantic_masks/frame_003.png", "audio_clips_binaural/frame_3.wav")),
        *(("view-3d", name) for name in ("observation.json", "camera_splits.json", "sparse/0/points3D.bin",
                                         "gt_3d/sounding_object.ply", "input/frame_003.png")),
    ],
)  # fmt: skip
def test_a_film_and_a_scene_of_damaged_files_are_one_line(
    root: Path, tmp_path: Path, command: str, name: str, spoil: Callable[[Path], None]
) -> None:
    pytest.importorskip("av" if command == "video" else "viser", reason="the extra `inspect` is not installed")
    spoil(root / KEY / name)
    target = tmp_path / ("film.mp4" if command == "video" else "scene.html")
    option = "-o" if command == "video" else "--save"
    result = CliRunner().invoke(avs3d, [command, KEY, "--dataset", str(root), option, str(target)])
    assert isinstance(result.exception, Avs3dError), result.output
    assert str(result.exception).startswith(f"{root / KEY / name}: ")
    assert "\n" not in str(result.exception)
    assert not target.exists()
    assert [path.name for path in tmp_path.iterdir()] == [root.name]


# ---- many connections, and slow ones ---------------------------------------------------------------------------


def connections(server: ViewServer, count: int, sent: bytes) -> list[socket.socket]:
    found = []
    for _ in range(count):
        one = socket.create_connection(("127.0.0.1", port_of(server)), timeout=HANGS)
        one.sendall(sent)
        found.append(one)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("sent", [b"", b"GET / HTTP/1.1\r\nHost: 127"])
def test_connections_that_ask_nothing_leave_room_for_those_that_do(source: Path, sent: bytes) -> None:
    """More than the server takes, idle or with half a head: threads stay bounded, and a question is answered."""
    before = threading.active_count()
    with served(source) as server:
        held = connections(server, 2 * MOST_CONNECTIONS, sent)
        assert ask(server, "/")[0] == 200
        assert threading.active_count() <= before + 1 + MOST_CONNECTIONS
        for one in held:
            one.close()


def test_a_connection_that_waits_too_long_is_closed(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One byte now and then keeps no thread: what counts is the time until the head is whole."""
    monkeypatch.setattr("avs3d_bench.inspector.server.WAITING_SECONDS", 0.5)
    with served(source) as server:
        (one,) = connections(server, 1, b"GET / HTTP/1.1\r\n")

        def drip() -> None:
            end = time.monotonic() + HANGS
            while time.monotonic() < end:
                one.sendall(b"X")
                time.sleep(0.05)

        with pytest.raises(ConnectionError):
            drip()
        one.close()


def test_when_all_are_being_answered_a_new_one_is_told(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("avs3d_bench.inspector.server.MOST_CONNECTIONS", 2)
    go, asked = threading.Event(), threading.Semaphore(0)
    read = LiveSite.read

    def wait(self: LiveSite, address: str) -> bytes:
        asked.release()
        assert go.wait(HANGS)
        return read(self, address)

    monkeypatch.setattr(LiveSite, "read", wait)
    with served(source) as server, ThreadPoolExecutor(2) as pool:
        answers = [pool.submit(ask, server, "/") for _ in range(2)]
        for _ in answers:
            assert asked.acquire(timeout=HANGS)
        status, headers, text = ask(server, "/")
        assert (status, text) == (503, "too many connections\n")
        assert dict(HEADERS).items() <= headers.items()
        go.set()
        assert [one.result()[0] for one in answers] == [200, 200]
        assert ask(server, "/")[0] == 200, "there is room again"


def test_parallel_ranges_of_the_sound_are_answered(source: Path) -> None:
    """A player asks for several parts at a time, over connections that stay open."""
    with served(source) as server:
        connection = http.client.HTTPConnection("127.0.0.1", port_of(server), timeout=HANGS)
        connection.request("GET", f"/{KEY}/sound.flac")
        whole = connection.getresponse().read()
        connection.close()

        def parts(start: int) -> bytes:
            kept = http.client.HTTPConnection("127.0.0.1", port_of(server), timeout=HANGS)
            found = b""
            for first in range(start, len(whole), 12 * 4096):
                kept.request("GET", f"/{KEY}/sound.flac", headers={"Range": f"bytes={first}-{first + 4095}"})
                answer = kept.getresponse()
                assert answer.status == 206
                found += answer.read()
            kept.close()
            return found

        with ThreadPoolExecutor(12) as pool:
            found = list(pool.map(parts, range(0, 12 * 4096, 4096)))
        expected = [
            b"".join(whole[first : first + 4096] for first in range(start, len(whole), 12 * 4096))
            for start in range(0, 12 * 4096, 4096)
        ]
        assert found == expected
