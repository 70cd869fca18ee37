"""Figures by factor: bins, means, intervals and differences against independent sums; the page and the command."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.contract.frame_rows import FrameRow
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from evaluators import cli
from evaluators.reporting.factors import bin_label, draw, factor_values, write_factors
from evaluators.reporting.report_check import read_report
from evaluators.score import evaluate
from evaluators.statistics import bootstrap
from evaluators.statistics.curves import FACTORS, FIGURES, curve, curves, difference, point
from evaluators.statistics.frame_rows import frame_rows, write_rows
from tests.evaluators.test_score import run, shifted, submit, true_mask
from tests.support import tiny, tiny_scenes
from tests.support.browser import launch, visit

BY_NAME = {factor.name: factor for factor in FACTORS}
STRICT, PAIRS, LISTEN = FIGURES
DOCUMENT = Path(__file__).parents[2] / "docs" / "factors.md"
ROOMS = ("bathroom", "kitchen", "living_room")
CATEGORIES = ("clock", "microwave", "toilet")


def row(observation: int = 0, frame: int = 0, iou: float | None = 0.5, **values: Any) -> FrameRow:
    """A row of part_1 in which 1,000 of 10,000 pixels are to be marked, unless ``iou`` is None."""
    visible = iou is not None
    room = ROOMS[observation % 3]
    fields: dict[str, Any] = {
        "method": "m", "dataset": "d", "dataset_sha256": "a" * 64, "protocol": "strict", "protocol_version": "1.0",
        "key": f"part_1/home/{room}/{observation + 1}", "part": "part_1", "scan": "home", "room": room, "group": None,
        "frame": f"frame_{frame:03d}", "pixels": 10_000, "truth_pixels": 1000 * visible, "predicted_pixels": 1000,
        "overlap_pixels": 0, "IoU": iou, "F": iou, "boundary_F": iou, "twins_visible": None, "twins_marked": None,
        "pairs": None, "pairs_right": None, "category": CATEGORIES[observation % 3], "visible_share": 0.1 * visible,
        "distance_m": 2.5, "azimuth_deg": 0.0, "elevation_deg": 0.0, "t30_s": 0.5, "drr_db": None, "snr_db": None,
        "twins": 0, "twin_distance_m": None, "unavailable": {"drr_db": "no", "snr_db": "no", "twin_distance_m": "no"},
    }  # fmt: skip
    return FrameRow.model_validate(fields | values)


def pair_row(observation: int, frame: int, pairs: int, right: int, **values: Any) -> FrameRow:
    """A row of part_3; every four observations are a group."""
    room = ROOMS[observation // 4 % 3]
    head = f"part_3/home/{room}"
    return row(
        observation, frame, protocol="listen", key=f"{head}/{observation + 1}", part="part_3", room=room,
        group=f"{head}/{observation // 4 * 4 + 1}", pairs=pairs, pairs_right=right, **values,
    )  # fmt: skip


def random_rows(seed: int, method: str = "m", observations: int = 20, listen: bool = False) -> list[FrameRow]:
    """Observations of six frames; the scene is the same for every seed and method, the figures are not."""
    scene, rng = np.random.default_rng(99), np.random.default_rng(seed)
    found = []
    for observation in range(observations):
        for frame in range(6):
            values = {"method": method, "distance_m": float(scene.uniform(0.5, 7)), "iou": float(rng.uniform())}
            if scene.random() < 0.2:
                values["iou"] = None
            pairs = int(scene.integers(0, 4))
            found.append(
                pair_row(observation, frame, pairs, int(rng.integers(0, pairs + 1)), **values)
                if listen
                else row(observation, frame, **values)
            )
    return found


# --- Bins -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("factor", "value", "label"),
    [
        ("distance_m", 0.0, "< 1"), ("distance_m", 0.999, "< 1"), ("distance_m", 1.0, "1 to 2"),
        ("distance_m", 5.99, "4 to 6"), ("distance_m", 6.0, "≥ 6"), ("distance_m", 100.0, "≥ 6"),
        ("azimuth_deg", -9.9, "< 10"), ("azimuth_deg", -45.0, "45 to 90"), ("azimuth_deg", 180.0, "≥ 90"),
        ("elevation_deg", -90.0, "< −30"), ("elevation_deg", -30.0, "−30 to −20"), ("elevation_deg", 0.0, "0 to 10"),
        ("visible_share", 0.0, "0"), ("visible_share", 1e-6, "< 0.1"), ("visible_share", 0.001, "0.1 to 0.3"),
        ("visible_share", 1.0, "≥ 10"), ("twins", 0, "0"), ("twins", 1, "1"), ("twins", 2, "2"), ("twins", 7, "≥ 3"),
        ("t30_s", 0.6, "0.6 to 0.8"), ("drr_db", -0.1, "−5 to 0"), ("snr_db", 20.0, "≥ 20"),
        ("twin_distance_m", 3.2, "3 to 4"), ("category", "clock", "clock"), ("room", "kitchen", "kitchen"),
    ],
)  # fmt: skip
def test_the_bin_of_a_value(factor: str, value: Any, label: str):
    assert BY_NAME[factor].bin_of(row(**{factor: value})) == label


def test_the_document_has_the_bins_of_the_code():
    section = DOCUMENT.read_text(encoding="utf-8").split("## By factor", 1)[1].split("\n## ", 1)[0]
    for factor in FACTORS:
        line = next(line for line in section.splitlines() if line.startswith(f"| `{factor.name}`"))
        if factor.cuts is not None:
            said = [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?", line.split("|")[3].replace("−", "-"))]
            assert said == list(factor.cuts), factor.name


def test_bins_go_from_the_first_to_the_last_that_has_a_frame():
    some = [row(0, 0, distance_m=1.5), row(0, 1, distance_m=4.5), row(0, 2, None, distance_m=0.1)]
    found = curve([some], BY_NAME["distance_m"], STRICT)
    assert [(each.label, each.points[0] is None) for each in found.bins] == [
        ("1 to 2", False), ("2 to 3", True), ("3 to 4", True), ("4 to 6", False),
    ]  # fmt: skip


def test_frames_without_the_factor_are_counted_by_reason():
    some = [row(0, 0), row(0, 1), row(1, 0, drr_db=3.0, unavailable={}), row(1, 1, None)]
    found = curve([some], BY_NAME["drr_db"], STRICT)
    assert dict(found.unknown) == {"no": 2}
    assert [each.label for each in found.bins] == ["0 to 5"]


# --- Figures ----------------------------------------------------------------------------------------------------------


def test_the_worked_example_of_the_document():
    section = DOCUMENT.read_text(encoding="utf-8").split("## By factor", 1)[1].split("\n## ", 1)[0]
    table = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in section.splitlines() if line.startswith("| o")
    ]
    frames = [line for line in table if re.fullmatch(r"o\d", line[0])]
    assert len(frames) == 5
    some = [row(int(o[1]), int(f), float(iou), distance_m=float(d)) for o, f, d, iou in frames]
    found = curve([some], BY_NAME["distance_m"], STRICT)
    values = {each.label: each.points[0].value for each in found.bins if each.points[0]}
    said = dict(re.findall(r"^(\d to \d) m: .* = (\d\.\d+)$", section, re.M))
    assert {label: float(text) for label, text in said.items()} == pytest.approx(values)
    assert len(values) == 2
    whole = point(some, STRICT)
    assert whole is not None
    assert f"whole: {whole.value:g}" in re.sub(r"whole: .* = ", "whole: ", section)


def test_a_point_is_a_mean_over_observations_with_their_interval():
    some = random_rows(3)
    for each in curve([some], BY_NAME["distance_m"], STRICT).bins:
        mine = [r for r in some if BY_NAME["distance_m"].bin_of(r) == each.label and r.IoU is not None]
        means = [np.mean([r.IoU for r in mine if r.key == key]) for key in sorted({r.key for r in mine})]
        (found,) = each.points
        assert found is not None
        assert found.value == pytest.approx(np.mean(means))
        assert found.interval == pytest.approx(bootstrap.interval(means))
        assert (found.observations, found.frames) == (len(means), len(mine))


def test_a_pair_accuracy_is_a_mean_over_groups():
    some = random_rows(4, observations=32, listen=True)
    for each in curve([some], BY_NAME["distance_m"], PAIRS).bins:
        mine = [r for r in some if BY_NAME["distance_m"].bin_of(r) == each.label and r.pairs]
        groups = sorted({r.group for r in mine})
        shares = [
            sum(r.pairs_right for r in mine if r.group == g) / sum(r.pairs for r in mine if r.group == g)
            for g in groups
        ]
        (found,) = each.points
        assert found is not None
        assert found.value == pytest.approx(np.mean(shares))
        assert found.observations == len(groups)
        assert found.interval == pytest.approx(bootstrap.clustered_interval([[s] for s in shares]))


def test_fewer_than_six_observations_have_no_interval():
    for count in (5, 6):
        some = [row(o, 0, 0.1 * o) for o in range(count)]
        found = point(some, STRICT)
        assert found is not None
        assert (found.interval is None) == (count == 5)


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Any, Sequence[FrameRow]]]:
    """Scores and rows of a tree of part_1 and part_2, and of one of part_3."""
    found = {}
    for name, write in (("objects", tiny.write_dataset), ("scenes", tiny_scenes.write_part_3)):
        root = write(tmp_path_factory.mktemp(name) / "data", frames=17)
        evaluation = evaluate(submit(root.parent / "submission", root, shifted), root)
        found[name] = (evaluation.scores, frame_rows(evaluation, Dataset(root)))
    return found


@pytest.mark.slow
def test_by_room_and_category_the_figures_are_those_of_the_file_of_scores(scored: Any):
    scores, rows = scored["objects"]
    for name, groups in (("room", scores.rooms), ("category", scores.categories)):
        found = curve([rows], BY_NAME[name], STRICT)
        assert {each.label: each.points[0].value for each in found.bins} == {
            label: group.strict.IoU for label, group in groups.items()
        }
    scores, rows = scored["scenes"]
    for metric in (PAIRS, LISTEN):
        (kitchen,) = curve([rows], BY_NAME["room"], metric).bins
        assert kitchen.points[0].value == getattr(scores.rooms["kitchen"].listen, metric.name)
        whole = point([r for r in rows if metric is LISTEN or r.pairs], metric)
        assert whole is not None
        assert whole.value == getattr(scores.overall.listen, metric.name)


def test_a_bin_with_all_observations_has_the_interval_of_the_file_of_scores():
    """As `evaluators.summary.summarise`, from the values of the observations."""
    some = random_rows(5)
    values = [np.mean([r.IoU for r in some if r.key == key and r.IoU is not None]) for key in {r.key for r in some}]
    found = point([r for r in some if r.IoU is not None], STRICT)
    assert found is not None
    assert found.interval == pytest.approx(bootstrap.interval(values), abs=1e-12)


def test_differences_are_paired():
    base = random_rows(6, "a")
    better = [r.model_copy(update={"IoU": None if r.IoU is None else r.IoU + 0.125, "method": "b"}) for r in base]
    for each in curve([better, base], BY_NAME["distance_m"], STRICT).bins:
        assert each.difference is not None
        assert each.difference.value == pytest.approx(0.125)
        if each.difference.interval is not None:
            assert (each.difference.interval.low, each.difference.interval.high) == pytest.approx((0.125, 0.125))
    found = difference(random_rows(7), random_rows(8), STRICT)
    one, other = (point([r for r in random_rows(s) if r.IoU is not None], STRICT) for s in (7, 8))
    assert found is not None
    assert one is not None
    assert other is not None
    assert found.value == pytest.approx(one.value - other.value)


def test_one_method_has_no_difference_and_neither_have_three():
    for count in (1, 3):
        found = curves([random_rows(s) for s in range(count)])
        assert all(each.difference is None for one in found for each in one.bins)


def test_a_curve_shows_what_a_method_depends_on():
    """IoU falls with distance by construction, and not with anything else."""
    some = [r.model_copy(update={"IoU": 1 - r.distance_m / 10}) for r in random_rows(9) if r.IoU is not None]
    values = [each.points[0].value for each in curve([some], BY_NAME["distance_m"], STRICT).bins]
    assert values == sorted(values, reverse=True)
    assert values[0] - values[-1] > 0.4
    rooms = [each.points[0].value for each in curve([some], BY_NAME["room"], STRICT).bins]
    assert max(rooms) - min(rooms) < 0.15


# --- The page ---------------------------------------------------------------------------------------------------------


def test_points_lie_where_the_figures_say():
    chart = draw(curve([random_rows(1), random_rows(2, "b")], BY_NAME["distance_m"], STRICT))
    bins = chart.curve.bins
    for method in (0, 1):
        marks = [mark for mark in chart.marks if mark.method == method]
        assert [mark.bottom for mark in marks] == pytest.approx([100 * each.points[method].value for each in bins])
        for place, (mark, each) in enumerate(zip(marks, bins, strict=True)):
            assert place / len(bins) < mark.left / 100 < (place + 1) / len(bins)
            interval = each.points[method].interval
            if interval is not None:
                assert (mark.low, mark.low + mark.height) == pytest.approx([100 * end for end in interval])
    assert len(chart.lines) == 2 * (len(bins) - 1)
    assert not draw(curve([random_rows(1)], BY_NAME["room"], STRICT)).lines


def test_what_is_not_drawn_is_said():
    (found,) = factor_values([[row(0, 0), row(1, 0)]])
    assert "DRR, SNR, nearest silent twin: not known (2 frames: no)" in found["undrawn"]
    assert "distance: all in the bin 2 to 3 m" in found["undrawn"]
    assert {chart.curve.factor.name for chart in found["charts"]} == {"category", "room"}
    assert factor_values([]) == factor_values([()]) == ()


def test_labels_have_units():
    found = curve([[row(azimuth_deg=33.0)]], BY_NAME["azimuth_deg"], STRICT)
    assert bin_label(found, found.bins[0]) == "30 to 45°"
    found = curve([[row(0)]], BY_NAME["room"], STRICT)
    assert bin_label(found, found.bins[0]) == "bathroom"


HOSTILE = '"><img src=x onerror=alert(1)><script>alert(2)</script>'


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    for name, rows in (("a", random_rows(1, HOSTILE, 32, True)), ("b", random_rows(2, "=b", 32, True))):
        write_rows(folder / f"{name}.csv", rows)
    write_factors([folder / "a.csv", folder / "b.csv"], html=folder / "page.html", table=folder / "table.csv")
    return folder / "page.html"


def test_the_page_trusts_no_text_and_has_both_methods(page: Path):
    text = page.read_text(encoding="utf-8")
    assert HOSTILE not in text
    assert "<img" not in text
    assert text.count("<script>") == 1
    assert 'data-factor="listen-pair_accuracy"' in text
    assert 'data-factor="listen-IoU"' in text
    assert text.count('class="curve-dot m0') > 10
    assert text.count('class="curve-dot m1') > 10


def test_the_table_has_every_point(page: Path):
    lines = list(csv.DictReader(io.StringIO((page.parent / "table.csv").read_text(encoding="utf-8"))))
    found = curves([random_rows(1, HOSTILE, 32, True), random_rows(2, "=b", 32, True)])
    expected = [at for one in found for each in one.bins for at in each.points if at is not None]
    assert [float(line["value"]) for line in lines] == [at.value for at in expected]
    assert [line["low"] == "" for line in lines] == [at.interval is None for at in expected]
    assert {line["method"] for line in lines} == {HOSTILE, "'=b"}
    rows = random_rows(1, HOSTILE, 32, True)
    for line in lines:
        if line["factor"] != "distance_m" or line["figure"] != "IoU" or line["method"] != HOSTILE:
            continue
        low, high = float(line["from"] or "-inf"), float(line["to"] or "inf")
        inside = [r for r in rows if r.IoU is not None and low <= (r.distance_m or 0) < high]
        assert len(inside) == int(line["frames"])


def test_where_bins_begin_and_end():
    for factor in FACTORS:
        ends = [factor.ends(label) for label in factor.labels]
        if factor.zero:
            assert ends.pop(0) == (0, 0)
        assert [low for low, _ in ends[1:]] == [high for _, high in ends[:-1]] == list(factor.cuts or ())
    assert BY_NAME["room"].ends("kitchen") == (None, None)


@pytest.mark.slow
def test_the_page_in_a_browser(page: Path):
    with launch() as browser:
        for width, dark in ((1280, False), (390, True)):
            with visit(browser, page, width=width, dark=dark) as found:
                assert found.overflow == 0
                assert not found.said
                assert not found.asked
                plots = found.page.locator('[data-factor="listen-pair_accuracy"] .curve-plot')
                for plot in plots.all():
                    box = plot.bounding_box()
                    for dot in plot.locator(".curve-dot").all():
                        at = dot.bounding_box()
                        assert box["x"] <= at["x"] + at["width"] / 2 <= box["x"] + box["width"]
                        assert box["y"] - 1 <= at["y"] + at["height"] / 2 <= box["y"] + box["height"] + 1
                hidden = found.page.locator(".curves").all()
                assert [one.is_visible() for one in hidden] == [True, False]
                found.page.locator('input[value="listen-IoU"]').check()
                assert [one.is_visible() for one in hidden] == [False, True]


@pytest.mark.slow
def test_the_report_shows_factors_and_may_be_published(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    root = tiny.write_dataset(tmp_path / "data", frames=17)
    report = tmp_path / "report.html"
    code, _, error = run(capsys, submit(tmp_path / "s", root, shifted), "--dataset", root, "--html", report)
    assert (code, error) == (0, "")
    text = read_report(report).decode()
    assert '<section id="factors">' in text
    assert "<strong>|azimuth|</strong> (°)" in text
    assert "DRR: not known" in text


# --- The command ------------------------------------------------------------------------------------------------------


def tables(folder: Path, **others: Any) -> tuple[Path, Path]:
    """Two tables, the second with other values in its first row, or without its last row (``short``)."""
    first = random_rows(1, "a", 3)
    second = random_rows(2, "b", 3)
    if others.pop("short", False):
        second = second[:-1]
    update = {name: others[name] for name in others if name not in ("dataset", "dataset_sha256")}
    second = [r.model_copy(update={n: others[n] for n in others.keys() - update.keys()}) for r in second]
    second[0] = second[0].model_copy(update=update)
    write_rows(folder / "a.csv", first)
    write_rows(folder / "b.csv", second)
    return folder / "a.csv", folder / "b.csv"


@pytest.mark.parametrize(
    ("others", "said"),
    [
        ({"dataset": "other"}, "b.csv: dataset other, but "),
        ({"dataset_sha256": "b" * 64}, "b.csv: dataset.json bbbb"),
        ({"short": True}, "b.csv: no row for part_1/home/living_room/3 frame_005, which "),
        ({"protocol_version": "2.0"}, "protocol strict 2.0, but "),
        ({"truth_pixels": 999}, "999 true pixels, but "),
    ],
)
def test_tables_that_cannot_be_compared_are_one_line(tmp_path: Path, others: dict[str, Any], said: str):
    with pytest.raises(UsageError) as error:
        write_factors(tables(tmp_path, **others), html=tmp_path / "page.html", table=None)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "page.html").exists()


def test_one_to_four_tables(tmp_path: Path):
    first, _ = tables(tmp_path)
    with pytest.raises(UsageError, match="5 tables of frames: expected 1 to 4"):
        write_factors([first] * 5, html=tmp_path / "page.html", table=None)
    assert write_factors([first] * 2, html=None, table=tmp_path / "t.csv") == ("a (a) [1]", "a (a) [2]")


def test_the_command(tmp_path: Path):
    first, second = tables(tmp_path)
    html, table = tmp_path / "page.html", tmp_path / "table.csv"
    found = CliRunner().invoke(cli.factors, [str(first), str(second), "--html", str(html), "--csv", str(table)])
    assert (found.exit_code, found.output.splitlines()) == (0, [str(html), str(table)])
    assert html.exists()
    assert table.exists()


def test_bad_options_of_the_command(tmp_path: Path):
    first, second = tables(tmp_path)
    for arguments, said in (
        (
            [str(first)],
            f"name the page or the table, or both: avs3d factors {first} --html factors.html",
        ),
        ([str(first), str(second), "--csv", str(second)], "this command has not written it"),
        ([str(first), "--html", str(tmp_path / "x"), "--csv", str(tmp_path / "x")], "named twice"),
    ):
        found = CliRunner().invoke(cli.factors, arguments)
        assert isinstance(found.exception, UsageError)
        assert said in str(found.exception)
    with pytest.raises(Avs3dError, match="missing"):
        write_factors([tmp_path / "none.csv"], html=tmp_path / "page.html", table=None)


def test_the_truth_is_one_in_every_bin(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=17)
    rows = frame_rows(evaluate(submit(tmp_path / "s", root, true_mask), root), Dataset(root))
    found = [at.value for one in curves([rows]) for each in one.bins for at in each.points if at]
    assert found
    assert set(found) == {1.0}
