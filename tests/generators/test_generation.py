"""`generators.generate`: the bytes of `avs3d generate`, one call from Python, and one-line errors."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from avs3d_bench import Dataset, UsageError, validate
from generators import Outcome, generate, read_manifest
from tests.support.homes import tree_digest, write_manifest

pytest.importorskip("embreex", reason="the renderer of the generate extra")

ROOT = Path(__file__).parents[2]
KEY = "part_1/box/kitchen/1"
SMALL: dict[str, Any] = {"only": ["part_1/*"], "audio": "analytic", "frames": 2, "size": 32, "workers": 1}


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_manifest(tmp_path_factory.mktemp("manifest"))


@pytest.fixture(scope="module")
def made(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    """The folder and the outcome of a first call, with threads that the caller's environment asks for."""
    root = tmp_path_factory.mktemp("made") / "tiny"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", "4")
        outcome = generate(str(manifest), str(root), extras=["depth"], **SMALL)
    return root, outcome


def test_a_manifest_becomes_a_dataset(made: tuple[Path, Outcome]) -> None:
    root, outcome = made
    assert (outcome.made, outcome.kept, outcome.failed, outcome.stopped) == ((KEY,), (), (), False)
    observation = Dataset(root)[0]
    assert (observation.key, len(observation), observation.intrinsics.width) == (KEY, 2, 32)
    assert observation.frames[1].depth().shape == (32, 32)
    assert validate(root).valid


@pytest.mark.slow
def test_the_bytes_are_those_of_the_command(made: tuple[Path, Outcome], manifest: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "avs3d_bench", "generate", manifest, "-o", tmp_path / "tiny", "--workers", "1"]
    command += ["--only", "part_1/*", "--audio", "analytic", "--frames", "2", "--size", "32", "--with", "depth"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert tree_digest(tmp_path / "tiny") == tree_digest(made[0])


def test_the_same_call_keeps_what_is_finished_and_prints_nothing(
    made: tuple[Path, Outcome], manifest: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    outcome = generate(read_manifest(manifest), made[0], extras=["depth"], **SMALL)
    assert (outcome.made, outcome.kept) == ((), (KEY,))
    assert capfd.readouterr() == ("", "")
    generate(manifest, made[0], extras=["depth"], progress=True, **SMALL)
    assert f"kept   {KEY}" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"frames": 0}, "frames: found 0; expected a whole number from 1 to 999"),
        ({"frames": 1000}, "frames: found 1000; expected a whole number from 1 to 999"),
        ({"frames": 8.5}, "frames: found 8.5; expected a whole number from 1 to 999"),
        ({"size": 8}, "size: found 8; expected a whole number from 16 to 8192"),
        ({"size": "128"}, "size: found '128'; expected a whole number from 16 to 8192"),
        ({"size": True}, "size: found True; expected a whole number"),
        ({"workers": 0}, "workers: found 0; expected a whole number from 1 to 256"),
        ({"ambisonics": "2"}, "ambisonics: found '2'; expected a whole number from 1 to 3"),
        ({"device": "gpu"}, "device: found 'gpu'; expected one of cpu, cuda"),
        ({"device": None}, "device: found None; expected one of cpu, cuda"),
        ({"vision": ["embree"]}, "vision: found ['embree']; expected one of embree, cuda, habitat"),
        ({"format": "folder"}, "format: found 'folder'; expected one of folders, webdataset; did you mean 'folders'?"),
        ({"hrtf": 5}, "hrtf: found 5; expected the path of a file or folder"),
        ({"only": [1]}, "only: found [1]; expected a list of patterns"),
        ({"only": 5}, "only: found 5; expected a list of patterns"),
        ({"remake": "part_1/*"}, "remake: found 'part_1/*'; expected a list of patterns"),
        (
            {"extras": ["deptth"]},
            "extras: unknown folder 'deptth': expected some of depth, rirs, stems; did you mean 'depth'",
        ),
        ({"extras": "depth"}, "extras: found 'depth'; expected a list of names"),
        ({"only": "part_1/*"}, "only: found 'part_1/*'; expected a list of patterns"),
        ({"only": ["part_9/*"]}, "part_9"),
        ({"vision": "povray"}, "vision: found 'povray'; expected one of embree, cuda, habitat"),
        ({"audio": "loud"}, "audio: found 'loud'; expected one of soundspaces, tracer, analytic"),
    ],
)
def test_wrong_arguments_are_one_line_before_anything_is_made(
    manifest: Path, tmp_path: Path, changes: dict[str, Any], says: str
) -> None:
    with pytest.raises(UsageError) as caught:
        generate(manifest, tmp_path / "tiny", **{**SMALL, **changes})
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "tiny").exists()


@pytest.mark.parametrize(("manifest", "root"), [(None, "data"), ("m.yaml", None), (5, "data")])
def test_what_is_no_path_is_one_line(manifest: Any, root: Any) -> None:
    with pytest.raises(UsageError, match=r"(manifest|root): found (None|5); expected the path of a file or folder"):
        generate(manifest, root)


def test_a_manifest_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"none\.yaml"):
        generate(tmp_path / "none.yaml", tmp_path / "tiny")
