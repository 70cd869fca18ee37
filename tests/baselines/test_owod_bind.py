"""OWOD-BIND: the released selection rule step by step, then the whole baseline from tiny checkpoints on disk."""

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
from avs3d_bench.runtime.provenance import Provenance
from baselines import sound_control
from baselines.cli import baseline
from baselines.networks import pixels
from baselines.networks.sound import check_clip, resample
from baselines.owod_bind import select
from baselines.owod_bind.boxes import MAX_BOXES, detections
from baselines.owod_bind.protocols import Detections
from tests.support import tiny
from tests.support.needs import need
from tests.support.shared import SharedDataset

torch = pytest.importorskip("torch", reason="torch is not installed: the learned baselines cannot run")
need("transformers", reason="transformers is not installed: the learned baselines cannot run")

from baselines.networks.device import enough_memory, pick_device  # noqa: E402
from baselines.owod_bind import run  # noqa: E402
from tests.support import tiny_models, tiny_scenes  # noqa: E402

torch.set_num_threads(1)
CPU = torch.device("cpu")
QUICK = settings(max_examples=60)


def found(*boxes: tuple[float, ...], scores: Any = None) -> Detections:
    """Detections of boxes x0 y0 x1 y1; by default with descending scores from 0.9."""
    scores = [0.9 - 0.01 * i for i in range(len(boxes))] if scores is None else scores
    return Detections(np.array(boxes, dtype=float).reshape(-1, 4), np.array(scores, dtype=float))


def some_detections(at_most: int = 12) -> st.SearchStrategy[Detections]:
    corner = st.floats(-20, 120, allow_nan=False)
    box = st.tuples(corner, corner, corner, corner)
    rows = st.lists(st.tuples(box, st.floats(0, 1)), max_size=at_most)
    return rows.map(lambda rows: found(*(b for b, _ in rows), scores=[s for _, s in rows]))


# ---- boxes


# The rules of the released code, one test each.


def released_boxes(detections: Detections, height: int) -> list[int]:
    """The released loop over detections, its fallback inside; the indices that are kept."""
    kept: list[int] = []
    for i, (box, score) in enumerate(zip(detections.boxes, detections.scores, strict=True)):
        if score > 0.15 and box[2] - box[0] < 0.98 * height and box[3] - box[1] < 0.98 * height:
            kept.append(i)
        if not kept:
            kept.append(0)
    return kept


def test_rule_a_box_needs_a_score_above_0_15_strictly() -> None:
    boxes = found((0, 0, 5, 5), (5, 5, 9, 9), (6, 6, 9, 9), scores=[0.9, 0.15, 0.15001])
    assert select.keep_boxes(boxes, (50, 100)).scores.tolist() == [0.9, 0.15001]


def test_rule_both_sides_must_be_below_0_98_of_the_height() -> None:
    boxes = found((0, 0, 9, 9), (0, 0, 49, 20), (0, 0, 48, 20), (0, 0, 20, 49), (0, 0, 20, 48), (0, 0, 97, 9))
    # 49 of 50 is not below 0.98, for the width neither: the picture is 100 wide, and its height counts.
    assert select.keep_boxes(boxes, (50, 100)).boxes.tolist() == [[0, 0, 9, 9], [0, 0, 48, 20], [0, 0, 20, 48]]


def test_rule_the_first_detection_is_always_a_proposal() -> None:
    """The fallback stands inside the loop: also where later boxes pass, and whatever its score or size."""
    large = select.keep_boxes(found((0, 0, 100, 100), (0, 0, 5, 5)), (100, 100))
    assert large.boxes.tolist() == [[0, 0, 100, 100], [0, 0, 5, 5]]
    faint = select.keep_boxes(found((0, 0, 9, 9), (0, 0, 5, 5), scores=[0.1, 0.1]), (100, 100))
    assert faint.boxes.tolist() == [[0, 0, 9, 9]]
    assert len(select.keep_boxes(found(), (100, 100))) == 0


@QUICK
@given(some_detections())
def test_kept_boxes_are_those_of_the_released_loop(boxes: Detections) -> None:
    kept = select.keep_boxes(boxes, (80, 100))
    expected = boxes.take(np.array(released_boxes(boxes, 80), dtype=np.intp))
    assert (kept.boxes == expected.boxes).all()
    assert (kept.scores == expected.scores).all()


@QUICK
@given(some_detections())
def test_clipped_boxes_lie_inside_and_have_pixels(boxes: Detections) -> None:
    inside = select.clip_boxes(boxes, (80, 100)).boxes
    assert (inside >= 0).all()
    assert (inside <= [100, 80, 100, 80]).all()
    assert (inside[:, 2:] - inside[:, :2] >= 1).all()
    again = select.clip_boxes(Detections(inside, np.ones(len(inside))), (80, 100)).boxes
    assert (again == inside).all()


