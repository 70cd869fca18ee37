"""DenseAV: the rule that makes masks of similarities, then the whole baseline from a checkpoint file.

The package is not on PyPI; a tiny network with its interface takes the place of its own (`tiny_models.TinyAligner`).
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.formats.files import read_json
from baselines import denseav, sound_control
from baselines.cli import baseline
from tests.support import tiny
from tests.support.shared import SharedDataset

torch = pytest.importorskip("torch", reason="torch is not installed: the learned baselines cannot run")
pytest.importorskip("huggingface_hub", reason="huggingface_hub is not installed: the learned baselines cannot run")

from tests.support import tiny_models, tiny_scenes  # noqa: E402

torch.set_num_threads(1)
CPU = torch.device("cpu")
QUICK = settings(max_examples=60)
MAPS = st.lists(arrays(np.float64, (3, 4), elements=st.floats(-10, 10)), min_size=1, max_size=4)

# ---- the rule


def test_the_map_of_a_clip_is_the_mean_over_time_of_the_likeliest_head() -> None:
    # One picture, two heads, 1 × 2 patches, two frequencies, three moments.
    similarity = np.zeros((1, 2, 1, 2, 2, 3))
    similarity[0, 0, 0, 0] = [[3, 0, 0], [1, 0, 0]]  # mean over frequency: 2, 0, 0
    similarity[0, 1, 0, 0] = [[0, 1, 1], [0, 1, 1]]  # 0, 1, 1
    similarity[0, 1, 0, 1] = -6.0
    # First patch: the larger head at each moment is 2, 1, 1. Second: head 0 gives 0, more than −6.
    np.testing.assert_allclose(denseav.clip_map(similarity), [[[4 / 3, 0.0]]])


@QUICK
@given(MAPS, st.floats(0.1, 100))
def test_normalised_maps_lie_in_0_to_1_together_and_ignore_the_unit(maps: list[Any], unit: float) -> None:
    out = denseav.min_max(maps)
    everything = np.stack(out)
    assert everything.min() >= 0.0
    raised = np.maximum(np.stack(maps), 0.0)
    if raised.max() > raised.min():
        assert everything.max() == 1.0
        assert everything.min() == 0.0
        for one, other in zip(out, denseav.min_max([unit * values for values in maps]), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-9)
    else:
        assert not everything.any()


def test_a_picture_that_fits_less_is_not_stretched() -> None:
    loud, faint = np.array([[0.0, 8.0]]), np.array([[-3.0, 2.0]])
    together = denseav.min_max([loud, faint])
    assert together[1].tolist() == [[0.0, 0.25]]
    assert not denseav.mark(together[1], (4, 8), 0.5).any()
    assert denseav.mark(denseav.min_max([faint])[0], (4, 8), 0.5).any()


def test_marked_is_what_is_above_the_threshold_at_the_size_of_the_frame() -> None:
    # Bilinear between the patches' centres: 0 left of column 2, 1 right of column 6, 0.5 in the middle.
    mask = denseav.mark(np.array([[0.0, 1.0]]), (6, 8), 0.5)
    assert mask.dtype == np.bool_
    assert (mask == (np.arange(8) >= 4)[None]).all()
    assert mask.shape == (6, 8)
    assert denseav.mark(np.array([[0.0, 1.0]]), (6, 8), 0.9)[0].tolist() == [False] * 6 + [True] * 2


@QUICK
@given(arrays(np.float64, (4, 4), elements=st.floats(0, 1)), st.floats(0, 0.98), st.floats(0, 0.98))
def test_a_higher_threshold_marks_a_part(values: Any, one: float, other: float) -> None:
    low, high = sorted((one, other))
    assert not (denseav.mark(values, (11, 7), high) & ~denseav.mark(values, (11, 7), low)).any()


@pytest.mark.parametrize(
    ("size", "expected"), [((1008, 1008), (224, 224)), ((480, 640), (224, 296)), ((640, 480), (296, 224))]
)
def test_pictures_become_whole_patches_that_cover_the_frame(size: tuple[int, int], expected: tuple[int, int]) -> None:
    out = denseav.prepare(np.full((*size, 3), 255, dtype=np.uint8))
    assert out.shape == (3, *expected)
    np.testing.assert_allclose(out[:, 0, 0], (1 - np.array([0.485, 0.456, 0.406])) / [0.229, 0.224, 0.225], rtol=1e-5)


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"threshold": 1.0}, "threshold 1.0: expected"), ({"normalise": "video"}, "normalise 'video': expected")],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        denseav.DenseAv(tiny_models.TinyAligner(4, 2, 0.0, False), CPU, **settings)


# ---- the whole baseline


@pytest.fixture(scope="module")
def root(shared_dataset: SharedDataset) -> Path:
    return shared_dataset()


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> denseav.DenseAv:
    tiny_models.install_denseav(monkeypatch)
    return denseav.load_denseav(tiny_models.write_denseav(tmp_path / "checkpoint"), device="cpu")


def redness(picture: Any) -> Any:
    """What the tiny network answers for a frame, in closed form: red − blue, normalised, the mean over a patch."""
    pixels = denseav.prepare(picture)
    return (pixels[0] - pixels[2]).reshape(28, 8, 28, 8).mean(axis=(1, 3))


def test_similarities_are_those_of_the_network(root: Path, model: denseav.DenseAv) -> None:
    frames = Dataset(root)[tiny.SINGLE].frames  # more than go through the network at a time
    maps = model.similarity(frames)
    assert len(maps) == len(frames) > denseav.BATCH
    for frame, values in zip(frames, maps, strict=True):
        assert values.shape == (28, 28)
        # Head 1 gives 0 everywhere, so that what is bluer than red is 0.
        np.testing.assert_allclose(values, np.maximum(redness(frame.rgb()), 0.0), atol=1e-5)


def test_every_frame_hears_its_own_clip(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tiny_models.install_denseav(monkeypatch)
    folder = tiny_models.write_denseav(tmp_path / "random", redness=False)
    model = denseav.load_denseav(folder, device="cpu")
    one, two = Dataset(root)[tiny.SINGLE].test
    together = model.similarity([one, two])
    for frame, values in zip((one, two), together, strict=True):
        np.testing.assert_allclose(model.similarity([frame])[0], values, rtol=1e-4, atol=1e-6)


def test_a_control_of_sound_is_what_it_hears_and_says(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny_models.install_denseav(monkeypatch)
    own = denseav.load_denseav(tiny_models.write_denseav(tmp_path / "random", redness=False), device="cpu")
    other = replace(own, hearing="other-category")
    first, *_, last = Dataset(root)
    frame, heard = first.test[0], last.test[0].mono()
    monkeypatch.setattr(sound_control, "other_frame", lambda *_, **__: last.test[0])
    with monkeypatch.context() as patch:
        patch.setattr(Frame, "mono", lambda _: heard)
        expected = own.similarity([frame])[0]
    np.testing.assert_array_equal(other.similarity([frame])[0], expected)
    assert not replace(own, hearing="none").masks([frame])[0].any()
    writer = denseav.write_denseav(Dataset(root), tmp_path / "out", other, only=[first.key])
    assert writer.record.method == "DenseAV, heard another category"
    assert writer.record.notes == f"{own.notes}; heard another category; only {first.key}"


def test_the_command_hears_nothing_and_its_submission_says_so(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny_models.install_denseav(monkeypatch)
    checkpoint, out = tiny_models.write_denseav(tmp_path / "checkpoint"), tmp_path / "out"
    arguments = ["denseav", "--dataset", str(root), "--checkpoint", str(checkpoint), "--device", "cpu"]
    result = CliRunner().invoke(baseline, [*arguments, "--sound", "none", "-o", str(out)])
    assert result.exit_code == 0, result.output
    assert not any(media.read_png_mask(path).any() for path in out.rglob("*.png"))
    record = read_json(out / "submission.json")
    assert record["method"] == "DenseAV, heard nothing"
    assert record["notes"].endswith("; heard nothing")


def test_the_submission_follows_the_rule(root: Path, tmp_path: Path, model: denseav.DenseAv) -> None:
    dataset = Dataset(root)
    writer = denseav.write_denseav(dataset, tmp_path / "out", model)
    assert writer.record.method == "DenseAV"
    assert "min-max over each observation; marked where > 0.5; checkpoint denseav_sound" in (writer.record.notes or "")
    marked = []
    for observation in dataset:
        maps = denseav.min_max([redness(frame.rgb()) for frame in observation.test])
        for frame, values in zip(observation.test, maps, strict=True):
            mask = media.read_png_mask(tmp_path / "out" / observation.key / "masks" / f"{frame.name}.png")
            assert (mask != denseav.mark(values, (tiny.SIZE, tiny.SIZE), 0.5)).mean() < 0.002
            marked.append(mask.mean())
    assert 0.0 < np.mean(marked) < 1.0


def test_normalising_every_frame_marks_something_in_each(root: Path, model: denseav.DenseAv) -> None:
    own = denseav.DenseAv(model.network, CPU, normalise="frame")
    for observation in Dataset(root):
        assert all(mask.any() for mask in own.masks(observation.test))


def test_only_pictures_and_mono_clips_of_test_frames_are_read(
    root: Path, tmp_path: Path, model: denseav.DenseAv
) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(root, bare)
    for key in (tiny.SINGLE, tiny.MULTI):
        for folder in ("semantic_masks", "instance_masks", "gt_3d", "sparse", "audio_clips_binaural", "images"):
            shutil.rmtree(bare / key / folder)
        (bare / key / "observation.json").unlink()
        for path in (bare / key).glob("audio_clips_mono/frame_[1-7].wav"):
            path.unlink()
    denseav.write_denseav(Dataset(root), tmp_path / "a", model)
    denseav.write_denseav(Dataset(bare), tmp_path / "b", model)
    masks = [p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*.png")]
    assert len(masks) == 4
    for mask in masks:
        assert (tmp_path / "a" / mask).read_bytes() == (tmp_path / "b" / mask).read_bytes()


def test_a_frame_without_sound_is_named_and_nothing_is_left(root: Path, tmp_path: Path, model: denseav.DenseAv) -> None:
    copy = tiny.clone(root, tmp_path / "x")
    (copy / tiny.MULTI / layout.audio_path(layout.MONO, 0)).unlink()
    with pytest.raises(Avs3dError, match=r"audio_clips_mono/frame_0\.wav: missing"):
        denseav.write_denseav(Dataset(copy), tmp_path / "out", model)
    assert not (tmp_path / "out").exists()


def test_a_network_that_gives_nan_is_one_line(root: Path, model: denseav.DenseAv) -> None:
    with torch.no_grad():
        model.network.image_model.bias.fill_(torch.nan)  # type: ignore[attr-defined]
    with pytest.raises(Avs3dError, match=r"frame_000: DenseAV gave numbers that are not finite; check its checkpoint"):
        model.masks(Dataset(root)[tiny.SINGLE].test)


# ---- the checkpoint


def test_without_the_package_the_way_to_get_it_is_said(tmp_path: Path) -> None:
    if denseav.has_package("denseav"):
        pytest.skip("denseav is installed: its absence cannot be seen")
    with pytest.raises(UsageError, match="denseav is not installed; DenseAV needs it: pip"):
        denseav.load_denseav(tmp_path)


def test_a_missing_or_truncated_checkpoint_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tiny_models.install_denseav(monkeypatch)
    with pytest.raises(UsageError, match="no folder with the checkpoint of DenseAV: make one and put denseav_sound"):
        denseav.load_denseav(None)
    with pytest.raises(Avs3dError, match=r"denseav_sound\.ckpt or denseav_2head\.ckpt of DenseAV is missing; put"):
        denseav.load_denseav(tmp_path)
    path = tiny_models.write_denseav(tmp_path) / "denseav_sound.ckpt"
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(Avs3dError, match=r"cannot load the checkpoint of DenseAV: .*; put .* \(MIT, about"):
        denseav.load_denseav(tmp_path)


def test_weights_of_another_network_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tiny_models.install_denseav(monkeypatch)
    path = tiny_models.write_denseav(tmp_path) / "denseav_sound.ckpt"
    data = torch.load(path, weights_only=True)
    del data["state_dict"]["audio_model.bias"]
    torch.save(data, path)
    with pytest.raises(Avs3dError, match="cannot load the checkpoint of DenseAV: RuntimeError"):
        denseav.load_denseav(tmp_path)


def test_the_first_version_of_the_package_keeps_its_network_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    tiny_models.install_denseav(monkeypatch)
    monkeypatch.setitem(sys.modules, "denseav.train_av_alignment", sys.modules["denseav.train"])
    monkeypatch.delitem(sys.modules, "denseav.train")
    model = denseav.load_denseav(tiny_models.write_denseav(tmp_path), device="cpu")
    assert isinstance(model.network, tiny_models.TinyAligner)


def test_digital_silence_gives_empty_masks_without_asking_the_network(tmp_path: Path) -> None:
    class Refusing:
        def forward_audio(self, batch: dict[str, Any]) -> dict[str, Any]:
            raise AssertionError("asked")

        forward_image = forward_audio

    dataset = Dataset(tiny_scenes.write_part_3(tmp_path / "data", frames=9))
    silent = dataset[tiny_scenes.SILENT]
    masks = denseav.DenseAv(Refusing(), CPU).masks(silent.test)  # type: ignore[arg-type]
    assert len(masks) == len(silent.test)
    assert not any(mask.any() for mask in masks)
