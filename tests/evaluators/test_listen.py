"""Protocol listen: the figures of part_3, against masks counted by hand, and what no deaf method can do."""

from __future__ import annotations

import json
import shutil
from fractions import Fraction
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from avs3d_bench.contract import layout
from avs3d_bench.contract.scores import (
    ALL_REFERENCES,
    BLIND_REFERENCES,
    LISTEN_REFERENCES,
    ListenObservation,
    Scores,
    SiblingScores,
)
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.measures.deaf_oracles import best_single, can_sound, instance_table
from evaluators.metrics.classes import class_ious, confusion
from evaluators.metrics.masks import frame_counts
from evaluators.metrics.pairs import agrees_better, differ, is_right, pair_accuracy, sibling_scores
from evaluators.protocols import listen
from evaluators.protocols import strict as protocols
from evaluators.references.deaf import DeafOracles
from evaluators.score import evaluate
from evaluators.statistics import bootstrap
from tests.evaluators.test_score import run, submit, true_mask
from tests.support import tiny
from tests.support.shared import SharedDataset
from tests.support.tiny_scenes import AWAY, BOTH, FIRST, GROUP, SECOND, SILENT

FRAMES = 17  # three test frames: 0, 8 and 16; frame 16 looks away


@pytest.fixture(scope="module")
def data(shared_part_3: SharedDataset) -> Path:
    return shared_part_3(frames=FRAMES)


def add_categories(folder: Path, root: Path, predict: Any) -> Path:
    """categories/ of what ``predict(frame)`` gives, beside the masks of a submission."""
    for observation in Dataset(root):
        for frame in observation.test:
            place = folder / observation.key / layout.SUBMISSION_CATEGORIES / f"{frame.name}.png"
            media.write_png_categories(place, predict(frame))
    return folder


def nothing(frame: Frame) -> np.ndarray:
    return np.zeros((tiny.SIZE, tiny.SIZE), bool)


def of(scores: Scores, key: str) -> ListenObservation:
    found = next(one for one in scores.observations if one.key == key).listen
    assert found is not None
    return found


# --- Pairs, counted by hand -------------------------------------------------------------------------------------------


def strip(*pixels: int) -> np.ndarray:
    """A picture of 1×12 with these pixels marked."""
    mask = np.zeros((1, 12), np.uint8)
    mask[0, list(pixels)] = 255
    return mask


def siblings_of(truths: list[list[np.ndarray]], predictions: list[list[np.ndarray]]) -> SiblingScores:
    """The pairs of a group: truths and predictions of each sibling, frame by frame."""
    frames = list(zip(*truths, strict=True))
    marked = list(zip(*predictions, strict=True))
    differing = [
        [(a, b) for a, b in combinations(range(len(truths)), 2) if differ(frame_counts(frame[a], frame[b]))]
        for frame in frames
    ]
    counts = [
        [[frame_counts(truth, mask) for truth in frame] for mask in masks]
        for frame, masks in zip(frames, marked, strict=True)
    ]
    return sibling_scores("g", [f"k{i}" for i in range(len(truths))], differing, counts)


def accuracy(truths: list[list[np.ndarray]], predictions: list[list[np.ndarray]]) -> float | None:
    return pair_accuracy(siblings_of(truths, predictions).pairs)[0]


A, B = strip(0, 1, 2, 3), strip(6, 7, 8, 9)
EMPTY = strip()


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (A, B, True),
        (A, EMPTY, True),
        (EMPTY, EMPTY, False),
        (A, A, False),
        (A, strip(2, 3, 4, 5), True),  # IoU 2/6
        (A, strip(0, 1), False),  # IoU 0.5 is not below 0.5
        (A, strip(0, 1, 2, 3, 4, 5, 6, 7, 8), True),  # IoU 4/9
    ],
)
def test_truths_differ_below_an_iou_of_one_half(first: np.ndarray, second: np.ndarray, expected: bool):
    assert differ(frame_counts(first, second)) == differ(frame_counts(second, first)) == expected


@pytest.mark.parametrize(
    ("marked", "truth", "expected"),
    [
        (A, A, True),
        (strip(0, 1), A, False),  # exactly half is not more than half
        (strip(0, 1, 2), A, True),
        (strip(0, 1, 2, 3, 4, 5, 6), A, True),  # 4/7
        (strip(0, 1, 2, 3, 4, 5, 6, 7), A, False),  # 4/8
        (EMPTY, A, False),
        (EMPTY, EMPTY, True),
        (strip(11), EMPTY, False),
    ],
)
def test_a_prediction_is_right_above_one_half_or_empty_with_the_truth(
    marked: np.ndarray, truth: np.ndarray, expected: bool
):
    assert is_right(frame_counts(truth, marked)) == expected


