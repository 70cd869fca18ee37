"""Weights and checkpoints that somebody else wrote: one line, no memory for what they claim, no empty masks."""

from __future__ import annotations

import json
import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")
pytest.importorskip("safetensors")

import torch
from safetensors import safe_open
from safetensors.torch import save_file

from avs3d_bench.cli import main
from avs3d_bench.errors import Avs3dError
from baselines.echosegnet import checkpoint
from baselines.echosegnet.densify import PARAMETERS, GradientStats
from baselines.listener import weights
from baselines.networks.checkpoints import load_pretrained
from tests.support import tiny, tiny_listener, tiny_models

MOST_BYTES = 1 << 30


def rewritten(path: Path, about: Callable[[dict[str, Any]], Any] | None = None, tensors: Any = None) -> Path:
    """Weights with another description, or other tensors, without their digest."""
    with safe_open(path, "pt") as file:
        said = json.loads(file.metadata()[weights.WEIGHTS_FORMAT])
        held = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    text = said if about is None else about(said)
    held = held if tensors is None else {name: tensors(name, tensor) for name, tensor in held.items()}
    save_file(held, path, metadata={weights.WEIGHTS_FORMAT: text if isinstance(text, str) else json.dumps(text)})
    weights.digest_path(path).unlink(missing_ok=True)
    return path


