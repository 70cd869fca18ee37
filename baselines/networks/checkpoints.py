"""Checkpoints of other people's networks: local folders, looked at before they are loaded, never downloaded.

Every network that a baseline runs is described once in `CHECKPOINTS`: which files its folder must hold, where they come
from, under which licence, and how large they are. A missing or broken file is reported in one line with all of this.
A folder with `SHA256SUMS`, as ``sha256sum *.* > SHA256SUMS`` writes it, is pinned: other files are refused.
Networks are loaded inside `loading`, where no library may fetch anything.
"""

from __future__ import annotations

import json
import os
import pickle
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import read_bytes, sha256_file
from avs3d_bench.runtime.imports import require_package

#: Weights as `save_pretrained` writes them: one file, or an index beside several.
_WEIGHTS = ("model.safetensors", "model.safetensors.index.json", "pytorch_model.bin", "pytorch_model.bin.index.json")
_PREPROCESSOR = ("preprocessor_config.json", "processor_config.json")
_TOKENIZER = ("tokenizer.json", "vocab.json", "vocab.txt")
_OFFLINE = ("HF_HUB_OFFLINE", "TRANSFORMERS_OFFLINE")
#: Lines ``sha256  FILE`` of the files that a folder must have, to the bit.
PINS = "SHA256SUMS"
#: Most layers of a part of a network.
_MOST_LAYERS = 1000
#: Longest quotation of a library's message (characters).
_CAUSE = 160


@dataclass(frozen=True)
class NetworkFiles:
    """The files and packages that a network needs.

    Attributes:
        name: as messages and submission.json name it.
        files: required files of the folder; of each inner tuple one file is enough.
        source: where the files come from.
        licence: of the weights.
        size: of the download, roughly.
        packages: modules that must be importable, beside torch.
        install: how to get those packages.
    """

    name: str
    files: tuple[tuple[str, ...], ...]
    source: str
    licence: str
    size: str
    packages: tuple[str, ...] = ()
    install: str = ""

    @property
    def advice(self) -> str:
        """Which files to put there, and all that must be known about them."""
        wanted = ", ".join(" or ".join(_brief(choice)) for choice in self.files)
        return f"put {wanted} there, from {self.source} ({self.licence}, {self.size})"


def _brief(choice: tuple[str, ...]) -> tuple[str, ...]:
    """The forms of weights that are worth naming."""
    return choice[:1] if choice == _WEIGHTS else choice


_TRANSFORMERS = "pip install 'avs3d-bench[baselines]'"


def _from_hugging_face(
    name: str,
    repository: str,
    size: str,
    *,
    install: str = _TRANSFORMERS,
    licence: str = "Apache-2.0",
    more: tuple[tuple[str, ...], ...] = (_PREPROCESSOR,),
) -> NetworkFiles:
    """A model of transformers: its configuration, its weights, and ``more`` files."""
    return NetworkFiles(
        name=name,
        files=(("config.json",), _WEIGHTS, *more),
        source=f"https://huggingface.co/{repository}",
        licence=licence,
        size=size,
        packages=("transformers",),
        install=install,
    )


#: Name on the command line → requirements of the network.
CHECKPOINTS: dict[str, NetworkFiles] = {
    "owlv2": _from_hugging_face("OWLv2", "google/owlv2-base-patch16-ensemble", "0.6 GB"),
    "mavl": NetworkFiles(
        name="MAVL",
        files=(("MDef_DETR_r101_epoch20_ore.pth", "MDef_DETR_r101_epoch20.pth"),),
        source="https://github.com/mmaaz60/mvits_for_class_agnostic_od",
        licence="MIT",
        size="about 0.8 GB",
        packages=("models.model",),
        install="clone https://github.com/mmaaz60/mvits_for_class_agnostic_od, build models/ops, add it to PYTHONPATH",
    ),
    "sam": _from_hugging_face("SAM", "facebook/sam-vit-huge", "2.6 GB"),
    "imagebind": NetworkFiles(
        name="ImageBind",
        files=(("imagebind_huge.pth",),),
        source="https://dl.fbaipublicfiles.com/imagebind/imagebind_huge.pth",
        licence="CC-BY-NC-SA-4.0, not for commercial use",
        size="4.5 GB",
        packages=("imagebind",),
        install="pip install git+https://github.com/facebookresearch/ImageBind",
    ),
    "pe-av": _from_hugging_face(
        "PE-AV",
        "facebook/pe-av-large",
        "several GB; pe-av-small and pe-av-base are smaller",
        install=f"{_TRANSFORMERS} timm torchvision",
    ),
    "denseav": NetworkFiles(
        name="DenseAV",
        files=(("denseav_sound.ckpt", "denseav_2head.ckpt"),),
        source="https://marhamilresearch4.blob.core.windows.net/denseav-public/hub/denseav_sound.ckpt",
        licence="MIT",
        size="about 1.4 GB",
        packages=("denseav",),
        install="pip install git+https://github.com/mhamilton723/DenseAV",
    ),
    "clap": _from_hugging_face("CLAP", "laion/clap-htsat-unfused", "0.6 GB", more=(_PREPROCESSOR, _TOKENIZER)),
    "sam3": _from_hugging_face(
        "SAM 3", "facebook/sam3", "3.4 GB", licence="SAM License, to be accepted there", more=(_TOKENIZER,)
    ),
    "grounding-dino": _from_hugging_face(
        "Grounding DINO", "IDEA-Research/grounding-dino-base", "0.9 GB", more=(_PREPROCESSOR, _TOKENIZER)
    ),
    "sam2": _from_hugging_face("SAM 2", "facebook/sam2.1-hiera-large", "0.9 GB", more=()),
}