def test_clipping_drops_what_is_no_number() -> None:
    boxes = found((0, 0, 5, np.nan), (0, 0, 5, 5), (1, 1, 5, 5), scores=[0.9, np.nan, 0.5])
    assert select.clip_boxes(boxes, (9, 9)).boxes.tolist() == [[1, 1, 5, 5]]


def test_suppression_keeps_the_likeliest_of_copies() -> None:
    # Intersection over union with the first: 9/11 and 1/3.
    boxes = found((0, 0, 10, 10), (1, 0, 11, 10), (5, 0, 15, 10), (40, 40, 50, 50), scores=[0.5, 0.9, 0.4, 0.6])
    kept = select.suppress(boxes, iou=0.5, at_most=9)
    assert kept.scores.tolist() == [0.9, 0.6, 0.4]
    assert select.suppress(boxes, iou=0.5, at_most=2).scores.tolist() == [0.9, 0.6]
    assert select.suppress(boxes, iou=0.25, at_most=9).scores.tolist() == [0.9, 0.6]


def iou(a: Any, b: Any) -> float:
    low, high = np.maximum(a[:2], b[:2]), np.minimum(a[2:], b[2:])
    shared = float(np.prod(np.maximum(high - low, 0)))
    both = float(np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2])) - shared
    return shared / both


@QUICK
@given(some_detections())
def test_after_suppression_nothing_overlaps_and_everything_else_did(boxes: Detections) -> None:
    boxes = select.clip_boxes(boxes, (100, 100))
    kept = select.suppress(boxes, iou=0.5, at_most=99)
    for i, box in enumerate(kept.boxes):
        assert all(iou(box, other) <= 0.5 + 1e-9 for other in kept.boxes[:i])
    assert (np.diff(kept.scores) <= 0).all()
    for box, score in zip(boxes.boxes, boxes.scores, strict=True):
        assert any(iou(box, k) > 0.5 - 1e-9 and s >= score for k, s in zip(kept.boxes, kept.scores, strict=True))


def test_owlv2_boxes_are_relative_to_the_longer_side() -> None:
    boxes = np.array([[0.5, 0.25, 0.2, 0.1], [0.5, 0.9, 0.5, 0.1]])
    out = detections(boxes, np.array([0.3, 0.8]), (50, 100))
    # The second lies in the padding below the picture.
    assert out.boxes.tolist() == [[40.0, 20.0, 60.0, 30.0]]
    assert out.scores.tolist() == [0.3]


def test_owlv2_gives_no_more_boxes_than_can_be_compared() -> None:
    rng = np.random.default_rng(0)
    centres = rng.uniform(0.1, 0.9, (500, 2))
    out = detections(np.concatenate([centres, np.full((500, 2), 0.02)], axis=1), rng.uniform(size=500), (400, 400))
    assert len(out) == MAX_BOXES
    assert (np.diff(out.scores) <= 0).all()


# ---- cut-outs


def test_a_cut_out_is_sharp_inside_of_the_mask_and_blurred_outside() -> None:
    picture = np.random.default_rng(1).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    blurred = select.blur(picture)
    mask = np.zeros((60, 80), dtype=bool)
    mask[20:30, 30:50] = True
    crop = select.cut_out(picture, blurred, mask, np.array([24.7, 15.0, 60.2, 40.0]))
    assert crop.shape == (25, 37, 3)
    assert (crop[5:15, 6:26] == picture[20:30, 30:50]).all()
    outside = ~mask[15:40, 24:61]
    assert (crop[outside] == blurred[15:40, 24:61][outside]).all()


def test_the_blur_is_a_gaussian_of_21_pixels() -> None:
    from scipy.stats import norm

    step = np.broadcast_to(np.where(np.arange(61) < 31, 255, 0)[None, :, None], (61, 61, 3)).astype(np.uint8)
    wide = select.blur(step)
    # A step under a Gaussian of σ = 3.5 is its distribution function; 10 pixels away the kernel has ended.
    columns = np.arange(61) - 30.5
    expected = 255 * norm.sf(columns / 3.5)
    assert np.abs(wide[30, :, 0] - expected).max() < 2.0
    assert (wide[30, :20, 0] == 255).all()
    assert (wide[30, 42:, 0] == 0).all()


@QUICK
@given(st.tuples(*[st.floats(-5, 45)] * 4), st.booleans())
def test_every_box_gives_a_crop_with_pixels(box: tuple[float, ...], full: bool) -> None:
    picture = np.full((30, 40, 3), 7, dtype=np.uint8)
    crop = select.cut_out(picture, select.blur(picture), np.full((30, 40), full), np.array(box))
    assert min(crop.shape) >= 1
    assert (crop == 7).all()


# ---- scores

LOGITS = arrays(np.float64, st.integers(1, 12), elements=st.floats(-500, 500))


