"""One moment of every kind of fault, at full depth; `python -m benchmarks.faults` tries fifty of each."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmarks import faults
from benchmarks.faults import KINDS, Bench, Trial, prepare, print_table, reason_against, try_once
from generators.cli import generate
from tests.support.here import generated_here

#: A trial whose moment falls into the observations, not into the start of the program.
SEEDS = {"hang": 1}
#: Where the run after the disturbed one is a program of its own, as for users; the others are given in this process.
AS_PROGRAMS = ("client", "dask-client")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    folder = tmp_path_factory.mktemp("faults")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", "1")
        patch.setenv("AVS3D_CACHE", str(folder / "cache"))
        # Compiled already, as whatever the tests use: no run before the one that is timed.
        yield prepare(folder, ["second"], camera={"size": 64, "frames": 12})


def again_here(bench: Bench, root: Path, log: Path, options: list[str]) -> int:
    """In place of `faults.again`: the same command without a program, which takes seconds to load."""
    arguments = [str(bench.manifest), "-o", str(root), "--audio", "analytic", "--workers", "1", *options]
    with generated_here():
        done = CliRunner().invoke(generate, arguments)
    log.write_text(done.output)
    return done.exit_code


@pytest.mark.parametrize("kind", KINDS)
def test_the_tree_is_that_of_an_undisturbed_run(bench: Bench, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if why := reason_against(kind):
        pytest.skip(f"{kind}: {why}")
    if kind not in AS_PROGRAMS:
        monkeypatch.setattr(faults, "again", again_here)
    trial = try_once(bench, kind, SEEDS.get(kind, 0))
    assert trial.recovered, trial.problem
    assert trial.healed or trial.reruns, "a run that was disturbed either heals by itself or is given again"


def undisturbed(bench: Bench, root: Path, log: Path, *_: object) -> int:
    """In place of a run that nothing disturbs: its tree, its exit code."""
    shutil.copytree(bench.folder / "second" / "data", root)
    log.touch()
    return 0


def test_a_tree_that_differs_is_not_recovered(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(faults._DISTURB, "client", undisturbed)
    assert try_once(bench, "client", 0).recovered
    name = next(name for name in bench.truth if name.endswith("observation.json"))
    trial = try_once(replace(bench, truth=bench.truth | {name: "0" * 64}), "client", 0)
    assert not trial.recovered
    assert trial.problem == f"1 files differ, e.g. {name}"


def test_what_is_left_behind_is_not_recovered(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def litter(bench: Bench, root: Path, log: Path, *_: object) -> int:
        code = undisturbed(bench, root, log)
        (root / ".left").touch()
        return code

    monkeypatch.setitem(faults._DISTURB, "worker", litter)
    trial = try_once(bench, "worker", 0)
    assert (trial.healed, trial.recovered, trial.problem) == (True, False, "1 files differ, e.g. .left")


def test_a_trial_that_cannot_be_made_is_not_recovered(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(faults._DISTURB, "worker", broken)
    trial = try_once(bench, "worker", 0)
    assert not trial.recovered
    assert trial.problem == "OSError: [Errno 28] No space left on device"


def test_the_table_counts_kinds_and_names_what_was_lost(capsys: pytest.CaptureFixture[str]) -> None:
    trials = [
        Trial("worker", 0, 0.25, True, True, 0),
        Trial("worker", 1, 0.5, False, True, 1),
        Trial("client", 0, 0.75, False, False, 3, "still exit code 1"),
    ]
    print_table(trials, {"clock": "libfaketime is missing"})
    assert capsys.readouterr().out.splitlines() == [
        "kind              tried  healed  recovered",
        "worker                2       1          2",
        "client                1       0          0",
        "clock             not tried: libfaketime is missing",
        "NOT RECOVERED client seed 0 at 0.750: still exit code 1",
    ]
