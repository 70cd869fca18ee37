"""benchmarks/listen_chance.py: what guesses reach, against shares worked out by hand and the oracle's own score."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from avs3d_bench.contract.scores import PAIR_FIGURES
from avs3d_bench.dataset import Dataset
from baselines.oracle import write_oracle
from benchmarks.listen_chance import GUESSES, group_chance, main
from evaluators.score import evaluate
from tests.support.shared import SharedDataset
from tests.support.tiny_scenes import AWAY, FIRST, GROUP, SECOND, SILENT


@pytest.fixture(scope="module")
def data(shared_part_3: SharedDataset) -> Path:
    return shared_part_3(frames=17)


def test_two_twins(data: Path):
    """Marking one of the two microwaves is right for each sibling with probability 1/2, whatever is in view."""
    found = group_chance(data, (FIRST, SECOND))
    for figure in ("pair_accuracy", "twins"):
        assert found["category, one"][figure] == pytest.approx(1 / 4)
        assert found["category, all"][figure] == 0
    assert found["category, one"]["silence"] is None


def test_a_sound_and_silence(data: Path):
    """Of three instances one is right, and silence is known; there are no twins."""
    found = group_chance(data, (FIRST, SILENT))
    for figure in ("pair_accuracy", "silence"):
        assert found["presence, instance"][figure] == pytest.approx(1 / 3)
        assert found["category, one"][figure] == pytest.approx(1 / 2)
    assert found["category, one"]["twins"] is None
    assert set(group_chance(data, (SILENT, AWAY))["category, one"].values()) == {None}, "no truth differs"


def test_all_of_the_category_is_the_category_oracle(data: Path, tmp_path: Path):
    write_oracle(Dataset(data), tmp_path / "s", instance="category")
    listen = evaluate(tmp_path / "s", data).scores.overall.listen
    assert listen is not None
    found = group_chance(data, GROUP)["category, all"]
    for figure in PAIR_FIGURES:
        assert found[figure] == pytest.approx(getattr(listen, figure)), figure


def test_the_program(data: Path, tmp_path: Path):
    done = CliRunner().invoke(main, [str(data), "--workers", "1", "--json", str(tmp_path / "c.json")])
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "c.json").read_text())
    assert (found["groups"], found["scored"]) == (1, len(GROUP))
    assert set(found["guesses"]) == set(GUESSES)
    expected = group_chance(data, GROUP)["category, one"]
    assert found["guesses"]["category, one"] == {name: pytest.approx(value) for name, value in expected.items()}
