"""The listener as a method: from frames of any size to masks and class ids."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.contract import layout
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media

torch = pytest.importorskip("torch", reason="torch is not installed: the listener cannot run")

from baselines.cli import baseline  # noqa: E402
from baselines.listener import masks, predict, weights  # noqa: E402
from baselines.listener.masks import Answer  # noqa: E402
from baselines.listener.model import Listener  # noqa: E402
from baselines.listener.predict import ListenerMethod  # noqa: E402
from baselines.sound_control import SAID  # noqa: E402
from tests.support import tiny, tiny_listener, tiny_scenes  # noqa: E402
from tests.support.shared import SharedDataset  # noqa: E402

torch.set_num_threads(1)
MICROWAVE, CLOCK = (CATEGORIES.index(name) for name in ("microwave", "clock"))


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights of an untrained network."""
    return tiny_listener.write_weights(tmp_path_factory.mktemp("weights"))


@pytest.fixture(scope="module")
def scenes(shared_part_3: SharedDataset) -> Path:
    return shared_part_3(frames=10, size=64)


def answer(box: tuple[int, int, int, int], logit: float = 5.0) -> Answer:
    """A mask of a box (top, bottom, left, right) of cells that looks like a microwave."""
    mask = np.full((126, 126), -8.0, np.float32)
    mask[box[0] : box[1], box[2] : box[3]] = logit
    classes = np.full((8, 126, 126), 0.01, np.float32)
    classes[1 + MICROWAVE] = 0.5
    classes[1 + CLOCK] = 0.4
    audible = np.full(7, 0.01, np.float32)
    audible[CLOCK] = 0.9
    return Answer(mask, classes, audible)


def marked(answer: Answer, picture: Any, refine: Any = "none") -> Any:
    """The mask of a frame."""
    return ListenerMethod(None, torch.device("cpu"), "0" * 64, threshold=0.5, refine=refine).mask(answer.mask, picture)


@pytest.mark.parametrize("size", [(252, 252), (1008, 1008), (480, 640)])
def test_masks_have_the_size_of_the_frame_and_lie_where_the_network_says(size: tuple[int, int]) -> None:
    mask = marked(answer((42, 84, 63, 126)), np.zeros((*size, 3), np.uint8))
    assert mask.shape == size
    rows, columns = np.nonzero(mask)
    tolerance = 1.5 / 126
    assert rows.min() / size[0] == pytest.approx(42 / 126, abs=tolerance)
    assert (rows.max() + 1) / size[0] == pytest.approx(84 / 126, abs=tolerance)
    assert columns.min() / size[1] == pytest.approx(63 / 126, abs=tolerance)
    assert columns.max() == size[1] - 1


def test_refined_masks_follow_the_edges_of_the_picture() -> None:
    picture = np.full((1008, 1008, 3), 40, np.uint8)
    truth = np.zeros((1008, 1008), bool)
    truth[341:669, 503:803] = True  # edges that are no multiple of the 8 pixels of a cell
    picture[truth] = 220
    cells = answer((43, 84, 63, 100))
    rough = marked(cells, picture)
    fine = marked(cells, picture, "edges")

    def iou(mask: Any) -> float:
        return float((mask & truth).sum() / (mask | truth).sum())

    assert iou(fine) > iou(rough)
    assert iou(fine) > 0.985


def test_the_guided_filter_leaves_constants_and_smooth_values_alone() -> None:
    picture = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    flat = np.full((64, 64), 2.5, np.float32)
    np.testing.assert_allclose(masks.guided(flat, picture), flat, atol=1e-4)


def test_specks_are_dropped() -> None:
    mask = np.zeros((100, 100), bool)
    mask[10:20, 10:20] = mask[50, 50] = mask[60, 60:62] = True
    found = masks.without_specks(mask, 2e-4)
    assert found.sum() == 102
    assert not found[50, 50]
    assert not masks.without_specks(np.zeros((4, 4), bool), 0.1).any()


def drawn(*boxes: tuple[slice, slice, float]) -> Any:
    """(100, 100) log-odds of a picture with probability .01 but for some boxes."""
    shares = np.full((100, 100), 0.01, np.float32)
    for rows, columns, share in boxes:
        shares[rows, columns] = share
    return masks.log_odds(shares)