def require_packages(kind: str) -> None:
    """Raise an error if packages of a network are missing; nothing is imported.

    Raises:
        UsageError: naming the missing package and how to install it.
    """
    checkpoint = CHECKPOINTS[kind]
    for package in ("torch", *checkpoint.packages):
        how = _TRANSFORMERS if package == "torch" else checkpoint.install
        require_package(package, user=checkpoint.name, how=how, kind=UsageError)


def find_checkpoint(kind: str, folder: str | Path | None, *, verify: bool = True) -> dict[str, Path]:
    """The files of a checkpoint.

    Args:
        kind: a key of `CHECKPOINTS`.
        folder: the folder that the user gave, or None.
        verify: compare the files with `PINS` of the folder, if it has them, which reads them whole.

    Returns:
        For each entry of `NetworkFiles.files`, keyed by its first name, the path of the file that is there.

    Raises:
        UsageError: if no folder was named.
        Avs3dError: if the folder, or a file of it, is missing, empty or not the pinned one.
    """
    checkpoint = CHECKPOINTS[kind]
    if folder is None:
        raise UsageError(f"no folder with the checkpoint of {checkpoint.name}: make one and {checkpoint.advice}")
    folder = Path(folder)
    if not folder.is_dir():
        raise Avs3dError(f"{folder}: no folder with the checkpoint of {checkpoint.name}; {checkpoint.advice}")
    found = {}
    for choice in checkpoint.files:
        there = [folder / name for name in choice if (folder / name).is_file()]
        if not there:
            missing = " or ".join(_brief(choice))
            raise Avs3dError(f"{folder}: {missing} of {checkpoint.name} is missing; {checkpoint.advice}")
        if there[0].stat().st_size == 0:
            raise Avs3dError(f"{there[0]}: empty, the checkpoint of {checkpoint.name} is broken; {checkpoint.advice}")
        found[choice[0]] = there[0]
    if verify and (folder / PINS).exists():
        _compare(folder, checkpoint.name, found.values())
    return found


@cache
def file_digest(path: Path) -> str:
    """The sha256 of a file of a checkpoint, read once in a process: it may have gigabytes."""
    return sha256_file(path)


def _compare(folder: Path, name: str, needed: Iterable[Path]) -> None:
    """Raise an error unless `PINS` of a folder name all files that are needed, and all that they name are these."""
    pins, pinned = folder / PINS, set()
    for number, line in enumerate(read_bytes(pins).decode(errors="replace").splitlines(), 1):
        digest, _, file = line.partition(" ")
        file = file.strip().removeprefix("*")
        if not re.fullmatch("[0-9a-f]{64}", digest) or not file:
            raise Avs3dError(f"{pins}, line {number}: expected a sha256 and a file, as sha256sum writes them")
        if (found := file_digest(folder / file)) != digest:
            raise Avs3dError(
                f"{folder / file}: not the file of {name} that {PINS} names (sha256 {found[:12]}…, expected "
                f"{digest[:12]}…); get that file again, or write {PINS} anew to take this one"
            )
        pinned.add(folder / file)
    for path in needed:
        if path not in pinned:
            raise Avs3dError(
                f"{pins}: {path.name} of {name} is not named; expected a line for each file: sha256sum *.* > {PINS}"
            )


@contextmanager
def loading(kind: str, folder: str | Path) -> Iterator[None]:
    """A block that loads a network: nothing is downloaded in it, and what fails becomes one line.

    Raises:
        Avs3dError: for every error of a library about unreadable, truncated or foreign files.
    """
    checkpoint = CHECKPOINTS[kind]
    try:
        with offline(), _quiet():
            yield
    except Avs3dError:
        raise
    except ImportError as error:
        raise UsageError(f"{checkpoint.name}: {_cause(error)}; {checkpoint.install}") from error
    except Exception as error:
        if not isinstance(error, _load_errors()):
            raise
        raise Avs3dError(
            f"{folder}: cannot load the checkpoint of {checkpoint.name}: {_cause(error)}; {checkpoint.advice}"
        ) from error


