"""Three hundred broken submissions: no traceback, no hang, no score, every broken file named."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from avs3d_bench.contract import layout
from evaluators import cli
from tests.evaluators.test_score import submit, true_mask
from tests.support import mutants, tiny
from tests.support.shared import SharedDataset

COUNT = 300
RELEASED_COUNT = 54
FRAMES = 25  # four test frames an observation


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=FRAMES)


@pytest.fixture(scope="module")
def whole(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("submissions") / "whole"
    return submit(folder, data, true_mask, points=lambda observation: observation.mesh().vertices)


@pytest.fixture(scope="module")
def released(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("submissions") / "released"
    return submit(folder, data, true_mask, masks=layout.RELEASED_MASKS[0])


def call(command: str, capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """Exit status and everything printed; what is no `SystemExit` is a traceback and fails the test."""
    from avs3d_bench.cli import main

    words = [str(a) for a in arguments]
    with pytest.raises(SystemExit) as end:
        cli.main(words) if command == "avs3d-eval" else main(["check", *words])
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out + said.err


@pytest.mark.slow
def test_the_whole_submission_is_scored(data: Path, whole: Path, capsys: pytest.CaptureFixture[str]):
    for command in ("check", "avs3d-eval"):
        code, said = call(command, capsys, whole, "--dataset", data, "--workers", 1)
        assert code == 0, said


@pytest.mark.parametrize("kind", mutants.MUTATIONS)
def test_each_kind_is_tried_at_least_seven_times(kind: str):
    assert sum(seed % len(mutants.MUTATIONS) == list(mutants.MUTATIONS).index(kind) for seed in range(COUNT)) >= 7


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(COUNT))
def test_a_broken_submission(data: Path, whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: int):
    root = tiny.clone(whole, tmp_path / "submission")
    kinds, named = mutants.broken(root, seed)
    refused(data, root, kinds, named, tmp_path, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(RELEASED_COUNT))
def test_broken_masks_of_the_released_pipeline(
    data: Path, released: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: int
):
    root = tiny.clone(released, tmp_path / "submission")
    kinds, named = mutants.broken(root, seed, mutants.IN_RELEASED)
    refused(data, root, kinds, named, tmp_path, capsys)


def refused(
    data: Path, root: Path, kinds: list[str], named: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both programs end with 1, name every file of ``named`` and blame no other, and write nothing."""
    assert named
    before = sorted(os.listdir(folder))
    scores, page = folder / "scores.json", folder / "report.html"
    for command, more in (("check", ()), ("avs3d-eval", ("--json", scores, "--html", page))):
        code, said = call(command, capsys, root, "--dataset", data, "--workers", 1, *more)
        assert code == 1, (kinds, said)
        assert all(line.isprintable() for line in said.split("\n")), (kinds, said)  # nothing that steers a terminal
        blamed = errors(said)
        assert not [path for path in named if path not in blamed], (kinds, said)
        guilty = (*named, *aside(root))
        innocent = [path for path in blamed if not any(path == g or path.startswith(f"{g}/") for g in guilty)]
        assert not innocent, (kinds, named, said)
    assert sorted(os.listdir(folder)) == before


def aside(root: Path) -> list[str]:
    """Where `folder_link_inside` put folders, with what earlier mutations had made of the masks in them."""
    return [path.name for path in root.glob("aside_*")]


def errors(said: str) -> set[str]:
    """The files that the printed findings call broken: observations are headings, files stand below theirs."""
    heading, found = "", set()
    for line in said.splitlines():
        finding = re.match(r"  (error|warning|note) +(.+?): ", line)
        if finding is None:
            heading = f"{line}/" if line.startswith("part_") else ""
        elif finding[1] == "error":
            found.add(f"{heading}{finding[2]}".removesuffix("/."))
    return found


@pytest.mark.slow
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