@QUICK
@given(LOGITS, st.floats(-1e3, 1e3))
def test_softmax_sums_to_one_ranks_like_the_logits_and_ignores_an_offset(logits: Any, offset: float) -> None:
    scores = select.softmax(logits)
    assert scores.sum() == pytest.approx(1.0)
    assert (scores >= 0).all()
    assert (np.diff(scores[np.argsort(logits)]) >= 0).all()
    np.testing.assert_allclose(select.softmax(logits + offset), scores, atol=1e-9)


def test_softmax_with_the_released_scale() -> None:
    # Cosines 0.30 and 0.25, times 20: e^(20 · 0.05) = e, so 1/(1 + e) is the share of the second.
    scores = select.softmax(select.AUDIO_LOGIT_SCALE * np.array([0.30, 0.25]))
    np.testing.assert_allclose(scores, [1 / (1 + np.exp(-1)), 1 / (1 + np.e)], rtol=1e-12)
    assert select.choose(scores).tolist() == [True, True]
    # 0.10 apart it is 0.119, below 0.2.
    assert select.choose(select.softmax(np.array([6.0, 4.0]))).tolist() == [True, False]


def test_rule_scores_are_a_softmax_over_the_proposals_of_the_frame_and_0_2_is_strict() -> None:
    assert select.choose(select.softmax(np.array([6.0, 4.0]))).tolist() == [True, False]
    assert select.choose(np.array([0.2, 0.2000001, 0.4, 0.1999999])).tolist() == [False, True, True, False]


@QUICK
@given(LOGITS)
def test_rule_at_most_four_proposals_stay_and_a_lone_one_always(logits: Any) -> None:
    keep = select.choose(select.softmax(logits))
    assert keep.sum() <= 4
    if len(logits) == 1:
        assert keep.all()


def test_rule_nothing_above_the_threshold_leaves_nothing() -> None:
    assert select.choose(select.softmax(np.zeros(4))).all()
    assert not select.choose(select.softmax(np.zeros(5))).any()
    assert not select.choose(np.full(5, 0.2)).any()


def test_a_network_that_gives_nan_is_an_error() -> None:
    with pytest.raises(Avs3dError, match="not finite"):
        select.softmax(np.array([0.0, np.nan]))


@QUICK
@given(arrays(np.bool_, st.tuples(st.integers(0, 4), st.just(3), st.just(5))))
def test_the_union_holds_every_mask_and_nothing_else(masks: Any) -> None:
    joined = select.union(masks, (3, 5))
    assert joined.shape == (3, 5)
    assert (joined == (masks.sum(axis=0) > 0)).all()


# ---- sound and pictures for the networks


@pytest.mark.parametrize("target", [16_000, 48_000, 44_100])
def test_resampling_keeps_a_tone_and_the_duration(target: int) -> None:
    seconds = np.arange(88_200) / 44_100
    out = resample(np.sin(2 * np.pi * 1000 * seconds).astype(np.float32), 44_100, target)
    assert out.dtype == np.float32
    assert len(out) == 2 * target
    expected = np.sin(2 * np.pi * 1000 * np.arange(2 * target) / target)
    middle = slice(target // 10, -target // 10)
    assert np.abs(out - expected)[middle].max() < 2e-3


def test_an_empty_or_broken_clip_is_an_error() -> None:
    with pytest.raises(Avs3dError, match="here: the mono clip is empty"):
        check_clip(np.zeros(0, dtype=np.float32), "here")
    with pytest.raises(Avs3dError, match="NaN"):
        check_clip(np.array([0, np.nan], dtype=np.float32), "here")


def test_pictures_for_networks() -> None:
    assert pixels.shorter_side((1008, 1008), 224) == (224, 224)
    assert pixels.shorter_side((300, 700), 224) == (224, 522)
    assert pixels.shorter_side((700, 300), 224) == (522, 224)
    picture = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    assert (pixels.centre_crop(picture, 2) == picture[1:3, 2:4]).all()
    out = pixels.normalise(picture, (0.5, 0, 0), (0.5, 1, 1))
    assert out.shape == (3, 4, 6)
    assert out.dtype == np.float32
    assert out[0, 0, 0] == -1.0
    assert out[2, 3, 5] == pytest.approx(71 / 255)
    assert (pixels.resize(np.full((9, 5, 3), 77, np.uint8), (4, 7)) == 77).all()


# ---- the device


def test_a_gpu_that_is_not_there_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert pick_device().type == "cpu"
    with pytest.raises(UsageError, match=r"device 'cuda': no CUDA device here .* use --device cpu"):
        pick_device("cuda")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    assert pick_device("cuda:1").index == 1
    with pytest.raises(UsageError, match="only 2 CUDA devices here, the last is cuda:1"):
        pick_device("cuda:2")
    for name in ("tpu", "meta", "cuda:x"):
        with pytest.raises(UsageError, match="expected cpu, cuda or"):
            pick_device(name)


@pytest.mark.parametrize(
    "error", [torch.OutOfMemoryError("CUDA out of memory"), MemoryError(), RuntimeError("can't allocate memory: 9 TB")]
)
def test_too_little_memory_is_one_line(error: Exception) -> None:
    with pytest.raises(Avs3dError, match=r"^frame_007: too little memory on cpu"), enough_memory(CPU, "frame_007"):
        raise error
    with pytest.raises(RuntimeError, match="shapes"), enough_memory(CPU, "frame_007"):
        raise RuntimeError("shapes do not fit")


# ---- the whole baseline


@pytest.fixture(scope="module")
def root(shared_dataset: SharedDataset) -> Path:
    return shared_dataset()


@pytest.fixture(scope="module")
def patch() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        tiny_models.use_vit_tower(patch)
        yield patch


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory, patch: pytest.MonkeyPatch) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("checkpoints")
    return {
        "boxes_checkpoint": tiny_models.write_owlv2(folder / "owlv2"),
        "sam_checkpoint": tiny_models.write_sam(folder / "sam"),
        "similarity_checkpoint": tiny_models.write_pe_av(folder / "pe-av"),
    }


