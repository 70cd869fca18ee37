"""The vision and acoustic backends by name; each is imported only when it is asked for."""

from __future__ import annotations

from importlib import metadata

import cv2

from avs3d_bench import __version__
from avs3d_bench.errors import UsageError
from generators.acoustics.base import AcousticBackend
from generators.vision.base import VisionBackend


def vision_backend(name: str) -> VisionBackend:
    """The renderer called ``name``.

    Raises:
        UsageError: if there is none of that name.
        Avs3dError: if what it needs is not installed.
    """
    if name == "embree":
        from generators.vision.embree import EmbreeBackend

        return EmbreeBackend()
    if name == "habitat":
        from generators.vision.habitat import HabitatBackend

        return HabitatBackend()
    raise UsageError(f"unknown vision backend {name!r}: expected embree or habitat")


def acoustic_backend(name: str, *, absorption_scale: float = 1.0) -> AcousticBackend:
    """The acoustic engine called ``name``, with the absorption of every surface scaled (see `AcousticBackend`).

    Raises:
        UsageError: if there is none of that name.
        Avs3dError: if what it needs is not installed, or the scale is out of range.
    """
    if name == "soundspaces":
        from generators.acoustics.soundspaces import SoundSpacesBackend

        return SoundSpacesBackend(absorption_scale=absorption_scale)
    if name == "analytic":
        from generators.acoustics.analytic import AnalyticBackend

        return AnalyticBackend(absorption_scale=absorption_scale)
    raise UsageError(f"unknown acoustic backend {name!r}: expected soundspaces or analytic")


def backend_versions(vision: str, audio: str) -> dict[str, str]:
    """Name → version of everything whose change may change an observation's bytes."""
    from generators.scenes.cache import builder_version

    sight, sound = vision_backend(vision), acoustic_backend(audio)
    libraries = {name: metadata.version(name) for name in ("numpy", "scipy", "numba", "xatlas", "trimesh", "soundfile")}
    return {
        "avs3d-bench": __version__,
        "homes and assets": builder_version(),
        f"settings of {sound.name}": repr(sorted(sound.describe().items())),
        **libraries,
        "opencv": cv2.__version__,
        sight.name: sight.version,
        sound.name: sound.version,
    }
