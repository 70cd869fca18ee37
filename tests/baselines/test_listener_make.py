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

from generators.manifest.reading import read_manifest, select
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
    from benchmarks import listener_page, listener_tables, recorded_manifests

    modules = {
        "listener_training": listener,
        "listener_tables": listener_tables.main,
        "listener_page": listener_page.main,
        "recorded_manifests": recorded_manifests.main,
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
    assert steps[:6] == ["benchmarks.recorded_manifests", "tracer", "tracer", "analytic", "tracer", "tracer"]
    assert sorted(steps[6:9]) == ["benchmarks.listener_training", "soundspaces", "tracer"]
    assert steps[9:] == ["benchmarks.listener_tables", "benchmarks.listener_tables", "benchmarks.listener_page"]
    assert any("pathtraced" in arguments for arguments in found) == bool(gpus)


def test_each_training_home_is_in_one_part_and_a_tenth_of_the_observations_is_path_traced(tmp_path: Path) -> None:
    manifest = read_manifest(ROOT / "scenes_manifest" / "train.yaml").manifest
    chosen: dict[str, list[str]] = {}
    for arguments in commands(tmp_path, "TESTS=demo"):
        if arguments[1] == "generate" and "--only" in arguments:
            (glob,) = (arguments[at + 1] for at, word in enumerate(arguments) if word == "--only")
            part = Path(arguments[arguments.index("-o") + 1]).name
            chosen[part] = [spec.key for spec in select(manifest, (glob,))]
    assert sorted(key for keys in chosen.values() for key in keys) == sorted(spec.key for spec in manifest.observations)
    assert len(chosen["pathtraced"]) >= 400
    assert len(chosen["tracer"]) > len(manifest.observations) / 2


def test_what_is_there_is_not_made_again(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "manifests").mkdir()
    parts = [f"train-{part}.done" for part in ("pathtraced", "tracer", "analytic", "recorded")]
    names = ["manifests/train-recorded.yaml", *parts, "train-data.done", "tune-data.done"]
    for name in (*names, "run/listener.safetensors", "test-demo.done"):
        (tmp_path / name).touch()
    assert [arguments[2] for arguments in commands(tmp_path, "TESTS=demo")] == [
        "benchmarks.listener_tables",
        "benchmarks.listener_tables",
        "benchmarks.listener_page",
    ]