@pytest.fixture(scope="module")
def model(folders: dict[str, Path]) -> run.OwodBind:
    return run.load_owod_bind(similarity="pe-av", device="cpu", **folders)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device: masks are compared on the CPU alone")
def test_a_gpu_gives_the_masks_of_the_cpu(root: Path, folders: dict[str, Path], model: run.OwodBind) -> None:
    gpu = run.load_owod_bind(similarity="pe-av", device="cuda", **folders)
    frame = Dataset(root)[tiny.SINGLE].test[0]
    picture, boxes = frame.rgb(), model.boxes.propose([frame.rgb()])[0]
    np.testing.assert_allclose(gpu.boxes.propose([picture])[0].boxes, boxes.boxes, atol=0.05)
    differ = gpu.masks.segment(picture, boxes.boxes) != model.masks.segment(picture, boxes.boxes)
    assert differ.mean() < 0.02
    logits = [m.similarity.logits([picture, picture[:20]], frame.mono(), layout.SAMPLE_RATE) for m in (gpu, model)]
    np.testing.assert_allclose(*logits, rtol=0.02, atol=0.02)
    assert gpu(frame).shape == model(frame).shape


class Squares:
    """Boxes, masks and similarities that are known: a left and a right square; the clip's level chooses."""

    name = "squares"

    def __init__(self, *boxes: tuple[float, ...], logits: tuple[float, ...] = (0.0, 10.0)) -> None:
        self.found, self.values = found(*boxes), logits
        self.crops: list[Any] = []
        self.clips: list[Any] = []

    def propose(self, pictures: Any) -> list[Detections]:
        return [self.found for _ in pictures]

    def segment(self, picture: Any, boxes: Any) -> Any:
        masks = np.zeros((len(boxes), *picture.shape[:2]), dtype=bool)
        for mask, (x0, y0, x1, y1) in zip(masks, boxes.astype(int), strict=True):
            mask[y0:y1, x0:x1] = True
        return masks

    def logits(self, crops: Any, clip: Any, rate: int) -> Any:
        self.crops, self.clips = list(crops), [*self.clips, (clip, rate)]
        return np.array(self.values[: len(crops)])


LEFT, RIGHT, ALL = (4, 8, 20, 30), (40, 8, 60, 30), (0, 0, 64, 64)


def with_squares(squares: Squares) -> run.OwodBind:
    return run.OwodBind(squares, squares, squares, CPU)


def test_the_mask_is_that_of_the_object_that_fits_the_sound(root: Path) -> None:
    squares = Squares(LEFT, ALL, RIGHT)
    frame = Dataset(root)[tiny.SINGLE].test[0]
    mask = with_squares(squares)(frame)
    expected = np.zeros((64, 64), dtype=bool)
    expected[8:30, 40:60] = True
    assert (mask == expected).all()
    # The box around everything was never shown; the others were cut out of this frame's picture.
    assert [crop.shape for crop in squares.crops] == [(22, 16, 3), (22, 20, 3)]
    assert (squares.crops[1] == frame.rgb()[8:30, 40:60]).all()
    ((clip, rate),) = squares.clips
    assert rate == layout.SAMPLE_RATE
    assert (clip == frame.mono()).all()


def test_rule_the_mask_is_the_union_of_the_kept_masks(root: Path) -> None:
    frame = Dataset(root)[tiny.SINGLE].test[0]
    assert with_squares(Squares(LEFT, RIGHT, logits=(3.0, 3.0)))(frame).sum() == 22 * 36


