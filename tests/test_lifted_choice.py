"""How marks become one object: what is kept of an observation, the figure, and the table of settings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.taxonomy import CATEGORIES

torch = pytest.importorskip("torch", reason="torch is not installed: Gaussians cannot be trained")

from baselines.echosegnet.binaural import Cues  # noqa: E402
from baselines.echosegnet.densify import DensityControl  # noqa: E402
from baselines.echosegnet.network_masks import NetworkMasks  # noqa: E402
from baselines.echosegnet.rasteriser.default import default_rasteriser  # noqa: E402
from baselines.echosegnet.sources import OracleMasks  # noqa: E402
from baselines.echosegnet.train import TrainingSettings  # noqa: E402
from benchmarks import lifted_choice  # noqa: E402
from benchmarks.lifted_choice import Cloud, Job, Setting  # noqa: E402
from tests import tiny, tiny_scenes  # noqa: E402

torch.set_num_threads(1)
MICROWAVE = 1 + CATEGORIES.index("microwave")


def grid(low: tuple[float, ...], size: tuple[float, ...]) -> np.ndarray:
    """Points 2.5 cm apart in a box: (N, 3)."""
    axes = [np.arange(0, length + 1e-9, 0.025) for length in size]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + low


def cloud(**changed: Any) -> Cloud:
    """A microwave and an oven 8 cm beside it, both marked; nothing is heard, so that the larger candidate is chosen."""
    microwave, oven = grid((0, 0, 0), (0.5, 0.3, 0.35)), grid((0.58, 0, 0), (0.5, 0.3, 0.3))
    sizes, points = [len(microwave), len(oven)], np.concatenate([microwave, oven])
    silence = Cues(np.zeros(2), np.zeros((2, 2), complex), np.zeros((2, 0)), np.full(2, -np.inf), np.zeros(0, np.intp))
    share, truth = np.repeat([0.9, 0.4], sizes), np.repeat([1.0, 0.0], sizes)
    found = Cloud(
        "part_1/home/kitchen/1", MICROWAVE, points, share, truth, np.ones(len(points)), np.tile(np.eye(3), (2, 1, 1)),
        np.zeros((2, 3)), silence,
    )  # fmt: skip
    return replace(found, **changed)


def test_the_figure_weighs_gaussians_by_how_much_they_show() -> None:
    true = cloud().truth > 0.5
    everything = np.ones(len(true), np.bool_)
    one = cloud(seen=np.where(true, 1 / true.sum(), 3 / (~true).sum()))
    assert one.iou(true) == 1.0
    assert one.iou(everything) == pytest.approx(0.25)
    assert one.iou(~everything) == 0.0
    assert cloud(truth=np.zeros(len(true))).iou(~everything) == 0.0


def test_settings_choose_what_they_say() -> None:
    one = cloud()
    together = one.iou(np.ones(len(one.points), np.bool_))
    everything, relative = "all votes", "well-marked"
    assert one.iou(Setting(0.3, everything, "any", 0.12).chosen(one)) == together < 0.6
    assert one.iou(Setting(0.3, everything, "of the category", 0.12).chosen(one)) == 1.0
    assert one.iou(Setting(0.5, everything, "any", 0.12).chosen(one)) == 1.0  # too few votes for the oven
    assert not Setting(0.95, everything, "any", 0.12).chosen(one).any()
    weak = cloud(share=one.share / 3)  # a model that the network hardly recognises
    assert not Setting(0.5, everything, "any", 0.12).chosen(weak).any()
    assert weak.iou(Setting(0.5, relative, "any", 0.12).chosen(weak)) == 1.0
    nothing = cloud(share=0 * one.share)
    assert not Setting(0.5, relative, "any", 0.12).chosen(nothing).any()


def test_a_file_keeps_an_observation_and_the_table_has_a_row_for_each_setting(tmp_path: Path) -> None:
    cloud().save(tmp_path)
    (path,) = tmp_path.iterdir()
    again = Cloud.load(path)
    assert (again.key, again.category) == (cloud().key, MICROWAVE)
    np.testing.assert_allclose(again.points, cloud().points, atol=1e-6)
    np.testing.assert_array_equal(again.cues.level, cloud().cues.level)
    found = CliRunner().invoke(lifted_choice.main, ["table", str(tmp_path)], catch_exceptions=False)
    head, _, *rows = found.output.splitlines()
    assert "part_1: IoU | right" in head
    assert len(rows) == len(lifted_choice.SETTINGS)
    together = f"{cloud().iou(np.ones(len(cloud().points), np.bool_)):.3f}"
    assert f"| 0.3 | all votes | any | 0.12 | {together} | 1.00 | {together} |" in rows
    assert "| 0.5 | well-marked | of the category | 0.3 | 1.000 | 1.00 | 1.000 |" in rows


def test_a_folder_without_files_is_one_line(tmp_path: Path) -> None:
    found = CliRunner().invoke(lifted_choice.main, ["table", str(tmp_path)])
    assert found.exit_code == 1
    assert "no file .npz; make them with" in found.output


def test_sound_scenes_are_refused(tmp_path: Path) -> None:
    root = tiny_scenes.write_sound_scenes(tmp_path / "scenes", keys=(tiny_scenes.FIRST,))
    arguments = ["lift", str(root), "-o", str(tmp_path / "out"), "--work", str(tmp_path / "work"), "--device", "cpu"]
    found = CliRunner().invoke(lifted_choice.main, arguments)
    assert found.exit_code == 1
    assert f"{tiny_scenes.FIRST}: a sound scene, which is lifted otherwise" in found.output


@dataclass(frozen=True)
class Marker:
    """Marks both of two instances, as a detector does."""

    name = "both"
    notes = "a test"
    entry = "baselines.oracle:oracle_mask"

    @property
    def settings(self) -> dict[str, str | float]:
        return {}

    def mark(self, frames: Sequence[Frame], device: Any) -> Iterator[np.ndarray]:
        for frame in frames:
            yield OracleMasks("category").mask(frame).astype(np.uint8) * MICROWAVE


@pytest.mark.slow
def test_marks_and_truth_are_lifted_onto_the_same_gaussians(tmp_path: Path) -> None:
    observation = Dataset(tiny.write_dataset(tmp_path / "set", frames=17))[tiny.MULTI]
    training = TrainingSettings(iterations=200, density=DensityControl(pixels_per_gaussian=20))
    root = observation.path.parents[3]
    job = Job(root, observation.key, NetworkMasks(Marker()), training, tmp_path / "work", tmp_path, ("cpu",))
    found = lifted_choice.lifted(observation, job, default_rasteriser("cpu"))
    assert found.category == MICROWAVE
    marked, true = found.share > 0.5, found.truth > 0.5
    assert 0 < true.sum() < marked.sum()  # the silent twin is marked, and is not the object that sounds
    assert (marked & true).sum() >= 0.9 * true.sum()
    assert len(found.rotation) == len(observation.train) == len(found.cues.level)