@contextmanager
def _quiet() -> Iterator[None]:
    """A block in which libraries neither draw bars nor talk; what matters, they raise."""
    with redirect_stdout(StringIO()):
        try:
            logging: Any = import_module("transformers.utils.logging")
        except ImportError:
            yield
            return
        verbosity, bars = logging.get_verbosity(), logging.is_progress_bar_enabled()
        logging.set_verbosity(logging.CRITICAL)
        logging.disable_progress_bar()
        try:
            yield
        finally:
            logging.set_verbosity(verbosity)
            if bars:
                logging.enable_progress_bar()


def _load_errors() -> tuple[type[Exception], ...]:
    """The exceptions of the libraries for wrong or damaged files."""
    known: list[type[Exception]] = [OSError, ValueError, RuntimeError, KeyError, TypeError, AttributeError, EOFError]
    known += [AssertionError, pickle.UnpicklingError]
    if "safetensors" in sys.modules:
        known.append(sys.modules["safetensors"].SafetensorError)
    if "huggingface_hub.errors" in sys.modules:
        known.append(sys.modules["huggingface_hub.errors"].StrictDataclassError)
    return tuple(known)


def _cause(error: BaseException) -> str:
    """The first line of a library's message, cut."""
    lines = str(error).strip().splitlines()
    text = f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__
    return text if len(text) <= _CAUSE else f"{text[:_CAUSE]}…"


@contextmanager
def offline() -> Iterator[None]:
    """A block in which neither the Hugging Face libraries nor torch.hub fetch a file.

    Caches that the user filled stay usable. `huggingface_hub` reads its environment once, when it is imported, so its
    constant is set as well.
    """
    constants: Any = import_module("huggingface_hub.constants")
    hub: Any = import_module("torch.hub")

    def refuse(url: Any, *_: Any, **__: Any) -> Any:
        where = getattr(url, "full_url", url)
        raise OSError(f"it asks for {where}, and nothing is downloaded here; fetch that file into torch.hub's cache")

    environment = {name: os.environ.get(name) for name in _OFFLINE}
    before = constants.HF_HUB_OFFLINE, hub.urlopen
    os.environ.update(dict.fromkeys(_OFFLINE, "1"))
    constants.HF_HUB_OFFLINE, hub.urlopen = True, refuse
    try:
        yield
    finally:
        constants.HF_HUB_OFFLINE, hub.urlopen = before
        for name, value in environment.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def load_pretrained(kind: str, cls: Any, folder: str | Path) -> Any:
    """A transformers model in float32 and evaluation mode, with every one of its weights from the folder.

    `from_pretrained` only warns about weights that the files lack and leaves them random; here that is an error.

    Args:
        kind: a key of `CHECKPOINTS`.
        cls: a class with `from_pretrained`.
        folder: the checkpoint.

    Raises:
        Avs3dError: if the files cannot be read or do not hold the weights of ``cls``.
    """
    import torch

    with loading(kind, folder):
        _check_depth(json.loads((Path(folder) / "config.json").read_bytes()))
        model, info = cls.from_pretrained(
            str(folder),
            local_files_only=True,
            dtype=torch.float32,
            # Collected, so that the message below can name them.
            ignore_mismatched_sizes=True,
            output_loading_info=True,
        )
        absent = sorted({*info["missing_keys"], *(key for key, *_ in info["mismatched_keys"])})
        if absent:
            raise ValueError(f"{len(absent)} weights are missing or have another shape, the first is {absent[0]}")
        broken = next((name for name, one in model.named_parameters() if not torch.isfinite(one).all()), None)
        if broken is not None:
            raise ValueError(f"{broken} holds NaN or infinite numbers")
    return model.eval().requires_grad_(False)


def _check_depth(config: Any, name: str = "") -> None:
    """Refuse a configuration with more layers than any network has: building them would take for ever.

    Raises:
        ValueError: naming the field.
    """
    if isinstance(config, dict):
        for key, value in config.items():
            _check_depth(value, str(key))
    elif isinstance(config, int) and ("layers" in name or "depth" in name) and config > _MOST_LAYERS:
        raise ValueError(f"config.json: {name[:40]} {config}, expected at most {_MOST_LAYERS:,}")


def load_weights(kind: str, path: Path) -> Any:
    """The tensors of a ``.pth`` file, on the CPU; only tensors and plain containers are unpickled.

    Raises:
        Avs3dError: if the file is no such file.
    """
    import torch

    with loading(kind, path.parent):
        held = torch.load(path, map_location="cpu", weights_only=True)
        for name, tensor in _tensors(held):
            if not torch.isfinite(tensor).all():
                raise ValueError(f"{name} holds NaN or infinite numbers")
    return held


def _tensors(held: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """The tensors in nested dictionaries, by name."""
    if isinstance(held, dict):
        for key, value in held.items():
            yield from _tensors(value, str(key))
    elif hasattr(held, "is_floating_point"):
        yield name, held
