"""The worker's file and its supervision without habitat-sim: any Python replaces the other interpreter."""

from __future__ import annotations

import ast
import errno
import io
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics
from generators.core.freespace import FreeSpace, Navigable
from generators.core.tone import srgb_decode, srgb_encode
from generators.vision import habitat_worker
from generators.vision.embree import EmbreeBackend
from generators.vision.habitat import HabitatBackend, probe
from generators.vision.habitat_process import (
    GPU_VARIABLE,
    VARIABLE,
    Client,
    WorkerTimeouts,
    find_interpreter,
    graphics_device,
    start,
)
from generators.vision.habitat_worker import Channel, Display
from tests.support.rooms import kitchen

WORKER = Path(habitat_worker.__file__)
#: A habitat_sim that prints wherever it likes and then says its version.
CHATTY = """
import os, sys
print("loading", flush=True)
os.write(1, b"GL renderer: llvmpipe\\n" * 1000)
os.write(2, b"a word of its own\\n")
__version__ = "9.9.9"
"""


def interpreter(folder: Path, *, habitat_sim: str | None = None, shell: str = "") -> str:
    """A program that first does what ``shell`` says, then is this Python with the given source as habitat_sim."""
    modules = folder / "modules"
    modules.mkdir(parents=True, exist_ok=True)
    if habitat_sim is not None:
        (modules / "habitat_sim.py").write_text(habitat_sim)
    path = folder / "python"
    path.write_text(f'#!/bin/sh\n{shell}\nPYTHONPATH="{modules}" exec "{sys.executable}" "$@"\n')
    path.chmod(0o755)
    return str(path)


def hello(interpreter: str) -> dict[str, Any]:
    worker, about = start(interpreter, WorkerTimeouts())
    worker.close()
    return about


def one_line(error: Avs3dError) -> str:
    text = str(error)
    assert "\n" not in text
    return text


# --- the file -------------------------------------------------------------------------------------------------------


def test_the_worker_is_python_3_8_and_needs_numpy_and_habitat_sim_alone() -> None:
    tree = ast.parse(WORKER.read_text(), feature_version=(3, 8))
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            names.add(str(node.module).split(".")[0])
    assert names <= {*sys.stdlib_module_names, "numpy"}
    # Annotations such as list[str] are only text on 3.8 with this.
    assert any(isinstance(node, ast.ImportFrom) and node.module == "__future__" for node in tree.body)
    for node in ast.walk(tree):
        assert not isinstance(node, ast.Match), "3.10"
        methods = {"removeprefix", "removesuffix", "pairwise", "cache"}
        assert not (isinstance(node, ast.Attribute) and node.attr in methods), "3.9"


def test_messages_carry_arrays_as_they_are() -> None:
    stream = io.BytesIO()
    sent = {
        "rgb": np.arange(24, dtype=np.uint8).reshape(2, 4, 3),
        "depth": np.array([[0.25, np.inf]], dtype=np.float32),
        "empty": np.zeros((0, 3), dtype=np.uint16),
        "turned": np.arange(6, dtype=np.int64).reshape(2, 3).T,
    }
    Channel(stream, stream).send({"command": "render", "name": "Küche"}, list(sent.items()))
    stream.seek(0)
    header, arrays = Channel(stream, stream).receive()
    assert header is not None
    assert (header["command"], header["name"]) == ("render", "Küche")
    assert list(arrays) == list(sent)
    for name, array in sent.items():
        assert arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(arrays[name], array)
    assert Channel(io.BytesIO(), io.BytesIO()).receive() == (None, {})


@pytest.mark.parametrize("keep", [2, 10, -1])
def test_a_message_that_breaks_off_is_noticed(keep: int) -> None:
    stream = io.BytesIO()
    Channel(stream, stream).send({"ok": True}, [("ids", np.zeros((4, 4), dtype=np.uint16))])
    with pytest.raises(ValueError, match="broke off"):
        Channel(io.BytesIO(stream.getvalue()[:keep]), stream).receive()


def test_supersampled_pixels_become_the_mean_of_their_light() -> None:
    pixels = np.random.default_rng(3).integers(0, 256, (12, 18, 3), dtype=np.uint8)
    found = Display(3).shrink(pixels)
    light = srgb_decode(pixels / 255.0).reshape(4, 3, 6, 3, 3).mean(axis=(1, 3))
    assert np.abs(found - 255.0 * srgb_encode(light)).max() <= 0.51
    np.testing.assert_array_equal(Display(1).shrink(pixels), pixels)
    flat = np.full((4, 4, 3), 77, dtype=np.uint8)
    assert (Display(2).shrink(flat) == 77).all()


