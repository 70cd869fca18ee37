"""The table of frames: its rows add up to the file of scores, its factors are those of the scene, in both formats."""

from __future__ import annotations

import csv
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.contract import layout
from avs3d_bench.contract.frame_rows import COLUMNS, FrameRow
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.geometry import direction_to
from evaluators.reading.records import Evaluation
from evaluators.reporting.factors import write_factors
from evaluators.score import evaluate
from evaluators.statistics import factors, frame_rows
from evaluators.statistics.frame_rows import read_rows, write_rows
from generators.acoustics import direct, geometry
from tests.evaluators.test_score import run, shifted, submit, twin
from tests.support import tiny, tiny_scenes
from tests.support.tiny import MULTI, SINGLE
from tests.support.tiny_scenes import AWAY, BOTH, FIRST, SILENT

FRAMES = 17  # three test frames: 0, 8 and 16


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Evaluation]:
    root = tiny.write_dataset(tmp_path_factory.mktemp("frames") / "data", frames=FRAMES)
    return root, evaluate(submit(root.parent / "submission", root, shifted), root)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Evaluation]:
    root = tiny_scenes.write_part_3(tmp_path_factory.mktemp("frames") / "scenes", frames=FRAMES)
    return root, evaluate(submit(root.parent / "submission", root, shifted), root)


def rows_of(scored: tuple[Path, Evaluation]) -> dict[tuple[str, str], FrameRow]:
    root, evaluation = scored
    return {(row.key, row.frame): row for row in frame_rows.frame_rows(evaluation, Dataset(root))}


