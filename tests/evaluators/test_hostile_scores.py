"""Untrusted files of scores: one line per fault, only this toolkit's reports are copied, no CSV has a formula."""

from __future__ import annotations

import csv
import io
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.cli import main
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files
from avs3d_bench.formats.files import read_json
from avs3d_bench.formats.media import write_json, write_png_mask
from evaluators.reporting.leaderboard import write_leaderboard
from evaluators.reporting.pages import page_script, report_head
from evaluators.reporting.report_check import read_report
from evaluators.reporting.score_file import read_scores
from evaluators.reporting.tables import write_tables
from evaluators.score import evaluate
from tests.support import tiny, tiny_scenes
from tests.support.score_examples import example_scores, report_page


def put(path: Path, *keys: str | int, value: Any) -> Path:
    """A file of scores with one value replaced."""
    data = example_scores(4).model_dump(mode="json")
    *folders, last = keys
    inner: Any = data
    for key in folders:
        inner = inner[key]
    inner[last] = value
    path.write_text(json.dumps(data))
    return path


def one_line(capsys: pytest.CaptureFixture[str], command: str, file: Path, *more: str) -> str:
    """What a command says about a file that it refuses."""
    out = file.with_name("out")
    with pytest.raises(SystemExit) as end:
        main([command, str(file), "-o", str(out), *more])
    said = capsys.readouterr()
    assert end.value.code == 1
    assert not out.exists()
    assert said.err.startswith(f"avs3d: error: {file}: ")
    assert said.err.removesuffix("\n").isprintable()
    return said.err


BOTH = pytest.mark.parametrize("command", [("leaderboard",), ("tables", "--no-plot")], ids=["leaderboard", "tables"])


@BOTH
@pytest.mark.parametrize(
    ("keys", "value", "says"),
    [
        (("report",), "a\0b.html", "report: .* holds a control character"),
        (("report",), "\x1b[31m.html", "report: .* holds a control character"),
        (("report",), "../.env", "report: .* is not a relative path"),
        (("report",), "/etc/passwd", "report: .* is not a relative path"),
        (("avs3d_eval", "protocols", "strict"), "9" * 6000, "avs3d_eval.protocols.strict: String should match"),
        (("avs3d_eval", "protocols", "strict"), "1." + "9" * 6000, "avs3d_eval.protocols.strict: String should match"),
        (("avs3d_eval", "protocols"), {"\0\x1b": "1.0"}, "avs3d_eval.protocols"),
        (("parts",), {"\0\n\u2028": {}}, "parts"),
        (("overall", "strict", "x" * 10**6), 1, "overall.strict.x+…"),
    ],
)  # fmt: skip
def test_a_hostile_value_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: tuple[str, ...], keys: Any, value: Any, says: str
):
    file = put(tmp_path / "s.json", *keys, value=value)
    said = one_line(capsys, command[0], file, *command[1:])
    assert re.search(says, said), said
    assert len(said) < 2000


@BOTH
def test_a_number_of_thousands_of_digits_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: tuple[str, ...]
):
    file = put(tmp_path / "s.json", "overall", "frames", value="HERE")
    file.write_text(file.read_text().replace('"HERE"', "9" * 6000))
    assert len(one_line(capsys, command[0], file, *command[1:])) < 2000


def nested(path: Path) -> None:
    path.write_text('{"runtime": ' + "[" * 200_000)


def sparse(path: Path) -> None:
    with path.open("wb") as stream:
        stream.truncate(2**36)


@BOTH
@pytest.mark.parametrize(
    ("make", "says"),
    [
        (os.mkfifo, "a FIFO; expected a regular file"),
        (Path.mkdir, "a folder; expected a regular file"),
        (sparse, "68,719,476,736 bytes, expected at most 67,108,864"),
        (nested, "recursion limit"),
        (lambda path: path.symlink_to("/dev/zero"), "a device; expected a regular file"),
        (lambda path: path.write_bytes(b"\xff\xfe{"), "Invalid JSON"),
    ],
)
def test_what_is_no_file_of_scores_is_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    command: tuple[str, ...],
    make: Callable[[Path], None],
    says: str,
):
    make(tmp_path / "s.json")
    assert says in one_line(capsys, command[0], tmp_path / "s.json", *command[1:])


