"""`make demo` and the listener: scored where weights and PyTorch are there, else one line says why not."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.support.makefile import environment
from tests.support.markdown_code import ROOT, unknown

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


def make(folder: Path, *, weights: bool, torch: bool) -> str:
    """What `make demo-listener` prints, with programs that only say how they were called."""
    programs = folder / "bin"
    programs.mkdir()
    for name, code in {
        "python": f"exit {int(not torch)}",
        "avs3d": 'echo "avs3d $@"',
        "avs3d-eval": 'echo "eval $@"',
    }.items():
        (programs / name).write_text(f"#!/bin/sh\n{code}\n")
        (programs / name).chmod(0o755)
    (folder / "data/demo-scores").mkdir(parents=True)
    (folder / "data/demo-scores/listener.json").write_text("of an earlier run")
    if weights:
        (folder / "weights").touch()
    command = [
        "make",
        "-s",
        "-f",
        str(ROOT / "Makefile"),
        "demo-listener",
        f"BIN={programs}",
        "LISTENER_WEIGHTS=weights",
    ]
    done = subprocess.run(
        command, cwd=folder, env=environment(), capture_output=True, text=True, check=True, timeout=60
    )
    return done.stdout


def test_it_is_scored_where_it_can_run(tmp_path: Path) -> None:
    output = make(tmp_path, weights=True, torch=True)
    command = "avs3d baseline listener --device cpu --looks one --dataset data/demo -o data/demo-submissions/listener"
    assert command in output
    assert "eval data/demo-submissions/listener --dataset data/demo" in output
    assert "not scored" not in output


def test_the_small_release_is_made_with_commands_that_exist() -> None:
    command = ["make", "-n", "-f", str(ROOT / "Makefile"), "release-demo", "BIN=bin", "DEMO_STAMP=", "AUDIO=tracer"]
    done = subprocess.run(command, cwd=ROOT, env=environment(), capture_output=True, text=True, check=True, timeout=60)
    calls = [shlex.split(line) for line in done.stdout.splitlines() if line.startswith("bin/avs3d ")]
    assert [call[1] for call in calls] == ["generate", "validate", "release"]
    for call in calls:
        assert not unknown(["avs3d", *call[1:]])
    assert calls[2][2] == calls[0][calls[0].index("-o") + 1]


@pytest.mark.parametrize(
    ("weights", "torch", "why"),
    [(False, True, "weights is not there"), (True, False, "PyTorch is not installed (make setup installs it)")],
)
def test_else_one_line_says_why_and_old_scores_are_gone(tmp_path: Path, weights: bool, torch: bool, why: str) -> None:
    assert make(tmp_path, weights=weights, torch=torch) == f"The listener is not scored: {why}.\n"
    assert not (tmp_path / "data/demo-scores/listener.json").exists()
