"""EchoSegnet from pictures and sound to a scored submission, on the CPU, on a tiny dataset."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tiny
import torch

from avs3d_bench import layout, media
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.scores import Scores
from baselines.echosegnet import pipeline
from baselines.echosegnet.cache import inputs_digest
from baselines.echosegnet.gaussians import read_audio_intensity, read_ply
from baselines.echosegnet.pipeline import Settings
from baselines.echosegnet.run import method_name, write_echosegnet, write_sweep
from baselines.echosegnet.sources import FolderMasks, OracleMasks, mask_source
from baselines.echosegnet.train import TrainingSettings
from baselines.errors import ErrorModel
from evaluators import evaluate

FRAMES = 24
SETTINGS = Settings(training=TrainingSettings(iterations=400))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.set_num_threads(1)
    return tiny.write_dataset(tmp_path_factory.mktemp("data") / "tiny", frames=FRAMES)


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Intermediate results that all tests share: the Gaussians are trained once."""
    return tmp_path_factory.mktemp("work")


def run(
    data: Path, target: Path, work: Path, source: object, settings: Settings = SETTINGS, **options: object
) -> Scores:
    write_echosegnet(Dataset(data), target, source, settings, work=work, devices=("cpu",), **options)
    return evaluate(target, data, only=options.get("only", ())).scores


@pytest.mark.parametrize("variant", ["official", "spatial"])
def test_it_finds_the_object_and_beats_the_centre_box(data: Path, tmp_path: Path, work: Path, variant: str):
    settings = replace(SETTINGS, variant=variant)
    scores = run(data, tmp_path / "s", work, OracleMasks("sounding"), settings)
    box = scores.references["centre_box"]["overall"].strict
    assert scores.overall.strict.IoU > box.IoU + 0.3
    assert scores.parts["part_2"].strict.wrong_instance_rate == 0
    if variant == "spatial":  # the published votes know no occlusion: splats far behind the object stay
        assert scores.overall.strict.centroid_error < 0.3
    assert scores.submission.points
    assert "ground truth of train frames" in scores.submission.notes
    assert scores.submission.runtime["variant"] == variant
    assert scores.submission.runtime["iterations"] == 400
    if variant == "official":
        (ply,) = (work / tiny.SINGLE).glob("audio-*.ply")
        intensity = read_audio_intensity(ply)
        assert intensity.max() == 1
        assert intensity.min() >= 0
        assert len(read_ply(ply)) == len(intensity)


def test_ambiguous_masks_mark_the_twin_too(data: Path, tmp_path: Path, work: Path):
    settings = replace(SETTINGS, refine=False)
    scores = run(data, tmp_path / "s", work, OracleMasks("category"), settings)
    assert scores.parts["part_2"].strict.wrong_instance_rate == 1
    assert method_name(settings, OracleMasks()) == "EchoSegnet, official without AISRM, masks: oracle (category)"


def test_another_threshold_trains_nothing_again(
    data: Path, tmp_path: Path, work: Path, monkeypatch: pytest.MonkeyPatch
):
    run(data, tmp_path / "s", work, OracleMasks("sounding"))

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("trained or voted again")

    monkeypatch.setattr(pipeline, "train", refuse)
    monkeypatch.setattr(pipeline.lift, "vote_counts", refuse)
    writers = write_sweep(
        Dataset(data), tmp_path / "sweep", OracleMasks("sounding"), SETTINGS, work=work, devices=("cpu",),
        thresholds=(0.9, 0.1), only=["part_1/*"],
    )  # fmt: skip
    assert [writer.path.name for writer in writers] == ["voting-threshold-0.9", "voting-threshold-0.1"]
    marked = [sum(media.read_png_mask(path).sum() for path in writer.path.rglob("*.png")) for writer in writers]
    assert marked[0] <= marked[1]
    said = [media.read_json(writer.path / layout.SUBMISSION_JSON)["runtime"]["voting_threshold"] for writer in writers]
    assert said == [0.9, 0.1]


