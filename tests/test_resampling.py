"""Differences over resampled observations: intervals in closed form, and the conditions for a statement."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner
from scipy.stats import binom
from score_examples import example_scores, keys_of

from avs3d_bench import media
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.scores import Scores
from benchmarks.resampling import WRONG_OBSERVATION, Estimate, difference, figure_of, main, read_scores


def scores_of(ious: Sequence[float | None], wrong: Sequence[float | None] = ()) -> Scores:
    """Scores whose observations have these strict IoU and rates of the wrong instance; all in part_2."""
    keys = [f"part_2/flat_{index}/kitchen/1" for index in range(len(ious))]
    data = example_scores(keys).model_dump(mode="json")
    for row, iou, rate in zip(data["observations"], ious, wrong or [0.0] * len(ious), strict=True):
        row["strict"] |= {"IoU": iou, "wrong_instance_rate": rate}
    return Scores.model_validate(data)


def compare(first: Sequence[float | None], second: Sequence[float | None]):
    return difference("strict.IoU", "part_2", ("a", scores_of(first)), ("b", scores_of(second)))


def test_the_interval_of_a_difference_of_six_values_is_the_one_worked_out_in_docs_metrics():
    """Five times 0.2 and 1.0: C(6, k)·5^(6−k)/6⁶ of the resamples hold the last k times; mean 0.2 + 0.8·k/6."""
    found = compare([0.2, 0.2, 0.2, 1.0, 0.2, 0.2], [0.0] * 6)
    assert found.estimate.mean == pytest.approx(1 / 3)
    assert (found.estimate.low, found.estimate.high) == pytest.approx((0.2, 0.6))
    assert found.verdict == "higher"


def test_of_four_observations_there_is_neither_an_interval_nor_a_statement():
    found = compare([0.2, 0.2, 0.2, 1.0], [0.0] * 4)
    assert found.estimate.mean == pytest.approx(0.4)
    assert (found.estimate.low, found.estimate.high) == (None, None)
    assert "no interval" in str(found)
    assert found.verdict == "undecided", "four observations are too few for a statement"


@pytest.mark.parametrize(("wrong", "count"), [(4, 9), (9, 24), (1, 12)])
def test_the_share_of_wrong_observations_is_binomial(wrong: int, count: int):
    """Resampled, the number of wrong ones follows Binomial(n, k/n); the ends are its quantiles."""
    # Of the others, one is missed without a mark on a twin, and one is found beside a marked twin.
    ious, rates = [0.05] * wrong + [0.05, 0.6] * count, [0.4] * wrong + [0.0, 1.0] * count
    scores = scores_of(ious[:count], rates[:count])
    values = [figure_of(observation, WRONG_OBSERVATION) for observation in scores.observations]
    assert values == [1.0] * wrong + [0.0] * (count - wrong)
    found = Estimate.of(values)
    low, high = binom.ppf([0.025, 0.975], count, wrong / count) / count
    assert (found.mean, found.low, found.high) == pytest.approx((wrong / count, low, high))


def test_differences_are_paired():
    """Means far apart between observations, but the first is 0.1 better in each: the interval is that one number."""
    first = [0.1, 0.3, 0.5, 0.6, 0.8, 1.0]
    found = compare(first, [value - 0.1 for value in first])
    assert (found.estimate.mean, found.estimate.low, found.estimate.high) == pytest.approx((0.1, 0.1, 0.1))
    assert found.verdict == "higher"
    assert compare([value - 0.1 for value in first], first).verdict == "lower"


def test_what_depends_on_one_observation_is_no_statement():
    found = compare([0.5] * 8 + [1.0], [0.5] * 8 + [0.0])
    assert found.estimate.mean == pytest.approx(1 / 9)
    assert found.estimate.low == 0, "a third of the resamples leaves the one out"
    assert found.verdict == "undecided"
    assert compare([0.5] * 8, [0.5] * 8).verdict == "equal"
    assert compare([0.5], [0.4]).verdict == "undecided"


def test_observations_without_the_figure_are_left_out_of_both():
    found = compare([0.5, None, 0.9], [0.4, 0.1, None])
    assert found.estimate.observations == 1
    assert found.estimate.mean == pytest.approx(0.1)
    assert compare([None], [0.5]) is None


def test_an_unknown_figure_is_named():
    with pytest.raises(
        UsageError,
        match=r"figure 'strict.iou': expected one of listen.FP_area, .*official.F, .*strict.wrong_observation",
    ):
        figure_of(scores_of([0.5]).observations[0], "strict.iou")


def test_files_of_two_datasets_are_refused(tmp_path: Path):
    media.write_json(tmp_path / "a.json", example_scores())
    media.write_json(tmp_path / "b.json", example_scores(dataset={"version": "2.0.0"}))
    with pytest.raises(
        Avs3dError, match=r"b\.json: scored on open-s34-o7 2\.0\.0 .*, .*a\.json on open-s34-o7 1\.0\.0"
    ):
        read_scores([tmp_path / "a.json", tmp_path / "b.json"])
    found = CliRunner().invoke(main, [str(tmp_path / "a.json"), str(tmp_path / "b.json")])
    assert found.exit_code == 1
    assert "expected one dataset" in found.output


def test_the_command_prints_means_differences_and_writes_them(tmp_path: Path):
    for name, skill in (("official", 0.4), ("spatial", 0.95)):
        media.write_json(tmp_path / f"{name}.json", example_scores(keys_of(34), seed=1, skill=skill))
    files = [str(tmp_path / f"{name}.json") for name in ("official", "spatial")]
    found = CliRunner().invoke(main, [*files, "--part", "part_2", "--json", str(tmp_path / "out.json")])
    assert found.exit_code == 0, found.output
    assert "part_2, strict.IoU" in found.output
    assert "part_1" not in found.output
    written = json.loads((tmp_path / "out.json").read_text())
    (iou,) = [each for each in written["differences"] if each["figure"] == "strict.IoU"]
    assert (iou["first"], iou["second"], iou["verdict"]) == ("official", "spatial", "lower")
    assert iou["estimate"]["observations"] == 8
    assert f"official − spatial: {iou['estimate']['mean']:+.3f}" in found.output
    assert "holds: the first is lower" in found.output


# --- Sound scenes: groups are drawn ----------------------------------------------------------------------------------


def scenes_of(rights: Sequence[int], ious: Sequence[float]) -> Scores:
    """Groups of two siblings with one pair of four frames, of which so many are right; both siblings have that IoU."""
    data = example_scores(keys_of(4)).model_dump(mode="json")
    keys = [[f"part_3/flat_{group}/kitchen/{index}" for index in (1, 2)] for group in range(len(rights))]
    counts = {"visible_frames": 4, "absent_frames": 0, "pair_frames": 4, "class_IoU": {}}
    data["observations"] = [
        {
            "key": key, "part": "part_3", "scan": key.split("/")[1], "room": "kitchen", "category": None,
            "group": siblings[0], "frames": 4,
            "listen": counts | {"pair_accuracy": right / 4, "IoU": iou, "FP_rate": None, "FP_area": None,
                                "class_mIoU": None},
        }
        for siblings, right, iou in zip(keys, rights, ious, strict=True)
        for key in siblings
    ]  # fmt: skip
    data["siblings"] = [
        {
            "group": first, "observations": [first, second],
            "pairs": [{"first": first, "second": second, "frames": 4, "right": right}],
        }
        for (first, second), right in zip(keys, rights, strict=True)
    ]  # fmt: skip
    return Scores.model_validate(data)


def test_under_listen_groups_are_drawn():
    """Siblings add nothing: the interval is that of one value per group, as worked out in docs/metrics.md."""
    first, second = scenes_of([1, 1, 4, 1, 1, 1], [0.2, 0.2, 1.0, 0.2, 0.2, 0.2]), scenes_of([0] * 6, [0.0] * 6)
    found = difference("listen.IoU", "part_3", ("a", first), ("b", second))
    assert found is not None
    assert (found.estimate.mean, found.estimate.observations) == (pytest.approx(1 / 3), 12)
    assert (found.estimate.low, found.estimate.high) == pytest.approx((0.2, 0.6))
    pairs = difference("listen.pair_accuracy", "overall", ("a", first), ("b", second))
    assert pairs is not None
    assert (pairs.estimate.mean, pairs.estimate.observations) == (pytest.approx((5 * 0.25 + 1) / 6), 6)
    assert (pairs.estimate.low, pairs.estimate.high) == pytest.approx((0.25, 0.25 + 0.75 * 3 / 6))
    assert pairs.verdict == "higher"
    # Five groups of two have ten values and no interval.
    few = difference("listen.IoU", "part_3", ("a", scenes_of([1] * 5, [0.2] * 5)), ("b", scenes_of([0] * 5, [0.1] * 5)))
    assert few is not None
    assert (few.estimate.low, few.verdict) == (None, "undecided")
    assert difference("listen.pair_accuracy", "part_1", ("a", first), ("b", second)) is None


def test_the_program_compares_sound_scenes(tmp_path: Path):
    for name, right in (("a", 4), ("b", 1)):
        media.write_json(tmp_path / f"{name}.json", scenes_of([right] * 6, [0.1 * right] * 6))
    done = CliRunner().invoke(main, [str(tmp_path / "a.json"), str(tmp_path / "b.json")])
    assert done.exit_code == 0, done.output
    assert "part_3, listen.pair_accuracy" in done.output
    assert "a − b: +0.750 (+0.750 to +0.750; n = 6); holds: the first is higher" in done.output
    assert "strict" not in done.output