def test_json_of_any_kind_has_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    nested(tmp_path / "deep.json")
    (tmp_path / "large.json").write_text(" " * 200)
    monkeypatch.setattr(files, "MAX_JSON_BYTES", 10**6)
    with pytest.raises(Avs3dError, match="nested too deeply"):
        read_json(tmp_path / "deep.json")
    monkeypatch.setattr(files, "MAX_JSON_BYTES", 100)
    with pytest.raises(Avs3dError, match="200 bytes, expected at most 100"):
        read_json(tmp_path / "large.json")


# Reports


def with_report(folder: Path, data: bytes | str, name: str = "report.html", **options: Any) -> Path:
    """A file of scores that names what lies beside it."""
    folder.mkdir()
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    write_json(folder / "scores.json", example_scores(4, report=name, **options))
    return folder / "scores.json"


HEAD, PAGE = report_head(), report_page("mine")


def body(more: str) -> str:
    return PAGE.replace("<main>", f"<main>{more}")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        (".env", "SECRET=1\n"),
        (".env", f"SECRET=1\n{PAGE}"),
        ("report.html", "<!doctype html><title>mine</title><script>alert(1)</script>"),
        ("report.html", PAGE.replace("script-src", "script-src 'unsafe-inline'")),
        ("report.html", PAGE.replace("default-src 'none'", "default-src *")),
        ("report.html", PAGE.replace("score report", "leaderboard")),
        ("report.html", PAGE.encode() + b"\xff"),
        ("report.html", b""),
        ("report.html", HEAD),
        ("report.html", PAGE.replace("<script>", "<script>alert(1);")),
        ("report.html", body("<script>alert(1)</script>")),
        ("report.html", body(f"<script>{page_script()}</script>")),
        ("report.html", body("<script src='https://example.org/x.js'></script>")),
        ("report.html", body("<SCRIPT >alert(1)</SCRIPT >")),
        ("report.html", body("<style>@import url(x)</style>")),
        ("report.html", body("<img src=x onerror=alert(1)>")),
        ("report.html", body("<img src='https://example.org/x.png'>")),
        ("report.html", body("<img src='data:image/svg+xml;base64,AAAA'>")),
        ("report.html", body("<p onclick='alert(1)'>x</p>")),
        ("report.html", body("<a href='javascript:alert(1)'>x</a>")),
        ("report.html", body("<a href='data:text/html,x'>x</a>")),
        ("report.html", body("<a href='../../.env'>x</a>")),
        ("report.html", body("<iframe src='x'></iframe>")),
        ("report.html", body("<form action='x'></form>")),
        ("report.html", body("<meta http-equiv='refresh' content='0;url=https://example.org'>")),
        ("report.html", body("<base href='https://example.org'>")),
        ("report.html", body("<svg><script>alert(1)</script></svg>")),
        ("report.html", body("<!-- --!><script>alert(1)</script> -->")),
        ("report.html", body("<?php x ?>")),
        ("report.html", body("<![CDATA[<script>]]>")),
    ],
    ids=map(str, range(30)),
)
def test_only_reports_of_ours_are_copied(tmp_path: Path, name: str, data: bytes | str):
    file = with_report(tmp_path / "s", data, name)
    (note,) = write_leaderboard(tmp_path / "board", [file])
    assert note.isprintable()
    assert str(file.parent / name) in note
    assert [path.name for path in (tmp_path / "board" / "reports").iterdir()] == ["echosegnet.json"]
    assert read_json(tmp_path / "board" / "reports" / "echosegnet.json")["report"] is None


def test_a_report_of_ours_is_copied_as_it_is(tmp_path: Path):
    file = with_report(tmp_path / "s", PAGE)
    assert write_leaderboard(tmp_path / "board", [file]) == ()
    assert (tmp_path / "board" / "reports" / "echosegnet.html").read_text() == PAGE


