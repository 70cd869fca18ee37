"""The vision and acoustic backends by name; a backend is imported on first use."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from avs3d_bench import __version__
from avs3d_bench.errors import UsageError, did_you_mean, excerpt
from avs3d_bench.runtime.imports import import_by_name
from avs3d_bench.runtime.provenance import Provenance, provenance
from generators.acoustics.base import AcousticBackend, CompiledBackend
from generators.acoustics.receivers import check_engine
from generators.core.cuda import cuda_version
from generators.core.rays import TRACERS
from generators.options import EngineOptions
from generators.vision import camera
from generators.vision.base import VisionBackend

#: Backends by name: module and class of each.
VISION = {
    "embree": "generators.vision.embree:EmbreeBackend",
    "cuda": "generators.vision.cuda:CudaBackend",
    "habitat": "generators.vision.habitat:HabitatBackend",
    "pathtraced": "generators.vision.pathtraced:PathtracedBackend",
    "splats": "generators.vision.splats.backend:SplatsBackend",
}
ACOUSTIC = {
    "soundspaces": "generators.acoustics.soundspaces:SoundSpacesBackend",
    "tracer": "generators.acoustics.tracer.backend:TracerBackend",
    "analytic": "generators.acoustics.analytic:AnalyticBackend",
}
#: Renderers built on others, and on which: these count as used.
BUILT_ON = {"pathtraced": ("embree",), "splats": ("embree",)}
#: Renderers that draw on the device of ``--device``, whatever it is.
VISION_ON_DEVICE = ("splats",)
#: Acoustic engines that work on the device of ``--device``.
ON_DEVICE = ("tracer",)
#: Acoustic engines whose random numbers have a seed.
SEEDED = ("tracer", "analytic")
#: Acoustic engines whose sources may have a directivity.
DIRECTED = ("tracer", "analytic")


def vision_backend(name: str, device: str = "cpu") -> VisionBackend:
    """The renderer called ``name``.

    Args:
        name: one of `VISION`.
        device: where it draws, if it can choose.

    Raises:
        UsageError: if there is none of that name.
        Avs3dError: if what it needs is not installed.
    """
    if name not in VISION:
        hint = did_you_mean(name, VISION)
        raise UsageError(f"unknown vision backend {excerpt(name)}: expected {_any_of(VISION)}{hint}")
    arguments = {"device": device} if device != "cpu" and name in VISION_ON_DEVICE else {}
    backend: VisionBackend = import_by_name(VISION[name])(**arguments)
    return backend


def acoustic_backend(
    options: EngineOptions, *, absorption_scale: float = 1.0, seed: int | None = None
) -> AcousticBackend:
    """The acoustic engine that ``options`` name, with its receivers, on its device.

    Args:
        options: of the run. Engines that cannot choose a device work on the CPU.
        absorption_scale: see `AcousticBackend`.
        seed: of the random numbers, of an engine that has a seed; None: the engine's usual one.

    Raises:
        UsageError: if there is no engine of that name, or it has no such receivers.
        Avs3dError: if what it needs is not installed, or the scale is out of range.
    """
    name, receivers = options.engine, options.receivers
    if name not in ACOUSTIC:
        hint = did_you_mean(name, ACOUSTIC)
        raise UsageError(f"unknown acoustic backend {excerpt(name)}: expected {_any_of(ACOUSTIC)}{hint}")
    arguments: dict[str, Any] = {"absorption_scale": absorption_scale}
    if receivers:
        check_engine(name, hrtf=receivers.hrtf or receivers.family or None, **receivers.channels)
        arguments |= {"receiver": receivers.head(), "others": receivers.others()}
    if options.device != "cpu" and name in ON_DEVICE:
        arguments["device"] = options.device
    if seed is not None and name in SEEDED:
        arguments["seed"] = seed
    backend: AcousticBackend = import_by_name(ACOUSTIC[name])(**arguments)
    return backend


def check_directed(engine: str, what: str) -> None:
    """Refuse an engine whose sources are alike in all directions.

    Args:
        engine: its name.
        what: whose source has a directivity.

    Raises:
        UsageError: one line.
    """
    if engine not in DIRECTED:
        raise UsageError(
            f"{what}: directivity needs the engine {_any_of(DIRECTED)}, found {engine}: add --audio {DIRECTED[0]}, or "
            "leave directivity out"
        )


def warm_up(options: EngineOptions) -> None:
    """Import renderer and engine, read what receivers need, compile the kernels if there are any.

    Raises:
        UsageError: if there is no renderer or engine of that name.
        Avs3dError: if what it needs is not installed.
    """
    vision_backend(options.renderer, options.device).warm_up()
    if options.camera != "ideal":
        camera.warm_up()
    engine = acoustic_backend(options)
    if isinstance(engine, CompiledBackend):
        engine.warm_up()


def _any_of(names: Iterable[str]) -> str:
    """``a, b or c``."""
    *first, last = names
    return f"{', '.join(first)} or {last}"


def unused_backends(options: EngineOptions) -> tuple[str, ...]:
    """The entries of the backends and ray tracers that are not chosen, and so never run."""
    drawing = (options.renderer, *BUILT_ON.get(options.renderer, ()))
    unused = [entry for name, entry in VISION.items() if name not in drawing]
    unused += [entry for name, entry in ACOUSTIC.items() if name != options.engine]
    return (*unused, *(entry for name, entry in TRACERS.items() if name not in ("cpu", options.device)))


def observation_provenance(options: EngineOptions) -> Provenance:
    """The software that observations made with these options depend on."""
    return provenance("observation", without=unused_backends(options))


def backend_versions(options: EngineOptions) -> dict[str, str]:
    """Name → version of all software and settings that an observation's bytes may depend on.

    Raises:
        UsageError: if there is no backend of that name.
        Avs3dError: if what a backend needs is not installed, or the device cannot be used.
    """
    renderer = vision_backend(options.renderer, options.device)
    engine = acoustic_backend(EngineOptions(audio=options.audio, device=options.device))
    device = options.device
    return {
        "avs3d-bench": __version__,
        **observation_provenance(options).versions,
        f"settings of {engine.name}": repr(sorted(engine.describe().items())),
        renderer.name: renderer.version,
        engine.name: engine.version,
        **({} if device == "cpu" else {f"device {device}": cuda_version()}),
    }