# --- the process ----------------------------------------------------------------------------------------------------


def test_what_habitat_prints_does_not_get_between_the_messages(tmp_path: Path) -> None:
    answer = hello(interpreter(tmp_path, habitat_sim=CHATTY))
    assert answer["version"] == "9.9.9"
    assert answer["python"] == ".".join(map(str, sys.version_info[:3]))


def test_modules_beside_the_worker_are_not_found_by_its_interpreter(tmp_path: Path) -> None:
    source = "import importlib.util\nassert importlib.util.find_spec('kernels') is None\n__version__ = '1'"
    assert hello(interpreter(tmp_path, habitat_sim=source))["version"] == "1"


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda folder: str(folder / "nowhere"), "is not there"),
        (lambda folder: str(folder), "no program"),
        (lambda folder: "/bin/true", "ended with status 0, without a word"),
        (lambda folder: interpreter(folder, habitat_sim="raise ImportError('no libEGL.so.1')"), "no libEGL.so.1"),
        (lambda folder: interpreter(folder, shell="echo version `GLIBC_2.99` >&2; exit 3"), "ended with status 3"),
        (lambda folder: interpreter(folder, shell="echo not found: libbullet >&2; exit 3"), "libbullet"),
        (lambda folder: interpreter(folder, shell="echo hi; exit 0"), "broke off|ended"),
        (lambda folder: interpreter(folder, shell="kill -SEGV $$"), "SIGSEGV"),
    ],
)
def test_an_interpreter_that_will_not_do_is_one_line(tmp_path: Path, make: object, says: str) -> None:
    chosen = make(tmp_path)  # type: ignore[operator]
    with pytest.raises(Avs3dError, match=says) as caught:
        _ = HabitatBackend(chosen).version
    assert chosen in one_line(caught.value)
    assert VARIABLE in str(caught.value), "and what to do"
    ok, text = probe(chosen)
    assert not ok
    assert "\n" not in text