def mean(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return math.fsum(known) / len(known) if known else None


# --- Rows -------------------------------------------------------------------------------------------------------------


def test_the_rows_of_an_observation_add_up_to_its_scores(scored: tuple[Path, Evaluation]):
    rows = rows_of(scored)
    assert len(rows) == 6
    for one in scored[1].scores.observations:
        mine = [row for (key, _), row in rows.items() if key == one.key]
        assert len(mine) == one.frames
        strict = one.strict
        assert strict is not None
        for name in ("IoU", "F", "boundary_F"):
            assert mean([getattr(row, name) for row in mine]) == getattr(strict, name)
        assert sum(row.truth_pixels > 0 for row in mine) == strict.visible_frames
        absent = [row for row in mine if not row.truth_pixels]
        assert mean([row.predicted_pixels / row.pixels for row in absent]) == strict.FP_area
        assert {row.protocol for row in mine} == {"strict"}


def test_twins_of_the_rows_are_those_of_the_scores(scored: tuple[Path, Evaluation], tmp_path: Path):
    root, _ = scored
    evaluation = evaluate(submit(tmp_path / "s", root, twin), root)
    rows = [row for row in rows_of((root, evaluation)).values() if row.key == MULTI]
    strict = next(one.strict for one in evaluation.scores.observations if one.key == MULTI)
    seen = [row for row in rows if row.twins_visible]
    assert strict is not None
    assert len(seen) == strict.twin_frames
    assert seen
    assert mean([float(row.twins_marked > 0) for row in seen]) == strict.wrong_instance_rate == 1.0
    assert all(row.twins_visible is None for row in rows_of((root, evaluation)).values() if row.key == SINGLE)


def test_the_pairs_of_the_rows_are_those_of_the_scores(scenes: tuple[Path, Evaluation]):
    rows = rows_of(scenes)
    for one in scenes[1].scores.observations:
        mine = [row for (key, _), row in rows.items() if key == one.key]
        listen = one.listen
        assert listen is not None
        pairs = sum(row.pairs or 0 for row in mine)
        assert pairs == listen.pair_frames
        assert sum(row.pairs_right or 0 for row in mine) / pairs == listen.pair_accuracy
        assert mean([row.IoU for row in mine]) == listen.IoU
        assert {(row.protocol, row.group) for row in mine} == {("listen", FIRST)}


def test_each_row_names_what_was_scored(scored: tuple[Path, Evaluation]):
    _, evaluation = scored
    for row in rows_of(scored).values():
        assert (row.method, row.dataset) == ("test", "tiny")
        assert row.dataset_sha256 == evaluation.scores.dataset.sha256 is not None
        assert row.protocol_version == evaluation.scores.avs3d_eval.protocols["strict"]


# --- Factors ----------------------------------------------------------------------------------------------------------


def test_the_factors_of_one_source_are_those_of_the_scene(scored: tuple[Path, Evaluation]):
    rows = rows_of(scored)
    box = next(box for box in tiny.BOXES[MULTI] if box.sounding)
    other = next(box for box in tiny.BOXES[MULTI] if not box.sounding)
    for index in (0, 8, 16):
        row = rows[MULTI, layout.frame_name(index)]
        where = direction_to(tiny.path_of(FRAMES)[index], box.source)
        assert row.distance_m == pytest.approx(where.distance, abs=1e-6)
        assert row.azimuth_deg == pytest.approx(where.azimuth, abs=1e-6)
        assert row.elevation_deg == pytest.approx(where.elevation, abs=1e-6)
        assert (row.category, row.room, row.twins) == ("microwave", "kitchen", 1)
        middle = np.add(other.low, other.high) / 2
        assert row.twin_distance_m == pytest.approx(math.dist(middle, box.source), abs=1e-6)
        assert row.visible_share == row.truth_pixels / 64**2


def test_an_oven_is_no_twin_of_a_microwave(scored: tuple[Path, Evaluation]):
    row = rows_of(scored)[SINGLE, "frame_000"]
    assert (row.twins, row.twin_distance_m) == (0, None)
    assert row.unavailable["twin_distance_m"] == factors.NO_TWIN
    assert row.unavailable["snr_db"] == factors.ALONE
    assert row.unavailable["t30_s"] == factors.NO_T30
    assert row.unavailable["drr_db"] == factors.NO_RESPONSES


def test_a_reverberation_time_is_taken_over(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=1, size=16)
    tiny.edit_record(root, SINGLE, lambda data: data["acoustics"].update(t30=0.62))
    found = factors.frame_factors(Dataset(root)[SINGLE].test[0])
    assert found.t30_s == 0.62
    assert "t30_s" not in found.unavailable


def test_the_source_of_a_part_3_is_the_loudest(scenes: tuple[Path, Evaluation]):
    root, _ = scenes
    rows = rows_of(scenes)
    record = Dataset(root)[BOTH].record
    assert record is not None
    heard = 0
    for frame in record.frames:
        row = rows.get((BOTH, frame.name))
        if row is None or not frame.audible:
            continue
        heard += 1
        loudest = max(frame.audible, key=lambda one: one.level_db)
        source = record.source(loudest.source)
        where = direction_to(frame.pose, source.position)
        assert (row.category, row.distance_m, row.azimuth_deg) == (source.category, where.distance, where.azimuth)
        assert (row.drr_db, row.snr_db) == (loudest.drr_db, loudest.snr_db)
        silent = {one.id for one in record.instances if one.category == source.category}
        assert row.twins == len(silent - {*record.audible_instances(frame)})
    assert heard


def test_silence_and_sound_from_elsewhere(scenes: tuple[Path, Evaluation]):
    rows = rows_of(scenes)
    silent, away = rows[SILENT, "frame_008"], rows[AWAY, "frame_008"]
    assert (silent.category, silent.distance_m, silent.snr_db, silent.twins) == (None,) * 4
    assert silent.unavailable["distance_m"] == silent.unavailable["twins"] == factors.NOTHING_AUDIBLE
    pose = tiny.path_of(FRAMES)[8]
    assert away.distance_m == pytest.approx(math.dist(pose.position, tiny_scenes.ELSEWHERE), abs=1e-6)
    assert away.snr_db == pytest.approx(10, abs=6)
    assert (away.IoU, away.truth_pixels) == (None, 0)


def test_the_official_release_has_sizes_and_reasons(tmp_path: Path):
    root = tiny.write_release(tmp_path / "release", frames=FRAMES)
    found = rows_of((root, evaluate(submit(tmp_path / "s", root, shifted), root)))
    for row in found.values():
        assert row.visible_share == row.truth_pixels / 64**2
        assert row.unavailable == dict.fromkeys(factors.NAMES, factors.NO_RECORD)
        assert all(getattr(row, name) is None for name in factors.NAMES)
    assert {row.visible_share for row in found.values()} > {0.0}


def test_every_null_factor_has_a_reason_and_no_other(scored: Any, scenes: Any):
    for row in (*rows_of(scored).values(), *rows_of(scenes).values()):
        assert {name for name in factors.NAMES if getattr(row, name) is None} == row.unavailable.keys()


# --- DRR from impulse responses ---------------------------------------------------------------------------------------


def response(distance: float, direct: float, late: float, rate: int = 44_100) -> np.ndarray:
    """(2, n): a tap of energy ``direct`` at distance / 343 m/s, and one of energy ``late`` 50 ms later, in each ear."""
    found = np.zeros((2, 8000))
    at = round(distance / 343 * rate)
    found[:, at], found[:, at + round(0.05 * rate)] = math.sqrt(direct), math.sqrt(late)
    return found


@pytest.mark.parametrize(("direct", "late", "expected"), [(1, 1, 0), (10, 1, 10), (1, 100, -20)])
@pytest.mark.parametrize("distance", [0.05, 1.0, 7.3])
def test_the_ratio_of_two_taps(distance: float, direct: float, late: float, expected: float):
    assert factors.direct_to_reverberant(response(distance, direct, late), distance) == pytest.approx(expected)


def test_what_comes_before_and_after_the_window_is_not_direct():
    there = response(2.0, 1, 1)
    assert factors.direct_to_reverberant(there, 2.0) == pytest.approx(0)
    assert factors.direct_to_reverberant(there, 2.0 + 0.7) == -math.inf  # 2 ms later: nothing at that time
    assert factors.direct_to_reverberant(response(2.0, 1, 0), 2.0) == math.inf


@pytest.mark.parametrize(
    ("free", "late", "expected"),
    [(True, 0.1, 10.0), (False, 0.1, factors.NO_DIRECT_SOUND), (True, 0.0, factors.NO_REVERBERATION)],
)
def test_the_ratio_of_a_dataset_with_responses(tmp_path: Path, free: bool, late: float, expected: float | str):
    root = tiny.write_dataset(tmp_path / "data", frames=1, size=16, extras=True, keys=(SINGLE,))
    tiny.edit_record(root, SINGLE, lambda data: data["frames"][0].update(line_of_sight=free))
    frame = Dataset(root)[SINGLE].test[0]
    assert frame.record is not None
    assert frame.record.distance is not None
    media.write_rir(root / SINGLE / layout.rir_path(0), response(frame.record.distance, 1, late))
    found = factors.frame_factors(frame)
    if isinstance(expected, str):
        assert (found.drr_db, found.unavailable["drr_db"]) == (None, expected)
    else:
        assert found.drr_db == pytest.approx(expected, abs=1e-4)


def test_the_direct_sound_is_that_of_the_generator():
    assert (factors.BEFORE, factors.AFTER) == (direct.BEFORE, direct.AFTER)
    assert geometry.SPEED_OF_SOUND == factors.SPEED_OF_SOUND


# --- Files ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".CSV"])
def test_a_table_is_read_as_it_was_written(scored: Any, scenes: Any, tmp_path: Path, suffix: str):
    rows = (*rows_of(scored).values(), *rows_of(scenes).values())
    path = tmp_path / f"frames{suffix}"
    write_rows(path, rows)
    assert read_rows(path) == rows
    first = path.read_bytes()
    write_rows(path, rows)
    assert path.read_bytes() == first


def test_other_programs_read_the_table(scored: Any, tmp_path: Path):
    pandas = pytest.importorskip("pandas")
    rows = tuple(rows_of(scored).values())
    for name in ("frames.csv", "frames.parquet"):
        write_rows(tmp_path / name, rows)
    tables = [pandas.read_csv(tmp_path / "frames.csv"), pandas.read_parquet(tmp_path / "frames.parquet")]
    for table in tables:
        assert tuple(table.columns) == COLUMNS
        assert table["IoU"].mean() == pytest.approx(mean([row.IoU for row in rows]))
        assert json.loads(table["unavailable"][0]) == rows[0].unavailable
    assert tables[1]["truth_pixels"].dtype == "int64"


@pytest.mark.parametrize("method", ["=1+1", "'quoted", "@x", 'a "b", c\nd', "Méthode 方法"])
def test_any_name_of_a_method_survives_and_is_no_formula(scored: Any, tmp_path: Path, method: str):
    rows = tuple(row.model_copy(update={"method": method}) for row in rows_of(scored).values())
    for suffix in (".csv", ".parquet"):
        path = tmp_path / f"frames{suffix}"
        write_rows(path, rows)
        assert read_rows(path) == rows
    with (tmp_path / "frames.csv").open(encoding="utf-8", newline="") as stream:
        assert {row["method"][0] for row in csv.DictReader(stream)}.isdisjoint("=+-@")


def _replace(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("distance_m", "distance_ft", "no column 'distance_m'; expected a table of version 1.0"),
        (",4096,60,", ",4096,many,", "row 1: truth_pixels: "),
        ("1.0,test", "2.0,test", "row 1: frames_version: "),
        ("strict,1.0", "loose,1.0", "row 1: protocol: "),
        ('{""drr_db""', '{""drr', "row 1: unavailable: no JSON"),
    ],
)
def test_a_damaged_table_is_one_line(scored: Any, tmp_path: Path, old: str, new: str, said: str):
    path = tmp_path / "frames.csv"
    write_rows(path, tuple(rows_of(scored).values()))
    _replace(path, old, new)
    with pytest.raises(Avs3dError, match="avs3d-eval --frames") as error:
        read_rows(path)
    assert str(error.value).startswith(f"{path}: {said}")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("name", "data"), [("a.csv", b"\xff\xfe"), ("a.parquet", b"PAR1"), ("a.csv", b"")])