def test_rule_an_empty_mask_is_written_where_nothing_passes_or_nothing_is_detected(root: Path, tmp_path: Path) -> None:
    """The released code writes no file for a frame without a detection; the package's docstring says why we do."""
    five = [(4 * i, 8, 4 * i + 3, 30) for i in range(5)]
    for name, squares in (("alike", Squares(*five, logits=(1.0,) * 5)), ("none", Squares())):
        frame = Dataset(root)[tiny.SINGLE].test[0]
        assert not with_squares(squares)(frame).any()
        for split, folder in (("test", "submission"), ("train", "masks")):
            target = tmp_path / name / folder
            if split == "test":
                run.write_owod_bind(Dataset(root), target, with_squares(squares))
            else:
                run.write_mask_folder(Dataset(root), target, with_squares(squares))
            masks = [media.read_png_mask(path) for path in target.rglob("*.png")]
            assert len(masks) == sum(len(getattr(o, split)) for o in Dataset(root))
            assert not any(mask.any() for mask in masks)


def test_digital_silence_gives_an_empty_mask_without_asking_for_similarity(tmp_path: Path) -> None:
    class Refusing(Squares):
        def logits(self, *_: Any) -> Any:
            raise AssertionError("asked")

    dataset = Dataset(tiny_scenes.write_part_3(tmp_path / "data", frames=9))
    model = with_squares(Refusing(LEFT))
    assert not any(mask.any() for mask in model.masks_of(dataset[tiny_scenes.SILENT].test))