def test_an_interpreter_in_a_folder_that_may_not_be_read_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Looked at by a stand-in, because root may read every folder."""

    def refused(self: Path) -> bool:
        raise PermissionError(errno.EACCES, "Permission denied", str(self))

    monkeypatch.setattr(Path, "is_file", refused)
    chosen = str(tmp_path / "locked/bin/python")
    with pytest.raises(Avs3dError, match=r"cannot be looked at \(Permission denied\)") as caught:
        find_interpreter(chosen)
    assert chosen in one_line(caught.value)
    ok, text = probe(chosen)
    assert not ok
    assert text == str(caught.value)


def test_an_interpreter_without_habitat_sim_says_so(tmp_path: Path) -> None:
    with pytest.raises(Avs3dError, match="No module named 'habitat_sim'"):
        _ = HabitatBackend(interpreter(tmp_path)).version


def test_no_interpreter_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    ok, text = probe()
    assert not ok
    assert VARIABLE in text


def test_an_interpreter_that_hangs_is_given_up(tmp_path: Path) -> None:
    began = time.monotonic()
    with pytest.raises(Avs3dError, match=r"did not answer within 0\.5 s"):
        _ = HabitatBackend(interpreter(tmp_path, shell="exec sleep 60"), WorkerTimeouts(hello=0.5)).version
    assert time.monotonic() - began < 10


def test_the_worker_ends_with_its_parent_even_if_that_is_killed(tmp_path: Path) -> None:
    # Busy for good in the middle of an answer, as in a long frame.
    path = interpreter(tmp_path, habitat_sim="import time\ntime.sleep(600)")
    # What its parent wrote for it is not left behind by either.
    folder = tmp_path / "exported"
    folder.mkdir()
    (folder / "stage.glb").write_bytes(b"large")
    request = {"command": "hello", "folder": str(folder)}
    script = (
        "import sys, threading\nfrom generators.vision.habitat_process import Worker\n"
        f"worker = Worker({path!r})\nprint(worker.pid, flush=True)\nworker.ask({request!r}, 600.0)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    time.sleep(1.0)
    assert alive(worker)
    assert folder.exists()
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 20
    while alive(worker) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not alive(worker)
    assert not folder.exists()


def test_a_client_whose_second_worker_does_not_start_is_closed(tmp_path: Path) -> None:
    path = interpreter(tmp_path, habitat_sim="__version__ = '1'")
    client = Client(path, "the flat", [], WorkerTimeouts(hello=60.0))
    assert client.worker is not None
    os.kill(client.worker.pid, signal.SIGKILL)
    Path(path).write_text("#!/bin/sh\nexit 3\n")
    with pytest.raises(Avs3dError, match="ended with status 3"):
        client.ask({"command": "hello"}, 20.0)
    with pytest.raises(Avs3dError, match="closed for the flat"):
        client.ask({"command": "hello"}, 20.0)
    client.close()


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_worker_ignores_the_terminals_interrupt(tmp_path: Path) -> None:
    worker, _ = start(interpreter(tmp_path, habitat_sim="__version__ = '1'"), WorkerTimeouts())
    try:
        os.kill(worker.pid, signal.SIGINT)
        assert worker.ask({"command": "hello"}, 20.0)[0]["version"] == "1"
    finally:
        worker.close()
    assert not alive(worker.pid)


def test_a_failed_request_is_an_error_and_the_worker_lives_on(tmp_path: Path) -> None:
    worker, _ = start(interpreter(tmp_path, habitat_sim="__version__ = '1'"), WorkerTimeouts())
    try:
        with pytest.raises(Avs3dError, match=r"render.* before any scene was opened"):
            worker.ask({"command": "render"}, 20.0)
        with pytest.raises(Avs3dError, match="SimulatorConfiguration"):
            worker.ask({"command": "open", "width": 8, "height": 8, "supersampling": 1}, 20.0)
        assert worker.ask({"command": "hello"}, 20.0)[0]["ok"]
    finally:
        worker.close()


@pytest.mark.parametrize("value", ["", "x", "-2", "1.5"])
def test_a_device_that_is_no_number_is_refused(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(GPU_VARIABLE, value)
    with pytest.raises(Avs3dError, match=GPU_VARIABLE):
        graphics_device()
    monkeypatch.setenv(GPU_VARIABLE, "2")
    assert graphics_device() == 2


@pytest.mark.parametrize(
    "camera",
    [
        Intrinsics(64, 64, 32, 33, 32, 32),
        Intrinsics(64, 64, 32, 32, 30, 32),
        Intrinsics(64, 48, 32, 32, 32, 32),
        Intrinsics(64, 64, float("nan"), 32, 32, 32),
        Intrinsics(20000, 20000, 1e4, 1e4, 1e4, 1e4),
    ],
)
def test_a_camera_that_habitat_has_no_sensor_for_is_refused(camera: Intrinsics) -> None:
    with pytest.raises(Avs3dError, match="expected fx = fy"):
        HabitatBackend(sys.executable).open(kitchen().scene, camera)


# --- free space within a navigation mesh ----------------------------------------------------------------------------


def test_free_space_is_cut_to_what_is_navigable() -> None:
    space = FreeSpace.of(kitchen().scene, "kitchen")
    asked: list[np.ndarray] = []

    def half(points: np.ndarray) -> np.ndarray:
        asked.append(points)
        return points[:, 0] > 2.0

    navigable: Navigable = half
    cut = space.within(navigable)
    expected = space.points[space.points[:, 0] > 2.0]
    assert 0 < len(expected) < len(space.points)
    np.testing.assert_array_equal(cut.points, expected)
    assert asked[0].shape == (len(space.points), 3)
    assert (asked[0][:, 1] == space.floor).all()
    nothing = cut.within(lambda points: np.zeros(len(points), dtype=bool))
    assert nothing.area == 0
    assert nothing.within(navigable).area == 0


def test_embree_has_no_navigation_mesh() -> None:
    assert EmbreeBackend().navigable(kitchen().scene) is None


def test_what_killed_processes_left_is_swept_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from generators.vision import habitat

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    gone = subprocess.Popen(["true"])
    gone.wait()
    host = socket.gethostname()
    names = [
        f"avs3d-habitat-{host}-{gone.pid}-abc",
        f"avs3d-habitat-{host}-{os.getpid()}-abc",
        "avs3d-habitat-other-1-x",
    ]
    for name in names:
        (tmp_path / name).mkdir()

    class Owner:
        pass

    owner = Owner()
    folder, clean = habitat._folder(owner)
    assert folder.is_dir()
    assert not (tmp_path / names[0]).exists()
    assert (tmp_path / names[1]).exists()
    assert (tmp_path / names[2]).exists()
    clean()
    assert not folder.exists()
