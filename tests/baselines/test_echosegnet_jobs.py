"""EchoSegnet on several workers: kernels compiled once, failures that do not affect other jobs, shared devices."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.file_lock import wait_for_lock
from avs3d_bench.scheduling import gsplat_kernels
from avs3d_bench.scheduling.errors import UnfitError
from avs3d_bench.scheduling.options import Options
from baselines.echosegnet import memory, training_stage
from baselines.echosegnet.densify import DensityControl
from baselines.echosegnet.jobs import run_each, spread
from baselines.echosegnet.pipeline import Settings
from baselines.echosegnet.run import write_echosegnet
from baselines.echosegnet.sources import OracleMasks
from baselines.echosegnet.train import TrainingSettings
from tests.support import gaussian_jobs, tiny

SETTINGS = Settings(training=TrainingSettings(iterations=20, density=DensityControl(pixels_per_gaussian=20)))

#: A package that compiles as gsplat does: without a library it clears the folder of the build, whoever works in it.
_GSPLAT = """
import os, pathlib, shutil, time
folder = pathlib.Path(os.environ["TORCH_EXTENSIONS_DIR"]) / "py311_cu130" / "gsplat_cuda"
folder.mkdir(parents=True, exist_ok=True)
library = folder / "gsplat_cuda.so"
if not library.exists():
    shutil.rmtree(folder)
    folder.mkdir()
    with open(os.environ["BUILDS"], "a") as log:
        log.write(f"{os.getpid()}\\n")
    (folder / "build.ninja").touch()
    time.sleep(1.0)
    (folder / "build.ninja").unlink()  # fails if another process has cleared the folder
    library.touch()
_C = object()
"""


def stand_in(folder: Path, backend: str = _GSPLAT) -> dict[str, str]:
    """The environment of a process that finds a stand-in for gsplat, and an empty cache."""
    (folder / "gsplat/cuda").mkdir(parents=True)
    (folder / "gsplat/__init__.py").write_text("rasterization = None\n")
    (folder / "gsplat/cuda/__init__.py").touch()
    (folder / "gsplat/cuda/_backend.py").write_text(backend)
    path = os.pathsep.join([str(folder), str(Path(__file__).parents[2])])
    own = {"TORCH_EXTENSIONS_DIR": str(folder / "cache"), "BUILDS": str(folder / "builds"), "PYTHONPATH": path}
    return os.environ | own


def test_two_processes_that_begin_with_an_empty_cache_compile_once(tmp_path: Path):
    environment = stand_in(tmp_path)
    load = "from avs3d_bench.scheduling.gsplat_kernels import gsplat; print(gsplat().__name__)"
    pair = [
        subprocess.Popen(
            [sys.executable, "-c", load], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    said = [process.communicate(timeout=120) for process in pair]
    assert [process.returncode for process in pair] == [0, 0], said
    assert [out for out, _ in said] == ["gsplat\n", "gsplat\n"]
    assert len((tmp_path / "builds").read_text().split()) == 1
    assert all(
        line == "waiting for another process to compile gsplat's kernels"
        for _, e in said
        for line in e.split("\n")
        if line
    )


def test_a_compiler_that_fails_is_one_line_and_another_worker_may_try(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    environment = stand_in(tmp_path, "raise RuntimeError('Error building extension\\n nvcc: a long story')")
    monkeypatch.setenv("TORCH_EXTENSIONS_DIR", environment["TORCH_EXTENSIONS_DIR"])
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "gsplat"]:
        monkeypatch.delitem(sys.modules, name)
    gsplat_kernels.gsplat.cache_clear()
    with pytest.raises(UnfitError, match=r"cannot be compiled \(Error building extension nvcc: a long story\)"):
        gsplat_kernels.gsplat()
    gsplat_kernels.gsplat.cache_clear()


def test_a_turn_is_taken_one_after_the_other_and_dies_with_its_process(tmp_path: Path):
    path = tmp_path / "new/folder/lock"
    hold = (
        "import sys, pathlib, time\nfrom avs3d_bench.runtime.file_lock import wait_for_lock\n"
        f"with wait_for_lock(pathlib.Path({str(path)!r})):\n    print('held', flush=True)\n    time.sleep(600)"
    )
    process = subprocess.Popen([sys.executable, "-c", hold], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    said: list[str] = []

    def waiting() -> None:
        said.append("waited")
        process.kill()

    with wait_for_lock(path, waiting):
        said.append("mine")
    process.wait()
    process.stdout.close()
    assert said == ["waited", "mine"]
    (tmp_path / "file").touch()
    with wait_for_lock(tmp_path / "file/below"):  # nothing can be locked there
        pass


# Observations on workers


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.set_num_threads(1)
    return tiny.write_dataset(tmp_path_factory.mktemp("data") / "tiny", frames=9, size=32)


@pytest.mark.slow
def test_what_others_finished_outlives_a_killed_worker_and_a_rerun_takes_it_up(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The one is tried again, on another worker, and named; the other is kept."""
    work = tmp_path / "work"
    masks = gaussian_jobs.DeadlyMasks("sounding", key=tiny.MULTI, folder=tmp_path)
    died = rf"^{tiny.MULTI}: the worker process died of signal 9.*\(tried 2 times\)"
    with pytest.raises(Avs3dError, match=died) as caught:
        write_echosegnet(
            Dataset(data), tmp_path / "s", masks, SETTINGS, work=work, devices=("cpu", "cpu"),
            scheduling=Options(retries=1),
        )  # fmt: skip
    assert f"1 of 2 observations are done and kept in {work}: run the same command again" in str(caught.value)
    assert not (tmp_path / "s").exists()
    made = [path for path in work.rglob("*") if path.is_file() and path.suffix != ".lock"]
    kept = {path: path.stat().st_mtime_ns for path in made}
    assert {path.name.partition("-")[0] for path in kept if tiny.SINGLE in str(path)} == {"gaussians", "votes", "audio"}
    monkeypatch.setattr(training_stage, "train", None)  # both were trained: nothing is trained again
    source = OracleMasks("sounding")
    writer = write_echosegnet(Dataset(data), tmp_path / "s", source, SETTINGS, work=work, devices=("cpu",))
    assert len(list(writer.path.rglob("frame_*.png"))) == 4
    assert all(path.stat().st_mtime_ns == time for path, time in kept.items() if tiny.SINGLE not in str(path))