def test_masks_from_a_folder_are_those_of_the_oracle(data: Path, tmp_path: Path, work: Path):
    source = OracleMasks("sounding")
    for observation in Dataset(data):
        for frame in observation.train:
            media.write_png_mask(tmp_path / "masks" / observation.key / f"{frame.name}.png", source.mask(frame))
    ours = run(data, tmp_path / "a", work, source)
    folder = run(data, tmp_path / "b", work, FolderMasks(tmp_path / "masks"))
    assert folder.overall.strict == ours.overall.strict
    assert "ground truth" not in folder.submission.notes


def test_the_truth_of_test_frames_is_not_for_it(data: Path):
    with pytest.raises(UsageError, match="truth of test frames"):
        OracleMasks().mask(Dataset(data)[tiny.SINGLE].test[0])


def test_the_truth_and_the_pictures_of_test_frames_change_nothing(data: Path, tmp_path: Path, work: Path):
    first = write_echosegnet(
        Dataset(data), tmp_path / "a", OracleMasks("sounding"), SETTINGS, work=work, devices=("cpu",), only=["part_1/*"]
    )
    other = tiny.clone(data, tmp_path / "data")
    for frame in Dataset(other)[tiny.SINGLE].test:
        tiny.replace(frame.path(layout.SEMANTIC_MASKS), b"no truth")
        tiny.replace(frame.path(layout.INSTANCE_MASKS), b"no truth")
    assert inputs_digest(Dataset(other)[tiny.SINGLE]) == inputs_digest(Dataset(data)[tiny.SINGLE])
    second = write_echosegnet(
        Dataset(other), tmp_path / "b", OracleMasks("sounding"), SETTINGS, work=tmp_path / "work2", devices=("cpu",),
        only=["part_1/*"],
    )  # fmt: skip
    for path in sorted(first.path.rglob("*.png")):
        assert (second.path / path.relative_to(first.path)).read_bytes() == path.read_bytes()


def test_what_is_missing_is_said_in_one_line(data: Path, tmp_path: Path, work: Path):
    source = OracleMasks("sounding")
    broken = tiny.clone(data, tmp_path / "no-sparse")
    shutil.rmtree(broken / tiny.SINGLE / "sparse")
    with pytest.raises(Avs3dError, match="EchoSegnet needs the sparse model"):
        run(broken, tmp_path / "s", tmp_path / "w", source, only=["part_1/*"])
    silent = tiny.clone(data, tmp_path / "no-audio")
    (silent / tiny.SINGLE / "audio_clips_binaural" / "frame_3.wav").unlink()
    with pytest.raises(Avs3dError, match=r"frame_3\.wav: missing"):
        run(silent, tmp_path / "s", work, source, only=["part_1/*"])
    (tmp_path / "empty" / tiny.SINGLE).mkdir(parents=True)
    with pytest.raises(Avs3dError, match=r"no mask; expected frame_001\.png and on"):
        run(data, tmp_path / "s", work, FolderMasks(tmp_path / "empty"), only=["part_1/*"])
    black = tmp_path / "black" / tiny.SINGLE
    for frame in Dataset(data)[tiny.SINGLE].train:
        media.write_png_mask(black / f"{frame.name}.png", np.zeros((tiny.SIZE, tiny.SIZE), bool))
    with pytest.raises(Avs3dError, match="marks nothing in any train frame"):
        run(data, tmp_path / "s", work, FolderMasks(tmp_path / "black"), only=["part_1/*"])
    with pytest.raises(UsageError, match="expected 'oracle', 'owod-bind' or a folder"):
        mask_source("nowhere", instance="category", errors=ErrorModel())
    if not torch.cuda.is_available():
        with pytest.raises(UsageError, match="CUDA devices"):
            write_echosegnet(Dataset(data), tmp_path / "s", source, SETTINGS, work=work, devices=("cuda:0",))
    assert not (tmp_path / "s").exists()