def test_the_same_answer_can_be_above_one_half_for_both_and_is_still_wrong():
    """The case for which each prediction must agree better with its own truth: |A| = 4, B = A and 5 more pixels."""
    small, large = A, strip(0, 1, 2, 3, 4, 5, 6, 7, 8)
    same = strip(0, 1, 2, 3, 4, 5)
    assert is_right(frame_counts(small, same)), "IoU 4/6"
    assert is_right(frame_counts(large, same)), "IoU 6/9"
    assert not agrees_better(frame_counts(small, same), frame_counts(large, same)), "4/6 is not more than 6/9"
    assert accuracy([[small], [large]], [[same], [same]]) == 0
    assert accuracy([[small], [large]], [[small], [large]]) == 1


def test_every_pair_of_frames_counts_once():
    truths = [[A, A, EMPTY], [B, A, EMPTY], [EMPTY, EMPTY, EMPTY]]
    predictions = [[A, A, EMPTY], [A, A, EMPTY], [EMPTY, strip(3), EMPTY]]
    found = siblings_of(truths, predictions)
    pairs = {(p.first, p.second): (p.right, p.frames) for p in found.pairs}
    # Frame 0: k0 right, k1 wrong, k2 right. Frame 1: k0 and k1 right (and no pair), k2 wrong. Frame 2: no pair.
    assert pairs == {("k0", "k1"): (0, 1), ("k0", "k2"): (1, 2), ("k1", "k2"): (0, 2)}
    assert pair_accuracy(found.pairs) == (1 / 5, 5)


def test_no_frame_of_a_pair_is_no_figure():
    assert accuracy([[A], [A]], [[B], [EMPTY]]) is None
    assert accuracy([[A]], [[A]]) is None


masks = arrays(np.uint8, (2, 4), elements=st.sampled_from([0, 255]))


@st.composite
def groups(draw: st.DrawFn) -> tuple[list[list[np.ndarray]], list[list[np.ndarray]]]:
    """Truths and predictions of 2 to 4 siblings over 1 to 3 frames."""
    siblings, frames = draw(st.integers(2, 4)), draw(st.integers(1, 3))
    rows = st.lists(st.lists(masks, min_size=frames, max_size=frames), min_size=siblings, max_size=siblings)
    return draw(rows), draw(rows)


def iou_of(a: np.ndarray, b: np.ndarray) -> Fraction:
    """In exact numbers; 1 of two empty masks."""
    union = int(((a > 0) | (b > 0)).sum())
    return Fraction(int(((a > 0) & (b > 0)).sum()), union) if union else Fraction(1)


@given(groups())
def test_pair_accuracy_is_what_the_definition_says(case: tuple[list[list[np.ndarray]], list[list[np.ndarray]]]):
    truths, predictions = case
    right = total = 0
    half = Fraction(1, 2)
    for a, b in combinations(range(len(truths)), 2):
        for ta, tb, pa, pb in zip(truths[a], truths[b], predictions[a], predictions[b], strict=True):
            if iou_of(ta, tb) >= half:
                continue
            total += 1
            good = all(
                (iou_of(p, own) > half if own.any() else not p.any()) and iou_of(p, own) > iou_of(p, other)
                for p, own, other in ((pa, ta, tb), (pb, tb, ta))
            )
            right += good
    assert accuracy(truths, predictions) == (right / total if total else None)


@given(groups())
def test_the_same_prediction_for_all_siblings_is_never_right(
    case: tuple[list[list[np.ndarray]], list[list[np.ndarray]]],
):
    truths, predictions = case
    assert accuracy(truths, [predictions[0]] * len(truths)) in (0, None)


@given(groups())
def test_the_truth_is_always_right(case: tuple[list[list[np.ndarray]], list[list[np.ndarray]]]):
    truths, _ = case
    assert accuracy(truths, truths) in (1, None)


@given(groups())
def test_the_order_of_siblings_changes_nothing(case: tuple[list[list[np.ndarray]], list[list[np.ndarray]]]):
    truths, predictions = case
    value = accuracy(truths, predictions)
    assert value == accuracy(truths[::-1], predictions[::-1])
    assert value is None or 0 <= value <= 1