def test_one_worker_goes_on_after_an_observation_that_failed(data: Path, tmp_path: Path):
    copy = tiny.clone(data, tmp_path / "data")
    (copy / tiny.SINGLE / "audio_clips_binaural/frame_3.wav").unlink()
    with pytest.raises(Avs3dError, match=r"frame_3\.wav: missing.*; 1 of 2 observations are done and kept in"):
        write_echosegnet(
            Dataset(copy), tmp_path / "s", OracleMasks("sounding"), SETTINGS,
            work=tmp_path / "work", devices=("cpu",),
        )  # fmt: skip
    assert list((tmp_path / "work" / tiny.MULTI).glob("votes-*"))


@pytest.mark.slow
def test_a_device_that_is_named_twice_works_on_two_observations_at_a_time(tmp_path: Path):
    (tmp_path / "begun").mkdir()
    devices = spread(("cpu", "cpu"), 2)
    jobs = [gaussian_jobs.Meeting(key, tmp_path / "begun", devices) for key in ("one", "two")]
    outcome = run_each(gaussian_jobs.meet, jobs, devices)
    assert not outcome.failed
    assert sorted(outcome.values) == [("cpu", 0), ("cpu", 1)]


def test_workers_are_spread_over_devices_before_any_is_shared():
    twice = ("cuda:0", "cuda:0", "cuda:1", "cuda:1")
    assert spread(twice, 12) == ("cuda:0", "cuda:1", "cuda:0", "cuda:1")
    assert spread(twice, 2) == ("cuda:0", "cuda:1")
    assert spread(("cuda:1",), 5) == ("cuda:1",)


def test_trainings_that_share_a_device_share_its_memory(monkeypatch: pytest.MonkeyPatch):
    asked: list[tuple[float, str]] = []
    monkeypatch.setattr(memory, "_PARTS", {})
    monkeypatch.setattr(
        torch.cuda, "set_per_process_memory_fraction", lambda share, device: asked.append((share, str(device)))
    )
    memory.share_device(torch.device("cuda:1"), 3)
    memory.share_device(torch.device("cpu"), 3)
    assert asked == [(pytest.approx(1 / 3), "cuda:1")]


def test_a_cap_changes_what_is_trained_and_is_said(data: Path, tmp_path: Path):
    capped = replace(SETTINGS, training=replace(SETTINGS.training, density=DensityControl(max_gaussians=500)))
    writer = write_echosegnet(
        Dataset(data), tmp_path / "s", OracleMasks("sounding"), capped, work=tmp_path / "work",
        devices=("cpu",), only=["part_1/*"],
    )  # fmt: skip
    runtime = writer.record.runtime
    assert isinstance(runtime, dict)
    assert (runtime["max_gaussians"], runtime["stopped_by_memory"]) == (500, 0)
    assert runtime["gaussians"] <= 500
