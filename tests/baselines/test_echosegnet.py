"""EchoSegnet from pictures and sound to a scored submission, on the CPU, on a tiny dataset."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from avs3d_bench.contract import layout
from avs3d_bench.contract.scores import Scores
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.formats.colmap import write_model
from avs3d_bench.geometry import Intrinsics
from avs3d_bench.scheduling.errors import UnfitError
from avs3d_bench.scheduling.tasks import Context
from baselines.echosegnet import cache, pipeline, training_stage, voting_stage
from baselines.echosegnet.cache import Stages, inputs_digest
from baselines.echosegnet.densify import DensityControl
from baselines.echosegnet.gaussians import from_points, read_audio_intensity, read_ply
from baselines.echosegnet.pictures import load_pictures
from baselines.echosegnet.pipeline import Settings
from baselines.echosegnet.rasteriser.default import TorchRasteriser
from baselines.echosegnet.rasteriser.rendering import Splat
from baselines.echosegnet.render import amodal_mask
from baselines.echosegnet.run import ObservationJob, method_name, predict_one, software, write_echosegnet, write_sweep
from baselines.echosegnet.sources import FolderMasks, OracleMasks, mask_source
from baselines.echosegnet.train import TrainingSettings
from baselines.echosegnet.views import input_views, load_views, train_views
from baselines.oracle_errors import ErrorModel
from evaluators import evaluate
from tests.support import tiny

FRAMES = 24
SETTINGS = Settings(training=TrainingSettings(iterations=400, density=DensityControl(pixels_per_gaussian=20)))


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


@pytest.mark.slow
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


@pytest.mark.slow
def test_ambiguous_masks_mark_the_twin_too(data: Path, tmp_path: Path, work: Path):
    settings = replace(SETTINGS, refine=False)
    scores = run(data, tmp_path / "s", work, OracleMasks("category"), settings)
    assert scores.parts["part_2"].strict.wrong_instance_rate == 1
    assert method_name(settings, OracleMasks()) == "EchoSegnet, official without AISRM, masks: oracle (category)"


@pytest.mark.slow
def test_another_threshold_trains_nothing_again(
    data: Path, tmp_path: Path, work: Path, monkeypatch: pytest.MonkeyPatch
):
    run(data, tmp_path / "s", work, OracleMasks("sounding"))

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("trained or voted again")

    monkeypatch.setattr(training_stage, "train", refuse)
    monkeypatch.setattr(voting_stage.lift, "vote_counts", refuse)
    writers = write_sweep(
        Dataset(data), tmp_path / "sweep", OracleMasks("sounding"), SETTINGS, work=work, devices=("cpu",),
        thresholds=(0.9, 0.1), only=["part_1/*"],
    )  # fmt: skip
    assert [writer.path.name for writer in writers] == ["voting-threshold-0.9", "voting-threshold-0.1"]
    marked = [sum(media.read_png_mask(path).sum() for path in writer.path.rglob("*.png")) for writer in writers]
    assert marked[0] <= marked[1]
    said = [media.read_json(writer.path / layout.SUBMISSION_JSON)["runtime"]["voting_threshold"] for writer in writers]
    assert said == [0.9, 0.1]


@pytest.mark.slow
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


@pytest.mark.slow
def test_truth_pictures_and_sound_of_test_frames_change_nothing(data: Path, tmp_path: Path, work: Path):
    first = write_echosegnet(
        Dataset(data), tmp_path / "a", OracleMasks("sounding"), SETTINGS, work=work, devices=("cpu",), only=["part_1/*"]
    )
    other = tiny.clone(data, tmp_path / "data")
    for frame in Dataset(other)[tiny.SINGLE].test:
        tiny.replace(frame.path(layout.SEMANTIC_MASKS), b"no truth")
        tiny.replace(frame.path(layout.INSTANCE_MASKS), b"no truth")
        tiny.replace(frame.path(layout.IMAGES), b"no picture")
        tiny.replace(frame.observation.path / layout.audio_path(layout.BINAURAL, frame.index), b"no sound")
    assert inputs_digest(Dataset(other)[tiny.SINGLE]) == inputs_digest(Dataset(data)[tiny.SINGLE])
    second = write_echosegnet(
        Dataset(other), tmp_path / "b", OracleMasks("sounding"), SETTINGS, work=tmp_path / "work2", devices=("cpu",),
        only=["part_1/*"],
    )  # fmt: skip
    for path in sorted(first.path.rglob("*.png")):
        assert (second.path / path.relative_to(first.path)).read_bytes() == path.read_bytes()


def _undistort(data: Path, key: str, camera: Intrinsics) -> None:
    """Put pictures of another camera into images/ and sparse/0, as an undistorted release has them."""
    observation = Dataset(data)[key]
    poses, boxes = [frame.pose for frame in observation.frames], tiny.BOXES[key]
    for frame, pose in zip(observation.frames, poses, strict=True):
        path = frame.path(layout.IMAGES)
        path.unlink()
        media.write_png_rgb(path, tiny.render(camera, pose, boxes)[0])
    shutil.rmtree(observation.path / "sparse")
    write_model(observation.path / layout.COLMAP, tiny.colmap_model(camera, poses, boxes))


@pytest.mark.slow
@pytest.mark.parametrize("ours", [True, False])
def test_images_may_have_another_size_and_camera_than_input(data: Path, tmp_path: Path, ours: bool):
    """Training reads images/ with the camera of sparse/0; masks, votes and the submission keep the size of input/."""
    copy = tiny.clone(data, tmp_path / "data")
    other = Intrinsics(60, 56, 32.0, 32.0, 30.0, 28.0)
    _undistort(copy, tiny.SINGLE, other)
    if not ours:
        (copy / tiny.SINGLE / layout.OBSERVATION_JSON).unlink()
    observation = Dataset(copy)[tiny.SINGLE]
    views = load_views(observation)
    assert {view.camera for view in views} == {other}
    assert load_pictures(train_views(views)).shape[1:] == (56, 60, 3)
    (lens,) = {view.camera for view in input_views(views)}
    assert astuple(lens) == pytest.approx(astuple(Intrinsics.from_fov(tiny.SIZE)))
    before = inputs_digest(observation)
    tiny.replace(observation.frames[0].path(layout.INPUT), b"not read by the training")
    assert inputs_digest(observation) == before
    tiny.clone(data / tiny.SINGLE / layout.INPUT, tmp_path / "input")
    shutil.copy(tmp_path / "input/frame_000.png", observation.frames[0].path(layout.INPUT))
    brief = replace(SETTINGS, training=replace(SETTINGS.training, iterations=100))
    scores = run(copy, tmp_path / "s", tmp_path / "w", OracleMasks("sounding"), brief, only=["part_1/*"])
    assert scores.overall.strict.IoU > scores.references["centre_box"]["overall"].strict.IoU + 0.3
    (mask, *_) = sorted((tmp_path / "s").rglob("frame_*.png"))
    assert media.read_png_mask(mask).shape == (tiny.SIZE, tiny.SIZE)


def test_a_camera_of_sparse_that_fits_input_is_used_as_it_is(tmp_path: Path):
    release = tiny.write_release(tmp_path / "release")
    views = load_views(Dataset(release)[tiny.SINGLE])
    assert input_views(views) == views


@pytest.mark.slow
def test_rule_the_choice_is_made_before_the_decomposition_and_the_map_is_of_all_gaussians(
    data: Path, tmp_path: Path, work: Path, monkeypatch: pytest.MonkeyPatch
):
    """The released order: votes, labelled set, DBSCAN and choice on undecomposed centres, decomposition, rendering."""
    said: list[tuple[str, np.ndarray]] = []

    def watch(name: str, module: object, function: str, centres: Callable[..., Any]) -> None:
        real = getattr(module, function)

        def watched(*arguments: Any, **options: Any) -> Any:
            said.append((name, np.asarray(centres(*arguments)).copy()))
            return real(*arguments, **options)

        monkeypatch.setattr(module, function, watched)

    watch("map", pipeline.aisrm, "audio_intensity_map", lambda views, clips, points: points)
    watch("centre", pipeline.aisrm, "audio_centre", lambda points, intensity: points)
    watch("refine", pipeline.aisrm, "refine", lambda points, centre: points)
    watch("decompose", pipeline, "decompose", lambda part, views, masks: part.means)
    run(data, tmp_path / "s", work, OracleMasks("sounding"), only=["part_2/*"])
    assert [name for name, _ in said] == ["map", "centre", "refine", "decompose"]
    whole, centre, labelled, chosen = (points for _, points in said)
    (ply,) = (work / tiny.MULTI).glob("gaussians-*.ply")
    scene = read_ply(ply).means.numpy()
    assert np.array_equal(whole, scene)
    assert np.array_equal(centre, scene)
    rows = {tuple(point) for point in scene.tolist()}
    assert {tuple(point) for point in labelled.tolist()} <= rows
    assert {tuple(point) for point in chosen.tolist()} <= {tuple(point) for point in labelled.tolist()}
    assert Settings().decompose_every == 4


def test_rule_the_mask_is_alpha_above_0_8_of_the_chosen_alone(data: Path):
    """Amodal: what stands in front is ignored."""
    view = load_views(Dataset(data)[tiny.SINGLE])[0]
    drawn: list[int] = []

    class Flat(TorchRasteriser):
        def splat(self, gaussians: Any, view: Any, **_: Any) -> Any:
            drawn.append(len(gaussians))
            alpha = torch.tensor([[0.79, 0.8, 0.8001, 1.0]], dtype=torch.float64)
            return Splat(alpha[..., None], alpha, gaussians.means, gaussians.means[:, 0] > 0, gaussians.means)

    part = from_points(np.eye(3), np.zeros((3, 3)))
    assert amodal_mask(Flat(), part, view).tolist() == [[False, False, True, True]]
    assert drawn == [3]


@pytest.mark.slow
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
    with pytest.raises(UsageError, match="expected 'oracle', 'owod-bind', 'listener' or a folder"):
        mask_source("nowhere", instance="category", errors=ErrorModel())
    if not torch.cuda.is_available():
        with pytest.raises(UsageError, match="CUDA devices"):
            write_echosegnet(Dataset(data), tmp_path / "s", source, SETTINGS, work=work, devices=("cuda:0",))
    assert not (tmp_path / "s").exists()


def test_a_stage_is_kept_only_while_its_inputs_and_its_software_are_the_same(data: Path, tmp_path: Path):
    rasteriser = TorchRasteriser()
    software = cache.software_digest(rasteriser)

    class Other(TorchRasteriser):
        pass

    assert cache.software_digest(Other()) != software

    other = tiny.clone(data, tmp_path / "data")
    observation, clone = Dataset(data)[tiny.SINGLE], Dataset(other)[tiny.SINGLE]
    assert inputs_digest(clone) == inputs_digest(observation)
    for split, same in (("test", True), ("train", False)):
        path = getattr(clone, split)[0].path(layout.IMAGES)
        content = bytearray(path.read_bytes())
        content[-20] ^= 1  # one bit of a picture: name and size stay
        tiny.replace(path, bytes(content))
        assert (inputs_digest(clone) == inputs_digest(observation)) is same

    masks = [np.zeros((4, 6), bool), np.ones((4, 6), bool)]
    assert cache.arrays_digest(masks) == cache.arrays_digest([mask.copy() for mask in masks])
    assert cache.arrays_digest(masks) != cache.arrays_digest(masks[::-1])
    assert cache.arrays_digest(masks) != cache.arrays_digest([mask.reshape(6, 4) for mask in masks])


def test_a_damaged_stage_is_made_again(tmp_path: Path):
    stages, votes = Stages(tmp_path), np.arange(1000.0)
    stages.save_arrays("votes", "key", {"inside": votes})
    path = stages.path("votes", "key", ".npz")
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 1
    for damaged in (b"", b"hello", whole[:200], whole[:-30], bytes(flipped)):
        path.write_bytes(damaged)
        assert stages.load_arrays("votes", "key") is None
    path.write_bytes(whole)
    kept = stages.load_arrays("votes", "key")
    assert kept is not None
    np.testing.assert_array_equal(kept["inside"], votes)


def test_a_worker_with_other_sources_is_refused(tmp_path: Path):
    mine = software(OracleMasks())
    job = ObservationJob(
        tmp_path, tiny.SINGLE, (), OracleMasks(), tmp_path, ("cpu",), tuple((mine | {"software": "0" * 64}).items())
    )
    with pytest.raises(
        UnfitError, match=f"has the software {mine['software'][:12]}, the run 000000000000 .*sources differ"
    ):
        predict_one(Context(0, lambda *_: None), job)
