"""`avs3d sweep-curve`: which scores make a point, the files, the picture, and the messages."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from avs3d_bench.contract.scores import Scores
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from evaluators.reporting.sweep_cli import sweep_curve
from evaluators.reporting.sweep_curve import csv_text, markdown_text, read_sweep, value_text
from evaluators.reporting.sweep_files import write_sweep
from evaluators.score import evaluate
from evaluators.statistics.bootstrap import clustered_interval, difference_interval, interval
from tests.evaluators.test_score import submit, true_mask
from tests.support import tiny, tiny_scenes
from tests.support.score_examples import example_scores, with_means
from tests.support.tiny_scenes import AWAY, FIRST, SECOND

SCALE, SNR, KIND = "acoustics.absorption_scale", "background.snr_db", "background.kind"
SCALES = (0.5, 1.0, 2.0)
#: Six originals of part_2; the variants of the n-th have the indices 10 n + 1, 10 n + 2, …
ORIGINALS = range(1, 7)


def rows_of_part_2(value: Callable[[int, float], float], method: str = "a") -> Scores:
    """Scores of part_2: observation n at scale s has a strict IoU of ``value(n, s)``."""
    keys = [f"part_2/flat/kitchen/{10 * n + at}" for n in ORIGINALS for at in range(len(SCALES))]
    data = example_scores(keys, method=method, dataset={"sha256": None}).model_dump(mode="json")
    for row in data["observations"]:
        n, at = divmod(int(row["key"].rpartition("/")[2]), 10)
        scale = SCALES[at]
        row["strict"]["IoU"] = value(n, scale)
        row["condition"] = {"variant_of": f"part_2/flat/kitchen/{10 * n}", "values": {SCALE: scale}, "t30": 0.5 / scale}
    return Scores.model_validate(with_means(data))


def scenes(right: dict[float | None, int], *, kinds: Sequence[str] = ("noise",), method: str = "a") -> Scores:
    """Scores of part_3: six groups of two siblings; of a group's 10 frames under an SNR, so many are right.

    Pairs of siblings under different conditions are all wrong.
    """
    data = example_scores(1, method=method, dataset={"sha256": None}).model_dump(mode="json")
    data["avs3d_eval"]["protocols"] = {"listen": "1.0"}
    points = [(snr, kind) for snr in right for kind in (kinds if snr is not None else (None,))]
    rows, siblings = [], []
    for group in ORIGINALS:
        keys, where = [], {}
        for sibling in (1, 2):
            for at, (snr, kind) in enumerate(points):
                key = f"part_3/flat/kitchen/{100 * group + 50 * (sibling - 1) + at + 1}"
                values = {SCALE: 1.0, SNR: snr, KIND: kind}
                keys.append(key)
                where[key] = (snr, kind)
                rows.append(
                    {
                        "key": key, "part": "part_3", "scan": "flat", "room": "kitchen", "category": "clock",
                        "group": f"part_3/flat/kitchen/{100 * group + 1}", "frames": 10,
                        "condition": {
                            "variant_of": f"part_3/flat/kitchen/{100 * group + 50 * (sibling - 1) + 1}",
                            "values": values, "t30": 0.4,
                        },
                        "listen": {
                            "pair_accuracy": None, "IoU": right[snr] / 11 + 0.01 * group, "FP_rate": None,
                            "FP_area": None, "class_mIoU": None, "visible_frames": 10, "absent_frames": 0,
                            "pair_frames": 10, "class_IoU": {},
                        },
                    }
                )  # fmt: skip
        pairs = [
            {
                "first": a, "second": b, "frames": 10,
                "right": min(10, right[where[a][0]] + group % 2) if where[a] == where[b] else 0,
            }
            for n, a in enumerate(keys) for b in keys[n + 1 :]
        ]  # fmt: skip
        siblings.append({"group": f"part_3/flat/kitchen/{100 * group + 1}", "observations": keys, "pairs": pairs})
    for row in rows:
        mine = [pair for one in siblings for pair in one["pairs"] if row["key"] in (pair["first"], pair["second"])]
        row["listen"]["pair_frames"] = sum(pair["frames"] for pair in mine)
        row["listen"]["pair_accuracy"] = sum(pair["right"] for pair in mine) / row["listen"]["pair_frames"]
    data |= {"observations": rows, "siblings": siblings, "references": {}, "references_unavailable": {}}
    data["dataset"] |= {"observations": len(rows), "scored": len(rows)}
    return Scores.model_validate(with_means(data))


def saved(folder: Path, **scores: Scores) -> list[Path]:
    for name, one in scores.items():
        media.write_json(folder / f"{name}.json", one)
    return [folder / f"{name}.json" for name in scores]


def test_a_point_has_the_mean_and_interval_of_its_observations(tmp_path: Path) -> None:
    def value(n: int, scale: float) -> float:
        return 0.05 * n / scale

    files = saved(tmp_path, a=rows_of_part_2(value))
    found = read_sweep(files, figures=["strict.IoU"])
    (curve,) = found.curves
    assert (found.field, curve.setting, [point.value for point in curve.points]) == (SCALE, (), list(SCALES))
    for point in curve.points:
        assert point.group.strict is not None
        assert isinstance(point.value, float)
        values = [value(n, point.value) for n in ORIGINALS]
        assert point.group.strict.IoU == pytest.approx(np.mean(values), abs=1e-12)
        assert point.group.strict.intervals["IoU"] == pytest.approx(interval(values))
        assert point.t30 == pytest.approx(0.5 / point.value)


def test_pairs_count_under_one_condition_only(tmp_path: Path) -> None:
    right: dict[float | None, int] = {None: 9, 10.0: 6, 0.0: 2}
    found = read_sweep(saved(tmp_path, a=scenes(right)))
    assert found.field == SNR
    assert [f"{m.protocol}.{m.name}" for m in found.metrics] == ["listen.pair_accuracy", "listen.IoU"]
    for point in found.curves[0].points:
        listen = point.group.listen
        assert listen is not None
        groups = [[(right[point.value] + n % 2) / 10] for n in ORIGINALS]  # type: ignore[index]
        assert listen.pair_accuracy == pytest.approx(np.mean(groups))
        assert listen.intervals["pair_accuracy"] == pytest.approx(clustered_interval(groups))
        assert (listen.groups, listen.counts["IoU"], listen.counts["pair_accuracy"]) == (6, 12, 6)
    noisy = next(point for point in found.curves[0].points if point.value == 0.0)
    changes = [found.curves[0].change(noisy, metric, found.reference) for metric in found.metrics]
    assert [change and (change.units, round(change.mean, 6)) for change in changes] == [
        (6, -0.7),
        (12, round(-7 / 11, 6)),
    ]


def test_other_parameters_are_settings(tmp_path: Path) -> None:
    found = read_sweep(saved(tmp_path, a=scenes({None: 9, 5.0: 4}, kinds=("noise", "room_tone"))), over=SNR)
    assert [(curve.setting, [point.value for point in curve.points]) for curve in found.curves] == [
        # Without a background there is no kind of it.
        (((KIND, "noise"),), [None, 5.0]),
        (((KIND, "room_tone"),), [None, 5.0]),
    ]


def test_the_files_hold_every_figure(tmp_path: Path) -> None:
    one = rows_of_part_2(lambda n, scale: 0.05 * n / scale, "one")
    two = rows_of_part_2(lambda n, scale: 0.06 * n / scale, "two")
    found = read_sweep(saved(tmp_path, a=one, b=two), figures=["strict.IoU"])
    table = pd.read_csv(StringIO(csv_text(found)))
    assert list(table.columns) == ["method", SCALE, "t30", "figure", "n", "mean", "low", "high", "change", "change_low",
                                   "change_high"]  # fmt: skip
    assert list(zip(table["method"], table[SCALE], strict=True)) == [(m, s) for m in ("one", "two") for s in SCALES]
    assert table["mean"].tolist() == pytest.approx([0.35, 0.175, 0.0875, 0.42, 0.21, 0.105])
    assert (table["low"] < table["mean"]).all()
    assert (table["mean"] < table["high"]).all()
    assert set(table["n"]) == {6}
    # Paired: 0.05 n / scale − 0.05 n at scale 1, from which nothing changes.
    assert table["change"].fillna(-9).tolist() == pytest.approx([0.175, -9, -0.0875, 0.21, -9, -0.105])
    spread = difference_interval([[0.05 * n] for n in ORIGINALS])
    assert spread is not None
    assert table[["change_low", "change_high"]].iloc[0].tolist() == pytest.approx([spread.low, spread.high])
    lines = markdown_text(found, False).splitlines()
    assert "| acoustics.absorption_scale | 0.5 | 1 | 2 |" in lines
    assert "| T30 (s) | 1.00 | 0.50 | 0.25 |" in lines
    assert "| n, strict IoU | 6 | 6 | 6 |" in lines
    assert any(line.startswith("| IoU, one | 0.350 (0.") for line in lines)


@pytest.mark.parametrize("method", ["=1+1", "@SUM(A1)", "a|b\nc"])
def test_no_cell_begins_a_formula_or_breaks_the_table(tmp_path: Path, method: str) -> None:
    found = read_sweep(saved(tmp_path, a=rows_of_part_2(lambda n, scale: 0.1, method)))
    table = pd.read_csv(StringIO(csv_text(found)))
    assert not table["method"].str.match(r"\s*[=+\-@]").any()
    rows = [line for line in markdown_text(found, False).splitlines() if line.startswith("|")]
    assert {row.replace("\\|", "").count("|") for row in rows} == {5}


def test_a_condition_that_no_sweep_makes_is_no_file_of_scores(tmp_path: Path) -> None:
    files = saved(tmp_path, a=rows_of_part_2(lambda n, scale: 0.1))
    files[0].write_text(files[0].read_text().replace(SCALE, "=cmd"))
    assert "condition.values" in refused(files)


def test_noise_goes_from_none_to_loud(tmp_path: Path) -> None:
    found = read_sweep(saved(tmp_path, a=scenes({0.0: 1, 20.0: 8, None: 9, -10.0: 0})))
    assert "| background.snr_db | none | 20 | 0 | -10 |" in markdown_text(found, False)
    assert [value_text(value) for value in (None, "noise", 2.5, 20.0)] == ["none", "noise", "2.5", "20"]


def test_the_picture_shows_a_curve_per_method_and_is_the_same_again(tmp_path: Path) -> None:
    files = saved(tmp_path, a=scenes({None: 9, 10.0: 7, 0.0: 2}), b=scenes({None: 5, 10.0: 4, 0.0: 1}, method="b"))
    outcome = CliRunner().invoke(sweep_curve, [*map(str, files), "-o", str(tmp_path / "out")], catch_exceptions=False)
    assert outcome.exit_code == 0, outcome.output
    assert outcome.output.split() == [str(tmp_path / "out" / f"curve.{suffix}") for suffix in ("csv", "md", "png")]
    data = (tmp_path / "out/curve.png").read_bytes()
    write_sweep(tmp_path / "again", files)
    assert (tmp_path / "again/curve.png").read_bytes() == data
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    # The two colours of the methods, BGR, in both halves: a panel per figure.
    for colour in ((0x97, 0x6F, 0x2A), (0x2F, 0x60, 0xD1)):
        columns = np.flatnonzero((np.abs(picture.astype(int) - colour).max(axis=2) < 12).sum(axis=0) > 2)
        middle = picture.shape[1] / 2
        assert columns.min() < middle < columns.max()


def test_the_panels_hold_the_figures(tmp_path: Path) -> None:
    from evaluators.reporting.sweep_plot import sweep_figure

    drawn = sweep_figure(
        read_sweep(saved(tmp_path, a=rows_of_part_2(lambda n, s: 0.05 * n / s)), figures=["strict.IoU"])
    )
    (axes,) = drawn.axes
    curve = max(axes.lines, key=lambda line: len(np.atleast_1d(line.get_xdata())))
    assert np.asarray(curve.get_ydata()).tolist() == pytest.approx([0.35, 0.175, 0.0875])
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0.5\n1.00 s", "1\n0.50 s", "2\n0.25 s"]


def refused(files: Sequence[Path], **options: Any) -> str:
    with pytest.raises(Avs3dError) as caught:
        read_sweep(files, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_what_makes_no_curve_is_refused_in_one_line(tmp_path: Path) -> None:
    plain, part_2 = example_scores(6), rows_of_part_2(lambda n, scale: 0.1)
    files = saved(tmp_path, plain=plain, part_2=part_2, scenes=scenes({None: 9, 0.0: 2}))
    assert refused(files[:1]) == (
        f"{files[0]}: no observations that are variants of one another; expected scores on a dataset made "
        "from a manifest of avs3d sweep"
    )
    assert "scores on different datasets or observations; give one" in refused(files[1:])
    assert refused(files[1:2], over=SNR) == f"--over {SNR}: does not vary in {files[1]}; expected {SCALE}"
    assert refused(files[1:2], figures=["strict.IOU"]).startswith("--figure strict.IOU: expected one of official.mIoU")
    assert refused(files[2:], figures=["strict.IoU"]) == (
        "the files of scores hold none of strict.IoU; choose others with --figure"
    )
    both = saved(tmp_path, both=scenes({None: 9, 0.0: 2, 5.0: 3}, kinds=("noise", "room_tone")))
    assert refused(both) == f"{both[0]}: {KIND} and {SNR} vary; name one with --over"
    with pytest.raises(UsageError, match=r"would overwrite .*curve\.csv, which is read"):
        write_sweep(tmp_path, [saved(tmp_path, curve=part_2)[0].rename(tmp_path / "curve.csv")], plot=False)


def test_a_file_of_scores_states_the_conditions_of_variants(tmp_path: Path) -> None:
    data = tiny_scenes.write_part_3(tmp_path / "data", frames=9, size=32, keys=(FIRST, SECOND, AWAY))
    plain = evaluate(submit(tmp_path / "plain", data, true_mask), data).scores
    assert all(row.condition is None for row in plain.observations)
    assert '"condition"' not in media.dump_json(plain)
    path = data / AWAY / "observation.json"
    record = json.loads(path.read_text())
    record["variant_of"] = FIRST
    record["acoustics"] |= {"settings": {"absorption_scale": 0.5}, "t30": 0.8}
    tiny.replace(path, json.dumps(record).encode())
    scores = evaluate(submit(tmp_path / "again", data, true_mask), data).scores
    found = {row.key: row.condition for row in scores.observations}
    assert found[SECOND] is None
    first, variant = found[FIRST], found[AWAY]
    assert first is not None
    assert variant is not None
    assert (first.variant_of, first.t30, first.values) == (FIRST, None, {SCALE: 1.0, SNR: None, KIND: None})
    assert (variant.variant_of, variant.t30, variant.values) == (FIRST, 0.8, {SCALE: 0.5, SNR: 10.0, KIND: "noise"})
