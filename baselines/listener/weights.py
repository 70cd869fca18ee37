"""The network's weights as a file: float16 safetensors that say what they are, checked before they are used."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from avs3d_bench.formats.files import atomic_path
from avs3d_bench.text.printable import printable
from baselines.listener.model import Listener, Widths

#: Changes when the network's layers, its features or its direction map do.
NETWORK_VERSION = 2
#: The weights of this package, their sha256 beside them, and the card of the run that made them.
PACKAGED = Path(__file__).parent / "weights" / "listener.safetensors"
WEIGHTS_FORMAT = "avs3d-listener"
_DIGEST_SUFFIX = ".sha256"


def save_weights(network: Listener, path: str | Path) -> str:
    """Write a network's weights as float16, and their sha256 to a file beside; both atomically.

    Returns:
        The sha256.
    """
    path = Path(path)
    tensors = {name: tensor.detach().cpu().half().contiguous() for name, tensor in _kept(network).items()}
    about = json.dumps({"version": NETWORK_VERSION, "widths": network.settings}, sort_keys=True)
    with atomic_path(path) as temporary:
        # One entry: the order of several differs from call to call, and with it the sha256.
        temporary.write_bytes(save(tensors, metadata={WEIGHTS_FORMAT: about}))
    digest = media.sha256_file(path)
    with atomic_path(digest_path(path)) as temporary:
        temporary.write_text(f"{digest}  {path.name}\n")
    return digest


def digest_path(path: Path) -> Path:
    """The file with the sha256 of a file of weights."""
    return path.with_name(path.name + _DIGEST_SUFFIX)


def load_listener(path: str | Path | None = None, *, device: torch.device | str = "cpu") -> tuple[Listener, str]:
    """The network with its weights in float32, in evaluation mode, and the weights' sha256.

    Args:
        path: file of weights; None: those of the package. The sha256 in the file beside it is checked, if there is one;
            that of the package must be there.
        device: where the network goes.

    Raises:
        Avs3dError: if the file is missing or cut short, is another one than its digest says, belongs to another version
            of the network, or holds NaN.
    """
    packaged = path is None
    path = PACKAGED if path is None else Path(path)
    if not path.is_file():
        hint = "this package comes without weights; train some and name them" if packaged else "expected weights"
        raise Avs3dError(f"{path}: no such file; {hint} (--weights FILE, see `avs3d train listener`)")
    digest = media.sha256_file(path)
    expected = _expected(path, required=packaged)
    if expected not in (None, digest):
        raise Avs3dError(f"{path}: sha256 {digest[:12]}…, expected {str(expected)[:12]}…; the file was changed or cut")
    try:
        with safe_open(path, "pt") as file:
            widths = _widths(path, file.metadata() or {})
            shapes = {name: tuple(file.get_slice(name).get_shape()) for name in file.keys()}  # noqa: SIM118
            _check_shapes(path, widths, shapes)
            tensors = {name: file.get_tensor(name).float() for name in shapes}
    except (SafetensorError, OSError) as error:
        raise Avs3dError(f"{path}: no whole safetensors file ({error}); copy or train it again") from None
    broken = next((name for name, tensor in tensors.items() if not torch.isfinite(tensor).all()), None)
    if broken is not None:
        raise Avs3dError(f"{path}: {broken} holds NaN or infinite numbers, expected finite weights; train it again")
    network = Listener(widths)
    network.load_state_dict(network.state_dict() | tensors)
    return network.eval().requires_grad_(False).to(device), digest


def _check_shapes(path: Path, widths: Widths, found: dict[str, tuple[int, ...]]) -> None:
    """Hold the file's tensors against those of a network of these widths, before any of them takes memory.

    Raises:
        Avs3dError: if they differ.
    """
    try:
        with torch.device("meta"):
            network = Listener(widths)
    except (RuntimeError, ValueError, AssertionError) as error:
        raise Avs3dError(f"{path}: widths that no network has ({str(error).splitlines()[0]}); copy it again") from None
    expected = {name: tuple(tensor.shape) for name, tensor in _kept(network).items()}
    if found != expected:
        name = next(name for name in sorted({*found, *expected}) if found.get(name) != expected.get(name))
        raise Avs3dError(
            f"{path}: its tensors are not those of version {NETWORK_VERSION} of the listener: {name} has shape "
            f"{found.get(name, 'none')}, expected {expected.get(name, 'none')}; train it again"
        )


def _kept(network: Listener) -> dict[str, Tensor]:
    """The tensors of a file of weights: counters of batches are whole numbers that no answer depends on."""
    return {name: tensor for name, tensor in network.state_dict().items() if tensor.is_floating_point()}


def _expected(path: Path, *, required: bool) -> str | None:
    beside = digest_path(path)
    if not beside.is_file():
        if required:
            raise Avs3dError(
                f"{beside}: missing, the digest of the weights cannot be checked; install the package again"
            )
        return None
    return (media.read_bytes(beside).decode(errors="replace").split() or [""])[0]


def _widths(path: Path, about: dict[str, str]) -> Widths:
    """The size of the network that the file names.

    Raises:
        Avs3dError: if it is none of this version.
    """
    if WEIGHTS_FORMAT not in about:
        raise Avs3dError(
            f"{path}: no weights of the listener, expected metadata named {WEIGHTS_FORMAT}; name another file"
        )
    try:
        said: dict[str, Any] = json.loads(about[WEIGHTS_FORMAT])
        if said["version"] != NETWORK_VERSION:
            raise Avs3dError(
                f"{path}: weights of version {printable(str(said['version']))[:20]} of the listener, expected "
                f"{NETWORK_VERSION}; take those of this version of the package, or train again"
            )
        lists = said["widths"].items()
        widths: Any = {name: tuple(value) if isinstance(value, list) else value for name, value in lists}
        return Widths(**widths).checked()
    except (KeyError, ValueError, TypeError, AttributeError, RecursionError) as error:
        kind = "nested too deeply" if isinstance(error, RecursionError) else printable(str(error))[:200]
        raise Avs3dError(f"{path}: its description of the network is damaged ({kind}); copy it again") from None
