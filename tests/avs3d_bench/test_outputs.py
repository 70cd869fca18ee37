"""Output files: devices, FIFOs and open descriptors are written to, links are followed, none of them is replaced."""

from __future__ import annotations

import json
import os
import socket
import stat
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from avs3d_bench.cli import main
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import atomic_path, write_bytes, write_json
from avs3d_bench.formats.media import write_png_mask
from evaluators import cli
from tests.evaluators.test_score import submit, true_mask
from tests.support.shared import SharedDataset


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=9)


def null_device(path: Path) -> Path:
    """A device of our own, so that a failing test destroys no other; the system's where that is not allowed."""
    try:
        os.mknod(path, 0o600 | stat.S_IFCHR, os.makedev(1, 3))
        with path.open("wb"):
            return path
    except OSError:
        if os.geteuid() == 0:
            pytest.skip("no device can be made or opened here, and the system's own must not be risked")
        return Path("/dev/null")


def test_a_device_stays_a_device(tmp_path: Path):
    device = null_device(tmp_path / "null")
    write_bytes(device, b"x" * 100_000)
    with atomic_path(device) as temporary:
        assert temporary.parent != device.parent, "nothing is made beside a device"
        temporary.write_bytes(b"y")
    assert stat.S_ISCHR(device.stat().st_mode)


@pytest.mark.parametrize("command", ["validate", "check", "avs3d-eval"])
def test_a_device_as_output_of_a_command(data: Path, tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]):
    device, submission = null_device(tmp_path / "null"), submit(tmp_path / "s", data, true_mask)
    words = {
        "validate": ["validate", data],
        "check": ["check", submission, "--dataset", data, "--workers", 1],
        "avs3d-eval": [submission, "--dataset", data, "--workers", 1, "--html", device],
    }[command]
    arguments = [*map(str, words), "--json", str(device)]
    with pytest.raises(SystemExit) as end:
        cli.main(arguments) if command == "avs3d-eval" else main(arguments)
    assert end.value.code == 0, capsys.readouterr()
    assert stat.S_ISCHR(device.stat().st_mode)


def test_a_full_device_is_one_line(tmp_path: Path):
    if not Path("/dev/full").exists():
        pytest.skip("the system has no /dev/full")
    with pytest.raises(Avs3dError, match="/dev/full: cannot write: no space left on device; free some space"):
        write_bytes("/dev/full", b"x")
    assert stat.S_ISCHR(os.stat("/dev/full").st_mode)


def test_a_fifo_gets_the_bytes_and_stays(tmp_path: Path):
    fifo, data = tmp_path / "fifo", os.urandom(300_000)  # more than a pipe holds at once
    os.mkfifo(fifo)
    found = []
    reader = threading.Thread(target=lambda: found.append(fifo.read_bytes()), daemon=True)
    reader.start()
    _until_written(lambda: write_bytes(fifo, data))
    reader.join(20)
    assert found == [data]
    assert stat.S_ISFIFO(fifo.stat().st_mode)
    assert [path.name for path in tmp_path.iterdir()] == ["fifo"]


def _until_written(write: Callable[[], None]) -> None:
    """Try again until the reader's thread has opened its end."""
    for _ in range(2000):
        try:
            return write()
        except Avs3dError as error:
            if "nobody reads" not in str(error):
                raise
            threading.Event().wait(0.005)
    raise AssertionError("the reader never came")


def test_a_fifo_that_nobody_reads_is_one_line(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    with pytest.raises(SystemExit) as end:
        main(["validate", str(data), "--json", str(fifo)])
    said = capsys.readouterr()
    assert end.value.code == 1
    assert said.err == f"avs3d: error: {fifo}: cannot write: nobody reads from this FIFO; start its reader first\n"
    assert "0 errors" in said.out, "what was found is printed all the same"
    assert stat.S_ISFIFO(fifo.stat().st_mode)


def test_links_are_followed_and_stay(tmp_path: Path):
    (tmp_path / "real").mkdir()
    target, link, chain = tmp_path / "real" / "a.json", tmp_path / "link.json", tmp_path / "chain.json"
    link.symlink_to("real/a.json")
    chain.symlink_to(link)
    write_json(chain, {"a": 1})  # the link's target is made where it is missing
    assert (chain.is_symlink(), link.is_symlink(), target.is_symlink()) == (True, True, False)
    assert json.loads(target.read_text()) == {"a": 1}
    inode = target.stat().st_ino
    write_json(link, {"a": 2})
    assert json.loads(target.read_text()) == {"a": 2}
    assert target.stat().st_ino != inode, "the target is replaced as a whole"
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a.json", "chain.json", "link.json", "real"]


def test_a_failure_leaves_a_links_target_alone(tmp_path: Path):
    (tmp_path / "a").write_bytes(b"old")
    (tmp_path / "link").symlink_to("a")

    def fail() -> None:
        with atomic_path(tmp_path / "link") as temporary:
            temporary.write_bytes(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert (tmp_path / "link").read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 2


def test_what_cannot_be_written_to_is_one_line(tmp_path: Path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "circle").symlink_to("circle")
    (tmp_path / "link").symlink_to("folder")
    with tempfile.TemporaryDirectory(dir="/tmp") as short, socket.socket(socket.AF_UNIX) as listener:
        listener.bind(f"{short}/s")
        for path, says in [
            (tmp_path / "folder", "found a folder, expected a file"),
            (tmp_path / "link", "found a folder, expected a file"),
            (Path(short, "s"), "found a socket, expected a file"),
            (tmp_path / "circle", "too many levels of symbolic links"),
            (tmp_path / "nul\0", "embedded null (byte|character)"),
        ]:
            with pytest.raises(Avs3dError, match=says) as caught:
                write_bytes(path, b"x")
            assert "\n" not in str(caught.value)
        assert stat.S_ISSOCK(os.stat(f"{short}/s").st_mode)
    with pytest.raises(UsageError, match="found a folder"):
        write_png_mask(tmp_path / "folder", [[1]])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_standard_output_keeps_what_it_holds(tmp_path: Path, name: str):
    """Standard output that is a file has a name of its own, which renaming would take away from it."""
    if not Path(name).exists():
        pytest.skip(f"the system has no {name}")
    code = (
        "from avs3d_bench.formats.files import write_bytes; print('before'); "
        f"write_bytes({name!r}, b'between\\n'); print('after')"
    )
    with (tmp_path / "out").open("wb") as out:
        subprocess.run([sys.executable, "-c", code], stdout=out, check=True)
    assert (tmp_path / "out").read_text() == "before\nbetween\nafter\n"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    piped = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, check=True)
    assert piped.stdout == b"before\nbetween\nafter\n"
