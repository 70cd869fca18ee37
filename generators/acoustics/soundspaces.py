"""The acoustic engine of SoundSpaces 2.0 (RLRAudioPropagation) behind the `AcousticBackend` protocol.

The engine traces energy along rays through the acoustic twin of the scene and renders it through its own head-related
transfer functions. It is licensed CC-BY-NC 4.0: its output is for non-commercial research.

It hangs, crashes or lies on bad numbers, so that everything is checked here, before it gets there:
finite poses and vertices, unit quaternions, indices in range, a supported sample rate, positions inside the scene.

One session owns one fresh context with one thread: its generator advances from call to call, so the same sequence of
calls gives the same bytes in any process, and a lone call inside a sequence does not.

Reference: C. Chen et al., "SoundSpaces 2.0: A Simulation Platform for Visual-Acoustic Learning", NeurIPS 2022.
"""

from __future__ import annotations

import ctypes
import math
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from avs3d_bench.runtime.imports import needing
from generators.acoustics.base import Place, point_of
from generators.acoustics.directivity import Directivity
from generators.acoustics.geometry import (
    AcousticMesh,
    acoustic_mesh,
    checked_position,
    checked_scale,
    reflections_to_decay,
)
from generators.acoustics.materials import RESIDUAL, material_for, write_engine_json
from generators.acoustics.tracer.enclosure import Enclosure
from generators.acoustics.tracer.surfaces import surfaces_of
from generators.core.limits import check_ranges
from generators.core.scene import Scene

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import Scalar

#: Sample rates the built-in head-related transfer functions were verified at; higher ones abort the process.
SAMPLE_RATES = (16_000, 22_050, 32_000, 44_100)
#: A listener of the default 0.1 m radius hears everything 13 samples early.
LISTENER_RADIUS = 0.001
#: Why there is no session with a directivity.
NO_DIRECTIVITY = (
    "the soundspaces engine has only sources that are alike in all directions, found a directivity; leave it out, or "
    "use tracer or analytic"
)
#: The engine's omnidirectional channel is the spherical harmonic of order 0, 1/√(4π).
_OMNI_GAIN = math.sqrt(4 * math.pi)