# --- The deaf oracles -------------------------------------------------------------------------------------------------


@given(arrays(np.uint16, (3, 4), elements=st.integers(0, 4)))
def test_a_table_counts_every_pixel_once(ids: np.ndarray):
    labels = (np.arange(12, dtype=np.uint8) % 3).reshape(3, 4)
    table = instance_table(ids, (1, 3), labels, 2)
    assert table.sum() == ids.size
    for row, number in enumerate((1, 3), start=1):
        for label in range(3):
            assert table[row, label] == np.count_nonzero((ids == number) & (labels == label))


@st.composite
def instance_groups(draw: st.DrawFn) -> tuple[list[np.ndarray], list[list[np.ndarray]]]:
    """Instance ids (0 to 3) of 1 to 3 frames, and the truth of 2 to 4 siblings: whichever instances sound."""
    frames, siblings = draw(st.integers(1, 3)), draw(st.integers(2, 4))
    ids = [draw(arrays(np.uint16, (2, 4), elements=st.integers(0, 3))) for _ in range(frames)]
    heard = st.sets(st.integers(1, 3))
    truths = [
        [(np.isin(ids[f], list(draw(heard))) * 255).astype(np.uint8) for f in range(frames)] for _ in range(siblings)
    ]
    return ids, truths


@given(instance_groups())
def test_deaf_oracles_have_no_pair_accuracy(case: tuple[list[np.ndarray], list[list[np.ndarray]]]):
    ids, truths = case
    oracles = DeafOracles({1: 1, 2: 2, 3: 2}, 1)
    for frame, numbers in enumerate(ids):
        oracles.add(numbers, [(truth[frame] > 0).view(np.uint8) for truth in truths])
    for name, rows in oracles.rows().items():
        marked = [(np.isin(numbers, rows) * 255).astype(np.uint8) for numbers in ids]
        assert accuracy(truths, [marked] * len(truths)) in (0, None), name
        for frame, found in enumerate(oracles.counts(rows)):
            assert found == [frame_counts(truth[frame], marked[frame]) for truth in truths]


@given(instance_groups())
def test_the_best_single_instance_is_the_best_of_all(case: tuple[list[np.ndarray], list[list[np.ndarray]]]):
    ids, truths = case
    tables = [instance_table(n, (1, 2, 3), (t[f] > 0).view(np.uint8), 1) for f, n in enumerate(ids) for t in truths]
    visible = [(n, t[f]) for f, n in enumerate(ids) for t in truths if t[f].any()]
    means = [sum(iou_of(n == i, t) for n, t in visible) / len(visible) if visible else 0 for i in (1, 2, 3)]
    chosen = best_single(tables)
    assert (chosen is None) == (not visible)
    if chosen is not None:
        assert float(means[chosen - 1]) == pytest.approx(float(max(means)))


def test_an_oven_cannot_sound(data: Path):
    record = Dataset(data)[FIRST].record
    assert record is not None
    assert [i.id for i in can_sound(record)] == [1, 2, 3]
    silent = record.instances[0].model_copy(update={"category": "oven"})
    assert [i.id for i in can_sound(record.model_copy(update={"instances": (silent, *record.instances[1:])}))] == [2, 3]


# --- Classes ----------------------------------------------------------------------------------------------------------


def test_the_iou_of_a_class_by_hand():
    truth = np.array([[1, 1, 2, 0]], np.uint8)
    marked = np.array([[1, 2, 2, 3]], np.uint8)
    assert class_ious(confusion(truth, marked, 3)) == {1: 1 / 2, 2: 1 / 2, 3: 0.0}
    assert class_ious(confusion(truth * 0, truth * 0, 3)) == {}
    with pytest.raises(Avs3dError, match="class id 3, expected at most 2"):
        confusion(truth, marked, 2)


# --- Intervals --------------------------------------------------------------------------------------------------------


def test_intervals_resample_groups():
    """Values of equal groups: repeating a value within its group says nothing new."""
    values = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.0]
    once = bootstrap.clustered_interval([[v] for v in values])
    assert once == pytest.approx(bootstrap.interval(values))
    assert bootstrap.clustered_interval([[v] * 5 for v in values]) == pytest.approx(once)
    assert bootstrap.clustered_interval([[v, v] for v in values[:5]]) is None, "five groups have none"
    assert bootstrap.clustered_interval([[v, 1 - v] for v in values]) == pytest.approx((0.5, 0.5))
    assert bootstrap.clustered_interval([[v] for v in reversed(values)]) == once


