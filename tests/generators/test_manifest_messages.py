"""What a wrong manifest is told: every problem in a line of its own, with the field, its line, and where it belongs."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import pytest
import yaml

from avs3d_bench.cli import run
from avs3d_bench.errors import UsageError
from avs3d_bench.formats.yamlfile import lines_of
from generators.cli import generate
from generators.manifest.messages import MOST_FAULTS
from generators.manifest.reading import read_manifest
from generators.manifest.schema import MOST_INTERVALS

HEAD = """\
name: mine
seed: 1
scans:
  flat: {source: apartment, seed: 3}
observations:
"""
SCENE = "  - {part: part_3, scan: flat, room: kitchen, index: 1, instances: {clock: 1}, sources: [SOURCE]}\n"
ONE = "  - {part: part_1, scan: flat, room: kitchen, index: 1, category: clock}\n"


def refusal(folder: Path, text: str) -> list[str]:
    """The messages, without the manifest's name."""
    path = folder / "mine.yaml"
    path.write_text(text)
    with pytest.raises(UsageError) as caught:
        read_manifest(path)
    assert str(caught.value).split("\n") == list(caught.value.args)
    assert all(line.startswith(str(path)) and line.isprintable() for line in caught.value.args)
    return [line.removeprefix(str(path)) for line in caught.value.args]


# ---- unknown fields -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        (
            SCENE.replace("SOURCE", "{category: clock, gain: 3}"),
            6,
            "observations.0.sources.0.gain: unknown field; did you mean 'gain_db'?",
        ),
        (
            ONE.replace("clock}", "clock, gain: 3}"),
            6,
            "observations.0.gain: unknown field; did you mean 'gain_db', which belongs in observations.N.sources.N?",
        ),
        (
            ONE.replace("clock}", "clock, gain_db: 3}"),
            6,
            "observations.0.gain_db: unknown field; gain_db belongs in observations.N.sources.N",
        ),
        (ONE + "frames: 8\n", 7, "frames: unknown field; frames belongs in camera"),
        (ONE + "camera:\n  sise: 64\n", 8, "camera.sise: unknown field; did you mean 'size'?"),
        (ONE + "xyzzy: 64\n", 7, "xyzzy: unknown field; correct its name, or leave it out"),
    ],
)
def test_an_unknown_field_is_told_its_name_or_its_place(tmp_path: Path, text: str, line: int, said: str) -> None:
    assert refusal(tmp_path, HEAD + text) == [f", line {line}: {said}"]


def test_the_field_that_is_named_is_known_there(tmp_path: Path) -> None:
    """Whoever follows the hints ends at a manifest that is read."""
    source = "{category: clock, gain_db: 3}"
    path = tmp_path / "mine.yaml"
    path.write_text(HEAD + SCENE.replace("SOURCE", source))
    (spec,) = read_manifest(path).manifest.observations
    assert spec.sources is not None
    assert spec.sources[0].gain_db == 3


# ---- all problems, with their lines ---------------------------------------------------------------------------------


def test_every_problem_has_a_line_of_its_own(tmp_path: Path) -> None:
    text = HEAD.replace("seed: 1", "seed: one") + (
        "  - part: part_1\n"
        "    scan: flat\n"
        "    room: kitchn\n"
        "    index: 1\n"
        "    category: clock\n"
        "  - {part: part_1, scan: flat, room: kitchen, category: clok}\n"
    )
    found = refusal(tmp_path, text)
    starts = [
        ", line 2: seed: ",
        ", line 8: observations.0.room: unknown room 'kitchn'",
        ", line 11: observations.1.index: is missing",
        ", line 11: observations.1.category: unknown category 'clok'",
    ]
    assert sorted(found) == sorted(line for line in found if line.startswith(tuple(starts)))
    assert len(found) == len(starts)


def test_what_only_the_whole_manifest_shows_has_a_line_too(tmp_path: Path) -> None:
    late = SCENE.replace("SOURCE", "{category: clock, programme: [[3, 5]]}")
    text = f"camera: {{frames: 4}}\n{HEAD}" + ONE.replace("flat", "flta") + ONE + ONE + late
    assert refusal(tmp_path, text) == [
        ", line 7: observations.0.scan: part_1/flta/kitchen/1: unknown scan 'flta'; expected flat",
        ", line 9: observations.2: part_1/flat/kitchen/1 is listed twice",
        ", line 10: observations.3.sources.0.programme: part_3/flat/kitchen/1: interval [3, 5] ends after the last "
        "frame; expected at most 4 s",
    ]
    like = "  - {like: part_1/flat/kitchen/9, index: 2}\n  - {like: part_1/flat/kitchen/1, index: 3, silent: []}\n"
    first, second = refusal(tmp_path, HEAD + ONE + like)
    assert first.startswith(", line 7: observations.1: like 'part_1/flat/kitchen/9' names no observation")
    assert second.startswith(", line 8: observations.2: an entry with like cannot have silent;")


