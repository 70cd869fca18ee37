"""What the tables of the listener say besides the figures: pairs of twins, and how rows were made."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from avs3d_bench.contract.scores import Scores
from avs3d_bench.formats.files import write_json
from benchmarks.listener_seeds import cell, class_columns, class_rows, control_rows, figures_of, strict_rows
from benchmarks.listener_summary import settings_lines, settings_text, twin_accuracy, twin_pairs

RESULTS = Path(__file__).parents[2] / "docs/results"


def scores(name: str) -> Scores:
    return Scores.model_validate_json((RESULTS / f"listener-{name}.json").read_bytes())


def test_pairs_of_twins_are_siblings_in_which_one_object_of_a_category_sounds_alone() -> None:
    pairs = twin_pairs("listen")
    assert pairs
    assert all(len({key.rpartition("/")[0] for key in pair}) == 1 for pair in pairs)
    assert twin_pairs("nowhere") == frozenset()


def test_the_pair_accuracy_of_some_pairs_is_a_mean_over_groups() -> None:
    found = scores("listen-2d")
    every = {frozenset((pair.first, pair.second)) for group in found.siblings or () for pair in group.pairs}
    assert found.overall.listen is not None
    assert twin_accuracy(found, every) == pytest.approx(found.overall.listen.pair_accuracy, abs=1e-8)
    assert twin_accuracy(found, ()) is None


def test_settings_that_differ_between_rows_are_said() -> None:
    one = {"looks": "one", "weights": "x", "only": []}
    many = {"looks": "several", "iterations": 800, "max_gaussians": 300_000, "voting_threshold": 0.3}
    assert settings_text({"only": []}) == ""
    assert settings_text(one) == "one look"
    votes = "at most 300,000 Gaussians, votes above .3 of all votes"
    assert settings_text(many) == f"several looks, 800 iterations, {votes}"
    lines = settings_lines({"2d": {"a": one, "b": one}, "spatial": {"a": many, "b": {**many, "iterations": 900}}})
    assert lines[2:-1] == [
        "- listener, 2D: one look",
        f"- listener + EchoSegnet spatial (a): several looks, 800 iterations, {votes}",
        f"- listener + EchoSegnet spatial (b): several looks, 900 iterations, {votes}",
    ]


def test_figures_of_seeds_are_a_mean_with_every_value_and_the_interval_of_the_first(tmp_path: Path) -> None:
    first = json.loads((RESULTS / "listener-listen-2d.json").read_bytes())
    for name, accuracy in {"seed0": 0.5, "seed1": 0.2}.items():
        first["parts"]["part_3"]["listen"]["pair_accuracy"] = accuracy
        write_json(tmp_path / name / "listener-listen-2d.json", first)
        first["parts"]["part_3"]["listen"]["intervals"]["pair_accuracy"] = [0.0, 0.9]
    found = figures_of((tmp_path / "seed0", tmp_path / "seed1"))["listen-2d"]["part_3"]
    one = found["pair_accuracy"]
    assert (one["mean"], one["values"]) == (0.35, [0.5, 0.2])
    assert one["interval"] not in (None, [0.0, 0.9])
    assert cell(one) == ".350 (.200–.500)"


def test_what_the_network_sees_is_a_column_for_each_run_that_has_it_and_a_dash_where_none_stands(
    tmp_path: Path,
) -> None:
    for name, clock in {"seed0": 0.5, "seed1": 0.2}.items():
        seen = {"class_iou": {"clock": clock, "toilet": None}, "calibration_error": 0.1, "average_precision": clock}
        write_json(tmp_path / name / "classes-open-scans.json", {"datasets": {"open-scans": seen}})
    runs = {"package": {}, "": figures_of((tmp_path / "seed0", tmp_path / "seed1"))}
    assert class_columns(runs) == [("open-scans", "")]
    rows = {row[0]: row[1:] for row in class_rows(runs)}
    assert rows["IoU, clock"] == [".350 (.200–.500)"]
    assert rows["IoU, toilet"] == ["–"]
    assert rows["calibration error above .1"] == [".100 (.100–.100)"]


def test_a_row_that_a_run_lacks_has_a_dash() -> None:
    figure = {"mean": 0.25, "values": [0.25], "interval": None}
    found = {"open-s34-o7-2d": {part: {"strict_IoU": figure} for part in ("part_1", "part_2")}}
    assert strict_rows({"package": found, "": {}})[0] == ["test voices", "network", "part_1", ".250", "–"]
    rows = {row[0]: row[1:] for row in control_rows(found, ["open-s34-o7"])}
    assert rows["own"] == [".250", ".250", "–", "–", "–"]
    assert rows["swapped-ears"] == ["–"] * 5


def test_the_cell_of_one_seed_has_its_interval_over_homes() -> None:
    assert cell({"mean": 0.25, "values": [0.25], "interval": [0.1, 0.4]}) == ".250 [.10–.40]"
    assert cell({"mean": 0.25, "values": [0.25], "interval": None}) == ".250"