def test_a_control_of_sound_reaches_the_similarity_and_the_name(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, *_, last = Dataset(root)
    frame, other, squares = first.test[0], last.test[0], Squares(LEFT)
    monkeypatch.setattr(sound_control, "other_frame", lambda *_, **__: other)
    controls: dict[sound_control.SoundControl, Frame] = {"own": frame, "swapped-ears": frame, "other-category": other}
    for control, heard in controls.items():
        model = replace(with_squares(squares), hearing=control)
        model(frame)
        np.testing.assert_array_equal(squares.clips[-1][0], heard.mono())
    assert model.method.endswith(", heard another category")
    assert model.notes == f"{replace(model, hearing='own').notes}; heard another category"
    asked = len(squares.clips)
    assert not replace(model, hearing="none")(frame).any()
    assert len(squares.clips) == asked


def test_the_command_hears_nothing_and_its_submission_says_so(
    root: Path, tmp_path: Path, folders: dict[str, Path]
) -> None:
    options = [f"--{name.replace('_', '-')}={folder}" for name, folder in folders.items()]
    arguments = ["owod-bind", "--dataset", str(root), "--only", tiny.SINGLE, "--similarity", "pe-av", "--device", "cpu"]
    out = tmp_path / "out"
    result = CliRunner().invoke(baseline, [*arguments, *options, "--sound", "none", "-o", str(out)])
    assert result.exit_code == 0, result.output
    assert not any(media.read_png_mask(path).any() for path in out.rglob("*.png"))
    record = read_json(out / "submission.json")
    assert record["method"] == "OWOD-BIND (OWLv2 objectness, SAM, PE-AV), heard nothing"
    assert "; heard nothing; only " in record["notes"]


def test_echosegnet_keeps_the_masks_of_each_control_apart_in_one_folder_of_work(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One run after the other, as docs/results-choice.md does it; submissions name the masks alike."""
    runs: list[Any] = []
    monkeypatch.setattr(run, "load_owod_bind", lambda **_: with_squares(Squares(LEFT, RIGHT)))

    def keep(dataset: Dataset, path: Path, source: Any, how: Any, **_: Any) -> Any:
        runs.append((source.name, how.sound, source.mask(dataset[tiny.SINGLE].train[0]).any()))
        raise Avs3dError("enough")

    monkeypatch.setattr("baselines.echosegnet.run.write_echosegnet", keep)
    arguments = ["echosegnet", "--dataset", str(root), "--only", tiny.SINGLE, "--masks", "owod-bind", "--device", "cpu"]
    for sound in ("own", "none"):
        more = ["--work", str(tmp_path / "work"), "--sound", sound, "-o", str(tmp_path / sound)]
        result = CliRunner().invoke(baseline, [*arguments, *more])
        assert str(result.exception) == "enough", result.output
    assert runs == [("owod-bind", "own", True), ("owod-bind", "none", False)]


def test_settings_outside_of_0_and_1_are_refused() -> None:
    squares = Squares()
    with pytest.raises(UsageError, match=r"threshold 1\.5: expected a number from 0 to 1"):
        run.OwodBind(squares, squares, squares, CPU, threshold=1.5)


@pytest.mark.slow
def test_a_frame_without_sound_is_named(root: Path, tmp_path: Path, model: run.OwodBind) -> None:
    copy = tiny.clone(root, tmp_path / "x")
    (copy / tiny.SINGLE / layout.audio_path(layout.MONO, 8)).unlink()
    with pytest.raises(Avs3dError, match=r"audio_clips_mono/frame_8\.wav: missing"):
        run.write_owod_bind(Dataset(copy), tmp_path / "out", model)
    assert not (tmp_path / "out").exists()


def test_a_nan_of_the_network_names_the_frame(root: Path) -> None:
    frame = Dataset(root)[tiny.SINGLE].test[0]
    with pytest.raises(Avs3dError, match=r"kitchen/1/frame_000: the similarity network gave"):
        with_squares(Squares(LEFT, RIGHT, logits=(np.nan, 0.0)))(frame)


@pytest.mark.slow
def test_networks_from_disk_give_boxes_masks_and_logits(root: Path, model: run.OwodBind) -> None:
    frame = Dataset(root)[tiny.SINGLE].test[0]
    picture = frame.rgb()
    (boxes,) = model.boxes.propose([picture])
    assert len(boxes) >= 2
    assert (boxes.boxes >= 0).all()
    assert (boxes.boxes <= 64).all()
    masks = model.masks.segment(picture, boxes.boxes)
    assert masks.shape == (len(boxes), 64, 64)
    assert masks.dtype == np.bool_
    # One mask for each box, each from its own box.
    alone = model.masks.segment(picture, boxes.boxes[1:2])
    assert (alone[0] != masks[1]).mean() < 1e-3
    crops = [picture[:20, :30], picture[30:, 10:], picture[5:9]]
    logits = model.similarity.logits(crops, frame.mono(), layout.SAMPLE_RATE)
    assert logits.shape == (3,)
    assert len(set(logits.round(9))) == 3
    swapped = model.similarity.logits(crops[::-1], frame.mono(), layout.SAMPLE_RATE)
    np.testing.assert_allclose(swapped, logits[::-1], rtol=1e-4)
    other = Dataset(root)[tiny.SINGLE].test[1].mono()
    assert np.abs(model.similarity.logits(crops, other, layout.SAMPLE_RATE) - logits).max() > 1e-9


def test_sam_takes_many_boxes_in_parts(root: Path, model: run.OwodBind) -> None:
    picture = Dataset(root)[tiny.SINGLE].test[0].rgb()
    boxes = np.array([[i, i, i + 20.0, i + 30.0] for i in range(19)])
    masks = model.masks.segment(picture, boxes)
    assert masks.shape == (19, 64, 64)
    assert (model.masks.segment(picture, boxes[17:18])[0] != masks[17]).mean() < 1e-3
    assert model.masks.segment(picture, boxes[:0]).shape == (0, 64, 64)


def test_sam_agrees_with_the_library_used_the_plain_way(
    root: Path, model: run.OwodBind, folders: dict[str, Path]
) -> None:
    from transformers import SamImageProcessorPil, SamModel, SamProcessor

    picture = Dataset(root)[tiny.SINGLE].test[0].rgb()[:40]
    box = [10.0, 5.0, 50.0, 30.0]
    processor = SamProcessor(SamImageProcessorPil.from_pretrained(folders["sam_checkpoint"]))
    inputs = processor(images=picture, input_boxes=[[box]], return_tensors="pt")
    sizes = inputs.pop("original_sizes"), inputs.pop("reshaped_input_sizes")
    with torch.no_grad():
        low = SamModel.from_pretrained(folders["sam_checkpoint"])(
            pixel_values=inputs["pixel_values"], input_boxes=inputs["input_boxes"].float(), multimask_output=False
        ).pred_masks
    (expected,) = processor.post_process_masks(low, *sizes)
    mask = model.masks.segment(picture, np.array([box]))
    assert mask.shape == (1, 40, 64)
    assert (mask[0] == expected[0, 0].numpy()).all()


@pytest.mark.slow
def test_a_still_is_a_video_of_equal_frames(root: Path, folders: dict[str, Path], model: run.OwodBind) -> None:
    from transformers import PeAudioFeatureExtractor, PeAudioVideoModel

    frame = Dataset(root)[tiny.SINGLE].test[0]
    crops = [frame.rgb()[:30], frame.rgb()[20:60, :50]]
    whole = PeAudioVideoModel.from_pretrained(folders["similarity_checkpoint"]).eval()
    still = model.similarity._still  # type: ignore[attr-defined]
    video = torch.from_numpy(np.stack([still.pixels(crop) for crop in crops]))[:, None].repeat(1, 16, 1, 1, 1)
    sound = PeAudioFeatureExtractor()(resample(frame.mono(), 44_100, 48_000), sampling_rate=48_000, return_tensors="pt")
    with torch.no_grad():
        out = whole(
            pixel_values_videos=video,
            input_values=sound["input_values"].repeat(2, 1, 1),
            padding_mask=sound["padding_mask"].repeat(2, 1),
        )
    expected = (out.logits_audio_video[0] - whole.audio_video_logit_bias).detach().numpy()
    logits = model.similarity.logits(crops, frame.mono(), layout.SAMPLE_RATE)
    np.testing.assert_allclose(logits, expected, rtol=1e-3, atol=1e-5)


def test_pe_av_with_the_vision_tower_of_timm(tmp_path: Path, root: Path) -> None:
    pytest.importorskip(
        "timm", reason="timm is not installed: PE-AV's own vision tower cannot be made", exc_type=Exception
    )
    from baselines.owod_bind.pe_av import PeAvSimilarity

    size = {"img_size": tiny_models.SIDE, "depth": 1, "embed_dim": 64, "num_heads": 2}
    tower = {"model_type": "timm_wrapper", "architecture": "vit_pe_core_large_patch14_336", "num_classes": 16,
             "do_pooling": True, "global_pool": "map", "initializer_range": 0.02, "model_args": size}  # fmt: skip
    similarity = PeAvSimilarity(tiny_models.write_pe_av(tmp_path / "x", tower), CPU)
    frame = Dataset(root)[tiny.SINGLE].test[0]
    logits = similarity.logits([frame.rgb(), frame.rgb()[:20]], frame.mono(), layout.SAMPLE_RATE)
    assert np.isfinite(logits).all()
    assert logits[0] != logits[1]


def test_the_submission_is_whole_and_comes_from_pictures_and_mono_clips_alone(
    root: Path, tmp_path: Path, model: run.OwodBind
) -> None:
    writer = run.write_owod_bind(Dataset(root), tmp_path / "a", model)
    assert writer.record.method == "OWOD-BIND (OWLv2 objectness, SAM, PE-AV)"
    assert "softmax over the proposals is > 0.2; checkpoints owlv2, sam, pe-av" in (writer.record.notes or "")
    masks = sorted(p.relative_to(tmp_path / "a").as_posix() for p in (tmp_path / "a").rglob("*.png"))
    assert masks == [f"{key}/masks/frame_00{i}.png" for key in (tiny.SINGLE, tiny.MULTI) for i in (0, 8)]
    assert any(media.read_png_mask(tmp_path / "a" / mask).any() for mask in masks)
    # Without any truth, and without the train frames, the same bytes.
    bare = tmp_path / "bare"
    shutil.copytree(root, bare)
    for key in (tiny.SINGLE, tiny.MULTI):
        for folder in ("semantic_masks", "instance_masks", "gt_3d", "sparse", "audio_clips_binaural", "images"):
            shutil.rmtree(bare / key / folder)
        (bare / key / "observation.json").unlink()
        for path in (bare / key).glob("audio_clips_mono/frame_[1-7].wav"):
            path.unlink()
    run.write_owod_bind(Dataset(bare), tmp_path / "b", model)
    for mask in masks:
        assert (tmp_path / "a" / mask).read_bytes() == (tmp_path / "b" / mask).read_bytes()


@pytest.mark.slow
def test_a_folder_of_train_masks_is_written_and_taken_up_again(
    root: Path, tmp_path: Path, model: run.OwodBind, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset, out = Dataset(root), tmp_path / "masks"
    assert run.write_mask_folder(dataset, out, model, only=[tiny.SINGLE]) == 8
    files = sorted(p.relative_to(out).as_posix() for p in out.rglob("*.png"))
    assert files == [f"{tiny.SINGLE}/{frame.name}.png" for frame in dataset[tiny.SINGLE].train]
    frame = dataset[tiny.SINGLE].train[3]
    assert (media.read_png_mask(out / tiny.SINGLE / f"{frame.name}.png") == model(frame)).all()
    (out / files[2]).unlink()
    before = (out / files[0]).stat().st_mtime_ns
    assert run.write_mask_folder(dataset, out, model) == 1 + 8
    assert (out / files[0]).stat().st_mtime_ns == before
    other = run.OwodBind(model.boxes, model.masks, model.similarity, CPU, threshold=0.3)
    for changed in (other, replace(model, hearing="none")):
        with pytest.raises(UsageError, match="holds masks made with other settings"):
            run.write_mask_folder(dataset, out, changed)
    clone = tiny.clone(root, tmp_path / "clone")
    tiny.replace(clone / "dataset.json", (clone / "dataset.json").read_bytes() + b"\n")
    with pytest.raises(UsageError, match="other settings, software or data"):
        run.write_mask_folder(Dataset(clone), out, model)
    monkeypatch.setattr(run, "provenance", lambda *_: Provenance({}, {}, "0"))
    with pytest.raises(UsageError, match="other settings, software or data"):
        run.write_mask_folder(dataset, out, model)


def test_a_folder_that_holds_something_else_is_left_alone(root: Path, tmp_path: Path, model: run.OwodBind) -> None:
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "thesis.txt").write_text("mine")
    with pytest.raises(UsageError, match="not empty and no folder of masks"):
        run.write_mask_folder(Dataset(root), tmp_path / "x", model)
    assert [p.name for p in (tmp_path / "x").iterdir()] == ["thesis.txt"]
    with pytest.raises(UsageError, match="no observation matches nothing"):
        run.write_mask_folder(Dataset(root), tmp_path / "y", model, only=["nothing"])


def test_what_is_missing_is_said_before_anything_is_loaded(
    folders: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from baselines.owod_bind import boxes

    monkeypatch.setattr(boxes.Owlv2Boxes, "__init__", lambda *_: pytest.fail("a network was loaded"))
    with pytest.raises(Avs3dError, match=r"no folder with the checkpoint of PE-AV; put config\.json"):
        run.load_owod_bind(similarity="pe-av", **{**folders, "similarity_checkpoint": tmp_path / "none"})
    with pytest.raises(UsageError, match="no folder with the checkpoint of SAM: make one"):
        run.load_owod_bind(similarity="pe-av", **{**folders, "sam_checkpoint": None})
    with pytest.raises(UsageError, match="no network 'clip': expected one of imagebind, pe-av"):
        run.load_owod_bind(similarity="clip", **folders)  # type: ignore[arg-type]


def test_pe_av_without_its_video_settings_is_one_line(folders: dict[str, Path], tmp_path: Path) -> None:
    from baselines.owod_bind.pe_av import PeAvSimilarity

    shutil.copytree(folders["similarity_checkpoint"], tmp_path / "x")
    (tmp_path / "x" / "video_preprocessor_config.json").unlink()
    with pytest.raises(Avs3dError, match="cannot load the checkpoint of PE-AV: ValueError: no 'size' in video_prep"):
        PeAvSimilarity(tmp_path / "x", CPU)


# ---- ImageBind and MAVL, through stand-ins for their packages


def test_imagebind_gives_twenty_times_the_cosine(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from baselines.owod_bind.imagebind import ImageBindSimilarity, prepare

    tiny_models.install_imagebind(monkeypatch)
    similarity = ImageBindSimilarity(tiny_models.write_imagebind(tmp_path), CPU)
    frame = Dataset(root)[tiny.SINGLE].test[0]
    crops = [frame.rgb(), frame.rgb()[:20], frame.rgb()[:, :9]]
    clip = frame.mono()
    kept = clip.copy()
    logits = similarity.logits(crops, clip, layout.SAMPLE_RATE)
    assert (clip == kept).all()
    # The package changes the waveform in place; a clip that has its rate already is not resampled.
    low = resample(clip, 44_100, 16_000)
    kept = low.copy()
    np.testing.assert_allclose(similarity.logits(crops, low, 16_000), logits, rtol=1e-6)
    assert (low == kept).all()
    # As the released code has it: the product of the network's two outputs.
    network = tiny_models.TinyImageBind()
    network.load_state_dict(torch.load(tmp_path / "imagebind_huge.pth", weights_only=True))
    mel = tiny_models._mel(torch.from_numpy(resample(clip, 44_100, 16_000).copy())[None], 16_000, 128, 204)
    three_clips = ((mel + 4.268) / 9.138).expand(1, 3, 1, 128, 204)
    with torch.no_grad():
        out = network({"vision": torch.from_numpy(np.stack([prepare(c) for c in crops])), "audio": three_clips})
    np.testing.assert_allclose(logits, (out["vision"] @ out["audio"].T)[:, 0].numpy(), rtol=1e-4)
    assert np.abs(logits).max() <= 20.0


def test_imagebind_is_taken_where_it_is_installed(
    folders: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if run.has_package("imagebind"):
        pytest.skip("imagebind is installed: its absence cannot be seen")
    assert run.load_owod_bind(**folders).similarity.name == "PE-AV"
    tiny_models.install_imagebind(monkeypatch)
    with_imagebind = {**folders, "similarity_checkpoint": tiny_models.write_imagebind(tmp_path)}
    assert run.load_owod_bind(**with_imagebind).similarity.name == "ImageBind"


def test_broken_imagebind_weights_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from baselines.owod_bind.imagebind import ImageBindSimilarity

    tiny_models.install_imagebind(monkeypatch)
    tiny_models.write_imagebind(tmp_path)
    path = tmp_path / "imagebind_huge.pth"
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(Avs3dError, match=r"cannot load the checkpoint of ImageBind: .*; put imagebind_huge\.pth there"):
        ImageBindSimilarity(tmp_path, CPU)
    torch.save({"vision.weight": torch.zeros(2)}, path)
    with pytest.raises(Avs3dError, match="cannot load the checkpoint of ImageBind: RuntimeError"):
        ImageBindSimilarity(tmp_path, CPU)


def test_mavl_boxes_come_in_pixels_without_copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from baselines.owod_bind.mavl import MavlBoxes

    tiny_models.install_mavl(monkeypatch)
    boxes = MavlBoxes(tiny_models.write_mavl(tmp_path), CPU)
    one, two = boxes.propose([np.zeros((40, 60, 3), np.uint8), np.zeros((100, 100, 3), np.uint8)])
    np.testing.assert_allclose(one.boxes, [[24, 8, 36, 12], [0, 0, 60, 40]], atol=1e-4)
    np.testing.assert_allclose(one.scores, [0.9, 0.7], atol=1e-6)
    np.testing.assert_allclose(two.boxes[0], [40, 20, 60, 30], atol=1e-4)
    assert select.keep_boxes(one, (40, 60)).scores == pytest.approx([0.9])
