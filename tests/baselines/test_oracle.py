"""The oracle and its errors: each error has its stated effect, and depends only on the seed and the names."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.cli import avs3d
from avs3d_bench.contract.schema import SubmissionRecord
from avs3d_bench.contract.taxonomy import CATEGORIES, DISTRACTORS
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import UsageError
from avs3d_bench.formats import media
from baselines.oracle import POINTS_PER_CM2, oracle_mask, oracle_points, write_oracle
from baselines.oracle_errors import CONFUSABLE, ErrorModel, move_outline
from tests.support import tiny
from tests.support.homes import tree_digest
from tests.support.shared import SharedDataset

RATES = st.floats(0, 1)
SEEDS = st.integers(0, 2**63)
NAMES = st.sampled_from([f"frame_{i:03d}" for i in range(20)])
#: In the tiny dataset part_2 has the sounding microwave 2 and its silent twin 1; part_1 has microwave 1 and the oven 2.
TWIN, SOUNDING, OVEN = 1, 2, 2


@pytest.fixture(scope="module")
def dataset(shared_dataset: SharedDataset) -> Dataset:
    return Dataset(shared_dataset())


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return Dataset(tiny.write_release(tmp_path_factory.mktemp("data") / "release"))


def run(*arguments: object) -> str:
    result = CliRunner().invoke(avs3d, ["baseline", "oracle", *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def frames(dataset: Dataset, key: str) -> tuple[Frame, ...]:
    """All frames, test and train."""
    return dataset[key].frames


# Without errors


@pytest.mark.parametrize("key", [tiny.SINGLE, tiny.MULTI])
def test_sounding_is_the_truth_in_every_frame(dataset: Dataset, release: Dataset, key: str):
    for frame in (*frames(dataset, key), *frames(release, key)):
        np.testing.assert_array_equal(oracle_mask(frame, instance="sounding"), frame.mask())


@pytest.mark.parametrize("key", [tiny.SINGLE, tiny.MULTI])
def test_category_is_the_union_of_the_visible_pixels_of_its_instances(dataset: Dataset, key: str):
    alone = []
    for frame in frames(dataset, key):
        mask = oracle_mask(frame, instance="category")
        np.testing.assert_array_equal(mask, np.isin(frame.instance_ids(), [1, 2] if key == tiny.MULTI else [1]))
        assert mask[frame.mask()].all()
        alone.append(bool(np.array_equal(mask, frame.mask())))
    # With one instance there is nothing to choose; with two it makes a difference.
    assert all(alone) == (key == tiny.SINGLE)


def test_submissions_of_it_are_whole(dataset: Dataset, tmp_path: Path):
    said = run("--dataset", dataset.root, "-o", tmp_path / "mine", "--workers", 1)
    assert said == f"{tmp_path / 'mine'}: 4 masks of 2 observations: oracle (category)\n"
    for observation in dataset:
        for frame in observation.test:
            written = media.read_png_mask(tmp_path / "mine" / observation.key / "masks" / f"{frame.name}.png")
            np.testing.assert_array_equal(written, oracle_mask(frame, instance="category"))


def test_it_says_what_it_looks_at_and_every_setting(dataset: Dataset, tmp_path: Path):
    run("--dataset", dataset.root, "-o", tmp_path / "a", "--instance", "sounding", "--drop", 0.25, "--swap", 0.5,
        "--dilate", -3, "--confuse", 1, "--seed", 7, "--only", "part_2/*", "--workers", 1)  # fmt: skip
    record = media.read_record(tmp_path / "a" / "submission.json", SubmissionRecord)
    assert record.truth == "masks of test frames"
    assert record.method == "oracle (sounding, drop 0.25, swap 0.5, dilate -3, confuse 1)"
    for words in ("uses the ground truth of test frames", "instance sounding", "drop 0.25, swap 0.5, dilate -3, "
                  "confuse 1, seed 7", "points none", "only part_2/*"):  # fmt: skip
        assert words in (record.notes or "")
    assert "GROUND TRUTH OF TEST FRAMES" in run("--help")


# Decisions: from the seed and the names, nothing else


@given(SEEDS, RATES, RATES, NAMES)
def test_with_a_higher_probability_the_same_frames_fail_and_more(seed: int, one: float, other: float, name: str):
    low, high = sorted((one, other))
    if ErrorModel(drop=low, seed=seed).happens("drop", tiny.SINGLE, name):
        assert ErrorModel(drop=high, seed=seed).happens("drop", tiny.SINGLE, name)


@given(SEEDS, NAMES, RATES, RATES)
def test_decisions_do_not_depend_on_the_other_settings_or_on_earlier_ones(seed: int, name: str, p: float, q: float):
    alone, beside = ErrorModel(drop=p, seed=seed), ErrorModel(drop=p, swap=q, confuse=q, dilate=3, seed=seed)
    first = alone.happens("drop", tiny.MULTI, name)
    beside.happens("swap", tiny.MULTI)
    beside.happens("drop", tiny.MULTI, "frame_999")
    assert beside.happens("drop", tiny.MULTI, name) == alone.happens("drop", tiny.MULTI, name) == first


@given(SEEDS)
def test_never_is_never_and_always_is_always(seed: int):
    for error in ("drop", "swap", "confuse"):
        assert not ErrorModel(seed=seed).happens(error, tiny.MULTI)
        assert ErrorModel(**{error: 1.0, "seed": seed}).happens(error, tiny.MULTI)  # type: ignore[arg-type]


def test_rates_are_met_and_seeds_keys_and_purposes_are_independent():
    def decisions(seed: int, key: str, error: str) -> np.ndarray:
        model = ErrorModel(drop=0.3, swap=0.3, seed=seed)
        return np.array([model.happens(error, key, f"frame_{i:03d}") for i in range(1000)])

    base = decisions(0, tiny.SINGLE, "drop")
    deviation = math.sqrt(0.3 * 0.7 / 1000)
    assert abs(base.mean() - 0.3) < 4 * deviation
    for other in (
        decisions(1, tiny.SINGLE, "drop"),
        decisions(0, tiny.MULTI, "drop"),
        decisions(0, tiny.SINGLE, "swap"),
    ):
        assert abs(np.corrcoef(base, other)[0, 1]) < 4 / math.sqrt(1000)


def test_the_decisions_of_a_seed_are_pinned():
    """Another release of the toolkit or of NumPy must not make another submission from the same command."""
    model = ErrorModel(drop=0.3, seed=3)
    dropped = [i for i in range(0, 120, 8) if model.happens("drop", "part_1/a/kitchen/1", f"frame_{i:03d}")]
    assert dropped == [8, 40, 48, 56, 80, 104, 112]


@pytest.mark.parametrize("values", [{"drop": 1.1}, {"swap": -0.1}, {"confuse": math.nan}, {"dilate": math.inf},
                                    {"dilate": math.nan}, {"dilate": 501}, {"seed": -1}])  # fmt: skip
def test_settings_that_mean_nothing_are_refused(values: dict[str, float]):
    with pytest.raises(UsageError, match=f"{next(iter(values))} .*expected"):
        ErrorModel(**values)  # type: ignore[arg-type]


# The errors


def test_dropped_frames_are_black_and_the_others_untouched(dataset: Dataset):
    errors = ErrorModel(drop=0.5, seed=1)
    dropped = 0
    for frame in frames(dataset, tiny.MULTI):
        mask = oracle_mask(frame, instance="category", errors=errors)
        if errors.happens("drop", tiny.MULTI, frame.name):
            assert not mask.any()
            dropped += 1
        else:
            np.testing.assert_array_equal(mask, oracle_mask(frame, instance="category"))
    assert 0 < dropped < len(frames(dataset, tiny.MULTI))


@given(SEEDS)
@settings(max_examples=10)
def test_a_swap_holds_for_the_whole_observation(dataset: Dataset, seed: int):
    errors = ErrorModel(swap=0.5, seed=seed)
    marked = TWIN if errors.happens("swap", tiny.MULTI) else SOUNDING
    for frame in frames(dataset, tiny.MULTI):
        mask = oracle_mask(frame, instance="sounding", errors=errors)
        np.testing.assert_array_equal(mask, frame.instance_ids() == marked)


def test_where_there_is_no_twin_nothing_is_swapped(dataset: Dataset):
    for frame in frames(dataset, tiny.SINGLE):
        mask = oracle_mask(frame, instance="sounding", errors=ErrorModel(swap=1))
        np.testing.assert_array_equal(mask, frame.mask())


def test_a_twin_that_is_never_in_sight_is_not_taken(dataset: Dataset, tmp_path: Path):
    root = tiny.clone(dataset.root, tmp_path / "data")
    for frame in Dataset(root)[tiny.MULTI].frames:
        ids = frame.instance_ids()
        frame.path("instance_masks").unlink()
        media.write_png_ids(frame.path("instance_masks"), np.where(ids == TWIN, 0, ids))
    for frame in Dataset(root)[tiny.MULTI].frames:
        mask = oracle_mask(frame, instance="sounding", errors=ErrorModel(swap=1))
        np.testing.assert_array_equal(mask, frame.mask())


def test_confusion_adds_the_neighbour_in_every_frame(dataset: Dataset):
    shown = 0
    for frame in frames(dataset, tiny.SINGLE):
        mask = oracle_mask(frame, instance="sounding", errors=ErrorModel(confuse=1))
        np.testing.assert_array_equal(mask, frame.mask() | (frame.instance_ids() == OVEN))
        shown += int((frame.instance_ids() == OVEN).any())
    assert shown
    for frame in frames(dataset, tiny.MULTI):  # twins are no neighbours, and there is nothing else
        mask = oracle_mask(frame, instance="sounding", errors=ErrorModel(confuse=1))
        np.testing.assert_array_equal(mask, frame.mask())


def _with_instances(dataset: Dataset, root: Path, *others: tuple[str, float]) -> Observation:
    """The single-instance observation, with silent instances 2, 3, … of (category, x) beside the microwave at x = 0."""

    def change(data: dict) -> None:
        sounding, sample = data["instances"]
        data["instances"] = [sounding] + [
            sample | {"id": 2 + n, "category": category, "bounds": [[x, 1.0, -2.6], [x + 0.1, 1.4, -2.2]]}
            for n, (category, x) in enumerate(others)
        ]

    tiny.clone(dataset.root, root)
    tiny.edit_record(root, tiny.SINGLE, change)
    return Dataset(root)[tiny.SINGLE]


@pytest.mark.parametrize(
    ("others", "chosen"),
    [
        ((("clock", 0.5), ("oven", 2.0)), 3),  # the likelier category, though it stands further away
        ((("coffee_machine", 0.5), ("washing_machine", 2.0)), 3),
        ((("oven", 2.0), ("oven", -1.0), ("oven", 3.0)), 3),  # of one category the nearest
        ((("toilet", 2.0), ("clock", -1.0)), 3),  # of no likely category the nearest
        ((("toilet", 1.0), ("clock", 1.0)), 2),  # a tie: the lower id
    ],
)
def test_which_neighbour_is_taken(dataset: Dataset, tmp_path: Path, others: tuple, chosen: int):
    observation = _with_instances(dataset, tmp_path / "data", *others)
    frame = observation.frames[0]
    ids = np.zeros((tiny.SIZE, tiny.SIZE), np.uint8)
    ids[:4, 2:9] = np.arange(2, 9)
    frame.path("instance_masks").unlink()
    media.write_png_ids(frame.path("instance_masks"), ids)
    added = oracle_mask(frame, instance="sounding", errors=ErrorModel(confuse=1)) & ~frame.mask()
    assert np.unique(ids[added]).tolist() == [chosen]


def test_confusable_categories_are_mutual():
    assert set(CONFUSABLE) == set(CATEGORIES)
    for category, others in CONFUSABLE.items():
        assert category not in others
        for other in others:
            assert other in DISTRACTORS or category in CONFUSABLE[other], f"{category}, {other}"


# Outlines

SMALL = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).random((17, 23)) < 0.08)


@given(SMALL, st.floats(1, 9))
def test_outlines_move_by_a_disc(mask: np.ndarray, radius: float):
    rows, columns = np.nonzero(mask)
    v, u = np.mgrid[:17, :23]
    squared = (v[..., None] - rows) ** 2 + (u[..., None] - columns) ** 2
    expected = (squared <= radius**2).any(axis=-1)
    np.testing.assert_array_equal(move_outline(mask, radius), expected)
    # Erosion is dilation of the background, so that the image's edge is no outline.
    np.testing.assert_array_equal(move_outline(~mask, -radius), ~expected if mask.any() else ~mask)


@given(SMALL, st.floats(-0.99, 0.99))
def test_less_than_a_pixel_moves_nothing(mask: np.ndarray, radius: float):
    np.testing.assert_array_equal(move_outline(mask, radius), mask)


@pytest.mark.parametrize("radius", [-4.0, 4.0])
def test_nothing_and_everything_have_no_outline(radius: float):
    for mask in (np.zeros((9, 9), bool), np.ones((9, 9), bool)):
        np.testing.assert_array_equal(move_outline(mask, radius), mask)


def test_pixels_count_at_1008_pixels():
    mask = np.zeros((504, 252), bool)
    mask[100, 100] = True
    marked = np.argwhere(ErrorModel(dilate=6).outline(mask))
    assert np.abs(marked - 100).max() == 3


def test_outlines_of_predictions_move(dataset: Dataset):
    frame = next(f for f in frames(dataset, tiny.SINGLE) if f.mask().sum() > 20)
    # 32 pixels at 1008 are 2 of 64.
    for dilate, moved in ((32, 2), (-32, -2)):
        mask = oracle_mask(frame, instance="sounding", errors=ErrorModel(dilate=dilate))
        np.testing.assert_array_equal(mask, move_outline(frame.mask(), moved * 64 * 32 / (1008 * 2)))
        assert (mask.sum() > frame.mask().sum()) == (dilate > 0)


# Points


def test_points_lie_evenly_on_the_true_mesh(dataset: Dataset):
    observation = dataset[tiny.MULTI]
    box = next(box for box in tiny.BOXES[tiny.MULTI] if box.sounding)
    low, high = np.array(box.low), np.array(box.high)
    points = oracle_points(observation).astype(float)
    size = high - low
    faces = 2 * np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]])  # pairs normal to x, y, z
    assert len(points) == round(faces.sum() * 1e4 * POINTS_PER_CM2)
    gaps = np.minimum(np.abs(points - low), np.abs(points - high))
    assert ((points > low - 1e-6) & (points < high + 1e-6)).all()
    assert gaps.min(axis=1).max() < 1e-6
    shares = np.bincount(gaps.argmin(axis=1), minlength=3) / len(points)
    np.testing.assert_allclose(shares, faces / faces.sum(), atol=2e-4)
    np.testing.assert_allclose(points.mean(axis=0), (low + high) / 2, atol=1e-3)
    # Evenly: every square centimetre of the front holds about POINTS_PER_CM2 points.
    front = points[np.abs(points[:, 2] - high[2]) < 1e-6][:, :2] - low[:2]
    cells, _, _ = np.histogram2d(*front.T, bins=np.round(size[:2] * 100).astype(int), range=[(0, s) for s in size[:2]])
    assert cells.min() >= 1
    assert cells.max() <= 3 * POINTS_PER_CM2


@pytest.mark.slow
def test_points_are_written_for_every_observation(dataset: Dataset, tmp_path: Path):
    run("--dataset", dataset.root, "-o", tmp_path / "a", "--instance", "sounding", "--points", "--drop", 0.5)
    for observation in dataset:
        cloud = media.read_ply(tmp_path / "a" / observation.key / "points.ply")
        np.testing.assert_array_equal(cloud.vertices, oracle_points(observation))
    notes = media.read_record(tmp_path / "a" / "submission.json", SubmissionRecord).notes or ""
    assert f"points {POINTS_PER_CM2:g} per cm²" in notes


# Refusals, and independence of workers


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--swap", "0.1"), "--instance sounding"),
        (("--points",), "--instance sounding"),
        (("--points", "--instance", "sounding", "--swap", "0.1"), "--swap"),
        (("--points", "--instance", "sounding", "--confuse", "0.1"), "--confuse"),
        (("--drop", "nan"), "drop nan"),
        (("--only", "nothing"), "no observation matches nothing"),
    ],
)
def test_what_cannot_be_had_is_said_in_one_line(dataset: Dataset, tmp_path: Path, options: tuple, words: str):
    with pytest.raises(UsageError, match=words) as caught:
        run("--dataset", dataset.root, "-o", tmp_path / "mine", *options)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "--instance category needs observation.json and instance_masks/"),
        (("--instance", "sounding", "--swap", "0.1"), "--swap needs observation.json"),
        (("--instance", "sounding", "--confuse", "0.1"), "--confuse needs observation.json"),
        (("--instance", "sounding", "--points"), "gt_3d/sounding_object.ply"),
    ],
)
def test_what_the_official_release_cannot_give(release: Dataset, tmp_path: Path, options: tuple, words: str):
    with pytest.raises(UsageError, match=words) as caught:
        run("--dataset", release.root, "-o", tmp_path / "mine", *options)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_on_the_official_release_the_sounding_instance_can_be_had(release: Dataset, tmp_path: Path):
    run("--dataset", release.root, "-o", tmp_path / "a", "--instance", "sounding", "--drop", 0.2, "--dilate", 20)
    assert len(tree_digest(tmp_path / "a")) == 5


@pytest.mark.slow
@pytest.mark.parametrize("points", [False, True])
def test_the_bytes_do_not_depend_on_the_number_of_processes(dataset: Dataset, tmp_path: Path, points: bool):
    errors = ErrorModel(drop=0.4, dilate=40, seed=5) if points else ErrorModel(0.4, 0.5, -20, 0.5, seed=5)
    digests = []
    for workers in (1, 2):
        path = tmp_path / str(workers)
        write_oracle(dataset, path, instance="sounding", errors=errors, points=points, workers=workers)
        digests.append(tree_digest(path))
    assert digests[0] == digests[1]
