"""`avs3d compare`: paired differences from files of scores, shared places, warnings, and one line per bad input."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from avs3d_bench.contract.comparisons import Comparison, FigureComparison, PairedDifference
from avs3d_bench.contract.scores import Scores
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from evaluators import cli
from evaluators.reading.origin import totals
from evaluators.reporting.compare import compare, comparison_lines
from evaluators.statistics.comparison import FIGURES, compare_figure, figure_of, metric_of, values_of
from tests.support.score_examples import example_scores, keys_of, with_means

IOU = FIGURES["strict.IoU"]


def scores_of(ious: Sequence[float | None], wrong: Sequence[float | None] = (), **said: Any) -> Scores:
    """Scores whose observations have these strict IoU and rates of the wrong instance; all in part_2."""
    keys = [f"part_2/flat_{index}/kitchen/1" for index in range(len(ious))]
    data = example_scores(keys, **said).model_dump(mode="json")
    for row, iou, rate in zip(data["observations"], ious, wrong or [0.0] * len(ious), strict=True):
        row["strict"] |= {"IoU": iou, "wrong_instance_rate": rate}
    return Scores.model_validate(with_means(data))


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
    data["avs3d_eval"]["protocols"] = {"listen": "1.0"}
    data["dataset"] |= {"observations": len(data["observations"]), "scored": len(data["observations"])}
    return Scores.model_validate(with_means(data))


def of_values(first: Sequence[float | None], second: Sequence[float | None]) -> FigureComparison | None:
    return compare_figure({"a": scores_of(first), "b": scores_of(second)}, IOU, "part_2")


def only(found: FigureComparison | None) -> PairedDifference:
    assert found is not None
    (difference,) = found.differences
    return difference


def save(folder: Path, **scores: Scores) -> list[Path]:
    """A file of scores for each."""
    for name, each in scores.items():
        media.write_json(folder / f"{name}.json", each)
    return [folder / f"{name}.json" for name in scores]


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.compare, [str(each) for each in arguments])


# --- One figure -------------------------------------------------------------------------------------------------------


def test_six_values_have_the_interval_and_the_p_value_worked_out_in_docs_metrics() -> None:
    """Five times 0.2 and 1.0: C(6, k)·5^(6−k)/6⁶ of the resamples hold the last k times; mean 0.2 + 0.8·k/6."""
    found = only(of_values([0.2, 0.2, 0.2, 1.0, 0.2, 0.2], [0.0] * 6))
    assert found.mean == pytest.approx(1 / 3)
    assert found.interval == pytest.approx((0.2, 0.6))
    assert found.interval_method == "percentile"
    assert found.p == found.p_holm == 2 / 2**6
    assert found.verdict == "better"


def test_differences_are_paired() -> None:
    """Means far apart between observations, but the first is 0.1 better in each."""
    first = [0.1, 0.3, 0.5, 0.6, 0.8, 1.0]
    second = [value - 0.1 for value in first]
    found = only(of_values(first, second))
    assert found.interval == pytest.approx((0.1, 0.1))
    assert found.verdict == "better"
    assert only(of_values(second, first)).verdict == "worse"


def test_what_depends_on_one_observation_is_no_statement() -> None:
    found = only(of_values([0.5] * 11 + [1.0], [0.5] * 11 + [0.0]))
    assert found.mean == pytest.approx(1 / 12)
    assert (found.p, found.verdict) == (1.0, "undecided")
    assert only(of_values([0.5] * 8, [0.5] * 8)).verdict == "equal"


def test_four_observations_have_a_p_value_and_neither_interval_nor_verdict() -> None:
    found = only(of_values([0.2, 0.3, 0.2, 1.0], [0.0] * 4))
    assert (found.interval, found.interval_method) == (None, None)
    assert (found.p, found.verdict) == (2 / 2**4, "undecided")


def test_observations_without_the_figure_are_left_out_of_both() -> None:
    found = only(of_values([0.5, None, 0.9], [0.4, 0.1, None]))
    assert (found.observations, found.units) == (1, 1)
    assert found.mean == pytest.approx(0.1)
    assert of_values([None], [0.5]) is None


def test_a_lower_false_positive_rate_is_better() -> None:
    first, second = scores_of([0.5] * 8, [0.1] * 8), scores_of([0.5] * 8, [0.6] * 8)
    found = compare_figure({"a": first, "b": second}, FIGURES["strict.wrong_instance_rate"], "part_2")
    assert only(found).verdict == "better"
    assert found is not None
    assert [(method.name, method.place) for method in found.methods] == [("a", 1), ("b", 2)]


def test_p_values_are_corrected_for_all_pairs() -> None:
    """Three methods: all patterns of eight differences of one sign give 2/2⁸, and three such pairs 3·2/2⁸."""
    levels = {"a": 0.1, "b": 0.3, "c": 0.6}
    methods = {name: scores_of([level + 0.01 * i for i in range(8)]) for name, level in levels.items()}
    found = compare_figure(methods, IOU, "part_2")
    assert found is not None
    assert [one.p for one in found.differences] == [2 / 2**8] * 3
    assert [one.p_holm for one in found.differences] == [6 / 2**8] * 3
    assert [(method.name, method.place) for method in found.methods] == [("c", 1), ("b", 2), ("a", 3)]
    two = compare_figure(methods, IOU, "part_2", pairs=[("a", "b"), ("b", "c")])
    assert two is not None
    assert [one.p_holm for one in two.differences] == [4 / 2**8] * 2, "only what is asked for counts"


def test_methods_that_nothing_separates_share_a_place() -> None:
    level = [0.5, 0.6, 0.4, 0.7, 0.3, 0.5, 0.6, 0.4]
    close = [value + (0.02 if index % 2 else -0.01) for index, value in enumerate(level)]
    far = [value - 0.2 for value in level]
    found = compare_figure({"a": scores_of(level), "b": scores_of(close), "c": scores_of(far)}, IOU, "part_2")
    assert found is not None
    assert [(method.name, method.place) for method in found.methods] == [("b", 1), ("a", 1), ("c", 3)]


def test_the_share_of_wrong_observations_can_be_compared_on_request() -> None:
    metric = metric_of("strict.wrong_observation")
    scores = scores_of([0.05, 0.05, 0.6, 0.6], [0.4, 0.0, 1.0, 0.0])
    assert [figure_of(one, metric) for one in scores.observations] == [1.0, 0.0, 0.0, 0.0]
    assert not metric.higher_is_better
    with pytest.raises(UsageError, match=r"figure 'strict.iou': expected one of listen.FP_area, .*strict.wrong_obs"):
        metric_of("strict.iou")


# --- part_3 ---------------------------------------------------------------------------------------------------------


def test_under_listen_groups_are_drawn_and_change_sign() -> None:
    """Siblings add nothing: interval and p-value are those of one value per group."""
    first, second = scenes_of([1, 1, 4, 1, 1, 1], [0.2, 0.2, 1.0, 0.2, 0.2, 0.2]), scenes_of([0] * 6, [0.0] * 6)
    methods = {"a": first, "b": second}
    iou = only(compare_figure(methods, FIGURES["listen.IoU"], "part_3"))
    assert (iou.units, iou.observations) == (6, 12)
    assert iou.mean == pytest.approx(1 / 3)
    assert iou.interval == pytest.approx((0.2, 0.6))
    assert iou.p == 2 / 2**6
    pairs = only(compare_figure(methods, FIGURES["listen.pair_accuracy"], "overall"))
    assert (pairs.units, pairs.observations) == (6, 6)
    assert pairs.mean == pytest.approx((5 * 0.25 + 1) / 6)
    assert pairs.interval == pytest.approx((0.25, 0.25 + 0.75 * 3 / 6))
    assert compare_figure(methods, FIGURES["listen.pair_accuracy"], "part_1") is None
    assert values_of(first, FIGURES["listen.pair_accuracy"], "part_1").of == {}


def test_scenes_are_compared_by_the_command(tmp_path: Path) -> None:
    files = save(tmp_path, a=scenes_of([4] * 12, [0.4] * 12), b=scenes_of([1] * 12, [0.1] * 12))
    done = run(*files)
    assert done.exit_code == 0, done.output
    assert "part_3, listen pair accuracy, higher is better" in done.output
    assert "a − b: +0.750 (+0.750 to +0.750; n = 12), p = 0.00049; a is better" in done.output
    assert "n = 24 in 12 groups" in done.output
    assert "strict" not in done.output


# --- Files ------------------------------------------------------------------------------------------------------------


def test_the_command_prints_every_pair_and_writes_the_record(tmp_path: Path) -> None:
    made = {name: example_scores(seed=1 if name != "other" else 2, skill=skill, method="EchoSegnet")
            for name, skill in (("official", 0.4), ("spatial", 0.95), ("other", 0.4))}  # fmt: skip
    files = save(tmp_path, **made)
    done = run(*files, "--part", "part_2", "--figure", "strict.IoU", "--json", tmp_path / "out.json")
    assert done.exit_code == 0, done.output
    record = Comparison.model_validate_json((tmp_path / "out.json").read_text())
    (figure,) = record.figures
    assert (figure.part, figure.protocol, figure.figure) == ("part_2", "strict", "IoU")
    assert [(one.first, one.second) for one in figure.differences] == [
        ("official", "spatial"), ("official", "other"), ("spatial", "other"),
    ]  # fmt: skip
    assert [method.place for method in figure.methods] == [1, 2, 2]
    assert figure.methods[0].mean == pytest.approx(made["spatial"].parts["part_2"].strict.IoU)
    assert figure.differences[0].verdict == "worse"
    assert record.avs3d_compare.protocols == {"strict": "1.0"}
    assert [file.method for file in record.files] == ["EchoSegnet"] * 3
    for line in comparison_lines(record):
        assert line in done.output
    assert "    1. spatial" in done.output
    assert "official − other:" in done.output


def test_every_part_and_figure_is_compared_by_default(tmp_path: Path) -> None:
    found = compare(save(tmp_path, a=example_scores(seed=1), b=example_scores(seed=2)))
    cases = {(figure.part, f"{figure.protocol}.{figure.figure}") for figure in found.figures}
    assert {part for part, _ in cases} == {"part_1", "part_2", "overall"}
    assert {"official.mIoU", "strict.IoU", "strict.FP_area"} <= {figure for _, figure in cases}
    assert ("part_1", "strict.wrong_instance_rate") not in cases, "part_1 has no twins"
    only_official = compare([tmp_path / "a.json", tmp_path / "b.json"], protocols=("official",), parts=("overall",))
    assert {(figure.part, figure.protocol) for figure in only_official.figures} == {("overall", "official")}


def test_the_result_does_not_depend_on_the_order_of_observations(tmp_path: Path) -> None:
    first, second = example_scores(seed=1), example_scores(seed=2)
    turned = first.model_copy(update={"observations": first.observations[::-1]})
    found = [compare(save(tmp_path / str(i), a=one, b=second)).figures for i, one in enumerate((first, turned))]
    assert found[0] == found[1]


def test_few_observations_are_a_warning(tmp_path: Path) -> None:
    files = save(tmp_path, a=scores_of([0.9] * 9), b=scores_of([0.1] * 9), c=scores_of([0.5] * 9))
    done = run(*files, "--figure", "strict.IoU", "--part", "part_2")
    assert done.exit_code == 0
    assert (
        "avs3d compare: warning: part_2: 9 observations of strict.IoU, fewer than 10: no p-value is below 0.0039, "
        "0.012 after correction for 3 pairs; intervals are too narrow\n"
    ) in done.stderr
    enough = save(tmp_path, a=scores_of([0.9] * 10), b=scores_of([0.1] * 10))
    assert "warning" not in run(*enough, "--figure", "strict.IoU").stderr


def test_a_method_that_uses_the_truth_is_named(tmp_path: Path) -> None:
    files = save(tmp_path, a=example_scores(seed=1, truth="masks of test frames"), b=example_scores(seed=2))
    found = compare(files, figures=("official.F",), parts=("overall",))
    assert found.warnings == (
        "a: made from the ground truth (masks of test frames): no result of a method",
        "3 homes, fewer than 6: the intervals are too narrow",
    )


def test_a_figure_of_one_observation_is_left_out_with_a_warning(tmp_path: Path) -> None:
    files = save(tmp_path, a=scores_of([0.5, 0.9], [0.5, None]), b=scores_of([0.4, 0.1], [0.0, None]))
    found = compare(files, figures=("strict.IoU", "strict.wrong_instance_rate"))
    assert {figure.figure for figure in found.figures} == {"IoU"}
    assert any("part_2: 1 observation of strict.wrong_instance_rate: not compared" in line for line in found.warnings)


def test_files_with_other_observations_are_compared_over_the_common_ones(tmp_path: Path) -> None:
    whole = example_scores(seed=1)
    data = example_scores(seed=2).model_dump(mode="json")
    data["observations"] = data["observations"][:20]
    data["dataset"]["scored"] = 20
    found = compare(
        save(tmp_path, a=whole, b=Scores.model_validate(with_means(data))), figures=("official.F",), parts=("overall",)
    )
    assert found.figures[0].differences[0].observations == 20
    assert found.warnings[0].startswith("observations differ (a 34, b 20): each pair of methods is compared over")


@pytest.mark.parametrize(
    ("second", "message"),
    [
        ({"dataset": {"version": "2.0.0"}},
         r"b\.json: scored on open-s34-o7 2\.0\.0 .*a\.json on open-s34-o7 1\.0\.0 .*expected one dataset"),
        ({"dataset": {"sha256": "0" * 64}}, r"b\.json: scored on .*sha256 000000000000\), .*expected one dataset"),
        ({"evaluator": {"protocols": {"official": "1.0", "strict": "2.0"}}},
         r"b\.json: protocol strict 2\.0 with voxels of .*a\.json: protocol strict 1\.0 .*expected one version"),
        ({"evaluator": {"voxel_size": 0.1}}, r"b\.json: protocol strict 1\.0 with voxels of 0\.1 m, .*of 0\.05 m"),
    ],
)  # fmt: skip
def test_what_was_measured_otherwise_is_refused_in_one_line(
    tmp_path: Path, second: dict[str, Any], message: str
) -> None:
    files = save(tmp_path, a=example_scores(seed=1), b=example_scores(seed=2, **second))
    with pytest.raises(UsageError, match=message) as caught:
        compare(files)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


def test_different_protocols_are_refused_in_one_line(tmp_path: Path) -> None:
    files = save(
        tmp_path, a=example_scores(seed=1, protocols=("official",)), b=example_scores(seed=2, protocols=("strict",))
    )
    with pytest.raises(
        UsageError, match=r"b\.json: protocol strict; .*a\.json: official; expected one in common: .*--protocol"
    ):
        compare(files)
    both = save(tmp_path, c=example_scores(seed=3))
    found = compare([*files[:1], *both])
    assert found.avs3d_compare.protocols == {"official": "1.0"}, "what all files have"
    with pytest.raises(UsageError, match=r"a\.json: not scored under protocol strict, only official"):
        compare([*files[:1], *both], protocols=("strict",))


def test_another_ground_truth_is_refused_in_one_line(tmp_path: Path) -> None:
    """Two official releases have neither version nor sha256: only the reference rows show that their masks differ."""
    data = example_scores(seed=2, release=True).model_dump(mode="json")
    data["references"]["centre_box"]["part_1"]["strict"]["IoU"] += 0.01
    files = save(tmp_path, a=example_scores(seed=1, release=True), b=Scores.model_validate(with_means(data)))
    with pytest.raises(UsageError, match=r"b\.json: its reference rows differ from those of .*a\.json: .*ground truth"):
        compare(files)
    data = example_scores(seed=2, release=True).model_dump(mode="json")
    data["observations"] = data["observations"][1:]
    data["dataset"]["scored"] -= 1
    data["observations"][3]["frames"] = 14
    data["observations"][3]["strict"]["visible_frames"] = 14 - data["observations"][3]["strict"]["absent_frames"]
    files = save(tmp_path, a=example_scores(seed=1, release=True), b=Scores.model_validate(with_means(data)))
    with pytest.raises(UsageError, match=r"b\.json: part_1/.*: 14 test frames, in .*a\.json 15"):
        compare(files)


def test_a_change_of_a_metric_is_not_called_another_truth(tmp_path: Path) -> None:
    """The digests of the truth tell data from software; files without them may differ in either."""
    for digest, says in (
        ("1" * 64, "the ground truth is the same .* versions 9.0.0 and .*: score both .* again"),
        (None, "same ground truth, or by evaluators of which a metric changed .versions 9.0.0"),
    ):
        files = []
        for name, changed in (("a", 0.0), ("b", 0.01)):
            data = example_scores(seed=1 + len(files)).model_dump(mode="json")
            data["references"]["centre_box"]["part_1"]["strict"]["IoU"] += changed
            for row in data["observations"] if digest else ():
                row["digests"] = {"predictions": digest, "truth": digest}
            data["avs3d_eval"]["version"] = "9.0.0" if changed else data["avs3d_eval"]["version"]
            scores = Scores.model_validate(with_means(data))
            data["submission"]["digest"], data["dataset"]["truth_digest"] = totals(scores.observations)
            files += save(tmp_path, **{name: Scores.model_validate(data)})
        with pytest.raises(UsageError, match=rf"b\.json: its reference rows differ from .*a\.json: .*{says}"):
            compare(files)


def test_one_observation_is_refused_in_one_line(tmp_path: Path) -> None:
    files = save(tmp_path, a=scores_of([0.5]), b=scores_of([0.4]))
    with pytest.raises(UsageError, match=r"a\.json, .*b\.json: 1 observation in common; a comparison needs at least 2"):
        compare(files)
    apart = save(tmp_path / "apart", a=scores_of([0.5, None]), b=scores_of([0.4, 0.3]))
    with pytest.raises(UsageError, match="no figure of any part has at least 2 observations in common under strict"):
        compare(apart, figures=("strict.IoU",))
    with pytest.raises(UsageError, match="no figure of part_1 has at least 2"):
        compare(apart, figures=("strict.F",), parts=("part_1",))


def test_one_file_is_refused(tmp_path: Path) -> None:
    (file,) = save(tmp_path, a=example_scores(seed=1))
    copy = tmp_path / "copy.json"
    copy.write_bytes(file.read_bytes())
    for files in ([file], [file, file], [file, copy]):
        with pytest.raises(UsageError, match=r"a\.json: nothing to compare with; expected two or more files"):
            compare(files)


def test_a_broken_file_is_one_line_with_file_and_field(tmp_path: Path) -> None:
    files = save(tmp_path, a=example_scores(seed=1), b=example_scores(seed=2))
    data = json.loads(files[1].read_text())
    del data["submission"]
    files[1].write_text(json.dumps(data))
    with pytest.raises(Avs3dError, match=r"b\.json: submission") as caught:
        compare(files)
    assert caught.value.exit_code == 1


def test_files_of_one_name_are_told_apart_by_their_paths(tmp_path: Path) -> None:
    one = save(tmp_path / "one", scores=example_scores(seed=1))
    two = save(tmp_path / "two", scores=example_scores(seed=2))
    found = compare([*one, *two], figures=("strict.IoU",))
    assert [file.name for file in found.files] == [str(one[0]), str(two[0])]


def test_no_file_of_scores_is_overwritten(tmp_path: Path) -> None:
    files = save(tmp_path, a=example_scores(seed=1), b=example_scores(seed=2))
    before = files[0].read_bytes()
    done = run(*files, "--json", files[0])
    assert isinstance(done.exception, UsageError)
    assert "a.json: exists, and this command has not written it" in str(done.exception)
    assert files[0].read_bytes() == before
