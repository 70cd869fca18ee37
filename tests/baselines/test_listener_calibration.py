"""Weights that are calibrated again, without a training: `benchmarks.listener_calibration`."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from avs3d_bench.cli import run
from avs3d_bench.exports import write_webdataset
from tests.support.needs import need

torch = pytest.importorskip("torch", reason="torch is not installed: the listener cannot run")
need("lightning_fabric", reason="lightning-fabric is not installed: the listener cannot be trained")

from baselines.listener import calibration, weights  # noqa: E402
from benchmarks import listener_calibration  # noqa: E402
from tests.support import tiny_listener, tiny_scenes  # noqa: E402

torch.set_num_threads(1)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Shards of two pictures with five sounds each."""
    folder = tmp_path_factory.mktemp("calibration")
    tiny_scenes.write_part_3(folder / "set", frames=2, size=64)
    write_webdataset(folder / "set", folder / "shards", workers=1)
    return folder / "shards"


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    return tiny_listener.write_weights(tmp_path)


def calibrated(weights_file: Path, data: Path, output: Path) -> int:
    """Exit code of the program."""
    words = [weights_file, "--calibrate-on", data, "-o", output, "--workers", "1"]
    with pytest.raises(SystemExit) as end:
        run(listener_calibration.main, [str(word) for word in words], program="listener_calibration")
    return int(end.value.code or 0)


def refused(weights_file: Path, data: Path, output: Path, says: str, capsys: Any) -> None:
    """The program ends with one line and writes no weights."""
    there = set(output.rglob("*"))
    assert calibrated(weights_file, data, output) in (1, 2)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("listener_calibration: error: ")
    assert says in line
    assert set(output.rglob("*")) == there


def test_weights_get_new_numbers_and_keep_their_network(saved: Path, data: Path, tmp_path: Path) -> None:
    output = tmp_path / "new" / "folder"
    assert calibrated(saved, data, output) == 0
    before, after = weights.read_weights(saved), weights.read_weights(output / "listener.safetensors")
    for name, tensor in before.network.state_dict().items():
        assert torch.equal(tensor, after.network.state_dict()[name]), name
    assert before.calibration is None
    assert after.calibration is not None
    assert after.calibration.share in calibration.SHARES
    assert after.calibration.bias == 0  # all of part_3
    told = json.loads((output / "calibration.json").read_text())
    assert (told["weights"], told["sha256"]) == (before.digest, after.digest)
    assert told["calibration"] == asdict(after.calibration)
    assert told["figures"]["pictures"] == 10
    chosen = {"threshold": after.calibration.threshold, "share": after.calibration.share}
    assert any(chosen.items() <= rule.items() for rule in told["figures"]["by_rule"])


def test_the_card_of_the_weights_gets_the_new_numbers(saved: Path, data: Path, tmp_path: Path) -> None:
    package = Path(weights.__file__).with_name("weights") / "model_card.json"
    card = json.loads(package.read_text())
    (saved.parent / "model_card.json").write_text(json.dumps(card))
    assert calibrated(saved, data, tmp_path / "other") == 0
    assert not (tmp_path / "other" / "model_card.json").exists()  # the card is of other weights
    card["weights"]["sha256"] = weights.read_weights(saved).digest
    (saved.parent / "model_card.json").write_text(json.dumps(card))
    output = tmp_path / "own"
    assert calibrated(saved, data, output) == 0
    found, told = (json.loads((output / f"{name}.json").read_text()) for name in ("model_card", "calibration"))
    assert found["weights"]["sha256"] == told["sha256"]
    assert found["calibration"].items() >= (told["calibration"] | {"figures": told["figures"]}).items()
    assert {key: found[key] for key in ("data", "training", "validation")} == {
        key: card[key] for key in ("data", "training", "validation")
    }
    shown = (output / "model_card.md").read_text()
    assert told["sha256"] in shown
    assert found["calibration"]["command"] in shown


def test_a_folder_with_something_in_it_is_refused(saved: Path, data: Path, tmp_path: Path, capsys: Any) -> None:
    output = tmp_path / "used"
    output.mkdir()
    (output / "thesis.tex").write_text("mine")
    refused(saved, data, output, "not empty", capsys)
    assert (output / "thesis.tex").read_text() == "mine"
    refused(saved, data, output / "thesis.tex", "not empty", capsys)


def test_damaged_weights_and_missing_inputs_are_one_line(saved: Path, data: Path, tmp_path: Path, capsys: Any) -> None:
    output = tmp_path / "out"
    refused(saved, tmp_path / "nowhere", output, "nowhere", capsys)
    refused(tmp_path / "none.safetensors", data, output, "no such file", capsys)
    saved.write_bytes(saved.read_bytes()[:1000])
    refused(saved, data, output, "the file was changed or cut", capsys)