def test_a_file_that_is_no_table_is_one_line(tmp_path: Path, name: str, data: bytes):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(Avs3dError, match=r"expected a table .*that avs3d-eval --frames wrote") as error:
        read_rows(tmp_path / name)
    assert "\n" not in str(error.value)


def test_a_table_without_rows_is_refused(tmp_path: Path):
    write_rows(tmp_path / "a.csv", ())
    with pytest.raises(Avs3dError, match="no row"):
        read_rows(tmp_path / "a.csv")


# --- The command ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_command_writes_the_table(scored: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str):
    root, evaluation = scored
    path = tmp_path / f"frames{suffix}"
    code, said, _ = run(capsys, root.parent / "submission", "--dataset", root, "--frames", path, "--workers", 1)
    assert code == 0
    assert str(path) in said.splitlines()
    assert read_rows(path) == tuple(rows_of(scored).values())
    assert evaluation.scores.dataset.scored == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--frames", "frames.txt"], "frames.txt: a table of frames is CSV or Parquet; expected a name ending in"),
        (["--frames", "frames"], "frames: a table of frames is CSV or Parquet"),
        (["--frames", "frames.csv", "--protocol", "official"], "frames.csv: --frames has the figures of strict"),
        (["--frames", "frames.csv", "--json", "frames.csv"], "frames.csv: named twice; expected a name of its own"),
    ],
)
def test_bad_options_are_one_line_before_any_work(
    scored: Any, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str,
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
):  # fmt: skip
    root, _ = scored
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("evaluators.score.score", lambda *_, **__: pytest.fail("scored"))
    code, _, error = run(capsys, root.parent / "submission", "--dataset", root, *arguments)
    assert code == 2
    assert said in error
    assert len(error.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_parquet_without_pyarrow_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(Avs3dError, match=r"avs3d-bench\[parquet\]"):
        frame_rows.check_suffix(tmp_path / "a.parquet")
    frame_rows.check_suffix(tmp_path / "a.csv")
    with pytest.raises(UsageError):
        frame_rows.check_suffix(tmp_path / "a.feather")


# --- The document -----------------------------------------------------------------------------------------------------

DOCUMENT = Path(__file__).parents[2] / "docs" / "factors.md"


def test_the_document_lists_every_column_and_every_reason():
    section = DOCUMENT.read_text(encoding="utf-8").split("## A table of frames", 1)[1].split("\n## ", 1)[0]
    cells = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    assert tuple(name for cell in cells for name in re.findall(r"`(\w+)`", cell)) == COLUMNS
    reasons = {value for name, value in vars(factors).items() if name.isupper() and isinstance(value, str)}
    listed = {line.split("|")[1].strip() for line in section.splitlines() if re.match(r"\| [a-z]", line)}
    assert listed - {"column", "reason in `unavailable` of a frame"} == reasons


def test_a_frame_in_two_rows_is_refused(scored: Any, tmp_path: Path):
    rows = tuple(rows_of(scored).values())
    for suffix in (".csv", ".parquet"):
        write_rows(tmp_path / f"frames{suffix}", (*rows, rows[0]))
        with pytest.raises(
            Avs3dError, match=rf"row {len(rows) + 1}: .* is in row 1 already; expected one row per frame"
        ):
            read_rows(tmp_path / f"frames{suffix}")


@pytest.mark.parametrize("text", ["=1+1", "@SUM(1)", "+1", "-1", "\t=1", "\tx", "'=1"])
def test_no_text_of_a_table_begins_a_formula(scored: Any, tmp_path: Path, text: str):
    """A category may come from anybody's dataset: neither table opens as a formula, and reading gives the text back."""
    rows = tuple(row.model_copy(update={"category": text, "dataset": text}) for row in rows_of(scored).values())
    write_rows(tmp_path / "frames.csv", rows)
    assert read_rows(tmp_path / "frames.csv") == rows
    write_factors([tmp_path / "frames.csv"], html=None, table=tmp_path / "factors.csv")
    for name in ("frames.csv", "factors.csv"):
        with (tmp_path / name).open(encoding="utf-8", newline="") as stream:
            for line in csv.DictReader(stream):
                for column in ("category", "dataset", "method", "bin"):
                    value = line.get(column, "")
                    numbers = column == "bin" and line.get("factor") != "category"
                    assert numbers or value[:1] not in set("=+-@\t"), (column, value)
