"""The `avs3d` program: exit codes, one line per error, commands of other packages loaded when called."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import click
import pytest

from avs3d_bench import __version__, cli
from avs3d_bench.errors import Avs3dError, UsageError
from tests.support import tiny
from tests.support.shared import SharedDataset


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=4, size=32)


def avs3d(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "avs3d_bench", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, **options)


def call(capsys: pytest.CaptureFixture[str], *arguments: object, command: click.Command = cli.avs3d) -> Any:
    """(exit code, stdout, stderr) of a run in this process."""
    with pytest.raises(SystemExit) as caught:
        cli.run(command, [str(a) for a in arguments])
    out = capsys.readouterr()
    return caught.value.code, out.out, out.err


def test_help_lists_every_command():
    done = avs3d("--help")
    assert done.returncode == 0
    for name in ("generate", "contact-sheet", "validate", "schema"):
        assert f"  {name}" in done.stdout


def test_help_imports_nothing_heavy():
    code = "import sys\ntry:\n from avs3d_bench.cli import main; main(['--help'])\nexcept SystemExit: pass\n"
    code += "print(*sorted(m for m in ('numpy', 'cv2', 'scipy', 'pydantic', 'rich', 'generators') if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == ""


def test_version():
    assert avs3d("--version").stdout.strip() == f"avs3d, version {__version__}"


def test_validate_says_valid_and_exits_with_0(data: Path, capsys: pytest.CaptureFixture[str]):
    code, out, err = call(capsys, "validate", data, "--deep", "--workers", 1)
    assert code == 0
    assert out.splitlines()[-1].endswith("(61 files, deep): valid")
    assert err == ""


def test_validate_names_the_file_and_exits_with_1(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    root = tiny.clone(data, tmp_path / "data")
    (root / tiny.SINGLE / "input/frame_002.png").unlink()
    code, out, _ = call(capsys, "validate", root, "--json", tmp_path / "report.json")
    assert code == 1
    assert "input/frame_002.png: missing file" in out
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["valid"] is False
    assert report["counts"]["error"] == len(report["problems"])
    assert {"severity": "error", "path": f"{tiny.SINGLE}/input/frame_002.png", "message": "missing file"} in report[
        "problems"
    ]


def test_schema_writes_what_is_committed(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    code, out, _ = call(capsys, "schema", "-o", tmp_path)
    assert code == 0
    committed = Path(cli.__file__).parent / "contract" / "schemas"
    for path in map(Path, out.split()):
        assert path.read_text() == (committed / path.name).read_text()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["genrate"], "no command 'genrate': expected one of .* did you mean 'generate'"),
        (["validate"], "Missing argument 'ROOT'"),
        (["validate", "x", "--depe"], "No such option"),
        (["validate", "/nowhere"], "/nowhere: no such folder"),
        (["schema"], "Missing option"),
    ],
)
def test_usage_errors_are_one_line_and_2(arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]):
    code, out, err = call(capsys, *arguments)
    assert code == 2
    assert out == ""
    assert err.startswith("avs3d: error: ")
    assert err.count("\n") == 1
    assert __import__("re").search(says, err)


def raising(error: BaseException) -> click.Command:
    def body() -> None:
        raise error

    return click.Command("x", callback=body)


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (Avs3dError("a.wav: truncated"), 1, "avs3d: error: a.wav: truncated"),
        (UsageError("no such\n thing"), 2, "avs3d: error: no such thing"),
        (OSError(errno.ENOSPC, "No space left on device", "/d/f"), 1,
         "avs3d: error: /d/f: cannot use: no space left on device; free some space and run again"),
        (KeyboardInterrupt(), 130, "avs3d: error: interrupted"),
        (ModuleNotFoundError("No module named 'embreex'", name="embreex"), 1,
         "avs3d: error: embreex is not installed; this command needs it: pip install embreex"),
        (ModuleNotFoundError("…", name="rlr_audio_propagation"), 1,
         "avs3d: error: rlr_audio_propagation is not installed; "
         "this command needs it: pip install 'avs3d-bench[soundspaces]'"),
        (ModuleNotFoundError("No module named 'importlib.resources'", name="importlib.resources"), 1,
         "avs3d: error: importlib.resources is a part of Python, but cannot be imported; check that the files below "
         f"{sys.base_prefix} are complete and may be read"),
        (UsageError("a: wrong", "b: wrong"), 2, "avs3d: error: a: wrong\navs3d: error: b: wrong"),
        (click.UsageError("x" * 5000), 2, f"avs3d: error: {'x' * 600} …"),
    ],
)  # fmt: skip
def test_errors_become_one_line(error: BaseException, code: int, line: str, capsys: pytest.CaptureFixture[str]):
    found, _, err = call(capsys, command=raising(error))
    assert found == code
    assert err.lstrip("\n") == line + "\n"  # click ends the line of the ^C first


@pytest.mark.parametrize(
    ("words", "name"), [(["gen"], "generate"), (["export", "hf"], "huggingface"), (["valdate"], "validate")]
)
def test_an_abbreviated_or_misspelt_command_gets_the_nearest_one(
    words: list[str], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = call(capsys, *words)
    assert code == UsageError.exit_code
    assert err.endswith(f"; did you mean '{name}'?\n")
    assert err.count("\n") == 1


def test_a_bug_keeps_its_traceback():
    with pytest.raises(ZeroDivisionError):
        cli.run(raising(ZeroDivisionError()), [])


@pytest.mark.slow
def test_a_full_disk_is_one_line(tmp_path: Path):
    if not os.path.exists("/dev/full"):
        pytest.skip("this system has no /dev/full")
    done = subprocess.run(
        [sys.executable, "-c", "from avs3d_bench.cli import main; main(['schema', '-o', '/dev/full'])"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("avs3d: error: /dev/full/")
    assert done.stderr.count("\n") == 1


def entry(name: str, value: str) -> dict[str, metadata.EntryPoint]:
    return {name: metadata.EntryPoint(name, value, cli.GROUP)}


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """generators.cli importable, one of its dependencies not."""
    monkeypatch.setitem(sys.modules, "generators.cli", None)
    monkeypatch.setattr(cli, "_entry_points", lambda: entry("generate", "generators.cli:generate"))

    def no_embree(self: object) -> None:
        raise ModuleNotFoundError("No module named 'embreex'", name="embreex")

    monkeypatch.setattr(metadata.EntryPoint, "load", no_embree)
    code, _, err = call(capsys, "generate", "x")
    assert code == 1
    assert err == "avs3d: error: embreex is not installed; this command needs it: pip install 'avs3d-bench[generate]'\n"


def test_a_foreign_command_is_loaded_when_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "foreign_tool.py").write_text(
        "import click\n@click.command()\n@click.argument('what')\ndef hello(what):\n    click.echo('hello ' + what)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(cli, "_entry_points", lambda: entry("hello", "foreign_tool:hello"))
    assert "hello" in call(capsys, "--help")[1]
    assert "foreign_tool" not in sys.modules
    assert call(capsys, "hello", "world")[1] == "hello world\n"
    monkeypatch.setattr(cli, "_entry_points", lambda: entry("hello", "foreign_tool:nothing"))
    assert "does not exist" in call(capsys, "hello")[2]