def test_a_frame_is_marked_down_to_a_share_of_its_peak() -> None:
    """And only around it: what is apart from the peak has to come near it by itself."""
    core, rim, other = (slice(10, 20), slice(10, 20), 0.6), (slice(5, 25), slice(5, 25), 0.35), (slice(60, 80),) * 2
    found = masks.marked(drawn(rim, core, (*other, 0.45)), 0.5, 0.5)
    assert found[5:25, 5:25].all()
    assert found.sum() == 400
    # The less sure frame has the same mask: shares are of its own peak.
    assert (masks.marked(drawn((*rim[:2], 0.175), (*core[:2], 0.3), (*other, 0.1)), 0.2, 0.5) == found).all()
    assert masks.marked(drawn(rim, core, (*other, 0.58)), 0.5, 0.5).sum() == 800


def test_one_pixel_is_no_peak() -> None:
    pixel, box = (slice(50, 51), slice(50, 51), 0.99), (slice(10, 20), slice(10, 20), 0.4)
    assert not masks.marked(drawn(pixel, box), 0.5, 0.5).any()
    assert masks.marked(drawn(pixel, box), 0.3, 0.5).sum() == 100


def test_without_a_share_each_pixel_above_the_threshold_is_marked() -> None:
    odds = drawn((slice(10, 20), slice(10, 20), 0.9), (slice(40, 50), slice(40, 50), 0.55))
    assert masks.marked(odds, 0.5, None).sum() == 200


def test_old_weights_keep_their_rule_and_looks_and_new_ones_bring_theirs(tmp_path: Path) -> None:
    old, new = weights.Calibration(threshold=0.7), weights.Calibration(threshold=0.4, share=0.6, finest=756)
    for calibration, rule in ((old, (0.7, None, 504)), (new, (0.4, 0.6, 756)), (None, (0.5, None, 756))):
        weights.save_weights(Listener(tiny_listener.SMALL), tmp_path / "file.safetensors", calibration)
        method = predict.load_method(tmp_path / "file.safetensors", device="cpu")
        assert (method.threshold, method.share, method.finest) == rule
        sides = [look.side for look in predict.looks_at(1008, "several", method.finest)]
        assert sides == [method.finest - 252] * 2 + [method.finest] * 2
        assert f"looks at {method.finest - 252}² and {method.finest}²" in method.notes
    weights.save_weights(Listener(tiny_listener.SMALL), tmp_path / "file.safetensors", weights.Calibration(finest=252))
    assert "looks at 252², also mirrored" in predict.load_method(tmp_path / "file.safetensors", device="cpu").notes
    assert "one look at 252²" in predict.load_method(tmp_path / "file.safetensors", device="cpu", looks="one").notes
    weights.save_weights(Listener(tiny_listener.SMALL), tmp_path / "file.safetensors", None)
    method = predict.load_method(tmp_path / "file.safetensors", device="cpu", threshold=0.2)
    assert (method.threshold, method.share) == (0.2, None)


def test_a_component_is_named_after_what_is_seen_there_and_heard() -> None:
    cells = answer((42, 84, 63, 100))
    mask = marked(cells, np.zeros((252, 252, 3), np.uint8))
    found = masks.class_map(mask, cells)
    assert set(np.unique(found[mask])) == {1 + CLOCK}
    assert not found[~mask].any()


def test_nothing_is_marked_where_the_network_marks_nothing() -> None:
    found = marked(answer((0, 20, 0, 20), logit=-1.5), np.zeros((252, 252, 3), np.uint8), "edges")
    assert not found.any()


def test_the_command_writes_a_submission_with_class_ids(scenes: Path, saved: Path, tmp_path: Path) -> None:
    arguments = ["listener", "--dataset", str(scenes), "-o", str(tmp_path / "out"), "--weights", str(saved),
                 "--device", "cpu", "--refine", "none", "--looks", "one"]  # fmt: skip
    found = CliRunner().invoke(baseline, arguments, catch_exceptions=False)
    assert found.exit_code == 0, found.output
    for observation in Dataset(scenes):
        for frame in observation.test:
            folder = tmp_path / "out" / observation.key
            mask = media.read_png_mask(folder / layout.SUBMISSION_MASKS / f"{frame.name}.png")
            assert mask.shape == frame.rgb().shape[:2]
            classes = folder / layout.SUBMISSION_CATEGORIES / f"{frame.name}.png"
            assert classes.exists()
    record = media.read_json(tmp_path / "out" / layout.SUBMISSION_JSON)
    assert record["method"] == "Listener"
    assert weights.load_listener(saved)[1][:12] in record["notes"]
    assert record.get("truth") is None


