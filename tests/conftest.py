"""Fixtures and settings of all tests."""

from __future__ import annotations

import gc
import os
import shutil
import signal
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from tests.support import once, tiny, tiny_scenes
from tests.support.shared import SharedDatasets

if TYPE_CHECKING:
    from tests.support.library_server import Server

# A slow machine is no failure of a test, and the same sources pass or fail in the same way on every machine.
# `pytest --hypothesis-profile explore` draws other examples each time.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None)
settings.load_profile("repeatable")


# Nothing that is collected, thousands of tests and all modules, is garbage before the end: to go over it again and
# again takes a quarter of the time of the collection, and part of that of the tests.
gc.disable()

#: Marker → files whose tests all have it. Those that take the fixture ``browser`` are marked ``browser``.
MARKED = {
    "engine": {"test_habitat", "test_habitat_worker", "test_soundspaces"},
    "cluster": {"test_cluster", "test_cluster_tls"},
    "gpu": {"test_core_cuda", "test_cuda_compile", "test_cuda_vision", "test_device_rays", "test_tracer_cuda"},
}


#: Files whose runs on one worker have no process of their own. What a process is for, others test (test_generate).
HERE = {
    "test_distractors", "test_generate_shards", "test_generation", "test_library_generate", "test_motion",
    "test_moving_together", "test_output_options", "test_part_3", "test_receivers_run", "test_regenerate",
    "test_remake", "test_scan_command", "test_sealed_attacks", "test_sealed_run", "test_splats_scan", "test_sweep",
    "test_takes", "test_top_view", "test_variants",
}  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests by what they need, so that `pytest -m "not browser"` leaves them out."""
    for item in items:
        for name in (name for name, files in MARKED.items() if item.path.stem in files):
            item.add_marker(name)
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker("browser")


def pytest_collection_finish() -> None:
    """Collect garbage from now on, but not among what is there already."""
    gc.freeze()
    gc.enable()


def pytest_configure(config: pytest.Config) -> None:
    """Let the programs that tests start hear Ctrl-C; make the folder of what is made once for all processes.

    A worker of pytest-xdist ignores SIGINT, and a program that is started by it would inherit that.
    """
    if hasattr(config, "workerinput"):
        signal.signal(signal.SIGINT, signal.default_int_handler)
    else:
        folder = tempfile.mkdtemp(prefix="avs3d-tests-", dir=os.environ.get("PYTEST_DEBUG_TEMPROOT"))
        os.environ[once.FOLDER] = folder
        config.add_cleanup(partial(shutil.rmtree, folder, ignore_errors=True))


@pytest.fixture(scope="module", autouse=True)
def _here(request: pytest.FixtureRequest) -> Iterator[None]:
    """Runs of the files `HERE`."""
    if request.path.stem not in HERE:
        yield
        return
    from tests.support.here import generated_here

    with generated_here():
        yield


@pytest.fixture(scope="session")
def shared_dataset(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SharedDatasets]:
    """Datasets of part_1 and part_2 that tests only read: ``shared_dataset(frames=9)``."""
    made = SharedDatasets(tiny.write_dataset, partial(tmp_path_factory.mktemp, "shared"))
    yield made
    made.check()


@pytest.fixture(scope="session")
def shared_part_3(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SharedDatasets]:
    """Datasets of part_3 that tests only read: ``shared_part_3(stems=True)``."""
    made = SharedDatasets(tiny_scenes.write_part_3, partial(tmp_path_factory.mktemp, "shared"))
    yield made
    made.check()


@pytest.fixture(scope="module")
def library_server() -> Iterator[Server]:
    """A service that libraries of objects and sounds are fetched from, for the tests of a file."""
    from tests.support.library_server import serving

    with serving() as server:
        yield server


@pytest.fixture
def github_server(library_server: Server, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Server:
    """The service in GitHub's place, without routes, and an empty store of assets."""
    library_server.routes.clear()
    monkeypatch.setenv("AVS3D_GITHUB_URL", library_server.url)
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    return library_server
