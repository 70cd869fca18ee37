"""The tables of the listener: how rows were made, figures of seeds, controls, aims."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from avs3d_bench.formats.files import write_json
from benchmarks import listener_aims
from benchmarks.listener_seeds import (
    cell,
    class_columns,
    class_rows,
    control_rows,
    figures_of,
    strict_rows,
    summary_rows,
)
from benchmarks.listener_summary import settings_lines, settings_text

RESULTS = Path(__file__).parents[2] / "docs/results"


def test_settings_that_differ_between_rows_are_said() -> None:
    one = {"looks": "one", "weights": "x", "only": []}
    many = {"looks": "several", "iterations": 800, "max_gaussians": 300_000, "voting_threshold": 0.3}
    assert settings_text({"only": []}) == ""
    assert settings_text(one) == "one look"
    votes = "at most 300,000 Gaussians, votes above .3 of all votes"
    assert settings_text(many) == f"several looks, 800 iterations, {votes}"
    assert settings_lines({"category": {"only": []}}) == []
    assert settings_lines({"2d": one, "category": {}, "spatial": many})[2:-1] == [
        "- listener, 2D: one look",
        f"- listener + EchoSegnet spatial: several looks, 800 iterations, {votes}",
    ]


def test_figures_of_seeds_are_a_mean_with_every_value_and_the_interval_of_the_first(tmp_path: Path) -> None:
    first = json.loads((RESULTS / "listen-oracle-sounding.json").read_bytes())
    for name, accuracy in {"seed0": 0.5, "seed1": 0.2}.items():
        first["parts"]["part_3"]["listen"]["pair_accuracy"] = accuracy
        write_json(tmp_path / name / "listener-listen-2d.json", first)
        first["parts"]["part_3"]["listen"]["intervals"]["pair_accuracy"] = [0.0, 0.9]
    write_json(tmp_path / "seed0" / "listener-listen-both.json", first)  # not of every seed
    every = figures_of((tmp_path / "seed0", tmp_path / "seed1"))
    assert list(every) == ["listen-2d"]
    one = every["listen-2d"]["part_3"]["pair_accuracy"]
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
    assert strict_rows({"package": found, "": {}}) == [["test voices", "network", ".250", "–", ".250", "–"]]
    other = {"open-s34-o7-both": {"part_1": {"strict_IoU": figure | {"mean": 0.5}}}}
    equal = {f"open-s34-o7-{row}": found["open-s34-o7-2d"] for row in ("2d", "direction")}
    assert [row[:2] for row in strict_rows({"package": equal | other})] == [
        ["test voices", "network and direction"],
        ["test voices", "both"],
    ]
    assert summary_rows(found) == [["network", ".250", ".250", *["–"] * 4]]


def test_controls_are_those_of_each_answer_that_were_measured() -> None:
    figure = {"mean": 0.25, "values": [0.25], "interval": None}
    parts = {part: {"strict_IoU": figure} for part in ("part_1", "part_2")}
    scenes = {"part_3": {"twins": figure, "pair_accuracy": figure | {"values": [0.5]}}}
    found = {
        "open-s34-o7-2d": parts, "open-s34-o7-swapped-ears": parts,
        "listen-direction-no-sound": scenes, "listen-both-no-sound": scenes,
        "listen-spatial-direction": scenes,  # without a control
        "listen-spatial-swapped-ears": scenes,
    }  # fmt: skip
    assert control_rows(found) == [
        ["test voices", "network", ".250, .250", "–", ".250, .250", "–", "–", "–"],
        ["`listen`, test voices", "direction and both", "–", ".250, .500", "–", "–", "–", "–"],
        ["`listen`, test voices", "EchoSegnet spatial, by name", "–", "–", ".250, .500", "–", "–", "–"],
    ]


def test_an_aim_is_met_or_missed_by_the_package_and_a_loss_is_that_of_the_worse_part() -> None:
    def of(*values: float) -> dict[str, Any]:
        return {"mean": sum(values) / len(values), "values": [*values], "interval": None}

    usual = {"part_1": {"strict_IoU": of(0.5, 0.7)}, "part_2": {"strict_IoU": of(0.8, 0.6)}}
    heads = {"part_1": {"strict_IoU": of(0.5, 0.6)}, "part_2": {"strict_IoU": of(0.7, 0.6)}}
    seeds = {"open-s34-o7-2d": usual, "open-s34-o7-heads-2d": heads}
    package = {"open-s34-o7-2d": {"part_1": {"strict_IoU": of(0.75)}, "part_2": {"strict_IoU": of(0.7)}}}
    rows = {row[0]: row[1:] for row in listener_aims.aim_rows(package, seeds)}
    assert rows["strict IoU with test voices, part_1 ≥ .75"] == [".750", ".600 (.500–.700)", "met"]
    assert rows["strict IoU with test voices, part_2 ≥ .75"] == [".700", ".700 (.600–.800)", "missed by .05"]
    assert rows["loss with other heads ≤ .05"] == ["–", ".100 (.100–.100)", "not measured"]
    heads["observations"] = [33, 34]  # of other observations it is no loss
    usual["observations"] = [34, 34]
    again = {row[0]: row[1:] for row in listener_aims.aim_rows(package, seeds)}
    assert again["loss with other heads ≤ .05"] == ["–", "–", "not measured"]
    assert rows["class map, IoU of clocks ≥ .65"] == ["–", "–", "not measured"]
    # An aim for masks in 2D has a row for each answer.
    package["open-s34-o7-both"] = {"part_1": {"strict_IoU": of(0.8)}}
    titled = [row[:2] for row in listener_aims.aim_rows(package, seeds)]
    place = titled.index(["strict IoU with test voices, part_1 ≥ .75", ".750"])
    assert titled[place + 1] == ["… by name and direction ≥ .75", ".800"]
    assert sum("by name and direction" in title for title, _ in titled) == 11


def test_what_is_marked_in_silence_is_told_from_what_is_marked_while_other_rooms_sound(tmp_path: Path) -> None:
    scores = json.loads((RESULTS / "listen-pipeline-spatial.json").read_bytes())
    unheard = [one for one in scores["observations"] if not one["listen"]["visible_frames"]]
    # The observations in silence have no category.
    silent, elsewhere = ([one for one in unheard if bool(one["category"]) == named] for named in (False, True))
    assert [one["listen"]["FP_rate"] for one in silent] == [0.0] * 4
    assert elsewhere
    for one in elsewhere:
        one["listen"]["FP_rate"] = 0.25
    write_json(tmp_path / "listener-listen-2d.json", scores)
    package = figures_of((tmp_path,))
    rows = {row[0]: row[1:] for row in listener_aims.aim_rows(package, {})}
    assert rows["marked in silence ≤ .01"] == [".000", "–", "met"]
    assert rows["marked with sounds of other rooms alone ≤ .05"] == [".250", "–", "missed by .20"]


def test_the_cell_of_one_seed_has_its_interval_over_homes() -> None:
    assert cell({"mean": 0.25, "values": [0.25], "interval": [0.1, 0.4]}) == ".250 [.10–.40]"
    assert cell({"mean": 0.25, "values": [0.25], "interval": None}) == ".250"
