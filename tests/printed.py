"""Runs the blocks of a page as they are printed: what a reader saves, applies and types, in the order of the page.

A block with ``title="FILE"`` is written to that file, a ``diff`` applied with `git apply`; ``python`` and ``bash`` run.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("avs3d_bench", "generators", "evaluators", "baselines")
_BLOCK = re.compile(r"^```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)^```$", re.M | re.S)


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the file that it is (if any), its text, the number of its first line."""

    language: str
    file: str | None
    text: str
    line: int


def blocks(page: str) -> list[Block]:
    """The fenced blocks of a page, in order."""
    return [Block(m[1], m[2], m[3], page.count("\n", 0, m.start()) + 2) for m in _BLOCK.finditer(page)]


def section(page: str, heading: str) -> str:
    """The page from a heading to the next one of the same level."""
    level = heading.split(" ", 1)[0]
    rest = page.partition(f"\n{heading}\n")[2]
    assert rest, f"no heading {heading!r}"
    return rest.partition(f"\n{level} ")[0]


class Desk:
    """A working folder with a copy of the packages, as a reader's checkout: commands in it use the copy.

    Args:
        folder: where it is made.
        data: a dataset that stands there as data/demo.
    """

    def __init__(self, folder: Path, data: Path | None = None) -> None:
        self.folder = folder
        for package in PACKAGES:
            shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", folder)
        (folder / "tests").mkdir()
        shutil.copy(ROOT / "tests/test_architecture.py", folder / "tests")
        (folder / "data").mkdir()
        if data is not None:
            (folder / "data/demo").symlink_to(data)
        bin_ = folder / "bin"
        bin_.mkdir()
        for name, module in (("avs3d", "avs3d_bench.cli"), ("avs3d-eval", "evaluators.cli")):
            script = bin_ / name
            script.write_text(
                f"#!{sys.executable}\nfrom {module} import main\n\nif __name__ == '__main__':\n    main()\n"
            )
            script.chmod(0o755)
        python = bin_ / "python"
        python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
        python.chmod(0o755)
        self._environment = os.environ | {
            "PYTHONPATH": str(folder),
            "PATH": f"{bin_}{os.pathsep}{os.environ['PATH']}",
            "AVS3D_CACHE": str(folder / "cache"),
            "NUMBA_CACHE_DIR": str(folder / "numba"),
        }

    def run(self, *command: str) -> str:
        """The output of a command, standard error included; fails with the whole of it."""
        done = subprocess.run(
            command, cwd=self.folder, env=self._environment, capture_output=True, text=True, check=False, timeout=600
        )
        said = done.stdout + done.stderr
        assert done.returncode == 0, f"{' '.join(command)}: exit code {done.returncode}\n{said}"
        return said

    def lint(self) -> None:
        """Fail if the packages would not pass `make lint`'s ruff."""
        for way in (("check",), ("format", "--check")):
            self.run("python", "-m", "ruff", *way, "--no-cache", "--quiet", *PACKAGES)

    def follow(self, page: str) -> str:
        """Do what each block of a page says; the outputs, joined."""
        said = []
        for number, block in enumerate(blocks(page)):
            if block.file is not None:
                target = self.folder / block.file
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(block.text)
            elif block.language == "diff":
                change = self.folder / f"change-{number}.diff"
                change.write_text(block.text)
                self.run("git", "apply", change.name)
            elif block.language == "bash":
                said.append(self.run("bash", "-ec", block.text))
            elif block.language == "python":
                said.append(self.run("python", "-c", block.text))
        return "".join(said)
