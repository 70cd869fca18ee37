"""The stopwatch of `make bench` fits the generator that it measures."""

from __future__ import annotations

import math
import os
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from benchmarks import bench_acoustics
from benchmarks.bench_pipeline import timed_engines
from benchmarks.dataset_report import facts
from benchmarks.frame_time import HERE, compared, measure
from generators.observation import prepare
from generators.observation.generate import generate_observation
from generators.options import GenerateOptions
from generators.plan import make_plans, read_manifest
from tests.support import tiny
from tests.support.homes import write_manifest


@pytest.mark.slow
def test_the_engines_inside_an_observation_are_timed_and_then_left_alone(tmp_path: Path) -> None:
    plan = make_plans(
        read_manifest(write_manifest(tmp_path)), GenerateOptions(only=["part_1/*"], frames=8, audio="analytic")
    )[0]
    spent: dict[str, float] = defaultdict(float)
    frames: list[int] = []
    with timed_engines(spent):
        assert prepare.vision_backend.__name__ == "made"
        generate_observation(plan, tmp_path / "data", tmp_path / "cache", frames.append)
    assert frames == list(range(8))
    assert set(spent) == {"render", "impulse response", "convolve", "encode"}
    assert all(seconds > 0 for seconds in spent.values())
    assert prepare.vision_backend.__name__ == "vision_backend"


def test_the_level_of_a_dataset_is_that_of_its_energy(tmp_path: Path) -> None:
    record = Dataset(tiny.write_dataset(tmp_path / "data"))[tiny.SINGLE].record
    assert record is not None
    loud = [{"rms_left": 0.1, "rms_right": 0.1}, {"rms_left": 0.3, "rms_right": 0.3}]
    frames = [frame.model_copy(update=loud[i % 2]) for i, frame in enumerate(record.frames[:10])]
    found = facts(record.model_copy(update={"frames": frames}))["level (dB)"]
    assert found == pytest.approx(10 * math.log10((0.1**2 + 0.3**2) / 2), abs=1e-9)


def test_the_deviation_of_a_response_is_that_of_its_level() -> None:
    response = np.full((2, 10), 0.1, dtype=np.float32)
    found = bench_acoustics._deviation([response, response * 10 ** (1 / 20)])
    assert found == pytest.approx(1 / math.sqrt(2), rel=1e-5)


def test_an_unknown_argument_of_the_acoustic_benchmark_is_one_line() -> None:
    with pytest.raises(SystemExit, match="unknown argument 'room'; expected none, cuda or rooms"):
        bench_acoustics.main(["room"])


def test_two_checkouts_are_compared_by_the_medians_of_their_rounds() -> None:
    before = [{"frame": 1.0, "gone": 3.0}, {"frame": 9.0, "gone": 3.0}, {"frame": 2.0, "gone": 3.0}]
    now = [{"frame": 3.0, "new": 1.0}, {"frame": 2.5, "new": 1.0}, {"frame": 50.0, "new": 1.0}]
    assert compared(before, now) == {"frame": {"before": 2.0, "now": 3.0, "ratio": 1.5}}


def test_another_checkout_is_measured_with_the_packages_of_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other, site = tmp_path / "other", tmp_path / "site"
    (other / "benchmarks").mkdir(parents=True)
    site.mkdir()
    (site / "only_here.py").write_text("FIGURE = 2.5\n")
    program = "import only_here\n\ndef run_all(repeats):\n    return {'frame': repeats * only_here.FIGURE}\n"
    (other / "benchmarks" / "bench_vision.py").write_text(program)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), str(site)]))
    assert measure(other, repeats=2) == {"frame": 5.0}


def test_a_checkout_that_is_none_of_this_project_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(Avs3dError, match=r"No module named 'benchmarks'.*expected a checkout of this project"):
        measure(tmp_path, repeats=1)
