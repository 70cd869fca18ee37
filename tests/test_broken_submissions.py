"""Three hundred broken submissions: no traceback, no hang, no score, every broken file named."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import mutants
import pytest
import tiny
from test_score import submit, true_mask

from evaluators import cli

COUNT = 300
FRAMES = 25  # four test frames an observation


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.write_dataset(tmp_path_factory.mktemp("data") / "tiny", frames=FRAMES)


@pytest.fixture(scope="module")
def whole(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("submissions") / "whole"
    return submit(folder, data, true_mask, points=lambda observation: observation.mesh().vertices)


def call(command: str, capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """Exit status and everything printed; what is no `SystemExit` is a traceback and fails the test."""
    from avs3d_bench.cli import main

    words = [str(a) for a in arguments]
    with pytest.raises(SystemExit) as end:
        cli.main(words) if command == "avs3d-eval" else main(["check", *words])
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out + said.err


def test_the_whole_submission_is_scored(data: Path, whole: Path, capsys: pytest.CaptureFixture[str]):
    for command in ("check", "avs3d-eval"):
        code, said = call(command, capsys, whole, "--dataset", data, "--workers", 1)
        assert code == 0, said


@pytest.mark.parametrize("kind", mutants.MUTATIONS)
def test_each_kind_is_tried_at_least_seven_times(kind: str):
    assert sum(seed % len(mutants.MUTATIONS) == list(mutants.MUTATIONS).index(kind) for seed in range(COUNT)) >= 7


@pytest.mark.parametrize("seed", range(COUNT))
def test_a_broken_submission(data: Path, whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: int):
    root = tiny.clone(whole, tmp_path / "submission")
    kinds, named = mutants.broken(root, seed)
    assert named
    scores = tmp_path / "scores.json"
    for command, more in (("check", ()), ("avs3d-eval", ("--json", scores, "--html", tmp_path / "report.html"))):
        code, said = call(command, capsys, root, "--dataset", data, "--workers", 1, *more)
        assert code == 1, (kinds, said)
        flat = "".join(said.split("\n"))
        missing = [path for path in named if not listed(path, flat)]
        assert not missing, (kinds, missing, said)
    assert not scores.exists()
    assert not (tmp_path / "report.html").exists()


def listed(path: str, said: str) -> bool:
    """Whether a path is named: its observation as a heading, its place inside below."""
    pieces = path.split("/")
    return all(part in said for part in (("/".join(pieces[:4]), "/".join(pieces[4:])) if len(pieces) > 4 else (path,)))


@pytest.mark.parametrize("seed", [0, 77, 151])
def test_as_a_program(data: Path, whole: Path, tmp_path: Path, seed: int):
    root = tiny.clone(whole, tmp_path / "submission")
    mutants.broken(root, seed)
    code = "from evaluators.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, str(root), "--dataset", str(data)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stdout + done.stderr


@pytest.mark.parametrize("depth", [1, 2])
def test_nested_a_folder_deeper(
    data: Path, whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], depth: int
):
    root = tmp_path / "outer"
    tiny.clone(whole, root.joinpath(*["deeper"] * depth))
    for command in ("check", "avs3d-eval"):
        code, said = call(command, capsys, root, "--dataset", data)
        assert code == 2
        assert said.count("\n") == 1
        assert ("point at" in said) == (depth == 1)
