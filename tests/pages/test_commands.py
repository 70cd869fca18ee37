"""Every command: its help, the names of its options, bare groups, `list` and `eval`, and the shell's completion."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from avs3d_bench import cli
from avs3d_bench.commands.click_options import Group
from avs3d_bench.commands.outputs import NamedPath
from avs3d_bench.dataset import Dataset
from avs3d_bench.inspector.listing import list_dataset
from tests.support import tiny
from tests.support.shared import SharedDataset

ROOT = Path(__file__).parents[2]
#: What ``-o`` may be called in a help text.
OUTPUTS = {"ROOT", "SUBMISSION", "DIR", "FILE"}


def entry_points() -> dict[str, str]:
    """Command → where it is, from the sources: an older installation may lack some."""
    import tomllib

    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"][cli.GROUP]


def commands() -> Iterator[tuple[str, click.Command]]:
    """Every command and group of `avs3d` with its full name."""
    from importlib import metadata

    waiting: list[tuple[str, click.Command]] = [
        (f"avs3d {name}", command) for name, command in cli.avs3d.commands.items()
    ]
    for name, target in entry_points().items():
        waiting.append((f"avs3d {name}", metadata.EntryPoint(name, target, cli.GROUP).load()))
    while waiting:
        name, command = waiting.pop()
        yield name, command
        if isinstance(command, click.Group):
            waiting += [(f"{name} {each}", below) for each, below in command.commands.items()]


COMMANDS = dict(commands())


def call(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[object, str, str]:
    """(exit code, stdout, stderr) of `avs3d`."""
    with pytest.raises(SystemExit) as caught:
        cli.run(cli.avs3d, [str(a) for a in arguments])
    out = capsys.readouterr()
    return caught.value.code, out.out, out.err


@pytest.mark.parametrize("name", COMMANDS)
def test_no_path_may_be_an_empty_text(name: str) -> None:
    """`Path("")` is the current folder: every option and argument that is a path has the type that refuses it."""
    paths = [p for p in COMMANDS[name].params if isinstance(p.type, click.Path)]
    assert [p.name for p in paths if not isinstance(p.type, NamedPath)] == []


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=4, size=32)


@pytest.fixture(autouse=True)
def _commands_of_the_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    from importlib import metadata

    points = {name: metadata.EntryPoint(name, target, cli.GROUP) for name, target in entry_points().items()}
    monkeypatch.setattr(cli, "_entry_points", lambda: points)


def test_every_command_has_a_line_in_the_list() -> None:
    assert {name.split()[1] for name in COMMANDS} == set(cli.SUMMARIES)


@pytest.mark.parametrize("name", COMMANDS)
def test_options_of_the_same_kind_have_the_same_form(name: str) -> None:
    for option in COMMANDS[name].params:
        if not isinstance(option, click.Option):
            continue
        forms = {*option.opts}
        if "--only" in forms:
            assert (option.metavar, option.multiple) == ("KEY_GLOB", True)
        if "--dataset" in forms:
            assert (option.metavar, option.required) == ("ROOT", True)
        if forms & {"-o", "--output"}:
            assert forms == {"-o", "--output"}
            assert option.metavar in OUTPUTS
        if "--json" in forms:
            assert option.metavar == "FILE"
        assert option.help or isinstance(option.type, click.Choice) or option.show_default, f"{name} {option.opts}"


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_called_alone_knows_h(name: str) -> None:
    """click keeps the help option of the first call, so that a command must not rely on the group's."""
    assert COMMANDS[name].context_settings.get("help_option_names") == ["-h", "--help"]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_answers_h_and_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    pages = []
    for flag in ("-h", "--help"):
        code, out, err = call(capsys, *name.split()[1:], flag)
        assert (code, err) == (0, "")
        pages.append(out)
    assert pages[0] == pages[1]
    assert pages[0].startswith(f"Usage: {name} ")


