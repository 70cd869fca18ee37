"""EchoSegnet on part_3 observations, from pictures and sound to a scored submission, on the CPU, on a tiny group."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from avs3d_bench.dataset import Dataset
from avs3d_bench.formats import media
from baselines.echosegnet import pipeline
from baselines.echosegnet.activity import Activity
from baselines.echosegnet.cache import inputs_digest
from baselines.echosegnet.densify import DensityControl
from baselines.echosegnet.pipeline import Settings
from baselines.echosegnet.run import write_echosegnet
from baselines.echosegnet.sources import OracleMasks
from baselines.echosegnet.train import TrainingSettings
from evaluators import evaluate
from tests.support import tiny_scenes

FRAMES = 24
SETTINGS = Settings(training=TrainingSettings(iterations=300, density=DensityControl(pixels_per_gaussian=20)))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.set_num_threads(1)
    return tiny_scenes.write_part_3(tmp_path_factory.mktemp("data") / "tiny", frames=FRAMES)


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("work")


def test_siblings_share_the_key_of_the_training(data: Path):
    dataset = Dataset(data)
    assert len({inputs_digest(dataset[key]) for key in tiny_scenes.GROUP}) == 1


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["official", "spatial"])
def test_a_group_is_trained_once_and_silence_gives_empty_masks(data: Path, tmp_path: Path, work: Path, variant: str):
    settings = replace(SETTINGS, variant=variant)
    target = tmp_path / "s"
    write_echosegnet(Dataset(data), target, OracleMasks("category"), settings, work=work, devices=("cpu",))
    assert [path.parent.name for path in work.rglob("gaussians-*.ply")] == ["1"]  # that of the first sibling
    files = sorted((target / tiny_scenes.SILENT / "masks").glob("*.png"))
    assert len(files) == FRAMES // 8
    assert not any(media.read_png_mask(path).any() for path in files)
    for path in sorted((target / tiny_scenes.FIRST / "masks").glob("*.png")):
        mask = media.read_png_mask(path)
        ids = media.read_png_categories(path.parent.parent / "categories" / path.name)
        assert set(np.unique(ids[mask])) <= {4}  # microwave
        assert not ids[~mask].any()
    scores = evaluate(target, data).scores
    assert scores.submission.runtime["variant"] == variant
    assert scores.overall.listen is not None


@pytest.mark.slow
def test_what_sounds_in_a_few_frames_only_is_lifted_and_drawn_where_it_is_active(
    data: Path, tmp_path: Path, work: Path, monkeypatch: pytest.MonkeyPatch
):
    def active(points: np.ndarray, labels: np.ndarray, views: list, clips: np.ndarray) -> Activity:
        """Every cluster sounds in every frame but those of the second half."""
        posterior = np.ones((len(views), int(labels.max()) + 1))
        posterior[len(views) // 2 :] = 0
        return Activity(posterior, np.zeros(len(views)), posterior[0], np.ones(len(views), np.bool_))

    monkeypatch.setattr(pipeline, "cluster_activity", active)
    settings = replace(SETTINGS, variant="spatial")
    observation = Dataset(data)[tiny_scenes.BOTH]
    write_echosegnet(
        Dataset(data), tmp_path / "s", OracleMasks("sounding"), settings, work=work, devices=("cpu",),
        only=[tiny_scenes.BOTH],
    )  # fmt: skip
    for frame in observation.test:
        mask = media.read_png_mask(tmp_path / "s" / observation.key / "masks" / f"{frame.name}.png")
        if frame.index >= FRAMES // 2:
            assert not mask.any()
            continue
        for box in (1, 3):  # which sound in 4 and 7 of the 24 frames
            seen = frame.instance_ids() == box
            assert not seen.any() or mask[seen].mean() > 0.3
