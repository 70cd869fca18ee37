"""The wheel: it holds the stubs, an installed user gets types from it, and its public names work."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("avs3d_bench", "generators", "evaluators", "baselines")
#: A program of a user. The last two lines are wrong on purpose.
PROGRAM = """\
from typing import assert_type

from avs3d_bench import Dataset, Frame, Observation, Report, SubmissionWriter, validate
from baselines import echosegnet, oracle, trivial
from evaluators import Evaluation, check, evaluate, metrics
from generators import ManifestFile, Outcome, generate, read_manifest

dataset = Dataset("data/demo")
assert_type(dataset[0], Observation)
assert_type(dataset[1:], list[Observation])
assert_type(dataset["part_1/a/kitchen/1"].test[0], Frame)
with SubmissionWriter("mine", dataset, method="mine") as writer:
    assert_type(writer, SubmissionWriter)
assert_type(validate("data/demo"), Report)
assert_type(check("mine", "data/demo"), Report)
assert_type(evaluate("mine", "data/demo"), Evaluation)
assert_type(read_manifest("demo.yaml"), ManifestFile)
assert_type(generate("demo.yaml", "data/demo", frames=8, audio="analytic"), Outcome)
assert_type(trivial.write_trivial("all-black", dataset, "mine"), SubmissionWriter)
assert_type(oracle.write_oracle(dataset, "mine", instance="category"), SubmissionWriter)
settings: echosegnet.Settings
print(metrics.no_such_metric)
generate("demo.yaml", "data/demo", audio="loud")
"""

pytestmark = pytest.mark.slow


def run(*command: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, cwd=cwd, timeout=400)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from a copy of the sources without a network."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    for package in PACKAGES:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    options = ("--no-deps", "--no-build-isolation", "--no-index", "-q", "-w", folder)
    built = run(sys.executable, "-m", "pip", "wheel", *options, source, cwd=folder)
    assert built.returncode == 0, built.stderr
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def interpreter(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of an environment that has the wheel and nothing else."""
    folder = tmp_path_factory.mktemp("environment")
    assert run(sys.executable, "-m", "venv", "--without-pip", folder / "venv", cwd=folder).returncode == 0
    python = folder / "venv/bin/python"
    options = ("install", "--no-deps", "--no-index", "-q")
    done = run(sys.executable, "-m", "pip", "--python", python, *options, wheel, cwd=folder)
    assert done.returncode == 0, done.stderr
    return python


def test_the_wheel_holds_every_stub_and_marker(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    expected = {f"{package}/py.typed" for package in PACKAGES}
    expected |= {path.relative_to(ROOT).as_posix() for package in PACKAGES for path in (ROOT / package).rglob("*.pyi")}
    assert len(expected) > 2 * len(PACKAGES)
    assert expected <= names


def test_a_type_checker_knows_the_public_names_of_the_installed_packages(interpreter: Path, tmp_path: Path) -> None:
    (tmp_path / "user.py").write_text(PROGRAM)
    # Other libraries are absent: what they declare is of no interest here, and takes a minute to read.
    options = ("--strict", "--ignore-missing-imports", "--cache-dir", tmp_path / "cache", "--no-error-summary")
    command = (sys.executable, "-m", "mypy", *options, "--python-executable", interpreter, "user.py")
    found = run(*command, cwd=tmp_path).stdout.splitlines()
    lines = PROGRAM.splitlines()
    assert [re.sub(r"user\.py:(\d+): error: .*\[(.*)\]", r"\1 \2", line) for line in found] == [
        f"{len(lines) - 1} attr-defined",
        f"{len(lines)} arg-type",
    ], "\n".join(found)


def test_the_public_names_of_the_installed_packages_can_be_imported(interpreter: Path, tmp_path: Path) -> None:
    import lazy_loader
    import numpy

    code = "import sys; sys.path += sys.argv[1:]\n"
    code += "from avs3d_bench import Dataset, SubmissionWriter, validate\nfrom evaluators import check, metrics\n"
    code += "from baselines import trivial\nimport avs3d_bench, generators\n"
    code += "print(avs3d_bench.__file__, *dir(generators))"
    libraries = {str(Path(str(module.__file__)).parent.parent) for module in (lazy_loader, numpy)}
    done = run(interpreter, "-I", "-c", code, *libraries, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    file, *names = done.stdout.split()
    assert Path(file).is_relative_to(interpreter.parent.parent)
    assert {"generate", "read_manifest"} <= set(names)
