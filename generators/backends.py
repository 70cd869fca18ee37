"""The vision and acoustic backends by name; a backend is imported on first use."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from avs3d_bench import __version__
from avs3d_bench.errors import UsageError
from avs3d_bench.imports import import_by_name
from avs3d_bench.provenance import Provenance, provenance
from generators.acoustics.base import AcousticBackend, CompiledBackend
from generators.core.cuda import cuda_version
from generators.core.rays import TRACERS
from generators.receivers import Receivers, check_engine
from generators.vision.base import VisionBackend

#: Backends by name: module and class of each.
VISION = {
    "embree": "generators.vision.embree:EmbreeBackend",
    "cuda": "generators.vision.cuda:CudaBackend",
    "habitat": "generators.vision.habitat:HabitatBackend",
}
ACOUSTIC = {
    "soundspaces": "generators.acoustics.soundspaces:SoundSpacesBackend",
    "tracer": "generators.acoustics.tracer.backend:TracerBackend",
    "analytic": "generators.acoustics.analytic:AnalyticBackend",
}
#: Acoustic engines that work on the device of ``--device``.
ON_DEVICE = ("tracer",)
#: Acoustic engines whose random numbers have a seed.
SEEDED = ("tracer", "analytic")
#: The renderer of each device, where none is named.
RENDERERS = {"cpu": "embree", "cuda": "cuda"}


def vision_backend(name: str) -> VisionBackend:
    """The renderer called ``name``.

    Raises:
        UsageError: if there is none of that name.
        Avs3dError: if what it needs is not installed.
    """
    if name not in VISION:
        raise UsageError(f"unknown vision backend {name!r}: expected {_any_of(VISION)}")
    backend: VisionBackend = import_by_name(VISION[name])()
    return backend


def acoustic_backend(
    name: str,
    *,
    absorption_scale: float = 1.0,
    receivers: Receivers | None = None,
    device: str = "cpu",
    seed: int | None = None,
) -> AcousticBackend:
    """The acoustic engine called ``name``.

    Args:
        name: of the engine.
        absorption_scale: see `AcousticBackend`.
        receivers: what hears the sound beside, or instead of, the engine's own head.
        device: what traces the sound, of an engine that can choose; the others work on the CPU.
        seed: of the random numbers, of an engine that has a seed; None: the engine's usual one.

    Raises:
        UsageError: if there is no engine of that name, or it has no such receivers.
        Avs3dError: if what it needs is not installed, or the scale is out of range.
    """
    if name not in ACOUSTIC:
        raise UsageError(f"unknown acoustic backend {name!r}: expected {_any_of(ACOUSTIC)}")
    options: dict[str, Any] = {"absorption_scale": absorption_scale}
    if receivers:
        check_engine(name, hrtf=receivers.hrtf, **receivers.channels)
        options |= {"receiver": receivers.head(), "others": receivers.others()}
    if device != "cpu" and name in ON_DEVICE:
        options["device"] = device
    if seed is not None and name in SEEDED:
        options["seed"] = seed
    backend: AcousticBackend = import_by_name(ACOUSTIC[name])(**options)
    return backend


def warm_up_acoustics(name: str, receivers: Receivers | None = None, device: str = "cpu") -> None:
    """Import the acoustic engine called ``name``, read what its receivers need, compile its kernels if it has any.

    Raises:
        UsageError: if there is none of that name.
        Avs3dError: if what it needs is not installed.
    """
    engine = acoustic_backend(name, receivers=receivers, device=device)
    if isinstance(engine, CompiledBackend):
        engine.warm_up()


def _any_of(names: Iterable[str]) -> str:
    """``a, b or c``."""
    *first, last = names
    return f"{', '.join(first)} or {last}"


def unused_backends(vision: str, audio: str, device: str = "cpu") -> tuple[str, ...]:
    """The entries of the backends and ray tracers that are not chosen, and so never run."""
    unused = [entry for name, entry in VISION.items() if name != vision]
    unused += [entry for name, entry in ACOUSTIC.items() if name != audio]
    return (*unused, *(entry for name, entry in TRACERS.items() if name not in ("cpu", device)))


def observation_provenance(vision: str, audio: str, device: str = "cpu") -> Provenance:
    """The software that observations made with these backends depend on."""
    return provenance("observation", without=unused_backends(vision, audio, device))


def backend_versions(vision: str, audio: str, device: str = "cpu") -> dict[str, str]:
    """Name → version of all software and settings that an observation's bytes may depend on.

    Raises:
        UsageError: if there is no backend of that name.
        Avs3dError: if what a backend needs is not installed, or the device cannot be used.
    """
    sight, sound = vision_backend(vision), acoustic_backend(audio, device=device)
    software = observation_provenance(vision, audio, device)
    return {
        "avs3d-bench": __version__,
        **software.versions,
        f"settings of {sound.name}": repr(sorted(sound.describe().items())),
        sight.name: sight.version,
        sound.name: sound.version,
        **({} if device == "cpu" else {f"device {device}": cuda_version()}),
    }