@pytest.fixture(scope="module")
def soft(scenes: Path, saved: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``masks`` and ``soft`` of an untrained network, whose threshold is .5."""
    folder = tmp_path_factory.mktemp("soft")
    assert softly(scenes, saved, folder).exit_code == 0
    return folder


def softly(scenes: Path, saved: Path, folder: Path, *extra: str) -> Any:
    arguments = ["listener", "--dataset", str(scenes), "-o", str(folder / "masks"), "--weights", str(saved), "--device",
                 "cpu", "--looks", "one", "--uncalibrated", "--soft-masks", str(folder / "soft"), *extra]  # fmt: skip
    return CliRunner().invoke(baseline, arguments)


def test_soft_masks_have_the_probabilities_of_which_masks_are_made(scenes: Path, saved: Path, soft: Path) -> None:
    method = predict.load_method(saved, device="cpu", looks="one")
    for observation in Dataset(scenes):
        frames = observation.test
        names = {f"{frame.name}.png" for frame in frames}
        assert {path.name for path in (soft / "soft" / observation.key / "masks").iterdir()} == names
        sounds = np.stack([predict.clip_of(frame) for frame in frames])
        cameras = np.asarray([predict.camera_of(frame) for frame in frames], np.float32)
        found = method.answers([frame.rgb() for frame in frames], sounds, cameras)
        for frame, answer in zip(frames, found, strict=True):
            grey = cv2.imread(
                str(soft / "soft" / observation.key / "masks" / f"{frame.name}.png"), cv2.IMREAD_UNCHANGED
            )
            wanted = 255 / (1 + np.exp(-method.odds(answer.mask, frame.rgb())))
            assert grey.dtype == np.uint8
            assert np.abs(grey - wanted).max() <= 0.5 + 1e-3
            assert len(np.unique(grey)) > 2
            mask = media.read_png_mask(soft / "masks" / observation.key / layout.SUBMISSION_MASKS / f"{frame.name}.png")
            assert (grey[mask] >= 127).all()


def test_soft_masks_are_scored_without_a_threshold(scenes: Path, soft: Path, tmp_path: Path) -> None:
    from evaluators.reading.mask_folders import FolderOptions, score_folders

    for path in (soft / "soft").rglob("*.png"):
        # The truth is what the network is surest of: the ranking is right, whatever the threshold.
        grey = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        media.write_png_mask(tmp_path / path.relative_to(soft / "soft"), grey == grey.max())
    found = score_folders(tmp_path, soft / "soft", FolderOptions(soft=True))
    assert found.figures["AP"] == 1.0
    assert found.frames == sum(len(observation.test) for observation in Dataset(scenes))


def test_soft_masks_replace_nothing(scenes: Path, saved: Path, soft: Path) -> None:
    for extra in ((), ("--overwrite",)):
        assert "new or an empty folder" in str(softly(scenes, saved, soft, *extra).exception)
    assert "--answer direction" in str(softly(scenes, saved, soft, "--overwrite", "--answer", "direction").exception)


def test_the_truth_is_not_read(scenes: Path, saved: Path, tmp_path: Path) -> None:
    import shutil

    blind = tmp_path / "blind"
    shutil.copytree(scenes, blind)
    for folder in (layout.SEMANTIC_MASKS, layout.CATEGORY_MASKS, layout.INSTANCE_MASKS):
        for path in blind.rglob(folder):
            shutil.rmtree(path)
    model = predict.load_method(saved, device="cpu")
    for before, after in zip(Dataset(scenes), Dataset(blind), strict=True):
        for one, other in zip(model.predictions(before.test), model.predictions(after.test), strict=True):
            np.testing.assert_array_equal(one.mask, other.mask)


def test_predictions_do_not_depend_on_their_neighbours(scenes: Path, saved: Path) -> None:
    model = predict.load_method(saved, device="cpu")
    frames = Dataset(scenes)[tiny_scenes.FIRST].frames[:3]
    pictures = [frame.rgb() for frame in frames]
    sounds = np.stack([predict.clip_of(frame) for frame in frames])
    cameras = np.asarray([predict.camera_of(frame) for frame in frames], np.float32)
    with torch.inference_mode():
        together = model.answers(pictures, sounds, cameras)
        alone = model.answers(pictures[1:2], sounds[1:2], cameras[1:2])
    np.testing.assert_allclose(together[1].mask, alone[0].mask, atol=1e-3)


@pytest.mark.parametrize("looks", ["one", "several"])
def test_what_is_seen_alone_and_heard_alone_is_what_is_seen_and_heard_together(
    scenes: Path, saved: Path, looks: predict.Looks
) -> None:
    model = predict.load_method(saved, device="cpu", looks=looks)
    frames = Dataset(scenes)[tiny_scenes.FIRST].test
    maps, heard = model.class_maps(frames), model.heard(frames)
    for frame, (shown, names) in enumerate(zip(maps, heard, strict=True)):
        answer = model.seen(frames)[frame]
        np.testing.assert_allclose(shown, answer.classes, atol=1e-5)
        np.testing.assert_allclose(names, answer.heard, atol=1e-5)


def test_each_picture_is_decoded_once(scenes: Path, saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames, decoded = Dataset(scenes)[tiny_scenes.FIRST].frames, list[str]()
    assert len(frames) > predict.BATCH
    decode = Frame.rgb
    monkeypatch.setattr(Frame, "rgb", lambda frame: decoded.append(frame.name) or decode(frame))
    found = predict.load_method(saved, device="cpu").predictions(frames)
    assert len(found) == len(frames)
    assert decoded == [frame.name for frame in frames]


def looked_at(model: ListenerMethod, size: int, flipped: bool, looks: predict.Looks) -> Answer:
    """The answer to a random picture and sound, or to both with left and right swapped."""
    rng = np.random.default_rng(7)
    picture = cv2.resize(rng.integers(0, 255, (16, 16, 3), dtype=np.uint8), (size, size))
    sound = rng.normal(0, 0.1, (1, 2, 44_100)).astype(np.float32)
    camera = np.array([[0.5, 0.5, 0.4, 0.5]], np.float32)
    if flipped:
        picture, sound = np.ascontiguousarray(picture[:, ::-1]), np.ascontiguousarray(sound[:, ::-1])
        camera[:, 2] = 1 - camera[:, 2]
    with torch.inference_mode():
        return model.answers([picture], sound, camera, looks=looks)[0]


def test_several_looks_answer_a_mirrored_scene_with_the_mirrored_mask(saved: Path) -> None:
    model = predict.load_method(saved, device="cpu")
    one, other = (looked_at(model, 504, flipped, "several") for flipped in (False, True))
    np.testing.assert_allclose(one.mask, other.mask[:, ::-1], atol=1e-3)
    np.testing.assert_allclose(one.classes, other.classes[..., ::-1], atol=1e-4)
    single, swapped = (looked_at(model, 504, flipped, "one") for flipped in (False, True))
    assert np.abs(single.mask - swapped.mask[:, ::-1]).max() > 0.01


def test_several_looks_are_the_mean_of_their_probabilities_in_the_finest_cells(saved: Path) -> None:
    model = predict.load_method(saved, device="cpu")
    assert looked_at(model, 504, False, "one").mask.shape == (126, 126)
    # A picture is enlarged by half at most, unless it is smaller than the network's own size.
    for size, cells in ((64, 126), (335, 126), (336, 252), (503, 252), (504, 378)):
        assert looked_at(model, size, False, "several").mask.shape == (cells, cells)
    found = looked_at(model, 504, False, "several")
    assert found.classes.shape == (8, 378, 378)
    np.testing.assert_allclose(found.classes.sum(axis=0), 1, atol=1e-4)
    flat = [Answer(np.full((n, n), masks.logit(p), np.float32), np.full((8, n, n), p, np.float32),
                   np.full(7, p, np.float32)) for n, p in ((2, 0.2), (4, 0.6))]  # fmt: skip
    mean = masks.agreed(flat)
    np.testing.assert_allclose(mean.mask, np.full((4, 4), masks.logit(0.4)), atol=1e-4)
    np.testing.assert_allclose(mean.audible, 0.4, atol=1e-6)


def test_a_control_is_what_the_network_hears(saved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = Dataset(tiny.write_dataset(tmp_path / "set"))[tiny.SINGLE].test[0]
    heard: list[np.ndarray] = []
    real = ListenerMethod.answers
    monkeypatch.setattr(ListenerMethod, "answers", lambda *given: heard.append(np.asarray(given[2])) or real(*given))
    for control in ("own", "none", "swapped-ears"):
        model = predict.load_method(saved, device="cpu", hearing=control, looks="one")
        model.predictions([frame])
        np.testing.assert_array_equal(heard[-1][0], predict.clip_of(frame, control))
        assert model.notes.endswith(SAID[control] or "dropped")
    assert not heard[1].any()
    np.testing.assert_array_equal(heard[2], heard[0][:, ::-1])


def test_a_frame_without_sound_is_one_line(saved: Path, tmp_path: Path) -> None:
    root = tiny.write_dataset(tmp_path / "set")
    observation = next(iter(Dataset(root)))
    for path in (observation.path / layout.BINAURAL).iterdir():
        path.unlink()
    model = predict.load_method(saved, device="cpu")
    with pytest.raises(Avs3dError, match=r"audio_clips_binaural") as caught:
        model.predictions(Dataset(root)[observation.key].test)
    assert "\n" not in str(caught.value)