def test_the_report_lies_in_the_same_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    below = with_report(tmp_path / "below", PAGE, "html/report.html", method="below")
    linked = with_report(tmp_path / "linked", PAGE, method="linked")
    (linked.parent / "report.html").rename(tmp_path / "elsewhere.html")
    (linked.parent / "report.html").symlink_to("../elsewhere.html")
    piped = with_report(tmp_path / "piped", PAGE, method="piped")
    (piped.parent / "report.html").unlink()
    os.mkfifo(piped.parent / "report.html")
    long = with_report(tmp_path / "long", PAGE, method="long")
    write_json(long, example_scores(4, report="x" * 6000, method="long"))
    with pytest.raises(SystemExit) as end:
        main(["leaderboard", *map(str, (below, linked, piped, long)), "-o", str(tmp_path / "board")])
    said = capsys.readouterr().err.splitlines()
    assert end.value.code == 0
    assert len(said) == 3
    assert "'html/report.html' is not copied: expected one beside the file" in said[0]
    assert "report.html: not copied: a link" in said[1]
    assert "report.html: a FIFO; expected a regular file" in said[2]
    assert not list((tmp_path / "board").rglob("*report*.html"))
    assert len(list((tmp_path / "board" / "reports").iterdir())) == 4


def test_a_huge_report_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    file = with_report(tmp_path / "s", PAGE)
    sparse(file.parent / "report.html")
    with pytest.raises(Avs3dError, match="68,719,476,736 bytes, expected at most 67,108,864"):
        read_report(file.parent / "report.html")


# Tables


@pytest.mark.parametrize(
    "method", ["=1+1", "+1", "-1", "@SUM(1)", "\t=1", " =1", "\r=cmd|'/C calc'!A0", "\uff1d1", "'=1", "plain-1"]
)
def test_no_cell_begins_a_formula(tmp_path: Path, method: str):
    write_json(tmp_path / "s.json", example_scores(4, method=method, dataset={"name": method, "version": method}))
    write_tables(tmp_path / "out", [tmp_path / "s.json"], plot=False)
    text = (tmp_path / "out" / "table2.csv").read_bytes().decode()
    rows = list(csv.DictReader(io.StringIO(text, newline="")))
    for row in rows:
        for value in row.values():
            assert value.lstrip()[:1] not in {"=", "+", "-", "@", "\uff1d"} or float(value) < 0
    named = {row["method"] for row in rows if row["kind"] == "method"}
    assert len(named) == 1
    plain = method in ("'=1", "plain-1") or not method.isprintable()  # what is not printable is written as \\t, \\r
    assert plain or named == {f"'{method}"}


# Files that contradict themselves


def _edit(data: dict[str, Any], keys: tuple[str | int, ...], value: Any) -> None:
    *folders, last = keys
    inner: Any = data
    for key in folders:
        inner = inner[key]
    inner[last] = value(inner[last]) if callable(value) else value


@pytest.mark.parametrize("protocol", ["official", "strict"])
@pytest.mark.parametrize(
    "group",
    [("overall",), ("parts", "part_1"), ("categories", "microwave"), ("rooms", "kitchen"),
     ("references", "centre_box", "overall")],
    ids=lambda group: group[0],
)  # fmt: skip
def test_an_edited_mean_is_named(tmp_path: Path, protocol: str, group: tuple[str, ...]):
    """Every mean of the file is computed again from its own observations."""
    data = example_scores(8).model_dump(mode="json")
    (tmp_path / "s.json").write_text(json.dumps(data))
    read_scores(tmp_path / "s.json")
    _edit(data, (*group, protocol, "F"), lambda value: round(value + 1e-4, 9))
    (tmp_path / "s.json").write_text(json.dumps(data))
    with pytest.raises(Avs3dError, match=rf"s\.json: {group[0]}.*{protocol}\.F: 0\.\d+, but its .* give 0\.\d+; score"):
        read_scores(tmp_path / "s.json")


