"""`benchmarks/listener.mk`: its commands are ones that exist, in an order in which each finds what it needs."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
from collections import Counter
from itertools import pairwise
from pathlib import Path

import click
import pytest

from avs3d_bench.formats.files import write_json
from benchmarks.listener_seeds import SCENES, TESTS
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
    programs = r"(?:\.venv/bin/avs3d|\.venv/bin/python -m(?! tests)) .*?(?= \|\| | && |; \}|; fi|\))"
    return [shlex.split(found.replace("$best", "0")) for line in lines for found in re.findall(programs, line)]


def command_of(arguments: list[str]) -> tuple[click.Command, list[str]]:
    """The click command that arguments name, and what it gets."""
    if arguments[0].endswith("avs3d"):
        from baselines.listener.cli import train
        from generators.cli import generate

        if arguments[1] == "generate":
            return generate, arguments[2:]
        assert arguments[1] == "train"
        return train.commands[arguments[2]], arguments[3:]  # type: ignore[attr-defined]
    from benchmarks import (
        listener_ablation,
        listener_best,
        listener_calibration,
        listener_classes,
        listener_dry,
        listener_page,
        listener_seeds,
        listener_tables,
        recorded_manifests,
    )

    modules = {
        "listener_ablation": listener_ablation.main.commands.get(arguments[3]),  # type: ignore[attr-defined]
        "listener_best": listener_best.main,
        "listener_calibration": listener_calibration.main,
        "listener_classes": listener_classes.main,
        "listener_tables": listener_tables.main,
        "listener_page": listener_page.main,
        "listener_seeds": listener_seeds.main,
        "recorded_manifests": recorded_manifests.main,
        "listener_dry": listener_dry.main,
    }
    name = arguments[2].removeprefix("benchmarks.")
    return modules[name], arguments[4 if name == "listener_ablation" else 3 :]


def counted(found: list[list[str]]) -> Counter[str]:
    """How often each program is called, `generate` by its engine; all options are ones that the program has."""
    steps = Counter[str]()
    for arguments in found:
        command, rest = command_of(arguments)
        context = command.make_context(command.name or "", rest, resilient_parsing=True)
        known = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in rest if re.match("--?[a-z]", word)} <= known
        steps[str(context.params.get("audio") or arguments[2].removeprefix("benchmarks."))] += 1
    return steps


@pytest.mark.parametrize("gpus", [0, 2])
def test_every_step_is_a_command_with_options_that_exist(tmp_path: Path, gpus: int) -> None:
    (tmp_path / "run").mkdir()
    found = commands(tmp_path, "TESTS=demo listen+soundspaces demo-heads", "TESTS_3D=demo", f"GPUS={gpus}", "SEEDS=0 1")
    trained = {"listener": 2, "listener_ablation": 3 if gpus else 2}
    # 6 rows of seeds, controls of the best one, and EchoSegnet of both.
    scored = {"listener_tables": 9, "listener_classes": 6, "listener_best": 2, "listener_seeds": 2, "listener_page": 1}
    made = {"recorded_manifests": 1, "listener_dry": 1, "tracer": 3 + 2 + 2, "analytic": 1, "soundspaces": 1}
    assert counted(found) == {**made, **trained, **scored}
    assert any("pathtraced" in arguments for arguments in found) == bool(gpus)
    assert sum(arguments[-1] != "" and "--hrtf" in arguments for arguments in found) == 1


@pytest.mark.parametrize("gpus", [0, 1])
def test_trained_weights_are_calibrated_and_scored_without_training_data(tmp_path: Path, gpus: int) -> None:
    found = commands(tmp_path, "TESTS=demo", "TESTS_3D=", f"GPUS={gpus}", "SEEDS=0 1", "TRAINED=trained")
    scored = {"listener_tables": 3, "listener_classes": 2, "listener_best": 2, "listener_seeds": 2, "listener_page": 1}
    # Data for calibration, decoded once, and the test set; `figures` collects an ablation where there is one.
    assert counted(found) == {"tracer": 2 + 1, "listener_calibration": 2, "listener_ablation": 2, **scored}
    (decoded,) = (arguments[4:6] for arguments in found if "decode" in arguments)
    assert decoded == [str(tmp_path), "tune"]
    calibrated = [arguments for arguments in found if "benchmarks.listener_calibration" in arguments]
    for seed, arguments in enumerate(calibrated):
        assert arguments[3] == f"trained/seed{seed}/listener.safetensors"
        assert arguments[arguments.index("--accelerator") + 1] == ("cuda" if gpus else "cpu")
        assert arguments[arguments.index("-o") + 1] == f"{tmp_path}/run/seed{seed}"
        assert arguments[arguments.index("--cache") + 1] == f"{tmp_path}/tune-cache"


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


def test_all_tests_are_those_of_the_tables(tmp_path: Path) -> None:
    made = {}
    for arguments in commands(tmp_path, "TESTS=all", "GPUS=1", "TRAINED=trained"):
        output = Path(arguments[arguments.index("-o") + 1]) if "-o" in arguments else Path()
        if arguments[1] == "generate" and output.parent.name == "tests":
            made[output.name] = arguments
            assert (ROOT / arguments[2]).is_file()
    assert made.keys() == TESTS.keys() | SCENES.keys()
    for name, frames in {"open-s34-o7": "64", "open-s34-o7-24frames": "24", "open-s34-o7-pathtraced": "24"}.items():
        options = dict(pairwise(made[name]))  # of an option that is there twice, the last
        assert options["--frames"] == frames


def test_what_is_there_is_not_made_again(tmp_path: Path) -> None:
    (tmp_path / "manifests").mkdir()
    (tmp_path / "run" / "seed0").mkdir(parents=True)
    parts = [f"train-{part}.done" for part in ("pathtraced", "tracer", "analytic", "recorded")]
    names = ["kernels.done", "manifests/train-recorded.yaml", *parts, "tune.done", "decoded.done", "dry.npz"]
    for name in (*names, "run/seed0/listener.safetensors", "test-demo.done", "ablation.done"):
        (tmp_path / name).touch()
    left = [arguments[2].removeprefix("benchmarks.") for arguments in commands(tmp_path, "TESTS=demo", "SEEDS=0")]
    assert left[:2] == ["listener_tables", "listener_classes"]
    later = {"listener_best", "listener_tables", "listener_seeds", "listener_ablation", "listener_page"}
    assert set(left[2:]) == later


def run_with(tmp_path: Path, program: str) -> subprocess.CompletedProcess[str]:
    """One part of the training data, made by a program of the test in place of `avs3d`."""
    (tmp_path / "manifests").mkdir()
    for name in ("kernels.done", "manifests/train-recorded.yaml"):
        (tmp_path / name).touch()
    fake = tmp_path / "avs3d"
    fake.write_text(f"#!/bin/sh\n{program}\n")
    fake.chmod(0o755)
    command = ["make", "-f", "benchmarks/listener.mk", f"LISTENER={tmp_path}", "WORKERS=2", f"AVS3D={fake}"]
    return subprocess.run(
        [*command, f"{tmp_path}/train-tracer.done"], cwd=ROOT, capture_output=True, text=True, timeout=60
    )  # fmt: skip


@pytest.mark.parametrize(
    ("status", "shards", "made"), [(0, 1, True), (1, 1, True), (124, 1, True), (1, 0, False), (2, 1, False)]
)
def test_a_part_is_what_could_be_made_of_it(tmp_path: Path, status: int, shards: int, made: bool) -> None:
    folder = tmp_path / "train" / "tracer"
    done = run_with(tmp_path, f"mkdir -p {folder}; {f'touch {folder}/one.tar; ' * shards}exit {status}")
    assert (done.returncode == 0) == made
    assert (tmp_path / "train-tracer.done").exists() == made


def test_the_best_run_has_the_best_rule(tmp_path: Path) -> None:
    from benchmarks.listener_best import best_of, figures_of, rows

    runs = [tmp_path / f"seed{number}" for number in range(4)]
    for run, rules in zip(runs, ([(0.5, 0.2)], [(0.2, 0.1), (0.6, 0.2)], [(0.6, 0.25), (0.3, 0.0)]), strict=False):
        run.mkdir()
        by_rule = {"by_rule": [{"iou": iou, "false": false} for iou, false in rules]}
        write_json(run / "model_card.json", {"calibration": {"figures": by_rule}})
    figures = figures_of(runs)
    assert best_of(figures) == runs[1]
    found = {run.name: each for run, each in figures.items()}
    assert ["IoU less false marks", ".300", ".400", ".350"] in rows(found)
    with pytest.raises(click.UsageError, match="let a training end first"):
        figures_of(runs[3:])
