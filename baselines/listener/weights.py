"""The network's weights as a file: float16 safetensors that say what they are, checked before they are used."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from avs3d_bench.formats.files import atomic_path
from avs3d_bench.text.printable import printable
from baselines.listener.model import Listener, Widths
from baselines.listener.shards import LOOK_SIDES

#: Changes when the network's layers, its features or its direction map do.
NETWORK_VERSION = 3
#: Versions that can be read: 2 has no output for what it cannot name, and no calibration.
READABLE = (2, NETWORK_VERSION)
#: The weights of this package, their sha256 beside them, and the card of the run that made them.
PACKAGED = Path(__file__).parent / "weights" / "listener.safetensors"
WEIGHTS_FORMAT = "avs3d-listener"
_DIGEST_SUFFIX = ".sha256"


@dataclass(frozen=True)
class Calibration:
    """What validation homes say of a network's probabilities, and where to mark.

    Attributes:
        mask: temperature of the mask: its log-odds, less the bias, are divided by this (Guo et al., "On calibration of
            modern neural networks", ICML 2017, §4.2).
        audible: the same of what is heard.
        threshold: probability, after this, that the peak of a frame needs for anything to be marked as sounding.
        category: probability of a pixel's class above which it is marked, for masks of a category.
        share: of the peak's probability, above which a pixel is marked as sounding (`masks.marked`); None, as in files
            before this field: marked is every pixel above the threshold.
        bias: of the log-odds of the mask (J. Platt, "Probabilistic outputs for support vector machines", 1999); files
            before this field have none.
        finest: side of the finest of several looks (pixels) with which these were chosen (`predict.looks_at`); in files
            before this field 504.
    """

    mask: float = 1.0
    audible: float = 1.0
    threshold: float = 0.5
    category: float = 0.2
    share: float | None = None
    bias: float = 0.0
    finest: int = 504

    def checked(self) -> Calibration:
        """The same; for numbers that a file names.

        Raises:
            ValueError: if a temperature is not between .05 and 20, a threshold or share not between 0 and 1, a bias
                beyond 20, or the finest look not one of `shards.LOOK_SIDES`.
        """
        given = {name: number for name, number in asdict(self).items() if (name, number) != ("share", None)}
        for name, number in given.items():
            if type(number) not in (int, float):
                raise ValueError(f"{name}: expected a number")
        for name in ("mask", "audible"):
            if not 0.05 <= getattr(self, name) <= 20:
                raise ValueError(f"{name}: expected a temperature between 0.05 and 20")
        for name in given.keys() - {"mask", "audible", "bias", "finest"}:
            if not 0 < given[name] < 1:
                raise ValueError(f"{name}: expected a probability between 0 and 1")
        if not -20 <= self.bias <= 20:
            raise ValueError("bias: expected log-odds between -20 and 20")
        if self.finest not in LOOK_SIDES:
            raise ValueError(f"finest: expected one of {', '.join(map(str, LOOK_SIDES))}")
        return self


class LoadedWeights(NamedTuple):
    """What a file of weights holds.

    Attributes:
        network: in evaluation mode.
        digest: sha256 of the file.
        calibration: of the file; None where it has none.
    """

    network: Listener
    digest: str
    calibration: Calibration | None


def save_weights(network: Listener, path: str | Path, calibration: Calibration | None = None) -> str:
    """Write a network's weights as float16, and their sha256 to a file beside; both atomically.

    Means and variances of layers stay float32: variances of features exceed the 65,504 that float16 ends at.

    Args:
        network: whose weights.
        path: of the file.
        calibration: is written into the file.

    Returns:
        The sha256.

    Examples:
        >>> small = Widths(
        ...     image=(8, 8, 16, 16, 16), blocks=(0, 1, 1, 1, 1), decoder=(16, 16, 8, 8), audio=(8, 8, 16, 16)
        ... )
        >>> digest = save_weights(Listener(small), "small.safetensors")
        >>> network, found = load_listener("small.safetensors")
        >>> found == digest, network.widths == small
        (True, True)
    """
    path = Path(path)
    tensors = {
        name: (tensor.float() if _is_moment(name) else tensor.half()).detach().cpu().contiguous()
        for name, tensor in _kept(network).items()
    }
    said: dict[str, Any] = {"version": NETWORK_VERSION, "widths": network.settings}
    if calibration is not None:
        said["calibration"] = asdict(calibration)
    about = json.dumps(said, sort_keys=True)
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
        path: file of weights; None: those of the package.
        device: where the network goes.

    Raises:
        Avs3dError: see `read_weights`.

    Examples:
        >>> network, digest = load_listener("weights/listener.safetensors")  # without a file: the package's weights
        >>> network.training, len(digest)
        (False, 64)
    """
    found = read_weights(path, device=device)
    return found.network, found.digest


def read_weights(path: str | Path | None = None, *, device: torch.device | str = "cpu") -> LoadedWeights:
    """A file of weights: the network in float32 and evaluation mode, the sha256, the calibration.

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
            widths, calibration = _said(path, file.metadata() or {})
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
    return LoadedWeights(network.eval().requires_grad_(False).to(device), digest, calibration)


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


def _is_moment(name: str) -> bool:
    """Whether a tensor is the mean or the variance of a layer's input over the batches."""
    return name.endswith((".running_mean", ".running_var"))


def _expected(path: Path, *, required: bool) -> str | None:
    beside = digest_path(path)
    if not beside.is_file():
        if required:
            raise Avs3dError(
                f"{beside}: missing, the digest of the weights cannot be checked; install the package again"
            )
        return None
    return (media.read_bytes(beside).decode(errors="replace").split() or [""])[0]


def _said(path: Path, about: dict[str, str]) -> tuple[Widths, Calibration | None]:
    """The size of the network that the file names, and its calibration.

    Raises:
        Avs3dError: if it is none of a version that can be read.
    """
    if WEIGHTS_FORMAT not in about:
        raise Avs3dError(
            f"{path}: no weights of the listener, expected metadata named {WEIGHTS_FORMAT}; name another file"
        )
    try:
        said: dict[str, Any] = json.loads(about[WEIGHTS_FORMAT])
        if said["version"] not in READABLE:
            raise Avs3dError(
                f"{path}: weights of version {printable(str(said['version']))[:20]} of the listener, expected "
                f"{' or '.join(map(str, READABLE))}; take those of this version of the package, or train again"
            )
        lists = said["widths"].items()
        widths: Any = {name: tuple(value) if isinstance(value, list) else value for name, value in lists}
        found = Calibration(**said["calibration"]).checked() if "calibration" in said else None
        return Widths(**widths).checked(), found
    except (KeyError, ValueError, TypeError, AttributeError, RecursionError) as error:
        kind = "nested too deeply" if isinstance(error, RecursionError) else printable(str(error))[:200]
        raise Avs3dError(f"{path}: its description of the network is damaged ({kind}); copy it again") from None