@dataclass(frozen=True)
class RaySettings:
    """How much work an impulse response is worth.

    A response costs about rays × reflections. A reverberant room needs many reflections, but its level settles with few
    rays; an absorbing room the other way round. So a budget is given, and each room spends it in its own way.

    Attributes:
        reflections: budget: indirect rays × reflections of each.
        source_rays: rays traced from the source.
        decay_db: the indirect field is followed until it has fallen this far; gives the reflections of a ray.
        min_rays: lower limit of the number of indirect rays.
        max_rays: upper limit of the number of indirect rays.
        max_depth: upper limit of the reflections of a ray.
    """

    reflections: int = 250_000
    source_rays: int = 200
    decay_db: float = 50.0
    min_rays: int = 1000
    max_rays: int = 5000
    max_depth: int = 150

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            Avs3dError: if a number is out of its range.
        """
        ranges: dict[str, tuple[float, float]] = {
            "reflections": (1, 100_000_000),
            "source_rays": (1, 100_000),
            "decay_db": (1.0, 120.0),
            "min_rays": (1, 1_000_000),
            "max_rays": (self.min_rays, 1_000_000),
            "max_depth": (1, 1000),
        }
        check_ranges("ray settings", self, ranges)

    def rays(self, depth: int) -> int:
        """Indirect rays for ``depth`` reflections of each."""
        return min(max(self.min_rays, self.reflections // depth), self.max_rays)


class SoundSpacesBackend:
    """Impulse responses from the rlr-audio-propagation package (extra ``soundspaces``)."""

    name = "soundspaces"

    def __init__(
        self, settings: RaySettings | None = None, *, absorption_scale: float = 1.0, omni: bool = False
    ) -> None:
        """Check that the engine is there.

        Args:
            settings: how much work a response is worth.
            absorption_scale: factor of every surface's Eyring exponent, −ln(1 − α).
            omni: one omnidirectional channel without a head, for measurements; 1/r in the free field.

        Raises:
            Avs3dError: if the package is not installed, or the scale is out of range.
        """
        self.settings = settings or RaySettings()
        self.absorption_scale = checked_scale(absorption_scale)
        self.omni = omni
        self._engine = _import_engine()
        self.version = metadata.version("rlr-audio-propagation")

    def open(
        self,
        scene: Scene,
        source: Place,
        *,
        room: str,
        sample_rate: int = 44_100,
        directivity: Directivity | None = None,
    ) -> SoundSpacesSession:
        """Load ``scene`` with a point source at ``source`` (world, metres) standing in ``room``.

        Raises:
            Avs3dError: if the source, the meshes or the sample rate would make the engine hang, crash or lie, or there
                is a directivity.
        """
        if directivity is not None:
            raise Avs3dError(f"{scene.name}: {NO_DIRECTIVITY}")
        at = point_of(source)
        return SoundSpacesSession(
            self._engine, self.settings, scene, at, room, sample_rate, self.absorption_scale, omni=self.omni
        )

    def describe(self) -> dict[str, Scalar]:
        """The settings that go into observation.json."""
        return {
            "backend": self.name,
            "engine": "rlr-audio-propagation",
            "version": self.version,
            "licence": "CC-BY-NC-4.0",
            **asdict(self.settings),
            "hrtf": "none" if self.omni else "built-in",
            "listener_radius_m": LISTENER_RADIUS,
            "global_volume": 1.0,
            "residual_absorption": RESIDUAL,
            "transmission": False,
            "diffraction": False,
            "threads": 1,
            **({} if self.absorption_scale == 1 else {"absorption_scale": self.absorption_scale}),
        }


class SoundSpacesSession:
    """An open context with one source and one listener; see `AcousticSession`."""

    def __init__(
        self,
        engine: Any,
        settings: RaySettings,
        scene: Scene,
        source: tuple[float, float, float],
        room: str,
        sample_rate: int,
        absorption_scale: float = 1.0,
        *,
        omni: bool = False,
    ) -> None:
        if sample_rate not in SAMPLE_RATES:
            raise Avs3dError(
                f"{scene.name}: sample rate {sample_rate!r} Hz is not supported by the acoustic engine; "
                f"expected one of {', '.join(map(str, SAMPLE_RATES))}"
            )
        box = scene.room(room)
        mesh = acoustic_mesh(scene, source, absorption_scale=absorption_scale)
        self._scene_name = scene.name
        self._bounds = mesh.bounds
        self._surfaces = surfaces_of(mesh)
        self._room = box
        self._enclosure = self._enclosure_of(source)
        self.sample_rate = sample_rate
        # A room that is made more live rings on for longer.
        limit = math.ceil(settings.max_depth / min(absorption_scale, 1.0))
        self.depth = reflections_to_decay(mesh, box, settings.decay_db, limit)
        self._context: Any = _new_context(engine, settings, self.depth, sample_rate)
        _upload(self._context, mesh)
        layouts = engine.ChannelLayoutType
        self._channels = 1 if omni else 2
        self._gain = _OMNI_GAIN if omni else 1.0
        self._context.add_listener(engine.ChannelLayout(layouts.Mono if omni else layouts.Binaural, self._channels))
        self._context.set_listener_radius(0, LISTENER_RADIUS)
        self._context.add_source()
        self._context.set_source_position(0, self._enclosure.source.tolist())

    def move_source(self, source: Place) -> None:
        """Put the source elsewhere for the responses that follow.

        Raises:
            Avs3dError: if the session is closed, or the source is outside the scene.
        """
        if self._context is None:
            raise Avs3dError(f"{self._scene_name}: the acoustic session is closed; open a new one")
        self._enclosure = self._enclosure_of(point_of(source))
        self._context.set_source_position(0, self._enclosure.source.tolist())

    def _enclosure_of(self, source: tuple[float, float, float]) -> Enclosure:
        """The space of a source: from a closed body the engine lets a few stray rays out."""
        position = np.array(self._position(source, "source"))
        return Enclosure.of(self._scene_name, self._room, self._surfaces, position)

    def _position(self, position: tuple[float, float, float], what: str) -> list[float]:
        return checked_position(self._scene_name, what, position, self._bounds)

    def impulse_response(self, pose: Pose) -> NDArray[np.float32]:
        """Binaural room impulse response (2, n) float32, channel 0 left, global volume 1; (1, n) of an omni listener.

        ``Pose`` has already refused NaN and quaternions that are not of unit length.

        Raises:
            Avs3dError: if the session is closed, the listener is outside the scene, it or the source is in a closed
                body that the other is not in (`Enclosure`), or the engine fails.
        """
        if self._context is None:
            raise Avs3dError(f"{self._scene_name}: the acoustic session is closed; open a new one")
        position = self._position(pose.position, "listener")
        self._enclosure.check_listener(np.array(position))
        rotation = np.asarray(pose.rotation, dtype=np.float64)
        try:
            self._context.set_listener_position(0, position)
            self._context.set_listener_orientation_quaternion(0, (rotation / np.linalg.norm(rotation)).tolist())
            self._context.simulate()
            response = np.stack([self._context.get_ir_channel(0, 0, k) for k in range(self._channels)])
            response = (self._gain * response).astype(np.float32)
        except (SystemError, RuntimeError, ValueError) as error:
            raise Avs3dError(
                f"{self._scene_name}: the acoustic engine failed at listener {position}: {error}"
            ) from error
        if response.size == 0 or not np.isfinite(response).all() or not response.any():
            source = self._enclosure.source.tolist()
            raise Avs3dError(
                f"{self._scene_name}: no sound reaches listener {position} from source {source}; "
                "the listener is enclosed by faces without an opening"
            )
        return response

    def close(self) -> None:
        """Free the context."""
        self._context = None


def _import_engine() -> Any:
    with needing("--audio soundspaces", "pip install 'avs3d-bench[soundspaces]', or use --audio tracer"):
        import rlr_audio_propagation
    return rlr_audio_propagation


@contextmanager
def _quiet() -> Iterator[None]:
    """Send file descriptor 1 to the null device: the engine prints a line per context that would break progress bars.

    The C library's buffer must be emptied before the descriptor is put back, or the line comes out later.
    """
    sys.stdout.flush()
    try:
        saved = os.dup(1)
    except OSError:  # standard output is closed: nothing to protect
        yield
        return
    null = os.open(os.devnull, os.O_WRONLY)
    flush = ctypes.CDLL(None).fflush
    try:
        flush(None)
        os.dup2(null, 1)
        yield
    finally:
        flush(None)
        os.dup2(saved, 1)
        os.close(saved)
        os.close(null)


def _new_context(engine: Any, settings: RaySettings, depth: int, sample_rate: int) -> Any:
    config = engine.Config()
    config.sample_rate = float(sample_rate)
    config.thread_count = 1  # two threads never repeat
    config.indirect_ray_count = settings.rays(depth)
    config.source_ray_count = settings.source_rays
    config.indirect_ray_depth = depth
    config.global_volume = 1.0
    config.transmission = 0
    config.diffraction = 0
    config.temporal_coherence = 0
    with _quiet():
        return engine.Context(config)


def _upload(context: Any, mesh: AcousticMesh) -> None:
    """Materials first, then one object with all faces, grouped by material."""
    with tempfile.TemporaryDirectory(prefix="avs3d-acoustics-") as folder, _quiet():
        path = Path(folder) / "materials.json"
        write_engine_json(path, [material_for(label).scaled(mesh.absorption_scale) for label in mesh.groups])
        try:
            context.set_material_database_json(str(path))
            if not mesh.groups:  # an empty scene is a free field
                return
            context.add_object()
            context.add_mesh_vertices(mesh.vertices.reshape(-1).tolist())
            for label, faces in mesh.groups.items():
                context.add_mesh_indices(faces.reshape(-1).tolist(), 3, label)
            context.finalize_object_mesh(0)
        except SystemError as error:
            raise Avs3dError(f"the acoustic engine refused the scene's meshes or materials: {error}") from error