@pytest.mark.parametrize(
    ("keys", "value", "says"),
    [
        (("observations", 0, "strict", "IoU"), True, r"observations\.0\.strict\.IoU: .*valid number"),
        (("observations", 0, "strict", "IoU"), "0.5", r"observations\.0\.strict\.IoU: .*valid number"),
        (("observations", 0, "frames"), "15", r"observations\.0\.frames: .*valid integer"),
        (("observations", 0, "part"), "part_2", "part: 'part_2' contradicts the key"),
        (("observations", 0, "room"), "bathroom_2", r"observations\.0\.room"),
        (("observations", 0, "scan"), "elsewhere", "scan: 'elsewhere' contradicts the key"),
        (("observations", 0, "key"), "part_1/../kitchen/1", "no key of an observation"),
        (("observations", 1), "COPY", "is listed 2 times; expected once"),
        (("observations", 0, "official"), None, "official: null, expected the contrary"),
        (("observations", 0, "frames"), 16, "of 16"),
        (("overall", "observations"), 9, "overall.observations: 9, but the list of observations has 8"),
        (("overall", "frames"), 1, "overall.frames: 1, but the list of observations has 120"),
        (("overall", "strict", "counts", "IoU"), 7, "overall.strict.counts"),
        (("overall", "strict", "intervals", "IoU"), [0.9, 0.1], "is no interval"),
        (("parts", "part_2"), None, r"parts\.part_2"),
        (("submission", "digest"), "0" * 64, "submission.digest: does not follow"),
        (("dataset", "truth_digest"), "0" * 64, "dataset.truth_digest: does not follow"),
    ],
)  # fmt: skip
def test_a_contradiction_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], keys: tuple[str | int, ...], value: Any, says: str
):
    data = example_scores(8).model_dump(mode="json")
    _edit(data, keys, data["observations"][0] if value == "COPY" else value)
    file = tmp_path / "s.json"
    file.write_text(json.dumps(data))
    for command in ("leaderboard", "tables"):
        assert re.search(says, one_line(capsys, command, file))
    (tmp_path / "other.json").write_text(json.dumps(example_scores(8, seed=2).model_dump(mode="json")))
    with pytest.raises(SystemExit) as end:
        main(["compare", str(file), str(tmp_path / "other.json")])
    assert end.value.code == 1
    assert re.search(says, capsys.readouterr().err)


@pytest.mark.slow
def test_files_of_the_evaluator_follow_from_their_observations(tmp_path: Path):
    """Nine digits, three parts, twins, siblings and missing figures: none of it is a contradiction."""
    tiny.write_dataset(tmp_path / "plain", frames=17, size=32)
    tiny_scenes.write_part_3(tmp_path / "scenes")
    for root in (tmp_path / "plain", tmp_path / "scenes"):
        dataset = Dataset(root)
        folder = tmp_path / f"{root.name}-submission"
        record = {"method": "m", "dataset": dataset.name, "dataset_version": dataset.record.version}
        write_json(folder / "submission.json", record)
        for observation in dataset:
            for frame in observation.test:
                mask = np.roll(frame.mask(), 2, axis=1)
                write_png_mask(folder / observation.key / "masks" / f"{frame.name}.png", mask)
        scores = evaluate(folder, root).scores
        write_json(tmp_path / "s.json", scores)
        assert read_scores(tmp_path / "s.json").overall.frames == scores.overall.frames
        data = json.loads((tmp_path / "s.json").read_text())
        if data.get("siblings"):
            pair = data["siblings"][0]["pairs"][0]
            for right, says in ((pair["frames"] + 1, "right frames of"), (0, "does not follow from the pairs")):
                pair["right"] = right
                (tmp_path / "s.json").write_text(json.dumps(data))
                with pytest.raises(Avs3dError, match=says):
                    read_scores(tmp_path / "s.json")


@pytest.mark.parametrize("name", ["x.csv", "x.parquet", "x.html"])
def test_another_kind_of_file_is_said_to_be_one(tmp_path: Path, name: str):
    (tmp_path / name).write_text("method,dataset\nm,d\n")
    with pytest.raises(Avs3dError, match="no JSON; expected a file of scores, which avs3d-eval --json writes"):
        read_scores(tmp_path / name)
