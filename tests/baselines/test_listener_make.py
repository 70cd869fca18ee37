"""`benchmarks/listener.mk`: its commands are ones that exist, in an order in which each finds what it needs."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import click
import pytest

from tests.support.markdown_code import ROOT

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


def commands(folder: Path, *variables: str) -> list[list[str]]:
    """The commands that make would run, as arguments."""
    environment = {name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MAKELEVEL")}
    command = ["make", "-n", "-f", "benchmarks/listener.mk", f"LISTENER={folder}", "WORKERS=2", *variables]
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True, timeout=60
    )  # fmt: skip
    lines = done.stdout.replace("\\\n", " ").splitlines()
    programs = r"(?:\.venv/bin/avs3d|\.venv/bin/python -m) .*?(?= \|\| | && |; \})"
    return [shlex.split(found.group(0)) for line in lines if (found := re.search(programs, line))]


def command_of(arguments: list[str]) -> tuple[click.Command, list[str]]:
    """The click command that arguments name, and what it gets."""
    if arguments[0].endswith("avs3d"):
        from generators.cli import generate

        assert arguments[1] == "generate"
        return generate, arguments[2:]
    from baselines.listener.cli import listener
    from benchmarks import listener_page, listener_tables

    modules = {
        "listener_training": listener,
        "listener_tables": listener_tables.main,
        "listener_page": listener_page.main,
    }
    return modules[arguments[2].removeprefix("benchmarks.")], arguments[3:]


@pytest.mark.parametrize("gpus", [0, 2])
def test_every_step_is_a_command_with_options_that_exist(tmp_path: Path, gpus: int) -> None:
    (tmp_path / "run").mkdir()
    found = commands(tmp_path, "TESTS=demo listen+soundspaces", f"GPUS={gpus}")
    steps = []
    for arguments in found:
        command, rest = command_of(arguments)
        context = command.make_context(command.name or "", rest, resilient_parsing=True)
        known = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in rest if word.startswith("-")} <= known
        steps.append(str(context.params.get("audio") or arguments[2]))
    assert steps[:2] == ["tracer", "tracer"]
    assert sorted(steps[2:5]) == ["benchmarks.listener_training", "soundspaces", "tracer"]
    assert steps[5:] == ["benchmarks.listener_tables", "benchmarks.listener_tables", "benchmarks.listener_page"]


def test_what_is_there_is_not_made_again(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    for name in ("train-data.done", "tune-data.done", "run/listener.safetensors", "test-demo.done"):
        (tmp_path / name).touch()
    assert [arguments[2] for arguments in commands(tmp_path, "TESTS=demo")] == [
        "benchmarks.listener_tables",
        "benchmarks.listener_tables",
        "benchmarks.listener_page",
    ]
