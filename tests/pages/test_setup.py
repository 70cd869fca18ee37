"""`make setup` and `make demo` install the tested set of versions; LATEST=1 the newest ones."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.makefile import environment
from tests.support.markdown_code import ROOT

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")

#: Stands for python3: makes environments whose Python is itself, notes what is asked of pip, and says that the
#: platform is the one of the hashes, or another one.
PROGRAM = """#!/bin/sh
case "$*" in
  "-m venv "*) mkdir -p "$3/bin" && cp "$0" "$3/bin/python" ;;
  "-m pip install "*) shift 3; echo "$@" >> {log} ;;
  *libc_ver*) exit {other} ;;
esac
"""


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder with the files that the targets depend on."""
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    return tmp_path


def installed(folder: Path, *arguments: str, other: bool = False) -> list[list[str]]:
    """What pip is asked to install, call by call, by `make` with some arguments."""
    log = folder / "log"
    log.unlink(missing_ok=True)
    python = folder / "python"
    python.write_text(PROGRAM.format(log=shlex.quote(str(log)), other=int(other)))
    python.chmod(0o755)
    command = ["make", "-s", f"PYTHON={python}", *arguments]
    subprocess.run(command, cwd=folder, env=environment(), check=True, timeout=60, capture_output=True)
    calls = [shlex.split(line) for line in log.read_text().splitlines()] if log.exists() else []
    return [[word for word in call if word not in ("--quiet", "--disable-pip-version-check")] for call in calls]


PROJECT = ["--no-deps", "--no-build-isolation", "-e", "."]


def test_setup_installs_the_tested_set_by_its_hashes(folder: Path) -> None:
    torch, rest, project, build, engine = installed(folder, "setup")
    assert torch == ["--constraint", "avs3d_bench/runtime/tested_versions.txt", "torch==2.13.0"]
    assert rest == ["--no-deps", "--require-hashes", "-r", "constraints.txt"]
    assert project == PROJECT
    assert build[:2] == torch[:2]
    assert all("==" in word for word in build[3:])
    assert engine == ["--no-build-isolation", "--no-deps", "rlr-audio-propagation==0.0.1"]
    assert installed(folder, "setup") == [], "all is there"
    (folder / "constraints.txt").touch()
    assert rest in installed(folder, "setup"), "a new set is installed"


def test_the_demo_installs_its_part_of_the_set(folder: Path) -> None:
    rest, project = installed(folder, ".venv/.demo")
    assert rest == ["--no-deps", "--require-hashes", "-r", "docker/build.txt", "-r", "docker/generator.txt"]
    assert project == PROJECT


@pytest.mark.parametrize(("target", "extra"), [("setup", "dev"), (".venv/.demo", "generate")])
def test_other_platforms_get_the_same_versions_without_hashes(folder: Path, target: str, extra: str) -> None:
    calls = installed(folder, target, other=True)
    assert not any("--require-hashes" in call for call in calls)
    (project,) = [call for call in calls if "-e" in call]
    assert project[:2] == ["--constraint", "avs3d_bench/runtime/tested_versions.txt"]
    assert extra in project[-1]


def test_the_newest_versions_are_installed_on_demand_and_the_tested_ones_again(folder: Path) -> None:
    assert installed(folder, "setup")
    calls = installed(folder, "setup", "LATEST=1")
    assert not any("constraint" in word or "constraints" in word for call in calls for word in call)
    (project,) = [call for call in calls if "-e" in call]
    assert project[:4] == ["--upgrade", "--upgrade-strategy", "eager", "torch==2.13.0"]
    assert installed(folder, "setup", "LATEST=1") == []
    assert installed(folder, "setup")[1] == ["--no-deps", "--require-hashes", "-r", "constraints.txt"]