# --- Whole submissions ------------------------------------------------------------------------------------------------


def test_the_truth_is_perfect(data: Path, tmp_path: Path):
    folder = submit(tmp_path / "s", data, true_mask)
    scores = evaluate(add_categories(folder, data, Frame.category_mask), data).scores
    assert scores.avs3d_eval.protocols == {"listen": "1.1"}
    for group in (scores.overall, *scores.parts.values(), *scores.categories.values(), *scores.rooms.values()):
        assert group.listen is not None
        assert group.official is None
        assert group.strict is None
        assert group.listen.pair_accuracy == 1
        assert group.listen.FP_rate == group.listen.FP_area == 0
        assert group.listen.IoU in (1, None)
        assert group.listen.class_mIoU in (1, None)
    assert scores.overall.listen is not None
    assert scores.overall.listen.counts == {
        "twins": 1, "pair_accuracy": 1, "category": 0, "off_screen": 1, "silence": 1, "several": 1,
        "IoU": 3, "FP_rate": 5, "FP_area": 5, "class_mIoU": 3,
    }  # fmt: skip
    assert scores.overall.listen.groups == 1
    assert of(scores, SILENT).unavailable == {
        "IoU": listen.NOTHING_VISIBLE, "class_mIoU": listen.NO_CLASS,
        **dict.fromkeys(("category", "off_screen", "twins"), listen.NO_SUCH_PAIR),
    }  # fmt: skip
    assert of(scores, BOTH).class_IoU == {"microwave": 1.0, "telephone": 1.0}
    assert list(scores.categories) == ["microwave", "telephone"]


def test_figures_are_those_of_the_masks_counted_by_hand(data: Path, tmp_path: Path):
    def shifted(frame: Frame) -> np.ndarray:
        return np.roll(frame.mask(), 1, axis=1) if frame.observation.key != AWAY else np.eye(tiny.SIZE, dtype=bool)

    scores = evaluate(submit(tmp_path / "s", data, shifted), data).scores
    for observation in Dataset(data):
        pairs = [(frame.mask(), shifted(frame)) for frame in observation.test]
        ious = [(g & p).sum() / (g | p).sum() for g, p in pairs if g.any()]
        areas = [p.mean() for g, p in pairs if not g.any()]
        found = of(scores, observation.key)
        assert found.IoU == (pytest.approx(np.mean(ious)) if ious else None)
        assert found.FP_rate == np.mean([area > 0 for area in areas])
        assert found.FP_area == pytest.approx(np.mean(areas))
        assert (found.visible_frames, found.absent_frames) == (len(ious), len(areas))
        assert found.unavailable["class_mIoU"] == listen.NO_CATEGORIES
    assert of(scores, AWAY).FP_rate == 1


def test_a_method_that_confuses_two_siblings_loses_their_pairs_and_no_others(data: Path, tmp_path: Path):
    dataset = Dataset(data)

    def swapped(frame: Frame) -> np.ndarray:
        other = {FIRST: SECOND, SECOND: FIRST}.get(frame.observation.key, frame.observation.key)
        return next(f.mask() for f in dataset[other].test if f.name == frame.name)

    scores = evaluate(submit(tmp_path / "s", data, swapped), data).scores
    (siblings,) = scores.siblings or ()
    for pair in siblings.pairs:
        spoilt = bool({pair.first, pair.second} & {FIRST, SECOND})
        assert pair.right == (0 if spoilt else pair.frames), (pair.first, pair.second)
    total, right = sum(p.frames for p in siblings.pairs), sum(p.right for p in siblings.pairs)
    assert 0 < right < total
    assert scores.overall.listen is not None
    assert scores.overall.listen.pair_accuracy == right / total
    assert of(scores, FIRST).pair_accuracy == 0
    # A category has the pairs in which an observation of the category takes part: AWAY is the one of telephone.
    telephone = scores.categories["telephone"].listen
    involved = [pair for pair in siblings.pairs if AWAY in (pair.first, pair.second)]
    assert telephone is not None
    assert telephone.pair_accuracy == sum(p.right for p in involved) / sum(p.frames for p in involved)
    assert telephone.pair_accuracy == of(scores, AWAY).pair_accuracy


