"""Local checkpoints: for a missing or broken one, one line with the file, its source, licence and size."""

from __future__ import annotations

import json
import os
import urllib.request
from pathlib import Path
from typing import Any

import pytest

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.runtime import imports
from tests.support.needs import need

torch = pytest.importorskip("torch", reason="torch is not installed: the learned baselines cannot run")
need("transformers", reason="transformers is not installed: the learned baselines cannot run")

from baselines.networks import checkpoints  # noqa: E402
from baselines.networks.checkpoints import (  # noqa: E402
    CHECKPOINTS,
    PINS,
    find_checkpoint,
    load_pretrained,
    load_weights,
)
from tests.support import tiny_models  # noqa: E402

torch.set_num_threads(1)


@pytest.fixture(scope="module")
def sam(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_models.write_sam(tmp_path_factory.mktemp("sam"))


def copy_of(folder: Path, target: Path, **changes: bytes | None) -> Path:
    """A copy; ``changes``: file name with ``_`` for ``.`` at its end → other bytes, or None to leave it out."""
    target.mkdir()
    for path in folder.iterdir():
        data = changes.get(path.name.replace(".", "_"), path.read_bytes())
        if data is not None:
            (target / path.name).write_bytes(data)
    return target


def line_of(error: pytest.ExceptionInfo[Avs3dError]) -> str:
    text = str(error.value)
    assert "\n" not in text
    return text


@pytest.mark.parametrize("kind", sorted(CHECKPOINTS))
def test_a_missing_folder_is_answered_with_all_that_must_be_known(kind: str, tmp_path: Path) -> None:
    with pytest.raises(Avs3dError) as error:
        find_checkpoint(kind, tmp_path / "nowhere")
    text = line_of(error)
    checkpoint = CHECKPOINTS[kind]
    for part in (str(tmp_path / "nowhere"), checkpoint.name, checkpoint.source, checkpoint.licence, checkpoint.size):
        assert part in text
    for choice in checkpoint.files:
        assert choice[0] in text


@pytest.mark.parametrize("kind", sorted(CHECKPOINTS))
def test_no_folder_named_is_a_usage_error(kind: str) -> None:
    with pytest.raises(UsageError, match=CHECKPOINTS[kind].name):
        find_checkpoint(kind, None)


@pytest.mark.slow
def test_the_missing_file_is_named(sam: Path, tmp_path: Path) -> None:
    folder = copy_of(sam, tmp_path / "x", model_safetensors=None)
    with pytest.raises(Avs3dError, match=r"model\.safetensors of SAM is missing; put config\.json, .*Apache-2\.0"):
        find_checkpoint("sam", folder)


def test_an_empty_file_is_broken(sam: Path, tmp_path: Path) -> None:
    folder = copy_of(sam, tmp_path / "x", config_json=b"")
    with pytest.raises(Avs3dError, match=r"config\.json: empty, the checkpoint of SAM is broken"):
        find_checkpoint("sam", folder)


def test_a_folder_with_digests_takes_no_other_files(tmp_path: Path) -> None:
    """The digest is that of `printf x | sha256sum`."""
    for choice in CHECKPOINTS["owlv2"].files:
        (tmp_path / choice[0]).write_bytes(b"x")
    digest = "2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a4881"
    lines = [f"{digest}  config.json", f"{digest} *{checkpoints._WEIGHTS[0]}"]
    (tmp_path / PINS).write_text("\n".join(lines))
    with pytest.raises(Avs3dError, match=r"SHA256SUMS: preprocessor_config\.json of OWLv2 is not named"):
        find_checkpoint("owlv2", tmp_path)
    (tmp_path / PINS).write_text("\n".join([*lines, f"{digest}  preprocessor_config.json"]))
    assert find_checkpoint("owlv2", tmp_path)
    checkpoints.file_digest.cache_clear()  # as another process
    (tmp_path / checkpoints._WEIGHTS[0]).write_bytes(b"y")
    with pytest.raises(Avs3dError, match=r"model\.safetensors: not the file of OWLv2 that SHA256SUMS names") as error:
        find_checkpoint("owlv2", tmp_path)
    assert "expected 2d711642b726…" in line_of(error)
    assert find_checkpoint("owlv2", tmp_path, verify=False)


@pytest.mark.parametrize(
    "text", ["nothing", f"{'0' * 63}  config.json", f"{'0' * 64}  ", f"{'0' * 64}  none.json", "\xff"]
)
def test_broken_digests_are_one_line(tmp_path: Path, text: str) -> None:
    for choice in CHECKPOINTS["owlv2"].files:
        (tmp_path / choice[0]).write_bytes(b"x")
    (tmp_path / PINS).write_text(text, encoding="latin-1")
    with pytest.raises(Avs3dError, match=r"line 1: expected a sha256 and a file|none\.json") as error:
        find_checkpoint("owlv2", tmp_path)
    assert line_of(error)


def test_one_of_several_files_is_enough(tmp_path: Path) -> None:
    (tmp_path / "denseav_2head.ckpt").write_bytes(b"x")
    assert find_checkpoint("denseav", tmp_path) == {"denseav_sound.ckpt": tmp_path / "denseav_2head.ckpt"}


def load_sam(folder: Path) -> Any:
    from transformers import SamModel

    return load_pretrained("sam", SamModel, folder)


def test_a_whole_checkpoint_is_loaded_to_the_bit(sam: Path) -> None:
    from safetensors.torch import load_file

    model = load_sam(sam)
    assert not model.training
    weights = model.state_dict()
    for name, tensor in load_file(sam / "model.safetensors").items():
        assert torch.equal(weights[name], tensor), name


def test_truncated_weights(sam: Path, tmp_path: Path) -> None:
    whole = (sam / "model.safetensors").read_bytes()
    folder = copy_of(sam, tmp_path / "x", model_safetensors=whole[: len(whole) // 2])
    with pytest.raises(Avs3dError, match="cannot load the checkpoint of SAM: SafetensorError") as error:
        load_sam(folder)
    assert "put config.json" in line_of(error)


def test_a_config_that_is_no_json(sam: Path, tmp_path: Path) -> None:
    with pytest.raises(Avs3dError, match="cannot load the checkpoint of SAM") as error:
        load_sam(copy_of(sam, tmp_path / "x", config_json=b"{"))
    line_of(error)


def test_weights_of_another_size_are_refused_rather_than_left_random(sam: Path, tmp_path: Path) -> None:
    config = json.loads((sam / "config.json").read_text())
    config["vision_config"]["mlp_dim"] = 48
    folder = copy_of(sam, tmp_path / "x", config_json=json.dumps(config).encode())
    with pytest.raises(Avs3dError, match=r"weights are missing or have another shape, the first is vision_encoder\."):
        load_sam(folder)


def test_weights_that_lack_a_tensor_are_refused_rather_than_left_random(sam: Path, tmp_path: Path) -> None:
    from safetensors.torch import load_file, save_file

    folder = copy_of(sam, tmp_path / "x")
    weights = load_file(folder / "model.safetensors")
    del weights["mask_decoder.iou_token.weight"]
    save_file(weights, folder / "model.safetensors", metadata={"format": "pt"})
    with pytest.raises(Avs3dError, match=r"1 weights are missing .* mask_decoder\.iou_token\.weight"):
        load_sam(folder)


def test_a_pickle_that_runs_code_is_refused(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> Any:
            return os.mkdir, (str(tmp_path / "made"),)

    torch.save({"model": Evil()}, tmp_path / "imagebind_huge.pth")
    with pytest.raises(Avs3dError, match="cannot load the checkpoint of ImageBind"):
        load_weights("imagebind", tmp_path / "imagebind_huge.pth")
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("before", [None, "0"])
def test_nothing_is_fetched_while_loading(before: str | None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import huggingface_hub.constants

    if before is None:
        monkeypatch.delenv("HF_HUB_OFFLINE", raising=False)
    else:
        monkeypatch.setenv("HF_HUB_OFFLINE", before)
    opener, offline = torch.hub.urlopen, huggingface_hub.constants.HF_HUB_OFFLINE
    seen = []
    with pytest.raises(Avs3dError, match=r"it asks for https://example\.org/w\.pth") as error:  # noqa: PT012, SIM117
        with checkpoints.loading("denseav", tmp_path):
            seen += [huggingface_hub.constants.HF_HUB_OFFLINE, os.environ["HF_HUB_OFFLINE"]]
            torch.hub.load_state_dict_from_url("https://example.org/w.pth", model_dir=str(tmp_path))
    assert seen == [True, "1"]
    line_of(error)
    assert torch.hub.urlopen is opener is urllib.request.urlopen
    assert huggingface_hub.constants.HF_HUB_OFFLINE is offline
    assert os.environ.get("HF_HUB_OFFLINE") == before


def test_a_missing_package_is_named_with_the_way_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imports, "has_package", lambda module: module != "denseav")
    with pytest.raises(UsageError, match=r"denseav is not installed; DenseAV needs it: pip install git"):
        checkpoints.require_packages("denseav")
    monkeypatch.setattr(imports, "has_package", lambda module: module != "torch")
    with pytest.raises(UsageError, match="torch is not installed; SAM needs it"):
        checkpoints.require_packages("sam")


def test_an_error_of_ours_passes_through(tmp_path: Path) -> None:
    with pytest.raises(Avs3dError, match=r"^mine$"), checkpoints.loading("sam", tmp_path):
        raise Avs3dError("mine")
    with pytest.raises(ZeroDivisionError), checkpoints.loading("sam", tmp_path):
        raise ZeroDivisionError
