"""Runs the blocks of a page (files, patches, commands) as they are printed, in the order of the page.

A block with ``title="FILE"`` is written to that file, a ``diff`` applied with `git apply`; ``python`` and ``bash`` run.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

from generators.core.folders import default_cache
from tests.support.markdown_code import ROOT, blocks, install_commands
from tests.support.one_core import keep_to_one_core

PACKAGES = ("avs3d_bench", "generators", "evaluators", "baselines")


def copy_kernels(sources: Path, copy: Path) -> Path:
    """A folder with the compiled kernels that there are of ``sources``, for a copy of them that has the same dates.

    numba names the folder of a module's kernels after the path of the module.
    """
    from numba.core.caching import _CacheLocator

    from generators.core.jit import _KERNELS

    place = copy / "numba"
    for module in (sources / "generators").rglob("*.py"):
        names = [_CacheLocator.get_suitable_cache_subpath(str(file))  # type: ignore[no-untyped-call]
                 for file in (module, copy / module.relative_to(sources))]  # fmt: skip
        compiled, target = Path(_KERNELS) / names[0], place / Path(_KERNELS).name / names[1]
        if compiled.is_dir() and not target.is_dir():
            shutil.copytree(compiled, target)
    return place


class Desk:
    """A working folder with a copy of the packages, as a reader's checkout: commands in it use the copy.

    Args:
        folder: where it is made.
        data: a dataset that stands there as data/demo.
    """

    def __init__(self, folder: Path, data: Path | None = None) -> None:
        self.folder = folder
        for package in PACKAGES:  # with Python's compiled code, which fits sources of the same date
            shutil.copytree(ROOT / package, folder / package)
        shutil.copy(ROOT / "pyproject.toml", folder)
        (folder / "tests").mkdir()
        shutil.copy(ROOT / "tests/test_architecture.py", folder / "tests")
        (folder / "data").mkdir()
        if data is not None:
            (folder / "data/demo").symlink_to(data)
        bin_ = folder / "bin"
        install_commands(bin_)
        self._environment = os.environ | {
            "PYTHONPATH": str(folder),
            "PATH": f"{bin_}{os.pathsep}{os.environ['PATH']}",
            "AVS3D_CACHE": str(default_cache()),  # by what homes are made of: an edit of that has homes of its own
            "NUMBA_CACHE_DIR": str(copy_kernels(ROOT, folder)),
        }

    def run(self, *command: str) -> str:
        """The output of a command, standard error included; fails with the whole of it."""
        done = subprocess.run(
            command, cwd=self.folder, env=self._environment, capture_output=True, text=True, check=False, timeout=600,
            preexec_fn=keep_to_one_core,
        )  # fmt: skip
        said = done.stdout + done.stderr
        assert done.returncode == 0, f"{' '.join(command)}: exit code {done.returncode}\n{said}"
        return said

    def lint(self) -> None:
        """Fail if the packages would not pass `make lint`'s ruff."""
        for way in (("check",), ("format", "--check")):
            self.run("python", "-m", "ruff", *way, "--no-cache", "--quiet", *PACKAGES)

    def follow(self, page: Path, text: str) -> str:
        """Do what each block of a page, or of a part of its text, says; the outputs, joined."""
        said = []
        for number, block in enumerate(blocks(page, text)):
            if block.file is not None:
                target = self.folder / block.file
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(block.code)
            elif block.language == "diff":
                change = self.folder / f"change-{number}.diff"
                change.write_text(block.code)
                self.run("git", "apply", change.name)
            elif block.language == "bash":
                said.append(self.run("bash", "-ec", block.code))
            elif block.language == "python":
                said.append(self.run("python", "-c", block.code))
        return "".join(said)