@pytest.mark.parametrize("name", LISTEN_REFERENCES)
def test_reference_rows_are_the_scores_of_such_submissions(data: Path, tmp_path: Path, name: str):
    dataset = Dataset(data)
    single = {}
    for number in (1, 2, 3):
        ious = [
            float(iou_of(frame.instance_ids() == number, frame.mask()))
            for o in dataset
            for frame in o.test
            if frame.mask().any()
        ]
        single[number] = np.mean(ious)
    best = max(single, key=single.__getitem__)

    def predict(frame: Frame) -> np.ndarray:
        if name.startswith("deaf"):
            return np.isin(frame.instance_ids(), (1, 2, 3) if name == "deaf_all" else (best,))
        out = np.full((tiny.SIZE, tiny.SIZE), name == "all_white")
        if name == "centre_box":
            out[16:48, 16:48] = True
        return out

    scores = evaluate(submit(tmp_path / "s", data, predict), data).scores
    assert list(scores.references) == sorted(LISTEN_REFERENCES, key=ALL_REFERENCES.index)
    for part, group in {**scores.parts, "overall": scores.overall}.items():
        assert scores.references[name][part].listen == group.listen
        assert group.listen is not None
        assert group.listen.pair_accuracy == 0


def test_deaf_rows_have_classes_where_the_submission_has(data: Path, tmp_path: Path):
    """The categories of all instances, whatever sounds."""

    def everything(frame: Frame) -> np.ndarray:
        ids = frame.instance_ids()
        return np.where(np.isin(ids, (1, 3)), 4, np.where(ids == 2, 7, 0))

    folder = submit(tmp_path / "s", data, lambda frame: everything(frame) > 0)
    scores = evaluate(add_categories(folder, data, everything), data).scores
    assert scores.overall.listen is not None
    assert scores.overall.listen.class_mIoU is not None
    assert scores.references["deaf_all"]["overall"].listen == scores.overall.listen
    assert scores.references["all_white"]["overall"].listen.class_mIoU is None


def test_siblings_left_out_make_no_pairs(data: Path, tmp_path: Path):
    submission = submit(tmp_path / "s", data, true_mask)
    scores = evaluate(submission, data, only=[FIRST, SILENT]).scores
    (siblings,) = scores.siblings or ()
    assert siblings.observations == (FIRST, SILENT)
    assert len(siblings.pairs) == 1
    alone = evaluate(submission, data, only=[SECOND]).scores
    assert alone.overall.listen is not None
    assert alone.overall.listen.pair_accuracy is None
    assert alone.overall.listen.unavailable["pair_accuracy"] == listen.NO_SIBLING
    pair = evaluate(submission, data, only=[SILENT, AWAY]).scores
    assert of(pair, SILENT).unavailable["pair_accuracy"] == listen.SAME_TRUTHS


def test_the_number_of_processes_changes_nothing(data: Path, tmp_path: Path):
    submission = submit(tmp_path / "s", data, nothing)
    root = tmp_path / "data"
    tiny.clone(data, root)
    one = evaluate(submission, root, workers=1).scores
    assert evaluate(submission, root, workers=2).scores == one


def test_without_records_every_observation_is_alone(data: Path, tmp_path: Path):
    root = tiny.clone(data, tmp_path / "data")
    for key in GROUP:
        (root / key / layout.OBSERVATION_JSON).unlink()
    (root / layout.DATASET_JSON).unlink()
    submission = submit(tmp_path / "s", root, true_mask)
    scores = evaluate(submission, root).scores
    assert scores.overall.listen is not None
    assert scores.overall.listen.IoU == 1
    assert scores.overall.listen.pair_accuracy is None
    assert scores.overall.listen.groups == len(GROUP)
    assert scores.references_unavailable == dict.fromkeys(("deaf_all", "deaf_single"), protocols.NO_INSTANCE_MASKS)


def test_without_instance_masks_there_are_no_deaf_rows(data: Path, tmp_path: Path):
    root = tiny.clone(data, tmp_path / "data")
    for key in GROUP:
        shutil.rmtree(root / key / layout.INSTANCE_MASKS)
    scores = evaluate(submit(tmp_path / "s", root, true_mask), root).scores
    assert scores.overall.listen is not None
    assert scores.overall.listen.pair_accuracy == 1
    assert list(scores.references) == list(BLIND_REFERENCES)
    assert scores.references_unavailable == dict.fromkeys(("deaf_all", "deaf_single"), protocols.NO_INSTANCE_MASKS)