@pytest.mark.parametrize("name", ["avs3d", *(name for name, each in COMMANDS.items() if isinstance(each, click.Group))])
def test_a_bare_group_prints_its_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = call(capsys, *name.split()[1:])
    assert (code, out) == (2, "")
    assert err.startswith(f"Usage: {name} [OPTIONS] COMMAND [ARGS]...\n\n")
    assert err.count("\n") > 8
    assert "Commands:\n" in err
    assert err.rstrip("\n") == call(capsys, *name.split()[1:], "--help")[1].rstrip("\n")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["exprot"], "no command 'exprot': expected one of .*; did you mean 'export'?"),
        (["export", "webdatset"], "no form 'webdatset': expected one of .*; did you mean 'webdataset'?"),
        (["baseline", "orakle"], "no baseline 'orakle': expected one of .*; did you mean 'oracle'?"),
        (["assets", "fecth"], "no command 'fecth': expected one of .*; did you mean 'fetch'?"),
        (["assets", "import", "foldr"], "no source 'foldr': expected one of .*; did you mean 'folder'?"),
        (["assets", "xyz"], "no command 'xyz': expected one of .*, list.*"),
        (["validate", "x", "--depe"], "No such option '--depe'. .*Did you mean.*'--deep'.*"),
        (
            ["baseline", "oracle", "--instanse", "category"],
            "No such option '--instanse'. .*Did you mean.*'--instance'.*",
        ),
    ],
)
def test_a_misspelt_command_or_option_is_told_with_the_nearest_one(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    import re

    code, out, err = call(capsys, *arguments)
    assert (code, out) == (2, "")
    assert re.fullmatch(f"avs3d: error: {says}".replace("?", r"\?"), err.rstrip("\n")), err
    assert err.count("\n") == 1


def test_eval_is_avs3d_eval(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import evaluators.cli
    from baselines.trivial import write_trivial

    write_trivial("all-white", Dataset(data), tmp_path / "white")
    arguments = [str(tmp_path / "white"), "--dataset", str(data), "--workers", "1"]
    assert COMMANDS["avs3d eval"] is evaluators.cli.evaluate
    code, out, _ = call(capsys, "eval", *arguments)
    assert code == 0
    with pytest.raises(SystemExit) as caught:
        evaluators.cli.main(arguments)
    assert caught.value.code == 0
    assert capsys.readouterr().out == out
    assert "all-white" in out
    assert call(capsys, "eval", tmp_path / "none", "--dataset", data)[0] == 2


def test_list_prints_a_row_for_each_observation(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = call(capsys, "list", data)
    assert (code, err) == (0, "")
    lines = [line.split() for line in out.splitlines() if line.startswith("part_")]
    assert [line[0] for line in lines] == [tiny.SINGLE, tiny.MULTI]
    record = Dataset(data)[tiny.SINGLE].record
    assert record is not None
    t30 = "–" if record.acoustics.t30 is None else f"{record.acoustics.t30:.2f}"
    assert lines[0][1:] == [record.category, "4", "4", t30, str(len(record.instances))]
    assert out.splitlines()[-1] == "tiny 1: 2 observations, 8 frames"


def test_list_counts_what_is_there_and_selects(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = tiny.clone(data, tmp_path / "data")
    tiny.edit_record(root, tiny.MULTI, lambda record: record["acoustics"].update(t30=0.4213))
    (root / tiny.MULTI / "audio_clips_binaural/frame_2.wav").unlink()
    code, out, _ = call(capsys, "list", root, "--only", "part_2/*", "--json", tmp_path / "list.json")
    assert code == 0
    rows = [line.split() for line in out.splitlines() if line.startswith("part_")]
    assert len(rows) == 1
    assert rows[0][2:5] == ["4", "3", "0.42"]
    document = json.loads((tmp_path / "list.json").read_text())
    assert document["dataset"] == {"name": "tiny", "version": "1"}
    (row,) = document["observations"]
    assert row == {
        "key": tiny.MULTI,
        "category": row["category"],
        "frames": 4,
        "seconds": 3.0,
        "t30": 0.4213,
        "instances": row["instances"],
    }
    record = Dataset(root)[tiny.MULTI].record
    assert record is not None
    assert (row["category"], row["instances"]) == (record.category, len(record.instances))
    assert list_dataset(Dataset(root), ["part_2/*"]).as_dict() == document


def test_list_reads_the_official_release(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = tiny.write_release(tmp_path / "release")
    code, out, _ = call(capsys, "list", root)
    assert code == 0
    rows = [line.split() for line in out.splitlines() if line.startswith("part_")]
    assert all((row[1], row[4], row[5]) == ("–", "–", "–") for row in rows)
    assert rows


def test_list_says_in_one_line_what_is_wrong(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no such folder" in call(capsys, "list", tmp_path / "none")[2]
    code, out, err = call(capsys, "list", data, "--only", "kitchen")
    assert (code, out) == (2, "")
    assert err == f"avs3d: error: {data}: no observation matches kitchen; keys look like '{tiny.SINGLE}'\n"
    code, out, err = call(capsys, "list", data, "--json", tmp_path)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    root = tiny.clone(data, tmp_path / "data")
    tiny.replace(root / tiny.SINGLE / "observation.json", b"{")
    code, out, err = call(capsys, "list", root)
    assert code == 1
    assert "observation.json" in err


def complete(words: str, position: int) -> list[str]:
    """What bash would offer, from a new process."""
    environment = os.environ | {"COMP_WORDS": words, "COMP_CWORD": str(position), "_AVS3D_COMPLETE": "bash_complete"}
    command = [sys.executable, "-c", "from avs3d_bench.cli import main; main()"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, cwd=ROOT)
    assert done.stderr == ""
    return [line.partition(",")[2] for line in done.stdout.splitlines()]


def test_the_shell_completes_commands_and_options() -> None:
    assert complete("avs3d va", 1) == ["validate"]
    assert complete("avs3d --v", 1) == ["--version"]
    assert complete("avs3d validate --de", 2) == ["--deep"]
    assert complete("avs3d baseline ora", 2) == ["oracle"]


def test_completing_the_commands_imports_none_of_them() -> None:
    code = "import sys; from avs3d_bench import cli; import click\n"
    code += "print(*(item.value for item in cli.avs3d.shell_complete(click.Context(cli.avs3d), '')))\n"
    code += "print('generators.cli' in sys.modules, 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    names, loaded = done.stdout.splitlines()
    assert {"generate", "validate", "list", "baseline"} <= set(names.split())
    assert loaded == "False False"


def test_a_group_tells_its_noun() -> None:
    @click.group(cls=Group, noun="animal")
    def zoo() -> None:
        """Animals."""

    zoo.command("lion")(lambda: None)
    result = CliRunner().invoke(zoo, ["lino"])
    assert str(result.exception) == "no animal 'lino': expected one of lion; did you mean 'lion'?"