def with_widths(**changes: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda said: said | {"widths": said["widths"] | changes}


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    return tiny_listener.write_weights(tmp_path)


@pytest.mark.parametrize(
    ("about", "says"),
    [
        (with_widths(image=[200_000] * 5), "image: expected whole numbers between 1 and 4096"),
        (with_widths(audio=[8, 8, 16, 10**30]), "audio: expected whole numbers"),
        (with_widths(blocks=[0, 1, 1, 1, 10**9]), "blocks: expected whole numbers between 0 and 64"),
        (with_widths(attention=10**9), "attention: expected whole numbers"),
        (with_widths(attention=True), "attention: expected whole numbers"),
        (with_widths(image=[8.0, 8, 16, 16, 16]), "image: expected whole numbers"),
        (with_widths(image=[8, 8, 16]), "image: expected 5 numbers"),
        (with_widths(image="8"), "image: expected 5 numbers"),
        (with_widths(image=[4096] * 5, decoder=[4096] * 4), "its tensors are not those of version 3"),
        (with_widths(image=[-1] * 5), "image: expected whole numbers"),
        (with_widths(unknown=1), "unknown: expected true or false"),
        (lambda said: said | {"calibration": {"mask": 0}}, "mask: expected a temperature between 0.05 and 20"),
        (lambda said: said | {"calibration": {"mask": "1"}}, "mask: expected a number"),
        (lambda said: said | {"calibration": {"audible": float("nan")}}, "audible: expected a temperature"),
        (lambda said: said | {"calibration": {"threshold": 1.0}}, "threshold: expected a probability"),
        (lambda said: said | {"calibration": {"share": 0}}, "share: expected a probability"),
        (lambda said: said | {"calibration": {"bias": 1e9}}, "bias: expected log-odds"),
        (lambda said: said | {"calibration": {"share": "half"}}, "share: expected a number"),
        (with_widths(more=1), "description of the network is damaged"),
        (lambda said: said | {"widths": [1]}, "description of the network is damaged"),
        (lambda said: [said], "description of the network is damaged"),
        (lambda said: said | {"version": "\x1b[31m" * 100}, "weights of version"),
        (lambda _: "[" * 100_000, "nested too deeply"),
        (lambda _: '{"version": 2, "widths": ' + '{"a":' * 100_000, "nested too deeply"),
        (lambda _: "", "description of the network is damaged"),
    ],
)  # fmt: skip
def test_a_description_that_no_network_has_is_one_line_and_takes_no_memory(
    saved: Path, about: Callable[[dict[str, Any]], Any], says: str
) -> None:
    rewritten(saved, about)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(Avs3dError, match=says) as caught:
        weights.load_listener(saved)
    line = str(caught.value)
    assert "\n" not in line
    assert "\x1b" not in line
    assert len(line) < 1000
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < MOST_BYTES


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
@pytest.mark.parametrize("where", ["everywhere", "in one number"])
def test_weights_that_are_no_numbers_write_nothing(
    saved: Path, tmp_path: Path, value: float, where: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def spoil(name: str, tensor: torch.Tensor) -> torch.Tensor:
        if where == "everywhere":
            return torch.full_like(tensor, value)
        if name == "picture_decoder.head.bias":
            tensor[-1] = value
        return tensor

    rewritten(saved, tensors=spoil)
    data = tiny.write_dataset(tmp_path / "data", frames=2, size=32, keys=(tiny.SINGLE,))
    words = ["--dataset", data, "-o", tmp_path / "out", "--weights", saved, "--looks", "one", "--device", "cpu"]
    with pytest.raises(SystemExit) as end:
        main(["baseline", "listener", *map(str, words)])
    assert end.value.code == 1
    assert "holds NaN or infinite numbers" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_finite_weights_whose_answer_is_no_number_write_nothing(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rewritten(saved, tensors=lambda _, tensor: torch.full_like(tensor, torch.finfo(tensor.dtype).max))
    data = tiny.write_dataset(tmp_path / "data", frames=2, size=32, keys=(tiny.SINGLE,))
    words = ["--dataset", data, "-o", tmp_path / "out", "--weights", saved, "--looks", "one", "--device", "cpu"]
    with pytest.raises(SystemExit) as end:
        main(["baseline", "listener", *map(str, words)])
    assert end.value.code == 1
    assert "answers with NaN or infinite numbers" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# ---- checkpoints of a splatting


def start(count: int = 6) -> torch.optim.Adam:
    """An optimiser after a step, with tensors of the shapes of a training."""
    torch.manual_seed(0)
    widths = {"means": (3,), "log_scales": (3,), "rotations": (4,), "opacities": (), "sh0": (1, 3), "sh_rest": (15, 3)}
    groups = [
        {"params": [torch.nn.Parameter(torch.randn(count, *widths[name]))], "name": name, "lr": 0.01}
        for name in PARAMETERS
    ]
    optimiser = torch.optim.Adam(groups)
    sum(group["params"][0].square().sum() for group in groups).backward()
    optimiser.step()
    return optimiser


def spoiled_parameters(content: dict[str, Any]) -> None:
    content["parameters"]["means"][0, 0] = float("nan")


def other_count(content: dict[str, Any]) -> None:
    content["parameters"]["opacities"] = torch.zeros(10)


def other_shape(content: dict[str, Any]) -> None:
    content["parameters"]["sh0"] = torch.zeros(6, 200_000)


def other_moments(content: dict[str, Any]) -> None:
    content["state"]["means"]["exp_avg"] = torch.zeros(1, 3)


def other_sums(content: dict[str, Any]) -> None:
    content["pull"]["total"] = torch.zeros(1)


def no_number(content: dict[str, Any]) -> None:
    content["iteration"] = "x"


def no_tensor(content: dict[str, Any]) -> None:
    content["parameters"]["rotations"] = [1, 2]


@pytest.mark.parametrize(
    "spoil", [spoiled_parameters, other_count, other_shape, other_moments, other_sums, no_number, no_tensor, None]
)
def test_a_checkpoint_whose_parts_do_not_belong_together_is_one_line(tmp_path: Path, spoil: Any) -> None:
    path, optimiser = tmp_path / "checkpoint.pt", start()
    pull = GradientStats.zeros(optimiser.param_groups[0]["params"][0])
    checkpoint.save(path, optimiser, pull, 7, None, "digest")
    if spoil is None:
        assert checkpoint.load(path, start(3), "digest", torch.device("cpu"))[0] == 7, (
            "another number of Gaussians is fine"
        )
        return
    content = torch.load(path, weights_only=True)
    spoil(content)
    torch.save(content, path)
    fresh = start(3)
    before = [group["params"][0] for group in fresh.param_groups]
    with pytest.raises(Avs3dError, match="damaged checkpoint") as caught:
        checkpoint.load(path, fresh, "digest", torch.device("cpu"))
    assert "\n" not in str(caught.value)
    assert all(group["params"][0] is old for group, old in zip(fresh.param_groups, before, strict=True))


# ---- checkpoints of other people's networks


@pytest.mark.parametrize("change", ["wide", "deep", "brackets", "nan"])
def test_a_foreign_checkpoint_that_claims_too_much_is_one_line(tmp_path: Path, change: str) -> None:
    transformers = pytest.importorskip("transformers")
    folder = tiny_models.write_sam(tmp_path / "sam")
    config = json.loads((folder / "config.json").read_text())
    if change == "wide":
        config["vision_config"] |= {"hidden_size": 200_000, "mlp_dim": 200_000}
    elif change == "deep":
        config["vision_config"] |= {"num_hidden_layers": 10**7}
    if change == "nan":
        from safetensors.torch import load_file

        tensors = {
            name: torch.full_like(one, torch.nan) for name, one in load_file(folder / "model.safetensors").items()
        }
        save_file(tensors, folder / "model.safetensors", metadata={"format": "pt"})
    text = json.dumps(config) if change != "brackets" else "[" * 100_000
    (folder / "config.json").write_text(text)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(Avs3dError, match="checkpoint of SAM") as caught:
        load_pretrained("sam", transformers.SamModel, folder)
    assert "\n" not in str(caught.value)
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < MOST_BYTES