def test_a_group_with_a_bad_mask_has_no_score_and_every_bad_file_is_named(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    submission = submit(tmp_path / "s", data, true_mask)
    for key, name in ((FIRST, "frame_000"), (SILENT, "frame_016")):
        media.write_png_ids(submission / key / "masks" / f"{name}.png", np.full((tiny.SIZE, tiny.SIZE), 7))
    code, said, _ = run(capsys, submission, "--dataset", data, "--workers", 1)
    assert code == 1
    assert f"{FIRST}\n  error   masks/frame_000.png" in said
    assert f"{SILENT}\n  error   masks/frame_016.png" in said


def test_siblings_with_other_test_frames_are_a_damaged_dataset(data: Path, tmp_path: Path):
    submission = submit(tmp_path / "s", data, true_mask)
    root = tiny.clone(data, tmp_path / "data")
    splits = {"train": [f"frame_{i:03d}" for i in range(FRAMES) if i not in (0, 8)], "test": ["frame_000", "frame_008"]}
    tiny.replace(root / SECOND / layout.SPLITS_JSON, json.dumps(splits).encode())
    (submission / SECOND / "masks" / "frame_016.png").unlink()
    with pytest.raises(Avs3dError, match=r"kitchen/2/camera_splits.json: other test frames than part_3/tiny/kitchen/1"):
        evaluate(submission, root)


# --- Which protocol scores what ---------------------------------------------------------------------------------------


def test_a_protocol_that_does_not_fit_the_dataset(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    ours = tiny.write_dataset(tmp_path / "ours", frames=9)
    for root, protocol, parts in ((ours, "listen", "part_1 and part_2"), (data, "strict", "part_3")):
        submission = submit(tmp_path / protocol, root, true_mask)
        code, _, error = run(capsys, submission, "--dataset", root, "--protocol", protocol, "--workers", 1)
        assert code == 2
        assert f"protocol {protocol} scores" in error
        assert f"found only {parts}" in error
        assert error.count("\n") == 1


def test_a_dataset_with_all_parts(data: Path, tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=FRAMES)
    for key in GROUP:
        tiny.clone(data / key, root / key)
    (root / layout.DATASET_JSON).unlink()
    submission = submit(tmp_path / "s", root, true_mask)
    scores = evaluate(submission, root).scores
    assert set(scores.avs3d_eval.protocols) == {"official", "strict", "listen"}
    assert list(scores.parts) == ["part_1", "part_2", "part_3"]
    assert scores.parts["part_3"].strict is None
    assert scores.parts["part_1"].listen is None
    assert scores.overall.strict is not None
    assert scores.overall.strict.IoU == 1
    assert scores.overall.listen is not None
    assert scores.overall.listen.IoU == 1
    assert set(scores.references) == set(ALL_REFERENCES)
    assert set(scores.references["deaf_all"]) == {"part_3", "overall"}
    assert set(scores.references["deaf_category"]) == {"part_1", "part_2", "overall"}
    # A protocol that was asked for leaves out what it does not score.
    alone = evaluate(submission, root, protocols=["listen"]).scores
    assert list(alone.parts) == ["part_3"]
    assert alone.parts["part_3"] == scores.parts["part_3"]
    with pytest.raises(UsageError, match="protocol listen scores part_3; found only part_1, which official and strict"):
        evaluate(submission, root, protocols=["listen"], only=["part_1/*"])


def test_the_terminal_shows_the_figures(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    submission = submit(tmp_path / "s", data, true_mask)
    out = tmp_path / "scores.json"
    code, said, _ = run(capsys, submission, "--dataset", data, "--json", out)
    assert code == 0
    assert "listen" in said
    assert "deaf single" in said
    assert "strict" not in said
    found = json.loads(out.read_text())
    assert found["overall"]["listen"]["pair_accuracy"] == 1
    assert found["siblings"][0]["group"] == FIRST
    assert Scores.model_validate(found).overall.listen is not None


def test_files_of_the_other_parts_have_no_new_keys(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=9)
    evaluation = evaluate(submit(tmp_path / "s", root, true_mask), root)
    media.write_json(tmp_path / "scores.json", evaluation.scores)
    found = json.loads((tmp_path / "scores.json").read_text())
    assert "siblings" not in found
    assert {"listen", "group"}.isdisjoint({*found["overall"], *found["observations"][0]})