def test_the_sources_of_a_scene_are_all_judged(tmp_path: Path) -> None:
    text = HEAD + SCENE.replace("SOURCE", "{category: toilet}, {category: clock, instance: 2}, {category: clock}")
    assert [line.partition(": ")[2] for line in refusal(tmp_path, text)] == [
        "observations.0.sources.0: no toilet stands in this kitchen; instances has clock",
        "observations.0.sources.1: instance 2 of clock does not exist; expected 1 to 1",
    ]


def test_of_very_many_problems_the_first_are_named_and_the_rest_counted(tmp_path: Path) -> None:
    entries = "".join(ONE.replace("kitchen", f"room{number}") for number in range(MOST_FAULTS + 3))
    found = refusal(tmp_path, HEAD + entries)
    assert len(found) == MOST_FAULTS + 1
    assert [line.split(":")[0] for line in found[:-1]] == [f", line {6 + number}" for number in range(MOST_FAULTS)]
    assert found[-1] == ": 3 more problems"


def test_the_command_prints_each_of_them_as_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(HEAD.replace("seed: 1", "sead: 1") + ONE)
    with pytest.raises(SystemExit) as end:
        run(generate, [str(path), "-o", str(tmp_path / "data")])
    assert end.value.code == UsageError.exit_code
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(": ")[:2] for line in lines] == [["avs3d", "error"]] * 2
    assert {line.partition(" line ")[2][:1] for line in lines} >= {"2"}
    assert not (tmp_path / "data").exists()


def test_lines_are_those_of_the_text() -> None:
    text = 'a: 1\n"b c":\n  - x\n  - d: &here {e: 5}\n    f: *here\n  -\n    <<: *here\n'
    places: list[tuple[tuple[Any, ...], int | None]] = [
        (("a",), 1),
        (("b c",), 2),
        (("b c", 0), 3),
        (("b c", 1, "d", "e"), 4),
        (("b c", 1, "f", "e"), 4),
        (("b c", 1, "g"), 4),
        (("b c", 2, "e"), 7),
        (("b c", 9), 2),
        (("z",), None),
        ((), None),
    ]
    assert lines_of(text, [place for place, _ in places]) == [line for _, line in places]


# ---- words ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["", "my bench", "-a", "../x", "a/b", "ä", "a" * 201, "a\n"])
def test_a_bad_name_is_told_what_a_name_is(tmp_path: Path, name: str) -> None:
    (line,) = refusal(tmp_path, yaml.safe_dump(yaml.safe_load(HEAD + ONE) | {"name": name}))
    for words in ("is no name", "letters", "digits", "first a letter or a digit"):
        assert words in line
    assert "^" not in line, "no regular expression"


def test_a_bad_axis_is_told_what_an_axis_is(tmp_path: Path) -> None:
    text = HEAD.replace("{source: apartment, seed: 3}", "{source: scan, file: a.glb, up: w, front: z}") + ONE
    assert [line.partition(": ")[2] for line in refusal(tmp_path, text)] == [
        "scans.flat.up: 'w' is no axis; expected x, y or z, with or without a sign, such as -z"
    ]


@pytest.mark.slow
def test_too_many_intervals_are_refused_before_they_are_looked_at(tmp_path: Path) -> None:
    text = HEAD + SCENE.replace("SOURCE", f"{{category: clock, programme: [{'[9, 1], ' * 100_000}]}}")
    tracemalloc.start()
    (line,) = refusal(tmp_path, text)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert f"100,000 intervals; expected at most {MOST_INTERVALS:,}" in line
    assert most < 200e6, "bytes: the document itself, and no error for each of its intervals"


def test_as_many_intervals_as_fit_are_read(tmp_path: Path) -> None:
    frames = 100
    intervals = [[round(0.05 * n, 2), round(0.05 * (n + 1), 2)] for n in range(frames * 20)]
    path = tmp_path / "mine.yaml"
    path.write_text(
        f"camera: {{frames: {frames}}}\n{HEAD}"
        + SCENE.replace("SOURCE", f"{{category: clock, programme: {intervals}}}")
    )
    (spec,) = read_manifest(path).manifest.observations
    assert spec.sources is not None
    assert spec.sources[0].programme is not None
    assert len(spec.sources[0].programme.intervals or ()) == len(intervals)
